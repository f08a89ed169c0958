//! Small dense symmetric matrices, row by row.

/// Sweeps of Jacobi's method at most; it converges quadratically.
const SWEEPS: usize = 60;

/// Eigenvalues, descending, and for each its unit eigenvector, of a symmetric matrix of n rows: Jacobi's
/// cyclic method (Golub and Van Loan, "Matrix Computations", section 8.5).
pub(crate) fn eigen(mut a: Vec<f64>, n: usize) -> Vec<(f64, Vec<f64>)> {
    let mut vectors = vec![0.0; n * n];
    (0..n).for_each(|i| vectors[i * n + i] = 1.0);
    let total: f64 = a.iter().map(|x| x * x).sum();
    for _ in 0..SWEEPS {
        let off: f64 = (0..n * n).filter(|i| i % n != i / n).map(|i| a[i] * a[i]).sum();
        if off <= 1e-28 * total {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                rotate(&mut a, &mut vectors, n, p, q);
            }
        }
    }
    let mut pairs: Vec<(f64, Vec<f64>)> =
        (0..n).map(|i| (a[i * n + i], vectors[i * n..(i + 1) * n].to_vec())).collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    pairs
}

/// Makes a[p, q] zero; the rows of `vectors` turn with it.
fn rotate(a: &mut [f64], vectors: &mut [f64], n: usize, p: usize, q: usize) {
    let apq = a[p * n + q];
    if apq == 0.0 {
        return;
    }
    let tau = (a[q * n + q] - a[p * n + p]) / (2.0 * apq);
    let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    let turn = |x: &mut f64, y: &mut f64| (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
    // Columns, then rows.
    for row in a.chunks_exact_mut(n) {
        let (left, right) = row.split_at_mut(q);
        turn(&mut left[p], &mut right[0]);
    }
    for matrix in [a, vectors] {
        let (above, below) = matrix.split_at_mut(q * n);
        above[p * n..(p + 1) * n].iter_mut().zip(&mut below[..n]).for_each(|(x, y)| turn(x, y));
    }
}

/// X of A X = B by Gauss's elimination with pivots; A has n rows, B n rows of m. What A does not decide is 0.
pub(crate) fn solve(mut a: Vec<f64>, mut b: Vec<f64>, n: usize, m: usize) -> Vec<f64> {
    let largest = a.iter().fold(0.0f64, |l, x| l.max(x.abs()));
    let mut decided = vec![true; n];
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs())).unwrap_or(k);
        (0..n).for_each(|j| a.swap(k * n + j, pivot * n + j));
        (0..m).for_each(|j| b.swap(k * m + j, pivot * m + j));
        decided[k] = a[k * n + k].abs() > 1e-12 * largest;
        if !decided[k] {
            continue;
        }
        for i in k + 1..n {
            let factor = a[i * n + k] / a[k * n + k];
            (k..n).for_each(|j| a[i * n + j] -= factor * a[k * n + j]);
            (0..m).for_each(|j| b[i * m + j] -= factor * b[k * m + j]);
        }
    }
    for k in (0..n).rev() {
        for j in 0..m {
            let known: f64 = (k + 1..n).map(|i| a[k * n + i] * b[i * m + j]).sum();
            b[k * m + j] = if decided[k] { (b[k * m + j] - known) / a[k * n + k] } else { 0.0 };
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_give_the_matrix_back() {
        let n = 7;
        let mut random = crate::train::targets::Random::new(3);
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let value = f64::from(random.uniform(0.0, 1.0)) - 0.5;
                (a[i * n + j], a[j * n + i]) = (value, value);
            }
        }
        let pairs = eigen(a.clone(), n);
        assert!(pairs.is_sorted_by(|a, b| a.0 >= b.0));
        for i in 0..n {
            for j in 0..n {
                let sum: f64 = pairs.iter().map(|(value, v)| value * v[i] * v[j]).sum();
                assert!((sum - a[i * n + j]).abs() < 1e-12, "{i} {j}");
                let dot: f64 = (0..n).map(|k| pairs[i].1[k] * pairs[j].1[k]).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn equations_are_solved_and_what_is_not_decided_is_zero() {
        let x = solve(vec![0.0, 2.0, 4.0, 1.0], vec![6.0, 2.0, 7.0, 9.0], 2, 2);
        // 2 y = (6, 2), 4 x + y = (7, 9).
        assert_eq!(x, [1.0, 2.0, 3.0, 1.0]);
        assert_eq!(solve(vec![2.0, 0.0, 0.0, 0.0], vec![3.0, 0.0], 2, 1), [1.5, 0.0]);
    }
}
