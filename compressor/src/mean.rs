//! Means that evaluation and compression share.

/// The mean of the finite values; `None` if there are none.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    weighted_mean(values.map(|value| (value, 1)))
}

/// The mean of the finite ones of (value, weight), of weights that are not all 0.
pub(crate) fn weighted_mean(values: impl Iterator<Item = (f64, usize)>) -> Option<f64> {
    let add = |(sum, weights): (f64, f64), (v, weight): (f64, usize)| {
        (sum + weight as f64 * v, weights + weight as f64)
    };
    let (sum, weights) = values.filter(|(v, _)| v.is_finite()).fold((0.0, 0.0), add);
    (weights > 0.0).then(|| sum / weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_leave_out_what_is_not_finite_and_weigh() {
        assert_eq!(mean([1.0, f64::NAN, 3.0, f64::INFINITY].into_iter()), Some(2.0));
        assert_eq!(mean([f64::NAN].into_iter()), None);
        assert_eq!(weighted_mean([(1.0, 1), (3.0, 3), (f64::NAN, 100)].into_iter()), Some(2.5));
        assert_eq!(weighted_mean([(1.0, 0)].into_iter()), None);
    }
}
