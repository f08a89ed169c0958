//! Which frames of a dataset show an hour.

use crate::light::times::schedule::is_on;
use dataset::format::Config;

/// The frames that show an hour, each with its weight.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Blend {
    /// Indices of frames; the weights sum to 1.
    pub parts: Vec<(usize, f32)>,
    /// What was chosen, in words.
    pub note: String,
    /// Whether the lamps are not as they are at that hour.
    pub is_doubtful: bool,
}

impl Blend {
    /// The frame of this hour; else its two neighbours on the circle of the day, linearly, or, where groups
    /// switch between them, the one whose groups are as they are then; else the nearest frame of all that has
    /// them so (as a bundle decodes).
    pub(super) fn new(config: &Config, hour: f64) -> Self {
        /// Two times of day nearer than this are one, in hours.
        const SAME: f64 = 1e-6;
        let frames = &config.frames;
        let name = |frame: usize| format!("{:.2} h", frames[frame].hour);
        let whole = |frame: usize, note: String, is_doubtful: bool| Blend {
            parts: vec![(frame, 1.0)],
            note,
            is_doubtful,
        };
        if let Some(frame) = frames.iter().position(|frame| (frame.hour - hour).abs() < SAME) {
            return whole(frame, format!("the frame of {}", name(frame)), false);
        }
        let after = frames.iter().position(|frame| frame.hour > hour).unwrap_or(0);
        let before = (after + frames.len() - 1) % frames.len();
        let on: Vec<bool> = config.groups.iter().map(|group| is_on(&group.on, hour)).collect();
        let fits = |frame: usize| frames[frame].groups_on == on;
        let (since, until) =
            ((hour - frames[before].hour).rem_euclid(24.0), (frames[after].hour - hour).rem_euclid(24.0));
        if before == after {
            let note = format!("the frame of {}, the only one", name(before));
            return whole(before, note, !fits(before));
        }
        match (fits(before), fits(after)) {
            (true, true) => {
                let weight = (since / (since + until)) as f32;
                Blend {
                    parts: vec![(before, 1.0 - weight), (after, weight)],
                    note: format!("linear between the frames of {} and {}", name(before), name(after)),
                    is_doubtful: false,
                }
            }
            (true, false) => {
                whole(before, format!("the frame of {}: lamps switch before the next", name(before)), false)
            }
            (false, true) => whole(
                after,
                format!("the frame of {}: lamps switch after the one before", name(after)),
                false,
            ),
            (false, false) => {
                let away = |frame: usize| {
                    let apart = (frames[frame].hour - hour).abs();
                    apart.min(24.0 - apart)
                };
                // Those that fit first, then by distance.
                let order = |&a: &usize, &b: &usize| fits(b).cmp(&fits(a)).then(away(a).total_cmp(&away(b)));
                let nearest = (0..frames.len()).min_by(order).unwrap_or(before);
                let whose = if fits(nearest) { "no neighbour has" } else { "no frame has" };
                let note = format!(
                    "the frame of {}, the nearest: {whose} the lamps as they are then",
                    name(nearest)
                );
                whole(nearest, note, true)
            }
        }
    }
}

impl Blend {
    /// A warning where all of its frames are hours away from what is asked for, and their light may be quite
    /// another; it says which hours there are.
    pub(super) fn far(&self, config: &Config, hour: f64) -> Option<String> {
        /// As much of a day is interpolated without a word, in hours.
        const NEAR: f64 = 2.0;
        /// Hours that are listed.
        const MOST: usize = 30;
        let apart = |frame: &(usize, f32)| {
            let apart = (config.frames[frame.0].hour - hour).abs();
            apart.min(24.0 - apart)
        };
        let nearest = self.parts.iter().map(apart).fold(f64::INFINITY, f64::min);
        if nearest <= NEAR {
            return None;
        }
        let mut hours: Vec<String> = config
            .frames
            .iter()
            .take(MOST)
            .map(|s| format!("{}", (s.hour * 100.0).round() / 100.0))
            .collect();
        if config.frames.len() > MOST {
            hours.push("…".to_owned());
        }
        Some(format!(
            "{hour:.2} h is {nearest:.1} h from the nearest lightmap shown ({}): the picture may show quite another light. The dataset \
             has the hours {}; choose one of these, or bake more with --hours",
            self.note,
            hours.join(", ")
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A dataset of these hours with one group; it is lit at the frames as told.
    fn config(on: [f64; 2], frames: &[(f64, bool)]) -> Config {
        let file = json!({ "path": "data/a.exr", "bytes": 1, "blake3": "0".repeat(64) });
        let frame = |&(hour, on): &(f64, bool)| json!({ "hour": hour, "groups_on": [on], "relative_error": null, "maps": [file] });
        serde_json::from_value(json!({
            "format": "temporal-lightmaps", "version": 2, "scene": "s", "generator": "", "unit": "", "seed": 1, "inputs": "",
            "samples": 1, "pages": [], "sun": null, "sky": null,
            "groups": [{ "name": "lamp", "on": [on], "baked": "all" }], "layers": [],
            "frames": frames.iter().map(frame).collect::<Vec<_>>(), "noise": null, "geometry": null, "instances": [], "settings": null,
        }))
        .unwrap()
    }

    #[test]
    fn hours_are_linear_between_sets_but_not_across_a_switch() {
        let day = [(6.0, false), (12.0, false), (18.0, false), (18.1, true), (22.0, true)];
        let config = config([18.0, 23.0], &day);
        let parts = |hour: f64| Blend::new(&config, hour).parts;
        assert_eq!(parts(12.0), [(1, 1.0)]);
        assert_eq!(parts(7.5), [(0, 0.75), (1, 0.25)]);
        // Lit from 18: at the very instant off, right after it on.
        assert_eq!(parts(18.0), [(2, 1.0)]);
        assert_eq!(parts(18.01), [(3, 1.0)]);
        assert_eq!(parts(17.9), [(1, 1.0 - 5.9f32 / 6.0), (2, 5.9 / 6.0)]);
        // Out at 23: before it the frame of 22, after it that of 6.
        assert_eq!(parts(22.9), [(4, 1.0)]);
        assert_eq!(parts(23.5), [(0, 1.0)]);
        assert!(!Blend::new(&config, 23.5).is_doubtful);
    }

    #[test]
    fn hours_far_from_all_that_are_shown_are_told() {
        let morning = config([1.0, 1.5], &[(8.0, false), (9.0, false), (10.0, false)]);
        let far = |hour: f64| Blend::new(&morning, hour).far(&morning, hour);
        for near in [8.0, 8.5, 12.0, 6.5] {
            assert_eq!(far(near), None, "{near}");
        }
        let told = far(20.0).expect("a warning");
        assert!(
            told.starts_with("20.00 h is 10.0 h from") && told.contains("has the hours 8, 9, 10;"),
            "{told}"
        );
        // The nearest of the day is not shown, for its lamps are others.
        let lit = config([7.0, 9.5], &[(8.0, true), (22.0, false), (23.0, false)]);
        assert!(Blend::new(&lit, 9.75).far(&lit, 9.75).is_some());
        // Across midnight it is near.
        assert_eq!(Blend::new(&lit, 0.5).far(&lit, 0.5), None);
    }

    #[test]
    fn across_midnight_and_where_nothing_fits() {
        let off = config([1.0, 2.0], &[(6.0, false), (22.0, false)]);
        assert_eq!(Blend::new(&off, 0.0).parts, [(1, 0.75), (0, 0.25)]);
        // Lit at 1:30, when no frame shows it.
        let lit = Blend::new(&off, 1.5);
        assert!(lit.is_doubtful && lit.parts == [(1, 1.0)] && lit.note.contains("nearest"), "{lit:?}");
        // Neither neighbour shows it, but another frame does.
        let far = config([1.0, 20.0], &[(2.0, true), (6.0, false), (12.0, false), (18.0, true)]);
        let other = Blend::new(&far, 9.5);
        assert!(
            other.is_doubtful && other.parts == [(0, 1.0)] && other.note.contains("no neighbour"),
            "{other:?}"
        );
        let one = Blend::new(&config([1.0, 2.0], &[(6.0, false)]), 1.5);
        assert!(one.is_doubtful && one.parts == [(0, 1.0)], "{one:?}");
    }
}
