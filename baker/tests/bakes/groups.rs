//! Many light groups: the light of each, and what they take.

use crate::scenes::{Case, Obj};
use crate::statistics::bakes;
use crate::{Stage, assert_same, data};
use baker::bake::run::{Integrator, Outcome};
use dataset::store::Dataset;
use std::fmt::Write;

/// A hall of 16 × 4 × 16 m with nine pillars and sixteen tables, lit by 64 small lamps in so many light
/// groups.
fn hall(groups: usize, size: usize) -> (Stage, String) {
    let mut obj = Obj::default()
        .mesh("floor")
        .floor([-8.0, 0.0, -8.0], 16.0, 16.0)
        .mesh("ceiling")
        .quad([-8.0, 4.0, -8.0], [16.0, 0.0, 0.0], [0.0, 0.0, 16.0])
        .mesh("walls")
        .quad([-8.0, 0.0, 8.0], [0.0, 0.0, -16.0], [0.0, 4.0, 0.0])
        .quad([8.0, 0.0, -8.0], [0.0, 0.0, 16.0], [0.0, 4.0, 0.0])
        .quad([-8.0, 0.0, -8.0], [16.0, 0.0, 0.0], [0.0, 4.0, 0.0])
        .quad([8.0, 0.0, 8.0], [-16.0, 0.0, 0.0], [0.0, 4.0, 0.0])
        .mesh("furniture");
    let at = |first: f64, i: usize| first + 4.0 * i as f64;
    for (i, j) in (0..16).map(|k| (k / 4, k % 4)) {
        if i < 3 && j < 3 {
            obj = obj.block([at(-4.2, i), 0.0, at(-4.2, j)], [0.4, 4.0, 0.4]);
        }
        obj = obj.block([at(-6.6, i), 0.0, at(-6.4, j)], [1.2, 0.8, 0.8]);
    }
    let mut text = "[[object]]\nfile = \"hall.obj\"\nalbedo = 0.6\n".to_owned();
    for lamp in 0..64 {
        if lamp % (64 / groups) == 0 {
            writeln!(text, "[[group]]\nname = \"g{lamp}\"").unwrap();
        }
        let (x, z) = (-7 + 2 * (lamp as i32 % 8), -7 + 2 * (lamp as i32 / 8));
        let light = "radius = 0.06\nradiance = [100, 90, 70]";
        writeln!(text, "[[group.sphere]]\ncentre = [{x}, 3, {z}]\n{light}").unwrap();
    }
    writeln!(text, "[lightmap]\nsize = {size}\n[bake]\nsamples = 64").unwrap();
    (Stage::new(&[("hall.obj", obj.bytes())]), text)
}

/// The error the layers of a bake tell, relative to the mean light of each: its root mean square.
fn error_of_layers(dataset: &Dataset) -> f64 {
    // Of each texel: its mean (3 × f32) and standard error (3 × bf16), and two bytes of nothing; then a
    // checksum.
    let float = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let brief = |b: &[u8]| f64::from(f32::from_le_bytes([0, 0, b[0], b[1]]));
    let (mut squares, mut layers) = (0.0, 0.0);
    for entry in std::fs::read_dir(dataset.root.join(".layers")).expect("kept layers") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|e| e == "layer") {
            let bytes = std::fs::read(&path).expect("readable");
            let texels: Vec<&[u8]> = bytes[..bytes.len() - 32].chunks_exact(20).collect();
            let mean = texels.iter().map(|t| float(&t[4..8])).sum::<f64>() / texels.len() as f64;
            let square = texels.iter().map(|t| brief(&t[14..16]).powi(2)).sum::<f64>() / texels.len() as f64;
            (squares, layers) = (squares + square / (mean * mean), layers + 1.0);
        }
    }
    f64::sqrt(squares / layers)
}

/// Bakes the hall, prints a row of the table in `NUMERICS.md`, and gives its rays per texel but for those
/// that find the points of texels, and the error of its layers.
fn row(groups: usize, size: usize, integrator: Integrator) -> (Outcome, f64, f64) {
    let (stage, text) = hall(groups, size);
    let (outcome, dataset) = stage.bake(&text, "hall", "22", |o| o.integrator = integrator);
    let rays = outcome.rays;
    let per_texel = |n: u64| n as f64 / outcome.texels as f64;
    let error = error_of_layers(&dataset);
    println!(
        "| {groups}, {integrator:?} | {:.0} | {:.0} | {:.0} | {:.1} % | {:.2} % |",
        per_texel(rays.path),
        per_texel(rays.lamp),
        per_texel(rays.bright_surface),
        100.0 * error,
        100.0 * outcome.rounds.last().and_then(|round| round.frame_errors[0]).unwrap_or(0.0),
    );
    let all = per_texel(rays.rays() - rays.inside);
    (outcome, all, error)
}

#[test]
fn rays_grow_little_with_the_number_of_light_groups() {
    let cached = |groups| row(groups, 64, Integrator::Cached);
    let ((_, one, _), (eight, of_eight, error_of_eight)) = (cached(1), cached(8));
    let (many, of_many, error_of_many) = cached(32);
    // Four times as many groups take less than twice as many rays, and the noise of their layers is less than
    // twice that of eight.
    assert!(of_many < 2.0 * of_eight && of_many < 5.0 * one, "{one} {of_eight} {of_many}");
    assert!(error_of_many < 2.0 * error_of_eight, "{error_of_eight} {error_of_many}");
    // A group by itself takes four trial samples and four of each half at every texel, and more where samples
    // differ, and a look at its bright surfaces with every path.
    let per_group = |rays: u64, outcome: &Outcome| rays as f64 / outcome.texels as f64 / 32.0;
    assert!(per_group(many.rays.lamp, &many) < 20.0, "{:?}", many.rays);
    assert!(per_group(many.rays.bright_surface, &many) < 8.0, "{:?}", many.rays);
    assert!(many.rays.bright_surface > 0 && eight.rays.lamp > 0);
    // Paths ask eight of them where they are reflected.
    let [of_eight, of_many] = [8, 32].map(|groups| row(groups, 32, Integrator::Path).1);
    assert!(of_many < 1.5 * of_eight, "{of_eight} {of_many}");
}

/// A room with twelve lights close to its walls, one of them a glowing panel, and a screen without texels:
/// all in groups of their own, or with the first and the panel apart and all others in one. The first shines
/// alone at 1 h, the panel at 2 h, all at 3 h.
fn room(groups: usize) -> Case {
    let room = Obj::default()
        .mesh("room")
        .floor([-2.0, 0.0, -2.0], 4.0, 4.0)
        .quad([-2.0, 2.5, -2.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.0])
        .quad([-2.0, 0.0, 2.0], [0.0, 0.0, -4.0], [0.0, 2.5, 0.0])
        .quad([2.0, 0.0, -2.0], [0.0, 0.0, 4.0], [0.0, 2.5, 0.0])
        .quad([-2.0, 0.0, -2.0], [4.0, 0.0, 0.0], [0.0, 2.5, 0.0])
        .quad([2.0, 0.0, 2.0], [-4.0, 0.0, 0.0], [0.0, 2.5, 0.0]);
    let screen = Obj::default().mesh("screen").quad([-0.6, 0.0, 0.4], [1.2, 0.0, 0.3], [0.0, 1.8, 0.0]);
    let panel = Obj::default().mesh("panel").quad([1.2, 1.2, -1.2], [0.0, 0.0, 0.5], [0.0, 0.3, 0.1]);
    let mut text = "[[object]]\nfile = \"room.obj\"\nalbedo = [0.5, 0.6, 0.4]\n\
        [[object]]\nfile = \"screen.obj\"\nalbedo = 0.6\nlightmap = false\ntwo_sided = true\n\
        [[object]]\nfile = \"panel.obj\"\nalbedo = 0\nlightmap = false\nemission = [9, 9, 9]\ngroup = \"panel\"\n\
        [[group]]\nname = \"panel\"\non = [[\"01:30\", \"24:00\"]]\n"
        .to_owned();
    for lamp in 0..11 {
        match lamp {
            0 => {
                text += "[[group]]\nname = \"first\"\non = [[\"00:00\", \"01:30\"], [\"02:30\", \"24:00\"]]\n"
            }
            _ if lamp == 1 || groups > 3 => {
                writeln!(text, "[[group]]\nname = \"g{lamp}\"\non = [[\"02:30\", \"24:00\"]]").unwrap();
            }
            _ => {}
        }
        // Around the walls, 15 cm from them.
        let (along, height) = (-1.6 + f64::from(lamp % 4) * 1.05, 0.8 + 0.1 * f64::from(lamp % 3));
        let [x, z] = [[along, -1.85], [along, 1.85], [-1.85, along]][(lamp / 4) as usize];
        let light = format!("radius = 0.04\nradiance = [{}, 90, 70]", 60 + 5 * lamp);
        writeln!(text, "[[group.sphere]]\ncentre = [{x}, {height}, {z}]\n{light}").unwrap();
    }
    text += "[lightmap]\nsize = 40\n";
    let files = [("room.obj", room.bytes()), ("screen.obj", screen.bytes()), ("panel.obj", panel.bytes())];
    Case { stage: Stage::new(&files), text, hours: "1,2,3" }
}

#[test]
fn each_of_many_light_groups_has_the_light_it_has_among_few() {
    let (few, many) = (room(3), room(12));
    for integrator in [Integrator::Path, Integrator::Cached] {
        let of = |case, first| bakes(case, first, 16, |o| o.integrator = integrator);
        let (few, many) = (of(&few, 1), of(&many, 101));
        let what = format!("twelve groups, {integrator:?}");
        let lit = many.outcomes.iter().all(|o| o.rays.lamp > 0 && o.layers.traced == 12);
        assert!(lit && few.outcomes.iter().all(|o| o.layers.traced == 3));
        if integrator == Integrator::Cached {
            // Bright surfaces are looked at in both.
            assert!([&few, &many].iter().all(|b| b.outcomes.iter().all(|o| o.rays.bright_surface > 1000)));
        }
        many.expect_texels_of(&few, &what);
        many.expect_mean_of(&few, &what);
        let told = many.honesty();
        println!("{what}: told ÷ true variance {told:.3}");
        assert!(crate::golden::HONEST.contains(&told), "{what}: {told}");
    }
}

#[test]
fn many_light_groups_are_relit_without_a_ray_and_one_is_traced_alone() {
    let Case { stage, mut text, hours } = room(12);
    text += "[bake]\nsamples = 8\n";
    let bake = |text: &str| stage.bake(text, "set", hours, |_| {});
    let (first, before) = bake(&text);
    assert_eq!(first.layers.traced, 12);
    let before = data(&before);
    // A colour, and the schedule of all but two.
    let text =
        text.replace("radiance = [90, 90, 70]", "radiance = [9, 30, 70]").replace("[\"02:30\"", "[\"02:20\"");
    let (outcome, after) = bake(&text);
    assert_eq!((outcome.layers.traced, outcome.rays.rays()), (0, 0));
    assert!(before != data(&after));
    // One lamp moved: its layer alone, by samples that are all its own.
    let moved = text.replace("centre = [-1.6, 0.8, -1.85]", "centre = [-1.6, 0.9, -1.85]");
    assert!(moved != text);
    let outcome = bake(&moved).0;
    assert_eq!((outcome.layers.traced, outcome.layers.reused), (1, 11));
    assert!(outcome.rays.lamp > 0);
}

#[test]
fn any_number_of_threads_gives_many_light_groups_the_same_bytes() {
    for integrator in [Integrator::Path, Integrator::Cached] {
        let Case { stage, text, hours } = room(12);
        let text = text + "[bake]\nsamples = 16\n";
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let set = format!("by-{threads}");
            pool.install(|| stage.bake(&text, &set, hours, |o| o.integrator = integrator).1)
        };
        assert_same(&by(1), &by(3));
    }
}
