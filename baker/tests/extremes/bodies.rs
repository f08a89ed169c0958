//! Two-sided bodies with faces that look into them: each of those has the same verdict in every instance.

use crate::common::Stage;
use crate::common::mesh::Obj;
use glam::{DAffine3, DQuat, DVec3, EulerRot, dvec3};
use std::collections::BTreeMap;

/// Radius and half the thickness of a coin in metres, and half the width of the post on it.
const RADIUS: f64 = 1.0;
const HALF: f64 = 0.2;
const POST: f64 = 0.2;
/// How far the post reaches into the coin: rounding must leave no gap between them.
const SUNK: f64 = 0.01;

/// A coin with a rim and a lower face that are there twice, turned out and in, and on it a post of sheets
/// without a bottom.
fn coin() -> String {
    const SIDES: usize = 12;
    let at = |i: usize, y: f64| {
        let (sin, cos) = (i as f64 / SIDES as f64 * std::f64::consts::TAU).sin_cos();
        dvec3(RADIUS * cos, y, -RADIUS * sin)
    };
    let top: Vec<DVec3> = (0..SIDES).map(|i| at(i, HALF)).collect();
    let mut faces: Vec<Vec<DVec3>> = vec![(0..SIDES).rev().map(|i| at(i, -HALF)).collect()];
    faces.extend((0..SIDES).map(|i| vec![at(i, -HALF), at(i + 1, -HALF), at(i + 1, HALF), at(i, HALF)]));
    let twice = |obj: Obj, face: &Vec<DVec3>| {
        let inwards: Vec<DVec3> = face.iter().rev().copied().collect();
        obj.polygon(face).polygon(&inwards)
    };
    let coin = faces.iter().fold(Obj::default().mesh("coin").polygon(&top), twice);
    coin.sides(dvec3(-POST, HALF - SUNK, -POST), dvec3(POST, HALF + 0.3, POST), false, &[0, 1, 3, 4, 5])
        .text()
}

/// A place: scale, degrees about X, Y and Z, and where.
type Place = ([f64; 3], [f64; 3], [f64; 3]);

fn world_from_coin(&(scale, degrees, place): &Place) -> DAffine3 {
    let [x, y, z] = degrees.map(f64::to_radians);
    // About X, then Y, then Z.
    let turned = DQuat::from_euler(EulerRot::ZYX, z, y, x);
    DAffine3::from_scale_rotation_translation(DVec3::from(scale), turned, DVec3::from(place))
}

/// Bakes coins at these places above a ground. Gives of every coin the verdicts on its texels by what they
/// are of: how many are valid, and how many are not.
fn verdicts(places: &[Place]) -> Vec<BTreeMap<&'static str, [usize; 2]>> {
    let instance = |(scale, rotate, translate): &Place| {
        format!("{{ scale = {scale:?}, rotate = {rotate:?}, translate = {translate:?} }}")
    };
    let instances: Vec<String> = places.iter().map(instance).collect();
    let scene = format!(
        "[sun]\ntrack = [{{ hour = 8, direction = [2, 1, 0.3], irradiance = [90, 90, 90] }}, \
         {{ hour = 16, direction = [-1, 1, -0.5], irradiance = [90, 90, 90] }}]\nvisibility = \"off\"\n\
         [sky]\nmodel = \"constant\"\nradiance = [2, 2, 2]\n\
         [[object]]\nfile = \"ground.obj\"\nalbedo = 0.5\ndensity = 0.1\n\
         [[object]]\nfile = \"coin.obj\"\nalbedo = 0.5\ntwo_sided = true\ninstances = [{}]\n\
         [lightmap]\ntexels_per_metre = 8\n",
        instances.join(", ")
    );
    let ground = Obj::default().mesh("ground").floor(DVec3::Y * -8.0, 60.0).text();
    let baked = Stage::new(&[("ground.obj", ground), ("coin.obj", coin())]).bake("8,16", 8, &scene);
    let hours = [8.0, 16.0].map(|hour| baked.at(hour));
    let mut found = vec![BTreeMap::new(); places.len()];
    for texel in baked.texels.iter().filter(|texel| texel.name.contains("coin")) {
        let is_black = hours.iter().all(|image| image.texels[texel.index] == [0.0; 3]);
        assert!(!(texel.valid && is_black), "black but valid: {texel:?}");
        let away = |place: &Place| texel.centre().distance_squared(DVec3::from(place.2));
        let nearest = (0..places.len()).min_by(|&a, &b| away(&places[a]).total_cmp(&away(&places[b])));
        let nearest = nearest.expect("a coin");
        let world_from_coin = world_from_coin(&places[nearest]);
        let at = world_from_coin.inverse().transform_point3(texel.centre());
        let side = (world_from_coin.matrix3.transpose() * texel.normal).normalize();
        let beside = at.x.abs().max(at.z.abs());
        let what = if at.y > HALF + 1e-4 {
            continue;
        } else if side.dot(at * dvec3(1.0, 9.0, 1.0)) < 0.0 {
            "inwards"
        } else if side.y > 0.9 && beside < POST - 0.09 {
            "under the post"
        } else if side.y > 0.9 && beside < POST + 0.09 {
            continue;
        } else {
            "outwards"
        };
        found[nearest].entry(what).or_insert([0; 2])[usize::from(!texel.valid)] += 1;
    }
    found
}

#[test]
fn what_looks_into_a_two_sided_body_is_valid_in_no_instance() {
    let random = |i: usize, k: usize| ((i * 7 + k * 13 + 5) * 2654435761 % 1000) as f64 / 1000.0;
    // Fourteen turned in all ways; then some mirrored, stretched and scaled.
    let place =
        |i: usize| ([4.0 * (i % 4) as f64, 0.5 * random(i, 9), 4.0 * (i / 4) as f64]).map(|x| x - 7.3);
    let turned = |i: usize| [0, 1, 2].map(|k| (360.0 * random(i, k)).round());
    let alike: Vec<Place> = (0..14).map(|i| ([1.0; 3], turned(i), place(i).map(|x| x + 5.0))).collect();
    let scales = [[-1.0, 1.0, 1.0], [1.0, -1.3, 1.3], [0.7, 0.7, -0.7], [-1.2, -1.2, -1.2], [1.5, 1.0, 1.2]];
    let scaled: Vec<Place> = (0..5).map(|i| (scales[i], turned(i), place(i).map(|x| x + 5.0))).collect();
    for places in [alike, scaled] {
        for (verdicts, place) in verdicts(&places).iter().zip(&places) {
            let of = |what: &str| verdicts.get(what).copied().unwrap_or_default();
            let ([inwards, hidden], [covered, beneath]) = (of("inwards"), of("under the post"));
            assert!(inwards == 0 && hidden > 100, "{place:?}: {verdicts:?}");
            assert!(covered == 0 && beneath > 0, "{place:?}: {verdicts:?}");
            // (Those under the edges of what stands on them may lie within it.)
            let [seen, lost] = of("outwards");
            assert!(seen > 200 && 20 * lost < seen, "{place:?}: {verdicts:?}");
        }
    }
}

/// A room of two-sided sheets that face outwards, as modellers export houses, under sun and sky; a small
/// window leaves its floor a ten-thousandth of the light outside. All of it is valid.
#[test]
fn a_dim_room_of_two_sided_sheets_is_valid() {
    let (low, high) = (dvec3(-2.5, 0.0, -2.5), dvec3(2.5, 2.6, 2.5));
    // All sides but +x, which has a window of 10 cm.
    let walls = Obj::default().mesh("walls").sides(low, high, false, &[0, 2, 3, 4, 5]);
    let strip = |obj: Obj, y: [f64; 2], z: [f64; 2]| {
        obj.quad(dvec3(2.5, y[0], z[1]), DVec3::NEG_Z * (z[1] - z[0]), DVec3::Y * (y[1] - y[0]))
    };
    let walls = strip(walls, [0.0, 1.2], [-2.5, 2.5]);
    let walls = strip(walls, [1.3, 2.6], [-2.5, 2.5]);
    let walls = strip(walls, [1.2, 1.3], [-2.5, -0.05]);
    let walls = strip(walls, [1.2, 1.3], [0.05, 2.5]);
    let floor = Obj::default().mesh("floor").floor(dvec3(0.0, 0.01, 0.0), 4.6).text();
    let ground = Obj::default().mesh("ground").floor(DVec3::Y * -0.5, 60.0).text();
    let scene = "[sun]\ntrack = [{ hour = 12, direction = [-1, 2, 0.3], irradiance = [80, 80, 80] }]\nvisibility = \"off\"\n\
                 [sky]\nmodel = \"constant\"\nradiance = [4, 4, 4]\n\
                 [[object]]\nfile = \"ground.obj\"\nalbedo = 0.3\n\
                 [[object]]\nfile = \"walls.obj\"\nalbedo = 0.5\ntwo_sided = true\nlightmap = false\n\
                 [[object]]\nfile = \"floor.obj\"\nalbedo = 0.5\n[lightmap]\nsize = 64\n";
    let files = [("ground.obj", ground), ("walls.obj", walls.text()), ("floor.obj", floor)];
    let baked = Stage::new(&files).bake("12", 32, scene);
    let floor = baked.covered("floor");
    let valid = floor.iter().filter(|texel| texel.valid).count();
    assert!(floor.len() > 20 && 20 * valid >= 19 * floor.len(), "{valid} of {} are valid", floor.len());
    let image = baked.at(12.0);
    let mean =
        floor.iter().map(|texel| f64::from(image.texels[texel.index][1])).sum::<f64>() / floor.len() as f64;
    assert!((1e-4..1.0).contains(&mean), "{mean}");
}
