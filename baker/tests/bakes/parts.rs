//! Which part of a light is baked: all of it, what surfaces reflect, or nothing.

use crate::scenes::Obj;
use crate::{Stage, data};
use baker::bake::run::{Denoise, Integrator, Options, Outcome};
use dataset::image::Image;
use dataset::store::Dataset;

const HOURS: &str = "12,21";

/// A floor between two walls, a black panel that shines down on it, a sphere, a portal to a bright sky, a
/// sun: a layer of each kind. They are traced in one round, so that the samples of one do not depend on the
/// light of others.
const SCENE: &str = r#"
[sun]
track = [{ hour = 0, direction = [0.4, 1, 0.3], irradiance = [50, 48, 45] }]
SUN
[sky]
model = "constant"
radiance = [3, 4, 5]
SKY
[[portal]]
corner = [-1, 2, -1]
edge_u = [2, 0, 0]
edge_v = [0, 0, 2]
[[object]]
file = "a.obj"
albedo = 0.5
[[object.part]]
name = "panel"
albedo = 0
emission = [6, 5, 4]
group = "panel"
[[group]]
name = "panel"
on = [["18:00", "23:00"]]
PANEL
[[group]]
name = "bulb"
on = [["20:00", "22:00"]]
BULB
[[group.sphere]]
centre = [-1.2, 0.6, 1]
radius = 0.1
radiance = [4, 4, 4]
[lightmap]
size = 48
[bake]
samples = 2
BOUNCES
"#;

/// The scene with a line for each of its placeholders; those that are not told are left out.
fn scene(lines: &[(&str, &str)]) -> String {
    let mut text = SCENE.to_owned();
    for (place, line) in lines {
        assert!(text.contains(place), "{place}");
        text = text.replacen(place, line, 1);
    }
    let kept = text.lines().filter(|line| !["SUN", "SKY", "PANEL", "BULB", "BOUNCES"].contains(line));
    kept.map(|line| format!("{line}\n")).collect()
}

fn stage() -> Stage {
    let obj = Obj::default()
        .mesh("ground")
        .floor([-2.0, 0.0, -2.0], 4.0, 4.0)
        .mesh("walls")
        .block([-2.0, -0.05, -2.0], [0.3, 1.5, 4.0])
        .block([0.5, -0.05, -1.0], [1.0, 1.05, 0.3])
        .mesh("panel")
        .quad([0.2, 0.7, 0.2], [0.8, 0.0, 0.0], [0.0, 0.0, 0.8]);
    Stage::new(&[("a.obj", obj.bytes())])
}

fn maps(dataset: &Dataset) -> Vec<Image> {
    (0..dataset.config.frames.len()).map(|set| dataset.map(set, 0).expect("a map")).collect()
}

fn bake(stage: &Stage, text: &str, set: &str, integrator: Integrator) -> (Outcome, Dataset) {
    stage.bake(text, set, HOURS, |options: &mut Options| {
        (options.integrator, options.denoise) = (integrator, Denoise::Off);
    })
}

const ALL: &[(&str, &str)] = &[];
const INDIRECT: &[(&str, &str)] = &[
    ("SUN", "baked = \"indirect\""),
    ("SKY", "baked = \"indirect\""),
    ("PANEL", "baked = \"indirect\""),
    ("BULB", "baked = \"indirect\""),
];

/// What is left out is what a bake without reflections has: not more, not less, in no set and at no texel.
#[test]
fn all_light_is_what_comes_straight_and_what_surfaces_reflect() {
    let stage = stage();
    let path = |text: &str, set| {
        let dataset = bake(&stage, text, set, Integrator::Path).1;
        (maps(&dataset), dataset.mask(0).unwrap().valid)
    };
    let (all, valid) = path(&scene(ALL), "all");
    let (indirect, same) = path(&scene(INDIRECT), "indirect");
    let (straight, lit) = path(&scene(&[("BOUNCES", "bounces = 0")]), "straight");
    assert_eq!(valid, same);
    // (Where nothing comes straight from a light, a bake without reflections has copies of the texels
    // around.)
    let compared: Vec<usize> = (0..lit.len()).filter(|&texel| lit[texel] && valid[texel]).collect();
    assert!(10 * compared.len() > 9 * valid.iter().filter(|valid| **valid).count());
    for ((all, indirect), straight) in all.iter().zip(&indirect).zip(&straight) {
        let most = all.texels.iter().flatten().copied().fold(0.0, f32::max);
        for (&texel, channel) in compared.iter().flat_map(|texel| [(texel, 0), (texel, 1), (texel, 2)]) {
            let [all, indirect, straight] = [all, indirect, straight].map(|map| map.texels[texel][channel]);
            assert!((all - indirect - straight).abs() <= 1e-4 * most, "{all} - {indirect} - {straight}");
        }
        assert!(compared.iter().any(|&texel| indirect.texels[texel][1] > 0.0));
    }
}

/// Suns and groups are kept in two parts, so that another choice of them takes no ray, and the first one
/// gives back its bytes.
#[test]
fn another_choice_for_sun_and_groups_traces_nothing() {
    for integrator in [Integrator::Cached, Integrator::Path] {
        let stage = stage();
        let (outcome, dataset) = bake(&stage, &scene(ALL), "set", integrator);
        assert_eq!((outcome.layers.traced, outcome.layers.reused), (4, 0));
        let (all, before, mask) = (data(&dataset), maps(&dataset), dataset.mask(0).unwrap());
        for (place, group) in [("SUN", None), ("PANEL", Some(0)), ("BULB", Some(1))] {
            let (outcome, dataset) =
                bake(&stage, &scene(&[(place, "baked = \"indirect\"")]), "set", integrator);
            assert_eq!((outcome.layers.traced, outcome.rays.rays()), (0, 0), "{place}");
            assert_eq!(dataset.mask(0).unwrap().valid, mask.valid, "{place}");
            let is_less = |(a, b): (&Image, &Image)| {
                let pairs = a.texels.iter().flatten().zip(b.texels.iter().flatten());
                assert!(pairs.clone().all(|(a, b)| b - a <= 1e-4), "{place}");
                pairs.fold(false, |less, (a, b)| less | (a > b))
            };
            let less: Vec<bool> = before.iter().zip(&maps(&dataset)).map(is_less).collect();
            // The sun shines at all hours of this scene.
            let shines = |groups_on: &[bool]| group.is_none_or(|group: usize| groups_on[group]);
            let sets = dataset.config.frames.iter();
            assert_eq!(less, sets.map(|set| shines(&set.groups_on)).collect::<Vec<_>>(), "{place}");
        }
        let (outcome, dataset) = bake(&stage, &scene(ALL), "set", integrator);
        assert_eq!(outcome.rays.rays(), 0);
        assert!(data(&dataset) == all);
    }
}

/// `--indirect` says of the sun what its key says.
#[test]
fn the_option_is_the_key_of_the_sun() {
    let stage = stage();
    let sun = scene(&[("SUN", "baked = \"indirect\"")]);
    let (_, key) = bake(&stage, &sun, "key", Integrator::Path);
    let (_, option) = stage.bake(&scene(ALL), "option", HOURS, |options: &mut Options| {
        (options.integrator, options.indirect) = (Integrator::Path, true);
        options.denoise = Denoise::Off;
    });
    assert!(data(&key) == data(&option));
}

/// What is not baked is not traced: no ray, no layer, and the maps of a scene without it.
#[test]
fn what_is_not_baked_is_not_traced() {
    let stage = stage();
    let none = |places: &[&'static str]| {
        let lines: Vec<_> = places.iter().map(|&place| (place, "baked = \"none\"")).collect();
        bake(&stage, &scene(&lines), "set", Integrator::Cached)
    };
    let (outcome, dataset) = none(&["PANEL", "BULB"]);
    assert_eq!((outcome.rays.lamp, outcome.layers.traced), (0, 2));
    // The game has these groups, the dataset has neither them nor their switches.
    assert!(dataset.config.groups.is_empty());
    assert_eq!(outcome.hours, [12.0, 21.0]);
    let (_, dataset) = none(&["PANEL"]);
    let names: Vec<_> = dataset.config.groups.iter().map(|group| group.name.as_str()).collect();
    assert_eq!(names, ["bulb"]);
    assert!(dataset.config.frames.iter().all(|set| set.groups_on == [20.0 < set.hour && set.hour < 22.0]));
    let (outcome, _) = none(&["SUN"]);
    assert_eq!(outcome.rays.sun, 0);
    let (outcome, dataset) = none(&["SUN", "SKY", "PANEL", "BULB"]);
    assert_eq!((outcome.layers.traced, outcome.layers.reused), (0, 0));
    assert!(maps(&dataset).iter().all(|map| map.texels.iter().flatten().all(|&value| value == 0.0)));
}

/// An open plane gets nothing from light of which only what surfaces reflect is baked, and all of its texels
/// are valid.
#[test]
fn nothing_reflects_light_to_an_open_plane() {
    let plane = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    let stage = Stage::new(&[("a.obj", plane.bytes())]);
    for integrator in [Integrator::Cached, Integrator::Path] {
        let text = scene(INDIRECT).replace(
            "[[object.part]]\nname = \"panel\"\nalbedo = 0\nemission = [6, 5, 4]\ngroup = \"panel\"\n",
            "",
        );
        let (_, dataset) = bake(&stage, &text, "set", integrator);
        assert!(maps(&dataset).iter().all(|map| map.texels.iter().flatten().all(|&value| value == 0.0)));
        let (_, whole) = bake(&stage, &text.replace("\"indirect\"", "\"all\""), "whole", integrator);
        assert_eq!(dataset.mask(0).unwrap(), whole.mask(0).unwrap());
    }
}
