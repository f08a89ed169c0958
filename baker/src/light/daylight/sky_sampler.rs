//! Where sky light is worth looking for beyond the cosine of the path: through portals, and at the bright
//! parts of a picture.
//!
//! A sampler only proposes directions; with the balance heuristic of its density and the cosine's, no light
//! is lost or counted twice, whatever it proposes.

use super::sky::SkyTable;
use super::sky_image::{ImageMap, LatLong};
use crate::light::lamps::Rectangle;
use crate::light::{cos_bound, luminance};
use crate::scene::{Portal, Scene};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Proposes directions towards the sky.
#[derive(Clone, Debug)]
pub struct SkySampler {
    portals: Vec<Opening>,
    picture: Option<Picture>,
}

/// A portal from both sides.
#[derive(Clone, Debug)]
struct Opening {
    sides: [Rectangle; 2],
    /// Half diagonal squared and middle.
    radius2: f64,
    middle: DVec3,
    /// Opposite corners of the box of points that look through it.
    room: [DVec3; 2],
}

impl SkySampler {
    /// A sampler for the scene's portals and its sky's picture; `origin` is the world position of the local
    /// origin. `None` where the cosine is as good: no sky, or neither portals nor a picture with bright
    /// parts.
    pub fn new(scene: &Scene, sky: &SkyTable, origin: DVec3) -> Option<Self> {
        if sky.lit.is_empty() {
            return None;
        }
        let portals: Vec<Opening> = scene.portals.iter().map(|portal| Opening::new(portal, origin)).collect();
        let picture = sky.image().and_then(Picture::new);
        (!portals.is_empty() || picture.is_some()).then_some(Self { portals, picture })
    }

    /// A direction and its density over solid angle ([`SkySampler::pdf`] of it); it may lie below the
    /// receiver's horizon. `choice` in [0, 1) chooses where to look, `u` in [0, 1)² the direction. `None`
    /// where no portal can be seen (and there is no picture): the density is then 0 everywhere.
    pub fn sample(&self, point: Vec3, normal: Vec3, choice: f32, u: Vec2) -> Option<(Vec3, f32)> {
        let (p, n, u) = (point.as_dvec3(), normal.as_dvec3(), u.as_dvec2());
        let shares = self.shares(p, n)?;
        let choice = f64::from(choice);
        let direction = if choice < shares.picture {
            self.picture.as_ref()?.sample(u)
        } else {
            // One portal, in proportion to importance, by the first number: what is left of it chooses the
            // point, so that the points on every portal are spread evenly.
            let mut left = u.x * shares.total;
            let mut chosen = None;
            for (i, opening) in self.portals.iter().enumerate() {
                let share = shares.of(self, i, p, n);
                if share > 0.0 {
                    chosen = Some((opening, (left / share).min(1.0)));
                    if left < share {
                        break;
                    }
                    left -= share;
                }
            }
            let (opening, left) = chosen?;
            opening.seen_from(p)?.sample(DVec2::new(left, u.y)).normalize()
        };
        let direction = direction.as_vec3();
        let pdf = self.density(&shares, p, n, direction.as_dvec3());
        (direction.is_finite() && pdf > 0.0 && pdf.is_finite()).then_some((direction, pdf))
    }

    /// Density over solid angle of [`SkySampler::sample`] in a unit direction, by whatever way it may be
    /// found: through any of the portals in that direction, or in the picture.
    pub fn pdf(&self, point: Vec3, normal: Vec3, direction: Vec3) -> f32 {
        let (p, n) = (point.as_dvec3(), normal.as_dvec3());
        match self.shares(p, n) {
            Some(shares) => self.density(&shares, p, n, direction.as_dvec3()),
            None => 0.0,
        }
    }

    fn density(&self, shares: &ShareOf, p: DVec3, n: DVec3, direction: DVec3) -> f32 {
        let picture = self.picture.as_ref().map_or(0.0, |picture| picture.pdf(direction));
        let mut through = 0.0;
        if shares.total > 0.0 {
            for (i, opening) in self.portals.iter().enumerate() {
                if opening.is_met(p, direction)
                    && let Some(seen) = opening.seen_from(p)
                    && let Some(offset) = seen.hit(direction)
                {
                    through += shares.of(self, i, p, n) / shares.total * seen.pdf(offset);
                }
            }
        }
        (shares.picture * picture + (1.0 - shares.picture) * through) as f32
    }

    /// The part of samples that looks at the picture, and the portals' importances. Even, where there are
    /// both.
    fn shares(&self, p: DVec3, n: DVec3) -> Option<ShareOf> {
        let (mut total, mut first) = (0.0, [0.0; MOST_KEPT_PORTALS]);
        for (i, opening) in self.portals.iter().enumerate() {
            let importance = opening.importance(p, n);
            total += importance;
            if let Some(known) = first.get_mut(i) {
                *known = importance;
            }
        }
        let picture = match (self.picture.is_some(), total > 0.0) {
            (true, true) => 0.5,
            (true, false) => 1.0,
            (false, true) => 0.0,
            (false, false) => return None,
        };
        Some(ShareOf { picture, total, first })
    }
}

/// Portals whose importance is kept while a direction is chosen; that of others is computed again.
const MOST_KEPT_PORTALS: usize = 8;

struct ShareOf {
    picture: f64,
    total: f64,
    /// Importances of the first portals.
    first: [f64; MOST_KEPT_PORTALS],
}

impl ShareOf {
    /// The importance of a portal.
    fn of(&self, sky_sampler: &SkySampler, portal: usize, p: DVec3, n: DVec3) -> f64 {
        self.first.get(portal).copied().unwrap_or_else(|| sky_sampler.portals[portal].importance(p, n))
    }
}

impl Opening {
    fn new(portal: &Portal, origin: DVec3) -> Self {
        let Portal { corner, edge_u, edge_v, room } = *portal;
        let corner = corner - origin;
        // Swapped edges turn the front to the other side.
        let sides = [Rectangle::new(corner, edge_u, edge_v), Rectangle::new(corner, edge_v, edge_u)];
        let radius2 = 0.25 * (edge_u.length_squared() + edge_v.length_squared());
        let everywhere = [DVec3::NEG_INFINITY, DVec3::INFINITY];
        let room = room.map_or(everywhere, |corners| corners.map(|corner| corner - origin));
        Self { sides, radius2, middle: corner + 0.5 * (edge_u + edge_v), room }
    }

    /// `None` from its plane.
    fn seen_from(&self, p: DVec3) -> Option<crate::light::lamps::Seen<'_>> {
        self.sides[0].seen_from(p).or_else(|| self.sides[1].seen_from(p))
    }

    /// Whether a direction meets the ball around it: only then may it meet the portal.
    fn is_met(&self, p: DVec3, direction: DVec3) -> bool {
        let to_middle = self.middle - p;
        let along = to_middle.dot(direction);
        // (A little more, for what rounding a direction moves the point by.)
        let distance2 = to_middle.length_squared();
        distance2 - along * along.abs() <= self.radius2 * (1.0 + 1e-3) + 1e-6 * distance2
    }

    /// A guess of its solid angle times the cosine; 0 in its plane, wholly below the horizon, and outside of
    /// its room.
    fn importance(&self, p: DVec3, n: DVec3) -> f64 {
        if p.cmplt(self.room[0]).any() || p.cmpgt(self.room[1]).any() {
            return 0.0;
        }
        let to_middle = self.middle - p;
        let distance2 = to_middle.length_squared();
        let height = to_middle.dot(self.sides[0].normal()).abs();
        if height <= 0.0 || self.sides[0].height_bound(p, n) <= 0.0 {
            return 0.0;
        }
        if distance2 > 4.0 * self.radius2 {
            let distance = distance2.sqrt();
            let cosine = cos_bound(to_middle.dot(n) / distance, self.radius2 / distance2);
            return self.sides[0].area() * height / (distance2 * distance) * cosine.max(1e-6);
        }
        self.seen_from(p).map_or(0.0, |seen| seen.solid_angle().clamp(1e-30, PI))
    }
}

/// Most columns of a picture's table of importance.
const MOST_COLUMNS: usize = 2048;

/// The bright parts of a picture: a density over the sphere that is constant in each cell of a lat-long grid,
/// in proportion to how far the cell's luminance is above the picture's mean. (What the mean explains, the
/// cosine finds: Karlík et al. 2019, "MIS Compensation".)
#[derive(Clone, Debug)]
struct Picture {
    frame: LatLong,
    columns: usize,
    rows: usize,
    /// Per row `columns + 1` sums of probability, from 0 to 1 (all 0 in a row without any).
    in_row: Vec<f32>,
    /// `rows + 1` sums of the rows' probabilities, from 0 to 1.
    of_rows: Vec<f64>,
}

impl Picture {
    /// `None` for a picture without bright parts.
    fn new(map: &ImageMap) -> Option<Self> {
        let image = map.image();
        let columns = image.width.min(MOST_COLUMNS);
        let rows = (columns / 2).max(1);
        // Mean luminance of the texels in each cell.
        let (mut cells, mut counts) = (vec![0.0f64; columns * rows], vec![0u32; columns * rows]);
        for (i, texel) in image.texels.iter().enumerate() {
            let (x, y) = (i % image.width, i / image.width);
            let cell = y * rows / image.height * columns + x * columns / image.width;
            cells[cell] += f64::from(luminance(Vec3::from_array(*texel)));
            counts[cell] += 1;
        }
        cells.iter_mut().zip(&counts).for_each(|(cell, &count)| *cell /= f64::from(count.max(1)));
        let cells = blurred(&cells, columns, rows);
        // How far each stands out, times its solid angle.
        let solid_angle = |row: usize| solid_angle(row, columns, rows);
        let mean = (0..rows)
            .map(|row| cells[row * columns..][..columns].iter().sum::<f64>() * solid_angle(row))
            .sum::<f64>()
            / (4.0 * PI);
        let (mut in_row, mut of_rows, mut total) = (Vec::with_capacity((columns + 1) * rows), vec![0.0], 0.0);
        for row in 0..rows {
            let excess = cells[row * columns..][..columns].iter().map(|cell| (cell - mean).max(0.0));
            let sums: Vec<f64> = std::iter::once(0.0)
                .chain(excess.scan(0.0, |sum, excess| {
                    *sum += excess;
                    Some(*sum)
                }))
                .collect();
            let of_row = sums[columns];
            in_row.extend(sums.iter().map(|sum| if of_row > 0.0 { (sum / of_row) as f32 } else { 0.0 }));
            total += of_row * solid_angle(row);
            of_rows.push(total);
        }
        // Nothing stands out of an even picture.
        if total <= 1e-3 * mean * 4.0 * PI {
            return None;
        }
        of_rows.iter_mut().for_each(|sum| *sum /= total);
        Some(Self { frame: map.frame(), columns, rows, in_row, of_rows })
    }

    fn sample(&self, u: DVec2) -> DVec3 {
        // A row, a column in it, and what is left of the two numbers within the cell.
        let (row, v) = pick(u.y, self.rows, |i| self.of_rows[i]);
        let sums = &self.in_row[row * (self.columns + 1)..][..=self.columns];
        let (column, h) = pick(u.x, self.columns, |i| f64::from(sums[i]));
        // Uniform in the cell's solid angle: in azimuth and height.
        let (high, low) = (cos_of(row, self.rows), cos_of(row + 1, self.rows));
        let polar = (high + (low - high) * v).clamp(-1.0, 1.0).acos() / PI;
        self.frame.direction_of(DVec2::new((column as f64 + h) / self.columns as f64, polar))
    }

    fn pdf(&self, direction: DVec3) -> f64 {
        let at = self.frame.square_of(direction);
        let column = ((at.x * self.columns as f64) as usize).min(self.columns - 1);
        let row = ((at.y * self.rows as f64) as usize).min(self.rows - 1);
        let sums = &self.in_row[row * (self.columns + 1)..];
        let probability =
            (self.of_rows[row + 1] - self.of_rows[row]) * f64::from(sums[column + 1] - sums[column]);
        probability / solid_angle(row, self.columns, self.rows)
    }
}

/// The interval of ascending sums (from 0 to 1) that `u` falls into, never an empty one, and where in it.
fn pick(u: f64, len: usize, sum: impl Fn(usize) -> f64) -> (usize, f64) {
    // The last i with sum(i) ≤ u.
    let (mut low, mut high) = (0, len);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if sum(middle) <= u { low = middle } else { high = middle }
    }
    while low > 0 && sum(low + 1) <= sum(low) {
        low -= 1;
    }
    let (start, end) = (sum(low), sum(low + 1));
    (low, if end > start { ((u - start) / (end - start)).clamp(0.0, 1.0) } else { 0.5 })
}

/// Cosine of the angle from +Y to a row's upper edge.
fn cos_of(row: usize, rows: usize) -> f64 {
    (PI * row as f64 / rows as f64).cos()
}

/// Solid angle of a cell.
fn solid_angle(row: usize, columns: usize, rows: usize) -> f64 {
    TAU / columns as f64 * (cos_of(row, rows) - cos_of(row + 1, rows))
}

/// The mean over each cell of the bilinear picture between the cells' middles: weights ⅛, ¾, ⅛ either way.
/// Without it, what the look-up spreads from a bright cell into its neighbours would be found with their
/// small density.
fn blurred(cells: &[f64], columns: usize, rows: usize) -> Vec<f64> {
    let blur = |a: f64, b: f64, c: f64| 0.125 * a + 0.75 * b + 0.125 * c;
    let mut across = vec![0.0; cells.len()];
    for (i, out) in across.iter_mut().enumerate() {
        let (row, column) = (i / columns * columns, i % columns);
        let at = |column: usize| cells[row + column % columns];
        *out = blur(at(column + columns - 1), at(column), at(column + 1));
    }
    let at = |row: usize, column: usize| across[row.min(rows - 1) * columns + column];
    (0..cells.len())
        .map(|i| {
            let (row, column) = (i / columns, i % columns);
            blur(at(row.saturating_sub(1), column), at(row, column), at(row + 1, column))
        })
        .collect()
}

#[cfg(test)]
#[path = "sky_sampler_tests.rs"]
mod tests;
