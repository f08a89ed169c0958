//! Thin glass against closed forms, with every backend that is built, in every channel.

use baker::Rgb;
use baker::geometry::{Emission, Geometry, Glass, Material, Solids, Texture, Wrap};
use baker::light::daylight::{SkySampler, SkyTable, SunDisc};
use baker::light::lamps::group::{GroupSampler, emitters};
use baker::scene::{Lamp, Portal, Scene, Sky};
use baker::surface::SurfacePoint;
use baker::trace::counts::RayCounts;
use baker::trace::paths::path::{Transport, sun_sample};
use baker::trace::paths::{Sequence, SequenceKind};
use baker::trace::rays::{Backend, RayTracer};
use baker::trace::solids::Space;
use baker::trace::sources::{GroupLight, Lights, SunLight};
use glam::{DVec3, Vec2, Vec3, dvec3, vec3};
use std::f32::consts::PI;

/// Independent scrambles behind every σ.
const SEEDS: u64 = 16;
/// As many standard errors as have the probability of 3 σ when σ itself is estimated from 16 values.
const THREE_SIGMA: f64 = 3.59;
/// Lets these shares through.
const TINT: Vec3 = Vec3::new(0.9, 0.5, 0.2);

/// A material of this albedo.
fn material(albedo: f32) -> Material {
    Material {
        albedo: Vec3::splat(albedo),
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: true,
        emission: None,
    }
}

/// Adds a parallelogram whose front is on the side of `u × v`.
fn quad(g: &mut Geometry, corner: Vec3, u: Vec3, v: Vec3, material: u32) {
    let first = g.positions.len() as u32;
    for (p, uv) in
        [(corner, Vec2::ZERO), (corner + u, Vec2::X), (corner + u + v, Vec2::ONE), (corner + v, Vec2::Y)]
    {
        g.positions.push(p);
        g.normals.push(u.cross(v).normalize());
        g.uvs.push(uv);
        g.lightmap_uvs.push(Vec2::ZERO);
    }
    g.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    g.material_of.extend([material, material]);
}

/// A black point of floor, looking up; materials 1 and 2 are glass of this transmission and albedo.
fn floor(transmission: [Vec3; 2], albedo: f32) -> Geometry {
    let mut g = Geometry {
        materials: vec![material(0.0), material(albedo), material(albedo)],
        glass: vec![None, Some(Glass::clear(transmission[0])), Some(Glass::clear(transmission[1]))],
        ..Geometry::default()
    };
    quad(&mut g, vec3(-1e-3, 0.0, 1e-3), vec3(2e-3, 0.0, 0.0), vec3(0.0, 0.0, -2e-3), 0);
    g
}

/// Six sides of a cube around zero, fronts inwards.
fn cube(g: &mut Geometry, half: f32, material: u32) {
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let n = Vec3::AXES[axis] * -sign;
            let (u, v) = n.any_orthonormal_pair();
            let (u, v) = if u.cross(v).dot(n) > 0.0 { (u, v) } else { (v, u) };
            quad(g, (-n - u - v) * half, u * (2.0 * half), v * (2.0 * half), material);
        }
    }
}

/// A level pane, large beside its height, looking up or down.
fn pane(g: &mut Geometry, height: f32, up: bool, material: u32) {
    let (u, v) = (Vec3::X * 20.0, Vec3::NEG_Z * 20.0);
    let (u, v) = if up { (u, v) } else { (v, u) };
    quad(g, vec3(-10.0, height, 10.0), u, v, material);
}

const POINT: SurfacePoint = SurfacePoint { triangle: 0, barycentric: Vec3::new(0.3, 0.45, 0.25) };

fn uniform_sky() -> Lights {
    let sky = SkyTable::new(Some(&Sky::Constant { radiance: DVec3::ONE }), None, &[12.0]);
    Lights { sky, ..Lights::none() }
}

/// A sharp sun that gives irradiance 1 to what faces it.
fn sun(direction: Vec3) -> Lights {
    let disc =
        SunDisc { direction: direction.normalize(), irradiance: Rgb::ONE, half_angle: 0.0, horizon: false };
    Lights { suns: vec![SunLight::new(disc)], ..Lights::none() }
}

/// Group 0: these lamps and the geometry's emissive triangles.
fn group(g: &Geometry, lamps: &[Lamp]) -> Lights {
    let emission = g.materials.iter().map(|m| m.emission.map_or(Vec3::ZERO, |e| e.radiance)).collect();
    let sampler = GroupSampler::new(lamps, &emitters(g, 0), DVec3::ZERO);
    let groups = vec![GroupLight { sampler, emission, has_maps: false, key: 7 }];
    Lights { groups, index_of_group: vec![Some(0)], ..Lights::none() }
}

/// Layer 0 at POINT over scrambles: one mean per scramble.
fn means(backend: Backend, g: &Geometry, lights: &Lights, samples: u32) -> Vec<Rgb> {
    let rays = RayTracer::with_backend(g, backend).expect("a built backend starts");
    let transport = Transport::new(Space::new(g, &rays), lights, None);
    let at = transport.space.receiver(&POINT).expect("a normal");
    let mut counts = RayCounts::default();
    let mut of_scramble = |scramble: u64| {
        let sequence = Sequence::new(11, SequenceKind::Texel, scramble as u32, 0);
        let mut out = vec![Rgb::ZERO; lights.layers()];
        for sample in (0..samples).map(|i| sequence.sample(i)) {
            for light in 0..lights.sampled() {
                out[lights.layer_of_sampled(light)] +=
                    transport.direct(&at, light, sample, &sun_sample(sample), &mut counts);
            }
            transport.indirect(&at, sample, |_, _, _| false, &mut out, None, &mut counts);
        }
        assert!(out.iter().all(|v| v.is_finite() && v.min_element() >= 0.0));
        out[0] / samples as f32
    };
    (0..SEEDS).map(&mut of_scramble).collect()
}

/// The mean of independent values, and its standard error.
fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Each channel of layer 0 must lie within 3 σ of the closed form, and σ within 1 % of it.
#[track_caller]
fn expect(g: &Geometry, lights: &Lights, samples: u32, closed_form: Vec3) {
    for backend in Backend::built() {
        let means = means(backend, g, lights, samples);
        for channel in 0..3 {
            let values: Vec<f64> = means.iter().map(|m| f64::from(m[channel])).collect();
            let (mean, sigma) = mean_and_sigma(&values);
            let expected = f64::from(closed_form[channel]);
            let off = (mean - expected).abs();
            assert!(
                off <= THREE_SIGMA * sigma + 3e-5 * expected && sigma <= 0.01 * expected,
                "{backend}, channel {channel}: {mean} ± {sigma}, expected {expected}"
            );
        }
    }
}

#[test]
fn panes_under_a_uniform_sky_multiply() {
    let mut one = floor([TINT, Vec3::ONE], 0.0);
    cube(&mut one, 1.0, 1);
    expect(&one, &uniform_sky(), 64, PI * TINT);
    cube(&mut one, 2.0, 1);
    expect(&one, &uniform_sky(), 64, PI * TINT * TINT);
}

#[test]
fn light_from_sun_and_lamps_is_dimmed_once_per_pane() {
    let mut g = floor([TINT, Vec3::new(0.3, 0.6, 0.9)], 0.0);
    pane(&mut g, 1.0, true, 1);
    let towards = vec3(0.3, 1.0, -0.2);
    expect(&g, &sun(towards), 4, TINT * towards.normalize().y);
    let lamp = |height: f64| Lamp::Point { position: dvec3(0.0, height, 0.0), intensity: DVec3::ONE };
    expect(&g, &group(&g, &[lamp(0.5)]), 4, Vec3::splat(4.0));
    expect(&g, &group(&g, &[lamp(2.0)]), 4, TINT / 4.0);
    // The order of panes does not matter, nor which way they look.
    let both = TINT * vec3(0.3, 0.6, 0.9);
    for (low, high) in [(1, 2), (2, 1)] {
        for up in [false, true] {
            let mut g = floor([TINT, Vec3::new(0.3, 0.6, 0.9)], 0.0);
            pane(&mut g, 1.0, up, low);
            pane(&mut g, 1.5, !up, high);
            expect(&g, &sun(towards), 4, both * towards.normalize().y);
            expect(&g, &group(&g, &[lamp(2.0)]), 4, both / 4.0);
        }
    }
}

#[test]
fn a_hundred_panes_are_as_one_of_their_product() {
    let each = vec3(0.99, 0.97, 0.95);
    let mut g = floor([each, Vec3::ONE], 0.0);
    (0..100).for_each(|i| cube(&mut g, 1.0 + 0.01 * i as f32, 1));
    let all = each.powf(100.0);
    expect(&g, &sun(vec3(0.1, 1.0, 0.2)), 4, all * vec3(0.1, 1.0, 0.2).normalize().y);
    expect(&g, &uniform_sky(), 16, PI * all);
}

#[test]
fn panes_that_coincide_all_count() {
    // The two sides of one sheet, as many models have them, and eight on each other.
    for count in [2, 8] {
        let mut g = floor([TINT, Vec3::ONE], 0.0);
        (0..count).for_each(|i| cube_facing(&mut g, i % 2 == 0));
        let all = TINT.powf(count as f32);
        expect(&g, &sun(vec3(0.1, 1.0, 0.2)), 4, all * vec3(0.1, 1.0, 0.2).normalize().y);
        expect(&g, &uniform_sky(), 16, PI * all);
    }
}

fn cube_facing(g: &mut Geometry, inwards: bool) {
    let first = g.triangles.len();
    cube(g, 1.0, 1);
    if !inwards {
        g.triangles[first..].iter_mut().for_each(|t| t.swap(1, 2));
    }
}

#[test]
fn glass_that_absorbs_nothing_keeps_a_furnace_at_one() {
    // Reflecting glass of both sides under the same radiance from everywhere: what it does not let through,
    // it reflects.
    let mut g = floor([TINT, Vec3::ONE], 1.0);
    cube(&mut g, 1.0, 1);
    expect(&g, &uniform_sky(), 1024, Vec3::splat(PI));
    // A room that shines with ½ and reflects ½, with glass in it.
    let mut g = floor([TINT, Vec3::ONE], 1.0);
    g.materials.push(Material {
        emission: Some(Emission { radiance: Vec3::splat(0.5), group: 0, map: None }),
        ..material(0.5)
    });
    cube(&mut g, 1.0, 1);
    cube(&mut g, 2.0, 3);
    let lights = group(&g, &[]);
    expect(&g, &lights, 2048, Vec3::splat(PI));
}

#[test]
fn what_glass_keeps_of_its_albedo_is_reflected() {
    // The pane's lower side sees the sky below: radiance albedo · (1 − τ), and through it comes τ.
    let albedo = 0.6;
    let mut g = floor([TINT, Vec3::ONE], albedo);
    cube(&mut g, 1.0, 1);
    // Inside the cube: L = τ + ρ L on all sides.
    let kept = (Vec3::ONE - TINT) * albedo;
    // (Of radiance that its walls show inside: τ · 1 from outside, ρ times what is inside.)
    expect(&g, &uniform_sky(), 2048, PI * TINT / (Vec3::ONE - kept));
    // A one-sided one absorbs on its back: fronts look inwards here, so turned round nothing is reflected.
    let mut g = floor([TINT, Vec3::ONE], albedo);
    g.materials[1].two_sided = false;
    cube_facing(&mut g, false);
    expect(&g, &uniform_sky(), 64, PI * TINT);
}

#[test]
fn emission_behind_glass_is_sampled_and_met() {
    // A shining ceiling of 2 × 2 m a metre up, half a metre of air, then glass.
    let mut bare = floor([TINT, Vec3::ONE], 0.0);
    bare.materials.push(Material {
        emission: Some(Emission { radiance: Vec3::ONE, group: 0, map: None }),
        two_sided: false,
        ..material(0.0)
    });
    quad(&mut bare, vec3(-1.0, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, 3);
    // From the middle, four rectangles over a corner with A = B = 1.
    let half = 1.0 / 2f32.sqrt() * (1.0 / 2f32.sqrt()).atan();
    let closed_form = PI * 4.0 * 2.0 * half / (2.0 * PI);
    expect(&bare, &group(&bare, &[]), 1024, Vec3::splat(closed_form));
    let mut glazed = bare.clone();
    pane(&mut glazed, 0.5, true, 1);
    expect(&glazed, &group(&glazed, &[]), 1024, TINT * closed_form);
    // Glass that shines itself, behind glass.
    let mut shining = bare;
    shining.glass.push(Some(Glass::clear(Vec3::splat(0.5))));
    pane(&mut shining, 0.5, false, 1);
    expect(&shining, &group(&shining, &[]), 1024, TINT * closed_form);
}

#[test]
fn a_portal_looks_for_the_sky_transmittance_of_glass() {
    // A black box of 100 × 1 × 100 m with a hole of 1 × 1 m in its lid, a metre above the point.
    let mut g = floor([TINT, Vec3::ONE], 0.0);
    let mut lid = |x: [f32; 2], z: [f32; 2]| {
        quad(&mut g, vec3(x[0], 1.0, z[0]), Vec3::X * (x[1] - x[0]), Vec3::Z * (z[1] - z[0]), 0);
    };
    lid([-50.0, -0.5], [-50.0, 50.0]);
    lid([0.5, 50.0], [-50.0, 50.0]);
    lid([-0.5, 0.5], [-50.0, -0.5]);
    lid([-0.5, 0.5], [0.5, 50.0]);
    quad(&mut g, vec3(-50.0, -0.01, 50.0), Vec3::X * 100.0, Vec3::NEG_Z * 100.0, 0);
    for side in [-50.0, 50.0] {
        quad(&mut g, vec3(-50.0, -0.01, side), Vec3::X * 100.0, Vec3::Y * 1.01, 0);
        quad(&mut g, vec3(side, -0.01, -50.0), Vec3::Z * 100.0, Vec3::Y * 1.01, 0);
    }
    quad(&mut g, vec3(-0.5, 1.0, -0.5), Vec3::X, Vec3::Z, 1);
    let (a, root) = (0.5f32, (1.0f32 + 0.25).sqrt());
    let closed_form = PI * 4.0 * 2.0 * (a / root * (a / root).atan()) / (2.0 * PI);
    let portal = Portal { corner: dvec3(-0.5, 1.0, -0.5), edge_u: DVec3::X, edge_v: DVec3::Z, room: None };
    let scene = Scene {
        name: "portal".to_owned(),
        sky: Some(Sky::Constant { radiance: DVec3::ONE }),
        portals: vec![portal],
        ..Scene::default()
    };
    let plain = uniform_sky();
    let sky_sampler = SkySampler::new(&scene, &plain.sky, DVec3::ZERO);
    assert!(sky_sampler.is_some());
    expect(&g, &Lights { sky_sampler, ..uniform_sky() }, 1024, TINT * closed_form);
    expect(&g, &plain, 8192, TINT * closed_form);
}

#[test]
fn clear_glass_changes_nothing() {
    // To the bit, for a path that passes draws nothing.
    let mut bare = floor([Vec3::ONE, Vec3::ONE], 0.5);
    bare.materials[0].albedo = Vec3::splat(0.7);
    quad(&mut bare, vec3(-3.0, -0.1, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 0);
    quad(&mut bare, vec3(-3.0, -0.1, -1.5), Vec3::X * 6.0, Vec3::Y * 2.0, 0);
    bare.glass.clear();
    let mut glazed = bare.clone();
    glazed.glass = vec![None, Some(Glass::clear(Vec3::ONE)), None];
    cube(&mut glazed, 1.0, 1);
    cube(&mut glazed, 2.0, 1);
    for lights in [uniform_sky(), sun(vec3(0.3, 1.0, 0.5))] {
        for backend in Backend::built() {
            assert_eq!(means(backend, &bare, &lights, 64), means(backend, &glazed, &lights, 64), "{backend}");
        }
    }
}

#[test]
fn backends_agree_on_glass_of_all_kinds() {
    let mut g = floor([TINT, vec3(0.2, 0.6, 0.7)], 0.5);
    cube(&mut g, 1.0, 1);
    quad(&mut g, vec3(-0.5, 0.6, -0.5), Vec3::X * 1.3, Vec3::Z, 2);
    quad(&mut g, vec3(-4.0, -0.5, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 2);
    g.glass[2] = Some(Glass { texture: Some(0), tint: Some(Vec3::splat(0.9)), ..Glass::clear(Vec3::ONE) });
    let rgba = [0, 80, 160, 255].map(|v| [v, v, v, 255]).to_vec();
    g.textures = vec![Texture { width: 2, height: 2, rgba, wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp }];
    for lights in [uniform_sky(), sun(vec3(0.3, 1.0, 0.1))] {
        let of = |backend| {
            let values: Vec<f64> = means(backend, &g, &lights, 256).iter().map(|m| f64::from(m.y)).collect();
            mean_and_sigma(&values)
        };
        let all: Vec<_> = Backend::built().map(of).collect();
        assert!(all[0].0 > 0.0);
        all.windows(2).for_each(|pair| {
            // The same random numbers: what differs is rounding, and what a rounding decides.
            assert!((pair[0].0 / pair[1].0 - 1.0).abs() < 2e-3, "{all:?}");
        });
    }
}

#[test]
fn a_texture_says_how_much_passes_where() {
    // Transmission from red, coverage from alpha; 2 × 1 texels, whose centres lie at u = ¼ and ¾.
    let texture = |left: [u8; 4], right: [u8; 4]| Texture {
        width: 2,
        height: 1,
        rgba: vec![left, right],
        wrap_u: Wrap::Clamp,
        wrap_v: Wrap::Clamp,
    };
    let mut g = floor([Vec3::ONE, Vec3::ONE], 0.5);
    quad(&mut g, vec3(0.0, 1.0, 0.0), Vec3::X, Vec3::NEG_Z, 1);
    let through = |g: &Geometry, u: f32| {
        let found = Backend::built().map(|backend| {
            let rays = RayTracer::with_backend(g, backend).expect("a built backend starts");
            rays.transmittance(vec3(u, 0.0, -0.37), Vec3::Y, f32::INFINITY, u32::MAX)
        });
        let found: Vec<Vec3> = found.collect();
        assert!(found.iter().all(|v| v.abs_diff_eq(found[0], 1e-5)), "{found:?}");
        found[0]
    };
    g.textures = vec![texture([51, 0, 0, 255], [255, 0, 0, 255])];
    g.glass[1] = Some(Glass { texture: Some(0), ..Glass::clear(vec3(1.0, 0.5, 0.25)) });
    for (u, red) in [(0.1, 0.2), (0.25, 0.2), (0.5, 0.6), (0.75, 1.0), (0.625, 0.8)] {
        assert!(through(&g, u).abs_diff_eq(vec3(1.0, 0.5, 0.25) * red, 1e-4), "{u}: {}", through(&g, u));
    }
    g.textures = vec![texture([255, 255, 255, 204], [255, 255, 255, 0])];
    g.materials[1].texture = Some(0);
    g.glass[1] = Some(Glass { is_blended: true, ..Glass::clear(Vec3::ZERO) });
    for (u, open) in [(0.1, 0.2), (0.5, 0.6), (0.9, 1.0)] {
        assert!(through(&g, u).abs_diff_eq(Vec3::splat(open), 1e-4), "{u}: {}", through(&g, u));
    }
    let albedo = g.albedo_at(2, Vec3::new(0.5, 0.25, 0.25));
    assert!(albedo.max_element() <= 0.5 && albedo.min_element() > 0.0, "{albedo}");
}

#[test]
fn glass_is_no_wall_and_no_body() {
    // A closed cube of dark glass, fronts outwards, around a point: not inside a solid, and in sight of what
    // is outside.
    let mut g = floor([Vec3::splat(0.1), Vec3::ONE], 0.5);
    g.materials.iter_mut().for_each(|m| m.two_sided = false);
    cube_facing(&mut g, false);
    for backend in Backend::built() {
        let rays = RayTracer::with_backend(&g, backend).expect("a built backend starts");
        let space = Space::new(&g, &rays).with_solids(Solids::new(&g));
        let mut counts = RayCounts::default();
        let (at, behind) = (space.receiver(&POINT).unwrap(), space.receiver_on(&POINT, true).unwrap());
        assert!(!space.is_inside(&at, &mut counts) && !space.is_hidden(&at, &behind, 10.0, &mut counts));
        let outside = SurfacePoint { triangle: 4, barycentric: Vec3::splat(1.0 / 3.0) };
        let outside = space.receiver(&outside).unwrap();
        assert!(space.sees(&at, &outside, &mut counts));
    }
    // As an opaque body it does hide.
    g.glass.clear();
    let rays = RayTracer::new(&g);
    let space = Space::new(&g, &rays).with_solids(Solids::new(&g));
    assert!(space.is_inside(&space.receiver(&POINT).unwrap(), &mut RayCounts::default()));
}

#[test]
fn a_pane_is_one_pane_where_its_triangles_meet() {
    // Straight at the diagonal of a square, in whichever direction it runs, and from both sides.
    for (u, v) in
        [(Vec3::X, Vec3::NEG_Z), (Vec3::NEG_Z, Vec3::X), (Vec3::NEG_X, Vec3::NEG_Z), (Vec3::Z, Vec3::NEG_X)]
    {
        let mut g = floor([TINT, Vec3::ONE], 0.0);
        quad(&mut g, 8.0 * Vec3::Y - 2.0 * (u + v), 4.0 * u, 4.0 * v, 1);
        let rays = RayTracer::new(&g);
        for along in [0.25, 0.5, 1.0] {
            for (height, direction) in [(4.0, Vec3::Y), (12.0, Vec3::NEG_Y)] {
                let from = (u + v) * along + Vec3::Y * height;
                assert_eq!(
                    rays.transmittance(from, direction, 6.0, u32::MAX),
                    TINT,
                    "{u} {v} {along} {direction}"
                );
                let first = rays.nearest(from, direction, u32::MAX).expect("the pane");
                let mut passed = baker::trace::rays::PassedGlass::default();
                passed.add(&first);
                assert!(
                    rays.nearest_behind(from, direction, u32::MAX, &passed).is_none_or(|hit| hit.t > 5.0)
                );
            }
        }
    }
}
