//! glTF 2.0, `.gltf` and `.glb`: the meshes of its default scene, at their nodes.

mod meshopt;
mod accessor;
mod colours;
mod container;
mod extensions;
mod lights;
mod material;
mod emission;
mod glass;
mod instancing;
mod motion;
mod keep;
mod photometric;
mod pose;

use super::LightmapPlace;
use super::model::{Mesh, Model, NodeMesh};
use super::names::TreeNode;
use super::notes::{Notes, plural};
use super::texture::TextureStore;
use accessor::{Buffers, read_floats, read_indices};
use dataset::{Error, Result};
use glam::{DMat4, DQuat, DVec3, Vec2, Vec3, Vec4};
use gltf::material::AlphaMode;
use gltf::mesh::{Mode, Semantic};
use material::{OpenAsset, UvSource};
use photometric::Profiles;
use pose::{Pose, Skins};
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// Reads a glTF asset.
pub(super) fn load(path: &Path, textures: &mut TextureStore, notes: &mut Notes) -> Result<Model> {
    let file = path.display().to_string();
    let folder = path.parent().unwrap_or(Path::new(""));
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let (json, binary) = container::split(&bytes, &file)?;
    // What the crate does not know stands in the same JSON as plain values.
    let root: Value =
        serde_json::from_slice(json).map_err(|e| Error::invalid(&file, format!("not glTF 2.0: {e}")))?;
    extensions::check_version(&root, &file)?;
    if let Some(unread) = extensions::check(&root, &file)? {
        notes.add_line(&file, unread);
    }
    lights::check(&root, &file)?;
    photometric::check(&root, &file)?;
    let document = document(json, &root, &file)?;
    let plain = buffers(&document, &root, binary, folder, &file)?;
    let decoded = meshopt::decode_views(&root, &plain, &file)?;
    let buffers = Buffers { plain, decoded };
    let asset = OpenAsset { file: &file, folder, document: &document, root: &root, buffers: &buffers };
    Reader {
        asset,
        textures,
        notes,
        model: Model::default(),
        materials: BTreeMap::new(),
        skins: Skins::default(),
        profiles: Profiles::default(),
        skipped: 0,
    }
    .read()
}

/// Parses and checks the JSON.
fn document(json: &[u8], root: &Value, file: &str) -> Result<gltf::Document> {
    let parsed = match root.get("animations") {
        None => gltf::json::deserialize::from_slice(json),
        // They are not played, and the crate refuses those of other things than nodes.
        Some(_) => {
            let mut still = root.clone();
            still.as_object_mut().map(|still| still.remove("animations"));
            gltf::json::deserialize::from_value(still)
        }
    };
    let mut root: gltf::json::Root =
        parsed.map_err(|e| Error::invalid(file, format!("not glTF 2.0: {e}")))?;
    // The crate's own check of positions reads past the list of accessors.
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (semantic, accessor) in mesh.primitives.iter().flat_map(|p| &p.attributes) {
            if accessor.value() >= root.accessors.len() {
                let what = format!("{} names accessor {}", semantic.to_string(), accessor.value());
                let expected = format!("expected an index below {}", root.accessors.len());
                return Err(Error::invalid(format!("{file}: mesh {i}"), format!("{what}: {expected}")));
            }
        }
    }
    // Judged by `extensions`; the crate would refuse what it does not read itself.
    root.extensions_required.clear();
    gltf::Document::from_json(root).map_err(|e| match e {
        gltf::Error::Validation(list) => {
            let place = |at: &dyn std::fmt::Display| extensions::as_written(&at.to_string());
            let list: Vec<_> =
                list.iter().take(3).map(|(at, what)| format!("{}: {what}", place(at))).collect();
            Error::invalid(file, format!("not glTF 2.0: {}", list.join("; ")))
        }
        other => Error::invalid(file, format!("not glTF 2.0: {other}")),
    })
}

/// Gathers the bytes of all buffers.
fn buffers<'a>(
    document: &gltf::Document,
    root: &Value,
    binary: Option<&'a [u8]>,
    folder: &Path,
    file: &str,
) -> Result<Vec<Cow<'a, [u8]>>> {
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        if meshopt::is_fallback(&root["buffers"][buffer.index()]) {
            buffers.push(Cow::default());
            continue;
        }
        let place = format!("{file}: buffer {}", buffer.index());
        let bytes: Cow<[u8]> = match buffer.source() {
            gltf::buffer::Source::Uri(uri) => container::read_uri(uri, folder, &place)?.into(),
            gltf::buffer::Source::Bin => binary
                .ok_or_else(|| Error::invalid(&place, "it has no uri and the file no BIN chunk"))?
                .into(),
        };
        if bytes.len() < buffer.length() {
            let what = format!("{} bytes: expected {}", bytes.len(), buffer.length());
            return Err(Error::invalid(place, what));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The state of reading one asset.
struct Reader<'a> {
    asset: OpenAsset<'a>,
    textures: &'a mut TextureStore,
    notes: &'a mut Notes,
    model: Model,
    /// By the material's index in the asset, and what vertices add to it: its index in the model, and where
    /// the coordinates of its base colour and of its emission come from.
    materials: BTreeMap<(Option<usize>, Vertices), (usize, UvSource, UvSource)>,
    skins: Skins,
    profiles: Profiles,
    /// Primitives of points or lines.
    skipped: usize,
}

/// What vertex colours decide about a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Vertices {
    /// Nothing but a factor.
    Plain,
    /// All of its colour, since the primitive names no material.
    Coloured,
    /// That it is glass, since their alpha is below 1 and the material blends.
    Thinned,
}

impl Reader<'_> {
    fn read(mut self) -> Result<Model> {
        let document = self.asset.document;
        let scene = document.default_scene().or(document.scenes().next());
        let number = scene.as_ref().map(gltf::Scene::index);
        // Each with where its parent stands, the parent's place in the tree, and whether that is hidden.
        let mut stack: Vec<(gltf::Node, DMat4, Option<usize>, bool)> = match scene {
            Some(scene) => scene.nodes().map(|n| (n, DMat4::IDENTITY, None, false)).collect(),
            None => {
                let mut is_child = vec![false; document.nodes().count()];
                document.nodes().flat_map(|n| n.children()).for_each(|c| is_child[c.index()] = true);
                let roots = document.nodes().filter(|n| !is_child[n.index()]);
                roots.map(|n| (n, DMat4::IDENTITY, None, false)).collect()
            }
        };
        let roots = stack.iter().map(|(node, ..)| node.index()).collect();
        stack.reverse();
        // Depth first, in the file's order. Nodes form a tree: none is met twice.
        let (mut met, mut order) = (vec![false; document.nodes().count()], Vec::new());
        let mut primitives: BTreeMap<(usize, Pose), std::ops::Range<usize>> = BTreeMap::new();
        while let Some((node, file_from_parent, parent, is_hidden)) = stack.pop() {
            let name = node.name().map_or_else(|| format!("node {}", node.index()), str::to_owned);
            let place = format!("{}: {name}", self.asset.file);
            if std::mem::replace(&mut met[node.index()], true) {
                return Err(Error::invalid(place, "the node has two parents: expected a tree"));
            }
            order.push(node.index());
            let file_from_node = file_from_parent * parent_from_node(&node);
            if !file_from_node.is_finite() {
                return Err(Error::invalid(place, "its transform: expected finite numbers"));
            }
            let json = &self.asset.root["nodes"][node.index()];
            let is_hidden = is_hidden || extensions::hides(json, &place)?;
            let movable = motion::movable(json).unwrap_or_else(|what| {
                self.notes.add(self.asset.file, "node", &name, what);
                None
            });
            let in_tree = self.model.tree.nodes.len();
            self.model.tree.nodes.push(TreeNode {
                index: node.index(),
                name: lights::valid(node.name().unwrap_or("")),
                parent,
                movable,
            });
            let (file, contents) = (self.asset.file, &mut self.model.contents);
            if !is_hidden {
                lights::read_lamp(&node, in_tree, file_from_node, file, contents, self.notes);
            }
            let shining = (!is_hidden).then_some(&mut *contents);
            self.profiles.read(&self.asset, &node, in_tree, file_from_node, shining, self.notes)?;
            lights::read_camera(&node, file_from_node, contents);
            if let Some(mesh) = node.mesh() {
                let lightmap_place = lightmap_place(&node).unwrap_or_else(|what| {
                    self.notes.add(self.asset.file, "node", &name, what);
                    LightmapPlace::Unsaid
                });
                let key = (mesh.index(), Pose::of(&node, &mesh));
                let skin = node.skin().filter(|_| key.1.skin.is_some());
                if node.skin().is_some() && skin.is_none() {
                    let what = "its skin is not applied: expected JOINTS_0 and WEIGHTS_0 in every primitive of the mesh";
                    self.notes.add(self.asset.file, "node", &name, what);
                }
                let range = match primitives.get(&key) {
                    Some(range) => range.clone(),
                    None => {
                        let start = self.model.meshes.len();
                        for primitive in mesh.primitives() {
                            self.primitive(&mesh, &primitive, &key.1, &skin)?;
                        }
                        primitives.insert(key, start..self.model.meshes.len());
                        start..self.model.meshes.len()
                    }
                };
                // The joints alone place what has a skin, not its node.
                let is_skinned = skin.is_some();
                let instances = match is_skinned {
                    true => None,
                    false => instancing::transforms(&self.asset, json, &place)?,
                };
                let repeats: Vec<_> = match instances {
                    None => vec![None],
                    Some(instances) => instances.into_iter().enumerate().map(Some).collect(),
                };
                let file_from_placed = if is_skinned { DMat4::IDENTITY } else { file_from_node };
                for repeat in repeats {
                    let file_from_mesh = repeat.map_or(file_from_placed, |(_, at)| file_from_placed * at);
                    self.model.placements.extend(range.clone().map(|mesh| NodeMesh {
                        mesh,
                        node: Some(in_tree),
                        repeat,
                        file_from_mesh,
                        is_skinned,
                        is_hidden,
                        lightmap_place,
                    }));
                }
            }
            let children: Vec<_> = node.children().collect();
            stack.extend(children.into_iter().rev().map(|c| (c, file_from_node, Some(in_tree), is_hidden)));
        }
        let placements = &mut self.model.placements;
        if placements.iter().any(|p| p.lightmap_place != LightmapPlace::Unsaid) {
            let unsaid = placements.iter_mut().filter(|p| p.lightmap_place == LightmapPlace::Unsaid);
            unsaid.for_each(|p| p.lightmap_place = LightmapPlace::Nowhere);
        }
        if self.skipped > 0 {
            let what = "points and lines have no surface and are left out";
            self.notes.add(self.asset.file, "file part", plural(self.skipped, "primitive"), what);
        }
        let materials = self.materials.keys().filter_map(|(material, _)| *material);
        let profiles = self.profiles.bytes;
        self.model.asset = Some(keep::asset(&self.asset, order, roots, number, materials, profiles));
        Ok(self.model)
    }

    /// Reads a primitive into a mesh in a pose, whose skin is `skin`; one of points or lines is skipped.
    fn primitive(
        &mut self,
        mesh: &gltf::Mesh,
        primitive: &gltf::Primitive,
        pose: &Pose,
        skin: &Option<gltf::Skin>,
    ) -> Result<()> {
        let name = mesh.name().unwrap_or("").to_owned();
        let shown = if name.is_empty() { format!("mesh {}", mesh.index()) } else { name.clone() };
        let part = || format!("{shown}, primitive {}", primitive.index());
        let place = format!("{}: {}", self.asset.file, part());
        if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            self.skipped += 1;
            return Ok(());
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            return Err(Error::invalid(place, "it has no POSITION"));
        };
        let buffers = self.asset.buffers;
        let colours = primitive.get(&Semantic::Colors(0));
        let colours = colours.map(|colours| colours::read(&colours, buffers, &place)).transpose()?;
        let (material, uv, emission_uv) = self.material(&primitive.material(), colours.as_deref())?;
        let numbers = Some((mesh.index(), primitive.index()));
        let mut result =
            Mesh { name, material, primitive: numbers, origin: DVec3::ZERO, ..Default::default() };
        result.positions =
            read_floats::<3>(&positions, buffers, &place)?.into_iter().map(Vec3::from).collect();
        let count = result.positions.len();
        let expect = |what: &str, n: usize| match n == count {
            true => Ok(()),
            false => Err(Error::invalid(&place, format!("{n} {what} for {count} positions"))),
        };
        if let Some(normals) = primitive.get(&Semantic::Normals) {
            result.normals =
                read_floats::<3>(&normals, buffers, &place)?.into_iter().map(Vec3::from).collect();
            expect("normals", result.normals.len())?;
        }
        if let Some(uvs) = primitive.get(&Semantic::TexCoords(uv.set)) {
            let transform = |t| uv.matrix * Vec2::from(t) + uv.offset;
            result.uvs = read_floats::<2>(&uvs, buffers, &place)?.into_iter().map(transform).collect();
            expect("texture coordinates", result.uvs.len())?;
        } else if self.model.materials[material].texture.is_some() {
            let what = format!(
                "the material has a texture, but there is no TEXCOORD_{}: the texture's corner is used all over",
                uv.set
            );
            self.notes.add(self.asset.file, "primitive", part(), what);
        }
        if self.model.materials[material].emission.is_some_and(|e| e.texture.is_some()) {
            if let Some(uvs) = primitive.get(&Semantic::TexCoords(emission_uv.set)) {
                let transform = |t| emission_uv.matrix * Vec2::from(t) + emission_uv.offset;
                result.emission_uvs =
                    read_floats::<2>(&uvs, buffers, &place)?.into_iter().map(transform).collect();
                expect("texture coordinates", result.emission_uvs.len())?;
            } else {
                let what = format!(
                    "the material has an emissive texture, but there is no TEXCOORD_{}: the texture's corner is used all over",
                    emission_uv.set
                );
                self.notes.add(self.asset.file, "primitive", part(), what);
            }
        }
        if let Some(uvs) = primitive.get(&Semantic::TexCoords(1)) {
            result.lightmap_uvs =
                read_floats::<2>(&uvs, buffers, &place)?.into_iter().map(Vec2::from).collect();
            expect("lightmap coordinates", result.lightmap_uvs.len())?;
        }
        let kept =
            primitive.attributes().filter_map(|(semantic, of)| keep::attribute(&semantic, &of, buffers));
        result.attributes =
            kept.filter(|attribute| attribute.bytes.len() == count * attribute.stride).collect();
        if let Some(colours) = colours {
            result.colours = colours;
            expect("vertex colours", result.colours.len())?;
        }
        let indices = match primitive.indices() {
            Some(indices) => read_indices(&indices, buffers, &place)?,
            None => (0..u32::try_from(count).unwrap_or(u32::MAX)).collect(),
        };
        result.triangles = triangles(&indices, primitive.mode(), &place)?;
        if !pose.is_plain() {
            let joints = skin.as_ref().map(|skin| self.skins.joints(&self.asset, skin)).transpose()?;
            pose.apply(&self.asset, primitive, joints, &mut result, &place)?;
        }
        // (Those it drops join the strips that some exporters write.)
        result.finish(&place)?.note_copies(self.asset.file, &part(), self.notes);
        self.model.meshes.push(result);
        Ok(())
    }

    /// The material's index in the model; each is read once for the same use of vertex colours.
    fn material(
        &mut self,
        material: &gltf::Material,
        colours: Option<&[Vec4]>,
    ) -> Result<(usize, UvSource, UvSource)> {
        let is_thinned = |colours: &[Vec4]| colours.iter().any(|colour| colour.w < 1.0);
        let vertices = match colours {
            Some(_) if material.index().is_none() => Vertices::Coloured,
            Some(colours) if material.alpha_mode() == AlphaMode::Blend && is_thinned(colours) => {
                Vertices::Thinned
            }
            _ => Vertices::Plain,
        };
        let key = (material.index(), vertices);
        if let Some(&known) = self.materials.get(&key) {
            return Ok(known);
        }
        let (mut read, mut uv) = material::material(&self.asset, material, self.textures, self.notes)?;
        if vertices == Vertices::Coloured {
            (read.albedo, read.undefined) = (Vec3::ONE, false);
        }
        let (emission, emission_uv) = emission::emission(&self.asset, material, self.textures, self.notes)?;
        read.emission = emission;
        let is_thinned = vertices == Vertices::Thinned;
        glass::read(&self.asset, material, is_thinned, &mut read, &mut uv, self.textures, self.notes)?;
        self.model.materials.push(read);
        let known = (self.model.materials.len() - 1, uv, emission_uv);
        self.materials.insert(key, known);
        Ok(known)
    }
}

/// Where a node's `extras` say that its lightmap lies; an error says what is wrong with them.
fn lightmap_place(node: &gltf::Node) -> std::result::Result<LightmapPlace, String> {
    let Some(extras) = node.extras() else { return Ok(LightmapPlace::Unsaid) };
    let Ok(extras) = serde_json::from_str::<serde_json::Value>(extras.get()) else {
        return Ok(LightmapPlace::Unsaid);
    };
    let (scale, offset) = (extras.get("lightmapScale"), extras.get("lightmapOffset"));
    if scale.is_none() && offset.is_none() {
        return Ok(LightmapPlace::Unsaid);
    }
    let pair = |value: Option<&serde_json::Value>, default: [f32; 2]| {
        let Some(value) = value else { return Some(default) };
        let pair = serde_json::from_value::<[f32; 2]>(value.clone()).ok()?;
        pair.iter().all(|x| x.is_finite()).then_some(pair)
    };
    let page = extras.get("lightmapPage").map_or(Some(0), |page| u32::try_from(page.as_u64()?).ok());
    match (page, pair(scale, [1.0; 2]), pair(offset, [0.0; 2])) {
        (Some(page), Some(scale), Some(offset)) => Ok(LightmapPlace::At { page, scale, offset }),
        _ => Err("its extras lightmapScale, lightmapOffset and lightmapPage are not used: expected two numbers, two numbers and a \
                  page from 0 on"
            .to_owned()),
    }
}

/// A node's transform in double precision; the quaternion is normalised.
fn parent_from_node(node: &gltf::Node) -> DMat4 {
    match node.transform() {
        gltf::scene::Transform::Matrix { matrix } => {
            DMat4::from_cols_array_2d(&matrix.map(|c| c.map(f64::from)))
        }
        gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
            let rotation = DQuat::from_array(rotation.map(f64::from)).normalize();
            DMat4::from_scale_rotation_translation(
                DVec3::from(scale.map(f64::from)),
                rotation,
                DVec3::from(translation.map(f64::from)),
            )
        }
    }
}

/// Lists, strips and fans as triangles (glTF 2.0, 3.7.2.1).
fn triangles(indices: &[u32], mode: Mode, place: &str) -> Result<Vec<[u32; 3]>> {
    Ok(match mode {
        Mode::TriangleStrip => {
            let turned =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => match indices.split_first() {
            Some((&hub, rim)) => rim.windows(2).map(|w| [w[0], w[1], hub]).collect(),
            None => Vec::new(),
        },
        _ => {
            let (list, rest) = indices.as_chunks::<3>();
            if !rest.is_empty() {
                let what = format!("{} indices: expected a multiple of 3", indices.len());
                return Err(Error::invalid(place, what));
            }
            list.to_vec()
        }
    })
}

#[cfg(test)]
mod pose_tests;
