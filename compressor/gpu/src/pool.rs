//! Some tiles of one or several bundles on a device, in numbered slots that are filled and emptied.

use crate::features::{Features, Interval, Known};
use crate::place::{Lattice, Site};
use crate::request::{DecodeParams, Options, Request, SlotRequest, Target, Work};
use crate::shader::Output;
use crate::stage::{self, Stage};
use crate::sun::Held;
use crate::survey::Survey;
use crate::tile::{self, Full, Placed};
use crate::{Error, Result};
use ndgi::Bundle;
use ndgi::at::{At, SunAt};
use ndgi::time::fold_hour;
use range_alloc::RangeAllocator;
use std::ops::Range;
use std::sync::Arc;

/// Longest side of a layer of maps, where slots are not longer.
const SIDE: u32 = 2048;
const RESIDENT: &str = "ndgi resident";
/// Most words of a buffer: texels of two bytes are numbered in 32 bits.
const MOST_WORDS: u64 = 1 << 30;

/// Some tiles of one or several bundles on a device, in numbered slots that are filled and emptied.
/// [`Features::read`] and [`Features::interval`] do all that takes long, on any thread; a pool uploads and
/// dispatches.
///
/// **Order.** [`Pool::load`] and [`Pool::set_interval`] write by the queue: before the commands of the *next*
/// submission, whenever those were recorded. So in a frame load first, then record decoding, then submit; and
/// between recording a decode and submitting it, load nothing and set no interval: a slot might have another
/// tile by then, or an unloaded one's memory another slot's. An encoder may be dropped instead of submitted.
///
/// **Room.** Each slot has a rectangle of a texture for the largest tile's maps. The rest of a tile differs
/// in size (normals most), and lies in parts of two buffers. They have room for as many of the largest tiles
/// as there are slots, and an eighth more: the interval's by a bound that the indices tell, the resident one
/// by what is likely. That one grows, by an allocation and a copy on the device, up to the indices' bound,
/// several times as much. Where the device's limits or the bound are reached, or what is free is in parts too
/// small, [`Pool::load`] gives [`Error::Full`].
#[derive(Debug)]
pub struct Pool {
    stage: Stage,
    texture: wgpu::Texture,
    lattice: Lattice,
    bundles: Vec<Arc<Bundle>>,
    slots: Vec<Option<Slot>>,
    resident: RangeAllocator<u32>,
    interval: RangeAllocator<u32>,
    /// Words up to which the resident buffer grows.
    most: u64,
}

/// A tile in a slot.
#[derive(Debug)]
struct Slot {
    bundle: usize,
    known: Arc<Known>,
    site: Site,
    resident: Range<u32>,
    interval: Range<u32>,
    /// The times of its part of the interval's buffer, and the visibility in it.
    held: Option<([usize; 2], Held)>,
}

impl Pool {
    /// Empty slots, sized by what the bundles' indices tell; no tile is read. Bundles may differ in their
    /// timelines, as mip levels of a scene do. Pipelines are made when they are first needed.
    ///
    /// # Errors
    /// [`Error::Invalid`] without a bundle or a slot; [`Error::Device`] where the device has too few layers
    /// of textures, or too small textures or buffers for one tile.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        bundles: &[Arc<Bundle>],
        slots: u32,
        options: Options,
    ) -> Result<Self> {
        if bundles.is_empty() || slots == 0 {
            return Err(Error::Invalid(format!(
                "{slots} slots for {} bundles; expected at least 1 of each",
                bundles.len()
            )));
        }
        let options = stage::resolved(device, options)?;
        let survey = Survey::of(bundles.iter().map(|bundle| &**bundle));
        let limits = device.limits();
        let lattice = Lattice::new(survey.rectangle(), slots, SIDE.min(limits.max_texture_dimension_2d));
        let texture = stage::texture(device, lattice.extent(), options.unpacks)?;
        let codebook: Vec<u32> = if survey.shadows { stage::codebook().collect() } else { Vec::new() };
        let most = (limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) / 4).min(MOST_WORDS);
        let [likely, _] = survey.words(slots as usize, |room| room.likely);
        let [resident, largest] = survey.words(slots as usize, |room| room.resident);
        let [interval, largest_interval] = survey.words(slots as usize, |room| room.interval);
        let before = codebook.len() as u64;
        for (what, words) in [("resident", before + largest), ("interval", largest_interval)] {
            if words > most {
                let what = format!(
                    "{what} buffer: a tile takes up to {} bytes; the device binds at most {}",
                    4 * words,
                    4 * most
                );
                return Err(Error::Device(what));
            }
        }
        let buffers = [
            stage::buffer(device, RESIDENT, (before + likely.max(largest)).min(most)),
            stage::buffer(device, "ndgi interval", interval.max(largest_interval).min(most)),
        ];
        queue.write_buffer(&buffers[0], 0, bytemuck::cast_slice(&codebook));
        let free = buffers.each_ref().map(|buffer| (buffer.size() / 4) as u32);
        Ok(Pool {
            stage: Stage::new(device, options, &survey, &texture, buffers),
            texture,
            lattice,
            bundles: bundles.to_vec(),
            slots: (0..slots).map(|_| None).collect(),
            resident: RangeAllocator::new(codebook.len() as u32..free[0]),
            interval: RangeAllocator::new(0..free[1]),
            most: (before + resident).min(most),
        })
    }

    /// Compiles the pipelines for an output, which takes 0.1 s or more; else they are when they are first
    /// needed.
    pub fn prepare(&self, output: Output) {
        self.stage.prepare(output);
    }

    /// The options that the device supports: the argument of [`Features::read`].
    pub fn options(&self) -> &Options {
        &self.stage.options
    }

    /// The bundles.
    pub fn bundles(&self) -> &[Arc<Bundle>] {
        &self.bundles
    }

    /// Number of slots.
    pub fn slots(&self) -> u32 {
        self.slots.len() as u32
    }

    /// Bytes on the device now, targets apart, whatever is loaded: more once the resident buffer grew.
    pub fn bytes(&self) -> u64 {
        self.stage.bytes
    }

    /// Fills a slot, before the next submission; `bundle` is a number of [`Pool::bundles`]. What was there is
    /// gone. No interval is set.
    ///
    /// # Errors
    /// [`Error::Full`] where the buffers have no room, mostly because free room is in small parts: the slot
    /// is then empty; unload others, and try again. [`Error::Invalid`] for a slot or bundle that there is
    /// not, or features of another bundle or of other options: the slot is as it was.
    pub fn load(&mut self, queue: &wgpu::Queue, slot: u32, bundle: usize, features: &Features) -> Result<()> {
        self.check_slot(slot)?;
        let Some(of) = self.bundles.get(bundle) else {
            let what = format!("bundle {bundle}; expected a number below {}", self.bundles.len());
            return Err(Error::Invalid(what));
        };
        let Features { known, data } = features;
        known.check(of)?;
        let picture = &data.picture;
        if known.maps.is_some() && picture.unpacks != self.stage.options.unpacks {
            return Err(Error::Invalid(format!(
                "features of {:?} were read with options other than Pool::options",
                known.place
            )));
        }
        self.unload(slot);
        let words = data.words.len() as u32;
        let mut resident = allocate(&mut self.resident, words, "resident");
        if resident.is_err() && self.grow(queue, words) {
            resident = allocate(&mut self.resident, words, "resident");
        }
        let resident = resident?;
        let interval = allocate(&mut self.interval, known.interval_words(), "interval");
        if interval.is_err() {
            free(&mut self.resident, resident.clone());
        }
        let interval = interval?;
        let corner = self.lattice.spot(slot);
        picture.upload(queue, &self.texture, [0, 0], picture.size, corner);
        queue.write_buffer(
            &self.stage.resident,
            4 * u64::from(resident.start),
            bytemuck::cast_slice(&data.words),
        );
        let maps =
            picture.maps.iter().map(|([x, y, _], _)| [corner[0] + x, corner[1] + y, corner[2]]).collect();
        let site = Site { resident: resident.start, interval: interval.start, maps };
        self.slots[slot as usize] =
            Some(Slot { bundle, known: Arc::clone(known), site, resident, interval, held: None });
        Ok(())
    }

    /// Makes the resident buffer twice as large, or so that it has room for this many words at its end; gives
    /// whether it could grow.
    fn grow(&mut self, queue: &wgpu::Queue, words: u32) -> bool {
        let (old, device) = (&self.stage.resident, &self.stage.device);
        let now = old.size() / 4;
        let then = (2 * now).max(now + u64::from(words)).min(self.most);
        if then <= now {
            return false;
        }
        let new = stage::buffer(device, RESIDENT, then);
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(old, 0, &new, 0, old.size());
        // What was written before is written by this submission, first.
        queue.submit([encoder.finish()]);
        self.stage.bytes += new.size() - old.size();
        self.stage.resident = new;
        self.resident.grow_to(then as u32);
        true
    }

    /// Empties a slot; does nothing for an empty or missing slot.
    pub fn unload(&mut self, slot: u32) {
        if let Some(Slot { resident, interval, .. }) =
            self.slots.get_mut(slot as usize).and_then(Option::take)
        {
            free(&mut self.resident, resident);
            free(&mut self.interval, interval);
        }
    }

    /// Uploads the visibility of the sun of a slot's tile in an interval, before the next submission.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an empty slot, or an interval of another tile.
    pub fn set_interval(&mut self, queue: &wgpu::Queue, slot: u32, interval: &Interval) -> Result<()> {
        self.slot(slot)?;
        let Some(Some(of)) = self.slots.get_mut(slot as usize) else { return Ok(()) };
        let is_its = (of.known.place, of.known.entry) == (interval.place(), interval.entry);
        if !is_its || interval.words.len() > of.interval.len() {
            let what = format!(
                "an interval of {:?} for slot {slot}, which has {:?}",
                interval.place(),
                of.known.place
            );
            return Err(Error::Invalid(what));
        }
        if interval.bytes() > 0 {
            let to = 4 * u64::from(of.interval.start);
            queue.write_buffer(&self.stage.interval, to, bytemuck::cast_slice(&interval.words));
        }
        of.held = Some((interval.times, interval.held));
        Ok(())
    }

    /// The times of the interval that was set for a slot's tile; `None` if none was, or the slot is empty.
    pub fn interval_of(&self, slot: u32) -> Option<[usize; 2]> {
        self.slots.get(slot as usize)?.as_ref()?.held.map(|(times, _)| times)
    }

    /// Records the decoding of slots at a time, as [`Decoder::decode`](crate::Decoder::decode) does of tiles.
    /// Where the interval that was set is not that of the time, visibility is held at its nearer end, while
    /// direction and irradiance are the time's; where none was set there is no sun. What is black is written
    /// black, and listed in [`Work::black`].
    ///
    /// # Errors
    /// [`Error::Invalid`] for an empty slot, or an hour or exposure that is not a finite number. Nothing is
    /// recorded then.
    pub fn decode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        requests: &[SlotRequest],
        target: Target,
        params: &DecodeParams,
    ) -> Result<Work<SlotRequest>> {
        stage::check(params)?;
        let at: Vec<At> = self
            .bundles
            .iter()
            .map(|bundle| Ok(bundle.at(params.hour)?.only(params.lights)))
            .collect::<Result<_>>()?;
        let (mut work, mut jobs) = (Work::default(), Vec::new());
        for request in requests {
            let slot = self.slot(request.slot)?;
            let (bundle, at) = (&self.bundles[slot.bundle], &at[slot.bundle]);
            let SlotRequest { to, with_border, .. } = *request;
            let blank =
                tile::blank(bundle, Request { place: slot.known.place, to, with_border }, params.exposure)?;
            let sun = at.sun().and_then(|sun| slot.sun(bundle, &sun, params.hour));
            let job =
                slot.placed().job(&bundle.header.timeline, at.point(), params.lights, sun.as_ref(), blank);
            match &job {
                Some(job) => work.count(job),
                None => work.black.push(*request),
            }
            jobs.push(job.unwrap_or_else(|| Full::without_network(blank)));
        }
        work.bytes = self.stage.dispatch(encoder, jobs, target);
        Ok(work)
    }

    /// Records that tiles' places on a target become black, whether they are in a slot or not; `bundle` is a
    /// number of [`Pool::bundles`].
    ///
    /// # Errors
    /// [`Error::Invalid`] for a bundle that there is not; [`Error::Bundle`] for a place that it does not
    /// have.
    pub fn clear(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        bundle: usize,
        requests: &[Request],
        target: Target,
    ) -> Result<Work> {
        let bundle = self.bundles.get(bundle).ok_or_else(|| Error::Invalid(format!("bundle {bundle}")))?;
        self.stage.clear(encoder, bundle, requests, target)
    }

    fn check_slot(&self, slot: u32) -> Result<()> {
        if slot < self.slots() {
            return Ok(());
        }
        Err(Error::Invalid(format!("slot {slot}; expected a number below {}", self.slots())))
    }

    fn slot(&self, slot: u32) -> Result<&Slot> {
        self.check_slot(slot)?;
        self.slots[slot as usize].as_ref().ok_or_else(|| Error::Invalid(format!("slot {slot} is empty")))
    }
}

impl Slot {
    fn placed(&self) -> Placed<'_> {
        Placed {
            maps: self.known.maps.as_ref(),
            seen: self.known.sun.as_ref().map(|sun| &sun.seen),
            site: &self.site,
            held: self.held.map(|(_, held)| held),
        }
    }

    /// The sun of a time within the interval that is set: where that is another, at its nearer end.
    fn sun(&self, bundle: &Bundle, sun: &SunAt, hour: f64) -> Option<SunAt> {
        let (times, _) = self.held?;
        if times == sun.times {
            return Some(*sun);
        }
        let all = &bundle.header.sun.as_ref()?.times;
        let away = |time: usize| {
            let hours = (all.get(time).copied().unwrap_or(0.0) - fold_hour(hour)).abs();
            hours.min(24.0 - hours)
        };
        let part = if away(times[1]) < away(times[0]) { 1.0 } else { 0.0 };
        Some(SunAt { times, part, ..*sun })
    }
}

/// A part of a buffer of this many words, which may be none.
fn allocate(of: &mut RangeAllocator<u32>, words: u32, buffer: &'static str) -> Result<Range<u32>> {
    if words == 0 {
        return Ok(0..0);
    }
    of.allocate_range(words).map_err(|error| Error::Full {
        buffer,
        words,
        free: error.fragmented_free_length,
    })
}

fn free(of: &mut RangeAllocator<u32>, range: Range<u32>) {
    if !range.is_empty() {
        of.free_range(range);
    }
}
