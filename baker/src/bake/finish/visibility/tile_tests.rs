use super::*;
use crate::geometry::{Geometry, Material};
use crate::scene::{Sun, SunKey, SunTrack};
use crate::surface::SurfacePoint;
use crate::trace::paths::path::{point_pair, sun_sample};
use crate::trace::paths::{Sample, Sequence, SequenceKind};
use crate::trace::rays::RayTracer;
use glam::{DVec3, Vec2, Vec3};

/// A floor of 16 × 2 squares of 0.1 m from x = 1 on, and a wall of 1 m height that stands across x = 0
/// (triangles 2 and 3).
fn scene() -> Geometry {
    let mut geometry = Geometry::default();
    let mut quad = |corners: [[f32; 3]; 4]| {
        let base = geometry.positions.len() as u32;
        geometry.positions.extend(corners.map(Vec3::from));
        geometry.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        geometry.material_of.extend([0, 0]);
    };
    quad([[1.0, 0.0, 0.0], [1.0, 0.0, 0.2], [2.6, 0.0, 0.2], [2.6, 0.0, 0.0]]);
    quad([[0.0, 0.0, -9.0], [0.0, 1.0, -9.0], [0.0, 1.0, 9.0], [0.0, 0.0, 9.0]]);
    geometry.normals = geometry.positions.iter().map(|p| if p.x > 0.0 { Vec3::Y } else { Vec3::X }).collect();
    geometry.uvs = vec![Vec2::ZERO; geometry.positions.len()];
    geometry.lightmap_uvs = geometry.uvs.clone();
    geometry.materials.push(Material {
        albedo: Vec3::splat(0.5),
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: true,
        emission: None,
    });
    geometry
}

/// A sun that rises behind the wall from the horizon to the zenith, from 6 to 12 h.
fn rising(disc_angle: f64) -> Sun {
    let key = |step: u32| {
        let elevation = f64::from(step).to_radians();
        let direction = DVec3::new(-elevation.cos(), elevation.sin(), 0.0);
        SunKey { hour: 6.0 + f64::from(step) / 15.0, direction, irradiance: DVec3::splat(100.0) }
    };
    Sun { disc_angle, track: SunTrack::Authored((0..=90).map(key).collect()) }
}

/// The random numbers of a texel's points.
fn samples() -> [Sample; 32] {
    let sequence = Sequence::new(1, SequenceKind::Texel, 7, 14);
    std::array::from_fn(|i| sequence.sample(i as u32))
}

/// The texels of the floor, or of its front row alone.
fn visibility_samplers(space: &Space, texels: usize) -> Vec<Option<VisibilitySampler>> {
    let of_texel = |texel: usize| {
        let at = |(i, sample): (usize, Sample)| {
            let place = (Vec2::new((texel % 16) as f32, (texel / 16) as f32) + point_pair(sample))
                / Vec2::new(16.0, 2.0);
            let (x, z) = (place.x, place.y);
            // The floor's corners: 0 (0, 0), 1 (0, 1), 2 (1, 1), 3 (1, 0).
            let (triangle, barycentric) =
                if z > x { (0, Vec3::new(1.0 - z, z - x, x)) } else { (1, Vec3::new(1.0 - x, z, x - z)) };
            Some((space.receiver(&SurfacePoint { triangle, barycentric })?, i))
        };
        VisibilitySampler::new(samples().into_iter().enumerate().filter_map(at).collect())
    };
    (0..texels).map(of_texel).collect()
}

fn planes(times: &VisibilityTimes, texels: usize) -> (Planes, RayCounts) {
    let geometry = scene();
    let rays = RayTracer::new(&geometry);
    let space = Space::new(&geometry, &rays);
    let suns = suns_at(times, &samples().map(sun_sample));
    let traced = vec![None; times.hours.len()];
    let visibility_samplers = visibility_samplers(&space, texels);
    Tile { width: 16, visibility_samplers, traced, times, suns: &suns, space: &space }.planes(255)
}

#[test]
fn a_shadow_passes_each_texel_when_it_should() {
    for minutes in [15.0, 2.5] {
        let times = VisibilityTimes::new(&rising(0.0), None, [6.0, 12.0], minutes);
        let (planes, counts) = planes(&times, 32);
        for texel in 0..32 {
            let near = 1.0 + 0.1 * (texel % 16) as f64;
            for (time, hour) in times.hours.iter().enumerate() {
                // The wall's shadow ends where the sun stands over it: at x = 1 ÷ tan(elevation).
                let elevation = ((hour - 6.0) * 15.0).to_radians();
                let lit = ((near + 0.1 - 1.0 / elevation.tan()) / 0.1).clamp(0.0, 1.0);
                let found = f64::from(planes.level(texel, time)[0]) / 255.0;
                // (32 points; and what lies on a line between times is within the change that is not asked
                // after.)
                assert!((found - lit).abs() < 0.12, "texel {texel} at {hour}: {found}, expected {lit}");
            }
        }
        assert!(counts.visibility > 0);
    }
}

#[test]
fn few_rays_are_traced_where_nothing_changes() {
    // Keys by the minute are times of level 0; a course without keys in between shows what refinement saves.
    let key = |hour: f64, x: f64| SunKey {
        hour,
        direction: DVec3::new(x, 1.0, 0.2).normalize(),
        irradiance: DVec3::ONE,
    };
    let still = Sun { disc_angle: 0.5, track: SunTrack::Authored(vec![key(8.0, 0.5), key(16.0, 0.6)]) };
    let times = VisibilityTimes::new(&still, None, [8.0, 16.0], 2.5);
    let (planes, counts) = planes(&times, 32);
    assert!(planes.levels.iter().all(|level| *level == 255));
    // Each quarter of eight hours, and the last; eight points each; no time between.
    assert_eq!((times.hours.len(), counts.visibility), (8 * 24 + 1, 32 * (8 * 4 + 1) * 8));
}

#[test]
fn a_wide_disc_is_seen_in_part() {
    // Of a disc of 40° that rises over the wall's edge as a texel far behind it sees it, half is seen when
    // its centre stands there.
    let times = VisibilityTimes::new(&rising(40.0), None, [6.0, 12.0], 15.0);
    let (planes, _) = planes(&times, 16);
    let edge = (1.0f64 / 2.05).atan().to_degrees();
    let hour = 6.0 + edge / 15.0;
    let near = dataset::format::Between::new(&times.hours, hour);
    let level = |time: usize| f32::from(planes.level(10, time)[0]) / 255.0;
    let found = near.lerp(level(near.before), level(near.after));
    // By the cosine: the middle of the upper half stands 4 ÷ 3π of the disc's radius above the centre.
    let share =
        0.5 * (edge + 20.0 * 4.0 / (3.0 * std::f64::consts::PI)).to_radians().sin() / edge.to_radians().sin();
    assert!((f64::from(found) - share).abs() < 0.05, "{found}, expected {share}");
}

#[test]
fn what_is_unknown_lies_between_or_holds() {
    let hours = [6.0, 7.0, 8.0, 9.0, 10.0];
    let known = |values: [Option<u8>; 5]| values.map(|value| value.map(|v| [v; 3]));
    let of = |values| filled(&known(values), &hours).iter().map(|value| value[0]).collect::<Vec<u8>>();
    assert_eq!(of([None, Some(40), None, Some(80), None]), [40, 40, 40, 80, 80]);
    assert_eq!(of([None; 5]), [0; 5]);
    assert_eq!(of([Some(1), Some(2), Some(3), Some(4), Some(5)]), [1, 2, 3, 4, 5]);
}
