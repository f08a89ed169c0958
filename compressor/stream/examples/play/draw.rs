//! The device: three passes over the scene, the fully decoded pages, and what is read back.

use crate::Result;
use crate::scene::{Scene, Vertex};
use glam::Mat4;
use ndgi::Bundle;
use ndgi_gpu::{DecodeParams, Decoder, Options, Output, Page};
use ndgi_stream::gpu::{Feedback, Runtime};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Light of a picture, linear: red, green, blue, and whether there are texels.
pub type Picture = Vec<[f32; 4]>;

const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Software or hardware, whatever there is.
pub fn device() -> Result<(String, wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::default();
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))
        .map_err(|_| "no Vulkan adapter found; install a driver (mesa-vulkan-drivers has one in software)")?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: ndgi_gpu::features(&adapter),
        required_limits: adapter.limits(),
        ..Default::default()
    }))?;
    Ok((adapter.get_info().name, device, queue))
}

pub struct Stage {
    device: wgpu::Device,
    queue: wgpu::Queue,
    size: [u32; 2],
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    count: u32,
    views: [wgpu::Buffer; 2],
    groups: [wgpu::BindGroup; 2],
    streamed: wgpu::RenderPipeline,
    feedback: wgpu::RenderPipeline,
    wholly: wgpu::RenderPipeline,
    colour: wgpu::Texture,
    depths: [wgpu::TextureView; 2],
    whole_layout: wgpu::BindGroupLayout,
    pages: u32,
}

/// What is drawn in a frame.
#[derive(Clone, Debug)]
pub struct Frame {
    pub camera: Mat4,
    pub copies: Vec<u32>,
    pub number: u32,
}

impl Stage {
    pub fn new(
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        scene: &Scene,
        runtime: &Runtime,
        pages: u32,
        size: [u32; 2],
    ) -> Self {
        let init = |label, contents: &[u8], usage| {
            device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
        };
        let vertices = init("vertices", bytemuck::cast_slice(&scene.vertices), wgpu::BufferUsages::VERTEX);
        let indices = init("indices", bytemuck::cast_slice(&scene.indices), wgpu::BufferUsages::INDEX);
        let copies: Vec<[f32; 4]> = scene.copies.iter().map(|copy| copy.extend(0.0).to_array()).collect();
        let copies = init("copies", bytemuck::cast_slice(&copies), wgpu::BufferUsages::STORAGE);
        let views = [(); 2]
            .map(|()| init("view", &[0; 80], wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST));
        let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let buffer = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: both,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[
                buffer(0, wgpu::BufferBindingType::Uniform),
                buffer(1, wgpu::BufferBindingType::Storage { read_only: true }),
            ],
        });
        let group = |view: &wgpu::Buffer| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: view.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 1, resource: copies.as_entire_binding() },
                ],
            })
        };
        let groups = [group(&views[0]), group(&views[1])];
        let whole_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: false },
                    view_dimension: wgpu::TextureViewDimension::D2Array,
                    multisampled: false,
                },
                count: None,
            }],
        });
        let source = format!("{}\n{}", Runtime::wgsl(1), include_str!("play.wgsl"));
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("play"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let pipeline = |entry: &str, format, whole: bool| {
            let mut layouts = vec![Some(&layout), Some(runtime.layout())];
            layouts.extend(whole.then_some(Some(&whole_layout)));
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &layouts,
                immediate_size: 0,
            });
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("corner"),
                    compilation_options: Default::default(),
                    buffers: &[Some(wgpu::VertexBufferLayout {
                        array_stride: size_of::<Vertex>() as u64,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32, 2 => Float32x2, 3 => Float32x3],
                    })],
                },
                primitive: Default::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Less),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format,
                        blend: None,
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let streamed = pipeline("streamed", COLOUR, false);
        let feedback = pipeline("feedback", Feedback::FORMAT, false);
        let wholly = pipeline("wholly", COLOUR, true);
        let target = |format, [width, height]: [u32; 2], usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let depth = |size| target(DEPTH, size, drawn).create_view(&Default::default());
        Stage {
            colour: target(COLOUR, size, drawn | wgpu::TextureUsages::COPY_SRC),
            depths: [depth(size), depth(runtime.feedback().size())],
            device: device.clone(),
            queue: queue.clone(),
            size,
            vertices,
            indices,
            count: scene.indices.len() as u32,
            views,
            groups,
            streamed,
            feedback,
            wholly,
            whole_layout,
            pages,
        }
    }

    /// Tells the passes of a frame where they look from. The feedback's pixels are jittered within those of
    /// the view.
    pub fn look(&self, frame: &Frame, feedback: [u32; 2]) {
        let view = |camera: Mat4, scale: f32| {
            let mut words: Vec<u32> = camera.to_cols_array().map(f32::to_bits).to_vec();
            words.extend([self.pages, frame.number, scale.to_bits(), 0]);
            words
        };
        self.queue.write_buffer(&self.views[0], 0, bytemuck::cast_slice(&view(frame.camera, 1.0)));
        let part = |base: u32, side: u32| {
            let (mut i, mut part, mut share) = (frame.number + 1, 0.0, 1.0f32);
            while i > 0 {
                share /= base as f32;
                part += share * (i % base) as f32;
                i /= base;
            }
            (2.0 * part - 1.0) / side as f32
        };
        let jitter = Mat4::from_translation(glam::Vec3::new(part(2, feedback[0]), part(3, feedback[1]), 0.0));
        let scale = feedback[0] as f32 / self.size[0] as f32;
        self.queue.write_buffer(&self.views[1], 0, bytemuck::cast_slice(&view(jitter * frame.camera, scale)));
    }

    /// The frame's view with the stream, and its feedback.
    pub fn draw(&self, encoder: &mut wgpu::CommandEncoder, runtime: &Runtime, frame: &Frame) {
        let colour = self.colour.create_view(&Default::default());
        self.pass(
            encoder,
            &self.streamed,
            [&colour, &self.depths[0]],
            &self.groups[0],
            (runtime, None, frame),
        );
        let feedback = runtime.feedback().view();
        self.pass(
            encoder,
            &self.feedback,
            [feedback, &self.depths[1]],
            &self.groups[1],
            (runtime, None, frame),
        );
    }

    /// The same view with fully decoded pages.
    pub fn draw_wholly(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        runtime: &Runtime,
        whole: &Whole,
        frame: &Frame,
    ) {
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.whole_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&whole.all),
            }],
        });
        let colour = self.colour.create_view(&Default::default());
        let with = (runtime, Some(&group), frame);
        self.pass(encoder, &self.wholly, [&colour, &self.depths[0]], &self.groups[0], with);
    }

    fn pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &wgpu::RenderPipeline,
        [colour, depth]: [&wgpu::TextureView; 2],
        view: &wgpu::BindGroup,
        (runtime, whole, frame): (&Runtime, Option<&wgpu::BindGroup>, &Frame),
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: colour,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, view, &[]);
        pass.set_bind_group(1, runtime.bind_group(), &[]);
        if let Some(whole) = whole {
            pass.set_bind_group(2, whole, &[]);
        }
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for copy in &frame.copies {
            pass.draw_indexed(0..self.count, 0, *copy..copy + 1);
        }
    }

    /// What was drawn last, read back at once.
    pub fn picture(&self) -> Result<Picture> {
        let [width, height] = self.size;
        let row = (8 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row * height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            self.colour.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let bytes = buffer.get_mapped_range(..)?;
        let texel = |eight: &[u8; 8]| {
            let half =
                |i: usize| ndgi::half::F16(u16::from_le_bytes([eight[2 * i], eight[2 * i + 1]])).to_f32();
            [0, 1, 2, 3].map(half)
        };
        let lines = bytes.chunks_exact(row as usize);
        Ok(lines.flat_map(|line| line[..8 * width as usize].as_chunks::<8>().0.iter().map(texel)).collect())
    }
}

/// The pages of one scene, fully decoded, with levels by averages of valid texels: what the stream is
/// compared with.
pub struct Whole {
    device: wgpu::Device,
    queue: wgpu::Queue,
    decoder: Decoder,
    pages: Vec<Page>,
    masks: Vec<wgpu::TextureView>,
    /// All pages and levels.
    pub all: wgpu::TextureView,
    texture: wgpu::Texture,
    pipelines: [wgpu::ComputePipeline; 2],
    levels: u32,
    exposure: f32,
}

impl Whole {
    pub fn new(
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        bundle: Bundle,
        masks: &[dataset::image::Mask],
        levels: u32,
        exposure: f32,
    ) -> Result<Self> {
        let decoder = Decoder::new(device, queue, bundle, Options::default())?;
        let grids = decoder.bundle().header.pages.clone();
        let pages = (0..grids.len())
            .map(|page| decoder.page(page, Output::Rgba16Float))
            .collect::<Result<Vec<_>, _>>()?;
        let most = |side: fn(&ndgi::grid::Grid) -> usize| grids.iter().map(side).max().unwrap_or(1) as u32;
        // Levels round up, those of textures down: a side that is a power of two has room for both.
        let side = |length: u32| length.next_power_of_two().max(1 << (levels - 1));
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("whole"),
            size: wgpu::Extent3d {
                width: side(most(|grid| grid.width)),
                height: side(most(|grid| grid.height)),
                depth_or_array_layers: grids.len() as u32,
            },
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: COLOUR,
            usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        let all = texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() });
        let mask = |mask: &dataset::image::Mask| {
            let size = wgpu::Extent3d {
                width: mask.width as u32,
                height: mask.height as u32,
                depth_or_array_layers: 1,
            };
            let bytes: Vec<u8> = mask.valid.iter().map(|valid| if *valid { 255 } else { 0 }).collect();
            let texture = device.create_texture_with_data(
                queue,
                &wgpu::TextureDescriptor {
                    label: Some("mask"),
                    size,
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: wgpu::TextureFormat::R8Unorm,
                    usage: wgpu::TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                },
                Default::default(),
                &bytes,
            );
            texture.create_view(&Default::default())
        };
        let module = device.create_shader_module(wgpu::include_wgsl!("halve.wgsl"));
        let pipelines = ["begin", "halve"].map(|entry| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                cache: None,
            })
        });
        Ok(Whole {
            masks: masks.iter().map(mask).collect(),
            device: device.clone(),
            queue: queue.clone(),
            decoder,
            pages,
            all,
            texture,
            pipelines,
            levels,
            exposure,
        })
    }

    /// Decodes all at an hour, and makes the levels.
    pub fn decode(&mut self, hour: f64) -> Result<()> {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let params = DecodeParams { exposure: self.exposure, ..DecodeParams::at(hour) };
        for page in &mut self.pages {
            self.decoder.decode_page(&mut encoder, page, &params)?;
        }
        for (number, page) in self.pages.iter().enumerate() {
            let grid = self.decoder.bundle().header.pages[number];
            let size = |level: u32| [grid.width, grid.height].map(|side| (side as u32).div_ceil(1 << level));
            for level in 0..self.levels {
                let view = |level: u32| {
                    self.texture.create_view(&wgpu::TextureViewDescriptor {
                        dimension: Some(wgpu::TextureViewDimension::D2),
                        base_mip_level: level,
                        mip_level_count: Some(1),
                        base_array_layer: number as u32,
                        array_layer_count: Some(1),
                        ..Default::default()
                    })
                };
                let above = (level > 0).then(|| view(level - 1));
                let views = [above.as_ref().unwrap_or(page.view()), &view(level)];
                self.halve(
                    &mut encoder,
                    views,
                    &self.masks[number],
                    [size(level.max(1) - 1), size(level)],
                    level,
                );
            }
        }
        self.queue.submit([encoder.finish()]);
        Ok(())
    }

    fn halve(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        [fine, coarse]: [&wgpu::TextureView; 2],
        mask: &wgpu::TextureView,
        [from, to]: [[u32; 2]; 2],
        level: u32,
    ) {
        let pipeline = &self.pipelines[usize::from(level > 0)];
        let sizes = self.device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&[from, to]),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(fine) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(coarse) },
            wgpu::BindGroupEntry { binding: 3, resource: sizes.as_entire_binding() },
        ];
        if level == 0 {
            entries.push(wgpu::BindGroupEntry {
                binding: 2,
                resource: wgpu::BindingResource::TextureView(mask),
            });
        }
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(to[0].div_ceil(8), to[1].div_ceil(8), 1);
    }
}
