//! What moves, as its file has it: skins, animations, and meshes that skins or morph targets deform.

use super::Writer;
use super::carry::asset;
use super::container::{FLOAT, Glb, UNSIGNED_INT, VERTICES};
use super::primitive::{unit, whiten, write_indices};
use crate::geometry::{Asset, Elements, Source, Use, index, is_deformable, use_of};
use glam::Vec3;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Names of the properties that animations may move; others belong to extensions.
const PATHS: &[&str] = &["translation", "rotation", "scale", "weights"];
/// The extras of a node that moves, with all below it.
const MOVABLE: &str = "movable";

/// An accessor of a file and what it is used as; whether its vectors are made unit ones.
type Of = (usize, usize, Use, bool);

/// What moves, and where it went.
#[derive(Default)]
pub(super) struct Motion {
    /// New nodes, by placed file and node.
    pub nodes: BTreeMap<(usize, usize), usize>,
    /// New skins, by placed file and skin.
    known_skins: BTreeMap<(usize, usize), usize>,
    skins: Vec<Value>,
    animations: Vec<Value>,
    accessors: BTreeMap<Of, Value>,
    /// New nodes with morph targets.
    morphed: BTreeSet<usize>,
    /// Of new nodes with something that is baked or moves, which of the two.
    moves: BTreeMap<usize, bool>,
}

/// How a deformed mesh is written.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Deformed {
    /// With joints and weights.
    pub is_skinned: bool,
}

impl Writer<'_> {
    /// How a mesh that moves is written, if skins or morph targets deform it.
    pub(super) fn deformed(&self, source: &Source) -> Option<Deformed> {
        let file = self.geometry.originals.objects[source.object].file;
        let (number, primitive) = self.geometry.originals.files[file].meshes[source.mesh].primitive?;
        let asset = asset(self.geometry, file);
        let primitive = &asset.root["meshes"][number]["primitives"][primitive];
        let has_elements = !asset.motion.elements.is_empty();
        (has_elements && is_deformable(primitive))
            .then(|| Deformed { is_skinned: self.skin_of(source).is_some() })
    }

    /// The skin of a mesh's node, in its file, if all of its joints are there.
    fn skin_of(&self, source: &Source) -> Option<usize> {
        let asset = asset(self.geometry, self.geometry.originals.objects[source.object].file);
        let number = index(&asset.root["nodes"][source.node?]["skin"])?;
        let mut joints = asset.motion.skins.get(number)?["joints"].as_array()?.iter();
        let is_there = |joint: &Value| {
            index(joint).is_some_and(|joint| self.motion.nodes.contains_key(&(source.object, joint)))
        };
        joints.all(is_there).then_some(number)
    }

    /// Notes that a new node shows something, which moves or is baked.
    pub(super) fn note(&mut self, node: usize, moves: bool) {
        self.motion.moves.insert(node, moves);
    }

    /// Gives a node that shows a deformed mesh what deforms it.
    pub(super) fn deform(&mut self, node: usize, source: &Source, deformed: Deformed) {
        let geometry = self.geometry;
        let file = geometry.originals.objects[source.object].file;
        let asset = asset(geometry, file);
        let Some(original) = source.node.map(|node| &asset.root["nodes"][node]) else { return };
        let primitive = geometry.originals.files[file].meshes[source.mesh].primitive;
        let primitive = primitive.map(|(mesh, number)| &asset.root["meshes"][mesh]["primitives"][number]);
        if primitive.is_some_and(|primitive| primitive.get("targets").is_some()) {
            self.motion.morphed.insert(node);
            if let Some(weights) = original.get("weights") {
                self.nodes[node].insert("weights".into(), weights.clone());
            }
        }
        if let (true, Some(number)) = (deformed.is_skinned, self.skin_of(source)) {
            let skin = self.skin(source.object, file, number, asset);
            self.nodes[node].insert("skin".into(), json!(skin));
        }
    }

    /// The new index of a skin of a placed file.
    fn skin(&mut self, object: usize, file: usize, number: usize, asset: &Asset) -> usize {
        if let Some(&known) = self.motion.known_skins.get(&(object, number)) {
            return known;
        }
        let mut skin = asset.motion.skins[number].clone();
        let node =
            |node: &Value| index(node).and_then(|node| self.motion.nodes.get(&(object, node)).copied());
        let joints: Vec<usize> = skin["joints"].as_array().into_iter().flatten().filter_map(node).collect();
        let skeleton = node(&skin["skeleton"]);
        let matrices = index(&skin["inverseBindMatrices"]);
        let matrices = matrices.and_then(|at| self.accessor((file, at, Use::Data, false), None));
        let Some(json) = skin.as_object_mut() else { return 0 };
        json.remove("extensions");
        json.insert("joints".into(), json!(joints));
        for (key, value) in
            [("skeleton", skeleton.map(|node| json!(node))), ("inverseBindMatrices", matrices)]
        {
            match value {
                Some(value) => drop(json.insert(key.into(), value)),
                None => drop(json.remove(key)),
            }
        }
        self.motion.skins.push(skin);
        let new = self.motion.skins.len() - 1;
        self.motion.known_skins.insert((object, number), new);
        new
    }

    /// The elements of an accessor of a file as a new one.
    fn accessor(&mut self, of: Of, target: Option<u32>) -> Option<Value> {
        if let Some(known) = self.motion.accessors.get(&of) {
            return Some(known.clone());
        }
        let (file, number, used, is_unit) = of;
        let mut elements = asset(self.geometry, file).motion.elements.get(&(number, used))?.clone();
        if is_unit {
            make_units(&mut elements);
        }
        let new = write(&elements, used == Use::Vertices, target, &mut self.out);
        self.motion.accessors.insert(of, new.clone());
        Some(new)
    }

    /// A deformed primitive: all attributes and morph targets of its file.
    pub(super) fn deformed_primitive(
        &mut self,
        file: usize,
        (mesh, number): (usize, usize),
        deformed: Deformed,
        is_recoloured: bool,
    ) -> Map<String, Value> {
        let asset = asset(self.geometry, file);
        let original = &asset.root["meshes"][mesh]["primitives"][number];
        let mut primitive = Map::new();
        let mut attributes = Map::new();
        for (name, accessor) in original["attributes"].as_object().into_iter().flatten() {
            let Some(at) = index(accessor) else { continue };
            let of_skin = name.starts_with("JOINTS_") || name.starts_with("WEIGHTS_");
            if of_skin && !deformed.is_skinned {
                continue;
            }
            let new = if is_recoloured && name == "COLOR_0" {
                self.white(file, at)
            } else {
                let is_unit = name == "NORMAL" || name == "TANGENT";
                self.accessor((file, at, use_of(name), is_unit), Some(VERTICES))
            };
            new.into_iter().for_each(|new| drop(attributes.insert(name.clone(), new)));
        }
        let targets: Vec<Value> = original["targets"].as_array().into_iter().flatten().cloned().collect();
        let mut new_targets = Vec::new();
        for target in &targets {
            let mut new_target = Map::new();
            for (name, accessor) in target.as_object().into_iter().flatten() {
                let of = index(accessor).map(|at| (file, at, use_of(name), false));
                let new = of.and_then(|of| self.accessor(of, Some(VERTICES)));
                new.into_iter().for_each(|new| drop(new_target.insert(name.clone(), new)));
            }
            new_targets.push(Value::Object(new_target));
        }
        primitive.insert("attributes".into(), Value::Object(attributes));
        if !new_targets.is_empty() {
            primitive.insert("targets".into(), json!(new_targets));
        }
        if let Some(mode) = original.get("mode") {
            primitive.insert("mode".into(), mode.clone());
        }
        let position = index(&original["attributes"]["POSITION"]);
        let vertices = position.and_then(|at| asset.motion.elements.get(&(at, Use::Floats)));
        let indices =
            index(&original["indices"]).and_then(|at| asset.motion.elements.get(&(at, Use::Indices)));
        if let (Some(indices), Some(vertices)) = (indices, vertices) {
            let indices: Vec<u32> = bytemuck::pod_collect_to_vec(&indices.bytes);
            primitive.insert("indices".into(), write_indices(&indices, vertices.count, &mut self.out));
        }
        primitive
    }

    /// The colours of vertices without their colour, if that leaves any.
    fn white(&mut self, file: usize, number: usize) -> Option<Value> {
        let mut elements = asset(self.geometry, file).motion.elements.get(&(number, Use::Vertices))?.clone();
        if elements.kind != "VEC4" {
            return None;
        }
        let (stride, component) = (elements.bytes.len() / elements.count.max(1), elements.component);
        elements.bytes.chunks_exact_mut(stride.max(1)).for_each(|colour| whiten(colour, component));
        Some(write(&elements, true, Some(VERTICES), &mut self.out))
    }

    /// The animations of the files: their channels of nodes that move, in every place of the file.
    pub(super) fn animate(&mut self) {
        let geometry = self.geometry;
        for (file, of_file) in geometry.originals.files.iter().enumerate() {
            let Some(asset) = &of_file.gltf else { continue };
            for animation in &asset.motion.animations {
                self.animation(file, animation);
            }
        }
    }

    fn animation(&mut self, file: usize, animation: &Value) {
        let geometry = self.geometry;
        let places = geometry.originals.objects.iter().enumerate().filter(|(_, object)| object.file == file);
        let (mut channels, mut samplers, mut known) = (Vec::new(), Vec::new(), BTreeMap::new());
        for (number, object) in places {
            for channel in animation["channels"].as_array().into_iter().flatten() {
                let target = &channel["target"];
                let path = target["path"].as_str().unwrap_or("");
                let old = index(&target["node"]).filter(|node| object.moving.has(*node));
                let new = old.and_then(|old| self.motion.nodes.get(&(number, old)).copied());
                let Some(node) = new.filter(|_| PATHS.contains(&path)) else { continue };
                if path == "weights" && !self.motion.morphed.contains(&node) {
                    continue;
                }
                let Some(old) = index(&channel["sampler"]) else { continue };
                let sampler = match known.get(&old) {
                    Some(&known) => known,
                    None => {
                        let Some(sampler) = self.sampler(file, &animation["samplers"][old]) else { continue };
                        samplers.push(sampler);
                        known.insert(old, samplers.len() - 1);
                        samplers.len() - 1
                    }
                };
                let mut channel = channel.clone();
                channel["sampler"] = json!(sampler);
                channel["target"]["node"] = json!(node);
                channels.push(channel);
            }
        }
        if channels.is_empty() {
            return;
        }
        let mut animation = animation.clone();
        animation["channels"] = json!(channels);
        animation["samplers"] = json!(samplers);
        self.motion.animations.push(animation);
    }

    /// A sampler with its times and values.
    fn sampler(&mut self, file: usize, sampler: &Value) -> Option<Value> {
        let mut new = sampler.clone();
        for key in ["input", "output"] {
            new[key] = self.accessor((file, index(&sampler[key])?, Use::Data, false), None)?;
        }
        Some(new)
    }

    /// Says in the extras of nodes what moves: `movable` holds for all below a node that says nothing else.
    pub(super) fn mark(&mut self, roots: &[usize]) {
        for (number, object) in self.geometry.originals.objects.iter().enumerate() {
            for (&(_, old), &node) in self.motion.nodes.range((number, 0)..=(number, usize::MAX)) {
                let has_lamp = self.nodes[node].get("extensions").is_some();
                let moves = object.moving.nodes.contains(&old);
                if moves || has_lamp {
                    self.motion.moves.entry(node).or_insert(moves);
                }
            }
        }
        let mut stack: Vec<(usize, bool)> = roots.iter().map(|&root| (root, false)).collect();
        while let Some((node, of_parent)) = stack.pop() {
            let moves = self.motion.moves.get(&node).copied().unwrap_or(of_parent);
            let children = self.nodes[node].get("children").and_then(Value::as_array).into_iter().flatten();
            stack.extend(children.filter_map(index).map(|child| (child, moves)));
            if moves != of_parent {
                super::extras(&mut self.nodes[node])[MOVABLE] = json!(moves);
            }
        }
    }

    /// The lists of skins and animations.
    pub(super) fn take_lists(&mut self) -> [(&'static str, Vec<Value>); 2] {
        let take = std::mem::take;
        [("skins", take(&mut self.motion.skins)), ("animations", take(&mut self.motion.animations))]
    }
}

/// Takes out of a node what its file said of whether it moves.
pub(super) fn remove_extras(extras: &mut Map<String, Value>) {
    if extras.get(MOVABLE).is_some_and(|said| said.is_boolean() || said.is_number()) {
        extras.remove(MOVABLE);
    }
}

/// Elements as a new accessor, with the range of what must have one.
fn write(elements: &Elements, is_padded: bool, target: Option<u32>, out: &mut Glb) -> Value {
    let Elements { component, kind, normalized, count, .. } = *elements;
    let view = out.view(&elements.bytes, target);
    let mut accessor =
        json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
    if normalized {
        accessor["normalized"] = json!(true);
    }
    if is_padded && component != FLOAT && component != UNSIGNED_INT {
        out.views[view]["byteStride"] = json!(elements.bytes.len() / count.max(1));
    }
    let components = match kind {
        "SCALAR" => 1,
        "VEC3" => 3,
        _ => 0,
    };
    if component == FLOAT && components > 0 && count > 0 {
        let floats: Vec<f32> = bytemuck::pod_collect_to_vec(&elements.bytes);
        let of = |axis: usize| floats.iter().skip(axis).step_by(components).copied();
        let list = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..components).map(|axis| of(axis).reduce(pick).unwrap_or_default()).collect()
        };
        accessor["min"] = json!(list(f32::min));
        accessor["max"] = json!(list(f32::max));
    }
    out.push(accessor)
}

/// Makes normals unit vectors, and the first three components of tangents.
fn make_units(elements: &mut Elements) {
    let components = if elements.kind == "VEC4" { 4 } else { 3 };
    let mut floats: Vec<f32> = bytemuck::pod_collect_to_vec(&elements.bytes);
    for element in floats.chunks_exact_mut(components) {
        let vector = unit(Vec3::new(element[0], element[1], element[2]), Vec3::Y);
        element[..3].copy_from_slice(&vector.to_array());
    }
    elements.bytes = bytemuck::cast_slice(&floats).to_vec();
}
