//! Meshes of an OBJ: from faces, whose corners have an index per attribute, to vertices.

use super::map::Placement;
use crate::geometry::model::Mesh;
use crate::geometry::notes::{Notes, plural};
use crate::geometry::polygon::triangulate;
use crate::geometry::texture::linear_from_srgb;
use dataset::{Error, Result};
use glam::{DVec3, Vec3, Vec4};

/// In place of an index: the corner has none.
pub(super) const MISSING: u32 = u32::MAX;
/// Colours of which one is greater count to 255.
const GREATEST_SHARE: f32 = 2.0;

/// Indices of `v`, `vt` and `vn`.
pub(super) type Corner = [u32; 3];

/// What the corners of all faces name.
#[derive(Default)]
pub(super) struct Vertices {
    pub v: Vec<DVec3>,
    pub vt: Vec<[f64; 2]>,
    pub vn: Vec<[f64; 3]>,
    /// Colours of the first vertices, sRGB; empty as long as none has one.
    colours: Vec<Option<Vec3>>,
    /// Those that ZBrush writes apart, in the order of the vertices.
    painted: Vec<Vec3>,
}

/// A mesh of an OBJ: what stands between two names or materials.
#[derive(Default)]
pub(super) struct Faces {
    pub name: String,
    /// Index into the materials that are used.
    pub material: Option<usize>,
    /// Face after face.
    pub corners: Vec<Corner>,
    /// Corners of each face, three or more.
    pub arities: Vec<u32>,
}

/// What a mesh is made of.
pub(super) struct Uses {
    /// The material's index in the model.
    pub material: usize,
    pub texture: Placement,
    pub emission: Option<Placement>,
    pub vt_is_lightmap: bool,
}

impl Vertices {
    /// Adds a `v`: three coordinates, then a weight, which is of no use, or a colour.
    pub(super) fn add(&mut self, numbers: &[f64]) {
        if let Some(colour) = numbers.get(3..6) {
            self.colours.resize(self.v.len(), None);
            self.colours.push(Some(DVec3::from_slice(colour).as_vec3()));
        }
        self.v.push(DVec3::from_slice(numbers));
    }

    /// Adds the colours of a `#MRGB`: eight hexadecimal digits each, a mask before red, green and blue.
    pub(super) fn paint(&mut self, digits: &str) {
        let colour = |digits: &[u8]| {
            let bits = u32::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
            let [_, r, g, b] = bits.to_be_bytes();
            Some(Vec3::new(f32::from(r), f32::from(g), f32::from(b)) / 255.0)
        };
        self.painted.extend(digits.as_bytes().as_chunks::<8>().0.iter().map_while(|digits| colour(digits)));
    }

    /// Ends the list: all colours as shares.
    pub(super) fn finish(&mut self) {
        let greatest = self.colours.iter().flatten().map(|colour| colour.max_element()).fold(0.0, f32::max);
        if greatest > GREATEST_SHARE {
            self.colours.iter_mut().flatten().for_each(|colour| *colour /= 255.0);
        }
        if self.colours.is_empty() {
            self.colours = self.painted.iter().copied().map(Some).collect();
        }
    }

    fn colour(&self, v: u32) -> Option<Vec3> {
        self.colours.get(v as usize).copied().flatten()
    }
}

impl Faces {
    /// Whether any of its vertices has a colour.
    pub(super) fn has_colours(&self, vertices: &Vertices) -> bool {
        !vertices.colours.is_empty() && self.corners.iter().any(|[v, ..]| vertices.colour(*v).is_some())
    }

    /// Equal corners as one: the vertex of each corner, and the corner of each vertex.
    fn unite(&self) -> (Vec<u32>, Vec<Corner>) {
        let corners = &self.corners;
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        order.sort_unstable_by_key(|&i| (corners[i as usize], i));
        // The first of each run of equal ones stands for all.
        let mut vertex_of = vec![0; corners.len()];
        let mut first = 0;
        for &i in &order {
            if corners[i as usize] != corners[first as usize] || i == order[0] {
                first = i;
            }
            vertex_of[i as usize] = first;
        }
        // Vertices are numbered by first use.
        let mut united = Vec::new();
        for (i, &corner) in corners.iter().enumerate() {
            let first = vertex_of[i] as usize;
            vertex_of[i] = if first == i {
                united.push(corner);
                united.len() as u32 - 1
            } else {
                vertex_of[first]
            };
        }
        (vertex_of, united)
    }
}

/// Triangulates, recentres and checks a mesh.
pub(super) fn convert(
    faces: &Faces,
    vertices: &Vertices,
    uses: &Uses,
    file: &str,
    notes: &mut Notes,
) -> Result<Mesh> {
    let name = &faces.name;
    let place = format!("{file}: {name}");
    let mut note = |what: &str| notes.add(file, "mesh", name, what);
    let (vertex_of, corners) = faces.unite();
    let positions: Vec<DVec3> = corners.iter().map(|[v, ..]| vertices.v[*v as usize]).collect();
    if let Some(bad) = positions.iter().find(|p| !p.is_finite()) {
        let what = format!("v {} {} {}: expected finite numbers", bad.x, bad.y, bad.z);
        return Err(Error::invalid(&place, what));
    }
    let origin = positions.first().copied().unwrap_or_default();
    let mut result = Mesh { name: name.clone(), material: uses.material, origin, ..Mesh::default() };
    result.positions = positions.iter().map(|p| (p - origin).as_vec3()).collect();
    let counts = [vertices.v.len(), vertices.vt.len(), vertices.vn.len()];
    let missing = |kind: usize| match counts[kind] {
        0 => corners.len(),
        _ => corners.iter().filter(|corner| corner[kind] == MISSING).count(),
    };
    match missing(2) {
        0 => {
            let normal = |corner: &Corner| DVec3::from_array(vertices.vn[corner[2] as usize]).as_vec3();
            result.normals = corners.iter().map(normal).collect();
        }
        n if n < corners.len() => note("some faces have no vn: all are shaded flat"),
        _ => {}
    }
    match missing(1) {
        0 => {
            let by = |placement: Placement| {
                corners.iter().map(|corner| placement.uv(vertices.vt[corner[1] as usize])).collect()
            };
            result.uvs = by(uses.texture);
            if uses.vt_is_lightmap {
                result.lightmap_uvs = by(Placement::IDENTITY);
            }
            if let Some(placement) = uses.emission {
                result.emission_uvs = by(placement);
            }
        }
        n if n < corners.len() => note("some faces have no vt: none are used"),
        _ => {}
    }
    if uses.vt_is_lightmap && result.lightmap_uvs.is_empty() {
        note("vt = \"lightmap\", but there are no vt: it is unwrapped");
    }
    if faces.has_colours(vertices) {
        let colour = |corner: &Corner| -> Vec4 {
            let colour = vertices.colour(corner[0]).unwrap_or(Vec3::ONE);
            // (One that is no number stays, to be told with its vertex.)
            Vec3::from(colour.to_array().map(|c| linear_from_srgb(f64::from(c.clamp(0.0, 1.0))) as f32))
                .extend(1.0)
        };
        result.colours = corners.iter().map(colour).collect();
    }
    let (mut polygon, mut cut) = (Vec::new(), Vec::new());
    let mut rest = &vertex_of[..];
    let mut crossed = 0;
    for &arity in &faces.arities {
        let (face, after) = rest.split_at(arity as usize);
        rest = after;
        if let [a, b, c] = *face {
            result.triangles.push([a, b, c]);
            continue;
        }
        polygon.clear();
        polygon.extend(face.iter().map(|&v| positions[v as usize]));
        cut.clear();
        crossed += usize::from(!triangulate(&polygon, &mut cut));
        result.triangles.extend(cut.iter().map(|t| t.map(|i| face[i])));
    }
    if crossed > 0 {
        let what = "faces that cross themselves or have no area are cut as fans, which may overlap: triangulate them in the modeller";
        notes.add(file, "mesh", format!("{name} ({})", plural(crossed, "face")), what);
    }
    let dropped = result.finish(&place)?;
    dropped.note_copies(file, name, notes);
    if dropped.repeated > 0 {
        let what = "faces with two corners at one point have no area and are left out";
        notes.add(file, "mesh", format!("{name} ({})", plural(dropped.repeated, "triangle")), what);
    }
    Ok(result)
}
