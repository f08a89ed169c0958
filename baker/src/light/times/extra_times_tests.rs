//! Tests of the extra times: a computed dusk, authored suns, and where there are none.

use super::*;
use crate::light::times::schedule::parse_hours;
use crate::scene::{Group, Location, Sky, Sun, SunKey, SunTrack};
use glam::DVec3;

fn scene(location: Option<Location>, sun: Option<Sun>, sky: Option<Sky>) -> Scene {
    Scene { location, sun, sky, ..scene_without_light() }
}

fn scene_without_light() -> Scene {
    let file = tempfile::Builder::new().suffix(".obj").tempfile().unwrap();
    Scene::of_models(&[file.path().to_owned()]).unwrap()
}

fn location(latitude: f64, date: (i32, u32, u32)) -> Location {
    Location { latitude, longitude: 16.4, utc_offset: 2.0, date, north: 0.0, refraction: true }
}

/// Sun and sky of a clear day.
fn clear(latitude: f64, date: (i32, u32, u32)) -> Scene {
    let sun = Sun { disc_angle: 0.53, track: SunTrack::Computed { turbidity: 3.0 } };
    let sky = Sky::HosekWilkie { turbidity: 3.0, ground_albedo: 0.2 };
    scene(Some(location(latitude, date)), Some(sun), Some(sky))
}

fn spring() -> Scene {
    clear(48.2, (2026, 4, 12))
}

/// A sun overhead with an irradiance at each hour.
fn track(keys: &[(f64, f64)]) -> Scene {
    let key =
        |&(hour, light): &(f64, f64)| SunKey { hour, direction: DVec3::Y, irradiance: DVec3::splat(light) };
    let track = SunTrack::Authored(keys.iter().map(key).collect());
    scene(None, Some(Sun { disc_angle: 0.0, track }), None)
}

fn times(scene: &Scene, hours: &str, most: u32) -> ExtraTimes {
    let hours = parse_hours(hours).unwrap();
    let (points, extra) = all_times(scene, &hours, most);
    assert!(points.is_sorted_by(|a, b| a.hour < b.hour));
    let refining: Vec<f64> = points.iter().filter(|m| m.refines).map(|m| m.hour).collect();
    assert_eq!(refining, hours_of(&extra));
    assert!(extra.added.len() <= most as usize);
    extra
}

fn hours_of(extra: &ExtraTimes) -> Vec<f64> {
    extra.added.iter().map(|time| time.hour).collect()
}

/// The greatest error at any minute of light interpolated between some hours, each half minute looked at
/// anew.
fn error_of(scene: &Scene, hours: &[f64]) -> f64 {
    let smooth = Smooth::new(scene);
    let greatest = (0..1440).map(|m| smooth.at(f64::from(m) / 60.0)).fold(0.0, f64::max);
    let error = |pair: [f64; 2]| {
        let minutes = (pair[0] * 60.0).ceil() as i32..=(pair[1] * 60.0).floor() as i32;
        let of_minute = |minute: i32| {
            let hour = f64::from(minute) / 60.0;
            let t = (hour - pair[0]) / (pair[1] - pair[0]);
            let between = (1.0 - t) * smooth.at(pair[0]) + t * smooth.at(pair[1] % 24.0);
            let light = smooth.at(hour % 24.0);
            (between - light).abs() / light.max(DARK_SHARE * greatest)
        };
        minutes.map(of_minute).fold(0.0, f64::max)
    };
    let around = [hours[hours.len() - 1], hours[0] + 24.0];
    hours.windows(2).map(|pair| [pair[0], pair[1]]).chain([around]).map(error).fold(0.0, f64::max)
}

#[test]
fn a_computed_dusk_draws_times_and_they_help() {
    let scene = spring();
    let day: Vec<f64> = (0..24).map(f64::from).collect();
    let extra = times(&scene, "0..24", MOST_EXTRA_TIMES);
    let hours = hours_of(&extra);
    // The sun rises at 6:13 and sets at 19:38.
    assert!(hours.iter().all(|h| (5.0..8.0).contains(h) || (18.0..21.0).contains(h)), "{hours:?}");
    assert!(hours.iter().any(|h| *h < 8.0) && hours.iter().any(|h| *h > 18.0), "{hours:?}");
    // On whole minutes.
    assert!(hours.iter().all(|h| ((h * 60.0).round() - h * 60.0).abs() < 1e-3), "{hours:?}");
    let mut all = [day.clone(), hours.clone()].concat();
    all.sort_by(f64::total_cmp);
    let (before, after) = (extra.error_before.unwrap(), extra.error_after.unwrap());
    assert!((before / error_of(&scene, &day) - 1.0).abs() < 1e-3, "{before}");
    assert!((after / error_of(&scene, &all) - 1.0).abs() < 1e-2, "{after}");
    assert!(before > 1.0 && after < 0.2 * before, "{before} {after}");
    assert!(extra.added.iter().all(|time| time.error_after < time.error_before && time.error_after <= after));
}

#[test]
fn more_times_leave_less_until_the_bound_is_reached() {
    let scene = spring();
    let errors: Vec<f64> = (0..8).map(|most| times(&scene, "0..24", most).error_after.unwrap()).collect();
    assert!(errors.is_sorted_by(|a, b| a * 1.002 >= *b) && errors[7] < 0.1 * errors[0], "{errors:?}");
    let plenty = times(&scene, "0..24", 100);
    assert!(plenty.added.len() < 40 && plenty.error_after.unwrap() <= MOST_ERROR, "{plenty:?}");
    assert_eq!(plenty.skipped(), None);
    let few = times(&scene, "0..24", 2);
    assert!(few.skipped().unwrap().starts_with("no more than 2 extra times (--extra-times)"));
    // The same again.
    assert_eq!(few, times(&scene, "0..24", 2));
}

#[test]
fn none_is_added_where_none_is_wanted() {
    let scene = spring();
    let none = times(&scene, "0..24", 0);
    assert!(none.added.is_empty() && none.error_before == none.error_after && none.error_before > Some(1.0));
    // Single hours stand for themselves.
    assert_eq!(times(&scene, "12", MOST_EXTRA_TIMES), ExtraTimes::default());
    assert_eq!(times(&scene, "5,6,18,19,20", MOST_EXTRA_TIMES), ExtraTimes::default());
    // Only within a range.
    let dusk = hours_of(&times(&scene, "6,18..22", MOST_EXTRA_TIMES));
    assert!(!dusk.is_empty() && dusk.iter().all(|h| (18.0..21.0).contains(h)), "{dusk:?}");
    // By day there is no need.
    let noon = times(&scene, "11..15", MOST_EXTRA_TIMES);
    assert!(noon.added.is_empty() && noon.skipped().unwrap().starts_with("no extra times"), "{noon:?}");
    // 240 hours a day are what was asked for, and 72 are not.
    assert_eq!(times(&scene, "0..24/0.1", MOST_EXTRA_TIMES), ExtraTimes::default());
    assert_eq!(times(&scene, "0..24/0.333", MOST_EXTRA_TIMES).added.len(), MOST_EXTRA_TIMES as usize);
}

#[test]
fn steady_light_draws_none() {
    let sky = Sky::Constant { radiance: DVec3::ONE };
    assert_eq!(
        times(&scene(None, None, Some(sky.clone())), "0..24", MOST_EXTRA_TIMES),
        ExtraTimes::default()
    );
    assert_eq!(times(&track(&[(0.0, 100.0)]), "0..24", MOST_EXTRA_TIMES), ExtraTimes::default());
    assert_eq!(times(&scene_without_light(), "0..24", MOST_EXTRA_TIMES), ExtraTimes::default());
    // What lightmaps do not hold does not count.
    let unbaked = Scene { sun_baked: Baked::None, sky_baked: Baked::None, ..spring() };
    assert_eq!(times(&unbaked, "0..24", MOST_EXTRA_TIMES), ExtraTimes::default());
    let sunless = Scene { sun_baked: Baked::None, ..spring() };
    assert!(!times(&sunless, "0..24", MOST_EXTRA_TIMES).added.is_empty());
}

#[test]
fn a_sun_that_jumps_gets_a_time_on_either_side() {
    // On within a second at 9:30, off at 15:20.
    let keys = [(0.0, 0.0), (9.5, 0.0), (9.5003, 80.0), (15.32, 80.0), (15.3203, 0.0), (23.0, 0.0)];
    let extra = times(&track(&keys), "0..24", MOST_EXTRA_TIMES);
    // The last dark minute and the first light one, the last light one and the first dark one.
    assert_eq!(hours_of(&extra), [9.5, 9.516667, 15.316667, 15.333333]);
    assert_eq!(extra.error_after, Some(0.0), "{extra:?}");
}

#[test]
fn the_midnight_sun_needs_few() {
    let scene = clear(75.0, (2026, 6, 21));
    let extra = times(&scene, "0..24", MOST_EXTRA_TIMES);
    assert!(extra.added.is_empty() && extra.error_before.unwrap() <= MOST_ERROR, "{extra:?}");
    // A day of four times does not do, across midnight neither.
    let four = times(&scene, "0..24/6", 100);
    assert!(four.error_before.unwrap() > MOST_ERROR && four.error_after.unwrap() <= MOST_ERROR, "{four:?}");
}

#[test]
fn between_the_sides_of_a_switch_light_is_held() {
    let lamp = |from: f64| Group {
        name: "lamp".into(),
        on: vec![[from, 23.0]],
        lamps: Vec::new(),
        baked: Baked::All,
    };
    // A lamp at 19:45, in the midst of dusk.
    let scene = Scene { groups: vec![lamp(19.75)], ..spring() };
    let (points, extra) = all_times(&scene, &Hours::day(), 100);
    assert!(extra.added.len() > 3);
    for point in points.iter().filter(|point| point.refines) {
        assert!(!(19.65..=19.85).contains(&point.hour), "{}", point.hour);
        assert_eq!(point.groups_on, [point.hour > 19.75 && point.hour < 23.0]);
        assert!(!point.extra);
    }
    assert_eq!(points.iter().filter(|point| point.extra).count(), 3);
}
