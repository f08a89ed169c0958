//! The integrator against closed forms, with every backend that is built. Every expectation is judged by its
//! own error: the mean over independent scrambles must lie within 3 standard errors of the closed form and
//! within 1 % of it.

use baker::Rgb;
use baker::geometry::{Emission, Geometry, Material, Texture, Wrap};
use baker::light::daylight::{SkySampler, SkyTable, SunDisc};
use baker::light::lamps::group::{GroupSampler, emitters};
use baker::scene::{Lamp, Portal, Scene, Sky, SkyImage};
use baker::surface::SurfacePoint;
use baker::trace::counts::RayCounts;
use baker::trace::paths::path::{Transport, sun_sample};
use baker::trace::paths::{Sequence, SequenceKind};
use baker::trace::rays::{Backend, RayTracer};
use baker::trace::solids::Space;
use baker::trace::sources::{GroupLight, Lights, SunLight};
use dataset::image::Image;
use glam::{DVec3, Vec2, Vec3, dvec3, vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Independent scrambles behind every σ.
const SCRAMBLES: u32 = 32;

fn material(albedo: f32) -> Material {
    Material {
        albedo: Vec3::splat(albedo),
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: false,
        emission: None,
    }
}

/// Adds a parallelogram whose front is on the side of `u × v`.
fn quad(g: &mut Geometry, corner: Vec3, u: Vec3, v: Vec3, material: u32) {
    let first = g.positions.len() as u32;
    let normal = u.cross(v).normalize();
    for p in [corner, corner + u, corner + u + v, corner + v] {
        g.positions.push(p);
        g.normals.push(normal);
        g.uvs.push(glam::Vec2::ZERO);
        g.lightmap_uvs.push(glam::Vec2::ZERO);
    }
    g.triangles.push([first, first + 1, first + 2]);
    g.triangles.push([first, first + 2, first + 3]);
    g.material_of.extend([material, material]);
}

/// A cube of side 2 around the origin, seen from inside.
fn room(material_index: u32, material: Material) -> Geometry {
    let mut g = Geometry { materials: vec![material], ..Geometry::default() };
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let n = Vec3::AXES[axis] * -sign;
            let (u, v) = n.any_orthonormal_pair();
            let (u, v) = if u.cross(v).dot(n) > 0.0 { (u, v) } else { (v, u) };
            quad(&mut g, -n - u - v, u * 2.0, v * 2.0, material_index);
        }
    }
    g
}

/// The first triangle's inner point.
const POINT: SurfacePoint = SurfacePoint { triangle: 0, barycentric: Vec3::new(0.3, 0.45, 0.25) };

fn constant_sky(radiance: f64) -> SkyTable {
    SkyTable::new(Some(&Sky::Constant { radiance: DVec3::splat(radiance) }), None, &[12.0])
}

/// Group 0 with these lamps and the geometry's emissive triangles of that group.
fn group(g: &Geometry, lamps: &[Lamp]) -> Lights {
    let emission = g.materials.iter().map(|m| m.emission.map_or(Vec3::ZERO, |e| e.radiance)).collect();
    let sampler = GroupSampler::new(lamps, &emitters(g, 0), DVec3::ZERO);
    let groups = vec![GroupLight {
        sampler,
        emission,
        has_maps: g.materials.iter().any(|m| m.emission.is_some_and(|e| e.map.is_some())),
        key: 7,
    }];
    Lights { groups, index_of_group: vec![Some(0)], ..Lights::none() }
}

fn sun(disc: SunDisc) -> Lights {
    Lights { suns: vec![SunLight::new(disc)], ..Lights::none() }
}

fn sky(sky: SkyTable) -> Lights {
    Lights { sky, ..Lights::none() }
}

/// Mean and standard error.
type Measured = (f64, f64);

/// Layer 0's green channel at POINT with the built backends, one after the other.
fn irradiance(g: &Geometry, lights: &Lights, bounces: Option<u32>, samples: u32) -> Vec<Measured> {
    Backend::built()
        .map(|backend| {
            let rays = RayTracer::with_backend(g, backend).expect("a built backend starts");
            irradiance_through(&rays, g, lights, bounces, samples)
        })
        .collect()
}

fn irradiance_through(
    rays: &RayTracer,
    geometry: &Geometry,
    lights: &Lights,
    bounces: Option<u32>,
    samples: u32,
) -> Measured {
    let transport = Transport::new(Space::new(geometry, rays), lights, bounces);
    let at = transport.space.receiver(&POINT).expect("a normal");
    let mut counts = RayCounts::default();
    let mut means = Vec::new();
    for scramble in 0..SCRAMBLES {
        let sequence = Sequence::new(11, SequenceKind::Texel, scramble, 0);
        let mut out = vec![Rgb::ZERO; lights.layers()];
        for index in 0..samples {
            let sample = sequence.sample(index);
            for light in 0..lights.sampled() {
                out[lights.layer_of_sampled(light)] +=
                    transport.direct(&at, light, sample, &sun_sample(sample), &mut counts);
            }
            transport.indirect(&at, sample, |_, _, _| false, &mut out, None, &mut counts);
        }
        assert!(out.iter().all(|v| v.is_finite() && v.min_element() >= 0.0));
        means.push(f64::from(out[0].y) / f64::from(samples));
    }
    let n = f64::from(SCRAMBLES);
    let mean = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

#[track_caller]
fn expect(measured: Vec<Measured>, closed_form: f64) {
    assert!(!measured.is_empty());
    for (mean, sigma) in measured {
        let rounding = closed_form * 3e-5;
        assert!(
            (mean - closed_form).abs() <= 3.0 * sigma + rounding && (mean / closed_form - 1.0).abs() <= 0.01,
            "{mean} ± {sigma}, closed form {closed_form}"
        );
    }
}

#[test]
fn furnace_reaches_the_geometric_series() {
    // A closed box of reflectance ½ that emits ½: L = 1 everywhere, E = π.
    let mut furnace = material(0.5);
    furnace.emission = Some(Emission { radiance: Vec3::splat(0.5), group: 0, map: None });
    let g = room(0, furnace);
    let l = group(&g, &[]);
    expect(irradiance(&g, &l, None, 1024), PI);
    // n bounces: Le (1 − ρⁿ⁺¹)/(1 − ρ).
    for n in [0, 1, 2, 5] {
        expect(irradiance(&g, &l, Some(n), 512), PI * (1.0 - 0.5f64.powi(n as i32 + 1)));
    }
}

#[test]
fn furnace_holds_at_high_albedo() {
    let mut furnace = material(0.9);
    furnace.emission = Some(Emission { radiance: Vec3::splat(0.1), group: 0, map: None });
    let g = room(0, furnace);
    let l = group(&g, &[]);
    expect(irradiance(&g, &l, None, 1024), PI);
}

#[test]
fn open_plane_under_a_uniform_sky_receives_pi_l() {
    let mut g = Geometry { materials: vec![material(0.5)], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    let l = sky(constant_sky(3.0));
    expect(irradiance(&g, &l, None, 64), PI * 3.0);
}

#[test]
fn a_tilted_plane_sees_its_part_of_the_sky() {
    // Over black ground: π L (1 + cos β)/2.
    let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
    let beta = 0.9f64;
    let up = vec3(0.0, beta.cos() as f32, beta.sin() as f32);
    let u = Vec3::X;
    let v = up.cross(u);
    quad(&mut g, vec3(0.0, 1.0, 0.0) - u * 0.01 - v * 0.01, u * 0.02, v * 0.02, 0);
    quad(&mut g, vec3(-1e4, 0.0, 1e4), vec3(2e4, 0.0, 0.0), vec3(0.0, 0.0, -2e4), 0);
    let l = sky(constant_sky(1.0));
    expect(irradiance(&g, &l, None, 1024), PI * (1.0 + beta.cos()) / 2.0);
}

#[test]
fn a_black_wall_takes_its_part_of_the_sky() {
    // A wall so long that it is endless, of height h at distance d: (1 + cos(atan(h/d)))/2 of the sky is
    // left.
    let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
    quad(&mut g, vec3(-0.01, 0.0, 0.01), vec3(0.02, 0.0, 0.0), vec3(0.0, 0.0, -0.02), 0);
    quad(&mut g, vec3(-2e2, -1.0, -2.0), vec3(4e2, 0.0, 0.0), vec3(0.0, 4.0, 0.0), 0);
    let point_z = 0.01 * (1.0 - 2.0 * 0.25);
    let l = sky(constant_sky(1.0));
    let (h, d) = (3.0f64, 2.0 + point_z);
    expect(irradiance(&g, &l, None, 1024), PI * (1.0 + (h / d).atan().cos()) / 2.0);
}

#[test]
fn sun_disc_gives_its_irradiance_times_the_cosine() {
    let mut g = Geometry { materials: vec![material(0.3)], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    for half_angle in [0.0, 0.00465, 0.2] {
        let direction = vec3(0.4, 0.7, -0.2).normalize();
        let disc = SunDisc { direction, irradiance: Vec3::splat(100.0), half_angle, horizon: false };
        // E = π L sin²δ cos θ, with the disc's flux per area ∫ L dω = 2 π L (1 − cos δ).
        let l = sun(disc);
        let radiance_times_pi = 100.0 / (2.0 * (1.0 - f64::from(half_angle).cos()));
        let sin2 = f64::from(half_angle).sin().powi(2);
        let perpendicular = if half_angle == 0.0 { 100.0 } else { radiance_times_pi * sin2 };
        expect(irradiance(&g, &l, None, 256), perpendicular * f64::from(direction.y));
    }
}

#[test]
fn penumbra_past_a_straight_edge() {
    // Under a disc whose centre stands t radii past a straight edge, (acos t − t √(1 − t²))/π of it is seen.
    // (So small that the cosine is 1 all over it.)
    let delta = 0.005f64;
    for t in [-0.6, 0.0, 0.35] {
        let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
        quad(&mut g, vec3(-1e-4, 0.0, 1e-4), vec3(2e-4, 0.0, 0.0), vec3(0.0, 0.0, -2e-4), 0);
        // A plane 10 m up covering x < edge as far as the disc reaches.
        let x = f64::from(POINT.barycentric.y + POINT.barycentric.z) * 2e-4 - 1e-4;
        let edge = (x + 10.0 * (delta * t).tan()) as f32;
        quad(&mut g, vec3(edge - 1.0, 10.0, 1.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
        let disc =
            SunDisc { direction: Vec3::Y, irradiance: Vec3::ONE, half_angle: delta as f32, horizon: false };
        let l = sun(disc);
        expect(irradiance(&g, &l, Some(0), 1024), (t.acos() - t * (1.0 - t * t).sqrt()) / PI);
    }
}

#[test]
fn lamps_give_their_closed_forms() {
    let mut g = Geometry { materials: vec![material(0.3)], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    let b = POINT.barycentric;
    let c = g.corners(0);
    let p = (c[0] * b.x + c[1] * b.y + c[2] * b.z).as_dvec3();
    // Sphere above the horizon: π L (R/d)² cos θ.
    let (centre, radius) = (p + dvec3(0.8, 1.5, -0.4), 0.3);
    let to = centre - p;
    let sphere = Lamp::Sphere { centre, radius, radiance: DVec3::splat(7.0) };
    let l = group(&g, std::slice::from_ref(&sphere));
    let d2 = to.length_squared();
    expect(irradiance(&g, &l, None, 256), PI * 7.0 * radius * radius / d2 * (to.y / d2.sqrt()));
    // Rectangle parallel to the receiver over its corner.
    let (a, bb, h) = (1.2, 0.7, 0.9);
    let rectangle = Lamp::Rectangle {
        corner: p + dvec3(0.0, h, 0.0),
        edge_u: dvec3(a, 0.0, 0.0),
        edge_v: dvec3(0.0, 0.0, bb),
        radiance: DVec3::splat(2.0),
    };
    let (x, y) = (a / h, bb / h);
    let factor = (x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan()
        + y / (1.0 + y * y).sqrt() * (x / (1.0 + y * y).sqrt()).atan())
        / (2.0 * PI);
    let l = group(&g, std::slice::from_ref(&rectangle));
    expect(irradiance(&g, &l, None, 256), PI * 2.0 * factor);
    // Two lamps of one group, one chosen per sample: the sum of both.
    let both = group(&g, &[sphere, rectangle]);
    let sum = PI * 7.0 * radius * radius / d2 * (to.y / d2.sqrt()) + PI * 2.0 * factor;
    expect(irradiance(&g, &both, None, 2048), sum);
}

#[test]
fn integrating_sphere_multiplies_by_one_over_one_minus_rho() {
    // A point source Φ in a sphere of radius R: E = Φ/(4πR²)/(1 − ρ).
    let mut g = Geometry { materials: vec![material(0.7)], ..Geometry::default() };
    let (rings, columns) = (96usize, 192usize);
    let at = |i: usize, j: usize| {
        let theta = std::f32::consts::PI * i as f32 / rings as f32;
        let phi = std::f32::consts::TAU * j as f32 / columns as f32;
        vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * 2.0
    };
    for i in 0..rings {
        for j in 0..columns {
            let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            for t in [[0, 1, 2], [0, 2, 3]] {
                let c = t.map(|k: usize| corners[k]);
                let n = (c[1] - c[0]).cross(c[2] - c[0]);
                if n.length_squared() < 1e-14 {
                    continue;
                }
                // Front on the inside.
                let c = if n.dot(c[0]) < 0.0 { c } else { [c[0], c[2], c[1]] };
                let first = g.positions.len() as u32;
                for p in c {
                    g.positions.push(p);
                    g.normals.push((c[1] - c[0]).cross(c[2] - c[0]).normalize());
                    g.uvs.push(glam::Vec2::ZERO);
                    g.lightmap_uvs.push(glam::Vec2::ZERO);
                }
                g.triangles.push([first, first + 1, first + 2]);
                g.material_of.push(0);
            }
        }
    }
    let (radius, radiance) = (0.05, 100.0);
    let flux = PI * radiance * 4.0 * PI * radius * radius;
    let lamp = Lamp::Sphere { centre: DVec3::ZERO, radius, radiance: DVec3::splat(radiance) };
    let l = group(&g, &[lamp]);
    expect(irradiance(&g, &l, None, 1024), flux / (4.0 * PI * 4.0) / (1.0 - 0.7));
}

#[test]
fn a_single_sheet_shades_what_lies_under_it() {
    // A one-sided black roof, 4 m square, 1 m over a floor: it takes its form factor from the sky, whichever
    // side is its front. From the middle, four rectangles over a corner with A = B = 2: F = 0.8310.
    let (a, b) = (2.0f64, 2.0f64);
    let half = |a: f64, b: f64| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
    let factor = 4.0 * (half(a, b) + half(b, a)) / (2.0 * PI);
    for (u, v) in [(vec3(4.0, 0.0, 0.0), vec3(0.0, 0.0, -4.0)), (vec3(0.0, 0.0, -4.0), vec3(4.0, 0.0, 0.0))] {
        let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
        quad(&mut g, vec3(-1e-4, 0.0, 1e-4), vec3(2e-4, 0.0, 0.0), vec3(0.0, 0.0, -2e-4), 0);
        quad(&mut g, vec3(-2.0, 1.0, 2.0), u, v, 0);
        let l = sky(constant_sky(1.0));
        expect(irradiance(&g, &l, None, 4096), PI * (1.0 - factor));
    }
}

#[test]
fn points_inside_a_closed_body_are_left_out() {
    // The floor of a closed box seen from inside, walls turned outwards: every sample says so.
    let mut g = room(0, material(0.5));
    for t in g.triangles[2..].iter_mut() {
        t.swap(1, 2);
    }
    let l = sky(constant_sky(1.0));
    for backend in Backend::built() {
        let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
        let transport = Transport::new(Space::new(&g, &rays), &l, None);
        let at = transport.space.receiver(&POINT).expect("a normal");
        let mut counts = RayCounts::default();
        assert!(transport.space.is_inside(&at, &mut counts));
        // Five directions, and whether the first back is met alone.
        assert_eq!(counts.inside, 6);
    }
}

/// World position of POINT.
fn point(g: &Geometry) -> DVec3 {
    let [a, b, c] = g.corners(0).map(|c| c.as_dvec3());
    let w = POINT.barycentric.as_dvec3();
    a * w.x + b * w.y + c * w.z
}

/// Lambert's formula: the irradiance of a polygon of radiance 1, wholly on the front of the receiver's plane,
/// ½ |Σ θᵢ n·Γᵢ| with θᵢ the angle an edge fills and Γᵢ the unit normal of its triangle with the receiver.
fn lambert(polygon: &[DVec3], p: DVec3, n: DVec3) -> f64 {
    let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let sum: f64 = edges
        .map(|(a, b)| {
            let (a, b) = ((*a - p).normalize(), (*b - p).normalize());
            let normal = a.cross(b);
            normal.length().atan2(a.dot(b)) * n.dot(normal.normalize_or_zero())
        })
        .sum();
    sum.abs() / 2.0
}

/// A black floor of 2 × 2 m, and a black quad of radiance 3 that belongs to group 0.
fn floor_and_emitter(corner: Vec3, u: Vec3, v: Vec3) -> Geometry {
    let mut shining = material(0.0);
    shining.emission = Some(Emission { radiance: Vec3::splat(3.0), group: 0, map: None });
    let mut g = Geometry { materials: vec![material(0.0), shining], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    quad(&mut g, corner, u, v, 1);
    g
}

#[test]
fn emissive_quads_give_lamberts_polygon() {
    let p = point(&floor_and_emitter(Vec3::ZERO, Vec3::X, Vec3::Y)).as_vec3();
    // Facing down from 1 m; from 1 cm, very large; from 60 m, small; upright, touching the floor 1 mm away.
    for (corner, u, v) in [
        (p + vec3(-0.3, 1.0, 0.2), vec3(0.8, 0.0, 0.0), vec3(0.0, 0.0, 0.9)),
        (p + vec3(-0.7, 0.01, -0.4), vec3(1.5, 0.0, 0.0), vec3(0.0, 0.0, 1.1)),
        (p + vec3(20.0, 60.0, -5.0), vec3(0.5, 0.0, 0.0), vec3(0.0, 0.0, 0.4)),
        (p + vec3(1e-3, 0.0, -0.5), vec3(0.0, 0.0, 1.0), vec3(0.0, 1.0, 0.0)),
    ] {
        // Its front towards the point.
        let (u, v) = if u.cross(v).dot(p - corner) > 0.0 { (u, v) } else { (v, u) };
        let g = floor_and_emitter(corner, u, v);
        let polygon = [corner, corner + u, corner + u + v, corner + v].map(|c| c.as_dvec3());
        let closed_form = 3.0 * lambert(&polygon, point(&g), DVec3::Y);
        expect(irradiance(&g, &group(&g, &[]), None, 512), closed_form);
        // From behind, it gives nothing.
        let g = floor_and_emitter(corner, v, u);
        for (mean, _) in irradiance(&g, &group(&g, &[]), None, 64) {
            assert_eq!(mean, 0.0);
        }
    }
}

/// Irradiance of an upright receiver at `p` by a quad whose radiance falls linearly along `u`, from 3 at ¼ to
/// 0 at ¾.
fn linear_quad(corner: DVec3, u: DVec3, v: DVec3, p: DVec3) -> f64 {
    const N: usize = 400;
    let normal = u.cross(v);
    let sum: f64 = (0..N * N)
        .map(|i| {
            let (s, t) = (((i % N) as f64 + 0.5) / N as f64, ((i / N) as f64 + 0.5) / N as f64);
            let to = corner + u * s + v * t - p;
            let radiance = 3.0 * (1.5 - 2.0 * s).clamp(0.0, 1.0);
            radiance * to.y.max(0.0) * to.dot(normal).abs() / to.length_squared().powi(2)
        })
        .sum();
    sum / (N * N) as f64
}

#[test]
fn emissive_maps_give_the_integral_of_their_light() {
    let p = point(&floor_and_emitter(Vec3::ZERO, Vec3::X, Vec3::Y)).as_vec3();
    // Facing down from 1 m, from 20 cm, from afar, and from the side.
    for (corner, u, v) in [
        (p + vec3(-0.3, 1.0, 0.2), vec3(0.8, 0.0, 0.0), vec3(0.0, 0.0, 0.9)),
        (p + vec3(-0.7, 0.2, -0.4), vec3(1.5, 0.0, 0.0), vec3(0.0, 0.0, 1.1)),
        (p + vec3(20.0, 60.0, -5.0), vec3(0.5, 0.0, 0.0), vec3(0.0, 0.0, 0.4)),
        (p + vec3(0.4, 0.1, -0.5), vec3(0.0, 0.0, 1.0), vec3(0.0, 1.0, 0.0)),
    ] {
        let mut g = floor_and_emitter(corner, u, v);
        let [first, .., last] = g.triangles[2..] else { unreachable!() };
        let front = (u.cross(v)).dot(p - corner) > 0.0;
        if !front {
            g.triangles[2..].iter_mut().for_each(|t| t.swap(1, 2));
        }
        let rgba = vec![[255, 255, 255, 255], [0, 0, 0, 255]];
        g.emission_maps =
            vec![Texture { width: 2, height: 1, rgba, wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp }];
        g.emission_uvs = vec![Vec2::ZERO; g.positions.len()];
        for index in first.into_iter().chain(last) {
            let along = (g.positions[index as usize] - corner).dot(u) / u.length_squared();
            g.emission_uvs[index as usize] = Vec2::new(along, 0.5);
        }
        g.materials[1].emission.as_mut().unwrap().map = Some(0);
        let (corner, u, v) = (corner.as_dvec3(), u.as_dvec3(), v.as_dvec3());
        let closed_form = linear_quad(corner, u, v, point(&g));
        expect(irradiance(&g, &group(&g, &[]), None, 4096), closed_form);
    }
}

#[test]
fn an_emissive_quad_through_the_floor_gives_what_stands_above() {
    let p = point(&floor_and_emitter(Vec3::ZERO, Vec3::X, Vec3::Y)).as_vec3();
    let corner = p + vec3(0.4, -1.0, -0.5);
    let g = floor_and_emitter(corner, vec3(0.0, 0.0, 1.0), vec3(0.0, 2.0, 0.0));
    let above = [(1.0, 0.0), (1.0, 1.0), (2.0, 1.0), (2.0, 0.0)];
    let polygon = above.map(|(y, z)| (corner + vec3(0.0, y, z)).as_dvec3());
    // Its front is −X.
    expect(irradiance(&g, &group(&g, &[]), None, 1024), 3.0 * lambert(&polygon, point(&g), DVec3::Y));
}

#[test]
fn a_lamp_and_emissive_quads_of_one_group_add_up() {
    let p = point(&floor_and_emitter(Vec3::ZERO, Vec3::X, Vec3::Y)).as_vec3();
    let (corner, u, v) = (p + vec3(-0.4, 0.5, -0.4), vec3(0.5, 0.0, 0.0), vec3(0.0, 0.0, 0.4));
    let g = floor_and_emitter(corner, u, v);
    let polygon = [corner, corner + u, corner + u + v, corner + v].map(|c| c.as_dvec3());
    let to = dvec3(0.9, 0.8, 0.5);
    let lamp = Lamp::Sphere { centre: point(&g) + to, radius: 0.2, radiance: DVec3::splat(5.0) };
    let ball = PI * 5.0 * 0.04 / to.length_squared() * to.normalize().y;
    expect(
        irradiance(&g, &group(&g, &[lamp]), None, 2048),
        ball + 3.0 * lambert(&polygon, point(&g), DVec3::Y),
    );
}

/// A scene that is nothing but a sky and portals.
fn skies(sky: Sky, portals: Vec<Portal>) -> Scene {
    Scene { name: "skies".to_owned(), sky: Some(sky), portals, ..Scene::default() }
}

/// The lights of such a scene, with its sky sampler and without.
fn sampled_and_not(scene: &Scene) -> [Lights; 2] {
    let table = || SkyTable::new(scene.sky.as_ref(), None, &[12.0]);
    let sky_sampler = SkySampler::new(scene, &table(), DVec3::ZERO);
    assert!(sky_sampler.is_some());
    [Lights { sky_sampler, ..sky(table()) }, sky(table())]
}

/// A room of side 2 with a window of 0.5 × 0.5 m in the wall z = 1, floor first.
fn room_with_window(albedo: f32) -> Geometry {
    let mut g = Geometry { materials: vec![material(albedo)], ..Geometry::default() };
    let mut wall =
        |corner: [f32; 3], u: [f32; 3], v: [f32; 3]| quad(&mut g, corner.into(), u.into(), v.into(), 0);
    wall([-1.0, -1.0, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, -2.0]);
    wall([-1.0, 1.0, -1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]);
    wall([-1.0, -1.0, -1.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]);
    wall([-1.0, -1.0, 1.0], [0.0, 0.0, -2.0], [0.0, 2.0, 0.0]);
    wall([1.0, -1.0, -1.0], [0.0, 0.0, 2.0], [0.0, 2.0, 0.0]);
    // Around the window, facing −Z: left, right, below, above.
    for (x0, x1, y0, y1) in
        [(-1.0, -0.2, -1.0, 1.0), (0.3, 1.0, -1.0, 1.0), (-0.2, 0.3, -1.0, 0.0), (-0.2, 0.3, 0.5, 1.0)]
    {
        wall([x0, y0, 1.0], [0.0, y1 - y0, 0.0], [x1 - x0, 0.0, 0.0]);
    }
    g
}

const WINDOW: [DVec3; 4] =
    [dvec3(-0.2, 0.0, 1.0), dvec3(0.3, 0.0, 1.0), dvec3(0.3, 0.5, 1.0), dvec3(-0.2, 0.5, 1.0)];

fn window_portal() -> Portal {
    Portal { corner: WINDOW[0], edge_u: WINDOW[1] - WINDOW[0], edge_v: WINDOW[3] - WINDOW[0], room: None }
}

#[test]
fn a_portal_changes_the_noise_and_not_the_light() {
    let scene = skies(Sky::Constant { radiance: DVec3::splat(2.0) }, vec![window_portal()]);
    let [sampled, plain] = sampled_and_not(&scene);
    // Black walls: the window is Lambert's polygon.
    let g = room_with_window(0.0);
    expect(irradiance(&g, &sampled, None, 512), 2.0 * lambert(&WINDOW, point(&g), DVec3::Y));
    // Light walls: the same with portal and without, and less noise with it at a quarter of the samples.
    let g = room_with_window(0.6);
    let with = irradiance(&g, &sampled, None, 1024);
    for ((a, sa), (b, sb)) in with.into_iter().zip(irradiance(&g, &plain, None, 4096)) {
        assert!((a - b).abs() <= 3.0 * sa.hypot(sb), "{a} ± {sa}, {b} ± {sb}");
        assert!(sb < 0.02 * b && sa < 0.7 * sb, "{a} ± {sa}, {b} ± {sb}");
    }
}

#[test]
fn portals_that_miss_the_opening_or_overlap_change_no_light() {
    let aside =
        Portal { corner: dvec3(-0.9, -0.5, 1.0), edge_u: DVec3::X * 0.9, edge_v: DVec3::Y * 0.7, room: None };
    let scene = skies(
        Sky::Constant { radiance: DVec3::splat(2.0) },
        vec![aside, window_portal(), window_portal(), aside],
    );
    let [sampled, _] = sampled_and_not(&scene);
    let g = room_with_window(0.0);
    expect(irradiance(&g, &sampled, None, 2048), 2.0 * lambert(&WINDOW, point(&g), DVec3::Y));
}

#[test]
fn an_image_sky_gives_its_integral_with_its_bright_spot_looked_for() {
    // 32 × 16 texels, dim but for one.
    let mut picture = Image::black(32, 16);
    picture.texels.fill([0.2; 3]);
    picture.texels[5 * 32 + 9] = [400.0; 3];
    let image = SkyImage {
        file: "spot.exr".to_owned(),
        scale: 1.0,
        rotation: 40.0,
        blake3: String::new(),
        radiance: Arc::new(picture),
    };
    let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    let [sampled, plain] = sampled_and_not(&skies(Sky::Image(image), Vec::new()));
    // ∫ L cos θ dω over the upper hemisphere by midpoints: sin² θ and the azimuth are even under the cosine.
    const N: usize = 1500;
    let mut sum = 0.0;
    for i in 0..N {
        let sin = ((i as f64 + 0.5) / N as f64).sqrt();
        for j in 0..N {
            let phi = (j as f64 + 0.5) / N as f64 * 2.0 * PI;
            let direction = dvec3(sin * phi.cos(), (1.0 - sin * sin).sqrt(), sin * phi.sin());
            let mut out = [Rgb::ZERO];
            sampled.sky.add(direction.as_vec3(), Rgb::ONE, &mut out);
            sum += f64::from(out[0].y);
        }
    }
    let integral = PI * sum / (N * N) as f64;
    let measured = irradiance(&g, &sampled, None, 1024);
    expect(measured.clone(), integral);
    for ((_, with), (b, without)) in measured.into_iter().zip(irradiance(&g, &plain, None, 1024)) {
        assert!(with < 0.5 * without && (b - integral).abs() <= 3.5 * without, "{with}, {b} ± {without}");
    }
}

#[test]
fn ground_below_the_horizon_lights_what_looks_down() {
    // A plane that looks down has π L of ground of radiance L, an upright one half of that and half of the
    // sky's; one that looks up has the sky alone. (The sun's layer comes first: ground of 2 in it, of 3 in
    // the sky's.)
    let plane = |up: Vec3| {
        let mut g = Geometry { materials: vec![material(0.5)], ..Geometry::default() };
        let u = up.any_orthonormal_vector();
        let v = up.cross(u);
        quad(&mut g, -0.5 * (u + v), u, v, 0);
        g
    };
    let behind = SunDisc { direction: Vec3::Y, irradiance: Rgb::ZERO, half_angle: 0.0, horizon: false };
    let lights = || Lights {
        suns: vec![SunLight::new(behind)],
        ground: vec![Rgb::splat(2.0), Rgb::splat(3.0)],
        ..sky(constant_sky(0.5))
    };
    for (up, sun_part, sky_part) in [
        (Vec3::NEG_Y, 2.0, 3.5),
        (Vec3::X, 1.0, 2.0),
        (Vec3::Y, 0.0, 0.5),
        (vec3(0.0, -0.6, 0.8), 2.0 * 0.8, 0.5 + 3.0 * 0.8),
    ] {
        let g = plane(up);
        for backend in Backend::built() {
            let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
            let lights = lights();
            let transport = Transport::new(Space::new(&g, &rays), &lights, None);
            let at = transport.space.receiver(&POINT).expect("a normal");
            let mut out = vec![Rgb::ZERO; lights.layers()];
            let sequence = Sequence::new(11, SequenceKind::Texel, 0, 0);
            let n = 1 << 14;
            for i in 0..n {
                transport.indirect(
                    &at,
                    sequence.sample(i),
                    |_, _, _| false,
                    &mut out,
                    None,
                    &mut RayCounts::default(),
                );
            }
            for (found, expected) in out.iter().zip([sun_part, sky_part]) {
                let found = f64::from(found.y) / f64::from(n) / PI;
                assert!((found - expected).abs() < 5e-3, "{up}: {found}, expected {expected}");
            }
        }
    }
}
