//! The stream on a device: a [`Reader`] reads, `ndgi-gpu` decodes into two textures of slots, and a WGSL
//! function samples them.
//!
//! A frame is three calls: see [`Runtime`].

mod feedback;
mod read;
mod table;
mod watch;

pub use feedback::Feedback;
pub use read::{Arrived, Done, ReadError, Reader, Slow, Threads, read};
pub use watch::Files;

use crate::{Answer, Budgets, Commands, Completion, Decode, Load, Pyramid, Read, Result, Seen, Stream, Tile};
use ndgi::decode::Lights;
use ndgi_gpu::{DecodeParams, Options, Output, Pool, SlotRequest, Sunlight, Target};
use read::Waiting;
use std::collections::BTreeMap;
use std::sync::Arc;
use table::Table;

/// Side of a slot in texels: the 126 of a tile and a border of one at each end.
pub const SIDE: u32 = 128;

/// The settings of a [`Runtime`].
#[derive(Clone, Debug)]
pub struct Settings {
    /// The limits of the stream.
    pub budgets: Budgets,
    /// How tiles are decoded.
    pub options: Options,
    /// The factor of light before it is stored in 16-bit floats; shaders divide by it. See
    /// `ndgi_gpu::Output`.
    pub exposure: f32,
    /// Width and height of the feedback's target; an eighth of the view's are enough.
    pub feedback: [u32; 2],
}

impl Settings {
    /// Default settings for a view of this width and height: an exposure of 256, and feedback at an eighth of
    /// the resolution.
    pub fn of_view([width, height]: [u32; 2]) -> Self {
        let feedback = [width.div_ceil(8), height.div_ceil(8)].map(|side| side.max(1));
        Settings { budgets: Budgets::default(), options: Options::default(), exposure: 256.0, feedback }
    }
}

/// What a frame did.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The feedback, if one arrived: tiles, and their pixels at the resolution of its target.
    pub seen: Option<Vec<Seen>>,
    /// The commands that were carried out.
    pub commands: Commands,
    /// Uploaded bytes.
    pub bytes: u64,
    /// Number of tiles that found no room on the device, and will be read again.
    pub refused: usize,
}

/// Streams a scene's tiles on a device.
///
/// A frame is three calls: [`Runtime::frame`] before anything is drawn, [`Runtime::read_back`] after the view
/// has drawn its feedback into [`Feedback::view`], and [`Runtime::submitted`] after the encoder was
/// submitted. Shaders call the functions of [`Runtime::wgsl`] with [`Runtime::bind_group`] bound.
///
/// No call waits. The [`Reader`] does all reading, checking and unpacking; feedback is used when it arrives,
/// one or two frames later.
#[derive(Debug)]
pub struct Runtime {
    stream: Stream,
    pool: Pool,
    reader: Box<dyn Reader>,
    settings: Settings,
    /// Tiles that were read and are not on the device yet.
    waiting: BTreeMap<Tile, Waiting>,
    /// For tiles on the device, the data from which further intervals are unpacked.
    sunlight: BTreeMap<Tile, Sunlight>,
    asked: BTreeMap<u64, Read>,
    done: Vec<Completion>,
    reported: Option<Vec<Seen>>,
    maps: wgpu::TextureView,
    sun: wgpu::TextureView,
    /// Number of slots in a row of the textures.
    across: u32,
    table: Table,
    feedback: Feedback,
}

impl Runtime {
    /// A runtime in which nothing is read yet, and every tile shows its mean.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for budgets under which nothing can be shown;
    /// [`Error::Device`](crate::Error::Device) for budgets that exceed the device's limits.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        pyramid: Arc<Pyramid>,
        reader: Box<dyn Reader>,
        settings: Settings,
    ) -> Result<Self> {
        let stream = Stream::new(Arc::clone(&pyramid), settings.budgets.clone())?;
        let pool = pool_of(device, queue, &pyramid, &settings)?;
        let across = (f64::from(settings.budgets.slots).sqrt().ceil() as u32).max(1);
        let size = [across * SIDE, settings.budgets.slots.div_ceil(across) * SIDE];
        let most = device.limits().max_texture_dimension_2d;
        if size[0].max(size[1]) > most {
            let what = format!(
                "{} slots take a texture of {} × {} texels; the device has {most} at most",
                settings.budgets.slots, size[0], size[1]
            );
            return Err(crate::Error::Device(what));
        }
        let [maps, sun] = ["ndgi slots", "ndgi slots, sun"].map(|label| {
            let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING;
            let slots = feedback::texture(device, label, size, wgpu::TextureFormat::Rgba16Float, usage);
            slots.create_view(&Default::default())
        });
        let table = Table::new(device, queue, &pyramid, [&maps, &sun], (across, settings.exposure));
        let feedback = Feedback::new(device, settings.feedback);
        Ok(Runtime {
            stream,
            pool,
            reader,
            settings,
            waiting: BTreeMap::new(),
            sunlight: BTreeMap::new(),
            asked: BTreeMap::new(),
            done: Vec::new(),
            reported: None,
            maps,
            sun,
            across,
            table,
            feedback,
        })
    }

    /// Brings the tiles up to `hour`; call it before anything samples. Uploads go through the queue and take
    /// effect at the next submission. Decoding is recorded on the encoder, which has to be submitted before
    /// the next frame is recorded.
    ///
    /// # Errors
    /// [`Error::Bundle`](crate::Error::Bundle) for an hour that is not a finite number. A tile that cannot be
    /// read is not an error: it is reported in [`Commands::failures`], and a coarser tile is shown instead.
    pub fn frame(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        hour: f64,
    ) -> Result<Report> {
        let now = self.stream.pyramid().at(hour)?;
        let arrived = self.feedback.arrived(device, self.stream.pyramid().tiles());
        let seen = self.reported.take().or(arrived);
        self.collect();
        let done = std::mem::take(&mut self.done);
        let mut report =
            Report { commands: self.stream.step(seen.as_deref(), &done, hour)?, ..Report::default() };
        report.commands.drops.iter().for_each(|tile| self.forget(*tile));
        report.commands.unloads.iter().for_each(|place| self.pool.unload(*place));
        let mut decodes = report.commands.decodes.clone();
        for load in report.commands.loads.clone() {
            if !self.load(queue, &load, &mut report) {
                decodes.retain(|decode| decode.tile != load.tile);
            }
        }
        for read in &report.commands.reads {
            self.asked.insert(read.ticket, *read);
            let known = self.sunlight.get(&read.tile).filter(|_| !read.features);
            self.reader.start(self.stream.pyramid(), self.pool.options(), *read, known.cloned());
        }
        report.bytes += self.decode(encoder, &decodes, hour)?;
        report.bytes += self.table.write(queue, &self.stream, &now, &report.commands, seen.as_deref());
        report.seen = seen;
        Ok(report)
    }

    /// Frames the tiles that the view needs, in place of the next frame's feedback: for views that know them,
    /// for instance after a jump.
    pub fn see(&mut self, seen: Vec<Seen>) {
        self.reported = Some(seen);
    }

    /// Takes up completed reads.
    fn collect(&mut self) {
        for Done { ticket, what } in self.reader.done() {
            // Reads of a scene that was replaced are dropped.
            let Some(read) = self.asked.remove(&ticket) else { continue };
            let answer = match what {
                Ok(Arrived { features, interval }) => {
                    let waiting = self.waiting.entry(read.tile).or_default();
                    waiting.features = features.or(waiting.features.take());
                    waiting.interval = interval.or(waiting.interval.take());
                    Answer::Arrived
                }
                Err(ReadError { is_lasting, what }) => Answer::Failed { is_lasting, what },
            };
            self.done.push(Completion { ticket, answer });
        }
    }

    /// Carries out a load; says whether it could. If not, the tile is read again, and nothing may be decoded
    /// from its place, which is empty.
    fn load(&mut self, queue: &wgpu::Queue, load: &Load, report: &mut Report) -> bool {
        let Load { tile, place, features, .. } = *load;
        let waiting = self.waiting.remove(&tile).unwrap_or_default();
        match self.put(queue, load, &waiting) {
            Ok(bytes) => {
                report.bytes += bytes;
                if let Some(features) = waiting.features.filter(|_| features) {
                    self.sunlight.insert(tile, features.sunlight());
                }
                true
            }
            Err(error) => {
                let is_full = matches!(error, ndgi_gpu::Error::Full { .. });
                let mut more = Commands::default();
                self.stream.refuse(tile, (!is_full).then(|| error.to_string()), &mut more);
                report.commands.failures.append(&mut more.failures);
                more.drops.into_iter().for_each(|tile| self.forget(tile));
                more.unloads.iter().chain([&place]).for_each(|place| self.pool.unload(*place));
                report.refused += 1;
                false
            }
        }
    }

    /// Forgets a tile that is off the device; an answer that is still to come is of no use.
    fn forget(&mut self, tile: Tile) {
        self.waiting.remove(&tile);
        self.sunlight.remove(&tile);
        self.asked.retain(|_, read| read.tile != tile);
    }

    fn put(&mut self, queue: &wgpu::Queue, load: &Load, waiting: &Waiting) -> ndgi_gpu::Result<u64> {
        let mut bytes = 0;
        if load.features {
            let level = self.stream.pyramid().spot(load.tile).map_or(0, |spot| spot.level);
            let none =
                || ndgi_gpu::Error::Invalid(format!("a reader returned no features of {:?}", load.tile));
            let features = waiting.features.as_ref().ok_or_else(none)?;
            self.pool.load(queue, load.place, level, features)?;
            bytes += features.bytes();
        }
        if let Some(interval) = &waiting.interval {
            self.pool.set_interval(queue, load.place, interval)?;
            bytes += interval.bytes();
        }
        Ok(bytes)
    }

    fn decode(&mut self, encoder: &mut wgpu::CommandEncoder, decodes: &[Decode], hour: f64) -> Result<u64> {
        let across = self.across;
        let request = |decode: &Decode| SlotRequest {
            slot: decode.place,
            to: [decode.slot % across, decode.slot / across].map(|i| (i * SIDE) as i32),
            with_border: true,
        };
        let exposure = self.settings.exposure;
        let mut bytes = 0;
        type Which = fn(&Decode) -> bool;
        let parts: [(Lights, &wgpu::TextureView, Which); 2] = [
            (Lights::Baked, &self.maps, |decode| decode.maps),
            (Lights::Sun, &self.sun, |decode| decode.sun || decode.maps),
        ];
        for (lights, view, which) in parts {
            let requests: Vec<SlotRequest> =
                decodes.iter().filter(|decode| which(decode)).map(request).collect();
            if requests.is_empty() {
                continue;
            }
            let target = Target { view, output: Output::Rgba16Float };
            let params = DecodeParams { hour, lights, exposure };
            bytes += self.pool.decode(encoder, &requests, target, &params)?.bytes;
        }
        Ok(bytes)
    }

    /// Records the read-back of the feedback that the view drew.
    pub fn read_back(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.feedback.read_back(encoder);
    }

    /// Call this after the encoder of [`Runtime::read_back`] was submitted.
    pub fn submitted(&mut self) {
        self.feedback.submitted();
    }

    /// Replaces the bundles: see [`Stream::replace`] and [`Files::changed`]. [`Runtime::bind_group`] is a new
    /// one afterwards.
    ///
    /// # Errors
    /// Those of [`Runtime::new`]. Nothing has changed then.
    pub fn replace(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        pyramid: Arc<Pyramid>,
    ) -> Result<()> {
        let pool = pool_of(device, queue, &pyramid, &self.settings)?;
        self.stream.replace(Arc::clone(&pyramid))?;
        self.pool = pool;
        self.table = Table::new(
            device,
            queue,
            &pyramid,
            [&self.maps, &self.sun],
            (self.across, self.settings.exposure),
        );
        self.table.fill(queue, &self.stream);
        self.waiting.clear();
        self.sunlight.clear();
        self.asked.clear();
        self.done.clear();
        self.reported = None;
        Ok(())
    }

    /// The feedback's target.
    pub fn feedback(&self) -> &Feedback {
        &self.feedback
    }

    /// The stream, which knows what is read, loaded, decoded and shown.
    pub fn stream(&self) -> &Stream {
        &self.stream
    }

    /// Bytes on the device: pool, slots and page table.
    pub fn bytes(&self) -> u64 {
        let texels = u64::from(self.across * SIDE)
            * u64::from(self.settings.budgets.slots.div_ceil(self.across) * SIDE);
        self.pool.bytes() + 2 * 8 * texels + self.table.bytes()
    }

    /// The layout of [`Runtime::bind_group`], for the view's pipelines.
    pub fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.table.layout
    }

    /// The bind group for the functions of [`Runtime::wgsl`]. [`Runtime::replace`] makes a new one.
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.table.group
    }

    /// WGSL functions that sample light and write feedback, with their bindings in group `group`: see
    /// `sample.wgsl`.
    pub fn wgsl(group: u32) -> String {
        include_str!("gpu/sample.wgsl").replace("@group(NDGI)", &format!("@group({group})"))
    }
}

fn pool_of(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    pyramid: &Pyramid,
    settings: &Settings,
) -> Result<Pool> {
    let bundles: Vec<_> = (0..pyramid.levels()).map(|level| Arc::clone(pyramid.bundle(level))).collect();
    let pool = Pool::new(device, queue, &bundles, settings.budgets.features, settings.options.clone())?;
    pool.prepare(Output::Rgba16Float);
    Ok(pool)
}
