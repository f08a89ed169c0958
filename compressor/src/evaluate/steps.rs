//! Temporal error: the error of the change of light from frame to frame, over the day and across switches.

use super::strips::{decode, read, strips, valid};
use crate::Result;
use crate::decode::{Decoder, Lights};
use crate::law::Law;
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Image;
use dataset::observe::Observer;
use dataset::pictures::StepError;
use dataset::store::Dataset;

/// From one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Hour of the first frame.
    pub from: f64,
    /// Hour of the second; past midnight that of the first frame of the day.
    pub to: f64,
    /// True where light groups switch in between.
    pub switch: bool,
    /// As [`StepError::relative`]: `None` if the light does not change.
    pub error: Option<f64>,
}

/// All steps of the day and their pooled errors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps {
    /// Every frame to the one after it; none where there is one frame.
    pub each: Vec<Step>,
    /// Error of the steps between frames with the same light groups on, all together ([`StepError::pooled`]):
    /// that of a bright hour counts for more than that of a night.
    pub smooth: Option<f64>,
    /// The same of the steps across a switch.
    pub switch: Option<f64>,
}

impl Steps {
    /// Of frames at `hours`, with the light groups that are on.
    pub(crate) fn new(hours: &[f64], groups_on: &[Vec<bool>], errors: &[StepError]) -> Self {
        let n = hours.len();
        let step = |(k, error): (usize, &StepError)| {
            let next = (k + 1) % n;
            let (from, to) = (hours[k], hours[next]);
            Step { from, to, switch: groups_on[k] != groups_on[next], error: error.relative() }
        };
        let each: Vec<Step> = errors.iter().enumerate().map(step).collect();
        let of = |switch: bool| {
            let steps = each.iter().zip(errors).filter(|(step, _)| step.switch == switch);
            StepError::pooled(steps.map(|(_, error)| error))
        };
        Steps { smooth: of(false), switch: of(true), each }
    }
}

/// Evaluates a bundle's steps; the bundle is the dataset's.
pub(super) fn steps(
    dataset: &Dataset,
    law: &Law,
    decoder: &Decoder,
    console: &dyn Observer,
) -> Result<Steps> {
    let frames = &dataset.config.frames;
    let n = frames.len();
    if n < 2 {
        return Ok(Steps::default());
    }
    let mut errors = vec![StepError::default(); n];
    let progress = console.progress("frame to frame", (n * dataset.config.pages.len()) as u64);
    for page in 0..dataset.config.pages.len() {
        let mask = dataset.mask(page)?;
        for rows in strips(&mask) {
            let load = |k: usize| -> Result<[Image; 2]> {
                stop_if_interrupted()?;
                Ok([
                    decode(decoder, Lights::All, page, frames[k].hour, &rows)?,
                    read(dataset, law, k, page, &rows)?,
                ])
            };
            let valid = valid(&mask, &rows);
            let mut before = load(0)?;
            for (k, error) in errors.iter_mut().enumerate() {
                let after = load((k + 1) % n)?;
                let [decoded, reference] =
                    [0, 1].map(|i| [before[i].texels.as_slice(), after[i].texels.as_slice()]);
                error.add(decoded, reference, valid);
                before = after;
            }
        }
        progress.advance(n as u64);
    }
    let hours: Vec<f64> = frames.iter().map(|frame| frame.hour).collect();
    let groups_on: Vec<Vec<bool>> = frames.iter().map(|frame| frame.groups_on.clone()).collect();
    Ok(Steps::new(&hours, &groups_on, &errors))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_across_a_switch_stand_apart_and_the_last_goes_to_the_first() {
        let error = |error: f32| {
            let mut step = StepError::default();
            step.add([&[[1.0; 3]], &[[2.0 + error; 3]]], [&[[1.0; 3]], &[[2.0; 3]]], &[true]);
            step
        };
        let (hours, on) = ([1.0, 5.0, 9.0], [vec![false], vec![false], vec![true]]);
        let steps = Steps::new(&hours, &on, &[error(0.25), error(0.5), error(1.0)]);
        let switches: Vec<bool> = steps.each.iter().map(|step| step.switch).collect();
        assert_eq!(switches, [false, true, true]);
        assert_eq!((steps.each[2].from, steps.each[2].to), (9.0, 1.0));
        // (0.5² + 1²) / 2 of the change squared.
        assert!(steps.switch.is_some_and(|error| (error - 0.625f64.sqrt()).abs() < 1e-9));
        assert!(steps.smooth.is_some_and(|error| (error - 0.25).abs() < 1e-9));
    }
}
