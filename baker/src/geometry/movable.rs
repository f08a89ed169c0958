//! What of an object moves, and so is no part of the bake: by the scene file, or by the `extras` of nodes.

use super::contents::FileLamp;
use super::model::{Model, NodeMesh};
use super::motion::{index, is_deformable};
use super::names::Names;
use super::notes::{list, plural};
use crate::scene::Object;
use serde_json::Value;
use std::collections::BTreeSet;

/// Most names that are kept for messages.
const MOST_NAMED: usize = 6;

/// The nodes of a placed glTF that move, by their indices there.
#[derive(Clone, Debug, Default)]
pub(crate) struct Moving {
    /// Nothing at them or below is baked, and something at them, above or below is said to move.
    pub nodes: BTreeSet<usize>,
    /// The joints of the skins of what moves.
    pub joints: BTreeSet<usize>,
}

impl Moving {
    /// Whether animations may move a node.
    pub(crate) fn has(&self, node: usize) -> bool {
        self.nodes.contains(&node) || self.joints.contains(&node)
    }
}

/// What a bake leaves out because it moves.
#[derive(Clone, Debug, Default)]
pub(crate) struct LeftOut {
    /// Placed objects: nodes with meshes, or meshes of an OBJ.
    objects: usize,
    lamps: usize,
    triangles: usize,
    names: Vec<String>,
}

impl LeftOut {
    /// Counts a mesh, which may be a further one of an object.
    pub(crate) fn add(&mut self, name: &str, is_further: bool, triangles: usize) {
        self.objects += usize::from(!is_further);
        self.triangles += triangles;
        self.name(name);
    }

    /// Counts the copies of a lamp.
    pub(crate) fn add_lamps(&mut self, name: &str, copies: usize) {
        self.lamps += copies;
        self.name(name);
    }

    fn name(&mut self, name: &str) {
        if self.names.len() < MOST_NAMED && !self.names.iter().any(|other| other == name) {
            self.names.push(name.to_owned());
        }
    }

    /// What is left out, in words, if anything is.
    pub(crate) fn fact(&self) -> Option<String> {
        let of = |n: usize, noun: &str| (n > 0).then(|| plural(n, noun));
        let what: Vec<String> =
            [of(self.objects, "mesh"), of(self.lamps, "lamp")].into_iter().flatten().collect();
        let all = if self.names.len() < MOST_NAMED { self.names.len() } else { usize::MAX };
        (!what.is_empty()).then(|| {
            let triangles = of(self.triangles, "triangle").map_or(String::new(), |n| format!(", {n}"));
            let (what, names) = (what.join(" and "), list(&self.names, all));
            format!("left out because they move: {what} ({names}){triangles}")
        })
    }
}

/// Whether something with these names moves: what the last part that fits says, else the object, else the
/// file. Sets `matched` of parts that say anything.
pub(super) fn is_movable(
    object: &Object,
    names: &Names,
    of_file: Option<bool>,
    matched: &mut [bool],
) -> bool {
    let mut movable = object.overrides.movable.or(of_file);
    for (part, matched) in object.parts.iter().zip(matched) {
        if let Some(said) = part.overrides.movable
            && names.fit(&part.pattern)
        {
            (movable, *matched) = (Some(said), true);
        }
    }
    movable.unwrap_or(false)
}

/// Which lamps of an object's file move.
pub(super) fn lamps_that_move(object: &Object, model: Option<&Model>, matched: &mut [bool]) -> Vec<bool> {
    let Some(model) = model else { return Vec::new() };
    let mut moves = |lamp: &FileLamp| {
        is_movable(object, &model.names_of_lamp(lamp), model.tree.movable(Some(lamp.node)), matched)
    };
    model.contents.lamps.iter().map(&mut moves).collect()
}

/// The nodes of a placed file that move. `placements` are its meshes, and whether each moves; `lamps` is
/// whether each of its lamps does, where they light the scene. Gives also the names of what is baked though
/// a joint that moves may carry it.
pub(super) fn moving(
    object: &Object,
    model: &Model,
    placements: &[(&NodeMesh, bool)],
    lamps: &[bool],
    matched: &mut [bool],
) -> (Moving, Vec<String>) {
    let nodes = &model.tree.nodes;
    let (mut baked, mut moves) = (vec![false; nodes.len()], vec![false; nodes.len()]);
    for (node, moves) in moves.iter_mut().enumerate() {
        *moves = is_movable(object, &model.tree.names_of_node(node), model.tree.movable(Some(node)), matched);
    }
    let meshes = placements.iter().filter_map(|(placement, movable)| Some((placement.node?, *movable)));
    let lamps = model.contents.lamps.iter().zip(lamps).map(|(lamp, movable)| (lamp.node, *movable));
    for (node, movable) in meshes.chain(lamps) {
        moves[node] |= movable;
        baked[node] |= !movable;
    }
    for node in (0..nodes.len()).rev() {
        if let Some(parent) = nodes[node].parent {
            baked[parent] |= baked[node];
            moves[parent] |= moves[node];
        }
    }
    let mut kept = vec![false; nodes.len()];
    for (node, of) in nodes.iter().enumerate() {
        kept[node] = of.parent.is_some_and(|parent| kept[parent]) || moves[node] && !baked[node];
    }
    let mut moving = Moving::default();
    moving.nodes.extend(nodes.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(node, _)| node.index));
    let Some(asset) = &model.asset else { return (moving, Vec::new()) };
    for (placement, _) in placements.iter().filter(|(_, movable)| *movable) {
        let (Some(node), Some((mesh, primitive))) = (placement.node, model.meshes[placement.mesh].primitive)
        else {
            continue;
        };
        if is_deformable(&asset.root["meshes"][mesh]["primitives"][primitive]) {
            let skin = index(&asset.root["nodes"][nodes[node].index]["skin"]);
            let skin = skin.and_then(|skin| asset.motion.skins.get(skin)).unwrap_or(&Value::Null);
            let joints = skin["joints"].as_array().into_iter().flatten();
            moving.joints.extend(joints.chain([&skin["skeleton"]]).filter_map(index));
        }
    }
    let is_carried = |placement: &NodeMesh| {
        model.tree.path(placement.node).any(|node| moving.joints.contains(&node.index))
    };
    let carried = placements.iter().filter(|(placement, movable)| !movable && is_carried(placement));
    let carried = carried.map(|(placement, _)| model.shown_name(placement)).collect();
    (moving, carried)
}
