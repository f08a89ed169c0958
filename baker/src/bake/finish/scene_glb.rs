//! The baked geometry with its lightmap coordinates, as glTF binary: what a viewer or a game needs beside the
//! maps.
//!
//! It is the scene's files put together: their nodes, names, transforms, materials, cameras, lights and
//! extras as they are. `primitive` writes vertices, `carry` what goes over (`emission_glb` and `glass_glb`
//! what the scene file changed), `motion` what moves, `transform` where files stand, `container` the bytes.

mod container;
mod emission_glb;
mod glass_glb;
mod carry;
mod primitive;
mod motion;
mod transform;

use crate::atlas::{Atlas, Face, Placement};
use crate::geometry::{File, Geometry, Mesh, Placed, Source};
use crate::{Error, Result};
use carry::{Carried, MaterialKey, asset};
use container::Glb;
use dataset::format::Instance;
use glam::{DAffine3, DVec3, Vec2};
use motion::{Deformed, Motion};
use primitive::{Layout, Own};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// The name under which the dataset's geometry is found.
pub(crate) const GLB_FILE: &str = "scene.glb";

/// Files that stand further from zero than this, in metres, are placed about a point near them: readers in
/// single precision then lose nothing.
const FAR: f64 = 4096.0;

/// The geometry file, and the places on the pages that its nodes tell, in their order.
pub struct Written {
    /// The file.
    pub glb: Vec<u8>,
    /// For the manifest.
    pub instances: Vec<Instance>,
}

/// Writes every placed file as a node that holds the file's own.
///
/// Meshes get `TEXCOORD_1`, which holds layout coordinates (v down, as glTF); a node that has texels says in
/// its `extras` where they lie: page coordinates = `lightmapScale` × TEXCOORD_1 + `lightmapOffset`, on page
/// `lightmapPage`. Nodes whose meshes share a layout, or have no texels, share a mesh. Where the parts of a
/// mesh lie at several places of that kind, or a node has instances, these are children of its name.
/// What moves keeps its animations, skins and morph targets; those of everything else are left out. Nodes
/// below which it moves have `movable` in their extras.
///
/// # Errors
/// [`Error::Unsupported`] where it would be larger than a GLB can be.
pub fn to_glb(geometry: &Geometry, atlas: &Atlas) -> Result<Written> {
    Writer {
        geometry,
        atlas,
        out: Glb::default(),
        carried: Carried::default(),
        motion: Motion::default(),
        nodes: Vec::new(),
        meshes: Vec::new(),
        primitives: BTreeMap::new(),
        known_meshes: BTreeMap::new(),
    }
    .write()
}

/// Which part of a mesh a primitive shows: what is equal is written once.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    /// All of it, without texels.
    Plain,
    /// All of it with what deforms it, without texels.
    Deformed(Deformed),
    /// All of it, in a layout of the atlas.
    Shared(u32),
    /// All of an instance of the geometry, in page coordinates.
    Whole(usize),
    /// What of an instance lies on a page; the first one has also what has no texels.
    OnPage { instance: usize, page: u32, is_first: bool },
}

/// A primitive: of which file and mesh, which part, of which material.
type Key = (usize, usize, Part, Option<MaterialKey>);

/// A primitive that a node shows.
#[derive(Clone, Copy)]
struct Piece {
    /// Of what it is a part, by its number among the sources.
    source: usize,
    /// Where it has texels.
    place: Option<Placement>,
    key: Key,
}

struct Writer<'a> {
    geometry: &'a Geometry,
    atlas: &'a Atlas,
    out: Glb,
    carried: Carried,
    motion: Motion,
    nodes: Vec<Map<String, Value>>,
    meshes: Vec<Value>,
    primitives: BTreeMap<Key, Value>,
    known_meshes: BTreeMap<Vec<Key>, usize>,
}

impl Writer<'_> {
    fn write(mut self) -> Result<Written> {
        let originals = &self.geometry.originals;
        let (baked, instances) = (originals.baked().count(), self.geometry.instances.len());
        if baked != instances {
            return Err(Error::invalid("scene.glb", format!("{baked} instances of {instances} in files")));
        }
        let far = originals.objects.iter().map(|object| object.world_from_file.w_axis.truncate());
        // A number of whole metres, which single precision holds.
        let base = far.clone().find(|at| at.abs().max_element() > FAR);
        let base = base.map_or(DVec3::ZERO, |at| at.round().as_vec3().as_dvec3());
        let mut placed = (0..originals.sources.len()).peekable();
        let mut roots = Vec::new();
        for number in 0..originals.objects.len() {
            let root = self.object(number, base, &mut placed)?;
            roots.push(root);
        }
        if base != DVec3::ZERO {
            let node = json!({ "name": "scene", "translation": base.to_array(), "children": roots });
            roots = vec![self.push(node.as_object().cloned().unwrap_or_default())];
        }
        self.mark(&roots);
        self.animate();
        self.finish(&roots)
    }

    /// Adds a node.
    fn push(&mut self, node: Map<String, Value>) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Makes a node a child of another.
    fn adopt(&mut self, parent: usize, child: usize) {
        let children = self.nodes[parent].entry("children").or_insert_with(|| json!([]));
        children.as_array_mut().into_iter().for_each(|list| list.push(json!(child)));
    }

    /// A placed file; gives the node that stands for it. `placed` is what is yet to be written of the scene's
    /// meshes.
    fn object(
        &mut self,
        number: usize,
        base: DVec3,
        placed: &mut std::iter::Peekable<std::ops::Range<usize>>,
    ) -> Result<usize> {
        let geometry = self.geometry;
        let object = &geometry.originals.objects[number];
        let file = &geometry.originals.files[object.file];
        let mut place = DAffine3::from_mat4(object.world_from_file);
        place.translation -= base;
        let mut root: Option<usize> = None;
        let mut inner = 0;
        for mut node in transform::nodes(&place) {
            node.insert("name".into(), json!(file.name));
            inner = self.push(node);
            match root {
                None => root = Some(inner),
                Some(outer) => self.adopt(outer, inner),
            }
        }
        // The file's own nodes, in its order.
        if let Some(asset) = &file.gltf {
            if let Some(extras) = asset.scene.get("extras") {
                self.nodes[inner].insert("extras".into(), extras.clone());
            }
            for &old in &asset.nodes {
                let mut node = self.carried.node(object.file, old, asset, &mut self.out);
                remove_own_extras(&mut node);
                let new = self.push(node);
                self.motion.nodes.insert((number, old), new);
            }
            let new_from_old = |old: usize| self.motion.nodes.get(&(number, old)).copied();
            let mut pairs = Vec::new();
            for &old in &asset.nodes {
                for child in asset.root["nodes"][old]["children"].as_array().into_iter().flatten() {
                    let child = child.as_u64().and_then(|child| new_from_old(child as usize));
                    pairs.extend(new_from_old(old).zip(child));
                }
            }
            pairs.extend(asset.roots.iter().filter_map(|&old| Some((inner, new_from_old(old)?))));
            pairs.into_iter().for_each(|(parent, child)| self.adopt(parent, child));
        }
        // What stands at one node, or as one of its instances, is written together.
        let sources = &geometry.originals.sources;
        let of = |source: &Source| {
            (
                source.node,
                source.repeat.map(|(number, _)| number),
                source.node.is_none().then_some(source.mesh),
            )
        };
        while let Some(first) = placed.next_if(|&i| sources[i].object == number) {
            let mut all = vec![first];
            while let Some(i) =
                placed.next_if(|&i| sources[i].object == number && of(&sources[i]) == of(&sources[first]))
            {
                all.push(i);
            }
            let node = match (sources[first].node, sources[first].repeat) {
                (Some(old), _)
                    if sources[first].is_skinned && matches!(sources[first].placed, Placed::Baked(_)) =>
                {
                    let original = self.motion.nodes[&(number, old)];
                    self.of_skin(inner, original, &file.meshes[sources[first].mesh])
                }
                (Some(old), None) => self.motion.nodes[&(number, old)],
                (Some(old), Some((_, node_from_instance))) => {
                    let parent = self.motion.nodes[&(number, old)];
                    self.child(parent, &DAffine3::from_mat4(node_from_instance))
                }
                (None, _) => {
                    let mesh = &file.meshes[sources[first].mesh];
                    let name = if mesh.name.is_empty() { &file.name } else { &mesh.name };
                    let mut node = Map::new();
                    node.insert("name".into(), json!(name));
                    let origin = primitive::origin(mesh);
                    if origin != DVec3::ZERO {
                        node.insert("translation".into(), json!(origin.to_array()));
                    }
                    let node = self.push(node);
                    self.adopt(inner, node);
                    node
                }
            };
            self.show(node, &all)?;
        }
        // What the file hides, as it is in the file.
        for hidden in file.hidden.chunk_by(|a, b| (a.node, a.repeat) == (b.node, b.repeat)) {
            let parent = self.motion.nodes[&(number, hidden[0].node)];
            let node = match hidden[0].repeat {
                _ if hidden[0].is_skinned => {
                    let node = self.of_skin(inner, parent, &file.meshes[hidden[0].mesh]);
                    let extensions = json!({ "KHR_node_visibility": { "visible": false } });
                    self.nodes[node].insert("extensions".into(), extensions);
                    node
                }
                None => parent,
                Some(node_from_instance) => self.child(parent, &DAffine3::from_mat4(node_from_instance)),
            };
            let keys = hidden.iter().map(|hidden| self.own_key(object.file, hidden.mesh)).collect();
            let mesh = self.mesh(keys)?;
            self.nodes[node].insert("mesh".into(), json!(mesh));
        }
        Ok(root.unwrap_or(inner))
    }

    /// A node for a mesh that a skin places, of the name of the mesh's own node, in the space of the file,
    /// whose node is `inner`.
    fn of_skin(&mut self, inner: usize, original: usize, mesh: &Mesh) -> usize {
        let mut node = Map::new();
        if let Some(name) = self.nodes[original].get("name") {
            node.insert("name".into(), name.clone());
        }
        let origin = primitive::origin(mesh);
        if origin != DVec3::ZERO {
            node.insert("translation".into(), json!(origin.to_array()));
        }
        let node = self.push(node);
        self.adopt(inner, node);
        node
    }

    /// A child of a node's name.
    fn child(&mut self, parent: usize, parent_from_child: &DAffine3) -> usize {
        let mut at = parent;
        for mut node in transform::nodes(parent_from_child) {
            if let Some(name) = self.nodes[parent].get("name") {
                node.insert("name".into(), name.clone());
            }
            let child = self.push(node);
            self.adopt(at, child);
            at = child;
        }
        at
    }

    /// Lets a node show some of the scene's meshes: as one mesh, or as children where their places differ, or
    /// some move.
    fn show(&mut self, node: usize, sources: &[usize]) -> Result<()> {
        let mut pieces: Vec<Piece> = Vec::new();
        for &source in sources {
            let placements = match self.geometry.originals.sources[source].placed {
                Placed::Baked(i) => &self.atlas.placements[i][..],
                Placed::Movable(_) => &[],
            };
            let places = placements.iter().copied().map(Some);
            let places = if placements.is_empty() { vec![None] } else { places.collect() };
            let keys = self.keys(source).into_iter().zip(places);
            pieces.extend(keys.map(|(key, place)| Piece { source, place, key }));
        }
        let said = |piece: &Piece| {
            let place = piece.place.map(|p| (p.page, p.scale.map(f32::to_bits), p.offset.map(f32::to_bits)));
            (place, self.moves(piece.source))
        };
        if pieces.windows(2).all(|pair| said(&pair[0]) == said(&pair[1])) {
            return self.fill(node, &pieces);
        }
        for piece in pieces {
            let child = self.child(node, &DAffine3::IDENTITY);
            self.fill(child, &[piece])?;
        }
        Ok(())
    }

    /// Whether a source moves.
    fn moves(&self, source: usize) -> bool {
        matches!(self.geometry.originals.sources[source].placed, Placed::Movable(_))
    }

    /// Gives a node its mesh and its place on the page, or what moves it.
    fn fill(&mut self, node: usize, pieces: &[Piece]) -> Result<()> {
        let Some(&Piece { source, place, key: (_, _, part, _) }) = pieces.first() else { return Ok(()) };
        let mesh = self.mesh(pieces.iter().map(|piece| piece.key).collect())?;
        self.nodes[node].insert("mesh".into(), json!(mesh));
        if let Some(Placement { page, scale, offset, .. }) = place {
            let extras = extras(&mut self.nodes[node]);
            extras["lightmapScale"] = json!(scale);
            extras["lightmapOffset"] = json!(offset);
            extras["lightmapPage"] = json!(page);
        }
        self.note(node, self.moves(source));
        if let Part::Deformed(deformed) = part {
            let source = self.geometry.originals.sources[source];
            self.deform(node, &source, deformed);
        }
        Ok(())
    }

    /// The primitive that shows a mesh of a glTF as the file does.
    fn own_key(&self, file: usize, number: usize) -> Key {
        let mesh = &self.geometry.originals.files[file].meshes[number];
        let root = &asset(self.geometry, file).root;
        let primitive =
            mesh.primitive.map(|(mesh, primitive)| &root["meshes"][mesh]["primitives"][primitive]);
        let original =
            primitive.and_then(|primitive| primitive["material"].as_u64()).map(|index| index as usize);
        let material = original.map(|index| MaterialKey {
            of: (file, mesh.material),
            original: Some((file, index)),
            material_index: None,
            emission: None,
            is_recoloured: false,
            is_movable: false,
            moved: (carry::reads_second_set(&root["materials"][index]) && !mesh.lightmap_uvs.is_empty())
                .then_some(1),
        });
        (file, number, Part::Plain, material)
    }

    /// The primitives that show a source, one for each of its places, or one if it has none.
    fn keys(&self, source: usize) -> Vec<Key> {
        let geometry = self.geometry;
        let source = &geometry.originals.sources[source];
        let file = geometry.originals.objects[source.object].file;
        let (material_index, placements, is_movable) = match source.placed {
            Placed::Baked(i) => {
                let triangle = geometry.instances[i].triangles.start;
                (geometry.material_of[triangle], &self.atlas.placements[i][..], false)
            }
            Placed::Movable(material) => (material, &[][..], true),
        };
        let mesh = &geometry.originals.files[file].meshes[source.mesh];
        let of = (file, mesh.material);
        let is_laid = !placements.is_empty();
        let material = match mesh.primitive {
            None => Some(MaterialKey {
                of,
                original: None,
                material_index: Some(material_index),
                emission: Some(material_index),
                is_recoloured: source.changed.colour,
                moved: None,
                is_movable,
            }),
            Some((number, primitive)) => {
                let root = &asset(geometry, file).root;
                let original = root["meshes"][number]["primitives"][primitive]["material"].as_u64();
                let original = original.map(|index| (file, index as usize));
                let changed = source.changed;
                let emission = changed.emission.then_some(material_index);
                let material_index = changed.surface.then_some(material_index);
                let reads =
                    original.is_some_and(|(_, index)| carry::reads_second_set(&root["materials"][index]));
                let sets = mesh.attributes.iter().filter(|a| a.name.starts_with("TEXCOORD_")).count() as u32;
                // Behind all others; without a layout they stay where they are.
                let moved = (reads && !mesh.lightmap_uvs.is_empty()).then_some(if is_laid {
                    sets.max(1) + 1
                } else {
                    1
                });
                (original.is_some() || material_index.is_some() || emission.is_some()).then_some(
                    MaterialKey {
                        of,
                        original,
                        material_index,
                        emission,
                        is_recoloured: changed.colour,
                        moved,
                        // (Without a change it is the file's for either.)
                        is_movable: is_movable && (material_index.is_some() || emission.is_some()),
                    },
                )
            }
        };
        let key = |part| (file, source.mesh, part, material);
        let Placed::Baked(instance) = source.placed else {
            return vec![key(self.deformed(source).map_or(Part::Plain, Part::Deformed))];
        };
        let part = |(n, placement): (usize, &Placement)| match placement.layout {
            Some(layout) => Part::Shared(layout),
            None if placements.len() == 1 => Part::Whole(instance),
            None => Part::OnPage { instance, page: placement.page, is_first: n == 0 },
        };
        match is_laid {
            false => vec![key(Part::Plain)],
            true => placements.iter().enumerate().map(|placement| key(part(placement))).collect(),
        }
    }

    /// The mesh of some primitives.
    fn mesh(&mut self, keys: Vec<Key>) -> Result<usize> {
        if let Some(&known) = self.known_meshes.get(&keys) {
            return Ok(known);
        }
        let primitives: Vec<Value> = keys.iter().map(|&key| self.primitive(key)).collect::<Result<_>>()?;
        let mut json = Map::new();
        if let Some(&(file, number, part, _)) = keys.first() {
            let mesh = &self.geometry.originals.files[file].meshes[number];
            if !mesh.name.is_empty() {
                json.insert("name".into(), json!(mesh.name));
            }
            let original =
                mesh.primitive.and_then(|(number, _)| asset(self.geometry, file).root["meshes"].get(number));
            if let Some(extras) = original.and_then(|original| original.get("extras")) {
                json.insert("extras".into(), extras.clone());
            }
            let weights = original.and_then(|original| original.get("weights"));
            if let (Part::Deformed(_), Some(weights)) = (part, weights) {
                json.insert("weights".into(), weights.clone());
            }
        }
        json.insert("primitives".into(), json!(primitives));
        self.meshes.push(Value::Object(json));
        self.known_meshes.insert(keys, self.meshes.len() - 1);
        Ok(self.meshes.len() - 1)
    }

    fn primitive(&mut self, key: Key) -> Result<Value> {
        if let Some(known) = self.primitives.get(&key) {
            return Ok(known.clone());
        }
        let (file, number, part, material) = key;
        let file_of = &self.geometry.originals.files[file];
        let mesh = &file_of.meshes[number];
        let all = 0..mesh.triangles.len() as u32;
        let own = Own {
            moved: material.and_then(|material| material.moved),
            is_recoloured: material.is_some_and(|material| material.is_recoloured),
        };
        let out = &mut self.out;
        let mut json = match part {
            Part::Deformed(deformed) => {
                self.deformed_primitive(file, mesh.primitive.unwrap_or_default(), deformed, own.is_recoloured)
            }
            Part::Plain => primitive::write(mesh, all, None, own, out),
            Part::Shared(layout) => {
                let layout = &self.atlas.layouts[layout as usize];
                let layout =
                    as_of_mesh(self.geometry, layout.instance as usize, layout.faces.iter().copied());
                primitive::write(mesh, all, Some(&layout), own, out)
            }
            Part::Whole(instance) => {
                let page = self.atlas.placements[instance].first().map_or(0, |p| p.page);
                let layout = own_layout(self.geometry, self.atlas, instance, page);
                primitive::write(mesh, all, Some(&layout), own, out)
            }
            Part::OnPage { instance, page, is_first } => {
                let layout = own_layout(self.geometry, self.atlas, instance, page);
                let part = part_on_page(self.geometry, self.atlas, instance, page, is_first);
                primitive::write(mesh, part.into_iter(), Some(&layout), own, out)
            }
        };
        let root = &asset(self.geometry, file).root;
        let original =
            mesh.primitive.map(|(number, primitive)| &root["meshes"][number]["primitives"][primitive]);
        if let Some(extras) = original.and_then(|original| original.get("extras")) {
            json.insert("extras".into(), extras.clone());
        }
        if let Some(key) = material {
            json.insert("material".into(), json!(self.carried.material(self.geometry, key, &mut self.out)?));
        }
        self.primitives.insert(key, Value::Object(json.clone()));
        Ok(Value::Object(json))
    }

    fn finish(mut self, roots: &[usize]) -> Result<Written> {
        let instances = self.nodes.iter().filter_map(instance_of).collect();
        let originals = &self.geometry.originals;
        let mut header =
            json!({ "version": "2.0", "generator": concat!("bake ", env!("CARGO_PKG_VERSION")) });
        let roots_of = originals.files.iter().filter_map(|file| Some(&file.gltf.as_ref()?.root));
        let copyrights: BTreeSet<&str> =
            roots_of.clone().filter_map(|root| root["asset"]["copyright"].as_str()).collect();
        if !copyrights.is_empty() {
            header["copyright"] = json!(copyrights.into_iter().collect::<Vec<_>>().join("; "));
        }
        let extras = roots_of.clone().find_map(|root| root["asset"].get("extras"));
        if let ([_], Some(extras)) = (&originals.files[..], extras) {
            header["extras"] = extras.clone();
        }
        let mut scene = json!({ "nodes": roots });
        if let ([_], Some(name)) = (&originals.files[..], originals.files.iter().find_map(scene_name)) {
            scene["name"] = json!(name);
        }
        let extensions = self.carried.root_extensions();
        let mut root = json!({
            "asset": header,
            "scene": 0,
            "scenes": [scene],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.carried.materials,
            "textures": self.carried.textures,
            "samplers": self.carried.samplers,
            "images": self.carried.images,
            "cameras": self.carried.cameras,
            "accessors": self.out.accessors,
            "bufferViews": self.out.views,
            "buffers": [{ "byteLength": self.out.binary.len() }],
        });
        for (key, list) in self.take_lists() {
            root[key] = json!(list);
        }
        if let Some(extensions) = extensions {
            root["extensions"] = extensions;
        }
        let mut used = BTreeSet::new();
        carry::extensions_used(&root, &mut used);
        let required = roots_of.flat_map(|root| root["extensionsRequired"].as_array().into_iter().flatten());
        let required: BTreeSet<&str> =
            required.filter_map(Value::as_str).filter(|name| used.contains(*name)).collect();
        root["extensionsUsed"] = json!(used);
        root["extensionsRequired"] = json!(required);
        let glb = self.out.finish(&without_empty(root))?;
        Ok(Written { glb, instances })
    }
}

/// The name of the scene that was read of a file.
fn scene_name(file: &File) -> Option<&str> {
    file.gltf.as_ref()?.scene["name"].as_str()
}

/// What a node tells of its place on the page.
fn instance_of(node: &Map<String, Value>) -> Option<Instance> {
    let extras = node.get("extras")?;
    let pair = |key: &str| serde_json::from_value(extras.get(key)?.clone()).ok();
    let page = u32::try_from(extras.get("lightmapPage")?.as_u64()?).ok()?;
    let name = node.get("name").and_then(Value::as_str).unwrap_or("").to_owned();
    Some(Instance { name, page, scale: pair("lightmapScale")?, offset: pair("lightmapOffset")? })
}

/// The extras of a node, made an object.
fn extras(node: &mut Map<String, Value>) -> &mut Value {
    let extras = node.entry("extras").or_insert_with(|| json!({}));
    if !extras.is_object() {
        *extras = json!({ "extras": extras.take() });
    }
    extras
}

/// Takes out of a node what it told of an earlier lightmap, and of what moves.
fn remove_own_extras(node: &mut Map<String, Value>) {
    let Some(extras) = node.get_mut("extras").and_then(Value::as_object_mut) else { return };
    ["lightmapScale", "lightmapOffset", "lightmapPage"].iter().for_each(|key| drop(extras.remove(*key)));
    motion::remove_extras(extras);
    if extras.is_empty() {
        node.remove("extras");
    }
}

/// Faces of an instance by the triangles of its mesh, corners in the order of those.
fn as_of_mesh(geometry: &Geometry, instance: usize, faces: impl Iterator<Item = (u32, [Vec2; 3])>) -> Layout {
    let instance = &geometry.instances[instance];
    let first = instance.triangles.start as u32;
    // A mirrored instance has two corners of each triangle swapped.
    let is_mirrored = instance.world_from_mesh.matrix3.determinant() < 0.0;
    let order = |[a, b, c]: [Vec2; 3]| if is_mirrored { [a, c, b] } else { [a, b, c] };
    faces.map(|(triangle, corners)| (triangle - first, order(corners))).collect()
}

/// An instance's faces, ascending by triangle.
fn faces<'a>(geometry: &Geometry, atlas: &'a Atlas, instance: usize) -> &'a [Face] {
    let triangles = &geometry.instances[instance].triangles;
    let below = |end: usize| atlas.faces.partition_point(|face| (face.triangle as usize) < end);
    &atlas.faces[below(triangles.start)..below(triangles.end)]
}

/// The places of an instance's faces on a page, which is its layout, in page coordinates.
fn own_layout(geometry: &Geometry, atlas: &Atlas, instance: usize, page: u32) -> Layout {
    let top = Vec2::new(0.0, atlas.page_rows(page).start as f32);
    let size = Vec2::new(atlas.width as f32, atlas.page_height as f32);
    let faces = faces(geometry, atlas, instance).iter().filter(|face| atlas.page_of(face) == page);
    let faces = faces.map(|face| (face.triangle, face.corners.map(|corner| (corner - top) / size)));
    as_of_mesh(geometry, instance, faces)
}

/// The triangles of an instance's mesh that lie on a page, ascending, and those without texels if asked for.
fn part_on_page(geometry: &Geometry, atlas: &Atlas, instance: usize, page: u32, with_rest: bool) -> Vec<u32> {
    let mut faces = faces(geometry, atlas, instance).iter().peekable();
    let triangles = geometry.instances[instance].triangles.clone();
    let first = triangles.start as u32;
    let is_here = |triangle: &u32| match faces.next_if(|face| face.triangle == *triangle) {
        Some(face) => atlas.page_of(face) == page,
        None => with_rest,
    };
    (first..triangles.end as u32).filter(is_here).map(|triangle| triangle - first).collect()
}

/// glTF forbids empty arrays.
fn without_empty(mut root: Value) -> Value {
    if let Some(object) = root.as_object_mut() {
        object.retain(|_, v| v.as_array().is_none_or(|a| !a.is_empty()));
    }
    root
}

#[cfg(test)]
#[path = "scene_glb_tests.rs"]
mod tests;
