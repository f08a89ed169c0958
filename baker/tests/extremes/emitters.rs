//! Lamps and emissive surfaces: tiny, touching, buried, many.

use crate::common::closed::{ball, level_rectangle};
use crate::common::mesh::Obj;
use crate::common::{Baked, Stage, green, mean};
use baker::bake::run::Integrator;
use glam::{DVec3, dvec3};
use std::f64::consts::PI;
use std::fmt::Write;

/// A floor of side 1 m around the origin, black.
fn floor() -> Stage {
    Stage::new(&[("a.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text())])
}

const BLACK: &str = "[[object]]\nfile = \"a.obj\"\nalbedo = 0\n";

#[test]
fn a_ball_of_a_tenth_of_a_millimetre_gives_its_lumens() {
    // Φ/(4 π² d²)·π cos θ = Φ cos θ/(4 π d²), whatever the radius.
    let lamp = dvec3(0.1, 0.8, -0.2);
    for radius in ["1e-4", "1e-6"] {
        let scene = format!(
            "{BLACK}[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0.1, 0.8, -0.2]\nradius = {radius}\n\
             lumens = 800\nkelvin = 6500\n[lightmap]\nsize = 16\n"
        );
        let read = |b: &Baked| {
            // The luminance of the lamp's colour is 0.8 klm.
            let image = b.first();
            let luminance =
                |t: [f32; 3]| 0.2126 * f64::from(t[0]) + 0.7152 * f64::from(t[1]) + 0.0722 * f64::from(t[2]);
            let texels = b.on("floor");
            let point = |p: DVec3| {
                let to = lamp - p;
                0.8 / (4.0 * PI) * to.y / to.length().powi(3)
            };
            let light: f64 = texels.iter().map(|t| luminance(image.texels[t.index])).sum();
            light / texels.iter().map(|t| t.average(point)).sum::<f64>()
        };
        floor().measure("12", 16, &scene, read).expect(1.0, 2e-3);
    }
}

#[test]
fn a_rectangle_of_a_tenth_of_a_millimetre_gives_its_closed_form() {
    let scene = format!(
        "{BLACK}[[group]]\nname = \"lamp\"\n[[group.rectangle]]\ncorner = [0.1, 0.5, 0.1]\nedge_u = [1e-4, 0, 0]\n\
         edge_v = [0, 0, 1e-4]\nradiance = [1e8, 1e8, 1e8]\n[lightmap]\nsize = 16\n"
    );
    let read = |b: &Baked| {
        let factor = |p: DVec3| {
            let to = dvec3(0.10005, 0.5, 0.10005) - p;
            1e8 * 1e-8 * to.y * to.y / to.length().powi(4)
        };
        b.ratio(&b.first(), &b.on("floor"), |t| t.average(factor))
    };
    floor().measure("12", 16, &scene, read).expect(1.0, 2e-3);
}

/// A floor under an emissive square of side `size` metres, `height` metres up, that looks down with radiance
/// 1/size².
fn under_a_glowing_square(size: f64, height: f64, samples: u32) -> (f64, f64, f64) {
    let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0);
    let stage = Stage::new(&[("a.obj", obj.mesh("glow").ceiling(dvec3(0.0, height, 0.0), size).text())]);
    let radiance = 1.0 / (size * size);
    let scene = format!(
        "{BLACK}[[object.part]]\nname = \"glow\"\nlightmap = false\nemission = [{radiance:?}, {radiance:?}, {radiance:?}]\n\
         group = \"lamp\"\n[[group]]\nname = \"lamp\"\n[lightmap]\nsize = 16\n"
    );
    let half = size / 2.0;
    let read = |b: &Baked| {
        let factor = |p: DVec3| {
            PI * radiance * level_rectangle(-half - p.x, half - p.x, -half - p.z, half - p.z, height)
        };
        let texels: Vec<_> = b.covered("floor").into_iter().filter(|t| t.whole).collect();
        b.ratio(&b.first(), &texels, |t| t.average(factor))
    };
    let measured = stage.measure("12", samples, &scene, read);
    (measured.mean, measured.sigma, 1.0)
}

#[test]
fn a_glowing_surface_gives_its_closed_form() {
    let (mean, sigma, expected) = under_a_glowing_square(0.5, 0.5, 64);
    crate::common::Measured { mean, sigma }.expect(expected, 0.01);
}

#[test]
fn a_glowing_surface_of_a_tenth_of_a_millimetre_gives_its_closed_form() {
    let (mean, sigma, expected) = under_a_glowing_square(1e-4, 0.5, 64);
    crate::common::Measured { mean, sigma }.expect(expected, 0.01);
}

#[test]
fn what_stands_close_before_a_glowing_surface_keeps_its_light_back() {
    // A sign thirty metres up, and a larger sheet two millimetres in front of it: less than 1/10,000 of the
    // way.
    let quad = |name: &str, half: f64, height: f64| {
        // Its front looks down.
        let (u, v) = (DVec3::X * (2.0 * half), DVec3::Z * (2.0 * half));
        Obj::default().mesh(name).quad(dvec3(-half, height, -half), u, v).text()
    };
    let light = |sheet: &str| {
        let files = [
            ("floor.obj", Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text()),
            ("sign.obj", quad("sign", 1.0, 30.0)),
            ("sheet.obj", quad("sheet", 2.0, 29.998)),
        ];
        let scene = format!(
            "[[object]]\nfile = \"floor.obj\"\nalbedo = 0\n[[object]]\nfile = \"sign.obj\"\nalbedo = 0\nlightmap = false\n\
             emission = [5, 5, 5]\ngroup = \"sign\"\n[[group]]\nname = \"sign\"\n{sheet}[lightmap]\nsize = 16\n"
        );
        let baked = Stage::new(&files).bake("12", 64, &scene);
        mean(&baked.first(), &baked.covered("floor"))
    };
    let sheet =
        |more: &str| format!("[[object]]\nfile = \"sheet.obj\"\nalbedo = 0\nlightmap = false\n{more}");
    let open = light("");
    assert!(open > 0.01, "{open}");
    let glass = light(&sheet("transmission = 0.25\ntwo_sided = true\n"));
    assert!((glass / open - 0.25).abs() < 1e-3, "{glass} of {open}");
    let opaque = light(&sheet("two_sided = true\n"));
    assert_eq!(opaque, 0.0);
}

#[test]
fn a_ball_that_touches_the_floor_gives_it_half_its_light() {
    // All the light that goes down lands on an endless floor; on a disc of radius a, all but R/√(a² + R²) of
    // it: ∫ π L R³/(r² + R²)^{3/2} dA.
    let (radius, radiance) = (0.05f64, 2.0);
    let scene = format!(
        "{BLACK}[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0, {radius}, 0]\nradius = {radius}\n\
         radiance = [2, 2, 2]\n[lightmap]\nsize = 64\n"
    );
    let read = |b: &Baked| {
        let expected = |p: DVec3| radiance * ball(dvec3(0.0, radius, 0.0), radius, p, DVec3::Y);
        b.ratio(&b.first(), &b.on("floor"), |t| t.average(expected))
    };
    floor().measure("12", 16, &scene, read).expect(1.0, 5e-3);
    // At the contact it fills the sky: no texel has more than π L.
    let most = floor().bake("12", 64, &scene).first().texels.iter().map(|t| t[1]).fold(0.0, f32::max);
    assert!(f64::from(most) <= radiance * PI * 1.0001 && f64::from(most) > radiance * 2.0, "{most}");
}

#[test]
fn a_tiny_ball_that_touches_the_floor_is_right_beside_the_contact() {
    // R = 10⁻⁴ m under texels of 2 cm: the contact's own texel holds half of all light within 10⁻⁷ of its
    // area, which no affordable number of points finds; it stays finite and below π L, and the others have
    // their closed form.
    let radius = 1e-4f64;
    let scene = format!(
        "{BLACK}[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0.0011, {radius:?}, 0.0013]\nradius = {radius:?}\n\
         radiance = [1e6, 1e6, 1e6]\n[lightmap]\nsize = 64\n"
    );
    let centre = dvec3(0.0011, radius, 0.0013);
    let read = |b: &Baked| {
        let texels: Vec<_> =
            b.on("floor").into_iter().filter(|t| (t.centre() - centre).length() > 0.05).collect();
        b.ratio(&b.first(), &texels, |t| t.average(|p| 1e6 * ball(centre, radius, p, DVec3::Y)))
    };
    // The points that see it are held off the floor by some 10⁻⁶ m, near 1 % of its height.
    let measured = floor().measure("12", 16, &scene, read);
    assert!((measured.mean - 1.0).abs() < 0.015 && measured.sigma < 5e-3, "{measured:?}");
    let baked = floor().bake("12", 64, &scene);
    assert!(baked.first().texels.iter().all(|t| f64::from(t[1]) <= 1e6 * PI * 1.00001));
}

#[test]
fn a_ball_half_sunk_in_the_floor_lights_it_from_above_only() {
    // Its upper half: closed form of a ball cut by the horizon is not needed; the floor outside sees half of
    // it, level: the irradiance is below that of the whole ball at that place and above nothing; inside the
    // ball's footprint it is π L.
    let scene = format!(
        "{BLACK}[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0, 0, 0]\nradius = 0.2\nradiance = [1, 1, 1]\n\
         [lightmap]\nsize = 32\n"
    );
    let baked = floor().bake("12", 1024, &scene);
    let image = baked.first();
    for texel in baked.on("floor") {
        let away = texel.centre().length();
        let light = green(&image, texel);
        if away < 0.2 - texel.size() {
            assert!((light / PI - 1.0).abs() < 0.02, "{away}: {light}");
        } else if away > 0.2 + texel.size() {
            // The part of the ball above the plane of a receiver at distance d: σ = asin(R/d), half of the
            // disc seen edge on: E/L = σ − sin σ cos σ (a half disc centred on the horizon: ∫ sin θ dω).
            let half = |p: DVec3| {
                let sigma = (0.2 / p.length()).min(1.0).asin();
                sigma - sigma.sin() * sigma.cos()
            };
            let expected = texel.average(half);
            assert!((light / expected - 1.0).abs() < 0.1, "{away}: {light}, expected {expected}");
        }
    }
}

#[test]
fn a_lamp_inside_a_wall_gives_nothing() {
    // Balls, a panel and a spot inside a wall 20 cm thick: exactly no light on either side. The wall stands
    // at places 3.7 mm apart, over a little more than a texel of the floor: at some of them a texel reaches
    // into the wall by less than a tenth of its width.
    for step in 0..24 {
        let z = 0.0037 * f64::from(step) - 0.04;
        let obj = Obj::default().mesh("floor").floor(DVec3::ZERO, 2.0);
        let obj = obj.mesh("wall").block(dvec3(-1.5, -0.1, z - 0.1), dvec3(1.5, 2.0, z + 0.1));
        let stage = Stage::new(&[("a.obj", obj.text())]).by(Integrator::Path);
        let scene = format!(
            "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\n[[group]]\nname = \"lamp\"\n\
             [[group.sphere]]\ncentre = [0, 0.5, {z}]\nradius = 0.05\nradiance = [1e6, 1e6, 1e6]\n\
             [[group.sphere]]\ncentre = [0.5, 0.5, {}]\nradius = 1e-4\nradiance = [1e6, 1e6, 1e6]\n\
             [[group.rectangle]]\ncorner = [-0.5, 0.5, {}]\nedge_u = [0, -0.3, 0]\nedge_v = [-0.3, 0, 0]\n\
             radiance = [1e6, 1e6, 1e6]\n[[group.spot]]\nposition = [0, 1, {z}]\ndirection = [0, -1, 1]\ninner = 60\n\
             outer = 80\nintensity = [1e6, 1e6, 1e6]\n[lightmap]\nsize = 64\n",
            z + 0.0999,
            z + 0.05,
        );
        let baked = stage.bake("12", 64, &scene);
        assert!(baked.on("floor").len() > 100, "wall at {z}");
        let worst = baked.group("lamp").texels.iter().map(|t| t[1]).fold(0.0, f32::max);
        assert_eq!(worst, 0.0, "wall at {z}");
    }
}

/// Powers of four orders of magnitude, heights of one: centres and radiances, and the scene's group.
pub fn lamps() -> (Vec<(DVec3, f64)>, String) {
    let mut scene = "[[group]]\nname = \"lamps\"\n".to_owned();
    let mut lamps = Vec::new();
    for i in 0..500 {
        // The additive recurrences of the plastic number: evenly spread.
        let part = |k: f64| (0.5 + f64::from(i) * k).fract();
        let (x, z) = (4.0 * part(0.7548776662) - 2.0, 4.0 * part(0.5698402909) - 2.0);
        let (y, power) = (0.3 + 2.0 * part(0.6180339887), 10f64.powf(4.0 * part(0.4142135623) - 2.0));
        lamps.push((dvec3(x, y, z), power));
        writeln!(
            scene,
            "[[group.sphere]]\ncentre = [{x}, {y}, {z}]\nradius = 0.02\nradiance = [{power:?}, {power:?}, {power:?}]"
        )
        .unwrap();
    }
    (lamps, scene)
}

#[test]
fn five_hundred_lamps_give_the_sum_of_their_closed_forms() {
    let (lamps, groups) = lamps();
    let scene = format!("{BLACK}{groups}[lightmap]\nsize = 16\n");
    let read = |b: &Baked| {
        let sum = |p: DVec3| lamps.iter().map(|&(c, l)| l * ball(c, 0.02, p, DVec3::Y)).sum();
        b.ratio(&b.first(), &b.on("floor"), |t| t.average(sum))
    };
    floor().measure("12", 64, &scene, read).expect(1.0, 0.01);
}
