//! An indexed triangle mesh in construction: positions in metres, unit normals, texture coordinates in
//! metres.

use glam::{DAffine3, DVec2, DVec3};

/// A mesh; front faces run counter-clockwise. Vertices that faces share are smooth there, split ones are
/// sharp.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Metres.
    pub positions: Vec<DVec3>,
    /// Unit, on the front side.
    pub normals: Vec<DVec3>,
    /// Metres along the surface until a material scales them; v runs down.
    pub uvs: Vec<DVec2>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Adds a vertex, its normal still to be computed.
    pub fn vertex(&mut self, position: DVec3, uv: DVec2) -> u32 {
        self.positions.push(position);
        self.normals.push(DVec3::ZERO);
        self.uvs.push(uv);
        self.positions.len() as u32 - 1
    }

    /// Adds a convex polygon with vertices of its own, flat, as a fan; `uv` in metres per corner.
    pub fn polygon(&mut self, corners: &[(DVec3, DVec2)]) {
        let mut normal = DVec3::ZERO;
        for i in 1..corners.len() - 1 {
            normal += (corners[i].0 - corners[0].0).cross(corners[i + 1].0 - corners[0].0);
        }
        let normal = normal.normalize();
        let first = self.positions.len() as u32;
        for &(position, uv) in corners {
            self.vertex(position, uv);
            *self.normals.last_mut().expect("just added") = normal;
        }
        for i in 1..corners.len() as u32 - 1 {
            self.triangles.push([first, first + i, first + i + 1]);
        }
    }

    /// Adds a flat quad whose texture coordinates are its edges' lengths.
    pub fn quad(&mut self, a: DVec3, b: DVec3, c: DVec3, d: DVec3) {
        let (w, h) = ((b - a).length(), (d - a).length());
        let uv = [DVec2::new(0.0, h), DVec2::new(w, h), DVec2::new(w, 0.0), DVec2::ZERO];
        self.polygon(&[(a, uv[0]), (b, uv[1]), (c, uv[2]), (d, uv[3])]);
    }

    /// Adds another mesh's faces.
    pub fn append(&mut self, other: Mesh) {
        let first = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uvs.extend(other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
    }

    /// The mesh with another's faces added.
    pub fn with(mut self, other: Mesh) -> Self {
        self.append(other);
        self
    }

    /// Normals from the faces around each vertex, weighted by squared area: broad faces stay flat, narrow
    /// bevels between them look round.
    pub fn smoothed(mut self) -> Self {
        self.normals.fill(DVec3::ZERO);
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let n = (b - a).cross(c - a);
            t.iter().for_each(|&i| self.normals[i as usize] += n * n.length());
        }
        self.normals.iter_mut().for_each(|n| *n = n.normalize());
        self
    }

    /// The faces whose geometric normal satisfies `wanted`, and the others.
    pub fn split(self, wanted: impl Fn(DVec3) -> bool) -> (Self, Self) {
        let normal = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            (b - a).cross(c - a).normalize()
        };
        let (yes, no): (Vec<_>, Vec<_>) = self.triangles.iter().partition(|t| wanted(normal(t)));
        (self.subset(&yes), self.subset(&no))
    }

    /// Some of the mesh's triangles, with the vertices they use.
    fn subset(&self, triangles: &[[u32; 3]]) -> Self {
        let mut kept = Self::default();
        let mut index = vec![u32::MAX; self.positions.len()];
        for t in triangles {
            let t = t.map(|i| {
                let at = i as usize;
                if index[at] == u32::MAX {
                    index[at] = kept.vertex(self.positions[at], self.uvs[at]);
                    kept.normals[index[at] as usize] = self.normals[at];
                }
                index[at]
            });
            kept.triangles.push(t);
        }
        kept
    }

    /// The mesh inside out.
    pub fn flipped(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self.normals.iter_mut().for_each(|n| *n = -*n);
        self
    }

    /// The mesh without the faces that look down: those that stand on the ground.
    pub fn standing(self) -> Self {
        self.split(|n| n.y > -0.999).0
    }

    /// Moved by an affine map that keeps orientation.
    pub fn transformed(mut self, map: DAffine3) -> Self {
        debug_assert!(map.matrix3.determinant() > 0.0, "a mirrored mesh would turn inside out");
        let normal_map = map.matrix3.inverse().transpose();
        self.positions.iter_mut().for_each(|p| *p = map.transform_point3(*p));
        self.normals.iter_mut().for_each(|n| *n = (normal_map * *n).normalize());
        self
    }

    /// Moved along a vector.
    pub fn translated(self, x: f64, y: f64, z: f64) -> Self {
        self.transformed(DAffine3::from_translation(DVec3::new(x, y, z)))
    }

    /// Turned about +Y by an angle in degrees (+Z towards +X).
    pub fn turned(self, degrees: f64) -> Self {
        self.transformed(DAffine3::from_rotation_y(degrees.to_radians()))
    }

    /// Texture coordinates turned a quarter: grain along the other edge.
    pub fn grain_turned(mut self) -> Self {
        self.uvs.iter_mut().for_each(|uv| *uv = uv.perp());
        self
    }

    /// Surface area in m².
    pub fn area(&self) -> f64 {
        self.corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
    }

    /// Corner positions of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|i| self.positions[i as usize]))
    }

    /// Enclosed volume in m³ of a closed mesh, positive when the faces look outwards.
    pub fn volume(&self) -> f64 {
        self.corners().map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    /// Whether every edge is met by as many faces in one direction as in the other (positions compared to 1
    /// µm).
    pub fn is_closed(&self) -> bool {
        let key = |p: DVec3| (p * 1e6).round().as_i64vec3().to_array();
        let mut balance = std::collections::BTreeMap::new();
        for t in self.corners() {
            for i in 0..3 {
                let (a, b) = (key(t[i]), key(t[(i + 1) % 3]));
                let (edge, sign) = if a < b { ((a, b), 1) } else { ((b, a), -1) };
                *balance.entry(edge).or_insert(0) += sign;
            }
        }
        balance.values().all(|&n| n == 0)
    }
}
