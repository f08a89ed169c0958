//! From world-space triangles to flat charts in metres: authored layouts where they are valid, xatlas
//! elsewhere. Instances of one shape are flattened once.

use super::ffi;
use super::islands::{islands, surfaces};
use super::raster::{Bits, bounds};
use super::sharing::{Member, groups};
use super::unwraps::{Key, Unwrap, Unwrapped, Unwraps};
use crate::geometry::{Geometry, Instance};
use crate::{Error, Result};
use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// A connected piece of surface laid flat.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    /// Its triangles, ascending.
    pub faces: Vec<FlatFace>,
    /// Upper corner of the bounding box in metres × density; the lower one is (0, 0).
    pub size: DVec2,
    /// Where it is in space: the mean of its surface, of the first member, in metres.
    pub centre: DVec3,
}

impl Chart {
    /// Its area in m² × density².
    pub(super) fn area(&self) -> f64 {
        self.faces.iter().map(|face| signed_area(face.corners).abs()).sum()
    }
}

/// A triangle of a chart.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlatFace {
    /// Index into `Geometry::triangles`, of the first member.
    pub triangle: u32,
    /// Corners in metres × density, of the smallest member.
    pub corners: [DVec2; 3],
}

/// The charts of one shape, and the instances that have it.
#[derive(Clone, Debug)]
pub(super) struct FlatMesh {
    /// By lowest triangle.
    pub charts: Vec<Chart>,
    /// At least one. One alone has its charts wherever they fit; several share a layout.
    pub members: Vec<Member>,
}

impl FlatMesh {
    /// Whether the charts form a layout of their own that goes on the page as a whole, once per member.
    pub(super) fn is_shared(&self) -> bool {
        self.members.len() > 1
    }

    /// The area of all charts of all members in m² × density².
    pub(super) fn area(&self) -> f64 {
        let one: f64 = self.charts.iter().map(Chart::area).sum();
        self.members.iter().map(|member| one * member.scale * member.scale).sum()
    }
}

/// All charts of a geometry.
#[derive(Debug, Default)]
pub(super) struct Flat {
    /// By first member; those without a triangle of area are left out.
    pub meshes: Vec<FlatMesh>,
    /// How many instances have a layout of their file that is used.
    pub authored: usize,
    /// Per shape whose file's layout is not used: which, and why.
    pub refused: Vec<String>,
}

/// A lightmapped triangle that has an area.
#[derive(Clone, Copy)]
struct Source {
    triangle: u32,
    corners: [DVec3; 3],
    area: f64,
}

/// Where a mesh's charts come from.
enum Layout {
    /// The file's own layout.
    Authored,
    /// xatlas; with what is wrong with the file's layout, where there is one.
    Unwrapped(Option<String>),
}

/// Flattens all lightmapped instances; one task per shape, joined in order. `hidden`, ascending, get no
/// texels where they are hidden in every instance of a shape. What `kept` has is not unwrapped again.
pub(super) fn flatten(geometry: &Geometry, hidden: &[u32], kept: &dyn Unwraps) -> Result<Flat> {
    geometry
        .instances
        .par_iter()
        .filter(|instance| instance.lightmap)
        .try_for_each(|i| check(geometry, i))?;
    let parts: Vec<(FlatMesh, Layout)> =
        groups(geometry).into_par_iter().map(|group| flatten_group(geometry, hidden, group, kept)).collect();
    let mut all = Flat::default();
    for (mesh, layout) in parts {
        match layout {
            Layout::Authored => all.authored += mesh.members.len(),
            Layout::Unwrapped(refused) => all.refused.extend(refused),
        }
        if !mesh.charts.is_empty() {
            all.meshes.push(mesh);
        }
    }
    Ok(all)
}

/// Checks an instance's numbers.
fn check(geometry: &Geometry, instance: &Instance) -> Result<()> {
    if !(instance.density.is_finite() && instance.density > 0.0) {
        let what = format!("density is {}, expected a positive number", instance.density);
        return Err(Error::invalid(&instance.name, what));
    }
    for triangle in instance.triangles.clone() {
        if geometry.corners(triangle).iter().any(|p| !p.is_finite()) {
            let what =
                format!("triangle {} has a corner that is not finite", triangle - instance.triangles.start);
            return Err(Error::invalid(&instance.name, what));
        }
    }
    Ok(())
}

/// Flattens the first member, at the density of the smallest. Gives the charts, and where they come from.
fn flatten_group(
    geometry: &Geometry,
    hidden: &[u32],
    group: super::sharing::Group,
    kept: &dyn Unwraps,
) -> (FlatMesh, Layout) {
    let mut mesh = FlatMesh { charts: Vec::new(), members: group.members };
    let instance = &geometry.instances[mesh.members[0].instance];
    let is_hidden = |triangle: usize| {
        let of = |member: &Member| {
            geometry.instances[member.instance].triangles.start + triangle - instance.triangles.start
        };
        mesh.members.iter().all(|member| hidden.binary_search(&(of(member) as u32)).is_ok())
    };
    let mut sources = Vec::with_capacity(instance.triangles.len());
    for triangle in instance.triangles.clone().filter(|&triangle| !is_hidden(triangle)) {
        let corners = geometry.corners(triangle).map(|p| p.as_dvec3());
        if let Some(area) = area(corners) {
            sources.push(Source { triangle: triangle as u32, corners, area });
        }
    }
    if sources.is_empty() {
        return (mesh, Layout::Unwrapped(None));
    }
    // Groups of flat triangles: the authored layout if there is a valid one, else xatlas' charts.
    let authored = if instance.has_lightmap_uvs { authored(geometry, &sources) } else { Err("") };
    let (groups, layout) = match authored {
        Ok(groups) => (groups, Layout::Authored),
        Err(why) => {
            let name = &instance.name;
            let refused = || format!("{name}: {why}");
            (unwrapped(geometry, &sources, kept), Layout::Unwrapped((!why.is_empty()).then(refused)))
        }
    };
    let chart = |faces: Vec<FlatFace>| {
        let centre = centre(geometry, &faces);
        let (faces, size) = place_upright(faces, group.density);
        Chart { faces, size, centre }
    };
    mesh.charts = groups.into_iter().map(chart).collect();
    mesh.charts.sort_by_key(|chart| chart.faces[0].triangle);
    (mesh, layout)
}

/// Whether a triangle is too thin to have texels.
pub(super) fn is_degenerate(corners: [DVec3; 3]) -> bool {
    area(corners).is_none()
}

/// The area of a triangle in m²; `None` when its height is within rounding of its corners (f32 relative to
/// the origin).
fn area(corners: [DVec3; 3]) -> Option<f64> {
    let [a, b, c] = corners;
    let magnitude = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let twice_area = (b - a).cross(c - a).length();
    let rounding = magnitude * f64::from(f32::EPSILON);
    (twice_area > longest * rounding.max(longest * 1e-7)).then_some(0.5 * twice_area)
}

fn signed_area(corners: [DVec2; 3]) -> f64 {
    0.5 * (corners[1] - corners[0]).perp_dot(corners[2] - corners[0])
}

/// The islands of the authored layout, all scaled alike so that the instance keeps its area. An error says
/// why it is unusable.
fn authored(geometry: &Geometry, sources: &[Source]) -> Result<Vec<Vec<FlatFace>>, &'static str> {
    let vertices = |s: &Source| geometry.triangles[s.triangle as usize];
    let uvs = |s: &Source| vertices(s).map(|v| geometry.lightmap_uvs[v as usize].as_dvec2());
    let corners: Vec<[DVec2; 3]> = sources.iter().map(uvs).collect();
    if corners.iter().flatten().any(|uv| !uv.is_finite()) {
        return Err("a coordinate is not finite");
    }
    let inside = |uv: &DVec2| uv.min_element() >= -1e-4 && uv.max_element() <= 1.0 + 1e-4;
    if !corners.iter().flatten().all(inside) {
        return Err("it leaves [0, 1]");
    }
    // A triangle of area must have area on the map: at least 10⁻⁴ of its share.
    let uv_area: f64 = corners.iter().map(|&c| signed_area(c).abs()).sum();
    let world_area: f64 = sources.iter().map(|s| s.area).sum();
    let share = |s: &Source, c: [DVec2; 3]| signed_area(c).abs() / uv_area >= 1e-4 * s.area / world_area;
    if uv_area <= 0.0 || !sources.iter().zip(&corners).all(|(s, &c)| share(s, c)) {
        return Err("a triangle has no area there");
    }
    if overlaps(&corners, 2048) {
        return Err("triangles overlap");
    }
    let scale = (world_area / uv_area).sqrt();
    let faces = sources.iter().zip(&corners);
    let faces: Vec<FlatFace> =
        faces.map(|(s, c)| FlatFace { triangle: s.triangle, corners: c.map(|uv| uv * scale) }).collect();
    let triangles: Vec<u32> = sources.iter().map(|s| s.triangle).collect();
    let labels = islands(geometry, &triangles);
    Ok(grouped(faces, &labels))
}

/// Faces that xatlas segments at a time at most: its time grows with their square where the surface is
/// smooth.
const MOST_FACES: usize = 1 << 12;

/// Pairs of vertices that xatlas may try when it looks for the neighbours of edges: for each side of a face
/// all that lie where its ends do. Ordinary meshes have some tens per side; where thousands of faces meet in
/// a point or along an edge, the pairs grow with the cube of the faces.
const MOST_PAIRS: u64 = 1 << 22;

/// Changes whenever the same triangles would come apart otherwise.
const METHOD: &str = "unwrap-2";

/// Charts by xatlas, each scaled to its area in the world; what it leaves out or gets wrong lies flat
/// triangle by triangle.
fn unwrapped(geometry: &Geometry, sources: &[Source], kept: &dyn Unwraps) -> Vec<Vec<FlatFace>> {
    let key = Mesh::of(geometry, sources).key();
    let unwrap = kept.get(&key, sources.len()).unwrap_or_else(|| {
        let unwrap = unwrap_in_pieces(geometry, sources);
        kept.put(&key, &unwrap);
        unwrap
    });
    let mut charts = Vec::new();
    let (mut flat, mut labels) = (Vec::new(), Vec::new());
    for (source, triangle) in sources.iter().zip(&unwrap.triangles) {
        match triangle.chart {
            Some(chart) => {
                let corners = triangle.corners.map(|corner| corner.as_dvec2());
                flat.push(FlatFace { triangle: source.triangle, corners });
                labels.push(chart as usize);
            }
            None => charts.push(vec![lie_flat(source)]),
        }
    }
    for mut chart in grouped(flat, &labels) {
        let world_area: f64 = chart.iter().map(|face| sources[place_of(sources, face.triangle)].area).sum();
        let scale = (world_area / flat_area(&chart)).sqrt();
        chart.iter_mut().for_each(|face| face.corners = face.corners.map(|c| c * scale));
        charts.push(chart);
    }
    charts
}

/// The place of a triangle among sources, which ascend.
fn place_of(sources: &[Source], triangle: u32) -> usize {
    sources.partition_point(|source| source.triangle < triangle)
}

fn flat_area(chart: &[FlatFace]) -> f64 {
    chart.iter().map(|face| signed_area(face.corners).abs()).sum()
}

/// Unwraps a mesh, a large one piece by piece, the pieces side by side.
fn unwrap_in_pieces(geometry: &Geometry, sources: &[Source]) -> Unwrap {
    let pieces = pieces(geometry, sources);
    let parts: Vec<Unwrap> = pieces.par_iter().map(|piece| unwrap(geometry, piece)).collect();
    let mut whole = Unwrap { triangles: vec![Unwrapped::ALONE; sources.len()] };
    let mut first = 0;
    for (piece, part) in pieces.iter().zip(parts) {
        for (source, triangle) in piece.iter().zip(part.triangles) {
            let chart = triangle.chart.map(|chart| first + chart);
            whole.triangles[place_of(sources, source.triangle)] = Unwrapped { chart, ..triangle };
        }
        first += piece.len() as u32;
    }
    whole
}

/// A mesh in pieces of at most [`MOST_FACES`]. Only what is joined to more than that is cut.
fn pieces(geometry: &Geometry, sources: &[Source]) -> Vec<Vec<Source>> {
    if sources.len() <= MOST_FACES {
        return vec![sources.to_vec()];
    }
    let triangles: Vec<u32> = sources.iter().map(|s| s.triangle).collect();
    let surface_of = surfaces(geometry, &triangles);
    let mut order: Vec<usize> = (0..sources.len()).collect();
    order.sort_by_key(|&i| (surface_of[i], i));
    let mut pieces: Vec<Vec<Source>> = vec![Vec::new()];
    for surface in order.chunk_by(|&a, &b| surface_of[a] == surface_of[b]) {
        let surface: Vec<Source> = surface.iter().map(|&i| sources[i]).collect();
        match pieces.last_mut() {
            Some(last) if last.len() + surface.len() <= MOST_FACES => last.extend(surface),
            _ => pieces.push(surface),
        }
    }
    while let Some(at) = pieces.iter().position(|piece| piece.len() > MOST_FACES) {
        let (low, high) = halves(pieces.swap_remove(at));
        pieces.extend([low, high]);
    }
    pieces.retain(|piece| !piece.is_empty());
    pieces.iter_mut().for_each(|piece| piece.sort_by_key(|source| source.triangle));
    pieces.sort_by_key(|piece| piece[0].triangle);
    pieces
}

/// The two halves of a piece of surface, along the axis on which it is longest.
fn halves(mut sources: Vec<Source>) -> (Vec<Source>, Vec<Source>) {
    let middle = |s: &Source| s.corners.iter().sum::<DVec3>();
    let (low, high) = sources
        .iter()
        .map(middle)
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let axis = (high - low).max_position();
    sources.sort_by(|a, b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.triangle.cmp(&b.triangle)));
    let far = sources.split_off(sources.len() / 2);
    (sources, far)
}

/// Triangles with the vertices that they use alone, numbered from 0 in the order of the geometry.
struct Mesh {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

impl Mesh {
    fn of(geometry: &Geometry, sources: &[Source]) -> Self {
        let mut vertices: Vec<u32> =
            sources.iter().flat_map(|s| geometry.triangles[s.triangle as usize]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let local = |v: u32| vertices.partition_point(|&other| other < v) as u32;
        let faces = sources.iter().map(|s| geometry.triangles[s.triangle as usize].map(local)).collect();
        let positions = vertices.iter().map(|&v| geometry.positions[v as usize]).collect();
        let normals = vertices.iter().map(|&v| geometry.normals[v as usize]).collect();
        Mesh { positions, normals, faces }
    }

    /// The same where vertices in one place are one, if they are too many for xatlas. (It tells creases by
    /// the vertices that lie there, so charts may go over some.)
    fn bounded(self) -> Self {
        let bits = |v: u32| self.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits());
        let mut order: Vec<u32> = (0..self.positions.len() as u32).collect();
        order.sort_unstable_by_key(|&v| (bits(v), v));
        let (mut first, mut count) = (vec![0u32; order.len()], vec![0u64; order.len()]);
        for same in order.chunk_by(|&a, &b| bits(a) == bits(b)) {
            same.iter().for_each(|&v| first[v as usize] = same[0]);
            count[same[0] as usize] = same.len() as u64;
        }
        let at = |v: u32| count[first[v as usize] as usize];
        let pairs: u64 =
            self.faces.iter().map(|&[a, b, c]| at(a) * at(b) + at(b) * at(c) + at(c) * at(a)).sum();
        if pairs <= MOST_PAIRS {
            return self;
        }
        let kept: Vec<u32> = (0..).zip(&first).filter(|(v, first)| v == *first).map(|(v, _)| v).collect();
        let local = |v: u32| kept.partition_point(|&other| other < first[v as usize]) as u32;
        Mesh {
            positions: kept.iter().map(|&v| self.positions[v as usize]).collect(),
            normals: kept.iter().map(|&v| self.normals[v as usize]).collect(),
            faces: self.faces.iter().map(|face| face.map(local)).collect(),
        }
    }

    /// Digest of all that decides its charts.
    fn key(&self) -> Key {
        let mut hash = blake3::Hasher::new();
        hash.update(METHOD.as_bytes());
        hash.update(&(self.positions.len() as u64).to_le_bytes());
        hash.update(&(self.faces.len() as u64).to_le_bytes());
        hash.update(bytemuck::cast_slice(&self.positions));
        hash.update(bytemuck::cast_slice(&self.normals));
        hash.update(bytemuck::cast_slice(&self.faces));
        *hash.finalize().as_bytes()
    }
}

/// xatlas' charts of triangles, those alone that are sound.
fn unwrap(geometry: &Geometry, sources: &[Source]) -> Unwrap {
    let mut unwrap = Unwrap { triangles: vec![Unwrapped::ALONE; sources.len()] };
    // xatlas has absolute tolerances: a face of mean area gets unit area, the instance's centre becomes the
    // origin.
    let low = sources.iter().flat_map(|s| s.corners).fold(DVec3::INFINITY, DVec3::min);
    let high = sources.iter().flat_map(|s| s.corners).fold(DVec3::NEG_INFINITY, DVec3::max);
    let (centre, extent) = (0.5 * (low + high), (high - low).max_element());
    let mean_area = sources.iter().map(|s| s.area).sum::<f64>() / sources.len() as f64;
    let scale = mean_area.sqrt().recip().min(1e5 / extent);
    let Mesh { positions, normals, faces } = Mesh::of(geometry, sources).bounded();
    let positions: Vec<Vec3> =
        positions.iter().map(|p| ((p.as_dvec3() - centre) * scale).as_vec3()).collect();
    let Some(result) = ffi::unwrap(&positions, &normals, &faces) else { return unwrap };
    let (mut flat, mut labels) = (Vec::new(), Vec::new());
    for (i, source) in sources.iter().enumerate() {
        if let Some(chart) = result.charts[i] {
            let corners = result.uvs[i].map(|corner| corner.as_dvec2());
            flat.push(FlatFace { triangle: source.triangle, corners });
            labels.push(chart as usize);
        }
    }
    let sound = grouped(flat, &labels).into_iter().filter(|chart| is_sound(chart, flat_area(chart)));
    for (chart, faces) in sound.enumerate() {
        for face in faces {
            let i = place_of(sources, face.triangle);
            unwrap.triangles[i] = Unwrapped { chart: Some(chart as u32), corners: result.uvs[i] };
        }
    }
    unwrap
}

/// Whether a chart is finite, turned one way everywhere, and free of overlaps.
fn is_sound(chart: &[FlatFace], flat_area: f64) -> bool {
    let areas = || chart.iter().map(|face| signed_area(face.corners));
    let corners: Vec<_> = chart.iter().map(|face| face.corners).collect();
    // Slivers may come out flipped by a rounding error; that much does no harm.
    let rounding = 1e-6 * flat_area;
    corners.iter().flatten().all(|c| c.is_finite())
        && flat_area > 0.0
        && (areas().all(|a| a > -rounding) || areas().all(|a| a < rounding))
        && !overlaps(&corners, 512)
}

/// Whether two triangles cover the same cell centre of a grid with `cells` cells along the longer side of
/// their bounds.
fn overlaps(triangles: &[[DVec2; 3]], cells: usize) -> bool {
    let (low, high) = extent(triangles.iter().copied());
    let scale = cells as f64 / (high - low).max_element();
    let size = ((high - low) * scale).ceil();
    let mut bits = Bits::new(size.x.max(1.0) as usize, size.y.max(1.0) as usize);
    triangles.iter().any(|t| bits.cover(t.map(|c| (c - low) * scale)))
}

fn extent(triangles: impl Iterator<Item = [DVec2; 3]>) -> (DVec2, DVec2) {
    triangles.map(bounds).fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// A triangle in its own plane.
fn lie_flat(source: &Source) -> FlatFace {
    let [a, b, c] = source.corners;
    let x = (b - a).normalize();
    let y = (b - a).cross(c - a).normalize().cross(x);
    let flat = |p: DVec3| DVec2::new((p - a).dot(x), (p - a).dot(y));
    FlatFace { triangle: source.triangle, corners: [DVec2::ZERO, flat(b), flat(c)] }
}

/// Faces by label, labels by first appearance.
fn grouped(faces: Vec<FlatFace>, labels: &[usize]) -> Vec<Vec<FlatFace>> {
    let mut slot = vec![usize::MAX; labels.iter().max().map_or(0, |m| m + 1)];
    let mut groups: Vec<Vec<FlatFace>> = Vec::new();
    for (face, &label) in faces.into_iter().zip(labels) {
        if slot[label] == usize::MAX {
            slot[label] = groups.len();
            groups.push(Vec::new());
        }
        groups[slot[label]].push(face);
    }
    groups
}

/// Turns a chart so that its bounding box is the smallest and lies along the axes, longer side along x, from
/// (0, 0).
fn place_upright(mut faces: Vec<FlatFace>, density: f64) -> (Vec<FlatFace>, DVec2) {
    let hull = convex_hull(faces.iter().flat_map(|f| f.corners).collect());
    // The smallest box shares a direction with an edge of the hull; a later one must be clearly smaller.
    let mut best = (f64::INFINITY, DVec2::X);
    for (i, &p) in hull.iter().enumerate() {
        let Some(axis) = (hull[(i + 1) % hull.len()] - p).try_normalize() else { continue };
        let (low, high) = hull
            .iter()
            .map(|q| DVec2::new(axis.dot(*q), axis.perp_dot(*q)))
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), q| (low.min(q), high.max(q)));
        let size = high - low;
        if size.x * size.y < best.0 * (1.0 - 1e-9) {
            best = (size.x * size.y, if size.x >= size.y { axis } else { axis.perp() });
        }
    }
    let axis = best.1;
    let turn = DMat2::from_cols(DVec2::new(axis.x, -axis.y), DVec2::new(axis.y, axis.x)) * density;
    faces.iter_mut().for_each(|face| face.corners = face.corners.map(|c| turn * c));
    let (low, high) = extent(faces.iter().map(|face| face.corners));
    faces.iter_mut().for_each(|face| face.corners = face.corners.map(|c| c - low));
    (faces, high - low)
}

/// The mean of faces in space, by area.
fn centre(geometry: &Geometry, faces: &[FlatFace]) -> DVec3 {
    let (mut centre, mut area) = (DVec3::ZERO, 0.0);
    for face in faces {
        let [a, b, c] = geometry.corners(face.triangle as usize).map(|p| p.as_dvec3());
        let weight = (b - a).cross(c - a).length();
        centre += weight * (a + b + c) / 3.0;
        area += weight;
    }
    centre / area
}

/// Andrew's monotone chain: the hull counter-clockwise, without collinear points.
fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let mut hull: Vec<DVec2> = Vec::new();
    for pass in 0..2 {
        let start = hull.len();
        for &p in &points {
            while hull.len() >= start + 2
                && (hull[hull.len() - 1] - hull[hull.len() - 2]).perp_dot(p - hull[hull.len() - 2]) <= 0.0
            {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    hull
}
