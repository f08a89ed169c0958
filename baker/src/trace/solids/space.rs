//! The space light moves in: points on its surfaces, and what stands between them or around them. All that
//! tells of places here ignores glass.

use crate::geometry::{Geometry, Material, Solids};
use crate::surface::SurfacePoint;
use crate::trace::counts::RayCounts;
use crate::trace::rays::Hit;
use crate::trace::rays::ray_tracer::{RayTracer, offset_point};
use glam::Vec3;

/// Sine of 75°, what directions close to a surface are off its normal: what stands under a single sheet sees
/// past it, what lies in a closed body does not.
const GRAZING_SIN: f32 = 0.965_925_8;
/// Cosine of that.
const GRAZING_COS: f32 = 0.258_819_04;

/// Triangles, the rays among them, and what is known of each.
pub struct Space<'a> {
    /// The triangles and materials.
    pub geometry: &'a Geometry,
    /// The ray tracer over them.
    pub ray_tracer: &'a RayTracer<'a>,
    /// Per triangle, the unit normal of its front.
    fronts: Vec<Vec3>,
    /// The triangles that bound solids.
    solids: Solids,
}

/// Directions in which a point looks for the body it may lie in.
const DIRECTIONS: usize = 5;

/// What a point met in each of the directions that it looked in, so that no question asks for the same ray
/// again.
#[derive(Clone, Copy, Debug, Default)]
pub struct SurroundingHits {
    hits: [Option<Option<Hit>>; DIRECTIONS],
}

/// A point light arrives at, moved off its surface.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    pub origin: Vec3,
    pub triangle: u32,
    /// Geometric normal on the side considered.
    pub face_normal: Vec3,
    /// The normal cosines are measured against.
    pub normal: Vec3,
}

impl Receiver {
    /// The point.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// The normal that cosines are measured against.
    pub fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Squared distance in m².
    pub fn distance_squared(&self, other: &Receiver) -> f32 {
        self.origin.distance_squared(other.origin)
    }
}

impl<'a> Space<'a> {
    /// Triangles and the rays among them.
    pub fn new(geometry: &'a Geometry, ray_tracer: &'a RayTracer<'a>) -> Self {
        let fronts = (0..geometry.triangles.len()).map(|t| geometry.normal(t)).collect();
        Space { geometry, ray_tracer, fronts, solids: Solids::default() }
    }

    /// The same, with the triangles that bound solids, which [`Space::is_in_solid`] rests on: none before.
    pub fn with_solids(self, solids: Solids) -> Self {
        Space { solids, ..self }
    }

    /// Unit normal of a triangle's front; zero for one without area.
    #[inline]
    pub fn front(&self, triangle: u32) -> Vec3 {
        self.fronts[triangle as usize]
    }

    /// The texel's point, on the front, with the interpolated normal the game shades with. `None` without a
    /// normal.
    pub fn receiver(&self, point: &SurfacePoint) -> Option<Receiver> {
        self.receiver_on(point, false)
    }

    /// A point on one side of a triangle; on the back, the interpolated normal is turned round. (Paths go on
    /// by it too, so that what a surface sends out is what its texels show.)
    pub fn receiver_on(&self, point: &SurfacePoint, is_back: bool) -> Option<Receiver> {
        let triangle = point.triangle as usize;
        let front = self.front(point.triangle);
        if front == Vec3::ZERO {
            return None;
        }
        let side = if is_back { -1.0 } else { 1.0 };
        let face_normal = front * side;
        let smooth = self.geometry.shading_normal_at(triangle, point.barycentric) * side;
        let normal = if smooth.dot(face_normal) > 0.0 { smooth } else { face_normal };
        let origin = offset_point(&self.geometry.corners(triangle), point.barycentric, face_normal);
        Some(Receiver { origin, triangle: point.triangle, face_normal, normal })
    }

    /// Whether a point lies inside a solid, closed or nearly so.
    pub fn is_inside(&self, at: &Receiver, counts: &mut RayCounts) -> bool {
        let mut known_hits = SurroundingHits::default();
        self.is_in_solid(at, &mut known_hits, counts) || self.is_enclosed(at, &mut known_hits, counts)
    }

    /// The normal, and directions close to the surface all around. Rays there count for no light: to leave
    /// out points by what they meet does not favour the light that reaches the others.
    pub fn directions_around(at: &Receiver) -> [Vec3; DIRECTIONS] {
        let (tangent, bitangent) = at.face_normal.any_orthonormal_pair();
        let aside = |side: Vec3| (side * GRAZING_SIN + at.face_normal * GRAZING_COS).normalize();
        [at.face_normal, aside(tangent), aside(bitangent), aside(-tangent), aside(-bitangent)]
    }

    /// What is met first in one of those directions: found once for each.
    pub fn hit_in(
        &self,
        at: &Receiver,
        k: usize,
        known_hits: &mut SurroundingHits,
        counts: &mut RayCounts,
    ) -> Option<Hit> {
        *known_hits.hits[k].get_or_insert_with(|| {
            counts.inside += 1;
            self.ray_tracer.nearest_wall(at.origin, Self::directions_around(at)[k], at.triangle)
        })
    }

    /// Whether a hit is on the absorbing back of a one-sided triangle.
    fn is_absorbing_back(&self, hit: &Hit, direction: Vec3) -> bool {
        self.front(hit.triangle).dot(direction) > 0.0 && !self.material(hit.triangle).two_sided
    }

    /// Whether a hit is on the back of a triangle that bounds a solid: where it is met first, the ray begins
    /// inside the solid.
    pub fn is_back_of_solid(&self, hit: &Hit, direction: Vec3) -> bool {
        self.solids.bound_by(hit.triangle) && self.is_absorbing_back(hit, direction)
    }

    /// What is met at once with a hit: where a body stands against another (a wall under a ceiling), the back
    /// of one and the front of the other.
    pub fn coincident_hit(
        &self,
        at: &Receiver,
        direction: Vec3,
        hit: &Hit,
        counts: &mut RayCounts,
    ) -> Option<Hit> {
        const COINCIDENT: f32 = 1e-5;
        counts.inside += 1;
        let next = self.ray_tracer.nearest_wall(at.origin, direction, hit.triangle);
        next.filter(|next| next.t - hit.t <= COINCIDENT * hit.t)
    }

    /// Whether a point lies inside a closed solid: the first thing met along the normal, or in one of two
    /// directions close to the surface, is the back of one. From outside none is ever met back first, except
    /// where a front is met at once with it (sheets of two one-sided faces): such hits do not count.
    pub fn is_in_solid(
        &self,
        at: &Receiver,
        known_hits: &mut SurroundingHits,
        counts: &mut RayCounts,
    ) -> bool {
        if self.solids.is_empty() {
            return false;
        }
        let directions = Self::directions_around(at);
        (0..3).any(|k| {
            let (hit, direction) = (self.hit_in(at, k, known_hits, counts), directions[k]);
            hit.is_some_and(|hit| {
                self.is_back_of_solid(&hit, direction) && {
                    let other = self.coincident_hit(at, direction, &hit, counts);
                    other.is_none_or(|other| self.is_absorbing_back(&other, direction))
                }
            })
        })
    }

    /// Whether a point lies in a body that may be open a little: along the normal and in four directions
    /// close to the surface, the back of a one-sided triangle is met.
    pub fn is_enclosed(
        &self,
        at: &Receiver,
        known_hits: &mut SurroundingHits,
        counts: &mut RayCounts,
    ) -> bool {
        self.is_surrounded_by_backs(at, |_| true, known_hits, counts)
    }

    /// Whether along the normal and in four directions close to the surface an absorbing back is met, of a
    /// material that counts, and one of them is met alone: a front lies in the plane of each where all sides
    /// of a body are modelled twice, to be seen from both.
    fn is_surrounded_by_backs(
        &self,
        at: &Receiver,
        counting: fn(&Material) -> bool,
        known_hits: &mut SurroundingHits,
        counts: &mut RayCounts,
    ) -> bool {
        let is_back = |hit: &Hit, direction: Vec3| {
            self.is_absorbing_back(hit, direction) && counting(self.material(hit.triangle))
        };
        let mut is_one_alone = false;
        let is_all_around = Self::directions_around(at).into_iter().enumerate().all(|(k, direction)| {
            let Some(hit) = self.hit_in(at, k, known_hits, counts) else { return false };
            let is_first = is_back(&hit, direction);
            if is_first && is_one_alone {
                return true;
            }
            let other = self.coincident_hit(at, direction, &hit, counts);
            let is_other = other.is_some_and(|other| is_back(&other, direction));
            is_one_alone |= is_first && (other.is_none() || is_other);
            is_first || is_other
        });
        is_all_around && is_one_alone
    }

    /// Whether nobody can see a point of a surface: it lies in a body, or another surface is pressed against
    /// it. `behind` is the same point on the other side of its surface; `gap` is the widest gap, in metres,
    /// across which surfaces count as pressed together.
    ///
    /// Cut-outs hide nothing, nor does glass.
    pub fn is_hidden(&self, at: &Receiver, behind: &Receiver, gap: f32, counts: &mut RayCounts) -> bool {
        let mut known_hits = SurroundingHits::default();
        let Some(hit) = self.hit_in(at, 0, &mut known_hits, counts) else {
            return self.is_in_contact(at, behind, counts);
        };
        let is_seen_side = !self.is_absorbing_back(&hit, at.face_normal);
        if is_seen_side && hit.t <= gap && is_opaque(self.material(hit.triangle)) {
            return true;
        }
        self.is_in_solid(at, &mut known_hits, counts)
            || self.is_surrounded_by_backs(at, is_opaque, &mut known_hits, counts)
            || self.is_in_contact(at, behind, counts)
    }

    /// Whether a body stands on a surface with this point: a one-sided surface lies in the same plane and
    /// faces the point's own, behind which is the inside of a body. (Without a body these may be the two
    /// sides of a leaf.)
    fn is_in_contact(&self, at: &Receiver, behind: &Receiver, counts: &mut RayCounts) -> bool {
        // From three times rounding behind the surface to as far in front of it.
        let step = at.origin - behind.origin;
        counts.inside += 1;
        let hit = self.ray_tracer.nearest_wall(behind.origin - step, at.face_normal, at.triangle);
        hit.is_some_and(|hit| {
            let material = self.material(hit.triangle);
            hit.t <= 3.0 * step.length()
                && self.front(hit.triangle).dot(at.face_normal) < 0.0
                && !material.two_sided
                && is_opaque(material)
                && self.is_inside(behind, counts)
        })
    }

    /// Whether a point lies under ground that may be open: upwards, as far as its surface leaves room, the
    /// absorbing back of a one-sided triangle is met first, and all around nothing that looks at the point
    /// (under a roof there is a floor).
    pub fn is_under_ground(&self, at: &Receiver, counts: &mut RayCounts) -> bool {
        let mut is_back_met = |direction: Vec3| {
            counts.inside += 1;
            let hit = self.ray_tracer.nearest_wall(at.origin, direction, at.triangle);
            hit.map(|hit| self.is_absorbing_back(&hit, direction))
        };
        let upwards = Vec3::Y.reject_from_normalized(at.face_normal).normalize_or_zero();
        let tilted = |side: Vec3| (side * GRAZING_SIN + at.face_normal * GRAZING_COS).normalize();
        let aside = at.face_normal.cross(upwards);
        is_back_met(tilted(upwards)) == Some(true)
            && [at.face_normal, tilted(aside), tilted(-aside), tilted(-upwards)]
                .into_iter()
                .all(|direction| is_back_met(direction) != Some(false))
    }

    /// Whether nothing stands between two points.
    pub fn sees(&self, a: &Receiver, b: &Receiver, counts: &mut RayCounts) -> bool {
        let (direction, distance) = (b.origin - a.origin).normalize_and_length();
        // What comes from behind a surface is stopped by it.
        if b.triangle < u32::MAX
            && b.triangle != a.triangle
            && direction.dot(b.face_normal) > 0.0
            && self.ray_tracer.is_blocked_by(a.origin, direction, distance, b.triangle)
        {
            return false;
        }
        counts.inside += 1;
        !self.ray_tracer.occluded(a.origin, direction, distance, a.triangle)
    }

    /// Distance to the first obstacle along the unit `direction`, if there is one within `distance`.
    pub fn distance_to_obstacle(&self, at: &Receiver, direction: Vec3, distance: f32) -> Option<f32> {
        let is_stopped = self.ray_tracer.occluded(at.origin, direction, distance, at.triangle);
        is_stopped
            .then(|| self.ray_tracer.nearest_wall(at.origin, direction, at.triangle).map_or(0.0, |hit| hit.t))
    }

    /// Whether nothing stands between two points of a piece of surface. Where it bulges between them, the
    /// straight way leads through what is below it, and one in an arch over it will do as well: what stands
    /// on the surface is in both.
    pub fn reaches(&self, a: &Receiver, b: &Receiver, counts: &mut RayCounts) -> bool {
        if self.sees(a, b, counts) {
            return true;
        }
        let (direction, distance) = (b.origin - a.origin).normalize_and_length();
        // The sine of the angle at which the way enters the surface, or leaves it.
        let bulge = b.face_normal.dot(direction).max(-a.face_normal.dot(direction));
        // Flat but for rounding.
        const FLAT: f32 = 1e-3;
        if bulge < FLAT {
            return false;
        }
        // Twice the height of a circle's arc.
        let raised = |at: &Receiver| Receiver {
            origin: at.origin + at.face_normal * (0.5 * distance * bulge),
            triangle: u32::MAX,
            ..*at
        };
        let (above_a, above_b) = (raised(a), raised(b));
        [(a, &above_a), (&above_a, &above_b), (&above_b, b)].into_iter().all(|(a, b)| self.sees(a, b, counts))
    }

    /// What a triangle is made of.
    pub fn material(&self, triangle: u32) -> &Material {
        &self.geometry.materials[self.geometry.material_of[triangle as usize] as usize]
    }
}

/// Whether nothing of a surface is cut out.
fn is_opaque(material: &Material) -> bool {
    material.alpha_cutoff.is_none()
}
