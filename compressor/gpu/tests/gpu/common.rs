//! The device that tests share, and what is expected of it: what the decoder on the CPU gives.

use ndgi::Bundle;
use ndgi::at::At;
use ndgi::bundle::MapCoding;
use ndgi::decode::{Inputs, Lights};
use ndgi::grid::Place;
use ndgi_gpu::{DecodeParams, Decoder, Options, Output, Page, Pipelines};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub pipelines: Pipelines,
}

/// The adapter's device, once for all tests.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    let gpu = GPU.get_or_init(|| {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = match pollster::block_on(instance.request_adapter(&Default::default())) {
            Ok(adapter) => adapter,
            Err(error) => {
                assert!(
                    std::env::var_os("NDGI_GPU").is_none(),
                    "NDGI_GPU is set, and there is no adapter: {error}"
                );
                println!("skipped: no adapter was found ({error})");
                return None;
            }
        };
        println!("{:?}", adapter.get_info());
        let required_limits = wgpu::Limits::default();
        let required_features = ndgi_gpu::features(&adapter);
        let descriptor = wgpu::DeviceDescriptor { required_features, required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).unwrap();
        Some(Gpu { device, queue, pipelines: Pipelines::default() })
    });
    gpu.as_ref()
}

/// One test at a time uses the device: its errors would be another's.
pub static TURN: Mutex<()> = Mutex::new(());

impl Gpu {
    pub fn has_half(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F16)
    }

    pub fn decoder(&self, bytes: &[u8], options: Options) -> Decoder {
        let options = Options { pipelines: self.pipelines.clone(), ..options };
        Decoder::new(&self.device, &self.queue, Bundle::from_bytes(bytes.to_vec()).unwrap(), options).unwrap()
    }

    /// A page's bytes at a time.
    pub fn decode(&self, decoder: &mut Decoder, page: &mut Page, params: &DecodeParams) -> Vec<u8> {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        decoder.decode_page(&mut encoder, page, params).unwrap();
        self.queue.submit([encoder.finish()]);
        self.read(&page.texture)
    }

    /// A texture's texels, row by row.
    pub fn read(&self, texture: &wgpu::Texture) -> Vec<u8> {
        let (width, height) = (texture.width(), texture.height());
        let texel = texture.format().block_copy_size(None).unwrap();
        let stride = (width * texel).next_multiple_of(256);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(stride * height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let bytes = buffer.get_mapped_range(..).unwrap();
        bytes.chunks(stride as usize).flat_map(|row| row[..(width * texel) as usize].to_vec()).collect()
    }

    pub fn floats(&self, decoder: &mut Decoder, page: &mut Page, params: &DecodeParams) -> Vec<[f32; 3]> {
        floats_of(&self.decode(decoder, page, params))
    }

    /// A texture that tiles can be decoded to and that can be read.
    pub fn texture(&self, width: u32, height: u32) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: Output::Rgba32Float.format(),
            usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }
}

/// Light of texels of [`Output::Rgba32Float`]; their alpha is 1.
pub fn floats_of(bytes: &[u8]) -> Vec<[f32; 3]> {
    let float = |texel: &[u8; 16], at: usize| f32::from_le_bytes(texel[at..at + 4].try_into().unwrap());
    let texels = bytes.as_chunks::<16>().0.iter();
    assert!(texels.clone().all(|texel| float(texel, 12) == 1.0), "alpha");
    texels.map(|texel| [0, 4, 8].map(|at| float(texel, at))).collect()
}

/// A texel, and a channel's mean: what the network's output or the share of the sun is multiplied with. (That
/// over the texels may be far less where the sun grazes some of them: a rounded cosine is then all of it.)
pub type Expected = ([f32; 3], [f32; 3]);

/// The same page by the CPU.
pub fn by_cpu(bundle: &Bundle, page: usize, params: &DecodeParams) -> Vec<Expected> {
    let grid = bundle.header.pages[page];
    let mut out = vec![([0.0; 3], [0.0; 3]); grid.width * grid.height];
    let at = bundle.at(params.hour).unwrap().only(params.lights);
    for place in grid.places(page) {
        let corner = [place.column, place.row].map(|i| i * ndgi::model::PAYLOAD);
        let width = grid.payload(place.column, place.row).0;
        for (i, texel) in tile_by_cpu(&at, bundle, place, params).into_iter().enumerate() {
            out[(corner[1] + i / width) * grid.width + corner[0] + i % width] = texel;
        }
    }
    out
}

/// A tile's own texels by the CPU.
pub fn tile_by_cpu(at: &At, bundle: &Bundle, place: Place, params: &DecodeParams) -> Vec<Expected> {
    let tile = at.tile(place).unwrap();
    let mut texels = vec![[0.0; 3]; tile.width() * tile.height()];
    tile.decode_into(&mut texels);
    let stored = bundle.tile(place).unwrap().filter(|_| params.lights != Lights::Sun);
    let means = stored.map(|tile| Inputs::at(&tile, &bundle.header.timeline, at.point()).means);
    let of_sun = at.sun_of(place).unwrap().and(at.sun()).map(|sun| sun.irradiance);
    let mean = [0, 1, 2].map(|c| means.unwrap_or_default()[c].max(of_sun.unwrap_or_default()[c]));
    texels.into_iter().map(|texel| (texel, mean)).collect()
}

/// The largest difference, in units of max(E, mean/100).
pub fn worst(found: &[[f32; 3]], expected: &[([f32; 3], [f32; 3])]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let mut worst = 0.0f32;
    for (found, (expected, mean)) in found.iter().zip(expected) {
        for c in 0..3 {
            assert!(found[c].is_finite() && found[c] >= 0.0, "{found:?}");
            let scale = expected[c].max(mean[c] / 100.0).max(f32::MIN_POSITIVE);
            worst = worst.max((found[c] - expected[c]).abs() / scale);
        }
    }
    worst
}

/// Bundles of the repository, with and without a sun; and those of the folder that
/// `NDGI_BUNDLES` names.
pub fn fixtures() -> Vec<(String, Vec<u8>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = vec![root.join("../../tests/fuzz/corpus/bundle")];
    folders.extend(std::env::var_os("NDGI_BUNDLES").map(PathBuf::from));
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap());
    // (Planes are not decoded here.)
    let is_neural =
        |path: &PathBuf| Bundle::open(path).is_ok_and(|bundle| bundle.header.coding == MapCoding::Neural);
    let files = files.map(|file| file.unwrap().path()).filter(is_neural);
    let mut files: Vec<_> =
        files.map(|path| (path.display().to_string(), std::fs::read(&path).unwrap())).collect();
    files.sort();
    assert!(files.len() >= 4);
    files
}
