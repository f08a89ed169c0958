//! Chooses the times of day that are rendered.

use crate::Result;
use crate::law::WIDEST;
use dataset::observe::count;
use dataset::store::Dataset;
use serde::Serialize;

/// The frames nearest to these hours are shown: morning, noon, evening.
const HOURS: [(&str, f64); 3] = [("morning", 8.0), ("noon", 12.0), ("evening", 20.0)];
/// How long after the first of them a time between frames is shown, in hours; half of the way to the next
/// frame where that is less.
const LATER: f64 = 0.25;
/// How long after a switch a time is shown, in hours.
const BESIDE: f64 = 0.05;

/// A time that is shown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shown {
    pub hour: f64,
    /// Which it is.
    pub what: String,
    /// The frame of that hour; `None` between frames.
    pub frame: Option<usize>,
}

/// The times of a dataset to render, and those that it lacks.
pub(super) fn choose(dataset: &Dataset) -> Result<(Vec<Shown>, Vec<String>)> {
    let frames = &dataset.config.frames;
    let (mut shown, mut skipped): (Vec<Shown>, Vec<String>) = (Vec::new(), Vec::new());
    for (what, wanted) in HOURS {
        let nearest = dataset.config.nearest_frame(wanted);
        if let Some(frame) = nearest.filter(|k| shown.iter().all(|shown| shown.frame != Some(*k))) {
            shown.push(Shown { hour: frames[frame].hour, what: what.to_owned(), frame: Some(frame) });
        }
    }
    let after = |hour: f64| frames.iter().find(|frame| frame.hour > hour).map(|frame| frame.hour);
    let later = shown.first().map(|first| first.hour).and_then(|first| {
        let step = after(first).map_or(LATER, |next| LATER.min(0.5 * (next - first)));
        Some(first + step).filter(|hour| *hour < 24.0)
    });
    match later {
        Some(hour) if is_baked(dataset, hour)? => {
            let minutes = (60.0 * (hour - shown[0].hour)).round() as usize;
            let what = format!("between frames, {} after the {}", count(minutes, "minute"), shown[0].what);
            shown.push(Shown { hour, what, frame: None });
        }
        _ => skipped.push("a time between frames: none was baked".to_owned()),
    }
    match last_switch(dataset)? {
        Some((hour, group)) => {
            let what = format!("near a switch, 3 minutes after “{group}” went on");
            let frame = frames.iter().position(|frame| frame.hour == hour);
            shown.push(Shown { hour, what, frame });
        }
        None => skipped.push("a time near a switch: no light group goes on in the baked day".to_owned()),
    }
    Ok((shown, skipped))
}

/// The time right after the last switch of the day by which a group goes on, and the group's name.
fn last_switch(dataset: &Dataset) -> Result<Option<(f64, &str)>> {
    let mut last: Option<(f64, &str)> = None;
    for group in &dataset.config.groups {
        for [from, _] in group.on.iter().filter(|[from, to]| (to - from).abs() < 24.0) {
            let hour = from + BESIDE;
            let is_later = last.is_none_or(|(last, _)| hour > last);
            if is_later && hour < 24.0 && is_baked(dataset, hour)? {
                last = Some((hour, group.name.as_str()));
            }
        }
    }
    Ok(last)
}

/// True if the dataset has light at an hour: its sun's path covers it, and the frames around it are not a
/// night apart.
pub(super) fn is_baked(dataset: &Dataset, hour: f64) -> Result<bool> {
    if dataset.sun_path()?.is_some_and(|path| path.at(hour).is_none()) {
        return Ok(false);
    }
    let hours: Vec<f64> = dataset.config.frames.iter().map(|frame| frame.hour).collect();
    let next = hours.partition_point(|frame| *frame <= hour);
    let (before, after) = (hours[(next + hours.len() - 1) % hours.len()], hours[next % hours.len()]);
    Ok(before == hour || (hours.len() > 1 && (after - before).rem_euclid(24.0) <= WIDEST))
}
