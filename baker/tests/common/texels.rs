//! Where texels lie in the scene, read from the dataset's own geometry, as a game would.

use dataset::image::Mask;
use dataset::store::Dataset;
use glam::{DMat2, DMat4, DQuat, DVec2, DVec3, dvec2};

/// A texel whose centre lies on a surface.
#[derive(Clone, Debug)]
pub struct Texel {
    /// Index on the page.
    pub index: usize,
    /// The name of the placed mesh.
    pub name: String,
    /// Its front's unit normal.
    pub normal: DVec3,
    /// Whether the mask says that it is valid.
    pub valid: bool,
    /// Whether all of it lies on this flat piece of surface.
    pub whole: bool,
    /// World position of its upper left corner.
    corner: DVec3,
    /// Steps to the next texel right and down, in metres.
    step: [DVec3; 2],
}

impl Texel {
    /// World position of its centre.
    pub fn centre(&self) -> DVec3 {
        self.at(0.5, 0.5)
    }

    /// Area of surface it covers, in m², if it is whole.
    pub fn area(&self) -> f64 {
        self.step[0].cross(self.step[1]).length()
    }

    /// The longer of its sides in metres.
    pub fn size(&self) -> f64 {
        self.step[0].length().max(self.step[1].length())
    }

    fn at(&self, u: f64, v: f64) -> DVec3 {
        self.corner + self.step[0] * u + self.step[1] * v
    }

    /// The mean of a function of the position over the texel (4 × 4 cells of 2 × 2 Gauss points).
    pub fn average(&self, f: impl Fn(DVec3) -> f64) -> f64 {
        const N: usize = 8;
        let gauss = 0.5 / 3.0f64.sqrt();
        let place = |i: usize| {
            ((i / 2) as f64 + 0.5 + if i.is_multiple_of(2) { -gauss } else { gauss }) / (N / 2) as f64
        };
        let cells = (0..N * N).map(|i| f(self.at(place(i % N), place(i / N))));
        cells.sum::<f64>() / (N * N) as f64
    }
}

/// A triangle on the page, in texels, and in the world.
struct Piece {
    name: usize,
    page: [DVec2; 3],
    normal: DVec3,
    /// world = at(0, 0) + step · (x, y).
    corner: DVec3,
    step: [DVec3; 2],
}

impl Piece {
    fn new(name: usize, page: [DVec2; 3], world: [DVec3; 3]) -> Option<Self> {
        let to_corners = DMat2::from_cols(page[1] - page[0], page[2] - page[0]);
        if to_corners.determinant().abs() < 1e-12 {
            return None;
        }
        let from_page = to_corners.inverse();
        let (e1, e2) = (world[1] - world[0], world[2] - world[0]);
        let step = [from_page.x_axis, from_page.y_axis].map(|c| e1 * c.x + e2 * c.y);
        let corner = world[0] - step[0] * page[0].x - step[1] * page[0].y;
        Some(Piece { name, page, normal: e1.cross(e2).normalize_or_zero(), corner, step })
    }

    fn contains(&self, p: DVec2, slack: f64) -> bool {
        let [a, b, c] = self.page;
        let area = (b - a).perp_dot(c - a);
        let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p) / area;
        [side(b, c, p), side(c, a, p), side(a, b, p)].iter().all(|&w| w >= -slack)
    }

    fn at(&self, p: DVec2) -> DVec3 {
        self.corner + self.step[0] * p.x + self.step[1] * p.y
    }
}

/// All texels of page 0 whose centres lie on surface.
pub fn of(dataset: &Dataset, mask: &Mask) -> Vec<Texel> {
    let file = dataset.path(dataset.config.geometry.as_ref().expect("a baked set has geometry"));
    let bytes = std::fs::read(file).expect("readable");
    let glb = gltf::Gltf::from_slice(&bytes).expect("valid glTF");
    // The transforms as they are written: the reader has them in single precision.
    let json = gltf::Glb::from_slice(&bytes).expect("a GLB").json;
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    let blob = glb.blob.as_deref().expect("a binary chunk");
    let size = dvec2(mask.width as f64, mask.height as f64);
    let matrix = |n: &gltf::Node| {
        let node = &json["nodes"][n.index()];
        let numbers = |key: &str| serde_json::from_value::<Vec<f64>>(node[key].clone()).ok();
        if let Some(matrix) = numbers("matrix") {
            return DMat4::from_cols_slice(&matrix);
        }
        let vector = |key: &str, default: DVec3| numbers(key).map_or(default, |v| DVec3::from_slice(&v));
        let rotation = numbers("rotation").map_or(DQuat::IDENTITY, |q| DQuat::from_slice(&q).normalize());
        let (scale, translation) = (vector("scale", DVec3::ONE), vector("translation", DVec3::ZERO));
        DMat4::from_scale_rotation_translation(scale, rotation, translation)
    };
    let scene = glb.document.default_scene().expect("a scene");
    // Placed files of one name are numbered.
    let mut stack: Vec<(gltf::Node, DMat4, String)> = Vec::new();
    for node in scene.nodes() {
        let number = stack.iter().filter(|(before, ..)| before.name() == node.name()).count();
        stack.push((node, DMat4::IDENTITY, format!("#{number}")));
    }
    stack.reverse();
    let (mut names, mut pieces) = (Vec::new(), Vec::new());
    while let Some((node, world_from_parent, parents)) = stack.pop() {
        let world_from_mesh = world_from_parent * matrix(&node);
        let path = match parents.strip_prefix('#') {
            Some(number) => format!("{} #{number}", node.name().unwrap_or("")),
            None => format!("{parents}/{}", node.name().unwrap_or("")),
        };
        let children: Vec<_> = node.children().collect();
        stack.extend(children.into_iter().rev().map(|child| (child, world_from_mesh, path.clone())));
        let extras = node.extras().as_ref().map(|extras| serde_json::from_str(extras.get()).expect("JSON"));
        let extras: serde_json::Value = extras.unwrap_or_default();
        if extras["lightmapScale"].is_null() {
            continue;
        }
        let pair = |key: &str| dvec2(extras[key][0].as_f64().unwrap(), extras[key][1].as_f64().unwrap());
        let (scale, offset) = (pair("lightmapScale"), pair("lightmapOffset"));
        for primitive in node.mesh().expect("a mesh").primitives() {
            let reader = primitive.reader(|_| Some(blob));
            let Some(uvs) = reader.read_tex_coords(1) else { continue };
            let on_page = |uv: [f32; 2]| (dvec2(uv[0].into(), uv[1].into()) * scale + offset) * size;
            let uvs: Vec<DVec2> = uvs.into_f32().map(on_page).collect();
            let positions = reader.read_positions().expect("positions");
            let in_world = |p: [f32; 3]| world_from_mesh.transform_point3(DVec3::from(p.map(f64::from)));
            let positions: Vec<DVec3> = positions.map(in_world).collect();
            let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
            for corners in indices.chunks_exact(3) {
                let corners = [corners[0], corners[1], corners[2]].map(|c| c as usize);
                // A node that mirrors turns fronts over; two corners the other way round turn them back.
                let [a, b, c] = corners;
                let corners = if world_from_mesh.determinant() < 0.0 { [a, c, b] } else { corners };
                let (page, world) = (corners.map(|c| uvs[c]), corners.map(|c| positions[c]));
                pieces.extend(Piece::new(names.len(), page, world));
            }
            let material = primitive.material().name().unwrap_or("").to_owned();
            names.push(format!("{path}/{material}"));
        }
    }
    let mut texels = Vec::new();
    for piece in &pieces {
        let low = piece.page.iter().copied().fold(DVec2::INFINITY, DVec2::min).max(DVec2::ZERO);
        let high = piece.page.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max).min(size);
        for y in low.y as usize..(high.y.ceil() as usize).min(mask.height) {
            for x in low.x as usize..(high.x.ceil() as usize).min(mask.width) {
                let corner = dvec2(x as f64, y as f64);
                if !piece.contains(corner + 0.5, 0.0) {
                    continue;
                }
                let step = piece.step;
                let size = step[0].length().max(step[1].length());
                // Every corner lies on a piece of the same plane, laid out alike.
                let continues = |p: DVec2| {
                    pieces.iter().any(|other| {
                        other.name == piece.name
                            && other.contains(p, 1e-5)
                            && other.normal.dot(piece.normal) > 0.9999
                            && (other.at(p) - piece.at(p)).length() < 1e-2 * size
                    })
                };
                let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
                let whole = corners.iter().all(|&(u, v)| continues(corner + dvec2(u, v)));
                let index = y * mask.width + x;
                texels.push(Texel {
                    index,
                    name: names[piece.name].clone(),
                    normal: piece.normal,
                    valid: mask.valid[index],
                    whole,
                    corner: piece.at(corner),
                    step,
                });
            }
        }
    }
    // A centre on an edge lies on two pieces.
    texels.sort_by_key(|t| t.index);
    texels.dedup_by_key(|t| t.index);
    texels
}
