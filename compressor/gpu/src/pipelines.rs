//! Compiled shaders.

use crate::shader::Shader;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Compiled shaders. A copy is the same: decoders of one device that share it compile each shader once.
#[derive(Clone, Debug, Default)]
pub struct Pipelines(Arc<Mutex<BTreeMap<Shader, wgpu::ComputePipeline>>>);

impl Pipelines {
    pub(crate) fn of(&self, device: &wgpu::Device, shader: &Shader) -> wgpu::ComputePipeline {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.entry(*shader).or_insert_with(|| pipeline(device, shader)).clone()
    }
}

fn pipeline(device: &wgpu::Device, shader: &Shader) -> wgpu::ComputePipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("ndgi"),
        source: wgpu::ShaderSource::Wgsl(shader.wgsl().into()),
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("ndgi"),
        layout: None,
        module: &module,
        entry_point: Some("decode"),
        // All that is read of a workgroup's memory is written before.
        compilation_options: wgpu::PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    })
}
