//! What a change of the scene traces again, and that nothing else changes.

use crate::scenes::Obj;
use crate::{Stage, assert_same, data};
use baker::bake::run::{Denoise, Integrator, Options, Outcome};
use dataset::store::Dataset;

/// At noon the sun shines, at night both groups.
pub const HOURS: &str = "12,21";

/// A crate on the ground; a sun, a sky and two groups: four layers. They are traced in one round: what later
/// rounds draw is allocated by all layers together, and a layer traced by itself would have other samples.
pub const SCENE: &str = r#"
[sun]
track = [{ hour = 0, direction = [0.4, 1, 0.3], irradiance = [50, 48, 45] }]
[sky]
model = "constant"
radiance = [3, 4, 5]
[[object]]
file = "a.obj"
albedo = 0.5
[[group]]
name = "porch"
on = [["18:00", "06:00"]]
[[group.sphere]]
centre = [1.2, 1, 1.1]
radius = 0.1
radiance = [8, 6, 4]
[[group]]
name = "garden"
on = [["20:00", "22:00"]]
[[group.sphere]]
centre = [-1.2, 0.6, 1]
radius = 0.1
radiance = [4, 4, 4]
[[group.rectangle]]
corner = [-1, 1.5, -1.5]
edge_u = [0.5, 0, 0]
edge_v = [0, 0, 0.5]
radiance = [2, 2, 2]
[lightmap]
size = 40
padding = 2
[bake]
samples = 2
"#;

/// A folder with its geometry.
pub fn stage() -> Stage {
    let obj = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    Stage::new(&[("a.obj", obj.mesh("crate").block([-0.5, -0.05, -0.5], [1.0, 1.05, 1.0]).bytes())])
}

/// A scene under change, baked again and again into one dataset.
struct Scene {
    stage: Stage,
    text: String,
    hours: &'static str,
    integrator: Integrator,
}

impl Scene {
    fn new(integrator: Integrator) -> Self {
        let scene = Scene { stage: stage(), text: SCENE.to_owned(), hours: HOURS, integrator };
        let (outcome, _) = scene.bake();
        assert_eq!((outcome.layers.traced, outcome.layers.reused), (4, 0));
        assert!(outcome.rays.sun > 0 && outcome.rays.lamp > 0 && outcome.rays.path > 0);
        scene
    }

    fn options(&self) -> impl FnOnce(&mut Options) {
        let integrator = self.integrator;
        move |options| options.integrator = integrator
    }

    fn bake(&self) -> (Outcome, Dataset) {
        self.stage.bake(&self.text, "set", self.hours, self.options())
    }

    /// A bake of the scene as it stands that knows of no earlier one.
    fn fresh(&self) -> Dataset {
        let (outcome, dataset) = self.stage.bake(&self.text, "fresh", self.hours, |options| {
            options.force = true;
            self.options()(options);
        });
        assert_eq!(outcome.layers.reused, 0);
        dataset
    }

    #[track_caller]
    fn change(&mut self, from: &str, to: &str) -> (Outcome, Dataset) {
        assert!(self.text.contains(from), "{from}");
        self.text = self.text.replace(from, to);
        let baked = self.bake();
        assert!(!baked.0.up_to_date);
        baked
    }

    /// A change that must trace no ray, and give what a fresh bake gives, byte for byte.
    #[track_caller]
    fn recompose(&mut self, from: &str, to: &str) {
        let before = data(&Dataset::open(&self.stage.path("set")).expect("a dataset"));
        let (outcome, dataset) = self.change(from, to);
        assert_eq!((outcome.layers.traced, outcome.layers.reused), (0, 4));
        assert_eq!(outcome.rays.rays(), 0, "{:?}", outcome.rays);
        assert!(data(&dataset) != before, "nothing changed");
        assert_same(&dataset, &self.fresh());
    }

    /// A change that must trace so many layers and keep the others.
    #[track_caller]
    fn retrace(&mut self, from: &str, to: &str, traced: usize) -> Outcome {
        let (outcome, dataset) = self.change(from, to);
        assert_eq!((outcome.layers.traced, outcome.layers.reused), (traced, 4 - traced), "{from} → {to}");
        assert!(outcome.rays.path > 0);
        let fresh = self.fresh();
        // In one round a layer does not depend on those it is traced with.
        assert_same(&dataset, &fresh);
        outcome
    }
}

const BOTH: [Integrator; 2] = [Integrator::Cached, Integrator::Path];

#[test]
fn schedules_colours_and_intensities_trace_nothing() {
    for integrator in BOTH {
        let mut scene = Scene::new(integrator);
        // A schedule: other times, other sums.
        scene.recompose("[\"18:00\", \"06:00\"]", "[\"17:30\", \"05:00\"]");
        // A colour.
        scene.recompose("[8, 6, 4]", "[3, 5, 9]");
        // The intensity of a group of two lamps.
        scene.text = scene.text.replace("[4, 4, 4]", "[12, 12, 12]");
        scene.recompose("[2, 2, 2]", "[6, 6, 6]");
    }
}

#[test]
fn one_changed_light_is_traced_alone() {
    for integrator in BOTH {
        let mut scene = Scene::new(integrator);
        // One lamp moved: its group, no sun, and of the sky nothing.
        let rays = scene.retrace("centre = [1.2, 1, 1.1]", "centre = [1.3, 1, 1.1]", 1).rays;
        assert!(rays.lamp > 0 && rays.sun == 0, "{rays:?}");
        let rays = scene.retrace("[0.4, 1, 0.3]", "[0.3, 1, 0.3]", 1).rays;
        assert!(rays.sun > 0 && rays.lamp == 0, "{rays:?}");
        let rays = scene.retrace("[3, 4, 5]", "[5, 4, 3]", 1).rays;
        assert!(rays.sun == 0 && rays.lamp == 0, "{rays:?}");
    }
}

#[test]
fn what_all_light_depends_on_traces_all() {
    let mut scene = Scene::new(Integrator::Cached);
    scene.retrace("albedo = 0.5", "albedo = 0.6", 4);
    scene.retrace("samples = 2", "samples = 32", 4);
    scene.retrace("[bake]", "[bake]\nseed = 9", 4);
    scene.retrace("size = 40", "size = 44", 4);
    // Geometry under the same name.
    let obj = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    scene.stage.write("a.obj", &obj.mesh("crate").block([-0.6, -0.05, -0.5], [1.0, 1.05, 1.0]).bytes());
    scene.retrace("[sky]", "\n[sky]", 4);
}

#[test]
fn another_hour_under_the_same_sun_traces_nothing() {
    let mut scene = Scene::new(Integrator::Cached);
    scene.hours = "10,12,21";
    let (outcome, dataset) = scene.bake();
    assert_eq!((outcome.layers.traced, outcome.layers.reused), (0, 4));
    assert_same(&dataset, &scene.fresh());
}

#[test]
fn files_written_again_as_they_were_change_nothing() {
    let scene = Scene::new(Integrator::Cached);
    let before = data(&Dataset::open(&scene.stage.path("set")).expect("a dataset"));
    // `bake` writes the scene file anew each time; the geometry too, with a date of its own.
    let obj = std::fs::read(scene.stage.path("a.obj")).expect("readable");
    scene.stage.write("a.obj", &obj);
    let file = std::fs::File::options().write(true).open(scene.stage.path("a.obj")).expect("open");
    let written = file.metadata().and_then(|m| m.modified()).expect("a date");
    let late = written + std::time::Duration::from_secs(3600);
    file.set_modified(late).expect("a date");
    let (outcome, dataset) = scene.bake();
    assert!(outcome.up_to_date && outcome.rays.rays() == 0);
    assert!(before == data(&dataset));
}

#[test]
fn layers_that_were_damaged_are_traced_again() {
    let mut scene = Scene::new(Integrator::Path);
    let folder = scene.stage.path("set").join(".layers");
    let layers = std::fs::read_dir(&folder).expect("layers").map(|e| e.expect("an entry").path());
    let layer = layers.filter(|p| p.extension().is_some_and(|e| e == "layer")).min().expect("a layer");
    let bytes = std::fs::read(&layer).expect("readable");
    std::fs::write(&layer, &bytes[..bytes.len() / 2]).expect("written");
    scene.retrace("[8, 6, 4]", "[3, 5, 9]", 1);
    // One bit is as bad.
    let mut bytes = std::fs::read(&layer).expect("readable");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x40;
    std::fs::write(&layer, bytes).expect("written");
    scene.retrace("[3, 5, 9]", "[8, 6, 4]", 1);
}

#[test]
fn denoising_is_switched_without_tracing() {
    let stage = stage();
    let bake =
        |set: &str, denoise: Denoise| stage.bake(SCENE, set, HOURS, |options| options.denoise = denoise);
    let (_, denoised) = bake("set", Denoise::Auto);
    let denoised = data(&denoised);
    let filtered = || {
        let entries = std::fs::read_dir(stage.path("set").join(".layers")).expect("layers").flatten();
        let mut files: Vec<_> = entries.map(|e| e.path()).collect();
        files.retain(|path| path.extension().is_some_and(|e| e == "filtered"));
        files.sort();
        files
    };
    assert_eq!(filtered().len(), 4);
    let (outcome, traced) = bake("set", Denoise::Off);
    assert_eq!((outcome.layers.traced, outcome.rays.rays(), filtered().len()), (0, 0, 0));
    assert!(outcome.denoised.is_none() && data(&traced) != denoised);
    assert_same(&traced, &bake("fresh", Denoise::Off).1);
    let (outcome, again) = bake("set", Denoise::Own);
    assert_eq!((outcome.layers.traced, outcome.denoised.map(|d| d.new_layers)), (0, Some(4)));
    assert!(data(&again) == denoised);
    // A filtered file that was damaged is made again, and it alone.
    let damaged = filtered().swap_remove(0);
    let mut bytes = std::fs::read(&damaged).expect("readable");
    bytes[17] ^= 1;
    std::fs::write(&damaged, bytes).expect("written");
    std::fs::remove_file(stage.path("set").join("run.json")).expect("removed");
    let (outcome, again) = bake("set", Denoise::Own);
    assert_eq!(outcome.denoised.map(|d| d.new_layers), Some(1));
    assert!(data(&again) == denoised);
}

#[test]
fn a_target_holds_under_another_light_too() {
    // All light comes from the sky; what a spot adds, around the crate, is too little to be worth samples.
    let sphere = "[[group.sphere]]\ncentre = [1.2, 1, 1.1]\nradius = 0.1\nradiance = [8, 6, 4]\n";
    let spot = "[[group.spot]]\nposition = [0.7, 0.4, 0]\ndirection = [0, -1, 0]\ninner = 40\nouter = 60\nintensity = [DIM, 0, 0]\n";
    let scene = SCENE.replace("irradiance = [50, 48, 45]", "irradiance = [0, 0, 0]").replace(sphere, spot);
    for integrator in BOTH {
        let stage = stage();
        let bake = |intensity: &str| {
            let toward = |options: &mut Options| {
                options.integrator = integrator;
                options.target_error = Some(0.04);
                options.samples = Some(1 << 14);
            };
            stage.bake(&scene.replace("DIM", intensity), "set", "21", toward).0
        };
        let is_closed = |outcome: &Outcome| outcome.rounds.last().is_some_and(|round| !round.is_missed);
        let dim = bake("0.0001");
        assert!(is_closed(&dim) && dim.layers.reused == 0, "{integrator:?}");
        // A little brighter it still is. As bright as can be, it is traced until its own error is as asked,
        // and then no more.
        let still = bake("0.0002");
        assert_eq!((still.layers.traced, still.rays.rays()), (0, 0), "{integrator:?}");
        let bright = bake("1000");
        assert!(
            bright.layers.traced > 0 && bright.samples > dim.samples,
            "{integrator:?} {:?}",
            bright.rounds
        );
        assert!(is_closed(&bright), "{integrator:?} {:?}", bright.rounds.last());
        assert_eq!(bake("1001").layers.traced, 0, "{integrator:?}");
    }
}
