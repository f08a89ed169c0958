//! Hours to time coordinates: which frames surround an hour, and how far it lies between them.
//!
//! Light jumps where a light group switches, so means and time coordinate interpolate only between
//! neighbouring frames that show the light groups in that hour's state; next to a switch, the frame on the
//! hour's side of the switch is held.

use crate::{Error, Result};

/// How time and light are coded in a tile's maps. Bundles have the standard coding alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// `τ = (i + ½)/m` for place i of m on the tile's own time axis, `γ` on 2πτ and 4πτ, `E = mean · y²`.
    Standard,
    /// The paper's literal choice, in memory alone, for comparisons: `τ = hour/24`, `γ` on πτ and 2πτ,
    /// `E = mean · y^2.2`.
    Paper,
}

impl Coding {
    /// The time coordinate of every frame: from its place on the tile's time axis, or with the paper's coding
    /// from its hour.
    pub fn taus(self, hours: &[f64], axis: &Axis) -> Vec<f64> {
        match self {
            Coding::Standard => {
                let length = f64::from(axis.length);
                axis.places.iter().map(|&place| (f64::from(place) + 0.5) / length).collect()
            }
            Coding::Paper => hours.iter().map(|hour| hour / 24.0).collect(),
        }
    }

    /// Positional encoding: sine and cosine of τ's first and second harmonic. The paper's first one has a
    /// period of two days, so that its γ jumps at midnight.
    pub fn gamma(self, tau: f64) -> [f32; 4] {
        let cycle = match self {
            Coding::Standard => std::f64::consts::TAU,
            Coding::Paper => std::f64::consts::PI,
        };
        let (s1, c1) = (cycle * tau).sin_cos();
        let (s2, c2) = (2.0 * cycle * tau).sin_cos();
        [s1 as f32, c1 as f32, s2 as f32, c2 as f32]
    }

    /// The exponent p of `E = mean · max(y, 0)^p`.
    pub fn exponent(self) -> f32 {
        match self {
            Coding::Standard => 2.0,
            Coding::Paper => 2.2,
        }
    }

    /// Light over mean of a decoder's output y ≥ 0: y^p.
    pub fn light(self, y: f64) -> f64 {
        match self {
            Coding::Standard => y * y,
            Coding::Paper => y.powf(f64::from(self.exponent())),
        }
    }

    /// The output for a ratio ≥ 0 of light to mean: the inverse of [`Self::light`].
    pub fn output(self, ratio: f64) -> f64 {
        match self {
            Coding::Standard => ratio.sqrt(),
            Coding::Paper => ratio.powf(1.0 / f64::from(self.exponent())),
        }
    }
}

/// A tile's time axis under the standard coding; empty under the paper's.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Axis {
    /// Number of places.
    pub length: u16,
    /// Per frame, its place. The first is 0 and places never decrease, except that the last frames may be at
    /// place 0 again.
    pub places: Vec<u16>,
}

impl Axis {
    /// Checks that the places follow the rules of [`Axis::places`] and are below the length.
    pub(crate) fn check(&self) -> Result<(), String> {
        let Some(&largest) = self.places.iter().max() else { return Ok(()) };
        let turn = self.places.iter().rposition(|&place| place == largest).map_or(0, |i| i + 1);
        let (day, night) = self.places.split_at(turn);
        let forwards = day[0] == 0 && day.is_sorted() && night.iter().all(|&place| place == 0);
        if forwards && largest < self.length {
            return Ok(());
        }
        Err(format!("a time axis of {} coordinates that does not ascend from 0", self.length))
    }
}

/// What a decoder knows about time: the frames' hours and when each light group is on.
///
/// ```
/// # let bundle = ndgi::Bundle::from_bytes(ndgi::testing::sunny_bundle())?;
/// let timeline = &bundle.header.timeline;
/// let time = timeline.at(5.0);
/// println!("between frames {} and {}", timeline.hours[time.a], timeline.hours[time.b]);
/// // The groups that are on then.
/// let on = timeline.state(5.0);
/// # Ok::<(), ndgi::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Timeline {
    /// The frames' hours: at least one, strictly ascending, in [0, 24).
    pub hours: Vec<f64>,
    /// Hours between frames at which tiles' means are known too, strictly ascending, in [0, 24): see
    /// [`Timeline::knots`].
    pub between: Vec<f64>,
    /// Per light group: its open on-intervals `(from, to)` in hours; `from > to` crosses midnight; `[0, 24]`
    /// is always on.
    pub intervals: Vec<Vec<[f64; 2]>>,
    /// Per frame and light group: true if the group is on in the frame.
    pub states: Vec<Vec<bool>>,
    /// The bundle's coding.
    pub coding: Coding,
}

/// An hour's position between two frames, or at one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimePoint {
    /// Index of the frame before, or of the held frame.
    pub a: usize,
    /// Index of the frame after; equal to `a` at a frame's hour and where a frame is held.
    pub b: usize,
    /// The surrounding knots, as indices of [`Timeline::knots`]; they lie between the knots of `a` and `b`.
    pub knots: [usize; 2],
    /// True if the second knot is that of frame `b`.
    pub reaches_b: bool,
    /// Weight of the second knot in the means, in [0, 1). In double precision because, where the second knot
    /// is far dimmer, the result depends on 1 − fraction.
    pub fraction: f64,
}

impl TimePoint {
    /// The interpolated time coordinate. `taus`: per frame; `brightness`: per knot; `share`: the part of a
    /// knot's light that comes from `b`, 0 at `a`. It runs from the coordinate of `a` to that of `b` as the
    /// share of `b` grows. Next to a frame a thousand times brighter it reaches that frame's coordinate
    /// almost at once; next to a black frame the light only fades. May exceed 1.
    pub fn tau(&self, taus: &[f64], brightness: impl Fn(usize) -> f64, share: impl Fn(usize) -> f64) -> f64 {
        let along = self.share(brightness, share);
        taus[self.a] + along * (taus[self.b] - taus[self.a]).rem_euclid(1.0)
    }
}

impl TimePoint {
    /// The part of the light that comes from `b`; arguments as of [`TimePoint::tau`].
    pub fn share(&self, brightness: impl Fn(usize) -> f64, share: impl Fn(usize) -> f64) -> f64 {
        let [from, to] = self.knots;
        let shares = [share(from), if self.reaches_b { 1.0 } else { share(to) }];
        light_share(self.fraction, [brightness(from), brightness(to)], shares)
    }
}

/// The second frame's share of the light at a fraction of the way between two knots with these brightnesses
/// and shares; linear where both are black.
fn light_share(fraction: f64, [a, b]: [f64; 2], [of_a, of_b]: [f64; 2]) -> f64 {
    let weights = [(1.0 - fraction) * a, fraction * b];
    let sum = weights[0] + weights[1];
    if sum > 0.0 {
        (weights[0] * of_a + weights[1] * of_b) / sum
    } else {
        (1.0 - fraction) * of_a + fraction * of_b
    }
}

/// The fraction of the way between two lit frames at which the second has this share of the light: the
/// inverse of what [`TimePoint::tau`] computes without knots between them.
pub fn fraction_of_share(share: f64, a: f64, b: f64) -> f64 {
    let (a, b) = (share * a, (1.0 - share) * b);
    a / (a + b)
}

/// A frame's brightness for [`TimePoint::tau`]: the sum of its means.
pub fn brightness(means: &[f32; 3]) -> f64 {
    means.iter().map(|&mean| f64::from(mean)).sum()
}

/// Whether a group with these open on-intervals is lit at `hour`. `[0, 24]` (and longer) is always on,
/// midnight included.
pub fn is_on(intervals: &[[f64; 2]], hour: f64) -> bool {
    intervals.iter().any(|&[from, to]| {
        if to - from >= 24.0 {
            true
        } else if from > to {
            hour > from || hour < to
        } else {
            from < hour && hour < to
        }
    })
}

/// Refuses an hour that is not a finite number.
pub(crate) fn check_hour(hour: f64) -> Result<()> {
    match hour.is_finite() {
        true => Ok(()),
        false => Err(Error::invalid("hour", format!("{hour}; expected a finite number"))),
    }
}

/// `hour` folded into [0, 24); a value that is not finite counts as midnight.
pub fn fold_hour(hour: f64) -> f64 {
    let folded = hour.rem_euclid(24.0);
    // A tiny negative hour folds to 24 by rounding.
    if folded < 24.0 { folded } else { 0.0 }
}

impl Timeline {
    /// The light groups' states at an hour in [0, 24).
    pub fn state(&self, hour: f64) -> Vec<bool> {
        self.intervals.iter().map(|on| is_on(on, hour)).collect()
    }

    /// The position of `hour` (periodic in 24 h) between the frames.
    pub fn at(&self, hour: f64) -> TimePoint {
        let hour = fold_hour(hour);
        let n = self.hours.len();
        // First frame later than the time; the one before it, around midnight.
        let next = self.hours.partition_point(|&h| h <= hour);
        let prev = (next + n - 1) % n;
        if self.hours[prev] == hour {
            return self.hold(prev);
        }
        let next = next % n;
        let state = self.state(hour);
        match (self.states[prev] == state, self.states[next] == state) {
            (true, true) if prev != next => self.between(prev, next, hour),
            (true, _) => self.hold(prev),
            (_, true) => self.hold(next),
            // Neither neighbour shows this state: the nearest frame that does, else the nearest.
            (false, false) => {
                let distance = |k: usize| {
                    let d = (self.hours[k] - hour).abs();
                    d.min(24.0 - d)
                };
                let nearest = |of: &mut dyn Iterator<Item = usize>| {
                    of.min_by(|&i, &j| distance(i).total_cmp(&distance(j)))
                };
                let same = nearest(&mut (0..n).filter(|&k| self.states[k] == state));
                self.hold(same.or_else(|| nearest(&mut (0..n))).unwrap_or(prev))
            }
        }
    }

    /// The same times for light that some light groups are no part of: `is_apart` by group. Those do not
    /// switch it.
    pub fn without(&self, is_apart: &[bool]) -> Self {
        let kept = |i: &usize| !is_apart.get(*i).copied().unwrap_or(false);
        let groups = || (0..self.intervals.len()).filter(kept);
        Timeline {
            intervals: groups().map(|i| self.intervals[i].clone()).collect(),
            states: self.states.iter().map(|state| groups().map(|i| state[i]).collect()).collect(),
            ..self.clone()
        }
    }

    /// Whether a light group is on at an hour: at a frame's hour as in the frame.
    pub fn is_on(&self, group: usize, hour: f64) -> bool {
        let hour = fold_hour(hour);
        match self.hours.iter().position(|of| *of == hour) {
            Some(frame) => self.states[frame][group],
            None => is_on(&self.intervals[group], hour),
        }
    }

    /// True if the frames that [`Timeline::at`] gives for an hour have the light groups in that hour's state.
    pub fn shows(&self, hour: f64) -> bool {
        let hour = fold_hour(hour);
        let TimePoint { a, .. } = self.at(hour);
        // (At the instant of a switch a frame may show either side of it.)
        self.hours[a] == hour || self.states[a] == self.state(hour)
    }

    /// Exactly at frame `k`.
    pub fn hold(&self, k: usize) -> TimePoint {
        let knot = self.knot_of(k);
        TimePoint { a: k, b: k, knots: [knot; 2], reaches_b: true, fraction: 0.0 }
    }

    /// The hours at which tiles' means are known, ascending: the frames' and those between.
    pub fn knots(&self) -> Vec<f64> {
        let mut knots = [&self.hours[..], &self.between].concat();
        knots.sort_by(f64::total_cmp);
        knots
    }

    /// The knot of frame `k`.
    pub fn knot_of(&self, k: usize) -> usize {
        k + self.between.partition_point(|&hour| hour < self.hours[k])
    }

    /// An error if an hour between frames is never used by a decoder.
    pub(crate) fn check_between(&self) -> Result<(), String> {
        if !self.between.is_sorted_by(|a, b| a < b) || self.between.iter().any(|h| !(0.0..24.0).contains(h)) {
            return Err("hours between frames that are not strictly ascending in [0, 24)".to_owned());
        }
        match self.between.iter().find(|&&hour| self.at(hour).a == self.at(hour).b) {
            Some(hour) => {
                Err(format!("{hour} h; expected an hour strictly between two frames that are interpolated"))
            }
            None => Ok(()),
        }
    }

    /// The position between neighbouring frames, or between knots that lie between them, possibly across
    /// midnight.
    fn between(&self, a: usize, b: usize, hour: f64) -> TimePoint {
        let after = |x: f64| {
            let x = x - self.hours[a];
            if x < 0.0 { x + 24.0 } else { x }
        };
        let (now, mut from, mut to) =
            (after(hour), (0.0, self.knot_of(a)), (after(self.hours[b]), self.knot_of(b)));
        let (end, mut reaches_b) = (to.0, true);
        for (i, &knot) in self.between.iter().enumerate() {
            let (at, index) = (after(knot), i + self.hours.partition_point(|&frame| frame < knot));
            if at <= now && at > from.0 {
                from = (at, index);
            } else if at > now && at < to.0 && at < end {
                (to, reaches_b) = ((at, index), false);
            }
        }
        let fraction = (now - from.0) / (to.0 - from.0);
        TimePoint { a, b, knots: [from.1, to.1], reaches_b, fraction }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hourly frames and the two extra times for lamps that are on 18:00–06:00.
    fn lamps_at_night() -> Timeline {
        let mut hours: Vec<f64> = (0..24).map(f64::from).collect();
        hours.extend([5.9, 18.1]);
        timeline(hours, vec![vec![[18.0, 6.0]]])
    }

    fn timeline(mut hours: Vec<f64>, intervals: Vec<Vec<[f64; 2]>>) -> Timeline {
        hours.sort_by(f64::total_cmp);
        let states = hours.iter().map(|&h| intervals.iter().map(|on| is_on(on, h)).collect()).collect();
        Timeline { hours, between: vec![], intervals, states, coding: Coding::Standard }
    }

    /// The time coordinate where every frame has a place of its own.
    fn tau(timeline: &Timeline, point: TimePoint) -> f64 {
        let length = timeline.hours.len() as u16;
        let axis = Axis { length, places: (0..length).collect() };
        point.tau(&timeline.coding.taus(&timeline.hours, &axis), |_| 1.0, |_| 0.0)
    }

    fn frame(timeline: &Timeline, hour: f64) -> usize {
        timeline.hours.iter().position(|&h| h == hour).unwrap()
    }

    #[test]
    fn a_frame_s_hour_is_that_frame_exactly() {
        let t = lamps_at_night();
        for (k, &hour) in t.hours.iter().enumerate() {
            for day in [-24.0, 0.0, 24.0] {
                // 24 + 5.9 is no longer 5.9 in binary: only exact hours are compared a day away.
                if day == 0.0 || hour.fract() == 0.0 {
                    let m = t.at(hour + day);
                    assert_eq!((m.a, m.b, m.fraction), (k, k, 0.0), "{hour}");
                    assert_eq!(tau(&t, m), (k as f64 + 0.5) / 26.0);
                }
            }
        }
    }

    #[test]
    fn the_side_of_a_switch_is_held() {
        let t = lamps_at_night();
        // Lamps still on at 5.95, off at 6.0 itself; still off at 18.0, on right after.
        assert_eq!(t.at(5.95), t.hold(frame(&t, 5.9)));
        assert_eq!(t.at(6.0), t.hold(frame(&t, 6.0)));
        assert_eq!(t.at(18.0), t.hold(frame(&t, 18.0)));
        assert_eq!(t.at(18.0 + 1e-9), t.hold(frame(&t, 18.1)));
        assert_eq!(t.at(18.05), t.hold(frame(&t, 18.1)));
        assert_eq!(t.at(18.1), t.hold(frame(&t, 18.1)));
        // Away from the switch both neighbours agree.
        let m = t.at(18.55);
        assert_eq!((m.a, m.b), (frame(&t, 18.1), frame(&t, 19.0)));
        assert!((m.fraction - 0.5).abs() < 1e-6);
        let k = frame(&t, 18.1) as f64;
        assert!((tau(&t, m) - (k + 1.0) / 26.0).abs() < 1e-6);
    }

    #[test]
    fn midnight_wraps() {
        let t = lamps_at_night();
        let m = t.at(23.5);
        assert_eq!((m.a, m.b, m.fraction), (25, 0, 0.5));
        assert!((tau(&t, m) - 1.0).abs() < 1e-7, "halfway between (25 + ½)/26 and 1 + ½/26");
        assert_eq!(t.at(0.0), t.hold(0));
        assert_eq!(t.at(24.0), t.hold(0));
        assert_eq!(t.at(-1e-30), t.hold(0));
        assert_eq!(t.at(f64::NAN), t.hold(0));
        assert_eq!(t.at(f64::INFINITY), t.hold(0));
    }

    #[test]
    fn sets_on_one_place_of_the_axis_have_one_time() {
        let t = lamps_at_night();
        // Night before 5.9 and after 18.1 is one place; 20 places for the day.
        let places: Vec<u16> = (0..26).map(|k: u16| if k < 20 { k.saturating_sub(5) } else { 0 }).collect();
        assert_eq!((places[4], places[6], places[19], places[20]), (0, 1, 14, 0));
        let axis = Axis { length: 15, places };
        axis.check().unwrap();
        let taus = Coding::Standard.taus(&t.hours, &axis);
        assert_eq!(taus[0], 0.5 / 15.0);
        for hour in [23.5, 0.0, 0.5, 3.3] {
            assert_eq!(t.at(hour).tau(&taus, |_| 1.0, |_| 0.0), 0.5 / 15.0, "{hour}");
        }
        // Forwards past 1 from the last place to the first.
        let late = TimePoint { a: 19, b: 20, knots: [19, 20], reaches_b: true, fraction: 0.75 };
        assert!((late.tau(&taus, |_| 1.0, |_| 0.0) - (14.5 + 0.75) / 15.0).abs() < 1e-12);
    }

    #[test]
    fn the_time_coordinate_goes_with_the_light() {
        let point = |fraction: f64| TimePoint { a: 0, b: 1, knots: [0, 1], reaches_b: true, fraction };
        let tau = |fraction: f64, light: [f64; 2]| {
            point(fraction).tau(&[0.25, 0.75], |frame| light[frame], |_| 0.0)
        };
        // Beside a black frame that of the lit one; a thousandth of the way to a frame a thousand times as
        // bright, halfway.
        assert_eq!([tau(0.01, [0.0, 2.0]), tau(0.99, [2.0, 0.0]), tau(0.5, [0.0, 0.0])], [0.75, 0.25, 0.5]);
        assert!((tau(0.001, [1.0, 999.0]) - 0.5).abs() < 1e-6);
        for (share, a, b) in [(0.5, 1.0, 1.0), (1.0 / 3.0, 1e-8, 1.0), (0.7, 3.0, 1e9)] {
            let fraction = fraction_of_share(share, a, b);
            assert!(
                (0.0..1.0).contains(&fraction)
                    && (light_share(fraction, [a, b], [0.0, 1.0]) - share).abs() < 1e-12
            );
        }
    }

    #[test]
    fn means_go_from_knot_to_knot_and_the_picture_by_the_share_of_light() {
        // Dusk: a tenth of the light, all of it the first frame's picture, at the first knot; at the second a
        // half is the second's.
        let t = Timeline {
            between: vec![1.0, 19.0, 19.5, 23.0],
            ..timeline(vec![2.0, 18.0, 20.0, 22.0], vec![])
        };
        t.check_between().unwrap();
        assert_eq!(t.knots(), [1.0, 2.0, 18.0, 19.0, 19.5, 20.0, 22.0, 23.0]);
        let light = [1e-3, 1e-3, 100.0, 10.0, 0.2, 0.1, 1e-2, 1e-3];
        let share = [0.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.25];
        let tau = |hour: f64| t.at(hour).tau(&[0.0, 0.25, 0.5, 0.75], |i| light[i], |i| share[i]);
        let at = |hour: f64| (t.at(hour).a, t.at(hour).b, t.at(hour).knots, t.at(hour).fraction);
        assert_eq!(at(18.5), (1, 2, [2, 3], 0.5));
        assert_eq!(at(19.0), (1, 2, [3, 4], 0.0));
        assert_eq!(at(19.75), (1, 2, [4, 5], 0.5));
        assert_eq!(at(20.0), (2, 2, [5, 5], 0.0));
        assert_eq!(
            (at(22.5), at(0.0), at(1.5)),
            ((3, 0, [6, 7], 0.5), (3, 0, [7, 0], 0.5), (3, 0, [0, 1], 0.5))
        );
        assert_eq!((tau(18.5), tau(19.0), tau(19.5)), (0.25, 0.25, 0.375));
        // Light linear between knots: (0.5 · 0.2 · 0.5 + 0.5 · 0.1) / 0.15 of it is the second frame's.
        assert!((tau(19.75) - (0.25 + 0.25 * 2.0 / 3.0)).abs() < 1e-12);
        assert!((tau(1.5) - (0.75 + 0.25 * 0.75)).abs() < 1e-12);
        for between in [vec![24.0], vec![-1.0], vec![f64::NAN], vec![3.0, 3.0], vec![4.0, 3.0], vec![18.0]] {
            assert!(
                Timeline { between: between.clone(), ..t.clone() }.check_between().is_err(),
                "{between:?}"
            );
        }
        // Where a frame is held nobody looks.
        let held = Timeline { between: vec![18.2], ..timeline(vec![18.0, 19.0], vec![vec![[18.5, 20.0]]]) };
        assert!(held.check_between().is_err());
    }

    #[test]
    fn a_blinking_lamp_stays_within_its_minutes() {
        // On for 0.1 h, shown by one extra frame inside and one on either side.
        let t = timeline(vec![20.0, 20.39, 20.45, 20.51, 21.0], vec![vec![[20.4, 20.5]]]);
        assert_eq!(t.at(20.395), t.hold(1));
        assert_eq!(t.at(20.4), t.hold(1));
        for inside in [20.41, 20.45, 20.49] {
            assert_eq!(t.at(inside), t.hold(2), "{inside}");
        }
        assert_eq!(t.at(20.5), t.hold(3));
        assert_eq!(t.at(20.505), t.hold(3));
        // Without a frame that shows it on: the nearest frame.
        let t = timeline(vec![20.0, 21.0], vec![vec![[20.6, 20.7]]]);
        assert_eq!(t.at(20.65), t.hold(1));
        // A frame elsewhere that shows the state is preferred to a nearer one that does not.
        let t = timeline(vec![3.0, 20.0, 21.0], vec![vec![[20.6, 20.7], [2.0, 4.0]]]);
        assert_eq!(t.at(20.65), t.hold(0));
    }

    #[test]
    fn two_groups_must_both_agree() {
        let t = timeline(vec![17.0, 18.0, 18.5, 19.0, 19.5], vec![vec![[18.0, 6.0]], vec![[19.0, 5.0]]]);
        assert_eq!(t.at(17.5).a, 0);
        assert_eq!(t.at(17.5).b, 1);
        assert_eq!(t.at(18.25), t.hold(2));
        assert_eq!(t.at(18.75).b, 3, "at 19:00 the second group is still off");
        assert_eq!(t.at(19.25), t.hold(4));
    }

    #[test]
    fn an_hour_whose_groups_no_frame_has_is_reported() {
        let t = timeline(vec![11.0, 12.0], vec![vec![[18.0, 6.0]]]);
        assert!([0.0, 11.0, 11.5, 12.0, 15.0, 18.0, 24.0 + 11.0].iter().all(|&h| t.shows(h) == (h != 0.0)));
        assert!(!t.shows(18.1) && !t.shows(-1.0) && !t.shows(20.0));
    }

    #[test]
    fn one_frame_is_held_all_day() {
        for on in [vec![], vec![[18.0, 6.0]], vec![[0.0, 24.0]]] {
            let t = timeline(vec![12.0], vec![on]);
            for i in 0..240 {
                assert_eq!(t.at(f64::from(i) / 10.0), t.hold(0));
            }
        }
    }

    #[test]
    fn always_on_includes_midnight_and_the_paper_s_axis_is_the_hour() {
        assert!(is_on(&[[0.0, 24.0]], 0.0));
        assert!(!is_on(&[[18.0, 24.0]], 0.0));
        assert!(is_on(&[[18.0, 6.0]], 0.0));
        let t = Timeline { coding: Coding::Paper, ..timeline(vec![0.0, 6.0, 18.0], vec![]) };
        assert!((tau(&t, t.at(12.0)) - 0.5).abs() < 1e-7);
        assert!((tau(&t, t.at(21.0)) - 0.875).abs() < 1e-7);
        // γ on πτ and 2πτ, literally: at 6 h, τ = ¼.
        let root = std::f32::consts::FRAC_1_SQRT_2;
        for (found, expected) in Coding::Paper.gamma(0.25).into_iter().zip([root, root, 1.0, 0.0]) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        assert!((Coding::Paper.light(0.5) - 0.5f64.powf(2.2)).abs() < 1e-7);
    }

    #[test]
    fn just_before_a_frame_the_remainder_of_the_one_before_keeps_its_digits() {
        let timeline = Timeline {
            hours: vec![0.0, 6.0],
            between: vec![],
            intervals: vec![],
            states: vec![vec![]; 2],
            coding: Coding::Standard,
        };
        for left in [1e-3, 1e-6, 1e-9] {
            let point = timeline.at(6.0 - left);
            let found = 6.0 * (1.0 - point.fraction);
            assert_eq!((point.a, point.b), (0, 1));
            assert!((found / left - 1.0).abs() < 1e-5, "{left}: {found}");
        }
    }

    #[test]
    fn output_is_the_inverse_of_light() {
        for coding in [Coding::Standard, Coding::Paper] {
            for ratio in [0.0, 1e-6, 0.3, 1.0, 100.0] {
                let back = coding.light(coding.output(ratio));
                assert!((back - ratio).abs() <= 1e-12 * ratio, "{coding:?} {ratio} {back}");
            }
        }
    }
}
