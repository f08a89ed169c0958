//! What becomes of the extensions that an asset names: read, without effect on what is baked, or in the way.

use dataset::{Error, Result};
use serde_json::Value;
use std::path::Path;

/// What [`hides`] reads.
const VISIBILITY: &str = "KHR_node_visibility";

/// Those that are read.
const READ: &[&str] = &[
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    VISIBILITY,
    "KHR_texture_transform",
];

/// Those that change neither where surfaces are nor what a diffuse one reflects, or whose fallback says it.
/// One that ends with an underscore stands for all that begin so.
const WITHOUT_EFFECT: &[&str] = &[
    "ADOBE_materials_clearcoat_",
    "CESIUM_primitive_outline",
    "EXT_feature_metadata",
    "EXT_instance_features",
    "EXT_materials_",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_mesh_primitive_edge_visibility",
    "EXT_structural_metadata",
    "EXT_texture_astc",
    "EXT_texture_webp",
    "FB_geometry_metadata",
    "FB_ngon_encoding",
    "GODOT_single_root",
    // Told with the animations themselves.
    "KHR_animation_pointer",
    "KHR_audio_",
    "KHR_character_",
    "KHR_implicit_shapes",
    "KHR_interactivity",
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
    "KHR_physics_",
    "KHR_texture_basisu",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MOZ_hubs_components",
    "MSFT_packing_",
    "OMI_",
    "VRM",
    "VRMC_",
];

/// Those that say something about geometry or light and are not read, and what to do. (Those that are not
/// known at all are told, too.)
const NOT_READ: &[(&str, &str)] = &[
    ("ADOBE_materials_thin_transparency", "give the part a `transmission`"),
    ("AGI_articulations", "parts stay where their nodes are"),
    ("CESIUM_RTC", "give the object a `translate`"),
    ("EXT_lights_area", "write its lamps as `[[group.rectangle]]` or `[[group.disc]]`"),
    ("EXT_lights_environment", "give the scene file a `[sky]` of model \"image\""),
    ("EXT_lights_image_based", "give the scene file a `[sky]` of model \"image\""),
    ("EXT_mesh_lod", "only the first level of detail is baked"),
    ("EXT_node_lod", "only the first level of detail is baked"),
    ("FRAUNHOFER_external_model", "name the other models as objects of their own"),
    ("INTEL_lights_sunsky", "give the scene file a `[place]`, a `[sun]` and a `[sky]`"),
    ("KHR_environment_map", "give the scene file a `[sky]` of model \"image\""),
    ("KHR_lights_environment", "give the scene file a `[sky]` of model \"image\""),
    ("KHR_gaussian_splatting", "splats have no surface"),
    ("KHR_materials_diffuse_transmission", "surfaces are taken as opaque"),
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

/// An error where the asset is of another version of the format.
pub(super) fn check_version(root: &Value, file: &str) -> Result<()> {
    let parsed = |key: &str| -> Result<Option<(u32, u32)>> {
        let value = &root["asset"][key];
        let number = |text: &str| text.parse::<u32>().ok();
        match value.as_str().map(|text| text.split_once('.').unwrap_or((text, "0"))) {
            Some((major, minor)) if number(major).is_some() && number(minor).is_some() => {
                Ok(number(major).zip(number(minor)))
            }
            None if value.is_null() => Ok(None),
            _ => Err(Error::invalid(
                file,
                format!("not glTF 2.0: asset.{key} = {value}: expected text such as \"2.0\""),
            )),
        }
    };
    let other = |key: &str, (major, minor): (u32, u32)| {
        let what = format!("asset.{key} = \"{major}.{minor}\": expected glTF 2.0: export the file as that");
        Err(Error::unsupported(file, what))
    };
    match (parsed("version")?, parsed("minVersion")?) {
        (Some(version), _) if version.0 != 2 => other("version", version),
        // Of a newer file 2.0 still means what is read, unless the file itself says otherwise.
        (_, Some(least)) if least > (2, 0) => other("minVersion", least),
        _ => Ok(()),
    }
}

/// Whether a node, by its JSON, is hidden with all that is below it (`KHR_node_visibility`).
pub(super) fn hides(node: &Value, place: &str) -> Result<bool> {
    match node["extensions"].get(VISIBILITY).map(|extension| &extension["visible"]) {
        None | Some(Value::Null) => Ok(false),
        Some(Value::Bool(is_visible)) => Ok(!is_visible),
        Some(other) => {
            let what = format!("{VISIBILITY}: `visible` = {other}: expected true or false");
            Err(Error::invalid(place, what))
        }
    }
}

/// An error where the asset requires what is not read, or its meshes are compressed in a way that is not; a
/// warning, if it uses something that is not read.
pub(super) fn check(root: &Value, file: &str) -> Result<Option<String>> {
    let names = |key: &str| -> Vec<&str> {
        root[key].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
    };
    for name in names("extensionsRequired") {
        if !READ.contains(&name) && !is_without_effect(name) {
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
    let is_known = |name: &str| {
        name == DRACO
            || READ.contains(&name)
            || is_without_effect(name)
            || NOT_READ.iter().any(|known| known.0 == name)
    };
    let mut unknown: Vec<&str> = used.iter().copied().filter(|name| !is_known(name)).collect();
    unknown.sort_unstable();
    unknown.dedup();
    let many = |n: usize| if n == 1 { "an extension that is" } else { "extensions that are" };
    let mut told = Vec::new();
    if !found.is_empty() {
        told.push(format!("{} not read: {}", many(found.len()), found.join("; ")));
    }
    if !unknown.is_empty() {
        let what =
            "they are ignored: what they add is not baked, and what they move or hide is baked unchanged";
        told.push(format!("{} not known: {} ({what})", many(unknown.len()), unknown.join(", ")));
    }
    Ok((!told.is_empty()).then(|| format!("the file uses {}", told.join(", and "))))
}

/// Whether an extension changes nothing of what is baked.
fn is_without_effect(name: &str) -> bool {
    let fits = |known: &&str| name == *known || known.ends_with('_') && name.starts_with(known);
    WITHOUT_EFFECT.iter().any(fits)
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
