//! Tests of the schedule: the stated examples, and random schedules against a brute-force reading of the
//! rule.

use super::*;
use crate::scene::Baked;

fn group(on: &[[f64; 2]]) -> Group {
    Group { name: "lamp".into(), on: on.to_vec(), lamps: Vec::new(), baked: Baked::All }
}

/// Hours of the extras for whole-hour frames over a whole day.
fn extras(groups: &[Group]) -> Vec<f64> {
    extras_of("0..24", groups)
}

fn extras_of(hours: &str, groups: &[Group]) -> Vec<f64> {
    time_points(&parse_hours(hours).unwrap(), groups).iter().filter(|m| m.extra).map(|m| m.hour).collect()
}

#[test]
fn evening_to_morning_needs_two_extras() {
    let groups = [group(&[[18.0, 6.0]])];
    let all = time_points(&parse_hours("0..24").unwrap(), &groups);
    assert_eq!(all.len(), 26);
    assert!(all.is_sorted_by(|a, b| a.hour < b.hour));
    assert_eq!(extras(&groups), [5.9, 18.1]);
    assert_eq!(format!("{}", all[6].hour), "5.9");
    let on: Vec<f64> = all.iter().filter(|m| m.groups_on[0]).map(|m| m.hour).collect();
    assert_eq!(on, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.9, 18.1, 19.0, 20.0, 21.0, 22.0, 23.0]);
}

#[test]
fn between_sets_both_sides_are_added() {
    assert_eq!(extras(&[group(&[[20.5, 6.0]])]), [5.9, 20.4, 20.6]);
}

#[test]
fn no_switches_no_extras() {
    assert!(extras(&[]).is_empty());
    assert!(extras(&[group(&[[0.0, 24.0]]), group(&[])]).is_empty());
    // Lit on both sides of 12 and of midnight: neither is a switch.
    let touching = group(&[[0.0, 12.0], [12.0, 24.0]]);
    assert!(extras(std::slice::from_ref(&touching)).is_empty());
    for hour in [0.0, 6.0, 12.0, 24.0] {
        assert!(is_on(&touching.on, hour) && is_on(&[[0.0, 24.0]], hour));
    }
}

#[test]
fn midnight_wraps() {
    // On from midnight: 0.0 shows off, and is the side before; lit after.
    assert_eq!(extras(&[group(&[[0.0, 6.5]])]), [0.1, 6.4, 6.6]);
    assert_eq!(extras(&[group(&[[18.5, 24.0]])]), [18.4, 18.6, 23.9]);
    assert_eq!(extras_of("0..24/0.05", &[group(&[[0.0, 6.5]])]), [] as [f64; 0]);
    // A switch just after midnight looks back into the day before.
    assert_eq!(extras(&[group(&[[0.05, 6.0]])]), [0.15, 5.9]);
    assert_eq!(extras_of("0..24/2", &[group(&[[0.12, 6.0]])]), [0.02, 0.22, 5.9]);
    assert_eq!(extras_of("1,0..24/24", &[group(&[[0.02, 6.0]])]), [0.12, 5.9, 6.1]);
    assert_eq!(extras_of("0..24/24,6", &[group(&[[23.97, 6.0]])]), [5.9, 23.87]);
    let off_at_six = group(&[[23.95, 6.0]]);
    assert_eq!(extras_of("0..24/6", &[off_at_six]), [5.9, 23.85]);
}

#[test]
fn blink_takes_half_the_gap() {
    assert_eq!(extras(&[group(&[[20.5, 20.6]])]), [20.4, 20.55, 20.7]);
    assert_eq!(extras(&[group(&[[20.0, 20.04]])]), [20.02, 20.14]);
    // The neighbouring switch may be another group's.
    assert_eq!(extras(&[group(&[[20.0, 22.0]]), group(&[[20.1, 22.0]])]), [20.05, 20.2, 21.9]);
}

#[test]
fn groups_that_swap_need_both_sides() {
    assert_eq!(extras(&[group(&[[6.0, 18.0]]), group(&[[18.0, 6.0]])]), [5.9, 6.1, 17.9, 18.1]);
    assert_eq!(extras(&[group(&[[6.0, 18.0]]), group(&[[6.0, 18.0]])]), [6.1, 17.9]);
}

#[test]
fn requested_sets_may_show_a_side() {
    let groups = [group(&[[18.0, 6.0]])];
    assert_eq!(extras_of("0..24,18.05", &groups), [5.9]);
    assert_eq!(extras_of("0..24,18.1,5.9", &groups), [] as [f64; 0]);
    assert_eq!(extras_of("0..24,18.11", &groups), [5.9, 18.1]);
}

#[test]
fn part_of_a_day_has_the_switches_inside() {
    let groups = [group(&[[18.0, 6.0]])];
    assert!(extras_of("12", &groups).is_empty());
    assert!(extras_of("6..18", &groups).is_empty());
    assert!(extras_of("18..24", &groups).is_empty());
    assert_eq!(extras_of("17..20", &groups), [18.1]);
    assert_eq!(extras_of("17.5,18.5", &groups), [17.9, 18.1]);
}

#[test]
fn hours_parse() {
    let list = |text| parse_hours(text).unwrap();
    let day = list("0..24");
    assert!(day.whole_day && day.list == (0..24).map(f64::from).collect::<Vec<_>>());
    assert_eq!(list("6,12,18.5"), Hours { list: vec![6.0, 12.0, 18.5], ..Hours::default() });
    assert_eq!(day, Hours::day());
    assert_eq!(list(" 18:30 , 6 ").list, [6.0, 18.5]);
    assert_eq!(list("00:20").list, [0.333333]);
    assert_eq!(list("6:00..7:30/0.5").list, [6.0, 6.5, 7.0]);
    assert_eq!(list("0..24/0.1").list[181], 18.1);
    assert!(list("0..24/6").whole_day && !list("0..23").whole_day && !list("1..24").whole_day);
    assert_eq!(list("22..24").list, [22.0, 23.0]);
}

#[test]
fn ranges_are_kept_as_stretches_of_time() {
    let ranges = |text| parse_hours(text).unwrap().ranges;
    assert_eq!(ranges("5.5,12,18:30"), [] as [[f64; 2]; 0]);
    assert_eq!(ranges("12,18..20/0.5,6..8"), [[6.0, 8.0], [18.0, 20.0]]);
    assert_eq!(ranges("8..12,6..8,9.5..10"), [[6.0, 12.0]]);
    let night = parse_hours("22..24,0..6").unwrap();
    assert!(night.spans([22.0, 23.0]) && night.spans([23.0, 24.0]) && night.spans([5.0, 6.0]));
    assert!(!night.spans([5.0, 22.0]) && !night.spans([5.0, 6.5]) && !night.spans([23.0, 31.0]));
    assert!(!parse_hours("20..24").unwrap().spans([23.0, 24.0 + 20.0]));
}

#[test]
fn a_range_across_midnight_is_told_as_a_list() {
    let told = parse_hours("22:30..2").unwrap_err();
    assert!(told.ends_with("across midnight: 22.5..24,0..2"), "{told}");
    assert_eq!(parse_hours("22.5..24,0..2").unwrap().list, [0.0, 1.0, 22.5, 23.5]);
}

#[test]
fn bad_hours_say_what_was_expected() {
    for text in [
        "",
        "24",
        "-1",
        "25",
        "1e1",
        "nan",
        "inf",
        "12,",
        "0...24",
        "12,12",
        "0..24,12",
        "5..5",
        "18..6",
        "0..25",
        "..",
        "0..",
        "..5",
        "0..24/0",
        "0..24/-1",
        "0..24/nan",
        "0..24/",
        "0..24/1e-9",
        "12:60",
        "12:5",
        "12:",
        ":30",
        "24:30",
        "1.5:30",
        "a",
        "1..2..3",
        "0.9999999,1",
    ] {
        let error = parse_hours(text).expect_err(text);
        assert!(error.contains("expected"), "{text}: {error}");
    }
}

/// A small generator for the property test.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % n
    }
}

/// Brute force: for every switch and side, the frames that stand there and near enough.
#[test]
fn random_schedules_show_every_side_and_nothing_else() {
    let mut random = Random(7);
    for trial in 0..400 {
        // Times on a grid of 0.05 h (coarse enough to collide) or of 0.001 h.
        let grid = if trial % 2 == 0 { 50 } else { 1 };
        let mut time = || grid * random.below(24_000 / grid);
        let mut groups = Vec::new();
        for _ in 0..1 + trial % 3 {
            let mut ends: Vec<u64> = (0..2 * (1 + trial % 2)).map(|_| time()).collect();
            ends.sort_unstable();
            ends.dedup();
            ends.truncate(ends.len() / 2 * 2);
            if trial % 5 == 0 {
                ends.rotate_left(1);
            }
            groups.push(group(
                &ends.chunks(2).map(|c| [c[0] as f64 / 1e3, c[1] as f64 / 1e3]).collect::<Vec<_>>(),
            ));
        }
        let hours = parse_hours(["0..24", "0..24/3", "0..24/0.5", "0..24/24"][trial as usize % 4]).unwrap();
        let all = time_points(&hours, &groups);
        assert!(all.is_sorted_by(|a, b| a.hour < b.hour), "trial {trial}");
        let milli = |h: f64| (h * 1e3 * 4.0).round() as i64; // a quarter of 0.001 h: half gaps stay whole, switches stand on multiples of 4
        let day = milli(24.0);
        let on = |g: &Group, t: i64| {
            let t = t.rem_euclid(day);
            g.on.iter()
                .map(|[a, b]| (milli(*a), milli(*b)))
                .any(|(a, b)| if a < b { a < t && t < b } else { a < t || t < b })
        };
        let switches: Vec<i64> = sorted(
            (0..day).step_by(4).filter(|&t| groups.iter().any(|g| on(g, t - 1) != on(g, t + 1))).collect(),
        );
        let mut useful = vec![false; all.len()];
        for &s in &switches {
            for side in [-1, 1] {
                let gap = switches.iter().map(|o| (side * (o - s)).rem_euclid(day)).filter(|&d| d > 0).min();
                let reach = milli(0.1).min(gap.unwrap_or(day) / 2);
                for g in groups.iter().filter(|g| on(g, s - 1) != on(g, s + 1)) {
                    let state = on(g, s + side);
                    let shows: Vec<usize> = (0..all.len())
                        .filter(|&k| {
                            let away = (side * (milli(all[k].hour) - s)).rem_euclid(day);
                            (0 < away && away <= reach) || (away == 0 && !state)
                        })
                        .collect();
                    assert!(!shows.is_empty(), "trial {trial}: switch {s} side {side}: {:?} {all:?}", g.on);
                    let i = groups.iter().position(|h| std::ptr::eq(h, g)).unwrap();
                    assert!(shows.iter().all(|&k| all[k].groups_on[i] == state), "trial {trial}");
                    // An extra is needed when it is the only one that shows some side.
                    if let [only] = shows[..] {
                        useful[only] = true;
                    }
                }
            }
        }
        for (k, point) in all.iter().enumerate() {
            assert_eq!(point.extra, !hours.list.contains(&point.hour));
            assert!(!point.extra || useful[k], "trial {trial}: {} is superfluous in {all:?}", point.hour);
        }
    }
}

/// Ascending, distinct, in the day, no more than the hours and two per switch.
fn check_sane(hours: &str, groups: &[Group]) -> Vec<TimePoint> {
    let hours = parse_hours(hours).unwrap();
    let all = time_points(&hours, groups);
    assert!(all.windows(2).all(|pair| pair[0].hour < pair[1].hour), "{all:?}");
    assert!(all.iter().all(|m| (0.0..24.0).contains(&m.hour) && m.groups_on.len() == groups.len()));
    assert_eq!(all.iter().filter(|m| !m.extra).map(|m| m.hour).collect::<Vec<_>>(), hours.list);
    let switches: usize = groups.iter().map(|g| 2 * g.on.len()).sum();
    assert!(all.len() <= hours.list.len() + 2 * switches);
    all
}

#[test]
fn always_never_and_for_a_second() {
    let second = 1.0 / 3600.0;
    let groups = [
        group(&[[0.0, 24.0]]),
        group(&[]),
        group(&[[12.0, 12.0 + second]]),
        group(&[[18.0 - second, 18.0]]),
        group(&[[24.0 - second, 24.0]]),
    ];
    let all = check_sane("0..24", &groups);
    assert!(all.iter().all(|m| m.groups_on[0] && !m.groups_on[1]));
    let lit = |g: usize| all.iter().filter(|m| m.groups_on[g]).map(|m| m.hour).collect::<Vec<_>>();
    assert_eq!(lit(2), [12.000139]);
    assert_eq!(lit(3), [17.999861]);
    assert_eq!(lit(4), [23.999861]);
    // All day but for a second; and for less than can be told apart.
    let groups = [
        group(&[[12.0 + second, 12.0]]),
        group(&[[6.000_000_2, 6.000_000_1]]),
        group(&[[6.000_000_1, 6.000_000_2]]),
    ];
    let all = check_sane("0..24", &groups);
    assert_eq!(all.iter().filter(|m| !m.groups_on[0]).map(|m| m.hour).collect::<Vec<_>>(), [12.0, 12.000139]);
    assert!(all.iter().all(|m| m.groups_on[1] && !m.groups_on[2]));
}

/// A switch on an hour, at 0:00 and at 24:00: the same time of the circle.
#[test]
fn midnight_is_one_moment() {
    let evening = [group(&[[18.0, 24.0]]), group(&[[0.0, 6.0]])];
    let all = check_sane("0..24", &evening);
    let on = |hour: f64| all.iter().find(|m| m.hour == hour).map(|m| (m.groups_on[0], m.groups_on[1]));
    assert_eq!(on(0.0), Some((false, false)));
    assert_eq!(on(0.1), Some((false, true)));
    assert_eq!(on(23.9), Some((true, false)));
    assert_eq!(on(18.0), Some((false, false)));
    assert_eq!(on(18.1), Some((true, false)));
    // Together they are one lamp that does not switch at midnight.
    let through = [group(&[[18.0, 24.0], [0.0, 6.0]])];
    let all = check_sane("0..24", &through);
    assert!(all[0].groups_on[0] && all.iter().all(|m| m.hour != 0.1 && m.hour != 23.9));
}

/// Two switches within a minute, of one group and of two: a time between them, and both sides.
#[test]
fn switches_within_a_minute() {
    let half_minute = 30.0 / 3600.0;
    let one = [group(&[[6.0, 20.5], [20.5 + half_minute, 23.0]])];
    let all = check_sane("0..24", &one);
    let dark = all.iter().filter(|m| !m.groups_on[0] && (20.0..21.0).contains(&m.hour)).count();
    assert_eq!(dark, 1, "{all:?}");
    let two = [group(&[[6.0, 20.5]]), group(&[[20.5 + half_minute, 23.0]])];
    let all = check_sane("0..24", &two);
    let near: Vec<_> =
        all.iter().filter(|m| (20.2..20.8).contains(&m.hour)).map(|m| m.groups_on.clone()).collect();
    assert_eq!(near, [[true, false], [false, false], [false, true]]);
    // A whole row of them, each a second after the one before.
    let row: Vec<Group> =
        (0..30).map(|i| group(&[[20.0 + f64::from(i) / 3600.0, 22.0 + f64::from(i) / 3600.0]])).collect();
    let all = check_sane("0..24", &row);
    for count in 0..=30 {
        assert!(all.iter().any(|m| m.groups_on.iter().filter(|on| **on).count() == count), "{count}");
    }
}

/// 200 groups with three intervals each to the minute: every side of every switch is shown.
#[test]
fn two_hundred_schedules() {
    let mut state = 3u64;
    let mut minute = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) % 1440) as f64 / 60.0
    };
    let groups: Vec<Group> = (0..200)
        .map(|_| {
            let mut ends: Vec<f64> = (0..6).map(|_| minute()).collect();
            ends.sort_by(f64::total_cmp);
            ends.dedup();
            group(&ends.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect::<Vec<_>>())
        })
        .collect();
    let all = check_sane("0..24", &groups);
    for (g, group) in groups.iter().enumerate() {
        for &[from, to] in &group.on {
            // Between the ends some time is lit, and just outside one is not, no farther than an extra
            // reaches.
            assert!(all.iter().any(|m| from < m.hour && m.hour < to && m.groups_on[g]), "{g}: {from}..{to}");
            let dark =
                |low: f64, high: f64| all.iter().any(|m| (low..=high).contains(&m.hour) && !m.groups_on[g]);
            assert!(from < 0.11 || dark(from - 0.100_001, from), "{g}: before {from}");
            assert!(to > 23.89 || dark(to, to + 0.100_001), "{g}: after {to}");
        }
    }
}

#[test]
fn switches_outside_the_hours_are_told() {
    let groups = [group(&[[20.25, 23.0]])];
    let outside = |hours: &str| switches_outside(&parse_hours(hours).unwrap(), &groups);
    assert_eq!(outside("0..24/2"), [0.0; 0]);
    assert_eq!(outside("0,2,4,6,8,10,12,14,16,18,20,22"), [23.0]);
    assert_eq!(outside("12"), [20.25, 23.0]);
}

#[test]
fn groups_that_are_not_baked_switch_nothing() {
    let left = Group { baked: Baked::None, ..group(&[[20.25, 23.0]]) };
    let indirect = Group { baked: Baked::Indirect, ..group(&[[7.25, 8.5]]) };
    let hours = |groups: &[Group]| {
        time_points(&parse_hours("0..24").unwrap(), groups).iter().map(|m| m.hour).collect::<Vec<_>>()
    };
    let extras =
        |groups: &[Group]| hours(groups).into_iter().filter(|hour| hour.fract() != 0.0).collect::<Vec<_>>();
    assert_eq!(extras(std::slice::from_ref(&left)), [0.0; 0]);
    assert_eq!(extras(&[left.clone(), indirect.clone()]), extras(&[indirect]));
    assert_eq!(switches_outside(&parse_hours("12").unwrap(), &[left]), [0.0; 0]);
}
