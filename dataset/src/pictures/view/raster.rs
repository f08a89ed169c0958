//! Which triangle each sample of a picture shows: a depth buffer.

use super::lens::Camera;
use super::model::{Model, Part};
use glam::{DVec2, Vec3};

/// What lies nearer than this share of the scene's size is cut off.
const NEAR: f64 = 1e-5;

/// What one sample shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fragment {
    /// One over the depth; 0 where there is nothing.
    pub inverse_depth: f32,
    pub part: u32,
    pub triangle: u32,
    /// The second and the third barycentric coordinate.
    pub at: [f32; 2],
    pub is_back: bool,
}

impl Fragment {
    const NOTHING: Fragment =
        Fragment { inverse_depth: 0.0, part: 0, triangle: 0, at: [0.0; 2], is_back: false };

    pub(super) fn is_surface(&self) -> bool {
        self.inverse_depth > 0.0
    }
}

/// Draws a model into samples row by row. One-sided surfaces hide nothing from behind, as in a game; with
/// `with_backs` they do.
pub(super) fn draw(model: &Model, camera: &Camera, size: [usize; 2], with_backs: bool) -> Vec<Fragment> {
    let mut raster = Raster {
        model,
        half: camera.half_view(size).map(|half| half as f32),
        near: (NEAR * model.extent()) as f32,
        size,
        with_backs,
        samples: vec![Fragment::NOTHING; size[0] * size[1]],
    };
    let view_from_world = camera.view_from_world();
    let mut positions = Vec::new();
    for (number, part) in model.parts.iter().enumerate() {
        let shape = &model.shapes[part.shape];
        if shape.triangles.is_empty() || model.materials[shape.material].is_clear {
            continue;
        }
        // In double precision up to here: far from zero, single precision holds no camera.
        let view_from_shape = view_from_world * part.world_from_shape;
        let corners = part.corners(model).map(|corner| view_from_world.transform_point3(corner).as_vec3());
        if raster.is_outside(&corners) {
            continue;
        }
        let matrix = view_from_shape.as_mat4();
        positions.clear();
        positions.extend(shape.positions.iter().map(|p| matrix.transform_point3(*p)));
        let is_mirrored = view_from_shape.determinant() < 0.0;
        for (triangle, corners) in shape.triangles.iter().enumerate() {
            let corners = corners.map(|v| positions[v as usize]);
            raster.triangle(part, [number as u32, triangle as u32], corners, is_mirrored);
        }
    }
    raster.samples
}

struct Raster<'a> {
    model: &'a Model,
    /// Half of what is seen across and down at depth 1.
    half: [f32; 2],
    near: f32,
    size: [usize; 2],
    with_backs: bool,
    samples: Vec<Fragment>,
}

/// A corner of what is left of a triangle: its place seen from the camera, and its barycentric coordinates.
#[derive(Clone, Copy)]
struct Corner {
    place: Vec3,
    at: [f32; 2],
}

impl Raster<'_> {
    /// Whether all points lie outside one side of what is seen.
    fn is_outside(&self, points: &[Vec3]) -> bool {
        let [across, down] = self.half;
        let sides: [&dyn Fn(&Vec3) -> bool; 5] = [
            &|p| -p.z < self.near,
            &|p| p.x > -p.z * across,
            &|p| p.x < p.z * across,
            &|p| p.y > -p.z * down,
            &|p| p.y < p.z * down,
        ];
        sides.iter().any(|side| points.iter().all(side))
    }

    fn triangle(&mut self, part: &Part, names: [u32; 2], places: [Vec3; 3], is_mirrored: bool) {
        if self.is_outside(&places) {
            return;
        }
        let [a, b, c] = places;
        let is_back = (b - a).cross(c - a).dot(a) > 0.0;
        let is_back = is_back != is_mirrored;
        let material = &self.model.materials[self.model.shapes[part.shape].material];
        if is_back && !material.two_sided && !self.with_backs {
            return;
        }
        let corners = [(a, [0.0, 0.0]), (b, [1.0, 0.0]), (c, [0.0, 1.0])];
        let corners = corners.map(|(place, at)| Corner { place, at });
        let (kept, count) = self.in_front(corners);
        let holed = material.cutoff.filter(|_| material.texture.is_some() || material.alpha < 1.0);
        for i in 2..count {
            self.fill(part, names, is_back, [kept[0], kept[i - 1], kept[i]], holed);
        }
    }

    /// The corners of a triangle's part in front of the near plane, and how many.
    fn in_front(&self, corners: [Corner; 3]) -> ([Corner; 4], usize) {
        let mut kept = [corners[0]; 4];
        let mut count = 0;
        let mut keep = |corner: Corner| {
            kept[count] = corner;
            count += 1;
        };
        for i in 0..3 {
            let (this, next) = (corners[i], corners[(i + 1) % 3]);
            let [from, to] = [this, next].map(|corner| -corner.place.z - self.near);
            if from >= 0.0 {
                keep(this);
            }
            if (from >= 0.0) != (to >= 0.0) {
                let share = from / (from - to);
                let mix = |k: usize| this.at[k] + (next.at[k] - this.at[k]) * share;
                let place = this.place.lerp(next.place, share);
                keep(Corner { place: place.with_z(-self.near), at: [mix(0), mix(1)] });
            }
        }
        (kept, count)
    }

    /// Fills the samples whose middles lie in a triangle that is in front of the camera.
    fn fill(
        &mut self,
        part: &Part,
        [number, triangle]: [u32; 2],
        is_back: bool,
        corners: [Corner; 3],
        holed: Option<f32>,
    ) {
        let [width, height] = self.size;
        let (across, down) = (f64::from(self.half[0]), f64::from(self.half[1]));
        // Where each corner lies in the picture, in samples, y down; and one over its depth.
        let on_screen = corners.map(|corner| {
            let (inverse, place) = (-1.0 / f64::from(corner.place.z), corner.place.as_dvec3());
            let x = (place.x * inverse / across + 1.0) * 0.5 * width as f64;
            let y = (1.0 - place.y * inverse / down) * 0.5 * height as f64;
            (DVec2::new(x, y), inverse)
        });
        let [(a, of_a), (b, of_b), (c, of_c)] = on_screen;
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let range = |low: f64, high: f64, most: usize| {
            let first = (low - 0.5).ceil().max(0.0) as usize;
            first..((high - 0.5).floor() + 1.0).clamp(0.0, most as f64) as usize
        };
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let (columns, rows) = (range(low.x, high.x, width), range(low.y, high.y, height));
        for y in rows {
            for x in columns.clone() {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let shares = [(c - b).perp_dot(p - b), (a - c).perp_dot(p - c), (b - a).perp_dot(p - a)];
                let shares = shares.map(|share| share / area);
                if shares.iter().any(|share| *share < 0.0) {
                    continue;
                }
                // Linear on the screen are one over the depth, and what is divided by the depth.
                let by_depth = [shares[0] * of_a, shares[1] * of_b, shares[2] * of_c];
                let inverse: f64 = by_depth.iter().sum();
                let sample = &mut self.samples[y * width + x];
                if inverse as f32 <= sample.inverse_depth {
                    continue;
                }
                let mix = |k: usize| {
                    let sum: f64 = (0..3).map(|i| by_depth[i] * f64::from(corners[i].at[k])).sum();
                    (sum / inverse) as f32
                };
                let at = [mix(0), mix(1)];
                if let Some(cutoff) = holed {
                    let shape = &self.model.shapes[part.shape];
                    if self.model.colour(shape, triangle as usize, at).1 < cutoff {
                        continue;
                    }
                }
                *sample = Fragment { inverse_depth: inverse as f32, part: number, triangle, at, is_back };
            }
        }
    }
}
