//! What stands where: the meshes of the objects at their places, under what the scene file overrides.

use super::LightmapPlace;
use super::lights::Groups;
use super::model::{DEFAULT_ALBEDO, MOST_COPIES, Mesh, Model, NodeMesh};
use super::movable::LeftOut;
use super::notes;
use super::originals::{self, Changed, Source};
use super::overrides::{MaterialStore, resolve};
use super::texture::TextureStore;
use crate::scene::Object;
use dataset::Error;
use glam::DMat4;
use std::collections::{BTreeMap, BTreeSet};

/// A mesh at a place in the world.
pub(super) struct Placed<'a> {
    pub mesh: &'a Mesh,
    pub source: Source,
    pub world_from_mesh: DMat4,
    /// Whether it moves, and so is not baked.
    pub movable: bool,
    /// Among those of what is baked, or of what moves.
    pub material: u32,
    /// Whether the scene file gives its colour in place of the file's.
    pub recoloured: bool,
    pub name: String,
    pub lightmap: bool,
    pub lightmap_place: LightmapPlace,
    pub density: f64,
}

/// What surfaces are made of, as it is gathered.
#[derive(Default)]
pub(super) struct Store {
    pub materials: MaterialStore,
    /// Those of what moves.
    pub movable: MaterialStore,
    pub textures: TextureStore,
    /// Warnings about surfaces without a material.
    pub undefined: Vec<String>,
    /// File and name of the materials that reflect more than the limit.
    pub limited: Vec<String>,
}

impl Store {
    /// The warning about materials that were limited, if there are any.
    pub(super) fn warning(&self, albedo_max: f64) -> Option<String> {
        let n = self.limited.len();
        (n > 0).then(|| {
            let (those, names) = (notes::plural(n, "material"), notes::list(&self.limited, n));
            format!(
                "{those} of files ({names}): albedo above {albedo_max} is limited to that, since light would hardly fade \
                 between bounces; `albedo_max = 1` in [bake] keeps it, and so does an `albedo` of the object or part"
            )
        })
    }
}

/// Lists the placed meshes of an object, instance by instance; `first_object` is the first of its places
/// among those of the scene. Gives the meshes of its file, and whether each moves.
#[expect(clippy::too_many_arguments, reason = "one call")]
pub(super) fn place<'a>(
    object: &Object,
    model: &'a Model,
    first_object: usize,
    matched: &mut [bool],
    groups: &mut Groups,
    albedo_max: f64,
    store: &mut Store,
    placed: &mut Vec<Placed<'a>>,
) -> Vec<(&'a NodeMesh, bool)> {
    let file = object.file.file_name().unwrap_or_default().to_string_lossy();
    // What holds for each mesh does not depend on the instance.
    let (mut limited, mut undefined) = (BTreeSet::new(), Vec::new());
    let mut list = Vec::new();
    for placement in &model.placements {
        let mesh = &model.meshes[placement.mesh];
        if mesh.triangles.is_empty() {
            continue;
        }
        let names = model.names_of_mesh(placement);
        let overrides = resolve(object, &names, matched);
        if placement.is_hidden {
            continue;
        }
        let movable = overrides.movable.or(model.tree.movable(placement.node)).unwrap_or(false);
        let material = &model.materials[mesh.material];
        let (emission, materials, albedo_max) = match movable {
            true => (groups.emission_left_out(&overrides, material, &names), &mut store.movable, 1.0),
            false => {
                let place = (object.file.as_path(), mesh.material);
                let emission = groups.emission(&overrides, material, &names, place);
                (emission, &mut store.materials, albedo_max as f32)
            }
        };
        let (index, is_limited) =
            materials.add(material, mesh.brightest, &overrides, emission, albedo_max, &mut store.textures);
        if is_limited {
            limited.insert(mesh.material);
        }
        if !movable && overrides.albedo.is_none() && material.undefined {
            undefined.push(material.name.as_str());
        }
        list.push((placement, index, movable, format!("{file}: {}", model.shown_name(placement)), overrides));
    }
    if !undefined.is_empty() {
        let meshes = notes::plural(undefined.len(), "mesh");
        undefined.retain(|name| !name.is_empty());
        undefined.sort_unstable();
        undefined.dedup();
        let names = notes::list(&undefined, undefined.len());
        let named = if names.is_empty() { names } else { format!(" ({names})") };
        let file = object.file.display();
        let line = format!("{file}: albedo {DEFAULT_ALBEDO} for want of a defined material{named}: {meshes}");
        if !store.undefined.contains(&line) {
            store.undefined.push(line);
        }
    }
    for index in limited {
        let name = match model.materials[index].name.as_str() {
            "" => "unnamed",
            name => name,
        };
        let name = format!("{file}: {name}");
        if !store.limited.contains(&name) {
            store.limited.push(name);
        }
    }
    // Glass that reflects nothing shows no light of its own.
    let clear: BTreeSet<u32> = list
        .iter()
        .filter(|(_, _, movable, ..)| !movable)
        .map(|(_, material, ..)| *material)
        .filter(|m| store.materials.reflects_nothing(*m))
        .collect();
    for (i, &world_from_file) in object.world_from_file.iter().enumerate() {
        let number = if object.world_from_file.len() > 1 { format!(" #{i}") } else { String::new() };
        placed.extend(list.iter().map(|(placement, material, movable, name, overrides)| Placed {
            mesh: &model.meshes[placement.mesh],
            source: Source {
                object: first_object + i,
                mesh: placement.mesh,
                node: placement.node.map(|node| model.tree.nodes[node].index),
                in_tree: placement.node,
                is_skinned: placement.is_skinned,
                repeat: placement.repeat,
                changed: Changed::by(overrides),
                placed: originals::Placed::Movable(*material),
            },
            world_from_mesh: world_from_file * placement.file_from_mesh,
            movable: *movable,
            material: *material,
            recoloured: overrides.albedo.is_some(),
            name: format!("{name}{number}"),
            lightmap: overrides.lightmap.unwrap_or(!clear.contains(material)),
            lightmap_place: placement.lightmap_place,
            density: overrides.density.unwrap_or(1.0),
        }));
    }
    list.into_iter().map(|(placement, _, movable, ..)| (placement, movable)).collect()
}

/// Removes baked meshes beyond the first [`MOST_COPIES`] that lie exactly where an equal one does, and gives
/// the warning about them.
pub(super) fn remove_copies(placed: &mut Vec<Placed>) -> Option<String> {
    let mut counts: BTreeMap<_, usize> = BTreeMap::new();
    let mut digests: BTreeMap<*const Mesh, blake3::Hash> = BTreeMap::new();
    let mut removed = Vec::new();
    placed.retain(|p| {
        if p.movable {
            return true;
        }
        let mesh = *digests.entry(p.mesh).or_insert_with(|| p.mesh.digest());
        let place = match p.lightmap_place {
            LightmapPlace::Unsaid => [0; 6],
            LightmapPlace::Nowhere => [1; 6],
            LightmapPlace::At { page, scale: [a, b], offset: [c, d] } => {
                [2, page, a.to_bits(), b.to_bits(), c.to_bits(), d.to_bits()]
            }
        };
        let numbers = p.world_from_mesh.to_cols_array().map(f64::to_bits);
        let look = (p.material, p.recoloured, p.lightmap, p.density.to_bits());
        let count = counts.entry((*mesh.as_bytes(), numbers, look, place)).or_default();
        *count += 1;
        let stays = *count <= MOST_COPIES;
        if !stays {
            removed.push(p.name.clone());
        }
        stays
    });
    let n = removed.len();
    (n > 0).then(|| {
        let (those, names) = (notes::plural(n, "placed mesh"), notes::list(&removed, n));
        format!("{those} ({names}): each lies exactly where equal ones do and is left out")
    })
}

/// Counts what moves among the placed meshes of an object: those of one node once.
pub(super) fn count(placed: &[Placed], left_out: &mut LeftOut) {
    let mut before = None;
    for p in placed.iter().filter(|p| p.movable) {
        let Source { object, node, mesh, .. } = p.source;
        let of = (object, node.map_or(mesh, |node| node), node.is_some());
        left_out.add(&p.name, before == Some(of), p.mesh.triangles.len());
        before = Some(of);
    }
}

/// Where what is placed comes from.
pub(super) fn sources(placed: &[Placed]) -> Vec<Source> {
    let mut baked = 0..;
    let of = |p: &Placed| Source {
        placed: match p.movable {
            true => originals::Placed::Movable(p.material),
            false => originals::Placed::Baked(baked.next().unwrap_or_default()),
        },
        ..p.source
    };
    placed.iter().map(of).collect()
}

/// An error about a scene of which nothing is left to bake.
pub(super) fn everything_moves(placed: &[Placed]) -> Error {
    let names: Vec<&str> = placed.iter().map(|p| p.name.as_str()).collect();
    let what = format!(
        "nothing is left to bake: every mesh moves ({}: {}), by `movable = true` or by \"movable\": true in the extras of a node. To bake \
         a mesh where it stands, set `movable = false` in its [[object]] or [[object.part]]",
        notes::plural(placed.len(), "mesh"),
        notes::list(&names, names.len())
    );
    Error::invalid("the scene's geometry", what)
}
