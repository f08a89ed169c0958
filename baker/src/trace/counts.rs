//! Rays traced, by purpose.

use serde::{Deserialize, Serialize};

/// Rays traced, by purpose, and what the paths met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RayCounts {
    /// Segments of paths.
    pub path: u64,
    /// Shadow rays to the sun.
    pub sun: u64,
    /// Shadow rays to the sun, for its visibility as a function of time.
    pub visibility: u64,
    /// Shadow rays to lamps.
    pub lamp: u64,
    /// Shadow rays to the sky, through portals or at its bright parts.
    pub sky: u64,
    /// Shadow rays to bright surfaces.
    pub bright_surface: u64,
    /// Rays that find out which points of a texel lie inside a solid, or behind a wall.
    pub inside: u64,
    /// Paths that ended by reading the cache.
    pub cached: u64,
    /// Paths in lit places that would never end: nothing absorbs them.
    pub endless: u64,
}

impl RayCounts {
    /// Rays of all purposes.
    pub fn rays(&self) -> u64 {
        self.path + self.sun + self.visibility + self.lamp + self.sky + self.bright_surface + self.inside
    }
}

/// The sum of counts.
pub fn sum(counts: impl IntoIterator<Item = RayCounts>) -> RayCounts {
    let mut all = RayCounts::default();
    counts.into_iter().for_each(|c| all += c);
    all
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.path += other.path;
        self.sun += other.sun;
        self.visibility += other.visibility;
        self.lamp += other.lamp;
        self.sky += other.sky;
        self.bright_surface += other.bright_surface;
        self.inside += other.inside;
        self.cached += other.cached;
        self.endless += other.endless;
    }
}

impl std::ops::Add for RayCounts {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}
