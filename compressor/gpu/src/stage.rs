//! A bundle's data on a device and the dispatches that decode them: shared by whole bundles and pools of
//! tiles.

use crate::request::{DecodeParams, Options, Request, Target, Work};
use crate::shader::{self, Job, Output, Precision, Shader};
use crate::survey::Survey;
use crate::tile::{self, Full};
use crate::{Error, Result};
use ndgi::Bundle;
use ndgi::sun::Shadows;
use std::collections::BTreeSet;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Maximum jobs per dispatch: WebGPU's limit of workgroups per axis.
const MOST_JOBS: usize = 65_535;

/// The options as a device can have them.
///
/// # Errors
/// [`Error::Device`] if it has no 16-bit floats and they are requested.
pub(crate) fn resolved(device: &wgpu::Device, options: Options) -> Result<Options> {
    let has = device.features();
    if options.precision == Precision::Half && !has.contains(wgpu::Features::SHADER_F16) {
        return Err(Error::Device(
            "the device was created without the feature SHADER_F16; request it, or use Precision::Single"
                .to_owned(),
        ));
    }
    let unpacks = options.unpacks || !has.contains(wgpu::Features::TEXTURE_COMPRESSION_BC);
    Ok(Options { unpacks, ..options })
}

/// The words of the codebook of moving shadows, with which the resident buffer begins where there are some.
pub(crate) fn codebook() -> impl Iterator<Item = u32> {
    Shadows::codebook().as_chunks::<4>().0.iter().map(|four| u32::from_le_bytes(*four))
}

/// A texture for maps: width, height and layers.
///
/// # Errors
/// [`Error::Device`] for one larger than the device has.
pub(crate) fn texture(
    device: &wgpu::Device,
    [width, height, layers]: [u32; 3],
    unpacks: bool,
) -> Result<wgpu::Texture> {
    let limits = device.limits();
    let (most, side) = (limits.max_texture_array_layers, limits.max_texture_dimension_2d);
    if layers > most || width.max(height) > side {
        let what = format!(
            "the maps take {layers} layers of {width} × {height} texels; the device has at most {most} of {side}²"
        );
        return Err(Error::Device(what));
    }
    Ok(device.create_texture(&wgpu::TextureDescriptor {
        label: Some("ndgi maps"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: match unpacks {
            true => wgpu::TextureFormat::Rgba8Unorm,
            false => wgpu::TextureFormat::Bc7RgbaUnorm,
        },
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    }))
}

/// A buffer of this many words, at least one.
pub(crate) fn buffer(device: &wgpu::Device, label: &str, words: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: 4 * words.max(1),
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}

/// The buffers and textures on a device.
#[derive(Debug)]
pub(crate) struct Stage {
    pub device: wgpu::Device,
    pub options: Options,
    maps: wgpu::TextureView,
    pub resident: wgpu::Buffer,
    pub interval: wgpu::Buffer,
    /// Bytes of all three.
    pub bytes: u64,
    coarse: usize,
    widths: BTreeSet<usize>,
}

impl Stage {
    pub(crate) fn new(
        device: &wgpu::Device,
        options: Options,
        survey: &Survey,
        maps: &wgpu::Texture,
        [resident, interval]: [wgpu::Buffer; 2],
    ) -> Self {
        let texels =
            u64::from(maps.width()) * u64::from(maps.height()) * u64::from(maps.depth_or_array_layers());
        let bytes = texels * if options.unpacks { 4 } else { 1 } + resident.size() + interval.size();
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        let maps = maps.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() });
        Stage {
            device: device.clone(),
            options,
            maps,
            resident,
            interval,
            bytes,
            coarse: survey.coarse,
            widths: survey.widths.clone(),
        }
    }

    /// The shader of tiles of a width; 0: of tiles without a network.
    fn shader(&self, hidden: usize, fits_half: bool, output: Output) -> Shader {
        let precision = if fits_half && hidden > 0 { self.options.precision } else { Precision::Single };
        let shared = self.device.limits().max_compute_workgroup_storage_size as usize;
        Shader { hidden, precision, output, coarse: self.coarse, shared }
    }

    /// Compiles what tiles will need, so that no frame has to.
    pub(crate) fn prepare(&self, output: Output) {
        for hidden in self.widths.iter().copied().chain([0]) {
            self.options.pipelines.of(&self.device, &self.shader(hidden, true, output));
        }
    }

    /// Records jobs: one dispatch for each shader that they need. Gives how many bytes are uploaded.
    pub(crate) fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        jobs: impl IntoIterator<Item = Full>,
        Target { view, output }: Target,
    ) -> u64 {
        let mut dispatches: Vec<(Shader, Vec<Full>)> = Vec::new();
        for job in jobs {
            let shader = self.shader(job.hidden, job.fits_half, output);
            match dispatches.iter_mut().find(|(of, _)| *of == shader) {
                Some((_, jobs)) => jobs.push(job),
                None => dispatches.push((shader, vec![job])),
            }
        }
        join(&mut dispatches);
        let mut bytes = 0;
        for (shader, jobs) in &dispatches {
            bytes += jobs
                .chunks(MOST_JOBS)
                .map(|jobs| self.dispatch_some(encoder, *shader, jobs, view))
                .sum::<u64>();
        }
        bytes
    }

    /// Records writing black to tiles' areas of a target.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a place that the bundle does not have.
    pub(crate) fn clear(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        bundle: &Bundle,
        requests: &[Request],
        target: Target,
    ) -> Result<Work> {
        let blank = |request: &Request| tile::blank(bundle, *request, 0.0).map(Full::without_network);
        let jobs: Vec<Full> = requests.iter().map(blank).collect::<Result<_>>()?;
        let tiles = jobs.len();
        let bytes = self.dispatch(encoder, jobs, target);
        Ok(Work { tiles, bytes, ..Work::default() })
    }

    fn dispatch_some(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        shader: Shader,
        jobs: &[Full],
        view: &wgpu::TextureView,
    ) -> u64 {
        let mut bytes = Vec::with_capacity(jobs.len() * (size_of::<Job>() + 4 * shader.hidden));
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

impl<R> Work<R> {
    /// Counts a tile that is dispatched.
    pub(crate) fn count(&mut self, full: &Full) {
        self.tiles += 1;
        self.networks += usize::from(full.hidden > 0);
    }
}

/// Checks that the parameters are valid.
///
/// # Errors
/// [`Error::Invalid`] for an exposure that is not a finite number ≥ 0.
pub(crate) fn check(params: &DecodeParams) -> Result<()> {
    if params.exposure.is_finite() && params.exposure >= 0.0 {
        return Ok(());
    }
    Err(Error::Invalid(format!("exposure {}; expected a finite number ≥ 0", params.exposure)))
}

/// Merges jobs without a network into a dispatch that has one, if there is one.
fn join(dispatches: &mut Vec<(Shader, Vec<Full>)>) {
    while dispatches.len() > 1 {
        let is_alone = |(_, jobs): &(Shader, Vec<Full>)| jobs.iter().all(|full| full.hidden == 0);
        let Some(at) = dispatches.iter().position(is_alone) else { return };
        let (_, jobs) = dispatches.swap_remove(at);
        dispatches[0].1.extend(jobs);
    }
}
