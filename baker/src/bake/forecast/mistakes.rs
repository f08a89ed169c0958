//! What is likely a mistake in a scene that can be baked all the same: a wrong unit of length, and lamps
//! whose light is shut in.

use super::needs::{density, extent};
use crate::Result;
use crate::bake::prepare::Prepared;
use crate::geometry::Geometry;
use crate::scene::{Baked, Lamp, Object, Scene};
use crate::trace::rays::{Hit, NO_TRIANGLE};
use crate::trace::solids::Space;
use glam::{DVec3, Vec3};
use std::f32::consts::PI;

/// Scenes are longer than this, and shorter than that, in metres.
const USUAL_LENGTHS: [f64; 2] = [0.1, 1e5];
/// Lightmaps have fewer texels per metre.
const MOST_TEXELS_PER_METRE: f64 = 1000.0;
/// A lamp is inside a solid if it is farther than this from its surface, in metres and as a share of the
/// scene's length, whichever is less.
const INSIDE: [f64; 2] = [0.01, 1e-3];
/// A two-sided body that is closed around a lamp within this distance in metres is a bulb, not a room.
const BULB: f32 = 0.3;
/// Only spheres of at least this radius in metres are too large; smaller ones may surround a model of a bulb.
const LARGE_SPHERE: f64 = 0.5;
/// Pairs of opposite directions in which a lamp looks around.
const PAIRS: usize = 32;
/// Lamps that a warning names.
const MOST_NAMED: usize = 5;

/// Warnings about a scene that is laid out with this many texels per metre.
///
/// # Errors
/// As [`Prepared::ray_tracer`].
pub fn warnings(prepared: &Prepared, texels_per_metre: f64) -> Result<Vec<String>> {
    let mut warnings = Vec::new();
    warnings.extend(wrong_unit(&prepared.scene, &prepared.geometry, texels_per_metre));
    if prepared.scene.groups.iter().any(|group| !group.lamps.is_empty()) {
        let ray_tracer = prepared.ray_tracer()?;
        warnings.extend(shut_in(&prepared.scene, &prepared.space(&ray_tracer)));
    }
    Ok(warnings)
}

/// Whether a scene may be this long, in metres.
pub fn is_usual_length(length: f64) -> bool {
    (USUAL_LENGTHS[0]..=USUAL_LENGTHS[1]).contains(&length)
}

/// Whether the scene's size makes sense in metres.
fn wrong_unit(scene: &Scene, geometry: &Geometry, texels_per_metre: f64) -> Option<String> {
    let length = extent(&geometry.positions).into_iter().fold(0.0, f64::max);
    let [shortest, longest] = USUAL_LENGTHS;
    let (size, remedy) = match () {
        () if length > longest => (format!("{:.0} km long", length / 1e3), "smaller"),
        () if length < shortest => (format!("{} mm long", density(length * 1e3)), "larger"),
        () if texels_per_metre > MOST_TEXELS_PER_METRE => {
            (format!("{} m long", density(length)), "larger, or the `size` of [lightmap] smaller")
        }
        () => return None,
    };
    let is_scaled = |object: &&Object| {
        let volume = |of: &glam::DMat4| of.determinant().abs();
        object.world_from_file.iter().any(|of| (volume(of) - 1.0).abs() > 1e-6)
    };
    let place = match scene.objects.iter().find(is_scaled) {
        Some(object) => format!("the object at {} sets a `scale`", object.source_line),
        None => "no object sets a `scale`; `bake new MODEL` guesses it".to_owned(),
    };
    let texels = match texels_per_metre {
        100.0.. => format!("{texels_per_metre:.0}"),
        few => density(few),
    };
    Some(format!(
        "the scene is {size}, with {texels} texels per metre, and lengths are in metres: should the `scale` of an [[object]] be {remedy}? \
         ({place})"
    ))
}

/// The lamps whose light cannot get out, or that are larger than what they stand in.
fn shut_in(scene: &Scene, space: &Space) -> Vec<String> {
    let geometry = space.geometry;
    let length = extent(&geometry.positions).into_iter().fold(0.0, f64::max);
    let tolerance = INSIDE[0].min(INSIDE[1] * length) as f32;
    let (mut inside, mut large) = (Vec::new(), Vec::new());
    for group in scene.groups.iter().filter(|group| group.baked != Baked::None) {
        for lamp in &group.lamps {
            let (kind, centre) = kind_and_centre(lamp);
            let name = || {
                let [x, y, z] = (centre * 1e3).round().to_array().map(|x| x / 1e3 + 0.0);
                format!("the {kind} of \"{}\" at [{x}, {y}, {z}]", group.name)
            };
            let around = Around::of(space, (centre - geometry.origin).as_vec3());
            if let Some(triangle) = around.closed_body(space, tolerance) {
                inside.push(format!("{} in \"{}\"", name(), name_of(geometry, triangle)));
            } else if let Lamp::Sphere { radius, .. } = *lamp {
                let what = around.too_small_for(geometry, radius);
                large.extend(what.map(|what| format!("{} (radius {radius} m, {what})", name())));
            }
        }
    }
    let mut warnings = Vec::new();
    if !inside.is_empty() {
        let those = match inside.len() {
            1 => "a lamp stands inside a closed body",
            _ => "lamps stand inside closed bodies",
        };
        warnings.push(format!(
            "{those}, so no light gets out: {}. Move the lamp, open the body, or let it pass light (`transmission`)",
            listed(&inside)
        ));
    }
    if !large.is_empty() {
        let those = match large.len() {
            1 => "a sphere is too large for its surroundings",
            _ => "spheres are too large for their surroundings",
        };
        warnings.push(format!(
            "{those}: {}. Nothing inside a sphere gets its light. Is the radius in metres? A bulb has about 0.03",
            listed(&large)
        ));
    }
    warnings
}

/// The first few.
fn listed(all: &[String]) -> String {
    let more = all.len().saturating_sub(MOST_NAMED);
    let named = all[..all.len() - more].join(", ");
    if more > 0 { format!("{named} and {more} more") } else { named }
}

/// A lamp in a word, and its middle in the world.
fn kind_and_centre(lamp: &Lamp) -> (&'static str, DVec3) {
    match *lamp {
        Lamp::Sphere { centre, .. } => ("sphere", centre),
        Lamp::Disc { centre, .. } => ("disc", centre),
        Lamp::Point { position, .. } => ("point", position),
        Lamp::Rectangle { corner, edge_u, edge_v, .. } => ("rectangle", corner + 0.5 * (edge_u + edge_v)),
        Lamp::Spot { position, .. } => ("spot", position),
        Lamp::Ies { position, .. } => ("lamp", position),
    }
}

/// The name of the instance of a triangle.
fn name_of(geometry: &Geometry, triangle: u32) -> &str {
    &geometry.instances[instance_of(geometry, triangle)].name
}

/// The instance of a triangle.
fn instance_of(geometry: &Geometry, triangle: u32) -> usize {
    geometry.instances.partition_point(|instance| instance.triangles.end <= triangle as usize)
}

/// What is met first in many directions from a place.
struct Around {
    centre: Vec3,
    /// Direction and hit; every second direction is the opposite of the one before.
    hits: Vec<(Vec3, Option<Hit>)>,
}

impl Around {
    fn of(space: &Space, centre: Vec3) -> Self {
        let look =
            |direction: Vec3| (direction, space.ray_tracer.nearest_wall(centre, direction, NO_TRIANGLE));
        Around { centre, hits: directions().map(look).collect() }
    }

    /// A triangle of the closed body around the place, farther from it than the tolerance: of a solid, whose
    /// back is met first in most directions, or of a small two-sided body that is all that is met.
    fn closed_body(&self, space: &Space, tolerance: f32) -> Option<u32> {
        let hits = self.hits.iter().filter_map(|(direction, hit)| Some((direction, hit.as_ref()?)));
        let backs: Vec<&Hit> = hits
            .clone()
            .filter(|(direction, hit)| space.is_back_of_solid(hit, **direction))
            .map(|(_, hit)| hit)
            .collect();
        if backs.len() > PAIRS && backs.iter().all(|hit| hit.t > tolerance) {
            return Some(backs[0].triangle);
        }
        let instance = |hit: &Hit| instance_of(space.geometry, hit.triangle);
        let first = self.hits[0].1?;
        let is_shell = |hit: &Hit| {
            let material = space.material(hit.triangle);
            let is_solid = material.two_sided && material.alpha_cutoff.is_none();
            is_solid && (tolerance..BULB).contains(&hit.t) && instance(hit) == instance(&first)
        };
        (hits.filter(|(_, hit)| is_shell(hit)).count() == 2 * PAIRS).then_some(first.triangle)
    }

    /// What is too small for a sphere of this radius: what it stands between, or what it contains.
    fn too_small_for(&self, geometry: &Geometry, radius: f64) -> Option<String> {
        /// One pair of directions in so many ends in the sphere on both sides: it reaches through the walls.
        const PART: usize = 8;
        if radius < LARGE_SPHERE {
            return None;
        }
        let ends_inside = |(_, hit): &(Vec3, Option<Hit>)| hit.is_some_and(|hit| f64::from(hit.t) < radius);
        let pairs = self.hits.chunks_exact(2).filter(|pair| pair.iter().all(ends_inside)).count();
        let nearest = self.hits.iter().filter_map(|(_, hit)| *hit).min_by(|a, b| a.t.total_cmp(&b.t));
        if let Some(hit) = nearest.filter(|_| pairs * PART >= PAIRS) {
            let name = name_of(geometry, hit.triangle);
            return Some(format!("reaching through \"{name}\", {} m from its centre", density(hit.t.into())));
        }
        let is_inside = |v: &Vec3| f64::from(v.distance(self.centre)) < radius;
        let contained = geometry
            .instances
            .iter()
            .find(|instance| geometry.positions[instance.vertices.clone()].iter().all(is_inside));
        contained.map(|instance| format!("containing \"{}\"", instance.name))
    }
}

/// Directions spread evenly over half the sphere (a Fibonacci lattice), each with its opposite.
fn directions() -> impl Iterator<Item = Vec3> {
    let golden = PI * (3.0 - 5.0f32.sqrt());
    (0..PAIRS).flat_map(move |i| {
        let y = 1.0 - (i as f32 + 0.5) / PAIRS as f32;
        let (sin, cos) = (i as f32 * golden).sin_cos();
        let across = (1.0 - y * y).sqrt();
        let direction = Vec3::new(across * cos, y, across * sin);
        [direction, -direction]
    })
}
