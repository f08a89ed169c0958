//! When the rounds of tracing stop.

use std::time::Instant;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Most samples of indirect light per texel, on average over the texels that still get any.
    pub samples: u32,
    /// Local error below which a cell of 16×16 texels gets no more samples; met where 95 % of the texels lie
    /// in such cells, in every frame.
    pub target_error: Option<f64>,
    /// When to stop whatever was reached; the first round is always made.
    pub deadline: Option<Instant>,
}

impl Limits {
    /// Whether nobody knows how many rounds there will be: towards a target, or under a time limit.
    pub fn have_target(&self) -> bool {
        self.target_error.is_some() || self.deadline.is_some()
    }
}
