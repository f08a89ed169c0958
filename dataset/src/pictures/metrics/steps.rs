//! Temporal error: the error of the change of light between two frames, seen as flicker or as a lamp that
//! lags.

use super::{RELATIVE_FLOOR, relative_error};

/// The change of light over valid texels from one frame to another, gathered image by image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepError {
    /// Sum over values of the squared error of the decoded change.
    squared_error: f64,
    /// Sum of the squared change.
    squared_change: f64,
    /// Sum of the light, the mean of both frames.
    light: f64,
    values: usize,
}

impl StepError {
    /// Adds texels of both frames, the earlier one first.
    pub fn add(&mut self, decoded: [&[[f32; 3]]; 2], reference: [&[[f32; 3]]; 2], valid: &[bool]) {
        for i in (0..valid.len()).filter(|&i| valid[i]) {
            for c in 0..3 {
                let [d0, d1] = decoded.map(|image| f64::from(image[i][c]));
                let [r0, r1] = reference.map(|image| f64::from(image[i][c]));
                self.squared_error += ((d1 - d0) - (r1 - r0)).powi(2);
                self.squared_change += (r1 - r0).powi(2);
                self.light += (r0 + r1) / 2.0;
                self.values += 1;
            }
        }
    }

    /// Of several steps together: RMS error of the change ÷ its RMS, so that each counts as its light
    /// changes. `None` if none of them changes.
    pub fn pooled<'a>(steps: impl Iterator<Item = &'a StepError>) -> Option<f64> {
        let of = steps.filter(|step| step.relative().is_some());
        let (error, change) =
            of.fold((0.0, 0.0), |(e, c), step| (e + step.squared_error, c + step.squared_change));
        (change > 0.0).then(|| (error / change).sqrt())
    }

    /// RMS error of the change ÷ its RMS, which is also that of the rate of change, the hours between being
    /// the same; `None` for a change below [`RELATIVE_FLOOR`] of the mean light, which is held to be none.
    pub fn relative(&self) -> Option<f64> {
        let n = self.values as f64;
        let (change, light) = ((self.squared_change / n).sqrt(), self.light / n);
        (change > RELATIVE_FLOOR * light).then(|| relative_error(self.squared_error / n, change, light))
    }
}
