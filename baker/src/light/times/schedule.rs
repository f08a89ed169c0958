//! Which hours are baked, and which groups are lit at each.
//!
//! Times are compared as whole micro-hours (3.6 ms), so that 18 + 0.1 is 18.1 and no switch is missed by
//! rounding. The day is a circle: 24 is 0.

use crate::scene::{Baked, Group};
use dataset::typed::clock;

/// The times to bake, before the switch frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hours {
    /// Ascending, distinct, in [0, 24).
    pub list: Vec<f64>,
    /// Whether they cover the whole day (`0..24`): then every switch gets its extras, else only those
    /// strictly between the first and the last hour.
    pub whole_day: bool,
    /// The ranges among what was asked for, `[from, to]` in [0, 24]: ascending, apart from each other.
    /// Lightmaps within them stand for a stretch of time, and not for single hours.
    pub ranges: Vec<[f64; 2]>,
}

impl Hours {
    /// The hours from 0 to 23, of a whole day.
    pub fn day() -> Self {
        Hours { list: (0..24).map(f64::from).collect(), whole_day: true, ranges: vec![[0.0, 24.0]] }
    }

    /// Whether all of the time between two neighbouring lightmaps, `to` up to a day later than midnight, lies
    /// in a range that was asked for.
    pub fn spans(&self, [from, to]: [f64; 2]) -> bool {
        let is_in = |[a, b]: [f64; 2]| self.ranges.iter().any(|range| range[0] <= a && b <= range[1]);
        if to < 24.0 { is_in([from, to]) } else { is_in([from, 24.0]) && is_in([0.0, to - 24.0]) }
    }

    /// The first and the last time that they cover: of a whole day 0 and 24.
    pub fn span(&self) -> [f64; 2] {
        match (self.whole_day, &self.list[..]) {
            (false, [first, .., last]) => [*first, *last],
            (false, [only]) => [*only, *only],
            _ => [0.0, 24.0],
        }
    }
}

/// A time to bake.
#[derive(Clone, Debug, PartialEq)]
pub struct TimePoint {
    /// In [0, 24).
    pub hour: f64,
    /// Per group of the scene: lit?
    pub groups_on: Vec<bool>,
    /// Whether it was added to show a side of a switch.
    pub extra: bool,
    /// Whether it was added because light interpolated between the others would err there
    /// (`light::times::extra_times`).
    pub refines: bool,
}

/// Micro-hours in an hour, in a day, and in the greatest distance of an extra from its switch (0.1 h).
const HOUR: i64 = 1_000_000;
const DAY: i64 = 24 * HOUR;
const SWITCH_REACH: i64 = HOUR / 10;

/// The finest step of a range, in micro-hours (0.001 h).
const FINEST_STEP: i64 = HOUR / 1000;

/// Parses `0..24` (half-open, step 1), `6..18`, `12`, `6,12,18.5`, `0..24/0.5` (step), `18:30` (minutes).
///
/// # Errors
/// A sentence that names the offending part and what was expected: malformed, outside the day, empty, or an
/// hour twice.
pub fn parse_hours(text: &str) -> Result<Hours, String> {
    let (mut list, mut ranges) = (Vec::new(), Vec::new());
    let mut whole_day = false;
    for item in text.split(',').map(str::trim) {
        if let Some((from, rest)) = item.split_once("..") {
            if rest.starts_with('.') {
                return Err(format!("`{item}`: expected a range with two dots, such as 0..24"));
            }
            let (to, step) = match rest.split_once('/') {
                Some((to, step)) => (to, parse_step(step, item)?),
                None => (rest, HOUR),
            };
            let (from, to) = (parse_time(from, item)?, parse_time(to, item)?);
            if from >= to {
                let across = match from > to && from < DAY && to > 0 {
                    true => format!("; across midnight: {}..24,0..{}", hours(from), hours(to)),
                    false => String::new(),
                };
                return Err(format!(
                    "`{item}`: expected a range a..b with a < b (half-open, within 0..24){across}"
                ));
            }
            whole_day |= from == 0 && to == DAY;
            ranges.push([from, to]);
            list.extend((from..to).step_by(step as usize));
        } else {
            let time = parse_time(item, item)?;
            if time == DAY {
                return Err(format!(
                    "`{item}`: expected an hour with 0 ≤ hour < 24 (24 is the next day's 0)"
                ));
            }
            list.push(time);
        }
    }
    list.sort_unstable();
    if let Some(pair) = list.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(format!("`{text}`: hour {} is asked for twice, expected distinct hours", hours(pair[0])));
    }
    Ok(Hours { list: list.into_iter().map(hours).collect(), whole_day, ranges: joined(ranges) })
}

/// Ranges in micro-hours as hours, those that touch or overlap as one.
fn joined(mut ranges: Vec<[i64; 2]>) -> Vec<[f64; 2]> {
    ranges.sort_unstable();
    let mut all: Vec<[i64; 2]> = Vec::new();
    for [from, to] in ranges {
        match all.last_mut() {
            Some(last) if from <= last[1] => last[1] = last[1].max(to),
            _ => all.push([from, to]),
        }
    }
    all.into_iter().map(|range| range.map(hours)).collect()
}

/// A time in [0, 24] as decimal hours or `HH:MM`, in micro-hours.
fn parse_time(text: &str, item: &str) -> Result<i64, String> {
    let text = text.trim();
    let wrong = || {
        let part = if text == item { String::new() } else { format!(": `{text}`") };
        format!(
            "`{item}`{part}: expected hours such as 12, 18.5, 18:30, 0..24 or 6..18/0.5, between 0 and 24"
        )
    };
    clock(text).map(micro).ok_or_else(wrong)
}

/// The step of a range, in micro-hours.
fn parse_step(text: &str, item: &str) -> Result<i64, String> {
    let step =
        text.trim().parse::<f64>().ok().filter(|s| s.is_finite() && (0.0..=24.0).contains(s)).map(micro);
    step.filter(|&s| s >= FINEST_STEP).ok_or_else(|| {
        format!("`{item}`: expected a step in hours between 0.001 and 24 after `/`, such as 0..24/0.5")
    })
}

/// Whether a group's open intervals contain `hour`. Both ends of an interval count as off, except where the
/// group is lit on either side (`[0, 24]`, or one interval that begins where another ends): that is no
/// switch.
pub fn is_on(on: &[[f64; 2]], hour: f64) -> bool {
    let time = micro(hour).rem_euclid(DAY);
    lit_before(on, time) && lit_after(on, time)
}

/// Whether a switch lies among the requested times: anywhere in a whole day, else between the first and the
/// last.
fn is_within(hours: &Hours, requested: &[i64], instant: i64) -> bool {
    let ends = requested.first().zip(requested.last());
    hours.whole_day || ends.is_some_and(|(a, b)| *a < instant && instant < *b)
}

/// The switches, in hours, that lie before the first or after the last of the hours, ascending: they get no
/// frames beside them.
pub fn switches_outside(hours: &Hours, groups: &[Group]) -> Vec<f64> {
    let requested: Vec<i64> = sorted(hours.list.iter().map(|&h| micro(h).rem_euclid(DAY)).collect());
    let switches = sorted(baked(groups).flat_map(|g| switches_of(&g.on)).collect());
    switches.into_iter().filter(|&at| !is_within(hours, &requested, at)).map(self::hours).collect()
}

/// The hours and the extras that show both sides of every switch, ascending.
///
/// A side of a switch is shown when a frame stands strictly on it, no farther away than an extra would stand
/// (0.1 h, or half the gap to the neighbouring switch of any group if that is less): a requested 18.05 shows
/// what 18.1 would. A frame at the very instant shows the side on which the group is off. Where several
/// groups switch at once, the sides each of them lacks are added together. An extra for which less than two
/// micro-hours are left is dropped.
pub fn time_points(hours: &Hours, groups: &[Group]) -> Vec<TimePoint> {
    let requested: Vec<i64> = sorted(hours.list.iter().map(|&h| micro(h).rem_euclid(DAY)).collect());
    let switches = sorted(baked(groups).flat_map(|g| switches_of(&g.on)).collect());
    let mut extras = Vec::new();
    for (i, &instant) in switches.iter().enumerate() {
        if !is_within(hours, &requested, instant) {
            continue;
        }
        let at_instant = requested.binary_search(&instant).is_ok();
        // Neighbouring switches on the circle; alone, a switch is its own neighbour a day away.
        let previous = switches[(i + switches.len() - 1) % switches.len()];
        let next = switches[(i + 1) % switches.len()];
        for side in [-1, 1] {
            // A frame at the instant shows every group off: the side is lacking only for groups that are lit
            // there.
            let lacking = baked(groups).any(|group| {
                let (before, after) = (lit_before(&group.on, instant), lit_after(&group.on, instant));
                before != after && (!at_instant || if side < 0 { before } else { after })
            });
            let gap = if side < 0 { instant - previous } else { next - instant };
            let gap = if gap <= 0 { gap + DAY } else { gap };
            // (The middle of an odd gap is one time, seen from either end.)
            let half = if side < 0 && gap > 1 { gap - gap / 2 } else { gap / 2 };
            let reach = SWITCH_REACH.min(half);
            // Distance from the instant to a frame, going to this side.
            let shown = requested.iter().any(|&frame| {
                let away = (side * (frame - instant)).rem_euclid(DAY);
                0 < away && away <= reach
            });
            if lacking && !shown && reach > 0 {
                extras.push((instant + side * reach).rem_euclid(DAY));
            }
        }
    }
    let extras = sorted(extras);
    let all = sorted(requested.iter().chain(&extras).copied().collect());
    let point = |time: i64| TimePoint {
        hour: self::hours(time),
        groups_on: groups.iter().map(|g| is_on(&g.on, self::hours(time))).collect(),
        extra: requested.binary_search(&time).is_err(),
        refines: false,
    };
    all.into_iter().map(point).collect()
}

/// The groups whose switches lightmaps show.
fn baked(groups: &[Group]) -> impl Iterator<Item = &Group> {
    groups.iter().filter(|group| group.baked != Baked::None)
}

/// The instants at which a group's state changes, in [0, DAY).
fn switches_of(on: &[[f64; 2]]) -> Vec<i64> {
    let ends = on.iter().flatten().map(|&h| micro(h).rem_euclid(DAY));
    ends.filter(|&t| lit_before(on, t) != lit_after(on, t)).collect()
}

/// Whether the group is lit just before `time` ∈ [0, DAY).
fn lit_before(on: &[[f64; 2]], time: i64) -> bool {
    on.iter().any(|&interval| {
        let (start, length) = arc(interval);
        let into = (time - start).rem_euclid(DAY);
        // On the whole circle, into = 0 stands for a full turn.
        let into = if into == 0 { DAY } else { into };
        into <= length
    })
}

/// Whether the group is lit just after `time` ∈ [0, DAY).
fn lit_after(on: &[[f64; 2]], time: i64) -> bool {
    on.iter().any(|&interval| {
        let (start, length) = arc(interval);
        (time - start).rem_euclid(DAY) < length
    })
}

/// An interval as start and length on the circle; `[0, 24]` is the whole of it, `[a, a]` nothing. Ends that
/// round to the same instant are nothing or, across midnight, the whole.
fn arc([from, to]: [f64; 2]) -> (i64, i64) {
    let across_midnight = from > to;
    let (from, to) = (micro(from), micro(to));
    let whole = to - from == DAY || (across_midnight && to == from);
    let length = if whole { DAY } else { (to - from).rem_euclid(DAY) };
    (from.rem_euclid(DAY), length)
}

fn micro(hours: f64) -> i64 {
    (hours * HOUR as f64).round() as i64
}

fn hours(micro: i64) -> f64 {
    micro as f64 / HOUR as f64
}

fn sorted(mut times: Vec<i64>) -> Vec<i64> {
    times.sort_unstable();
    times.dedup();
    times
}

#[cfg(test)]
#[path = "schedule_tests.rs"]
mod tests;
