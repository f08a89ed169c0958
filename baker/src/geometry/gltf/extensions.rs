//! What becomes of the extensions that an asset names: read, without effect on what is baked, or in the way.

use dataset::{Error, Result};
use serde_json::Value;
use std::path::Path;

/// Those that are read.
const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
];

/// Those that change neither where surfaces are nor what a diffuse one reflects, or whose fallback says it.
const WITHOUT_EFFECT: &[&str] = &[
    "EXT_texture_webp",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_texture_basisu",
    "KHR_xmp_json_ld",
];

/// Those that say something about geometry or light and are not read, and what to do.
const NOT_READ: &[(&str, &str)] = &[
    ("EXT_lights_image_based", "give the scene file a `[sky]` of model \"image\""),
    ("KHR_materials_diffuse_transmission", "surfaces are taken as opaque"),
    ("KHR_node_visibility", "hidden nodes are baked too: delete them before the export"),
    ("MSFT_lod", "only the first level of detail is baked"),
    ("MSFT_texture_dds", "export the textures as PNG or JPEG"),
    (AVIF, ""),
];

const DRACO: &str = "KHR_draco_mesh_compression";
const AVIF: &str = "EXT_texture_avif";

/// The command that writes meshes of a file without compression.
fn uncompressed(file: &str) -> String {
    format!("{} writes it without", command("copy", file, ""))
}

/// The command that turns KTX2 textures of a file into such as are read.
pub(super) fn without_ktx2(file: &str) -> String {
    format!("{} converts it to PNG", command("ktxdecompress", file, ""))
}

/// The command that turns textures of a file, of any format, into such as are read.
pub(super) fn with_png(file: &str) -> String {
    format!("{} converts the textures to PNG", command("png", file, " --formats \"*\""))
}

/// A command of glTF Transform that writes a file anew, beside it.
fn command(verb: &str, file: &str, options: &str) -> String {
    let path = Path::new(file);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let out = path.with_file_name(format!("{stem}-plain.glb"));
    let quoted = |path: &str| match path.chars().all(|c| c.is_alphanumeric() || "/\\._-+:".contains(c)) {
        true => path.to_owned(),
        false => format!("\"{path}\""),
    };
    let (file, out) = (quoted(file), quoted(&out.to_string_lossy()));
    format!("`npx @gltf-transform/cli {verb} {file} {out}{options}`")
}

/// A place in an asset, as the `gltf` crate names it, with the names that extensions have in files:
/// `KHR_lights_punctual` for `khrLightsPunctual`.
pub(super) fn as_written(place: &str) -> String {
    let plain = |name: &str| name.replace('_', "").to_ascii_lowercase();
    let known = |word: &str| {
        let names = READ.iter().chain(WITHOUT_EFFECT).find(|name| plain(name) == word.to_ascii_lowercase());
        names.map_or_else(|| word.to_owned(), |name| (*name).to_owned())
    };
    place.split('.').map(known).collect::<Vec<_>>().join(".")
}

/// An error where the asset requires what is not read, or its meshes are compressed in a way that is not; a
/// warning, if it uses something that is not read.
pub(super) fn check(root: &Value, file: &str) -> Result<Option<String>> {
    let names = |key: &str| -> Vec<&str> {
        root[key].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
    };
    for name in names("extensionsRequired") {
        if !READ.contains(&name) && !WITHOUT_EFFECT.contains(&name) {
            let remedy = match NOT_READ.iter().find(|(known, _)| *known == name) {
                _ if name == DRACO => uncompressed(file),
                _ if name == AVIF => with_png(file),
                Some((_, remedy)) if remedy.starts_with("export") => (*remedy).to_owned(),
                _ => "export it without".to_owned(),
            };
            return Err(Error::unsupported(
                file,
                format!("the asset requires {name}, which is not read: {remedy}"),
            ));
        }
    }
    // What Draco compressed may stand there a second time, as plain numbers.
    for (i, mesh) in root["meshes"].as_array().into_iter().flatten().enumerate() {
        for primitive in mesh["primitives"].as_array().into_iter().flatten() {
            let position = primitive["attributes"]["POSITION"].as_u64().unwrap_or(u64::MAX);
            let accessor = usize::try_from(position).ok().and_then(|at| root["accessors"].get(at));
            let is_plain = accessor.is_some_and(|accessor| accessor.get("bufferView").is_some());
            if primitive["extensions"].get(DRACO).is_some() && !is_plain {
                let remedy = uncompressed(file);
                let what = format!("its positions are compressed with {DRACO}, which is not read: {remedy}");
                return Err(Error::unsupported(format!("{file}: mesh {i}"), what));
            }
        }
    }
    let used = names("extensionsUsed");
    let found: Vec<String> = NOT_READ
        .iter()
        .filter(|(name, _)| used.contains(name))
        .map(|(name, remedy)| match *name {
            AVIF => format!("{name} ({})", with_png(file)),
            _ => format!("{name} ({remedy})"),
        })
        .collect();
    let many = if found.len() == 1 { "an extension that is" } else { "extensions that are" };
    Ok((!found.is_empty()).then(|| format!("the file uses {many} not read: {}", found.join("; "))))
}

/// Whether a texture stands in another format alone, which the asset requires to be read.
pub(super) fn is_in_a_required_format(root: &Value, texture: usize) -> bool {
    let texture = &root["textures"][texture];
    let required = root["extensionsRequired"].as_array().into_iter().flatten();
    let mut named = required.filter_map(Value::as_str).filter(|name| name.contains("_texture_"));
    texture.get("source").is_none() && named.any(|name| texture["extensions"].get(name).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_the_names_that_files_have() {
        for (place, expected) in [
            ("nodes[3].extensions.khrLightsPunctual.light", "nodes[3].extensions.KHR_lights_punctual.light"),
            (
                "materials[0].extensions.khrMaterialsPbrSpecularGlossiness",
                "materials[0].extensions.KHR_materials_pbrSpecularGlossiness",
            ),
            (
                "meshes[0].primitives[1].attributes[\"POSITION\"]",
                "meshes[0].primitives[1].attributes[\"POSITION\"]",
            ),
        ] {
            assert_eq!(as_written(place), expected);
        }
    }

    #[test]
    fn commands_name_the_file_and_one_beside_it() {
        let copy = |file: &str| command("copy", file, "");
        assert_eq!(copy("a/car.glb"), "`npx @gltf-transform/cli copy a/car.glb a/car-plain.glb`");
        let spaced = "`npx @gltf-transform/cli copy \"my car.gltf\" \"my car-plain.glb\"`";
        assert_eq!(copy("my car.gltf"), spaced);
    }
}
