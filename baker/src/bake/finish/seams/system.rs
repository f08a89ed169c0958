//! The least-squares problem of texels at seams, and its solution by conjugate gradients.

use rayon::prelude::*;

/// Stops when the residual has fallen by this factor in the norm of the preconditioner. Conjugate gradients
/// are not linear in the right-hand side before they end, so they are led on until the rest is below the
/// rounding of `f32`.
const TOLERANCE: f64 = 1e-7;
/// More steps than this do not help: rounding is in the way.
const MOST_STEPS: usize = 1000;

/// Weights below this are what rounding leaves of zero.
const CANCELLED: f32 = 1e-6;

/// What a texel may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Freedom {
    /// It keeps its value.
    Fixed,
    /// It moves from its value at this price per square.
    Free(f64),
}

/// A point of a seam: the texels under it, each with its bilinear weight, positive on one side of the seam
/// and negative on the other, and texels of the page's length that it stands for.
#[derive(Clone, Debug)]
pub(super) struct Point {
    /// Page texel and weight; a texel may come twice.
    pub taps: [(u32, f32); 8],
    /// Texels.
    pub length: f32,
}

/// Texels at seams with what binds them. With x the values now, minimises over the changes d
///
///   Σ over points: length · (Σ weight · (x + d))² + Σ over texels: price · d²,
///
/// which makes d linear in x.
#[derive(Debug, Default)]
pub(super) struct System {
    /// Per texel, its place on the page; those of an island together.
    texels: Vec<u32>,
    /// Per texel; infinite for those that are fixed.
    prices: Vec<f64>,
    /// Per texel, one over the diagonal of the normal matrix; zero for those that are fixed.
    inverse_diagonal: Vec<f64>,
    /// Per point, the first of its taps; and the end.
    starts: Vec<u32>,
    /// Index into `texels`, and the weight times the root of the point's length.
    taps: Vec<(u32, f32)>,
    /// Per point, the root of its length.
    roots: Vec<f32>,
    /// Parts that do not touch each other.
    islands: Vec<Island>,
}

#[derive(Debug)]
struct Island {
    texels: std::ops::Range<usize>,
    points: std::ops::Range<usize>,
}

type Rgb = [f64; 3];

impl System {
    /// Sorts the points into islands.
    pub(super) fn new(points: &[Point], freedom: impl Fn(u32) -> Freedom) -> System {
        let used = |point: &Point| point.taps.into_iter().filter(|tap| tap.1 != 0.0);
        let mut texels: Vec<u32> = points.iter().flat_map(used).map(|tap| tap.0).collect();
        texels.par_sort_unstable();
        texels.dedup();
        let index = |texels: &[u32], texel: u32| texels.partition_point(|&t| t < texel) as u32;

        // Texels under one point belong together.
        let mut parents: Vec<u32> = (0..texels.len() as u32).collect();
        let mut ends = Vec::with_capacity(points.len());
        for point in points {
            let mut first = u32::MAX;
            for (texel, _) in used(point) {
                let root = find(&mut parents, index(&texels, texel));
                let other = if first == u32::MAX { root } else { find(&mut parents, first) };
                // The lowest is the root, so that the order of the points does not matter.
                parents[root.max(other) as usize] = root.min(other);
                first = root.min(other);
            }
            ends.push(first);
        }
        let island_of: Vec<u32> = (0..texels.len() as u32).map(|t| find(&mut parents, t)).collect();
        let mut texel_order: Vec<u32> = (0..texels.len() as u32).collect();
        texel_order.sort_by_key(|&t| island_of[t as usize]);
        let mut position = vec![0; texels.len()];
        (0..).zip(&texel_order).for_each(|(new, &old)| position[old as usize] = new);
        let island_of_point = |p: &u32| island_of[ends[*p as usize] as usize];
        let mut point_order: Vec<u32> =
            (0..points.len() as u32).filter(|&p| ends[p as usize] != u32::MAX).collect();
        point_order.sort_by_key(island_of_point);

        let mut system = System::default();
        let free = |texel: u32| match freedom(texel) {
            Freedom::Fixed => f64::INFINITY,
            Freedom::Free(price) => price,
        };
        system.texels = texel_order.iter().map(|&old| texels[old as usize]).collect();
        system.prices = system.texels.iter().map(|&texel| free(texel)).collect();
        let mut diagonal = system.prices.clone();
        for &p in &point_order {
            let point = &points[p as usize];
            let root = point.length.sqrt();
            let first = system.taps.len();
            for (texel, weight) in used(point) {
                let texel = position[index(&texels, texel) as usize];
                match system.taps[first..].iter_mut().find(|tap| tap.0 == texel) {
                    Some(tap) => tap.1 += weight * root,
                    None => system.taps.push((texel, weight * root)),
                }
            }
            // What cancels out, where both sides lie in one texel, is rounding.
            let kept: Vec<(u32, f32)> =
                system.taps.drain(first..).filter(|tap| tap.1.abs() > CANCELLED * root).collect();
            system.taps.extend(kept);
            system.starts.push(first as u32);
            system.roots.push(root);
            for &(texel, weight) in &system.taps[first..] {
                diagonal[texel as usize] += f64::from(weight) * f64::from(weight);
            }
        }
        system.starts.push(system.taps.len() as u32);
        // One over infinity is zero.
        system.inverse_diagonal = diagonal.into_iter().map(|d| 1.0 / d).collect();

        let (mut texel, mut point) = (0, 0);
        while texel < texel_order.len() {
            let island = island_of[texel_order[texel] as usize];
            let texels =
                texel_order[texel..].iter().take_while(|&&t| island_of[t as usize] == island).count();
            let points = point_order[point..].iter().take_while(|p| island_of_point(p) == island).count();
            system.islands.push(Island { texels: texel..texel + texels, points: point..point + points });
            (texel, point) = (texel + texels, point + points);
        }
        system
    }

    /// Page texels the system knows.
    pub(super) fn texels(&self) -> &[u32] {
        &self.texels
    }

    /// The texels' light after they are moved, from what it is before. What would fall below zero becomes
    /// zero.
    pub(super) fn solve(&self, light: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let texel = |t: usize| light[t].map(f64::from);
        let changes: Vec<Vec<Rgb>> =
            self.islands.par_iter().map(|island| self.changes(island, texel)).collect();
        let mut solved = light.to_vec();
        for (island, changes) in self.islands.iter().zip(&changes) {
            for (t, change) in island.texels.clone().zip(changes) {
                if self.inverse_diagonal[t] > 0.0 {
                    let value = texel(t);
                    solved[t] = [0, 1, 2].map(|c| (value[c] + change[c]).max(0.0) as f32);
                }
            }
        }
        solved
    }

    /// The changes of an island's texels.
    fn changes(&self, island: &Island, value: impl Fn(usize) -> Rgb) -> Vec<Rgb> {
        let n = island.texels.len();
        let first = island.texels.start;
        // r = −Aᵀ A x, z = D⁻¹ r: without a change yet, the price is nought.
        let values: Vec<Rgb> = island.texels.clone().map(value).collect();
        let mut r = vec![[0.0; 3]; n];
        self.apply(island, &values, &mut r);
        for (t, r) in r.iter_mut().enumerate() {
            // Fixed texels have no equation.
            *r = if self.inverse_diagonal[first + t] > 0.0 { r.map(|r| -r) } else { [0.0; 3] };
        }
        let mut d = vec![[0.0; 3]; n];
        let mut q = d.clone();
        let inverse = &self.inverse_diagonal[island.texels.clone()];
        let mut p: Vec<Rgb> = r.iter().zip(inverse).map(|(r, i)| r.map(|r| r * i)).collect();
        let mut rho = dot(&r, &p);
        let least = rho.map(|rho| rho * TOLERANCE * TOLERANCE);
        for _ in 0..MOST_STEPS {
            // The three channels share the matrix; one that is done stands still.
            let open: [bool; 3] = [0, 1, 2].map(|c| rho[c] > least[c] && rho[c].is_finite());
            if open == [false; 3] {
                break;
            }
            q.iter_mut().for_each(|q| *q = [0.0; 3]);
            self.apply(island, &p, &mut q);
            for ((q, p), (&price, &inverse)) in
                q.iter_mut().zip(&p).zip(self.prices[island.texels.clone()].iter().zip(inverse))
            {
                *q = if inverse > 0.0 { [0, 1, 2].map(|c| q[c] + price * p[c]) } else { [0.0; 3] };
            }
            let pq = dot(&p, &q);
            let alpha = [0, 1, 2].map(|c| if open[c] && pq[c] > 0.0 { rho[c] / pq[c] } else { 0.0 });
            for ((d, r), (p, q)) in d.iter_mut().zip(&mut r).zip(p.iter().zip(&q)) {
                (0..3).for_each(|c| d[c] += alpha[c] * p[c]);
                (0..3).for_each(|c| r[c] -= alpha[c] * q[c]);
            }
            let mut next = [0.0; 3];
            for (r, i) in r.iter().zip(inverse) {
                (0..3).for_each(|c| next[c] += r[c] * r[c] * i);
            }
            let beta = [0, 1, 2].map(|c| if open[c] { next[c] / rho[c] } else { 0.0 });
            for ((p, r), i) in p.iter_mut().zip(&r).zip(inverse) {
                (0..3).for_each(|c| p[c] = r[c] * i + beta[c] * p[c]);
            }
            rho = next;
        }
        d
    }

    /// Adds Aᵀ A v to `sum`, with a row of A per point of the island.
    fn apply(&self, island: &Island, v: &[Rgb], sum: &mut [Rgb]) {
        let first = island.texels.start;
        for taps in island.points.clone().map(|p| self.taps(p)) {
            let mut jump = [0.0; 3];
            for &(texel, weight) in taps {
                let v = v[texel as usize - first];
                (0..3).for_each(|c| jump[c] += f64::from(weight) * v[c]);
            }
            for &(texel, weight) in taps {
                let sum = &mut sum[texel as usize - first];
                (0..3).for_each(|c| sum[c] += f64::from(weight) * jump[c]);
            }
        }
    }

    fn taps(&self, point: usize) -> &[(u32, f32)] {
        &self.taps[self.starts[point] as usize..self.starts[point + 1] as usize]
    }

    /// Per point with its length: the difference of both sides, and their sum.
    pub(super) fn jumps<'a>(&'a self, light: &'a [[f32; 3]]) -> impl Iterator<Item = (f64, Rgb, Rgb)> + 'a {
        self.roots.iter().enumerate().map(|(p, &root)| {
            let root = f64::from(root);
            let (mut jump, mut sum) = ([0.0; 3], [0.0; 3]);
            for &(texel, weight) in self.taps(p) {
                let value = light[texel as usize];
                let part = value.map(|v| f64::from(weight) * f64::from(v) / root);
                (0..3).for_each(|c| jump[c] += part[c]);
                (0..3).for_each(|c| sum[c] += part[c].abs());
            }
            (root * root, jump, sum)
        })
    }
}

/// The root of a tree of texels; shortens the way to it.
fn find(parents: &mut [u32], mut texel: u32) -> u32 {
    while parents[texel as usize] != texel {
        let above = parents[parents[texel as usize] as usize];
        parents[texel as usize] = above;
        texel = above;
    }
    texel
}

/// Per channel, in order.
fn dot(a: &[Rgb], b: &[Rgb]) -> Rgb {
    let mut sum = [0.0; 3];
    for (a, b) in a.iter().zip(b) {
        (0..3).for_each(|c| sum[c] += a[c] * b[c]);
    }
    sum
}
