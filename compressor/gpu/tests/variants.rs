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

#[test]
fn every_variant_is_valid() {
    let mut count = 0;
    for shader in variants() {
        let text = shader.wgsl();
        assert!(!text.contains('$'), "{shader:?}");
        let module =
            naga::front::wgsl::parse_str(&text).unwrap_or_else(|error| panic!("{shader:?}: {error:?}"));
        let capabilities = shaders::capabilities(&shader);
        let mut validator = Validator::new(ValidationFlags::all(), capabilities);
        validator.validate(&module).unwrap_or_else(|error| panic!("{shader:?}: {error:?}"));
        let used: u32 = module
            .global_variables
            .iter()
            .filter(|(_, variable)| variable.space == naga::AddressSpace::WorkGroup)
            .map(|(_, variable)| module.types[variable.ty].inner.size(module.to_ctx()))
            .sum();
        assert!(used as usize <= shader.shared, "{shader:?}: {used} bytes of a workgroup");
        for (language, text) in shaders::languages(&shader).unwrap() {
            assert!(text.lines().count() > 200, "{shader:?} in {language}");
        }
        count += 1;
    }
    assert_eq!(count, 36);
}
