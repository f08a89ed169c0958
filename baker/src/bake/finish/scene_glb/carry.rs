//! What goes over from the files as it is: materials, textures, cameras and lights, each where something
//! first names it.

use super::container::Glb;
use super::{emission_glb, glass_glb};
use crate::geometry::{Asset, Geometry, Glass, Material, Motion, Wrap};
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Extensions of nodes that go over; others may name things by numbers that no longer hold.
const NODE_EXTENSIONS: &[&str] = &["KHR_node_hoverability", "KHR_node_selectability", "KHR_node_visibility"];
/// The extension of lights.
const LIGHTS: &str = "KHR_lights_punctual";
/// The extension of lamps that shine as photometric profiles say.
const PROFILES: &str = "EXT_lights_ies";

/// The extension that says a colour in an older way.
const GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";

/// A texture of the geometry, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Baked {
    /// Of base colour or transmission.
    Surface(u32),
    /// Of emission.
    Emission(u32),
}

/// A material as primitives name it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MaterialKey {
    /// The file, and the index among the materials that were read of it.
    pub of: (usize, usize),
    /// The file, and the material's index there, if it is a glTF's.
    pub original: Option<(usize, usize)>,
    /// The material of the geometry that is written in its place, or as its base.
    pub material_index: Option<u32>,
    /// The material of the geometry whose emission is written in place of the file's.
    pub emission: Option<u32>,
    /// The scene file gives the colour, so those of the vertices are not written.
    pub is_recoloured: bool,
    /// The set that the file's `TEXCOORD_1` now is.
    pub moved: Option<u32>,
    /// Materials of the geometry are those of what moves.
    pub is_movable: bool,
}

/// A material of the geometry, and what it lets through.
type Look<'a> = (&'a Material, Option<&'a Glass>);

impl MaterialKey {
    /// A material of the geometry, by its index.
    fn look<'a>(&self, geometry: &'a Geometry, index: u32) -> Look<'a> {
        let originals = &geometry.originals;
        match self.is_movable {
            true => {
                let glass = originals.movable_glass.get(index as usize).and_then(Option::as_ref);
                (&originals.movable_materials[index as usize], glass)
            }
            false => (&geometry.materials[index as usize], geometry.glass_of(index)),
        }
    }
}

/// What has gone over so far: lists of the new file, and where in them what of which file is.
#[derive(Default)]
pub(super) struct Carried {
    pub materials: Vec<Value>,
    pub textures: Vec<Value>,
    pub samplers: Vec<Value>,
    pub images: Vec<Value>,
    pub cameras: Vec<Value>,
    pub lights: Vec<Value>,
    pub profiles: Vec<Value>,
    known: BTreeMap<(&'static str, usize, usize), usize>,
    known_materials: BTreeMap<MaterialKey, usize>,
    known_textures: BTreeMap<Baked, usize>,
}

impl Carried {
    /// The new index of a material.
    pub(super) fn material(&mut self, geometry: &Geometry, key: MaterialKey, out: &mut Glb) -> Result<usize> {
        if let Some(&index) = self.known_materials.get(&key) {
            return Ok(index);
        }
        let name = geometry.originals.files[key.of.0].materials.get(key.of.1).map_or("", |name| name);
        let mut material = match key.original {
            Some((file, index)) => {
                let asset = asset(geometry, file);
                let mut material = asset.root["materials"][index].clone();
                self.rewrite_textures(&mut material, file, asset, key.moved, out);
                material
            }
            None if name.is_empty() => json!({}),
            None => json!({ "name": name }),
        };
        if let Some(material_index) = key.material_index {
            let look = key.look(geometry, material_index);
            self.restyle(&mut material, geometry, look, key.original.is_none(), out)?;
        }
        if let Some(material_index) = key.emission {
            let (look, _) = key.look(geometry, material_index);
            self.shine(&mut material, geometry, look, out)?;
        }
        self.materials.push(material);
        self.known_materials.insert(key, self.materials.len() - 1);
        Ok(self.materials.len() - 1)
    }

    /// Gives a material the look that was baked.
    fn restyle(
        &mut self,
        json: &mut Value,
        geometry: &Geometry,
        (material, glass): Look,
        is_new: bool,
        out: &mut Glb,
    ) -> Result<()> {
        // The older way to say a colour would go before the newer one.
        let older =
            json.get_mut("extensions").and_then(|extensions| extensions.as_object_mut()?.remove(GLOSSINESS));
        drop_empty(json, "extensions");
        let base = &mut json["pbrMetallicRoughness"];
        let texture = match older {
            Some(mut older) => older["diffuseTexture"].take(),
            None => base["baseColorTexture"].take(),
        };
        if is_new {
            *base = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
        }
        let [r, g, b] = material.albedo.to_array();
        base["baseColorFactor"] = json!([r, g, b, material.alpha]);
        match material.texture {
            None => drop(base.as_object_mut().and_then(|base| base.remove("baseColorTexture"))),
            Some(index) => {
                let mut info = if texture.is_object() { texture } else { json!({}) };
                info["index"] = json!(self.texture_of_geometry(geometry, Baked::Surface(index), out)?);
                base["baseColorTexture"] = info;
            }
        }
        json["doubleSided"] = json!(material.two_sided);
        if let (true, Some(cutoff)) = (is_new, material.alpha_cutoff) {
            json["alphaMode"] = json!("MASK");
            json["alphaCutoff"] = json!(cutoff);
        }
        self.let_through(json, geometry, glass, out)
    }

    /// Gives a material the emission that was baked, or none.
    fn shine(
        &mut self,
        json: &mut Value,
        geometry: &Geometry,
        material: &Material,
        out: &mut Glb,
    ) -> Result<()> {
        emission_glb::clear(json);
        let Some(emission) = material.emission else { return Ok(()) };
        let map = emission.map.map(|map| self.texture_of_geometry(geometry, Baked::Emission(map), out));
        emission_glb::add(json, emission.radiance, geometry.originals.emission_unit, map.transpose()?);
        Ok(())
    }

    /// Gives a material the glass that was baked, or none.
    fn let_through(
        &mut self,
        json: &mut Value,
        geometry: &Geometry,
        glass: Option<&Glass>,
        out: &mut Glb,
    ) -> Result<()> {
        glass_glb::clear(json);
        let Some(glass) = glass else { return Ok(()) };
        let texture = glass.texture.map(|at| self.texture_of_geometry(geometry, Baked::Surface(at), out));
        glass_glb::add(json, glass, texture.transpose()?);
        Ok(())
    }

    /// A texture as it was baked, as PNG.
    fn texture_of_geometry(&mut self, geometry: &Geometry, index: Baked, out: &mut Glb) -> Result<usize> {
        if let Some(&known) = self.known_textures.get(&index) {
            return Ok(known);
        }
        let texture = match index {
            Baked::Surface(index) => &geometry.textures[index as usize],
            Baked::Emission(index) => &geometry.emission_maps[index as usize],
        };
        let wrap = |w: Wrap| match w {
            Wrap::Repeat => 10497,
            Wrap::Clamp => 33071,
            Wrap::Mirror => 33648,
        };
        let pixels: Vec<u8> = texture.rgba.iter().flatten().copied().collect();
        let Some(buffer) = image::RgbaImage::from_raw(texture.width, texture.height, pixels) else {
            let what = format!("texture {index:?}: its texels are not width × height");
            return Err(Error::invalid("scene.glb", what));
        };
        let mut png = std::io::Cursor::new(Vec::new());
        buffer.write_to(&mut png, image::ImageFormat::Png).map_err(|e| Error::invalid("scene.glb", e))?;
        let view = out.view(&png.into_inner(), None);
        self.images.push(json!({ "bufferView": view, "mimeType": "image/png" }));
        self.samplers.push(json!({ "wrapS": wrap(texture.wrap_u), "wrapT": wrap(texture.wrap_v) }));
        self.textures.push(json!({ "source": self.images.len() - 1, "sampler": self.samplers.len() - 1 }));
        self.known_textures.insert(index, self.textures.len() - 1);
        Ok(self.textures.len() - 1)
    }

    /// Puts the new numbers of textures and coordinates into a material, wherever it names any. A texture
    /// without an image is left out.
    fn rewrite_textures(
        &mut self,
        json: &mut Value,
        file: usize,
        asset: &Asset,
        moved: Option<u32>,
        out: &mut Glb,
    ) {
        let Some(object) = json.as_object_mut() else { return };
        let mut lost = Vec::new();
        for (key, value) in object.iter_mut() {
            if key == "extras" {
                continue;
            }
            if !key.ends_with("Texture") || value.get("index").is_none() {
                self.rewrite_textures(value, file, asset, moved, out);
                continue;
            }
            let index = value["index"].as_u64().and_then(|index| usize::try_from(index).ok());
            match index.and_then(|index| self.texture(file, index, asset, out)) {
                Some(index) => value["index"] = json!(index),
                None => lost.push(key.clone()),
            }
            if let Some(moved) = moved {
                let is_one = |info: &Value| info["texCoord"] == 1;
                if is_one(value) {
                    value["texCoord"] = json!(moved);
                }
                if let Some(transform) =
                    value.pointer_mut("/extensions/KHR_texture_transform").filter(|t| is_one(t))
                {
                    transform["texCoord"] = json!(moved);
                }
            }
        }
        lost.iter().for_each(|key| drop(object.remove(key)));
    }

    /// The new index of a texture; `None` if it has no image.
    fn texture(&mut self, file: usize, index: usize, asset: &Asset, out: &mut Glb) -> Option<usize> {
        if let Some(&known) = self.known.get(&("texture", file, index)) {
            return Some(known);
        }
        let mut texture = asset.root["textures"].get(index)?.clone();
        let mut has_image = false;
        let mut resource = |of: &mut Value| {
            let Some(source) = of.get("source").and_then(Value::as_u64) else { return true };
            match self.image(file, source as usize, asset, out) {
                Some(image) => {
                    of["source"] = json!(image);
                    has_image = true;
                    true
                }
                None => false,
            }
        };
        if !resource(&mut texture) {
            texture.as_object_mut()?.remove("source");
        }
        if let Some(extensions) = texture.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.retain(|_, extension| resource(extension));
        }
        drop_empty(&mut texture, "extensions");
        if let Some(sampler) = texture.get("sampler").and_then(Value::as_u64) {
            let copied = self.copy("sampler", file, sampler as usize, &asset.root["samplers"]);
            match copied {
                Some(sampler) => texture["sampler"] = json!(sampler),
                None => drop(texture.as_object_mut()?.remove("sampler")),
            }
        }
        if !has_image {
            return None;
        }
        self.textures.push(texture);
        self.known.insert(("texture", file, index), self.textures.len() - 1);
        Some(self.textures.len() - 1)
    }

    /// The new index of an image, whose bytes go into the file; `None` if they could not be read or are of no
    /// known kind.
    fn image(&mut self, file: usize, index: usize, asset: &Asset, out: &mut Glb) -> Option<usize> {
        if let Some(&known) = self.known.get(&("image", file, index)) {
            return Some(known);
        }
        let bytes = asset.images.get(index)?.as_ref()?;
        let kind = match bytes.as_slice() {
            [0x89, b'P', b'N', b'G', ..] => "image/png",
            [0xff, 0xd8, ..] => "image/jpeg",
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => "image/webp",
            [0xab, b'K', b'T', b'X', b' ', b'2', b'0', ..] => "image/ktx2",
            _ => return None,
        };
        let mut image = asset.root["images"][index].clone();
        image.as_object_mut()?.remove("uri");
        image["bufferView"] = json!(out.view(bytes, None));
        image["mimeType"] = json!(kind);
        self.images.push(image);
        self.known.insert(("image", file, index), self.images.len() - 1);
        Some(self.images.len() - 1)
    }

    /// The new index of something that is copied as it is.
    fn copy(&mut self, kind: &'static str, file: usize, index: usize, from: &Value) -> Option<usize> {
        if let Some(&known) = self.known.get(&(kind, file, index)) {
            return Some(known);
        }
        let copied = from.get(index)?.clone();
        let list = match kind {
            "sampler" => &mut self.samplers,
            "camera" => &mut self.cameras,
            _ => &mut self.lights,
        };
        list.push(copied);
        let new = list.len() - 1;
        self.known.insert((kind, file, index), new);
        Some(new)
    }

    /// A node of a file without what names meshes, skins and children; with its camera and light.
    pub(super) fn node(
        &mut self,
        file: usize,
        index: usize,
        asset: &Asset,
        out: &mut Glb,
    ) -> Map<String, Value> {
        let original = &asset.root["nodes"][index];
        let mut node = original.as_object().cloned().unwrap_or_default();
        for key in ["mesh", "skin", "weights", "children", "camera", "extensions"] {
            node.remove(key);
        }
        let camera = original["camera"].as_u64();
        if let Some(camera) =
            camera.and_then(|at| self.copy("camera", file, at as usize, &asset.root["cameras"]))
        {
            node.insert("camera".into(), json!(camera));
        }
        let mut extensions = Map::new();
        for (name, extension) in original["extensions"].as_object().into_iter().flatten() {
            if NODE_EXTENSIONS.contains(&&name[..]) {
                extensions.insert(name.clone(), extension.clone());
            }
            if name == LIGHTS {
                let lights = &asset.root["extensions"][LIGHTS]["lights"];
                let light = extension["light"].as_u64();
                if let Some(light) = light.and_then(|at| self.copy("light", file, at as usize, lights)) {
                    extensions.insert(name.clone(), json!({ "light": light }));
                }
            }
            if name == PROFILES {
                let light = extension["light"].as_u64();
                if let Some(light) = light.and_then(|at| self.profile(file, at as usize, asset, out)) {
                    let mut lamp = extension.clone();
                    lamp["light"] = json!(light);
                    extensions.insert(name.clone(), lamp);
                }
            }
        }
        if !extensions.is_empty() {
            node.insert("extensions".into(), Value::Object(extensions));
        }
        node
    }

    /// The new index of a photometric profile, whose bytes go into the file; `None` if they could not be
    /// read.
    fn profile(&mut self, file: usize, index: usize, asset: &Asset, out: &mut Glb) -> Option<usize> {
        if let Some(&known) = self.known.get(&("profile", file, index)) {
            return Some(known);
        }
        let bytes = asset.profiles.get(&index)?;
        let mut profile = asset.root["extensions"][PROFILES]["lights"].get(index)?.clone();
        profile.as_object_mut()?.remove("uri");
        profile["bufferView"] = json!(out.view(bytes, None));
        profile["mimeType"] = json!("application/x-ies-lm-63");
        self.profiles.push(profile);
        self.known.insert(("profile", file, index), self.profiles.len() - 1);
        Some(self.profiles.len() - 1)
    }

    /// The root's own extensions.
    pub(super) fn root_extensions(&mut self) -> Option<Value> {
        let lists =
            [(LIGHTS, std::mem::take(&mut self.lights)), (PROFILES, std::mem::take(&mut self.profiles))];
        let used = lists.into_iter().filter(|(_, lights)| !lights.is_empty());
        let extensions: Map<String, Value> =
            used.map(|(name, lights)| (name.to_owned(), json!({ "lights": lights }))).collect();
        (!extensions.is_empty()).then_some(Value::Object(extensions))
    }
}

/// Removes an empty object.
fn drop_empty(json: &mut Value, key: &str) {
    if json[key].as_object().is_some_and(Map::is_empty) {
        json.as_object_mut().map(|json| json.remove(key));
    }
}

/// What a file that is a glTF holds.
pub(super) fn asset(geometry: &Geometry, file: usize) -> &Asset {
    static NONE: Asset = Asset {
        root: Value::Null,
        nodes: Vec::new(),
        roots: Vec::new(),
        scene: Value::Null,
        images: Vec::new(),
        motion: Motion::NONE,
        profiles: BTreeMap::new(),
    };
    geometry.originals.files[file].gltf.as_ref().unwrap_or(&NONE)
}

/// Whether a material reads the texture coordinates `TEXCOORD_1`.
pub(super) fn reads_second_set(material: &Value) -> bool {
    material.as_object().into_iter().flatten().any(|(key, value)| {
        let is_info = key.ends_with("Texture") && value.get("index").is_some();
        let transformed = value.pointer("/extensions/KHR_texture_transform/texCoord");
        is_info && transformed.unwrap_or(&value["texCoord"]) == 1
            || key != "extras" && reads_second_set(value)
    })
}

/// The names of all extensions that a file makes use of, sorted.
pub(super) fn extensions_used(json: &Value, found: &mut std::collections::BTreeSet<String>) {
    match json {
        Value::Object(object) => {
            for (key, value) in object {
                match key.as_str() {
                    "extras" => {}
                    "extensions" => {
                        for (name, extension) in value.as_object().into_iter().flatten() {
                            found.insert(name.clone());
                            extensions_used(extension, found);
                        }
                    }
                    _ => extensions_used(value, found),
                }
            }
        }
        Value::Array(list) => list.iter().for_each(|value| extensions_used(value, found)),
        _ => {}
    }
}
