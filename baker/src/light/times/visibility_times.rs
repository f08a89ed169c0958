//! The times at which the sun's visibility is found, and the sun at each.

use crate::light::daylight::{SunDisc, sun};
use crate::scene::{Location, Sun, SunTrack};
use dataset::format::SunPath;
use glam::{DVec3, Vec2};

/// Steps of 2.5 minutes in an hour.
const FINEST_PER_HOUR: i64 = 24;

/// The steps of the levels, coarsest first, in units of 2.5 minutes: 60, 30, 15, 7.5 and 2.5 minutes.
const STEPS_OF_LEVELS: [i64; 5] = [24, 12, 6, 3, 1];

/// The level of quarters of an hour. Where steps are finer, all is asked for as often: beams through narrow
/// gaps show for a few minutes.
const QUARTERS_LEVEL: usize = 2;

/// The times at which the sun's visibility is asked for, ascending, and the sun at each: none at which it
/// gives no light.
#[derive(Clone, Debug)]
pub struct VisibilityTimes {
    /// The finest step of the clock, in minutes.
    pub minutes: f64,
    /// In hours from midnight, at most 24.
    pub hours: Vec<f64>,
    /// Per time, its level: 0 is always asked for, others where light changes between those of lower levels
    /// around it.
    pub levels: Vec<u8>,
    /// Per time, the sun.
    pub suns: Vec<SunDisc>,
}

impl VisibilityTimes {
    /// The times between two hours. `minutes`: the finest step, 15 or 2.5.
    ///
    /// The times are those of the clock at that step, both ends, the keys of an authored course, the first
    /// and last second of sun, and the middle of every time of sun that lies between two others.
    pub fn new(sun: &Sun, location: Option<&Location>, [from, to]: [f64; 2], minutes: f64) -> Self {
        let step = (minutes / 2.5).round().max(1.0) as i64;
        let finest =
            (from * FINEST_PER_HOUR as f64).ceil() as i64..=(to * FINEST_PER_HOUR as f64).floor() as i64;
        let of_clock = finest.filter(|k| k % step == 0);
        let coarsest = if minutes < 15.0 && is_moving(sun) { QUARTERS_LEVEL } else { 0 };
        let of_step =
            |k: i64| STEPS_OF_LEVELS.iter().position(|step| k % step == 0).filter(|level| *level > coarsest);
        let level = |k: i64| of_step(k).unwrap_or(0) as u8;
        let mut times: Vec<(f64, u8)> =
            of_clock.map(|k| (k as f64 / FINEST_PER_HOUR as f64, level(k))).collect();
        let mut add = |hour: f64| {
            times.retain(|(other, _)| *other != hour);
            times.push((hour, 0));
        };
        add(from);
        add(to);
        if let SunTrack::Authored(keys) = &sun.track {
            keys.iter().map(|key| key.hour).filter(|hour| (from..=to).contains(hour)).for_each(&mut add);
        }
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = |hour: f64| sun::at(sun, location, hour);
        let brief = brief_times(&times, &at);
        times.extend(brief.into_iter().map(|hour| (hour, 0)));
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let ends = times.windows(2).filter_map(|pair| end_of_day([pair[0].0, pair[1].0], &at));
        let ends: Vec<(f64, u8)> = ends.map(|hour| (hour, 0)).collect();
        times.extend(ends);
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        times.dedup_by_key(|(hour, _)| *hour);
        let by_day = times.into_iter().filter_map(|(hour, level)| Some((hour, level, at(hour)?)));
        let (mut hours, mut levels, mut suns) = (Vec::new(), Vec::new(), Vec::new());
        for (hour, level, sun) in by_day {
            hours.push(hour);
            levels.push(level);
            suns.push(sun);
        }
        VisibilityTimes { minutes, hours, levels, suns }
    }

    /// Whether the sun ever shines.
    pub fn is_dark(&self) -> bool {
        self.suns.is_empty()
    }

    /// The times of one level, each with the nearest times of lower levels before and after it, where there
    /// are any.
    pub fn of_level(&self, level: u8) -> Vec<(usize, Option<usize>, Option<usize>)> {
        let is_coarser = |&time: &usize| self.levels[time] < level;
        let times = (0..self.hours.len()).filter(|&time| self.levels[time] == level);
        let around = |time: usize| {
            let before = (0..time).rev().find(is_coarser);
            (time, before, (time + 1..self.hours.len()).find(is_coarser))
        };
        times.map(around).collect()
    }

    /// The finest level.
    pub fn finest(&self) -> u8 {
        self.levels.iter().copied().max().unwrap_or(0)
    }
}

/// Whether a sun stands at several places in the course of a day.
fn is_moving(sun: &Sun) -> bool {
    match &sun.track {
        SunTrack::Computed { .. } => true,
        SunTrack::Authored(keys) => keys.iter().any(|key| key.direction != keys[0].direction),
    }
}

/// The sun by the minute between two hours, as datasets hold it; the keys of an authored course, and the
/// first and last second of sun, are times of their own. None of it where there is no sun at all.
pub fn sun_path(sun: &Sun, location: Option<&Location>, [from, to]: [f64; 2]) -> SunPath {
    let at = |hour: f64| sun::at(sun, location, hour);
    let mut hours = vec![from, to];
    hours.extend(
        ((from * 60.0).ceil() as i64..=(to * 60.0).floor() as i64).map(|minute| minute as f64 / 60.0),
    );
    if let SunTrack::Authored(keys) = &sun.track {
        hours.extend(keys.iter().map(|key| key.hour).filter(|hour| (from..=to).contains(hour)));
    }
    hours.sort_by(f64::total_cmp);
    hours.dedup();
    let ends: Vec<f64> = hours.windows(2).filter_map(|pair| end_of_day([pair[0], pair[1]], &at)).collect();
    hours.extend(ends);
    hours.sort_by(f64::total_cmp);
    hours.dedup();
    let mut path = SunPath::default();
    for hour in hours {
        // (By night it stands where it was, and gives nothing.)
        let disc = at(hour);
        let last = path.direction.last().copied();
        let direction =
            disc.map(|disc| mean_direction(&disc).as_vec3().to_array()).or(last).unwrap_or([0.0; 3]);
        path.hours.push(hour);
        path.direction.push(direction);
        path.irradiance.push(disc.map_or([0.0; 3], |disc| disc.irradiance.to_array()));
    }
    path
}

/// The middles of the times of sun that lie between two of `times`: found by the minute.
fn brief_times(times: &[(f64, u8)], at: &impl Fn(f64) -> Option<SunDisc>) -> Vec<f64> {
    let mut brief = Vec::new();
    for pair in times.windows(2) {
        let (from, to) = (pair[0].0, pair[1].0);
        if at(from).is_some() || at(to).is_some() {
            continue;
        }
        let steps = ((to - from) * 60.0).ceil().max(1.0) as u32;
        let hours = (1..steps).map(|i| from + (to - from) * f64::from(i) / f64::from(steps));
        let up: Vec<f64> = hours.filter(|&hour| at(hour).is_some()).collect();
        if !up.is_empty() {
            brief.push(up[up.len() / 2]);
        }
    }
    brief
}

/// The last time of sun, or the first, to a second, where there is sun at one of two times alone.
fn end_of_day([from, to]: [f64; 2], at: &impl Fn(f64) -> Option<SunDisc>) -> Option<f64> {
    const SECOND: f64 = 1.0 / 3600.0;
    let (mut day, mut night) = match (at(from).is_some(), at(to).is_some()) {
        (true, false) => (from, to),
        (false, true) => (to, from),
        _ => return None,
    };
    while (day - night).abs() > SECOND {
        let middle = 0.5 * (day + night);
        if at(middle).is_some() { day = middle } else { night = middle }
    }
    Some(day)
}

/// The mean direction towards the visible part of a sun's disc: a vector of length 1 for a small disc, less
/// for a wide one. Its product with the normal of a surface that sees all of it, times the disc's irradiance,
/// is the irradiance of the surface.
pub fn mean_direction(disc: &SunDisc) -> DVec3 {
    let (direction, half_angle) = (disc.direction.as_dvec3(), f64::from(disc.half_angle));
    if half_angle == 0.0 {
        return direction;
    }
    if !disc.horizon || direction.y >= half_angle.sin() {
        // ∫ ω dω over a cap ÷ its solid angle.
        return direction * (0.5 * (1.0 + half_angle.cos()));
    }
    /// Points per side of a grid over the part above the horizon.
    const SIDE: u32 = 16;
    let middle = |i: u32| (i as f32 + 0.5) / SIDE as f32;
    let points = (0..SIDE * SIDE).map(|i| Vec2::new(middle(i / SIDE), middle(i % SIDE)));
    let sum: DVec3 = points.map(|u| disc.sample(u).as_dvec3()).sum();
    sum / f64::from(SIDE * SIDE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SunKey;
    use glam::Vec3;

    fn authored(keys: &[(f64, f64, f64)]) -> Sun {
        let key = |&(hour, x, light): &(f64, f64, f64)| SunKey {
            hour,
            direction: DVec3::new(x, 1.0, 0.0).normalize(),
            irradiance: DVec3::splat(light),
        };
        Sun { track: SunTrack::Authored(keys.iter().map(key).collect()), disc_angle: 0.53 }
    }

    #[test]
    fn times_are_those_of_the_clock_with_ends_and_keys() {
        let sun = authored(&[(6.0, -1.0, 1.0), (12.1, 0.0, 1.0), (18.0, 1.0, 1.0)]);
        let course = VisibilityTimes::new(&sun, None, [11.0, 13.1], 15.0);
        assert_eq!(course.hours, [11.0, 11.25, 11.5, 11.75, 12.0, 12.1, 12.25, 12.5, 12.75, 13.0, 13.1]);
        assert_eq!(course.levels, [0, 2, 1, 2, 0, 0, 2, 1, 2, 0, 0]);
        assert_eq!(course.of_level(1), [(2, Some(0), Some(4)), (7, Some(5), Some(9))]);
        assert_eq!(course.of_level(2)[2], (6, Some(5), Some(7)));
        let fine = VisibilityTimes::new(&sun, None, [0.0, 24.0], 2.5);
        assert_eq!(fine.hours.len(), 24 * 24 + 1 + 1); // (12.1 beside those of the clock.)
        assert_eq!(fine.finest(), 4);
    }

    #[test]
    fn a_sun_of_one_minute_has_a_time() {
        let sun = authored(&[(0.0, 0.0, 0.0), (9.05, 0.0, 0.0), (9.06, 0.1, 1.0), (9.07, 0.1, 0.0)]);
        let course = VisibilityTimes::new(&sun, None, [0.0, 24.0], 15.0);
        assert!(course.hours.contains(&9.06), "{:?}", course.hours);
        assert!(course.hours.iter().all(|hour| (9.05..9.07).contains(hour)));
        // A computed one, so far north that it comes up for minutes between two quarters of an hour.
        let sun = Sun { track: SunTrack::Computed { turbidity: 3.0 }, disc_angle: 0.53 };
        let location = |latitude: f64| Location {
            latitude,
            longitude: 25.0,
            north: 0.0,
            refraction: true,
            date: (2026, 12, 11),
            utc_offset: 2.0,
        };
        let minutes_of = |latitude: f64| {
            let is_up =
                |minute: u32| sun::at(&sun, Some(&location(latitude)), f64::from(minute) / 60.0).is_some();
            (0..1440).filter(|&minute| is_up(minute)).count()
        };
        let latitude = (0..400).map(|i| 67.6 + f64::from(i) / 1000.0).find(|l| minutes_of(*l) < 12).unwrap();
        assert!(minutes_of(latitude) > 0, "{latitude}");
        for minutes in [15.0, 2.5] {
            assert!(
                !VisibilityTimes::new(&sun, Some(&location(latitude)), [0.0, 24.0], minutes).is_dark(),
                "{latitude}"
            );
        }
    }

    #[test]
    fn mean_directions_are_those_of_the_samples() {
        for (elevation, degrees, horizon) in [
            (0.3f64, 0.5, true),
            (0.001, 1.0, true),
            (0.2, 60.0, true),
            (0.9, 90.0, false),
            (-0.002, 1.0, true),
        ] {
            let direction = Vec3::new(elevation.cos() as f32, elevation.sin() as f32, 0.0);
            let half_angle = (degrees * 0.5f32).to_radians();
            let disc = SunDisc { direction, irradiance: Vec3::ONE, half_angle, horizon };
            const SIDE: u32 = 200;
            let middle = |i: u32| (i as f32 + 0.5) / SIDE as f32;
            let points = (0..SIDE * SIDE).map(|i| Vec2::new(middle(i / SIDE), middle(i % SIDE)));
            let mean: DVec3 =
                points.map(|u| disc.sample(u).as_dvec3()).sum::<DVec3>() / f64::from(SIDE * SIDE);
            let off = (mean - mean_direction(&disc)).length();
            assert!(off < 1e-3 * f64::from(half_angle).max(1e-3), "{degrees}°: {off}");
        }
    }
}
