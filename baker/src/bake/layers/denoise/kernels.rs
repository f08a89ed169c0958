//! The candidate filters: kernels that depend on nothing but where a texel's neighbours lie.

use super::neighbours::{MAX_NEIGHBOURS, Neighbour, REACH};
use std::sync::LazyLock;

/// Standard deviations of the Gaussians, in texels.
const GAUSSIANS: [f32; 4] = [1.0, 2.0, 4.0, 8.0];
/// Of which of them there is also a fit of first order.
const FITTED: [usize; 2] = [2, 3];
/// Candidates beside the unfiltered light.
pub(super) const FILTERS: usize = GAUSSIANS.len() + FITTED.len();
/// Index of the Gaussian that weights neighbours' error matrices.
const ERROR_GAUSSIAN: usize = 2;
/// Radius of that average, in texels.
pub(super) const ERROR_RADIUS: f32 = 6.0;
/// How near the nearest are, in texels: some twenty.
const NEAR: f32 = 2.5;
/// Entries of the table between squared distances 0 and REACH².
const STEPS: usize = 1024;

/// The Gaussians by squared distance, from 0 to the reach's.
static TABLE: LazyLock<Vec<[f32; GAUSSIANS.len()]>> = LazyLock::new(|| {
    let squared = |step: usize| (step as f32 + 0.5) / STEPS as f32 * REACH * REACH;
    let gauss = |squared: f32| GAUSSIANS.map(|sigma| (-squared / (2.0 * sigma * sigma)).exp());
    (0..=STEPS).map(|step| gauss(if step == 0 { 0.0 } else { squared(step) })).collect()
});

/// The weights of a texel's neighbours.
pub(super) struct Kernel {
    /// Of each neighbour, by candidate: they sum up to 1.
    pub weights: Vec<[f32; FILTERS]>,
    /// Of each neighbour, how much its error matrix counts.
    pub error_weights: Vec<f32>,
    /// The nearest neighbours, without the texel itself, by their places in the list.
    pub nearest: Vec<usize>,
}

impl Kernel {
    /// No weights yet.
    pub(super) fn new() -> Self {
        Kernel {
            weights: Vec::with_capacity(MAX_NEIGHBOURS),
            error_weights: Vec::with_capacity(MAX_NEIGHBOURS),
            nearest: Vec::new(),
        }
    }

    /// Finds the weights of a texel's neighbours, of which the first is itself.
    pub(super) fn find(&mut self, neighbours: &[Neighbour]) {
        self.weights.clear();
        self.error_weights.clear();
        self.nearest.clear();
        let near = neighbours.iter().enumerate().skip(1).filter(|(_, n)| n.squared <= NEAR * NEAR);
        self.nearest.extend(near.map(|(i, _)| i));
        let mut sums = [0.0f32; GAUSSIANS.len()];
        // Of the fitted: sums of weights × (1, x, y, x², xy, y²).
        let mut moments = [[0.0f64; 6]; FITTED.len()];
        for neighbour in neighbours {
            let step = (neighbour.squared * (STEPS as f32 / (REACH * REACH))) as usize;
            let gauss = TABLE[step.min(STEPS)];
            let mut weights = [0.0; FILTERS];
            weights[..GAUSSIANS.len()].copy_from_slice(&gauss);
            sums.iter_mut().zip(gauss).for_each(|(sum, gauss)| *sum += gauss);
            let [x, y] = neighbour.along.map(f64::from);
            for (moments, &of) in moments.iter_mut().zip(&FITTED) {
                let powers = [1.0, x, y, x * x, x * y, y * y];
                moments.iter_mut().zip(powers).for_each(|(m, power)| *m += f64::from(gauss[of]) * power);
            }
            self.weights.push(weights);
            let is_near = neighbour.squared <= ERROR_RADIUS * ERROR_RADIUS;
            self.error_weights.push(if is_near { gauss[ERROR_GAUSSIAN] } else { 0.0 });
        }
        let fits = moments.map(|moments| intercept(&moments));
        for (weights, neighbour) in self.weights.iter_mut().zip(neighbours) {
            let gauss: [f32; GAUSSIANS.len()] = std::array::from_fn(|k| weights[k]);
            for (k, sum) in sums.iter().enumerate() {
                weights[k] = gauss[k] / sum;
            }
            for (k, (fit, &of)) in fits.iter().zip(&FITTED).enumerate() {
                let [x, y] = neighbour.along;
                weights[GAUSSIANS.len() + k] = match fit {
                    Some([c, cx, cy]) => gauss[of] * (c + cx * x + cy * y),
                    None => gauss[of] / sums[of],
                };
            }
        }
    }
}

/// A first-order fit evaluated at the texel: the factor of each Gaussian weight is c + cx·x + cy·y. `None`
/// where the neighbours lie on a line, or so far to one side that it would extrapolate.
fn intercept(&[s, x, y, xx, xy, yy]: &[f64; 6]) -> Option<[f32; 3]> {
    /// Farthest that the neighbours' centroid may lie from the texel, in standard deviations of their
    /// positions.
    const MOST_ASIDE: f64 = 1.5;
    // About their middle: [xx xy; xy yy] ÷ s.
    let (mx, my) = (x / s, y / s);
    let (cxx, cxy, cyy) = (xx / s - mx * mx, xy / s - mx * my, yy / s - my * my);
    let determinant = cxx * cyy - cxy * cxy;
    // (Texels are one apart.)
    if determinant < 0.05 * (cxx + cyy).max(1.0) {
        return None;
    }
    // The slope of weights along x and y: −C⁻¹ m.
    let (sx, sy) = ((mx * cyy - my * cxy) / determinant, (my * cxx - mx * cxy) / determinant);
    let aside = mx * sx + my * sy;
    if aside > MOST_ASIDE * MOST_ASIDE {
        return None;
    }
    Some([(1.0 + aside) / s, -sx / s, -sy / s].map(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn neighbours(at: impl Iterator<Item = [f32; 2]>) -> Vec<Neighbour> {
        let neighbour = |(i, along): (usize, [f32; 2])| Neighbour {
            texel: i as u32,
            squared: along[0] * along[0] + along[1] * along[1],
            along,
        };
        at.enumerate().map(neighbour).collect()
    }

    #[test]
    fn weights_sum_up_to_one_and_fits_keep_slopes() {
        // All around, and at the edge of a surface.
        let all = (0..289).map(|i| [(i % 17) as f32 - 8.0, (i / 17) as f32 - 8.0]);
        let reach = |at: &[f32; 2]| at[0] * at[0] + at[1] * at[1] <= REACH * REACH;
        for least in [-9.0, 0.0, -2.5] {
            let neighbours = neighbours(all.clone().filter(reach).filter(|at| at[0] >= least));
            let mut kernel = Kernel::new();
            kernel.find(&neighbours);
            for k in 0..FILTERS {
                let sum = |f: &dyn Fn(&Neighbour) -> f32| {
                    kernel.weights.iter().zip(&neighbours).map(|(w, n)| w[k] * f(n)).sum::<f32>()
                };
                assert!((sum(&|_| 1.0) - 1.0).abs() < 1e-5);
                if k >= GAUSSIANS.len() {
                    assert!(sum(&|n| n.along[0]).abs() < 1e-4 && sum(&|n| n.along[1]).abs() < 1e-4);
                }
            }
        }
    }

    #[test]
    fn on_a_line_nothing_is_fitted() {
        let mut kernel = Kernel::new();
        kernel.find(&neighbours((0..9).map(|i| [i as f32, 0.0])));
        assert!(kernel.weights.iter().all(|w| w[GAUSSIANS.len()] == w[FITTED[0]]));
        kernel.find(&neighbours([[0.0; 2]].into_iter()));
        assert_eq!(kernel.weights, [[1.0; FILTERS]]);
    }
}
