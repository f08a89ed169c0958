//! Helpers of the whole-pipeline tests, which live in `tests/`.

pub mod faults;

use dataset::image::Image;
use dataset::store::Dataset;

/// The valid texels near a named place of a scene.
pub struct Probe {
    /// The page they lie on.
    pub page: usize,
    /// Their indices on it.
    pub texels: Vec<usize>,
}

impl Probe {
    /// Texels of surface points within `radius` metres of `at`, on faces whose normal is within 25° of
    /// `normal`: found through the lightmap coordinates of the dataset's own geometry, as a game would.
    pub fn new(dataset: &Dataset, at: [f32; 3], normal: [f32; 3], radius: f32) -> Self {
        let pages = 0..dataset.config.pages.len();
        let probes = pages.map(|page| Probe::on_page(dataset, page, at, normal, radius));
        let found = probes.into_iter().max_by_key(|probe| probe.texels.len());
        found.filter(|probe| !probe.texels.is_empty()).unwrap_or_else(|| panic!("no texel near {at:?}"))
    }

    /// The texels on one page, if there are any.
    fn on_page(dataset: &Dataset, page: usize, at: [f32; 3], normal: [f32; 3], radius: f32) -> Self {
        let file = dataset.path(dataset.config.geometry.as_ref().expect("a baked set has geometry"));
        let glb = gltf::Gltf::from_slice(&std::fs::read(file).expect("readable")).expect("valid glTF");
        let blob = glb.blob.as_deref().expect("a binary chunk");
        let mask = dataset.mask(page).expect("a mask");
        let (width, height) = (mask.width, mask.height);
        let mut texels = Vec::new();
        // Instances share meshes: a node's matrix says where one stands, its extras where its texels lie.
        for (node, matrix) in nodes_in_world(&glb.document) {
            let Some(extras) = node.extras() else { continue };
            let extras: serde_json::Value = serde_json::from_str(extras.get()).expect("JSON");
            if extras["lightmapPage"] != page {
                continue;
            }
            let pair = |key: &str| [0, 1].map(|c| extras[key][c].as_f64().expect("a number") as f32);
            let (scale, offset) = (pair("lightmapScale"), pair("lightmapOffset"));
            let linear = |v: [f32; 3]| [0, 1, 2].map(|r| (0..3).map(|c| matrix[c][r] * v[c]).sum::<f32>());
            for primitive in node.mesh().expect("a mesh").primitives() {
                let reader = primitive.reader(|_| Some(blob));
                let uvs = reader.read_tex_coords(1).expect("lightmap coordinates").into_f32();
                let uvs: Vec<[f32; 2]> = uvs.map(|uv| [0, 1].map(|c| scale[c] * uv[c] + offset[c])).collect();
                let positions = reader.read_positions().expect("positions").map(linear);
                let positions: Vec<[f32; 3]> =
                    positions.map(|p| [0, 1, 2].map(|c| p[c] + matrix[3][c])).collect();
                let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
                for corners in indices.chunks_exact(3) {
                    let corners = [corners[0] as usize, corners[1] as usize, corners[2] as usize];
                    if facing(corners.map(|v| positions[v]), &matrix, normal) < 0.9 {
                        continue;
                    }
                    walk(corners, &positions, &uvs, |point, uv| {
                        if (0..3).map(|c| (point[c] - at[c]).powi(2)).sum::<f32>() > radius * radius {
                            return;
                        }
                        let x = ((uv[0] * width as f32) as usize).min(width - 1);
                        let y = ((uv[1] * height as f32) as usize).min(height - 1);
                        if mask.valid[y * width + x] {
                            texels.push(y * width + x);
                        }
                    });
                }
            }
        }
        texels.sort_unstable();
        texels.dedup();
        Probe { page, texels }
    }

    /// Mean over the texels and channels.
    pub fn mean(&self, image: &Image) -> f64 {
        let sum: f64 = self.texels.iter().flat_map(|&t| image.texels[t]).map(f64::from).sum();
        sum / (3 * self.texels.len()) as f64
    }
}

/// A matrix, column by column.
pub type Matrix = [[f32; 4]; 4];

/// All nodes of a file's scene and where they stand, parents first.
pub fn nodes_in_world(document: &gltf::Document) -> Vec<(gltf::Node<'_>, Matrix)> {
    let identity = [0, 1, 2, 3].map(|c| [0, 1, 2, 3].map(|r| if r == c { 1.0 } else { 0.0 }));
    let scene = document.default_scene().expect("a scene");
    let mut stack: Vec<(gltf::Node, Matrix)> = scene.nodes().map(|node| (node, identity)).collect();
    stack.reverse();
    let mut all = Vec::new();
    while let Some((node, parent)) = stack.pop() {
        let own = node.transform().matrix();
        let world = own.map(|column| [0, 1, 2, 3].map(|r| (0..4).map(|k| parent[k][r] * column[k]).sum()));
        let children: Vec<_> = node.children().map(|child| (child, world)).collect();
        stack.extend(children.into_iter().rev());
        all.push((node, world));
    }
    all
}

/// How much a triangle at a node, by its corners in the world, faces a direction: 1 if it does.
fn facing([a, b, c]: [[f32; 3]; 3], world_from_node: &Matrix, direction: [f32; 3]) -> f32 {
    let minus = |p: [f32; 3], q: [f32; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let cross = |u: [f32; 3], v: [f32; 3]| {
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    };
    let dot = |u: [f32; 3], v: [f32; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let column = |k: usize| [world_from_node[k][0], world_from_node[k][1], world_from_node[k][2]];
    let is_mirrored = dot(cross(column(0), column(1)), column(2)) < 0.0;
    let normal = cross(minus(b, a), minus(c, a));
    let cosine = dot(normal, direction) / dot(normal, normal).sqrt();
    if is_mirrored { -cosine } else { cosine }
}

/// Walks over a triangle finely: gives points and their coordinates.
fn walk(
    corners: [usize; 3],
    positions: &[[f32; 3]],
    uvs: &[[f32; 2]],
    mut take: impl FnMut([f32; 3], [f32; 2]),
) {
    let steps = 160;
    for i in 0..=steps {
        for j in 0..=steps - i {
            let (b1, b2) = (i as f32 / steps as f32, j as f32 / steps as f32);
            let weights = [1.0 - b1 - b2, b1, b2];
            let mix =
                |value: &dyn Fn(usize) -> f32| (0..3).map(|k| weights[k] * value(corners[k])).sum::<f32>();
            take([0, 1, 2].map(|c| mix(&|v| positions[v][c])), [0, 1].map(|c| mix(&|v| uvs[v][c])));
        }
    }
}
