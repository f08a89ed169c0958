//! Writes the shader in the languages of other engines: WGSL, HLSL (shader model 6.2), GLSL (4.50) and Metal.
//!
//!     cargo run --release -p ndgi-gpu --example shaders -- OUT [hidden 16|32|64] [single|half] [rgba16float|rgba32float|rgba8unorm] [BYTES]
//!
//! BYTES: memory of a workgroup that the device has; 16384 without it, which all have. Where it does not hold
//! the weights, as of width 32 in single precision, the shader reads them where they lie. With 32768 they are
//! copied there first.

use naga::back::{glsl, hlsl, msl};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use ndgi_gpu::{Output, Precision, Shader};
use std::error::Error;

/// What a device has to be able to do, beyond what all can.
pub fn capabilities(shader: &Shader) -> Capabilities {
    // All but the oldest unpack 16-bit floats.
    let unpack = Capabilities::SHADER_FLOAT16_IN_FLOAT32;
    if shader.precision == Precision::Half { unpack | Capabilities::SHADER_FLOAT16 } else { unpack }
}

/// A shader by language: the ending of its file, and its text.
pub fn languages(shader: &Shader) -> Result<Vec<(&'static str, String)>, Box<dyn Error>> {
    let wgsl = shader.wgsl();
    let module = naga::front::wgsl::parse_str(&wgsl).map_err(|error| error.emit_to_string(&wgsl))?;
    let info = Validator::new(ValidationFlags::all(), capabilities(shader))
        .validate(&module)
        .map_err(|error| error.emit_to_string(&wgsl))?;
    let mut out = vec![("wgsl", wgsl)];

    let mut text = String::new();
    let options = hlsl::Options {
        shader_model: hlsl::ShaderModel::V6_2,
        zero_initialize_workgroup_memory: false,
        // What is uploaded was checked when the bundle was read.
        restrict_indexing: false,
        force_loop_bounding: false,
        ..Default::default()
    };
    let pipeline = hlsl::PipelineOptions::default();
    hlsl::Writer::new(&mut text, &options, &pipeline).write(&module, &info, None)?;
    out.push(("hlsl", text));

    // Half precision in GLSL takes an extension that naga does not write.
    if shader.precision == Precision::Single {
        let mut text = String::new();
        let binding = |binding| naga::ResourceBinding { group: 0, binding };
        let options = glsl::Options {
            version: glsl::Version::Desktop(450),
            binding_map: (0..5).map(|i| (binding(i), i as u8)).collect(),
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        };
        let pipeline = glsl::PipelineOptions {
            shader_stage: naga::ShaderStage::Compute,
            entry_point: "decode".to_owned(),
            multiview: None,
        };
        let policies = naga::proc::BoundsCheckPolicies::default();
        glsl::Writer::new(&mut text, &module, &info, &options, &pipeline, policies)?.write()?;
        out.push(("glsl", text));
    }

    // Buffers 0 to 2 and textures 0 and 1; buffer 3 has the sizes of the first three in bytes, three `uint`.
    let target = |i: u8| msl::BindTarget {
        buffer: (i < 3).then_some(i),
        texture: i.checked_sub(3),
        mutable: i == 4,
        ..Default::default()
    };
    let binding = |binding| naga::ResourceBinding { group: 0, binding };
    let resources = (0..5).map(|i| (binding(u32::from(i)), target(i))).collect();
    let places = msl::EntryPointResources { resources, sizes_buffer: Some(3), ..Default::default() };
    let options = msl::Options {
        per_entry_point_map: [("decode".to_owned(), places)].into(),
        fake_missing_bindings: false,
        zero_initialize_workgroup_memory: false,
        ..Default::default()
    };
    let (text, _) = msl::write_string(&module, &info, &options, &msl::PipelineOptions::default())?;
    out.push(("metal", text));
    Ok(out)
}

/// Memory of a workgroup that every device of WebGPU has, in bytes.
const SHARED: usize = 16_384;

/// The shader that the arguments behind the folder ask for.
pub fn shader(arguments: &[String]) -> Option<Shader> {
    let argument = |i: usize, default| arguments.get(i).map_or(default, String::as_str);
    let hidden = match argument(0, "16") {
        "16" => 16,
        "32" => 32,
        "64" => 64,
        _ => return None,
    };
    let precision = match argument(1, "single") {
        "single" => Precision::Single,
        "half" => Precision::Half,
        _ => return None,
    };
    let output = match argument(2, "rgba16float") {
        "rgba16float" => Output::Rgba16Float,
        "rgba32float" => Output::Rgba32Float,
        "rgba8unorm" => Output::Rgba8Unorm,
        _ => return None,
    };
    let shared = arguments.get(3).map_or(Some(SHARED), |bytes| bytes.parse().ok())?;
    // The largest F_uvt that the format allows: indices into the array of this length are not checked, and
    // less would save memory of a workgroup alone.
    let coarse = ndgi_gpu::coarse([128, 128], 128);
    (shared >= SHARED && arguments.len() <= 4).then_some(Shader { hidden, precision, output, coarse, shared })
}

#[allow(dead_code, reason = "a test uses the functions above alone")]
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = "usage: shaders OUT [hidden 16|32|64] [single|half] [rgba16float|rgba32float|rgba8unorm] \
                 [bytes of a workgroup's memory, 16384 or more]";
    let (folder, more) = arguments.split_first().ok_or(usage)?;
    let shader = shader(more).ok_or(usage)?;
    std::fs::create_dir_all(folder)?;
    for (ending, text) in languages(&shader)? {
        let path = std::path::Path::new(folder).join(format!("decode.{ending}"));
        std::fs::write(&path, &text)?;
        println!("{}: {} lines", path.display(), text.lines().count());
    }
    Ok(())
}
