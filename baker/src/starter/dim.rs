//! Emission of a model that is hardly meant as a lamp: leaves that are lit up for looks, and what gives next
//! to no light.

use super::glowing::is_glowing;
use crate::geometry::{Geometry, fits};
use crate::light::luminance;
use std::collections::{BTreeMap, BTreeSet};
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
pub(super) const LEAST_LUMENS: f64 = 5.0;
/// So is what is nowhere brighter than this, in kcd/m²: white paper under a ceiling lamp of a home.
pub(super) const LEAST_RADIANCE: f64 = 0.02;

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
pub(super) fn switched_off(geometry: &Geometry, models: usize, metres: f64) -> Vec<Vec<SwitchedOff>> {
    let mut emitters: BTreeMap<(usize, &str), Emitter> = BTreeMap::new();
    // Per model, the names by which a part applies to an emitter, each with the emitter's material.
    let mut parts = vec![BTreeSet::new(); models];
    for (instance, source) in geometry.instances.iter().zip(geometry.originals.baked()) {
        let Some(first) = instance.triangles.clone().next() else { continue };
        let material = &geometry.materials[geometry.material_of[first] as usize];
        let Some(emission) = material.emission else { continue };
        let file = &geometry.originals.files[geometry.originals.objects[source.object].file];
        let name = file.materials[file.meshes[source.mesh].material].as_str();
        parts[source.object].extend(file.names_of(source).iter().map(|part| (part, name)));
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
        if name.is_empty() || emitter.is_named_like_a_lamp {
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
        // A part by that name may take others along, for nodes and meshes have names, too.
        if parts[model].iter().all(|&(part, of)| of == name || !fits(name, part)) {
            off[model].push(SwitchedOff { name: name.to_owned(), why });
        }
    }
    off
}
