//! A light BVH: chooses one of many lights in proportion to a bound of what each may give (Conty Estevez &
//! Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting").
//!
//! Splitting serves to know more, not to take more samples: from the root, those nodes that are large as seen
//! from the receiver are opened until a front of [`FRONT_NODES`] nodes stands, one of which is chosen; below
//! it the descent chooses between two children at a time. Where the front reaches single lights the choice is
//! the exact one.

use super::lamp::Outline;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Nodes of the front.
const FRONT_NODES: usize = 20;
/// A node is opened only if its radius is more than this part of its distance.
const OPEN_ABOVE: f32 = 0.15;
/// Bins per axis when building.
const BINS: usize = 12;

/// The tree over lights 0 … n − 1.
#[derive(Clone, Debug)]
pub(super) struct LightTree {
    /// Preorder: a node's first child follows it.
    nodes: Vec<Node>,
    /// The light of each slot; a node's lights are in neighbouring slots.
    lights: Vec<u32>,
    /// The slot of each light.
    slots: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    /// A box around its lights, middle and half extents, and the radius of the ball around that.
    centre: Vec3,
    half: Vec3,
    radius: f32,
    /// The cone of its lights' normals: axis, cosine and sine of the half angle.
    axis: Vec3,
    cos_spread: f32,
    sin_spread: f32,
    /// Cosine of the greatest angle between a normal and light.
    cos_reach: f32,
    /// Sum of intensities.
    intensity: f32,
    /// Its slots.
    first: u32,
    count: u32,
    /// Its second child; 0: a leaf, one light.
    second: u32,
}

/// A few nodes that together hold every light, and their importances.
struct Front {
    nodes: [(u32, f32); FRONT_NODES],
    len: usize,
    total: f32,
}

impl LightTree {
    /// Builds the tree over at least one light.
    pub(super) fn new(outlines: &[Outline]) -> Self {
        let mut lights: Vec<u32> = (0..outlines.len() as u32).collect();
        let mut nodes = Vec::with_capacity(2 * outlines.len());
        build(outlines, &mut lights, 0, 0, &mut nodes);
        let mut slots = vec![0; lights.len()];
        for (slot, &light) in lights.iter().enumerate() {
            slots[light as usize] = slot as u32;
        }
        Self { nodes, lights, slots }
    }

    /// A guess of the irradiance that all lights give.
    pub(super) fn all(&self, p: Vec3, n: Vec3, exact: impl Fn(u32) -> f32) -> f32 {
        self.importance(0, p, n, &exact)
    }

    /// A light and the probability of choosing it; `u` in [0, 1). `exact` is the importance of a single
    /// light. `None` where no light has any.
    pub(super) fn choose(&self, p: Vec3, n: Vec3, u: f32, exact: impl Fn(u32) -> f32) -> Option<(u32, f32)> {
        let front = self.front(p, n, &exact);
        if front.total <= 0.0 {
            return None;
        }
        // One node of the front.
        let mut left = u * front.total;
        let mut chosen = None;
        for &(node, share) in &front.nodes[..front.len] {
            if share > 0.0 {
                chosen = Some((node, share, (left / share).clamp(0.0, ONE_BELOW)));
                if left < share {
                    break;
                }
                left -= share;
            }
        }
        let (mut node, share, mut u) = chosen?;
        let mut probability = share / front.total;
        // Down to a light.
        while self.nodes[node as usize].second != 0 {
            let first = self.first_share(node, p, n, &exact);
            // The number is used again: what is left of it is uniform.
            if u < first {
                (node, probability, u) = (node + 1, probability * first, u / first);
            } else {
                (node, probability, u) = (
                    self.nodes[node as usize].second,
                    probability * (1.0 - first),
                    (u - first) / (1.0 - first),
                );
            }
            u = u.min(ONE_BELOW);
        }
        Some((self.lights[self.nodes[node as usize].first as usize], probability))
    }

    /// The probability with which [`LightTree::choose`] gives `light`; `None` where it gives none at all.
    pub(super) fn probability(
        &self,
        p: Vec3,
        n: Vec3,
        light: u32,
        exact: impl Fn(u32) -> f32,
    ) -> Option<f32> {
        let front = self.front(p, n, &exact);
        if front.total <= 0.0 {
            return None;
        }
        let slot = self.slots[light as usize];
        let holds = |node: u32| {
            let node = &self.nodes[node as usize];
            (node.first..node.first + node.count).contains(&slot)
        };
        let Some(&(mut node, share)) = front.nodes[..front.len].iter().find(|(node, _)| holds(*node)) else {
            return Some(0.0);
        };
        let mut probability = share / front.total;
        while probability > 0.0 && self.nodes[node as usize].second != 0 {
            let first = self.first_share(node, p, n, &exact);
            if holds(node + 1) {
                (node, probability) = (node + 1, probability * first);
            } else {
                (node, probability) = (self.nodes[node as usize].second, probability * (1.0 - first));
            }
        }
        Some(probability)
    }

    /// The first child's share of an inner node; a half where neither child turns out to have importance.
    fn first_share(&self, node: u32, p: Vec3, n: Vec3, exact: &impl Fn(u32) -> f32) -> f32 {
        let a = self.importance(node + 1, p, n, exact);
        let b = self.importance(self.nodes[node as usize].second, p, n, exact);
        if a <= 0.0 && b <= 0.0 { 0.5 } else { a / (a + b) }
    }

    fn front(&self, p: Vec3, n: Vec3, exact: &impl Fn(u32) -> f32) -> Front {
        let mut nodes = [(0, 0.0); FRONT_NODES];
        // How much may be gained by opening each: the most it may give, if it is large.
        let mut worth = [0.0; FRONT_NODES];
        let bounds_of = |node: u32| {
            let (importance, most) = self.bounds_of(node, p, n, exact);
            let at = &self.nodes[node as usize];
            let large = at.radius > OPEN_ABOVE * p.distance(at.centre);
            ((node, importance), if large { most } else { 0.0 })
        };
        (nodes[0], worth[0]) = bounds_of(0);
        let mut len = 1;
        while len < FRONT_NODES {
            let mut most = 0;
            for i in 1..len {
                if worth[i] > worth[most] {
                    most = i;
                }
            }
            if worth[most] <= 0.0 {
                break;
            }
            let node = nodes[most].0;
            (nodes[most], worth[most]) = bounds_of(node + 1);
            (nodes[len], worth[len]) = bounds_of(self.nodes[node as usize].second);
            len += 1;
        }
        let total = nodes[..len].iter().map(|(_, importance)| importance).sum();
        Front { nodes, len, total }
    }

    /// A guess of the irradiance a node's lights give: 0 only where none can give any.
    fn importance(&self, node: u32, p: Vec3, n: Vec3, exact: &impl Fn(u32) -> f32) -> f32 {
        self.bounds_of(node, p, n, exact).0
    }

    /// The guess, and for an inner node the most that they could give if all stood where the box is nearest.
    fn bounds_of(&self, node: u32, p: Vec3, n: Vec3, exact: &impl Fn(u32) -> f32) -> (f32, f32) {
        let node = &self.nodes[node as usize];
        if node.second == 0 {
            return (exact(self.lights[node.first as usize]), 0.0);
        }
        let offset = node.centre - p;
        let radius = node.radius.max(f32::MIN_POSITIVE.sqrt());
        let distance2 = offset.length_squared();
        let outside = distance2 > radius * radius * 1.0001;
        let distance = distance2.sqrt().max(radius);
        // Heights over the receiver's plane: the middle's, and how far the box reaches beyond it.
        let (height, reach) = (offset.dot(n), node.half.dot(n.abs()));
        if height + reach < -COSINE_SLACK * distance {
            return (0.0, 0.0);
        }
        // Distance of the box; no less than a part of its size, for there is no bound in it.
        let nearest = ((node.centre - p).abs() - node.half).max(Vec3::ZERO).length();
        let near = nearest.max(0.01 * radius);
        let mut from_middle = (positive_part(height, reach) / distance).max(COSINE_SLACK);
        let mut from_nearest = ((height + reach) / near).clamp(COSINE_SLACK, 1.0);
        // The same at the lights: heights over the planes of the cone's nearest normal.
        if node.cos_spread > -1.0 {
            let (height, reach) = (-offset.dot(node.axis), node.half.dot(node.axis.abs()));
            if outside {
                // The greatest cosine to a normal: the angle to the axis less the cone's and the ball's.
                let sin2_ball = radius * radius / distance2;
                let cosine = cos_within(height / distance, node.cos_spread, node.sin_spread);
                if cos_within(cosine, (1.0 - sin2_ball).sqrt(), sin2_ball.sqrt())
                    < node.cos_reach - COSINE_SLACK
                {
                    return (0.0, 0.0);
                }
            } else if node.sin_spread == 0.0
                && node.cos_reach >= 0.0
                && height + reach < -COSINE_SLACK * distance
            {
                return (0.0, 0.0);
            }
            let cosine = cos_within((height / distance).clamp(-1.0, 1.0), node.cos_spread, node.sin_spread);
            let aside = (reach * node.cos_spread.max(0.0) + radius * node.sin_spread) / distance;
            from_middle *= positive_part(cosine, aside).max(COSINE_SLACK);
            let cosine = ((height + reach) / near).clamp(-1.0, 1.0);
            from_nearest *= cos_within(cosine, node.cos_spread, node.sin_spread).max(COSINE_SLACK);
        }
        let from_middle = from_middle / (distance * distance);
        let from_nearest = from_nearest / (near * near);
        // Between the two; but in the box the nearest lights give most, whatever the cosines: of lights
        // spread evenly over a ceiling of radius r, intensity / r² whatever its height.
        let between = from_middle.sqrt() * from_nearest.sqrt();
        let within = (1.0 - 2.0 * nearest / radius).max(0.0);
        let guess = between + within * (1.0 / (radius * radius) - between);
        let bounded = |x: f32| {
            let importance = node.intensity * x;
            // (At the very place of all lights it is no number.)
            if importance.is_nan() {
                LARGEST_IMPORTANCE
            } else {
                importance.clamp(f32::MIN_POSITIVE, LARGEST_IMPORTANCE)
            }
        };
        (bounded(guess), bounded(from_nearest))
    }
}

/// What rounding may do to a cosine here.
const COSINE_SLACK: f32 = 1e-4;
/// The largest importance: sums stay finite.
const LARGEST_IMPORTANCE: f32 = 1e30;
/// The number below 1.
const ONE_BELOW: f32 = 1.0 - f32::EPSILON / 2.0;

/// The mean of max(0, x) for x even in `middle` ± `reach`.
fn positive_part(middle: f32, reach: f32) -> f32 {
    if middle >= reach {
        middle
    } else if middle <= -reach {
        0.0
    } else {
        (middle + reach) * ((middle + reach) / (4.0 * reach))
    }
}

/// cos max(0, θ − a).
fn cos_within(cosine: f32, cos_a: f32, sin_a: f32) -> f32 {
    if cosine >= cos_a {
        return 1.0;
    }
    cosine * cos_a + (1.0 - cosine * cosine).max(0.0).sqrt() * sin_a
}

/// Appends the node over `lights` (slots from `first` on) and everything below it.
fn build(outlines: &[Outline], lights: &mut [u32], first: u32, depth: u32, nodes: &mut Vec<Node>) {
    let here = nodes.len();
    let bound = lights.iter().fold(Bound::EMPTY, |b, &light| b.with(&Bound::of(&outlines[light as usize])));
    nodes.push(bound.node(first, lights.len() as u32));
    if lights.len() == 1 {
        return;
    }
    let middle = split(outlines, lights, depth, &bound);
    let (low, high) = lights.split_at_mut(middle);
    build(outlines, low, first, depth + 1, nodes);
    nodes[here].second = nodes.len() as u32;
    build(outlines, high, first + middle as u32, depth + 1, nodes);
}

/// Orders the lights so that the first ones, whose number is returned, go to the first child: by the least
/// sum of intensity × extent² × solid angle of the cones (the surface area orientation heuristic, with the
/// squared diagonal for the area, which lights in a row or on a ceiling have too).
fn split(outlines: &[Outline], lights: &mut [u32], depth: u32, whole: &Bound) -> usize {
    let middle_of = |light: u32| 0.5 * (outlines[light as usize].low + outlines[light as usize].high);
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for &light in &*lights {
        let middle = middle_of(light);
        (low, high) = (low.min(middle), high.max(middle));
    }
    let extent = high - low;
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        // (Beyond this depth lights are halved: a bound on the depth whatever their places.)
        if extent[axis] <= 0.0 || depth > 40 {
            continue;
        }
        let mut bins = [Bound::EMPTY; BINS];
        for &light in &*lights {
            let bin = bin_of(middle_of(light)[axis], low[axis], extent[axis]);
            bins[bin] = bins[bin].with(&Bound::of(&outlines[light as usize]));
        }
        // Long thin nodes are cut across.
        let stretch = (whole.high - whole.low).max_element() / (whole.high - whole.low)[axis].max(1e-30);
        let mut above = [0.0; BINS];
        let mut bound = Bound::EMPTY;
        for bin in (1..BINS).rev() {
            bound = bound.with(&bins[bin]);
            above[bin] = bound.cost();
        }
        let mut bound = Bound::EMPTY;
        for bin in 1..BINS {
            bound = bound.with(&bins[bin - 1]);
            let cost = stretch * (bound.cost() + above[bin]);
            let divides = bound.count > 0 && bound.count < whole.count;
            if divides && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, bin));
            }
        }
    }
    match best {
        Some((_, axis, bin)) => {
            let goes_low = |light: &u32| bin_of(middle_of(*light)[axis], low[axis], extent[axis]) < bin;
            // (Stable, so that the tree is a function of the lights' order.)
            lights.sort_by_key(|light| !goes_low(light));
            lights.iter().filter(|light| goes_low(light)).count()
        }
        None => {
            let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
            lights.sort_by(|&a, &b| middle_of(a)[axis].total_cmp(&middle_of(b)[axis]));
            lights.len() / 2
        }
    }
}

fn bin_of(at: f64, low: f64, extent: f64) -> usize {
    (((at - low) / extent * BINS as f64) as usize).min(BINS - 1)
}

/// Bound of several lights.
#[derive(Clone, Copy, Debug)]
struct Bound {
    low: DVec3,
    high: DVec3,
    axis: DVec3,
    spread: f64,
    reach: f64,
    intensity: f64,
    count: usize,
}

impl Bound {
    const EMPTY: Self = Self {
        low: DVec3::MAX,
        high: DVec3::MIN,
        axis: DVec3::Y,
        spread: 0.0,
        reach: 0.0,
        intensity: 0.0,
        count: 0,
    };

    fn of(o: &Outline) -> Self {
        let Outline { low, high, axis, spread, reach, intensity } = *o;
        Self { low, high, axis, spread, reach, intensity, count: 1 }
    }

    fn with(&self, other: &Self) -> Self {
        if self.count == 0 {
            return *other;
        }
        if other.count == 0 {
            return *self;
        }
        let (axis, spread) = wider_cone((self.axis, self.spread), (other.axis, other.spread));
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            axis,
            spread,
            reach: self.reach.max(other.reach),
            intensity: self.intensity + other.intensity,
            count: self.count + other.count,
        }
    }

    /// What choosing within it costs, in no unit; 0 for none.
    fn cost(&self) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        // ∫ over the cone of directions lit, light falling off as the cosine beyond the normals' own cone.
        let (o, w) = (self.spread, (self.spread + self.reach).min(PI));
        let (sin, cos) = o.sin_cos();
        let solid =
            2.0 * PI * (1.0 - cos) + PI / 2.0 * (2.0 * w * sin - (o - 2.0 * w).cos() - 2.0 * o * sin + cos);
        self.intensity * (self.high - self.low).length_squared().max(1e-30) * solid
    }

    fn node(&self, first: u32, count: u32) -> Node {
        let centre = (0.5 * (self.low + self.high)).as_vec3();
        // Around the rounded centre, and rounded up.
        let half = (self.low - centre.as_dvec3()).abs().max((self.high - centre.as_dvec3()).abs());
        let half = half * (1.0 + 1e-6);
        // (A little more, for the rounding of the cone.)
        let spread = self.spread + if self.spread > 0.0 { 1e-6 } else { 0.0 };
        let all = spread >= PI;
        Node {
            centre,
            half: half.as_vec3(),
            radius: half.length() as f32,
            axis: self.axis.as_vec3(),
            cos_spread: if all { -1.0 } else { spread.cos() as f32 },
            sin_spread: if all { 0.0 } else { spread.sin() as f32 },
            cos_reach: self.reach.cos() as f32,
            intensity: (self.intensity as f32).clamp(f32::MIN_POSITIVE, LARGEST_IMPORTANCE),
            first,
            count,
            second: 0,
        }
    }
}

/// The cone around two cones of directions.
fn wider_cone((a, angle_a): (DVec3, f64), (b, angle_b): (DVec3, f64)) -> (DVec3, f64) {
    let ((a, angle_a), (b, angle_b)) =
        if angle_a >= angle_b { ((a, angle_a), (b, angle_b)) } else { ((b, angle_b), (a, angle_a)) };
    let between = a.cross(b).length().atan2(a.dot(b));
    if (between + angle_b).min(PI) <= angle_a {
        return (a, angle_a);
    }
    let angle = 0.5 * (angle_a + between + angle_b);
    // Turned from a towards b.
    match (b - a * a.dot(b)).try_normalize() {
        Some(towards) if angle < PI => {
            let turn = angle - angle_a;
            (a * turn.cos() + towards * turn.sin(), angle)
        }
        _ => (a, PI),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_that_all_stand_at_the_receiver_are_chosen_with_numbers() {
        let outline = |at: f64| Outline {
            low: DVec3::splat(at),
            high: DVec3::splat(at),
            axis: DVec3::Y,
            spread: PI,
            reach: PI,
            intensity: 1.0,
        };
        for apart in [0.0, 1e-30, 1e-20, 1e-10] {
            let outlines: Vec<Outline> = (0..40).map(|i| outline(apart * f64::from(i))).collect();
            let tree = LightTree::new(&outlines);
            for u in [0.0, 0.3, 0.9] {
                let (light, probability) = tree.choose(Vec3::ZERO, Vec3::Y, u, |_| 1.0).expect("a light");
                assert!(probability > 0.0 && probability <= 1.0, "{apart}: {probability}");
                let again = tree.probability(Vec3::ZERO, Vec3::Y, light, |_| 1.0).expect("a probability");
                assert!((again / probability - 1.0).abs() < 1e-3, "{apart}: {again}, {probability}");
            }
        }
    }
}
