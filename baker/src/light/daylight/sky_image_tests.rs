//! Tests of sky pictures: where each texel hangs, and what lies between.

use super::*;

fn map(width: usize, rotation: f64, texels: Vec<[f32; 3]>) -> ImageMap {
    let image = Image { width, height: width / 2, texels };
    ImageMap::new(&SkyImage {
        file: "sky.exr".into(),
        scale: 1.0,
        rotation,
        blake3: String::new(),
        radiance: Arc::new(image),
    })
}

#[test]
fn the_map_is_its_own_inverse() {
    for turn in [0.0, 1.0, -4.0] {
        let frame = LatLong { turn };
        for i in 0..50 {
            for j in 0..50 {
                let at = DVec2::new((f64::from(i) + 0.5) / 50.0, (f64::from(j) + 0.5) / 50.0);
                assert!((frame.square_of(frame.direction_of(at)) - at).length() < 1e-12);
            }
        }
        for pole in [DVec3::Y, DVec3::NEG_Y] {
            assert!(frame.square_of(pole).is_finite());
        }
    }
}

/// Eight columns numbered from 0, four rows of tens: each texel's middle is found where the conventions put
/// it.
#[test]
fn texels_hang_where_they_should() {
    let texels: Vec<[f32; 3]> = (0..32).map(|i| [(i % 8) as f32, (i / 8) as f32 * 10.0, 1.0]).collect();
    for (rotation, shift) in [(0.0, 0.0), (90.0, 90.0), (-360.0, 0.0)] {
        let map = map(8, rotation, texels.clone());
        for (i, texel) in texels.iter().enumerate() {
            // Clockwise from −Z: the left edge looks to +Z.
            let azimuth = ((i % 8) as f64 + 0.5) * 45.0 - 180.0 + shift;
            let (sin, cos) = azimuth.to_radians().sin_cos();
            let polar = ((i / 8) as f64 + 0.5) / 4.0 * PI;
            let d = DVec3::new(polar.sin() * sin, polar.cos(), -polar.sin() * cos);
            let found = map.radiance(d.as_vec3());
            assert!((found - Vec3::from_array(*texel)).length() < 1e-4, "{rotation} {i}: {found}");
        }
    }
    // The middle looks to −Z: between columns 3 and 4, rows 1 and 2; across the seam between 7 and 0; the
    // poles are the end rows.
    let map = map(8, 0.0, texels);
    assert!((map.radiance(Vec3::NEG_Z) - Vec3::new(3.5, 15.0, 1.0)).length() < 1e-4);
    assert!((map.radiance(Vec3::Z) - Vec3::new(3.5, 15.0, 1.0)).length() < 1e-4);
    assert!((map.radiance(Vec3::X) - Vec3::new(5.5, 15.0, 1.0)).length() < 1e-4);
    assert!(map.radiance(Vec3::Y).y == 0.0 && map.radiance(Vec3::NEG_Y).y == 30.0);
    assert!(!map.is_black());
}

#[test]
fn two_texels_are_a_sky() {
    let map = map(2, 45.0, vec![[1.0; 3], [3.0; 3]]);
    for d in [Vec3::X, Vec3::Y, Vec3::NEG_Y, Vec3::new(0.6, 0.0, -0.8)] {
        let value = map.radiance(d).x;
        assert!((1.0..=3.0).contains(&value), "{value}");
    }
}

/// The table tells every hour the same picture.
#[test]
fn the_table_holds_the_picture() {
    let image = Image { width: 2, height: 1, texels: vec![[1.0, 2.0, 3.0]; 2] };
    let sky = crate::scene::Sky::Image(SkyImage {
        file: "sky.exr".into(),
        scale: 1.0,
        rotation: 0.0,
        blake3: String::new(),
        radiance: Arc::new(image),
    });
    let table = crate::light::daylight::sky::SkyTable::new(Some(&sky), None, &[3.0, 12.0]);
    assert_eq!(table.lit, [0, 1]);
    let mut out = [Rgb::ONE; 2];
    table.add(Vec3::NEG_Y, Rgb::splat(2.0), &mut out);
    assert!((out[0] - Rgb::new(3.0, 5.0, 7.0)).length() < 1e-5 && out[0] == out[1]);
}
