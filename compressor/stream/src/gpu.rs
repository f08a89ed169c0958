//! The stream on a device: reads by a [`Reader`], decodes by `ndgi-gpu` into two textures of slots, and gives shaders a function that samples them.
//!
//! Three calls a frame, see [`Runtime`].

mod feedback;
mod read;
mod table;
mod watch;

pub use feedback::Feedback;
pub use read::{Arrived, Done, ReadError, Reader, Slow, Threads, read};
pub use watch::Files;

use crate::{Answer, Budgets, Commands, Completion, Decode, Load, Pyramid, Read, Result, Seen, Stream, Tile};
use ndgi::decode::Lights;
use ndgi_gpu::{Moment, Options, Output, Pool, SlotRequest, Sunlight, Target};
use read::Waiting;
use std::collections::BTreeMap;
use std::sync::Arc;
use table::Table;

/// Texels of a slot's side: a tile's own and a border of one.
pub const SIDE: u32 = 128;

/// How a runtime decodes.
#[derive(Clone, Debug)]
pub struct Settings {
    /// What it may use.
    pub budgets: Budgets,
    /// How tiles are decoded.
    pub options: Options,
    /// What light is multiplied with before it is stored in 16-bit floats: see `ndgi_gpu::Output`.
    pub exposure: f32,
    /// The size of the feedback's target: an eighth of the view's is enough.
    pub feedback: [u32; 2],
}

impl Settings {
    /// Those of a view of so many pixels.
    pub fn of_view([width, height]: [u32; 2]) -> Self {
        let feedback = [width.div_ceil(8), height.div_ceil(8)].map(|side| side.max(1));
        Settings { budgets: Budgets::default(), options: Options::default(), exposure: 256.0, feedback }
    }
}

/// What a frame did.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// What the feedback told, if one arrived: tiles and their pixels at its resolution.
    pub seen: Option<Vec<Seen>>,
    /// What the stream commanded.
    pub commands: Commands,
    /// Bytes uploaded.
    pub bytes: u64,
    /// Tiles that found no room on the device, and are tried again.
    pub refused: usize,
}

/// A scene's tiles on a device.
///
/// A frame is three calls: [`Runtime::frame`] before anything is drawn; [`Runtime::read_back`] after the view drew its feedback into
/// [`Feedback::view`]; [`Runtime::submitted`] after the encoder was submitted. Shaders sample by the functions of [`Runtime::wgsl`] and the bind group of
/// [`Runtime::bind_group`].
///
/// No call waits: reads, checksums and unpacking are the [`Reader`]'s, and feedback is taken up when it has arrived, one frame later or two.
#[derive(Debug)]
pub struct Runtime {
    stream: Stream,
    pool: Pool,
    reader: Box<dyn Reader>,
    settings: Settings,
    /// What was read and is not on the device yet.
    waiting: BTreeMap<Tile, Waiting>,
    /// Of tiles on the device, what further intervals are unpacked from.
    sunlight: BTreeMap<Tile, Sunlight>,
    asked: BTreeMap<u64, Read>,
    done: Vec<Completion>,
    told: Option<Vec<Seen>>,
    maps: wgpu::TextureView,
    sun: wgpu::TextureView,
    /// Slots across the textures.
    across: u32,
    table: Table,
    feedback: Feedback,
}

impl Runtime {
    /// A runtime in which every tile shows its mean.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for budgets that make no sense; [`Error::Device`](crate::Error::Device) for ones that the device has no room for.
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
        let [maps, sun] = ["ndgi slots", "ndgi slots, sun"].map(|label| slots_of(device, label, size));
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
            told: None,
            maps,
            sun,
            across,
            table,
            feedback,
        })
    }

    /// Records what a frame needs before anything samples: uploads through the queue, which come before the next submission, and decoding on the
    /// encoder. The encoder has to be submitted, and nothing else of this runtime be submitted before it.
    ///
    /// # Errors
    /// [`Error::Bundle`](crate::Error::Bundle) for an hour that is not a finite number. What cannot be read is no error: it is told in
    /// [`Commands::failures`], and shown by what covers it.
    pub fn frame(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        hour: f64,
    ) -> Result<Report> {
        let now = self.stream.pyramid().at(hour)?;
        let arrived = self.feedback.arrived(device, self.stream.pyramid().tiles());
        let seen = self.told.take().or(arrived);
        self.collect();
        let done = std::mem::take(&mut self.done);
        let mut report =
            Report { commands: self.stream.step(seen.as_deref(), &done, hour)?, ..Report::default() };
        for tile in &report.commands.drops {
            self.waiting.remove(tile);
            self.sunlight.remove(tile);
        }
        report.commands.unloads.iter().for_each(|place| self.pool.unload(*place));
        for load in report.commands.loads.clone() {
            self.load(queue, &load, &mut report)?;
        }
        for read in &report.commands.reads {
            self.asked.insert(read.ticket, *read);
            let known = self.sunlight.get(&read.tile).filter(|_| !read.features);
            self.reader.start(self.stream.pyramid(), self.pool.options(), *read, known.cloned());
        }
        report.bytes += self.decode(encoder, &report.commands.decodes, hour)?;
        report.bytes += self.table.write(queue, &self.stream, &now, &report.commands, seen.as_deref());
        report.seen = seen;
        Ok(report)
    }

    /// Says what the view shows, in the place of the next frame's feedback: for views that know it, or are about to jump.
    pub fn see(&mut self, seen: Vec<Seen>) {
        self.told = Some(seen);
    }

    /// Takes up what the reader did.
    fn collect(&mut self) {
        for Done { ticket, what } in self.reader.done() {
            // What a scene that was replaced had asked for is let go.
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

    fn load(&mut self, queue: &wgpu::Queue, load: &Load, report: &mut Report) -> Result<()> {
        let Load { tile, place, features, .. } = *load;
        let Some(waiting) = self.waiting.remove(&tile) else { return Ok(()) };
        let level = self.stream.pyramid().spot(tile).map_or(0, |spot| spot.level);
        if features {
            let Some(features) = waiting.features else { return Ok(()) };
            match self.pool.load(queue, place, level, &features) {
                Ok(()) => {}
                Err(ndgi_gpu::Error::Full { .. }) => {
                    let mut more = Commands::default();
                    self.stream.refuse(tile, &mut more);
                    more.unloads.iter().for_each(|place| self.pool.unload(*place));
                    more.drops.iter().for_each(|tile| drop(self.sunlight.remove(tile)));
                    report.refused += 1;
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            }
            report.bytes += features.bytes();
            self.sunlight.insert(tile, features.sunlight());
        }
        if let Some(interval) = waiting.interval {
            self.pool.set_interval(queue, place, &interval)?;
            report.bytes += interval.bytes();
        }
        Ok(())
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
            let moment = Moment { hour, lights, exposure };
            bytes += self.pool.decode(encoder, &requests, target, &moment)?.bytes;
        }
        Ok(bytes)
    }

    /// Records that the feedback which the view drew is read back.
    pub fn read_back(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.feedback.read_back(encoder);
    }

    /// To be called after the encoder of [`Runtime::read_back`] was submitted.
    pub fn submitted(&mut self) {
        self.feedback.submitted();
    }

    /// Takes up other bundles in the place of those there were: see [`Stream::replace`] and [`Files::changed`].
    ///
    /// # Errors
    /// As [`Runtime::new`]; nothing has changed then.
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
        Ok(())
    }

    /// The feedback's target.
    pub fn feedback(&self) -> &Feedback {
        &self.feedback
    }

    /// What is read, loaded, decoded and shown.
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

    /// What the functions of [`Runtime::wgsl`] read. It is another one after [`Runtime::replace`].
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.table.group
    }

    /// The functions by which shaders sample and tell feedback, with their bindings in a group of that number: see `sample.wgsl`.
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

fn slots_of(device: &wgpu::Device, label: &str, [width, height]: [u32; 2]) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&Default::default())
}
