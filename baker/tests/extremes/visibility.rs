//! The sun's visibility as a function of time, read from the files of whole bakes.

use crate::common::closed::disc_over_plane;
use crate::common::mesh::Obj;
use crate::common::texels::Texel;
use crate::common::{Baked, Stage, mean};
use baker::bake::run::{Options, Outcome, bake};
use baker::light::times::schedule::parse_hours;
use dataset::format::{Between, Light, MOST_TIMES, Planes};
use dataset::image::Image;
use dataset::observe::Silent;
use dataset::store::{Dataset, Sunlight};
use glam::{DVec3, dvec3};
use std::fs;
use std::path::{Path, PathBuf};

/// What the one tile of a page shows.
struct Curves {
    hours: Vec<f64>,
    top: f64,
    planes: Planes,
    light: Sunlight,
}

impl Curves {
    fn new(dataset: &Dataset) -> Self {
        let light = dataset.sunlight(0).expect("whole files").expect("a visibility");
        assert_eq!(light.visibility.tiles.len(), 1);
        let planes = light.visibility.tile(0).expect("a tile");
        Curves { hours: light.visibility.hours.clone(), top: f64::from(light.visibility.top), planes, light }
    }

    /// Red, green and blue at a texel.
    fn rgb(&self, texel: &Texel, hour: f64) -> [f64; 3] {
        let between = Between::new(&self.hours, hour);
        let [a, b] = [between.before, between.after].map(|time| self.planes.level(texel.index, time));
        let value = |c: usize| f64::from(between.lerp(f32::from(a[c]), f32::from(b[c]))) / self.top;
        let value = [0, 1, 2].map(value);
        assert!(value.iter().all(|v| (0.0..=1.0).contains(v)), "{value:?}");
        value
    }

    fn at(&self, texel: &Texel, hour: f64) -> f64 {
        self.rgb(texel, hour)[1]
    }

    fn mean(&self, texels: &[&Texel], hour: f64) -> f64 {
        texels.iter().map(|texel| self.at(texel, hour)).sum::<f64>() / texels.len() as f64
    }
}

/// Texels that lie wholly on the surfaces of this name, whatever light they have.
fn whole<'a>(baked: &'a Baked, name: &str) -> Vec<&'a Texel> {
    let found: Vec<&Texel> = baked.covered(name).into_iter().filter(|texel| texel.whole).collect();
    assert!(!found.is_empty(), "{:?}", baked.outcome.facts);
    found
}

/// A sun of irradiance 10 along keys of hour and the tangent, towards +x, of its distance from the zenith.
/// Between two keys of one distance either side of noon that tangent is linear in time.
fn sun(minutes: &str, keys: &[(f64, f64)]) -> String {
    let key = |(hour, tangent): &(f64, f64)| {
        format!("{{ hour = {hour:?}, direction = [{tangent:?}, 1.0, 0.0], irradiance = [10, 10, 10] }}")
    };
    let keys: Vec<String> = keys.iter().map(key).collect();
    format!("[sun]\ndisc_angle = 0\nvisibility = \"{minutes}\"\ntrack = [{}]\n", keys.join(", "))
}

/// The tangent from −1 at 6 h to 1 at 18 h.
const DAY: [(f64, f64); 2] = [(6.0, -1.0), (18.0, 1.0)];

fn tangent(hour: f64) -> f64 {
    (hour - 12.0) / 6.0
}

/// A black floor, and two-sided sheets over it that have no texels.
fn scene(sun: &str, size: u32) -> String {
    format!(
        "{sun}[[object]]\nfile = \"floor.obj\"\nalbedo = 0\n[[object]]\nfile = \"sheets.obj\"\nalbedo = 0\nlightmap = false\n\
         two_sided = true\n[lightmap]\nsize = {size}\n"
    )
}

/// A floor of this side, and level strips from one x to another at a height, `slant` further on at z = 1 than
/// at 0.
fn strips(side: f64, height: f64, slant: f64, strips: &[[f64; 2]]) -> Stage {
    const FAR: f64 = 5.0;
    let mut sheets = Obj::default().mesh("sheets");
    for [from, to] in strips {
        let at = |x: f64, z: f64| dvec3(x + slant * z, height, z);
        sheets = sheets.polygon(&[at(*from, FAR), at(*to, FAR), at(*to, -FAR), at(*from, -FAR)]);
    }
    over(side, sheets)
}

/// A floor of this side under sheets.
fn over(side: f64, sheets: Obj) -> Stage {
    let floor = Obj::default().mesh("floor").floor(DVec3::ZERO, side).text();
    Stage::new(&[("floor.obj", floor), ("sheets.obj", sheets.text())])
}

/// Of a level interval on the floor, the part from which the sun stands behind a strip, at this tangent.
fn hidden([from, to]: [f64; 2], height: f64, tangent: f64, strips: &[[f64; 2]]) -> f64 {
    let shadow = |strip: &[f64; 2]| {
        let [a, b] = strip.map(|x| x - height * tangent);
        (b.min(to) - a.max(from)).max(0.0)
    };
    strips.iter().map(shadow).sum::<f64>() / (to - from)
}

/// From where to where a texel reaches along x.
fn reach(texel: &Texel) -> [f64; 2] {
    let (x, half) = (texel.centre().x, texel.size() / 2.0);
    [x - half, x + half]
}

/// Bakes into a folder of its own, and what was kept there is used.
fn keeping(stage: &Stage, set: &str, hours: &str, scene: &str) -> (Outcome, Dataset) {
    stage.write("case.toml", format!("{scene}[bake]\nsamples = 4\n").as_bytes());
    let out = stage.path(set);
    let options = Options { out: Some(out.clone()), ..Options::new(parse_hours(hours).expect("hours")) };
    let outcome = bake(&stage.path("case.toml"), &options, &Silent).expect("baked");
    (outcome, Dataset::open(&out).expect("a dataset"))
}

/// The bytes of a dataset's visibility and normals.
fn files(dataset: &Dataset) -> Vec<Vec<u8>> {
    let visibility = dataset.config.visibility.as_ref().expect("a visibility");
    visibility.references().map(|file| fs::read(dataset.path(file)).expect("readable")).collect()
}

/// The kept tiles below a folder.
fn kept_tiles(folder: &Path) -> Vec<PathBuf> {
    let entries: Vec<PathBuf> =
        fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path()).collect();
    let below = entries.iter().filter(|path| path.is_dir()).flat_map(|path| kept_tiles(path));
    let here = entries.iter().filter(|path| path.extension().is_some_and(|e| e == "tile")).cloned();
    let mut found: Vec<PathBuf> = here.chain(below).collect();
    found.sort();
    found
}

#[test]
fn a_wire_thinner_than_a_texel_takes_its_share() {
    // Slanted, so that it crosses texels everywhere; its shadow is as wide all day. Where the first points of
    // a texel all pass it, no more look, and less than half a level counts as nothing: of a wire of a
    // twentieth most is lost, but never more found than there is.
    for (width, least, most) in [(0.3, 0.75, 1.2), (0.05, 0.0, 1.1)] {
        let step = 1.0 / 30.0;
        let wire = [[-width * step / 2.0, width * step / 2.0]];
        for minutes in ["15min", "2.5min"] {
            let baked = strips(1.0, 0.5, 0.4, &wire).bake("8..17", 16, &scene(&sun(minutes, &DAY), 32));
            let curves = Curves::new(&baked.dataset);
            let texels = whole(&baked, "floor");
            let across = (texels.len() as f64).sqrt() * texels[0].size();
            let expected = width * step / across;
            let mut found = Vec::new();
            for hour in [9.0, 10.25, 10.37, 11.5, 12.0, 12.91, 13.66] {
                found.push((1.0 - curves.mean(&texels, hour)) / expected);
            }
            println!("{width} of a texel, {minutes}: {found:.3?}");
            assert!(
                found.iter().all(|share| (least..=most).contains(share)),
                "{width}, {minutes}: {found:?}"
            );
        }
    }
}

#[test]
fn blinds_of_twenty_slats_let_their_share_through() {
    // Slats that lean by 45° towards the morning: their shadows are the narrower the later it is.
    const PITCH: f64 = 0.05;
    const WIDE: f64 = 0.03;
    let mut sheets = Obj::default().mesh("sheets");
    for i in -10..10 {
        let (low, high) = (dvec3(PITCH * f64::from(i), 0.2, -5.0), dvec3(WIDE, WIDE, 0.0));
        sheets = sheets.quad(low, high, DVec3::Z * 10.0);
    }
    for (minutes, bound) in [("15min", 0.05), ("2.5min", 0.05)] {
        let stage = over(0.4, Obj::clone(&sheets));
        let baked = stage.bake("9..16", 16, &scene(&sun(minutes, &DAY), 8));
        let curves = Curves::new(&baked.dataset);
        let texels = whole(&baked, "floor");
        assert!(texels[0].size() > PITCH);
        let mut off = Vec::new();
        for hour in [9.0, 9.4, 10.5, 11.77, 12.0, 12.7, 13.37, 14.9] {
            let open = 1.0 - WIDE * (1.0 - tangent(hour)).abs() / PITCH;
            off.push(curves.mean(&texels, hour) - open);
        }
        println!("{minutes}: {off:.3?}");
        assert!(off.iter().all(|off| off.abs() < bound), "{minutes}: {off:?}");
    }
}

/// Root mean square and count of transitions of a small floor's texels under a comb of posts, by the minute.
fn comb(minutes: &str, pitch: f64) -> (f64, f64, f64) {
    let posts: Vec<[f64; 2]> =
        (-40..40).map(|i| [pitch * f64::from(i), pitch * (f64::from(i) + 0.5)]).collect();
    let baked = strips(0.2, 1.0, 0.0, &posts).bake("6..19", 16, &scene(&sun(minutes, &DAY), 16));
    let curves = Curves::new(&baked.dataset);
    let texels = whole(&baked, "floor");
    let times: Vec<f64> = (0..=12 * 60).map(|minute| 6.0 + f64::from(minute) / 60.0).collect();
    let transitions = |v: &[f64]| v.windows(2).filter(|w| (w[0] < 0.5) != (w[1] < 0.5)).count() as f64;
    let (mut square, mut found, mut wanted) = (0.0, 0.0, 0.0);
    for texel in &texels {
        let truth: Vec<f64> =
            times.iter().map(|hour| 1.0 - hidden(reach(texel), 1.0, tangent(*hour), &posts)).collect();
        let seen: Vec<f64> = times.iter().map(|hour| curves.at(texel, *hour)).collect();
        square += truth.iter().zip(&seen).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / times.len() as f64;
        found += transitions(&seen);
        wanted += transitions(&truth);
    }
    let n = texels.len() as f64;
    ((square / n).sqrt(), found / n, wanted / n)
}

#[test]
fn a_comb_of_posts_passes_over_a_texel() {
    for pitch in [0.08, 0.097] {
        for minutes in ["15min", "2.5min"] {
            let (rms, found, wanted) = comb(minutes, pitch);
            println!("pitch {pitch}, {minutes}: rms {rms:.3}, {found:.1} transitions of {wanted:.1}");
            // A post and the gap behind it take 29 or 35 minutes: quarters of an hour show that something
            // passes, and not when.
            let (most, missed) = if minutes == "15min" { (0.4, 0.12) } else { (0.06, 0.01) };
            assert!(rms < most && (found - wanted).abs() <= missed * wanted, "{rms}, {found} of {wanted}");
        }
    }
}

#[test]
fn visibility_that_stays_takes_few_rays() {
    // Glass of 0.37, and strips far finer than a texel that are open by 0.37.
    let pane = Obj::default().mesh("sheets").floor(dvec3(0.0, 0.5, 0.0), 8.0);
    for minutes in ["15min", "2.5min"] {
        let glazed = scene(&sun(minutes, &DAY), 16).replace("two_sided = true", "transmission = 0.37");
        let baked = over(1.0, pane.clone()).bake("8..17", 16, &glazed);
        let curves = Curves::new(&baked.dataset);
        let texels = whole(&baked, "floor");
        for (texel, hour) in texels.iter().flat_map(|t| curves.hours.iter().map(move |h| (t, *h))) {
            assert!((curves.at(texel, hour) - 0.37).abs() <= 0.5 / curves.top + 1e-6, "{texel:?} at {hour}");
        }
        // Nine hours, by 2.5 minutes their quarters, eight points of each texel.
        let rays = baked.outcome.rays.visibility;
        let times = if minutes == "15min" { 9 } else { 8 * 4 + 1 };
        let most = times * 8 * baked.mask.count() as u64;
        println!("{minutes}: {rays} rays of {most}");
        assert!(rays > 0 && rays <= most, "{rays} rays, {most} at most");
    }
    let (pitch, step) = (0.0071, 1.0 / 15.0);
    let grating: Vec<[f64; 2]> =
        (-300..300).map(|i| [pitch * f64::from(i), pitch * (f64::from(i) + 0.63)]).collect();
    let baked = strips(1.0, 0.5, 0.37, &grating).bake("10..15", 16, &scene(&sun("2.5min", &DAY), 16));
    let curves = Curves::new(&baked.dataset);
    let texels = whole(&baked, "floor");
    assert!(texels[0].size() > 0.9 * step);
    let hours = [10.0, 10.3, 11.0, 11.71, 12.5, 13.9, 14.0];
    let off: Vec<f64> = hours.iter().map(|hour| curves.mean(&texels, *hour) - 0.37).collect();
    let every = |hour: &f64| texels.iter().map(|t| (curves.at(t, *hour) - 0.37).abs()).fold(0.0, f64::max);
    let worst = hours.iter().map(every).fold(0.0, f64::max);
    println!("grating: {off:.3?}, one texel {worst:.3}");
    assert!(off.iter().all(|off| off.abs() < 0.02) && worst < 0.25, "{off:?}, one texel {worst}");
}

#[test]
fn a_minute_of_sun_is_found_where_the_track_says_so_and_missed_between_the_times() {
    // Behind a roof that ends at tangent 0.5, but for the minute that keys at its ends and in its middle
    // make.
    let minute = 1.0 / 60.0;
    let keys = [(6.0, -0.2), (9.1, -0.2), (9.1 + minute / 2.0, 0.8), (9.1 + minute, -0.2), (18.0, -0.2)];
    let roof = [[-4.0, 0.5]];
    for minutes in ["15min", "2.5min"] {
        let baked = strips(0.1, 1.0, 0.0, &roof).bake("6..19", 16, &scene(&sun(minutes, &keys), 4));
        let curves = Curves::new(&baked.dataset);
        for texel in whole(&baked, "floor") {
            let at = |hour: f64| curves.at(texel, hour);
            assert_eq!((at(9.1), at(9.1 + minute / 2.0), at(9.1 + minute)), (0.0, 1.0, 0.0));
            assert!((0..24).all(|hour| at(f64::from(hour)) == 0.0));
        }
    }
    // A slit far above that the sun passes in one minute: what lies between two times that are always asked
    // for (hours, by 2.5 minutes their quarters) is not found; on one of them it is, and seems to last as
    // long as a line to the times beside it.
    let slit = |middle: f64| {
        let [from, to] = [middle - minute / 2.0, middle + minute / 2.0].map(|hour| 100.0 * tangent(hour));
        [[-300.0, from], [to, 300.0]]
    };
    for (minutes, middle, lasts) in [
        ("15min", 10.1, 0.0),
        ("2.5min", 10.1, 0.0),
        ("2.5min", 10.0, 2.5),
        ("15min", 10.0, 15.0),
        ("2.5min", 10.25, 2.5),
        ("2.5min", 10.125, 0.0),
    ] {
        let baked = strips(0.01, 100.0, 0.0, &slit(middle)).bake("6..19", 16, &scene(&sun(minutes, &DAY), 4));
        let curves = Curves::new(&baked.dataset);
        for texel in whole(&baked, "floor") {
            let seen = (0..7200).map(|i| curves.at(texel, 6.0 + f64::from(i) / 600.0)).sum::<f64>() / 10.0;
            assert!((seen - lasts).abs() < 0.01, "{minutes}, {middle}: {seen} min");
        }
    }
}

#[test]
fn a_track_that_jumps_turns_back_or_stands_still() {
    let edge = [[0.0, 4.0]];
    // It jumps at noon by 3.6 seconds: from before the roof to behind it.
    let keys = [(6.0, -0.8), (12.0, -0.4), (12.001, 0.4), (18.0, 0.8)];
    for minutes in ["15min", "2.5min"] {
        let baked = strips(0.2, 1.0, 0.0, &edge).bake("8..17", 16, &scene(&sun(minutes, &keys), 8));
        let curves = Curves::new(&baked.dataset);
        let texels = whole(&baked, "floor");
        let seen: Vec<f64> =
            [8.0, 11.99, 12.0, 12.001, 12.01, 16.0].map(|hour| curves.mean(&texels, hour)).to_vec();
        assert_eq!(seen, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        let light = |hour: f64| mean(&curves.light.at(hour).unwrap(), &texels);
        let exact = 10.0 / (1.0f64 + 0.16).sqrt();
        assert!((light(12.0) / exact - 1.0).abs() < 1e-4 && light(12.001) == 0.0, "{}", light(12.0));
    }
    // It turns back at noon: the afternoon is the morning backwards.
    let keys = [(6.0, -0.5), (12.0, 0.5), (18.0, -0.5)];
    let baked = strips(0.5, 1.0, 0.3, &edge).bake("6..19", 16, &scene(&sun("2.5min", &keys), 16));
    let curves = Curves::new(&baked.dataset);
    let (mut changed, mut differ) = (0, 0);
    for (texel, step) in whole(&baked, "floor").into_iter().flat_map(|t| (0..=144).map(move |i| (t, i))) {
        let before = f64::from(step) / 24.0;
        let [a, b] = [12.0 - before, 12.0 + before].map(|hour| curves.at(texel, hour));
        assert!((a - b).abs() < 1.5 / curves.top, "{texel:?} {before} h from noon: {a} {b}");
        changed += usize::from(a > 0.0 && a < 1.0);
        differ += usize::from((a - b).abs() > 1e-6);
    }
    println!("turned back: {differ} differ of {changed} in part");
    assert!(changed > 500 && differ * 50 < changed, "{differ} of {changed}");
    // It stands still: no more times are asked for than the first.
    let stands = |minutes: &str| {
        let keys = [(0.0, 0.1)];
        let baked = strips(0.5, 1.0, 0.3, &edge).bake("6..19", 16, &scene(&sun(minutes, &keys), 16));
        let curves = Curves::new(&baked.dataset);
        for (texel, hour) in
            whole(&baked, "floor").iter().flat_map(|t| curves.hours.iter().map(move |h| (t, *h)))
        {
            assert_eq!(curves.at(texel, hour), curves.at(texel, 6.0));
        }
        baked.outcome.rays.visibility
    };
    let (coarse, fine) = (stands("15min"), stands("2.5min"));
    println!("standing still: {coarse} rays, {fine} rays");
    // (By 2.5 minutes twice as many points look where not all see the same.)
    assert!(coarse > 0 && (coarse..=2 * coarse).contains(&fine), "{coarse} {fine}");
}

#[test]
fn two_edges_that_cross_within_two_minutes() {
    // A gap in a roof whose light passes each point in two minutes, and moves by five texels in an hour.
    let width = tangent(12.0 + 2.0 / 60.0);
    let gap = [[-4.0, 0.0], [width, 4.0]];
    for minutes in ["15min", "2.5min"] {
        let baked = strips(1.0, 1.0, 0.3, &gap).bake("10..15", 16, &scene(&sun(minutes, &DAY), 32));
        let curves = Curves::new(&baked.dataset);
        let texels = whole(&baked, "floor");
        let across = (texels.len() as f64).sqrt() * texels[0].size();
        let share = |hour: f64| curves.mean(&texels, hour) * across / width;
        let of = |hours: &[f64]| hours.iter().map(|hour| share(*hour)).collect::<Vec<f64>>();
        let (hours, halves) = (of(&[11.0, 12.0, 13.0]), of(&[10.5, 11.5, 12.5]));
        let between = of(&[10.8, 11.27, 11.77, 12.19, 12.61]);
        println!("{minutes}: {hours:.3?} at the hours, {halves:.3?} half past, {between:.3?} between");
        // (A bar of light of a sixth of a texel: what is less than an eighth of one is lost in part, as of a
        // wire.)
        let all = [hours, halves, between].concat();
        assert!(all.iter().all(|share| (0.55..1.1).contains(share)), "{minutes}: {all:?}");
    }
}

#[test]
fn pages_of_few_texels() {
    let empty = strips(1.0, 1.0, 0.0, &[[30.0, 31.0]]);
    let message = empty.refusal("8..17", &scene(&sun("15min", &DAY), 1));
    assert!(message.contains("size 1 x 1") && message.contains("at least 2 x 2"), "{message}");
    for (strip, expected) in [([30.0, 31.0], 1.0), ([-9.0, 9.0], 0.0)] {
        let baked = strips(1.0, 1.0, 0.0, &[strip]).bake("8..17", 16, &scene(&sun("15min", &DAY), 2));
        let curves = Curves::new(&baked.dataset);
        assert_eq!((baked.mask.width, baked.mask.height), (2, 2));
        let texels = baked.covered("floor");
        assert!(!texels.is_empty());
        for (texel, hour) in texels.iter().flat_map(|t| curves.hours.iter().map(move |h| (t, *h))) {
            assert_eq!(curves.at(texel, hour), expected);
        }
    }
    // The edge of a roof stands over the middle of the page at noon.
    let baked = strips(1.0, 1.0, 0.0, &[[0.0, 9.0]]).bake("8..17", 16, &scene(&sun("2.5min", &DAY), 2));
    let curves = Curves::new(&baked.dataset);
    let is_surface = |i: &usize| curves.light.normals.normals[*i] != [0.0; 3];
    let seen: Vec<f32> =
        (0..4).filter(is_surface).map(|i| curves.light.at(12.0).unwrap().texels[i][1]).collect();
    println!("2 x 2 at noon: {seen:?}");
    let half = f64::from(seen.iter().sum::<f32>()) / seen.len() as f64 / 10.0;
    assert!((half - 0.5).abs() < 0.05, "{half}");
}

#[test]
fn two_hundred_and_forty_lightmaps_a_day() {
    let stage = || strips(1.0, 1.0, 0.3, &[[0.0, 0.2], [0.5, 0.8]]);
    let scene = scene(&sun("2.5min", &DAY), 8);
    let many = stage().bake("0..24/0.1", 16, &scene);
    let few = stage().bake("0..24", 16, &scene);
    assert_eq!((many.dataset.config.frames.len(), few.dataset.config.frames.len()), (240, 24));
    let (a, b) = (Curves::new(&many.dataset), Curves::new(&few.dataset));
    assert!(a.hours == b.hours && a.hours.len() <= MOST_TIMES, "{} times", a.hours.len());
    let mut differ = 0;
    for (texel, hour) in whole(&many, "floor").iter().flat_map(|t| a.hours.iter().map(move |h| (t, *h))) {
        let off = (a.at(texel, hour) - b.at(texel, hour)).abs();
        assert!(off < 1.5 / a.top, "{texel:?} at {hour}: {off}");
        differ += usize::from(off > 0.0);
    }
    println!("{} times, {differ} values differ", a.hours.len());
}

#[test]
fn a_sun_of_a_million_beside_a_lamp_of_a_thousandth() {
    let lamp = "[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0, 1, 0]\nradius = 0.1\nradiance = [1e-3, 1e-3, 1e-3]\n";
    let stage = || strips(1.0, 2.0, 0.0, &[[0.0, 9.0]]);
    let with = |light: &str| {
        let sun = sun("15min", &DAY).replace("irradiance = [10, 10, 10]", &format!("irradiance = [{light}]"));
        let text = scene(&sun, 16).replace("[lightmap]", &format!("{lamp}[lightmap]"));
        stage().bake("8..17", 16, &text)
    };
    let (bright, plain) = (with("1e6, 1e6, 1e6"), with("10, 10, 10"));
    let (a, b) = (Curves::new(&bright.dataset), Curves::new(&plain.dataset));
    assert!(a.planes == b.planes && a.light.normals == b.light.normals);
    let levels = &a.planes.levels;
    assert!(levels.contains(&0) && levels.contains(&(a.top as u8)));
    for hour in [8.0, 11.3, 13.77] {
        let image = a.light.at(hour).unwrap();
        assert!(image.texels.iter().flatten().all(|v| v.is_finite() && (0.0..=1e6).contains(v)));
        assert!(hour > 12.0 || image.texels.iter().any(|texel| texel[1] > 5e5));
    }
    // The lamp's light is that of a ball, whatever the sun.
    let exact = |p: DVec3| 1e-3 * crate::common::closed::ball(DVec3::Y, 0.1, p, DVec3::Y);
    for baked in [&bright, &plain] {
        let image = baked.group("lamp");
        let ratio = baked.ratio(&image, &baked.on("floor"), |texel| texel.average(exact));
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
}

/// A place far north, with its sun on a floor.
fn north(date: &str) -> String {
    format!(
        "[place]\nlatitude = 75\nlongitude = 15\nutc_offset = 1\ndate = {date}\n[sun]\nvisibility = \"15min\"\n\
         [sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"floor.obj\"\nalbedo = 0\n[lightmap]\nsize = 8\n"
    )
}

#[test]
fn no_sun_always_sun_and_a_sun_that_nothing_sees() {
    let has = |baked: &Baked, key: &str| {
        fs::read_to_string(baked.dataset.root.join("config.json")).unwrap().contains(&format!("\"{key}\""))
    };
    let keys = |baked: &Baked| ["sun_path", "visibility"].map(|key| has(baked, key));
    let stage = strips(1.0, 1.0, 0.0, &[[30.0, 31.0]]);
    let sky = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"floor.obj\"\n[lightmap]\nsize = 8\n";
    let none = stage.bake("0..24", 16, sky);
    assert_eq!((keys(&none), has(&none, "curve")), ([false; 2], false));
    // Light of a computed sun and sky goes by curves; of an authored sun and a steady sky, or of one hour, by
    // none.
    let computed = north("2026-04-12").replace("\"constant\"\nradiance = [1, 1, 1]", "\"hosek-wilkie\"");
    let layers = |baked: &Baked| -> Vec<bool> {
        baked.dataset.config.layers.iter().map(|l| l.curve.is_some()).collect()
    };
    assert_eq!(layers(&stage.bake("4..8/2", 4, &computed)), [false, true, true]);
    assert_eq!(layers(&stage.bake("12", 4, &computed)), [false; 3]);
    let authored = sun("off", &DAY) + sky;
    assert_eq!(layers(&stage.bake("9..11", 4, &authored)), [false; 3]);
    assert!(none.dataset.sunlight(0).unwrap().is_none());
    // The midnight sun: all times of the day, and all of it is seen.
    let always = stage.bake("0..24", 16, &north("2026-06-21"));
    let curves = Curves::new(&always.dataset);
    assert_eq!(curves.hours, (0..=96).map(|i| f64::from(i) / 4.0).collect::<Vec<f64>>());
    for (texel, hour) in
        whole(&always, "floor").iter().flat_map(|t| curves.hours.iter().map(move |h| (t, *h)))
    {
        assert_eq!(curves.at(texel, hour), 1.0);
    }
    // The polar night: a path that gives nothing, and no visibility.
    let never = stage.bake("0..24", 16, &north("2026-12-21"));
    assert_eq!(keys(&never), [true, false]);
    let told = "no visibility of the sun: it gives no light between the first and the last hour";
    assert!(never.outcome.skipped.iter().any(|what| what == told), "{:?}", never.outcome.skipped);
    let path = never.dataset.sun_path().unwrap().unwrap();
    assert!(path.irradiance.iter().all(|light| *light == [0.0; 3]));
    // A closed room with a lamp: 0 everywhere, in no byte.
    let room = Obj::default().mesh("room").room(dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 2.0, 1.0)).text();
    let room = Stage::new(&[("room.obj", room)]);
    let text = sun("2.5min", &DAY)
        + "[[object]]\nfile = \"room.obj\"\nalbedo = 0\n[[group]]\nname = \"lamp\"\n[[group.sphere]]\n\
           centre = [0, 1, 0]\nradius = 0.1\nradiance = [9, 9, 9]\n[lightmap]\nsize = 32\n";
    let closed = room.bake("6..19", 16, &text);
    let curves = Curves::new(&closed.dataset);
    assert!(curves.planes.levels.iter().all(|level| *level == 0));
    let file = &closed.dataset.config.visibility.as_ref().unwrap().files[0];
    assert_eq!(file.bytes, 24 + 8 * curves.hours.len() as u64 + 8);
    assert!(curves.light.at(12.3).unwrap().texels.iter().all(|texel| *texel == [0.0; 3]));
}

/// Texels of a page: normals no longer than 1, and light that is finite and no more than this.
fn assert_bounded(dataset: &Dataset, most: f32) {
    let curves = Curves::new(dataset);
    for normal in &curves.light.normals.normals {
        let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!(length <= 1.0 + 1e-4, "{normal:?}");
    }
    for step in 0..=48 {
        let image = curves.light.at(6.0 + f64::from(step) / 4.0).unwrap();
        assert!(image.texels.iter().flatten().all(|v| (0.0..=most * 1.0001).contains(v)));
    }
}

#[test]
fn normals_that_flip_within_a_texel() {
    // Normals of one sheet that lean by 80° to all sides: those of a page of 2 × 2 differ within each texel.
    let (s, c) = 80f64.to_radians().sin_cos();
    let fan = format!(
        "o fan\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvn {} {c} {}\nvn {s} {c} 0\nvn 0 {c} {}\nvn {} {c} 0\n\
         f 1//1 2//2 3//3 4//4\n",
        -s, 0.1, -s, -s
    );
    // A plate of 1 mm, and a roof of two sheets that meet at 20°, each smaller than a texel.
    let plate = Obj::default().mesh("plate").block(dvec3(-0.1, 0.0, -0.1), dvec3(0.1, 0.001, 0.1)).text();
    let at = |x: f64, z: f64| dvec3(x, 0.3 - 5.67 * x.abs(), z);
    let fold = Obj::default()
        .mesh("fold")
        .polygon(&[at(-0.05, 0.1), at(0.0, 0.1), at(0.0, -0.1), at(-0.05, -0.1)])
        .polygon(&[at(0.0, 0.1), at(0.05, 0.1), at(0.05, -0.1), at(0.0, -0.1)])
        .text();
    for (name, text, size) in [("fan", fan, 2), ("plate", plate, 16), ("fold", fold, 4)] {
        let stage = Stage::new(&[("a.obj", text)]);
        for two_sided in [false, true] {
            let text = format!(
                "{}[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\nalbedo = 0\n\
                 two_sided = {two_sided}\n[lightmap]\nsize = {size}\n",
                sun("2.5min", &DAY)
            );
            let baked = stage.bake("6..19", 16, &text);
            assert_bounded(&baked.dataset, 10.0);
            let curves = Curves::new(&baked.dataset);
            let short =
                curves.light.normals.normals.iter().map(|n| n.iter().map(|x| x * x).sum::<f32>().sqrt());
            let short = short.filter(|length| *length > 0.0).fold(1.0, f32::min);
            println!("{name}, two-sided {two_sided}: shortest normal {short:.3}");
            assert!(name != "fan" || short < 0.95, "{short}");
            assert!(curves.planes.levels.iter().any(|level| *level > 0), "{name} has no sun");
        }
    }
}

#[test]
fn discs_of_all_sizes_give_the_light_that_was_traced() {
    // A floor, beside a wall of 1 m that looks towards +x and throws a shadow in the afternoon.
    let obj = Obj::default().mesh("floor").quad(dvec3(0.0, 0.0, 1.0), DVec3::X * 2.0, DVec3::NEG_Z * 2.0);
    let obj = obj.mesh("wall").quad(dvec3(0.0, 0.0, 1.0), DVec3::NEG_Z * 2.0, DVec3::Y);
    let stage = || Stage::new(&[("a.obj", obj.clone().text())]);
    let object = "[[object]]\nfile = \"a.obj\"\nalbedo = 0\ntwo_sided = true\n[lightmap]\nsize = 24\n";
    for (degrees, bound) in [(0.0, 0.01), (30.0, 0.02), (90.0, 0.03)] {
        let sun = sun("15min", &[(6.0, 2.0), (18.0, -2.0)])
            .replace("disc_angle = 0", &format!("disc_angle = {degrees}"));
        let baked = stage().bake("8..17", 256, &format!("{sun}{object}"));
        let light = baked.dataset.sunlight(0).unwrap().unwrap();
        let delta = f64::to_radians(degrees) / 2.0;
        for (frame, set) in baked.dataset.config.frames.iter().enumerate() {
            let traced = baked.dataset.light(Light::Sun, None, frame, 0).unwrap();
            let found = light.at(set.hour).unwrap();
            let direction = dvec3(2.0 - (set.hour - 6.0) / 3.0, 1.0, 0.0).normalize();
            for (part, cosine) in [("floor", direction.y), ("wall", direction.x)] {
                let texels = whole(&baked, part);
                let [a, b] = [&traced, &found].map(|image| mean(image, &texels) / 10.0);
                // What a plane gets of a disc that stands before it in part, and what the product with the
                // mean direction can be.
                let lost = if delta > 0.0 && cosine.abs() < delta.sin() {
                    let whole = 2.0 / (1.0 + delta.cos()) * disc_over_plane(cosine.asin(), delta);
                    whole - cosine.max(0.0)
                } else {
                    0.0
                };
                println!(
                    "{degrees}° at {} on the {part}: traced {a:.3}, found {b:.3}, lost {lost:.3}",
                    set.hour
                );
                assert!(
                    b <= a + bound && b >= a - lost - bound,
                    "{degrees}° at {} on the {part}: {a}, found {b}, lost {lost}",
                    set.hour
                );
                assert!(part == "floor" || cosine > 0.0 || b == 0.0, "{degrees}° at {}: {b}", set.hour);
            }
        }
    }
    // At the horizon, where the disc is cut: an hour of it, on level ground alone.
    let place = "[place]\nlatitude = 0\nlongitude = 0\nutc_offset = 0\ndate = 2026-03-20\n";
    for degrees in [0.533, 30.0] {
        let floor = Obj::default().mesh("floor").floor(DVec3::ZERO, 1.0).text();
        let text = format!(
            "{place}[sun]\ndisc_angle = {degrees}\nvisibility = \"2.5min\"\n[[object]]\nfile = \"floor.obj\"\nalbedo = 0\n\
             [lightmap]\nsize = 16\n"
        );
        let baked = Stage::new(&[("floor.obj", floor)]).bake("5,5.8,6.075,6.09,6.11,6.3,7,12", 256, &text);
        let light = baked.dataset.sunlight(0).unwrap().unwrap();
        for (frame, set) in baked.dataset.config.frames.iter().enumerate() {
            let texels = whole(&baked, "floor");
            let traced = mean(&baked.dataset.light(Light::Sun, None, frame, 0).unwrap(), &texels);
            let found = mean(&light.at(set.hour).unwrap(), &texels);
            println!("{degrees}° at {}: traced {traced:.6}, found {found:.6}", set.hour);
            // (In the first minutes the light of the low sun grows faster than the path by the minute tells.)
            let bound = 0.03 * traced + 1e-5;
            assert!((traced - found).abs() <= bound, "{degrees}° at {}: {traced} {found}", set.hour);
        }
    }
}

#[test]
fn coloured_glass_makes_three_channels() {
    let pane = || over(1.0, Obj::default().mesh("sheets").floor(dvec3(0.0, 0.5, 0.0), 8.0));
    let tau = [0.9, 0.5, 0.1];
    for minutes in ["15min", "2.5min"] {
        let text =
            scene(&sun(minutes, &DAY), 16).replace("two_sided = true", &format!("transmission = {tau:?}"));
        let baked = pane().bake("8..17", 16, &text);
        let curves = Curves::new(&baked.dataset);
        assert_eq!(curves.planes.channels, 3);
        for (texel, hour) in
            whole(&baked, "floor").iter().flat_map(|t| curves.hours.iter().map(move |h| (t, *h)))
        {
            let found = curves.rgb(texel, hour);
            for c in 0..3 {
                assert!((found[c] - tau[c]).abs() <= 0.5 / curves.top + 1e-6, "at {hour}: {found:?}");
            }
        }
        let grey = pane().bake("8..17", 16, &text.replace("[0.9, 0.5, 0.1]", "0.4"));
        assert_eq!(Curves::new(&grey.dataset).planes.channels, 1);
    }
}

/// Blocks and a ground on two pages, black.
fn two_pages() -> (Stage, String) {
    let block = Obj::default().mesh("block").block(dvec3(-0.5, 0.0, -0.5), dvec3(0.5, 1.0, 0.5)).text();
    let ground = Obj::default().mesh("ground").floor(dvec3(1.0, 0.0, 0.0), 6.0).text();
    let text = "[sun]\nvisibility = \"15min\"\ntrack = [{ hour = 6, direction = [-2, 1, 0.4], irradiance = [50, 48, 45] }, \
        { hour = 18, direction = [2, 1, 0.4], irradiance = [50, 48, 45] }]\n\
        [sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n[[object]]\nfile = \"ground.obj\"\nalbedo = 0\n\
        [[object]]\nfile = \"block.obj\"\nalbedo = 0\ninstances = [{ translate = [-1, 0, 0] }, { translate = [1, 0, 0] }, \
        { translate = [3, 0, 0] }]\n[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0, 0.8, 0.3]\nradius = 0.1\n\
        radiance = [8, 6, 4]\n[lightmap]\nsize = [48, 40]\npages = 2\npadding = 2\n";
    (Stage::new(&[("block.obj", block), ("ground.obj", ground)]), text.to_owned())
}

/// Root of the mean squared difference of green ÷ the greatest light, in dB, over valid texels of a page.
fn psnr(dataset: &Dataset, page: usize, truth: &Image, found: &Image) -> f64 {
    let valid = dataset.mask(page).unwrap().valid;
    let texels: Vec<usize> = (0..valid.len()).filter(|&i| valid[i]).collect();
    let peak = texels.iter().map(|&i| f64::from(truth.texels[i][1])).fold(0.0, f64::max);
    let square = |i: usize| f64::from(truth.texels[i][1] - found.texels[i][1]).powi(2);
    let sum = texels.iter().map(|&i| square(i)).sum::<f64>();
    -10.0 * (sum / texels.len() as f64 / (peak * peak)).log10()
}

#[test]
fn every_page_has_its_own_visibility() {
    let (stage, text) = two_pages();
    let baked = stage.bake("8..17", 256, &text);
    let dataset = &baked.dataset;
    assert_eq!((dataset.config.pages.len(), dataset.config.visibility.as_ref().unwrap().files.len()), (2, 2));
    let light = [0, 1].map(|page| dataset.sunlight(page).unwrap().unwrap());
    for (frame, set) in dataset.config.frames.iter().enumerate() {
        for page in 0..2 {
            let traced = dataset.light(Light::Sun, None, frame, page).unwrap();
            let [own, other] =
                [page, 1 - page].map(|p| psnr(dataset, page, &traced, &light[p].at(set.hour).unwrap()));
            println!("page {page} at {}: {own:.1} dB, {other:.1} dB of the other", set.hour);
            assert!(own > 30.0 && other < own - 10.0, "page {page} at {}: {own} dB, {other} dB", set.hour);
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_what_was_kept() {
    let (stage, text) = two_pages();
    let (first, dataset) = keeping(&stage, "first", "8..17", &text);
    assert!(first.rays.visibility > 0);
    let expected = files(&dataset);
    assert_eq!(expected.len(), 4);
    for threads in [1, 2, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (other, dataset) = pool.install(|| keeping(&stage, &format!("of-{threads}"), "8..17", &text));
        assert!(files(&dataset) == expected, "{threads} threads");
        assert_eq!(other.rays.visibility, first.rays.visibility);
    }
    // As after a kill: no manifest, and one tile missing or cut short.
    let root = dataset.root.clone();
    let tiles = kept_tiles(&root);
    assert_eq!(tiles.len(), 2);
    let spoil: [&dyn Fn(); 3] = [
        &|| fs::remove_file(&tiles[0]).unwrap(),
        &|| fs::write(&tiles[1], &fs::read(&tiles[1]).unwrap()[..99]).unwrap(),
        &|| tiles.iter().for_each(|tile| fs::remove_file(tile).unwrap()),
    ];
    for spoil in spoil {
        spoil();
        fs::remove_file(root.join("config.json")).unwrap();
        let (again, dataset) = keeping(&stage, "first", "8..17", &text);
        assert!(files(&dataset) == expected);
        assert!(again.rays.visibility > 0 && again.layers.traced == 0, "{:?}", again.rays);
        assert_eq!(kept_tiles(&root), tiles);
    }
    // Other steps, which here have the same times: what was kept has other levels, and is not used.
    let fine = text.replace("15min", "2.5min");
    let (_, fresh) = keeping(&stage, "fresh", "12,12.02", &fine);
    keeping(&stage, "stepped", "12,12.02", &text);
    let (_, stepped) = keeping(&stage, "stepped", "12,12.02", &fine);
    assert!(files(&stepped) == files(&fresh));
    // Another lamp's light: nothing is traced.
    let dimmed = text.replace("[8, 6, 4]", "[1, 2, 3]");
    let (lit, dataset) = keeping(&stage, "first", "8..17", &dimmed);
    assert!(!lit.up_to_date && files(&dataset) == expected);
    assert_eq!((lit.layers.traced, lit.rays.visibility), (0, 0));
    let run: serde_json::Value = serde_json::from_slice(&fs::read(root.join("run.json")).unwrap()).unwrap();
    assert_eq!(run["rays"]["visibility"], 0);
}
