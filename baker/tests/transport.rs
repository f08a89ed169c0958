//! The integrator against closed forms. Every expectation is judged by its own error: the mean over independent
//! scrambles must lie within 3 standard errors of the closed form and within 1 % of it.

use baker::Rgb;
use baker::geometry::{Geometry, Material};
use baker::light::lamp::LampSampler;
use baker::light::sky::SkyTable;
use baker::light::sun::SunDisc;
use baker::scene::{Lamp, Sky};
use baker::surface::SurfacePoint;
use baker::trace::rays::Rays;
use baker::trace::sampler::Sequence;
use baker::trace::walk::{RayCounts, Transport};
use glam::{DVec3, Vec3, dvec3, vec3};
use std::f64::consts::PI;

/// Independent scrambles behind every σ.
const SCRAMBLES: u32 = 32;

fn material(albedo: f32) -> Material {
    Material {
        albedo: Vec3::splat(albedo),
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

struct Lights {
    suns: Vec<SunDisc>,
    sky: SkyTable,
    groups: Vec<Vec<LampSampler>>,
}

fn lights() -> Lights {
    Lights { suns: Vec::new(), sky: SkyTable::new(None, None, &[12.0]), groups: Vec::new() }
}

fn constant_sky(radiance: f64) -> SkyTable {
    SkyTable::new(Some(&Sky::Constant { radiance: DVec3::splat(radiance) }), None, &[12.0])
}

/// Mean and standard error of layer 0's green channel at POINT.
fn irradiance(g: &Geometry, lights: &Lights, bounces: Option<u32>, samples: u32) -> (f64, f64) {
    let rays = Rays::new(g);
    let layer_of_group: Vec<Option<usize>> = (0..lights.groups.len()).map(Some).collect();
    let transport = Transport {
        geometry: g,
        rays: &rays,
        suns: &lights.suns,
        sky: &lights.sky,
        groups: &lights.groups,
        layer_of_group: &layer_of_group,
        bounces,
    };
    let mut means = Vec::new();
    for scramble in 0..SCRAMBLES {
        let sequence = Sequence::new(11, 0, scramble, 0);
        let mut out = vec![Rgb::ZERO; transport.layers()];
        for index in 0..samples {
            transport.gather(&POINT, sequence.sample(index), &mut out, &mut RayCounts::default());
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
fn expect((mean, sigma): (f64, f64), closed_form: f64) {
    let rounding = closed_form * 1e-5;
    assert!(
        (mean - closed_form).abs() <= 3.0 * sigma + rounding && (mean / closed_form - 1.0).abs() <= 0.01,
        "{mean} ± {sigma}, closed form {closed_form}"
    );
}

#[test]
fn furnace_reaches_the_geometric_series() {
    // A closed box of reflectance ½ that emits ½: L = 1 everywhere, E = π.
    let mut furnace = material(0.5);
    furnace.emission = Some((Vec3::splat(0.5), 0));
    let g = room(0, furnace);
    let mut l = lights();
    l.groups = vec![Vec::new()];
    expect(irradiance(&g, &l, None, 1024), PI);
    // n bounces: Le (1 − ρⁿ⁺¹)/(1 − ρ).
    for n in [0, 1, 2, 5] {
        expect(irradiance(&g, &l, Some(n), 512), PI * (1.0 - 0.5f64.powi(n as i32 + 1)));
    }
}

#[test]
fn furnace_holds_at_high_albedo() {
    let mut furnace = material(0.9);
    furnace.emission = Some((Vec3::splat(0.1), 0));
    let g = room(0, furnace);
    let mut l = lights();
    l.groups = vec![Vec::new()];
    expect(irradiance(&g, &l, None, 4096), PI);
}

#[test]
fn open_plane_under_a_uniform_sky_receives_pi_l() {
    let mut g = Geometry { materials: vec![material(0.5)], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    let l = Lights { sky: constant_sky(3.0), ..lights() };
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
    let l = Lights { sky: constant_sky(1.0), ..lights() };
    expect(irradiance(&g, &l, None, 1024), PI * (1.0 + beta.cos()) / 2.0);
}

#[test]
fn a_black_wall_takes_its_part_of_the_sky() {
    // A wall so long that it is endless, of height h at distance d: (1 + cos(atan(h/d)))/2 of the sky is left.
    let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
    quad(&mut g, vec3(-0.01, 0.0, 0.01), vec3(0.02, 0.0, 0.0), vec3(0.0, 0.0, -0.02), 0);
    quad(&mut g, vec3(-2e2, -1.0, -2.0), vec3(4e2, 0.0, 0.0), vec3(0.0, 4.0, 0.0), 0);
    let point_z = 0.01 * (1.0 - 2.0 * 0.25);
    let l = Lights { sky: constant_sky(1.0), ..lights() };
    let (h, d) = (3.0f64, 2.0 + point_z);
    expect(irradiance(&g, &l, None, 1024), PI * (1.0 + (h / d).atan().cos()) / 2.0);
}

#[test]
fn sun_disc_gives_its_irradiance_times_the_cosine() {
    let mut g = Geometry { materials: vec![material(0.3)], ..Geometry::default() };
    quad(&mut g, vec3(-1.0, 0.0, 1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, -2.0), 0);
    for half_angle in [0.0, 0.00465, 0.2] {
        let direction = vec3(0.4, 0.7, -0.2).normalize();
        let sun = SunDisc { direction, irradiance: Vec3::splat(100.0), half_angle, horizon: false };
        // E = π L sin²δ cos θ, with the disc's flux per area ∫ L dω = 2 π L (1 − cos δ).
        let l = Lights { suns: vec![sun], ..lights() };
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
        let sun =
            SunDisc { direction: Vec3::Y, irradiance: Vec3::ONE, half_angle: delta as f32, horizon: false };
        let l = Lights { suns: vec![sun], ..lights() };
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
    let l = Lights { groups: vec![vec![LampSampler::new(&sphere, DVec3::ZERO)]], ..lights() };
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
    let l = Lights { groups: vec![vec![LampSampler::new(&rectangle, DVec3::ZERO)]], ..lights() };
    expect(irradiance(&g, &l, None, 256), PI * 2.0 * factor);
    // Two lamps of one group, one chosen per sample: the sum of both.
    let both = Lights {
        groups: vec![vec![LampSampler::new(&sphere, DVec3::ZERO), LampSampler::new(&rectangle, DVec3::ZERO)]],
        ..lights()
    };
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
    let l = Lights { groups: vec![vec![LampSampler::new(&lamp, DVec3::ZERO)]], ..lights() };
    expect(irradiance(&g, &l, None, 1024), flux / (4.0 * PI * 4.0) / (1.0 - 0.7));
}

#[test]
fn a_single_sheet_shades_what_lies_under_it() {
    // A one-sided black roof, 4 m square, 1 m over a floor: it takes its form factor from the sky, whichever side is its
    // front. From the middle, four rectangles over a corner with A = B = 2: F = 0.8310.
    let (a, b) = (2.0f64, 2.0f64);
    let half = |a: f64, b: f64| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
    let factor = 4.0 * (half(a, b) + half(b, a)) / (2.0 * PI);
    for (u, v) in [(vec3(4.0, 0.0, 0.0), vec3(0.0, 0.0, -4.0)), (vec3(0.0, 0.0, -4.0), vec3(4.0, 0.0, 0.0))] {
        let mut g = Geometry { materials: vec![material(0.0)], ..Geometry::default() };
        quad(&mut g, vec3(-1e-4, 0.0, 1e-4), vec3(2e-4, 0.0, 0.0), vec3(0.0, 0.0, -2e-4), 0);
        quad(&mut g, vec3(-2.0, 1.0, 2.0), u, v, 0);
        let l = Lights { sky: constant_sky(1.0), ..lights() };
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
    let rays = Rays::new(&g);
    let l = Lights { sky: constant_sky(1.0), ..lights() };
    let transport = Transport {
        geometry: &g,
        rays: &rays,
        suns: &l.suns,
        sky: &l.sky,
        groups: &l.groups,
        layer_of_group: &[],
        bounces: None,
    };
    let sequence = Sequence::new(1, 0, 0, 0);
    for index in 0..64 {
        let mut out = vec![Rgb::ZERO; 1];
        let added = transport.gather(&POINT, sequence.sample(index), &mut out, &mut RayCounts::default());
        assert!(!added && out[0] == Rgb::ZERO);
    }
}
