//! A bundle on a device.

use crate::load::{Loading, sizes};
use crate::pipelines::Pipelines;
use crate::place;
use crate::shader::{self, Output, Precision, Shader};
use crate::tile::{self, Held, Job, Maps, Tile};
use crate::{Error, Result};
use ndgi::Bundle;
use ndgi::at::At;
use ndgi::decode::Lights;
use ndgi::grid::Place;
use ndgi::sun::Shadows;
use std::sync::Arc;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Features of a device that the decoder makes use of, so far as the adapter has them: BC7 textures, and 16-bit floats.
pub fn features(adapter: &wgpu::Adapter) -> wgpu::Features {
    adapter.features() & (wgpu::Features::TEXTURE_COMPRESSION_BC | wgpu::Features::SHADER_F16)
}

/// How a bundle is decoded.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The network's precision. A tile whose weights are too large for 16 bits is decoded in 32.
    pub precision: Precision,
    /// Upload RGBA8 (4× the memory) even if the device supports BC7; always done if it does not.
    pub unpacks: bool,
    /// Pipeline cache; clone it into other decoders of the same device.
    pub pipelines: Pipelines,
}

/// Which light is decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The hour, periodic in 24.
    pub hour: f64,
    /// All light, or some of it.
    pub lights: Lights,
    /// What light is multiplied with before it is stored: see [`Output`].
    pub exposure: f32,
}

impl Moment {
    /// All light at an hour, as it is.
    pub fn at(hour: f64) -> Self {
        Moment { hour, lights: Lights::All, exposure: 1.0 }
    }
}

/// A tile that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The tile.
    pub place: Place,
    /// Where its upper left texel comes on the target: the first of its payload, or the border's.
    pub to: [i32; 2],
    /// Whether the border around the payload is written too, a texel wide, for filters of hardware.
    pub with_border: bool,
}

/// Where decoded texels go.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// A texture of two dimensions, of the output's format, with [`wgpu::TextureUsages::STORAGE_BINDING`].
    pub view: &'a wgpu::TextureView,
    /// What is stored.
    pub output: Output,
}

/// What a call did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Tiles dispatched.
    pub tiles: usize,
    /// Those of them whose network was evaluated; the others have the sun alone.
    pub networks: usize,
    /// Tiles that are black at the moment: nothing was dispatched, and the target is as it was.
    pub black: Vec<Request>,
    /// Bytes uploaded.
    pub bytes: u64,
}

/// Maximum jobs per dispatch: WebGPU's limit of workgroups per axis.
const MOST_JOBS: usize = 65_535;

/// A page's texture, and what is known to be on it.
#[derive(Debug)]
pub struct Page {
    /// The texture: the page's size.
    pub texture: wgpu::Texture,
    view: wgpu::TextureView,
    output: Output,
    page: usize,
    /// Per tile, whether black was written to it last.
    is_black: Vec<bool>,
    /// [`Decoder::forgotten`] when it was written last.
    forgotten: Option<u64>,
}

impl Page {
    /// A view of the texture.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}

impl Output {
    /// Its format of texture.
    pub fn format(self) -> wgpu::TextureFormat {
        match self {
            Output::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
            Output::Rgba32Float => wgpu::TextureFormat::Rgba32Float,
            Output::Rgba8Unorm => wgpu::TextureFormat::Rgba8Unorm,
        }
    }
}

/// A bundle on a device, all of its tiles.
#[derive(Debug)]
pub struct Decoder {
    device: wgpu::Device,
    bundle: Arc<Bundle>,
    options: Options,
    tiles: Vec<Tile>,
    maps: wgpu::TextureView,
    resident: wgpu::Buffer,
    interval: wgpu::Buffer,
    coarse: usize,
    bytes: u64,
    /// How often [`Decoder::forget`] was called.
    forgotten: u64,
}

impl Decoder {
    /// Reads all tiles of a bundle onto a device. Pipelines are made when they are first needed.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a damaged one; [`Error::Device`] where it has too few layers of textures or too small buffers.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, bundle: Bundle, options: Options) -> Result<Self> {
        let has = device.features();
        if options.precision == Precision::Half && !has.contains(wgpu::Features::SHADER_F16) {
            return Err(Error::Device(
                "the device was made without the feature SHADER_F16; ask for it, or for Precision::Single"
                    .to_owned(),
            ));
        }
        let unpacks = options.unpacks || !has.contains(wgpu::Features::TEXTURE_COMPRESSION_BC);
        let options = Options { unpacks, ..options };
        let (sizes, coarse) = sizes(&bundle);
        let (side, layers, spots) = place::place(&sizes);
        let limits = device.limits();
        if layers > limits.max_texture_array_layers {
            let most = limits.max_texture_array_layers;
            let what = format!("the maps take {layers} layers of {side}²; the device has {most}");
            return Err(Error::Device(what));
        }
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("ndgi maps"),
            size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: match unpacks {
                true => wgpu::TextureFormat::Rgba8Unorm,
                false => wgpu::TextureFormat::Bc7RgbaUnorm,
            },
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let mut loading = Loading { queue, texture: &texture, unpacks, resident: Vec::new(), interval: 0 };
        if bundle.header.shadows {
            let words = Shadows::codebook().as_chunks::<4>().0.iter();
            loading.resident.extend(words.map(|four| u32::from_le_bytes(*four)));
        }
        let mut spots = spots.into_iter();
        let tiles: Vec<Tile> = bundle
            .header
            .places()
            .map(|place| loading.tile(&bundle, place, &mut spots))
            .collect::<Result<_>>()?;
        let Loading { mut resident, interval, .. } = loading;
        for (what, words) in [("resident", resident.len() as u64), ("interval", u64::from(interval))] {
            let most = limits.max_storage_buffer_binding_size;
            if 4 * words > most {
                let what =
                    format!("the {what} buffer takes {} bytes; the device binds {most} at most", 4 * words);
                return Err(Error::Device(what));
            }
        }
        resident.resize(resident.len().max(1), 0);
        let resident = device.create_buffer_init(&BufferInitDescriptor {
            label: Some("ndgi resident"),
            contents: bytemuck::cast_slice(&resident),
            usage: wgpu::BufferUsages::STORAGE,
        });
        let interval = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ndgi interval"),
            size: 4 * u64::from(interval.max(1)),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let texels = u64::from(side) * u64::from(side) * u64::from(layers);
        let bytes = texels * if unpacks { 4 } else { 1 } + resident.size() + interval.size();
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        let maps = texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() });
        Ok(Decoder {
            device: device.clone(),
            bundle: Arc::new(bundle),
            options,
            tiles,
            maps,
            resident,
            interval,
            coarse,
            bytes,
            forgotten: 0,
        })
    }

    /// The bundle.
    pub fn bundle(&self) -> &Bundle {
        &self.bundle
    }

    /// Bytes on the device, targets apart.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A texture of a page, which [`Decoder::decode_page`] fills. Its first call writes every texel; until then all is 0, alpha too.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a page that the bundle does not have; [`Error::Device`] for one larger than a texture may be.
    pub fn page(&self, page: usize, output: Output) -> Result<Page> {
        let pages = &self.bundle.header.pages;
        let grid = pages.get(page).ok_or_else(|| {
            Error::Invalid(format!(
                "page {page}; expected a number below {}, the bundle's pages",
                pages.len()
            ))
        })?;
        let most = self.device.limits().max_texture_dimension_2d as usize;
        if grid.width.max(grid.height) > most {
            return Err(Error::Device(format!(
                "page {page} of {} × {} texels; textures of the device have {most} at most: decode tiles",
                grid.width, grid.height
            )));
        }
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("ndgi page"),
            size: wgpu::Extent3d {
                width: grid.width as u32,
                height: grid.height as u32,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: output.format(),
            usage: wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        Ok(Page { texture, view, output, page, is_black: vec![false; grid.tiles()], forgotten: None })
    }

    /// Records the decoding of a whole page. Tiles that are black, and were before, are left out.
    ///
    /// # Errors
    /// As [`Decoder::decode`].
    pub fn decode_page(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        page: &mut Page,
        moment: &Moment,
    ) -> Result<Work> {
        let grid = self.bundle.header.pages[page.page];
        let request = |place: Place| {
            let (x, y) = place.origin();
            let border = ndgi::model::BORDER as isize;
            Request { place, to: [x + border, y + border].map(|at| at as i32), with_border: false }
        };
        let requests: Vec<Request> = grid.places(page.page).map(request).collect();
        let target = Target { view: &page.view, output: page.output };
        let mut work = self.decode(encoder, &requests, target, moment)?;
        let index = |request: &Request| request.place.row * grid.columns() + request.place.column;
        let is_known = page.forgotten.replace(self.forgotten) == Some(self.forgotten);
        let was_black = std::mem::replace(&mut page.is_black, vec![false; grid.tiles()]);
        work.black.iter().for_each(|request| page.is_black[index(request)] = true);
        let is_stale = |request: &&Request| !(is_known && was_black[index(request)]);
        let stale: Vec<Request> = work.black.iter().filter(is_stale).copied().collect();
        if !stale.is_empty() {
            let cleared = self.clear(encoder, &stale, target)?;
            work.bytes += cleared.bytes;
        }
        Ok(work)
    }

    /// Records the decoding of tiles at a moment: one dispatch for each width of hidden layers and precision that is among them, nearly always
    /// one in all. Command buffers have to be submitted in the order in which they were recorded; after one was dropped instead, call
    /// [`Decoder::forget`].
    ///
    /// # Errors
    /// [`Error::Invalid`] for an hour or exposure that is not a finite number; [`Error::Bundle`] for a place that the bundle does not have, or a
    /// damaged one. Nothing is recorded then.
    pub fn decode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        requests: &[Request],
        target: Target,
        moment: &Moment,
    ) -> Result<Work> {
        if !moment.exposure.is_finite() || moment.exposure < 0.0 {
            return Err(Error::Invalid(format!(
                "exposure {}; expected a finite number ≥ 0",
                moment.exposure
            )));
        }
        let bundle = Arc::clone(&self.bundle);
        let at = bundle.at(moment.hour)?.only(moment.lights);
        let mut uploads = Vec::new();
        let planned = self.plan(&at, requests, target.output, moment, &mut uploads);
        if planned.is_err() {
            // They are not recorded.
            uploads.iter().for_each(|upload| self.tiles[upload.tile].forget());
        }
        let (mut work, dispatches) = planned?;
        work.bytes += self.upload(encoder, &uploads);
        for (shader, jobs) in &dispatches {
            work.bytes += self.dispatch(encoder, *shader, jobs, target.view);
        }
        Ok(work)
    }

    /// Forgets what of the sun's visibility is on the device, and what is known of pages: the next calls upload it again and write whole pages. To be
    /// called after an encoder with decoding on it was dropped instead of submitted.
    pub fn forget(&mut self) {
        self.forgotten += 1;
        self.tiles.iter_mut().for_each(Tile::forget);
    }

    /// What is to be dispatched. What is to be uploaded before comes to `uploads`, and counts as uploaded.
    fn plan(
        &mut self,
        at: &At,
        requests: &[Request],
        output: Output,
        moment: &Moment,
        uploads: &mut Vec<Upload>,
    ) -> Result<(Work, Vec<Dispatch>)> {
        let mut work = Work::default();
        let mut dispatches: Vec<Dispatch> = Vec::new();
        for request in requests {
            let Some(job) = self.job(at, request, moment, uploads)? else {
                work.black.push(*request);
                continue;
            };
            work.tiles += 1;
            work.networks += usize::from(job.hidden > 0);
            let shader = self.shader(job.hidden, job.fits_half, output);
            match dispatches.iter_mut().find(|(of, _)| *of == shader) {
                Some((_, jobs)) => jobs.push(job),
                None => dispatches.push((shader, vec![job])),
            }
        }
        join(&mut dispatches);
        Ok((work, dispatches))
    }

    /// A tile's job at a moment; `None` where it is black.
    fn job(
        &mut self,
        at: &At,
        request: &Request,
        moment: &Moment,
        uploads: &mut Vec<Upload>,
    ) -> Result<Option<Full>> {
        let place = request.place;
        // A place that the bundle does not have is refused here.
        self.bundle.knots(place)?;
        let position = self.bundle.header.position(place).unwrap_or_default();
        let (tile, grid) = (&mut self.tiles[position], &self.bundle.header.pages[place.page]);
        let mut job =
            tile::blank(grid, [place.column, place.row], request.to, request.with_border, moment.exposure);
        let maps = tile.maps.as_ref().filter(|_| moment.lights != Lights::Sun);
        let bias = maps.and_then(|maps| maps.job(&self.bundle.header.timeline, at.moment(), &mut job));
        let mut is_sunlit = false;
        if let Some((seen, sun)) = tile.seen.as_mut().zip(at.sun()) {
            if seen.held.is_none_or(|(times, _)| times != sun.times) {
                let part = at.sun_of(place)?.map(|tile| seen.part(&tile, sun.times));
                let (held, words) = part.unwrap_or((Held::Dark, Vec::new()));
                debug_assert!(words.len() <= seen.region.1);
                if held != Held::Dark {
                    uploads.push(Upload { tile: position, to: seen.region.0, words });
                }
                seen.held = Some((sun.times, held));
            }
            is_sunlit = seen.job(&sun, &mut job);
        }
        if bias.is_none() && !is_sunlit {
            return Ok(None);
        }
        let (hidden, fits_half) =
            maps.filter(|_| bias.is_some()).map_or((0, true), |maps| (maps.hidden(), maps.fits_half));
        Ok(Some(Full { job, bias: bias.unwrap_or_default(), hidden, fits_half }))
    }

    /// Records that tiles' places on a target become black.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a place that the bundle does not have.
    pub fn clear(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        requests: &[Request],
        target: Target,
    ) -> Result<Work> {
        let mut jobs = Vec::new();
        for Request { place, to, with_border } in requests {
            self.bundle.knots(*place)?;
            let grid = &self.bundle.header.pages[place.page];
            let job = tile::blank(grid, [place.column, place.row], *to, *with_border, 0.0);
            jobs.push(Full { job, bias: Vec::new(), hidden: 0, fits_half: true });
        }
        let shader = self.shader(0, true, target.output);
        let bytes = self.dispatch(encoder, shader, &jobs, target.view);
        Ok(Work { tiles: jobs.len(), bytes, ..Work::default() })
    }

    /// The shader of tiles of a width; 0: of tiles without a network.
    fn shader(&self, hidden: usize, fits_half: bool, output: Output) -> Shader {
        let precision = if fits_half { self.options.precision } else { Precision::Single };
        // Tiles without a network use the narrowest shader that the others need.
        let least = || self.tiles.iter().filter_map(|tile| tile.maps.as_ref()).map(Maps::hidden).min();
        let hidden = if hidden > 0 { hidden } else { least().unwrap_or(16) };
        let shared = self.device.limits().max_compute_workgroup_storage_size as usize;
        Shader { hidden, precision, output, coarse: self.coarse, shared }
    }

    fn upload(&self, encoder: &mut wgpu::CommandEncoder, uploads: &[Upload]) -> u64 {
        let words: Vec<u32> = uploads.iter().flat_map(|upload| &upload.words).copied().collect();
        if words.is_empty() {
            return 0;
        }
        let staging = self.device.create_buffer_init(&BufferInitDescriptor {
            label: Some("ndgi interval, new"),
            contents: bytemuck::cast_slice(&words),
            usage: wgpu::BufferUsages::COPY_SRC,
        });
        let mut from = 0;
        for Upload { to, words, .. } in uploads {
            let length = 4 * words.len() as u64;
            encoder.copy_buffer_to_buffer(&staging, from, &self.interval, 4 * u64::from(*to), length);
            from += length;
        }
        staging.size()
    }

    fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        shader: Shader,
        jobs: &[Full],
        view: &wgpu::TextureView,
    ) -> u64 {
        jobs.chunks(MOST_JOBS).map(|jobs| self.dispatch_some(encoder, shader, jobs, view)).sum()
    }

    fn dispatch_some(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        shader: Shader,
        jobs: &[Full],
        view: &wgpu::TextureView,
    ) -> u64 {
        let mut bytes = Vec::new();
        for Full { job, bias, .. } in jobs {
            bytes.extend_from_slice(bytemuck::bytes_of(job));
            let end = bytes.len() + 4 * shader.hidden;
            bytes.extend_from_slice(bytemuck::cast_slice(bias));
            bytes.resize(end, 0);
        }
        let buffer = self.device.create_buffer_init(&BufferInitDescriptor {
            label: Some("ndgi jobs"),
            contents: &bytes,
            usage: wgpu::BufferUsages::STORAGE,
        });
        let device = &self.device;
        let pipeline = self.options.pipelines.of(device, &shader);
        let buffers = [&buffer, &self.resident, &self.interval];
        let mut entries: Vec<wgpu::BindGroupEntry> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        for (binding, view) in [(3, &self.maps), (4, view)] {
            entries
                .push(wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) });
        }
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("ndgi"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let rows = jobs.iter().map(|full| full.job.size[1]).max().unwrap_or(0);
        let mut pass = encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("ndgi"), ..Default::default() });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(jobs.len() as u32, rows.div_ceil(shader::STRIP as u32), 1);
        bytes.len() as u64
    }
}

/// A job, with the biases behind it.
struct Full {
    job: Job,
    bias: Vec<f32>,
    /// Width of the hidden layers; 0 where the sun alone is decoded.
    hidden: usize,
    fits_half: bool,
}

type Dispatch = (Shader, Vec<Full>);

/// A tile's part of the interval's buffer.
struct Upload {
    /// The tile's number in the index.
    tile: usize,
    /// Where the part begins, in words.
    to: u32,
    words: Vec<u32>,
}

/// Merges sun-only jobs into a dispatch that has a network, if there is one.
fn join(dispatches: &mut Vec<Dispatch>) {
    while dispatches.len() > 1 {
        let is_alone = |(_, jobs): &Dispatch| jobs.iter().all(|full| full.hidden == 0);
        let Some(at) = dispatches.iter().position(is_alone) else { return };
        let (_, jobs) = dispatches.swap_remove(at);
        dispatches[0].1.extend(jobs);
    }
}
