//! Emission of a model that is hardly meant as a lamp: leaves that are lit up for looks, and what gives next
//! to no light.

use super::glowing::is_glowing;
use crate::geometry::{Geometry, fits};
use crate::light::luminance;
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// A material that is switched off.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchedOff {
    /// The material's name.
    pub name: String,
    /// Why, as part of a sentence.
    pub why: String,
}

/// Less light than this is off, in lumens from all of a material: a candle gives 12.
pub const LEAST_LUMENS: f64 = 5.0;
/// So is what is nowhere brighter than this, in kcd/m²: white paper under a ceiling lamp of a home.
pub const LEAST_RADIANCE: f64 = 0.02;

/// A material of a model, and what it emits.
#[derive(Default)]
struct Emitter {
    is_cut_out: bool,
    is_named_like_a_lamp: bool,
    /// kcd/m², factor alone.
    brightest: f64,
    /// kcd/m² · square units.
    radiance_by_area: f64,
}

/// Per model, the materials that are better switched off, by name. A model is an object of the scene that
/// `geometry` was loaded from, in its own unit of so many metres.
pub fn switched_off(geometry: &Geometry, models: usize, metres: f64) -> Vec<Vec<SwitchedOff>> {
    let mut emitters: BTreeMap<(usize, &str), Emitter> = BTreeMap::new();
    for (instance, source) in geometry.instances.iter().zip(geometry.originals.baked()) {
        let Some(first) = instance.triangles.clone().next() else { continue };
        let material = &geometry.materials[geometry.material_of[first] as usize];
        let Some(emission) = material.emission else { continue };
        let file = &geometry.originals.files[geometry.originals.objects[source.object].file];
        let name = file.materials[file.meshes[source.mesh].material].as_str();
        let emitter = emitters.entry((source.object, name)).or_default();
        emitter.is_cut_out |= material.alpha_cutoff.is_some();
        let names = instance.name.split_once(": ").map_or("", |(_, names)| names);
        emitter.is_named_like_a_lamp |= names.split('/').any(is_glowing);
        emitter.brightest = emitter.brightest.max(luminance(emission.radiance).into());
        if !emitter.is_cut_out {
            let sides = if material.two_sided { 2.0 } else { 1.0 };
            let of = |triangle: usize| {
                let radiance = emission.radiance * geometry.emission_map_mean(triangle);
                geometry.area_f64(triangle) * f64::from(luminance(radiance))
            };
            emitter.radiance_by_area += sides * instance.triangles.clone().map(of).sum::<f64>();
        }
    }
    let mut off = vec![Vec::new(); models];
    for ((model, name), emitter) in emitters {
        // (Without a name there is no key that switches it off.)
        if name.is_empty() || emitter.is_named_like_a_lamp || takes_others(geometry, model, name) {
            continue;
        }
        let lumens = 1000.0 * PI * emitter.radiance_by_area * metres * metres;
        let why = match () {
            () if emitter.is_cut_out => "cut out by its alpha, as leaves are".to_owned(),
            () if emitter.brightest < LEAST_RADIANCE => {
                format!("nowhere brighter than {LEAST_RADIANCE} kcd/m²")
            }
            () if lumens < LEAST_LUMENS => format!("less than {LEAST_LUMENS} lm in all"),
            () => continue,
        };
        off[model].push(SwitchedOff { name: name.to_owned(), why });
    }
    off
}

/// Whether a part by the name of a material of a model would switch off other materials, too, for that is
/// also the name of a mesh of theirs, or of a node above.
fn takes_others(geometry: &Geometry, model: usize, name: &str) -> bool {
    let originals = &geometry.originals;
    let file = &originals.files[originals.objects[model].file];
    let nodes =
        file.gltf.as_ref().and_then(|asset| asset.root["nodes"].as_array()).map_or(&[][..], Vec::as_slice);
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for child in node["children"].as_array().into_iter().flatten().filter_map(Value::as_u64) {
            parents.get_mut(child as usize).into_iter().for_each(|of_child| *of_child = Some(parent));
        }
    }
    let of_model =
        geometry.instances.iter().zip(originals.baked()).filter(|(_, source)| source.object == model);
    of_model.into_iter().any(|(instance, source)| {
        let mesh = &file.meshes[source.mesh];
        let first = instance.triangles.start;
        let emits = geometry.materials[geometry.material_of[first] as usize].emission.is_some();
        let above = std::iter::successors(source.node, |&node| parents.get(node).copied().flatten());
        let named = |node: usize| nodes.get(node).and_then(|node| node["name"].as_str());
        let names = above.filter_map(named).chain([mesh.name.as_str(), &file.materials[mesh.material]]);
        emits && file.materials[mesh.material] != name && names.into_iter().any(|other| fits(name, other))
    })
}
