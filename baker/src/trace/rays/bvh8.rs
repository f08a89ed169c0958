//! An eight-wide bounding volume hierarchy over triangles, and a ray made ready for it.
//!
//! What a ray hits is a function of the triangles alone: [`super::triangle`] decides in double precision, of
//! equally near triangles the one with the lower index counts, and boxes only leave out what cannot be hit.
//! So neither the shape of the hierarchy nor the kernel changes a result.

use super::triangle::Shear;
use glam::Vec3;

/// Eight boxes and where they lead.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Node {
    /// Low x, high x, low y, high y, low z, high z of the children; low = ∞, high = −∞ where there is none.
    pub planes: [[f32; 8]; 6],
    /// Index of a node, or [`LEAF`] and the index of a packet.
    pub children: [u32; 8],
}

/// Up to eight triangles.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Packet {
    /// By corner, dimension, lane. NaN in empty lanes.
    pub corners: [[[f32; 8]; 3]; 3],
    /// Triangle indices, with [`CUT_OUT`]; `u32::MAX` in empty lanes.
    pub triangles: [u32; 8],
}

/// Marks a child that is a packet.
pub(super) const LEAF: u32 = 1 << 31;

/// Marks triangles that may be open where they are hit: cut-outs, and glass.
pub(super) const CUT_OUT: u32 = 1 << 31;

/// The stack the kernels have; a built hierarchy never needs more.
pub(super) const STACK: usize = 192;

/// The hierarchy. Built by [`Bvh8::new`] (`bvh8_build`), traversed in `bvh8_traversal`.
#[derive(Clone, Debug)]
pub struct Bvh8 {
    /// The root first; empty without triangles.
    pub nodes: Vec<Node>,
    /// Its leaves.
    pub packets: Vec<Packet>,
    /// The instructions that it is walked with.
    pub tier: Tier,
}

/// What the processor can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// Nothing in particular: the compiler's own vector code.
    Portable,
    /// AVX2, BMI and LZCNT (x86-64-v3).
    Avx2,
    /// AVX-512 F, VL and DQ (x86-64-v4).
    Avx512,
}

impl Tier {
    /// All of them, slowest first.
    pub const ALL: [Tier; 3] = [Tier::Portable, Tier::Avx2, Tier::Avx512];

    /// The best tier of this machine.
    pub fn detect() -> Tier {
        #[cfg(target_arch = "x86_64")]
        {
            let v3 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt");
            let v4 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512dq");
            if v3 && v4 {
                return Tier::Avx512;
            }
            if v3 {
                return Tier::Avx2;
            }
        }
        Tier::Portable
    }
}

/// A ray, prepared for the box test and for both triangle tests.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    pub origin: Vec3,
    /// Reciprocal direction, less or more by [`ROBUST`]: for the planes where the ray enters and where it
    /// leaves.
    pub near: Vec3,
    pub far: Vec3,
    /// Which of a node's planes the ray enters by, per dimension: 0 low, 1 high.
    pub enters: [usize; 3],
    /// Single-precision shear along x and y of `exact.axes`.
    pub shear: [f32; 2],
    pub exact: Shear,
}

/// The box test's distances carry at most 4 roundings (reciprocal, this factor, difference, product): each
/// side is moved by twice that (Ize 2013, "Robust BVH Ray Traversal", with both sides moved rather than the
/// far one twice as much).
const ROBUST: f32 = 8.0 * 0.5 * f32::EPSILON;

/// Direction components below this count as zero, in all tests alike: their reciprocal would overflow.
const TINY: f32 = 1e-30;

/// How far occluders are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Hits from here on do not count.
    pub t_max: f32,
    /// From here on every hit is asked about; before, only those on triangles marked [`CUT_OUT`].
    pub ask_from: f32,
}

impl Line {
    /// `None` where nothing can be hit: a direction that is zero, or a number that is not finite.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Option<Self> {
        let direction = Vec3::select(direction.abs().cmplt(Vec3::splat(TINY)), Vec3::ZERO, direction);
        if direction == Vec3::ZERO || !(origin + direction).is_finite() {
            return None;
        }
        // ∞ for zero: the box test then gives ±∞, or NaN on a plane itself, which its min and max pass over.
        let inverse = direction.recip();
        let exact = Shear::new(origin, direction);
        let [kx, ky, kz] = exact.axes;
        let sz = 1.0 / direction[kz];
        Some(Line {
            origin,
            near: inverse * (1.0 - ROBUST),
            far: inverse * (1.0 + ROBUST),
            enters: [0, 1, 2].map(|k| usize::from(direction[k] < 0.0)),
            shear: [direction[kx] * sz, direction[ky] * sz],
            exact,
        })
    }
}

impl Bvh8 {
    /// The same hierarchy traversed with another tier, or the best one of this machine if that is less.
    pub fn with_tier(mut self, tier: Tier) -> Self {
        self.tier = tier.min(Tier::detect());
        self
    }

    /// The tier that traverses it.
    pub fn tier(&self) -> Tier {
        self.tier
    }

    /// Memory held, in bytes.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.packets.len() * size_of::<Packet>()
    }
}
