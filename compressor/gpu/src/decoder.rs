//! A bundle on a device.

use crate::load::Data;
use crate::place::{self, Site};
use crate::request::{DecodeParams, Options, Request, Target, Work};
use crate::stage::{self, Stage};
use crate::sun::{Held, Seen};
use crate::survey::Survey;
use crate::tile::{self, Full, Maps, Placed};
use crate::{Error, Result};
use ndgi::Bundle;
use ndgi::at::At;
use std::sync::Arc;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// A bundle on a device, all of its tiles.
#[derive(Debug)]
pub struct Decoder {
    pub(crate) bundle: Arc<Bundle>,
    pub(crate) stage: Stage,
    tiles: Vec<Tile>,
    /// How often [`Decoder::forget`] was called.
    pub(crate) forgotten: u64,
}

/// A tile on the device.
#[derive(Debug, Default)]
struct Tile {
    maps: Option<Maps>,
    seen: Option<Seen>,
    site: Site,
    /// The times of its part of the interval's buffer, and the visibility in it.
    held: Option<([usize; 2], Held)>,
}

/// A tile's part of the interval's buffer.
struct Upload {
    /// The tile's number in the index.
    tile: usize,
    /// Where the part begins, in words.
    to: u32,
    words: Vec<u32>,
}

impl Decoder {
    /// Reads all tiles of a bundle onto a device. Pipelines are made when they are first needed.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a damaged one; [`Error::Device`] if it has too few layers of textures or too
    /// small buffers.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, bundle: Bundle, options: Options) -> Result<Self> {
        let options = stage::resolved(device, options)?;
        let survey = Survey::of([&bundle]);
        let sizes: Vec<[u32; 2]> = survey.tiles.iter().flat_map(|room| room.maps.iter().copied()).collect();
        let (side, layers, spots) = place::place(&sizes);
        let texture = stage::texture(device, [side, side, layers], options.unpacks)?;
        let mut resident: Vec<u32> = if survey.shadows { stage::codebook().collect() } else { Vec::new() };
        let (mut tiles, mut spots, mut interval) = (Vec::new(), spots.into_iter(), 0u32);
        for place in bundle.header.places() {
            let (mut tile, mut data) = (Tile::default(), Data::default());
            tile.maps = bundle.tile(place)?.map(|params| data.maps(params, options.unpacks)).transpose()?;
            tile.seen = bundle.sun(place)?.map(|sun| {
                let most = sun.shadows.most_bytes(sun.channels());
                Seen::new(&sun, most, &mut data.words)
            });
            let maps = spots.by_ref().take(data.picture.maps.len()).collect();
            tile.site = Site { resident: resident.len() as u32, interval, maps };
            for (([x, y, _], size), to) in data.picture.maps.iter().zip(&tile.site.maps) {
                data.picture.upload(queue, &texture, [*x, *y], *size, *to);
            }
            resident.extend(data.words);
            interval += tile.seen.as_ref().map_or(0, |seen| seen.words);
            tiles.push(tile);
        }
        for (what, words) in [("resident", resident.len() as u64), ("interval", u64::from(interval))] {
            let most = device.limits().max_storage_buffer_binding_size;
            if 4 * words > most {
                let what =
                    format!("the {what} buffer takes {} bytes; the device binds at most {most}", 4 * words);
                return Err(Error::Device(what));
            }
        }
        resident.resize(resident.len().max(1), 0);
        let resident = device.create_buffer_init(&BufferInitDescriptor {
            label: Some("ndgi resident"),
            contents: bytemuck::cast_slice(&resident),
            usage: wgpu::BufferUsages::STORAGE,
        });
        let interval = stage::buffer(device, "ndgi interval", interval.into());
        let stage = Stage::new(device, options, &survey, &texture, [resident, interval]);
        Ok(Decoder { bundle: Arc::new(bundle), stage, tiles, forgotten: 0 })
    }

    /// The bundle.
    pub fn bundle(&self) -> &Bundle {
        &self.bundle
    }

    /// Bytes on the device, without targets.
    pub fn bytes(&self) -> u64 {
        self.stage.bytes
    }

    /// Records the decoding of tiles at one time: one dispatch per width of hidden layers and precision among
    /// them, nearly always a single one. Submit command buffers in the order in which they were recorded;
    /// after dropping one instead, call [`Decoder::forget`].
    ///
    /// # Errors
    /// [`Error::Invalid`] for an hour or exposure that is not a finite number; [`Error::Bundle`] for a place
    /// that the bundle does not have, or a damaged one. Nothing is recorded then.
    pub fn decode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        requests: &[Request],
        target: Target,
        params: &DecodeParams,
    ) -> Result<Work> {
        stage::check(params)?;
        let bundle = Arc::clone(&self.bundle);
        let at = bundle.at(params.hour)?.only(params.lights);
        let mut uploads = Vec::new();
        let planned = self.plan(&at, requests, params, &mut uploads);
        if planned.is_err() {
            // They are not recorded.
            uploads.iter().for_each(|upload| self.tiles[upload.tile].held = None);
        }
        let (mut work, jobs) = planned?;
        work.bytes += self.upload(encoder, &uploads);
        work.bytes += self.stage.dispatch(encoder, jobs, target);
        Ok(work)
    }

    /// Invalidates the sun's visibility on the device and the state of pages: the next calls upload it again
    /// and write whole pages. Call it after dropping an encoder with recorded decoding instead of submitting
    /// it.
    pub fn forget(&mut self) {
        self.forgotten += 1;
        self.tiles.iter_mut().for_each(|tile| tile.held = None);
    }

    /// Plans the dispatches. Data to upload first are appended to `uploads` and count as uploaded.
    fn plan(
        &mut self,
        at: &At,
        requests: &[Request],
        params: &DecodeParams,
        uploads: &mut Vec<Upload>,
    ) -> Result<(Work, Vec<Full>)> {
        let (mut work, mut jobs) = (Work::default(), Vec::new());
        for request in requests {
            match self.job(at, *request, params, uploads)? {
                None => work.black.push(*request),
                Some(job) => {
                    work.count(&job);
                    jobs.push(job);
                }
            }
        }
        Ok((work, jobs))
    }

    /// A tile's job at a time; `None` if it is black.
    fn job(
        &mut self,
        at: &At,
        request: Request,
        params: &DecodeParams,
        uploads: &mut Vec<Upload>,
    ) -> Result<Option<Full>> {
        let blank = tile::blank(&self.bundle, request, params.exposure)?;
        let position = self.bundle.header.position(request.place).unwrap_or_default();
        let (tile, sun) = (&mut self.tiles[position], at.sun());
        if let Some((seen, sun)) = tile.seen.as_ref().zip(sun)
            && tile.held.is_none_or(|(times, _)| times != sun.times)
        {
            let part = at.sun_of(request.place)?.map(|tile| seen.part(&tile, sun.times));
            let (held, words) = part.unwrap_or((Held::Dark, Vec::new()));
            debug_assert!(words.len() <= seen.words as usize);
            if held != Held::Dark {
                uploads.push(Upload { tile: position, to: tile.site.interval, words });
            }
            tile.held = Some((sun.times, held));
        }
        let Tile { maps, seen, site, held } = &*tile;
        let held = held.map(|(_, held)| held);
        let placed = Placed { maps: maps.as_ref(), seen: seen.as_ref(), site, held };
        let timeline = &self.bundle.header.timeline;
        Ok(placed.job(timeline, at.point(), params.lights, sun.as_ref(), blank))
    }

    /// Records writing black to tiles' areas of a target.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a place that the bundle does not have.
    pub fn clear(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        requests: &[Request],
        target: Target,
    ) -> Result<Work> {
        self.stage.clear(encoder, &self.bundle, requests, target)
    }

    fn upload(&self, encoder: &mut wgpu::CommandEncoder, uploads: &[Upload]) -> u64 {
        let words: Vec<u32> = uploads.iter().flat_map(|upload| &upload.words).copied().collect();
        if words.is_empty() {
            return 0;
        }
        let staging = self.stage.device.create_buffer_init(&BufferInitDescriptor {
            label: Some("ndgi interval, new"),
            contents: bytemuck::cast_slice(&words),
            usage: wgpu::BufferUsages::COPY_SRC,
        });
        let mut from = 0;
        for Upload { to, words, .. } in uploads {
            let length = 4 * words.len() as u64;
            encoder.copy_buffer_to_buffer(&staging, from, &self.stage.interval, 4 * u64::from(*to), length);
            from += length;
        }
        staging.size()
    }
}
