//! Clustered principal component analysis (Sloan, Hall, Hart and Snyder 2003, "Clustered Principal Components
//! for Precomputed Radiance Transfer", section 4.2): points belong to the cluster whose affine subspace is
//! nearest.

use crate::linear::eigen;

/// Points in some dimensions, row by row.
pub(super) struct Points {
    pub dimensions: usize,
    pub values: Vec<f64>,
}

/// An affine subspace: a mean and orthonormal axes, by falling variance.
#[derive(Clone)]
pub(super) struct Subspace {
    mean: Vec<f64>,
    axes: Vec<Vec<f64>>,
    /// Of each axis there is, also those that are not kept.
    variances: Vec<f64>,
}

impl Points {
    fn iter(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.dimensions.max(1))
    }

    /// The principal components of some of the points, at most `rank` of them.
    pub(super) fn subspace(&self, is_in: impl Fn(usize) -> bool, rank: usize) -> Subspace {
        let n = self.dimensions;
        let points = || self.iter().enumerate().filter(|(i, _)| is_in(*i)).map(|(_, point)| point);
        let number = points().count().max(1) as f64;
        let mut mean = vec![0.0; n];
        points().for_each(|point| mean.iter_mut().zip(point).for_each(|(sum, x)| *sum += x / number));
        let mut covariance = vec![0.0; n * n];
        let mut from_mean = vec![0.0; n];
        for point in points() {
            from_mean.iter_mut().zip(point.iter().zip(&mean)).for_each(|(d, (x, mean))| *d = x - mean);
            for (i, x) in from_mean.iter().enumerate() {
                let row = &mut covariance[i * n..][..=i];
                row.iter_mut().zip(&from_mean).for_each(|(sum, y)| *sum += x * y / number);
            }
        }
        for i in 0..n {
            (0..i).for_each(|j| covariance[j * n + i] = covariance[i * n + j]);
        }
        let (variances, axes): (Vec<f64>, Vec<Vec<f64>>) = eigen(covariance, n).into_iter().unzip();
        Subspace { mean, axes: axes.into_iter().take(rank).collect(), variances }
    }

    /// The points in so few dimensions that at most this share of their variance is lost.
    pub(super) fn reduced(&self, lost: f64) -> Points {
        let all = self.subspace(|_| true, self.dimensions);
        let total: f64 = all.variances.iter().sum();
        let mut left = total;
        let kept = all.variances.iter().take_while(|variance| {
            let is_wanted = left > lost * total;
            left -= **variance;
            is_wanted
        });
        // One at least: points that are all the same are points too.
        let dimensions = kept.count().max(1).min(all.axes.len());
        let (axes, all) = (&all.axes[..dimensions], &all);
        let along =
            |point| axes.iter().map(move |axis| all.mean_to(point).zip(axis).map(|(d, a)| d * a).sum());
        Points { dimensions, values: self.iter().flat_map(along).collect() }
    }

    /// This many clusters initially, or fewer if there is nothing to divide: the one that is met worst is cut
    /// across its first axis, again and again.
    pub(super) fn divided(&self, number: usize, rank: usize) -> Vec<usize> {
        let mut of = vec![0; self.iter().count()];
        let whole = self.subspace(|_| true, rank);
        let missed = |of: &[usize], cluster: usize, space: &Subspace| -> f64 {
            let own = self.iter().zip(of).filter(|(_, own)| **own == cluster);
            own.map(|(point, _)| space.distance2(point)).sum()
        };
        let mut clusters = vec![(missed(&of, 0, &whole), whole)];
        while clusters.len() < number {
            let worst =
                (0..clusters.len()).max_by(|&a, &b| clusters[a].0.total_cmp(&clusters[b].0)).unwrap_or(0);
            let new = clusters.len();
            let space = clusters[worst].1.clone();
            let Some(axis) = space.axes.first().filter(|_| clusters[worst].0 > 0.0) else { break };
            for (of, point) in of.iter_mut().zip(self.iter()).filter(|(of, _)| **of == worst) {
                let along: f64 = space.mean_to(point).zip(axis).map(|(d, a)| d * a).sum();
                if along > 0.0 {
                    *of = new;
                }
            }
            for cluster in [worst, new] {
                let space = self.subspace(|i| of[i] == cluster, rank);
                let entry = (missed(&of, cluster, &space), space);
                if cluster == new { clusters.push(entry) } else { clusters[cluster] = entry }
            }
        }
        of
    }

    /// The subspaces of clusters, after some passes in which each point went to the nearest.
    pub(super) fn settled(&self, of: &mut [usize], rank: usize, passes: usize) -> Vec<Subspace> {
        let number = of.iter().max().map_or(1, |last| last + 1);
        let fit = |of: &[usize]| -> Vec<Subspace> {
            (0..number).map(|cluster| self.subspace(|i| of[i] == cluster, rank)).collect()
        };
        let mut spaces = fit(of);
        for _ in 0..passes {
            let mut changed = false;
            for (of, point) in of.iter_mut().zip(self.iter()) {
                let distance = |space: usize| spaces[space].distance2(point);
                let own = distance(*of);
                let (least, nearest) = (0..number)
                    .map(|space| (distance(space), space))
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .unwrap_or((own, *of));
                if least < own {
                    (*of, changed) = (nearest, true);
                }
            }
            if !changed {
                break;
            }
            spaces = fit(of);
        }
        spaces
    }

    /// The coordinates of all points, each along the axes of its own cluster.
    pub(super) fn coordinates<'a>(
        &'a self,
        of: &'a [usize],
        spaces: &'a [Subspace],
    ) -> impl Iterator<Item = f64> + 'a {
        self.iter().zip(of).flat_map(move |(point, &of)| {
            let space = &spaces[of];
            space.axes.iter().map(move |axis| space.mean_to(point).zip(axis).map(|(d, a)| d * a).sum())
        })
    }
}

impl Subspace {
    fn mean_to<'a>(&'a self, point: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        point.iter().zip(&self.mean).map(|(x, mean)| x - mean)
    }

    fn distance2(&self, point: &[f64]) -> f64 {
        let whole: f64 = self.mean_to(point).map(|d| d * d).sum();
        let along = |axis: &Vec<f64>| self.mean_to(point).zip(axis).map(|(d, a)| d * a).sum::<f64>().powi(2);
        (whole - self.axes.iter().map(along).sum::<f64>()).max(0.0)
    }
}
