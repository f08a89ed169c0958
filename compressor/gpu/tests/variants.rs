//! Every variant of the shader is valid, and can be written in the languages of other engines.

#[path = "../examples/shaders.rs"]
mod shaders;

use naga::valid::{ValidationFlags, Validator};
use ndgi_gpu::{Output, Precision, Shader};

fn variants() -> impl Iterator<Item = Shader> {
    let outputs = [Output::Rgba16Float, Output::Rgba32Float, Output::Rgba8Unorm];
    [16, 32, 64].into_iter().flat_map(move |hidden| {
        [Precision::Single, Precision::Half].into_iter().flat_map(move |precision| {
            outputs.into_iter().flat_map(move |output| {
                // As little of F_uvt as there can be, and as much; memory for all weights, and for few.
                [1, 640].map(|coarse| Shader { hidden, precision, output, coarse, shared: 16_384 })
            })
        })
    })
}

/// Bytes of a workgroup's memory that a shader takes.
fn used(module: &naga::Module) -> usize {
    let variables = module.global_variables.iter().map(|(_, variable)| variable);
    let shared = variables.filter(|variable| variable.space == naga::AddressSpace::WorkGroup);
    shared.map(|variable| module.types[variable.ty].inner.size(module.to_ctx()) as usize).sum()
}

#[test]
fn exported_shaders_run_on_every_device_unless_more_memory_is_named() {
    let shader = |arguments: &[&str]| {
        shaders::shader(&arguments.iter().map(|argument| (*argument).to_owned()).collect::<Vec<_>>())
    };
    let used =
        |arguments: &[&str]| used(&naga::front::wgsl::parse_str(&shader(arguments).unwrap().wgsl()).unwrap());
    for hidden in ["16", "32", "64"] {
        for precision in ["single", "half"] {
            let small = used(&[hidden, precision]);
            assert!(small <= 16_384, "{hidden}, {precision}: {small} bytes");
            let large = used(&[hidden, precision, "rgba8unorm", "32768"]);
            assert!((small..=32_768).contains(&large), "{hidden}, {precision}: {large} bytes");
        }
        let wide = used(&[hidden, "single", "rgba8unorm", "32768"]) > 16_384;
        assert_eq!(wide, hidden != "16");
    }
    assert_eq!(shader(&[]), shader(&["16", "single", "rgba16float", "16384"]));
    for wrong in
        [&["8"][..], &["16", "double"], &["16", "half", "bc6h"], &["16", "half", "rgba8unorm", "9000"]]
    {
        assert_eq!(shader(wrong), None, "{wrong:?}");
    }
}

#[test]
fn every_variant_is_valid() {
    let mut count = 0;
    for shader in variants() {
        let text = shader.wgsl();
        assert!(!text.contains('$') && text.contains("(FORMAT.md, sections"), "{shader:?}");
        let module =
            naga::front::wgsl::parse_str(&text).unwrap_or_else(|error| panic!("{shader:?}: {error:?}"));
        let capabilities = shaders::capabilities(&shader);
        let mut validator = Validator::new(ValidationFlags::all(), capabilities);
        validator.validate(&module).unwrap_or_else(|error| panic!("{shader:?}: {error:?}"));
        let used = used(&module);
        assert!(used <= shader.shared, "{shader:?}: {used} bytes of a workgroup");
        for (language, text) in shaders::languages(&shader).unwrap() {
            assert!(text.lines().count() > 200, "{shader:?} in {language}");
            let places: &[&str] = match language {
                "metal" => &[
                    "jobs [[buffer(0)]]",
                    "resident [[buffer(1)]]",
                    "interval [[buffer(2)]]",
                    "_buffer_sizes [[buffer(3)]]",
                    "maps [[texture(0)]]",
                    "destination [[texture(1)]]",
                ],
                "hlsl" => &["register(t0)", "register(t1)", "register(t2)", "register(t3)", "register(u4)"],
                _ => &[],
            };
            for place in places {
                assert!(text.contains(place), "{shader:?} in {language}: no {place}");
            }
        }
        count += 1;
    }
    assert_eq!(count, 36);
}
