//! Helpers of the whole-pipeline tests, which live in `tests/`.

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
    /// Texels of surface points within `radius` metres of `at`, on faces whose normal is within 25° of `normal`: found
    /// through the lightmap coordinates of the dataset's own geometry, as a game would.
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
        let root = glb.document.nodes().find(|n| n.name() == Some("scene")).expect("a root node");
        let origin = root.transform().decomposed().0;
        let mut texels = Vec::new();
        // Instances share meshes: a node's matrix says where one stands, its extras where its texels lie.
        for node in root.children() {
            let Some(extras) = node.extras() else { continue };
            let extras: serde_json::Value = serde_json::from_str(extras.get()).expect("JSON");
            if extras["lightmapPage"] != page {
                continue;
            }
            let pair = |key: &str| [0, 1].map(|c| extras[key][c].as_f64().expect("a number") as f32);
            let (scale, offset) = (pair("lightmapScale"), pair("lightmapOffset"));
            let matrix = node.transform().matrix();
            let linear = |v: [f32; 3]| [0, 1, 2].map(|r| (0..3).map(|c| matrix[c][r] * v[c]).sum::<f32>());
            let primitive = node.mesh().and_then(|m| m.primitives().next()).expect("a mesh");
            let reader = primitive.reader(|_| Some(blob));
            let uvs = reader.read_tex_coords(1).expect("lightmap coordinates").into_f32();
            let uvs: Vec<[f32; 2]> = uvs.map(|uv| [0, 1].map(|c| scale[c] * uv[c] + offset[c])).collect();
            let positions = reader.read_positions().expect("positions").map(linear);
            let positions: Vec<[f32; 3]> =
                positions.map(|p| [0, 1, 2].map(|c| p[c] + matrix[3][c])).collect();
            // Shapes are kept, so normals turn as positions do.
            let normals = reader.read_normals().expect("normals").map(linear).map(|n| {
                let length = n.iter().map(|x| x * x).sum::<f32>().sqrt();
                n.map(|x| x / length)
            });
            let normals: Vec<[f32; 3]> = normals.collect();
            let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
            for corners in indices.chunks_exact(3) {
                let corners = [corners[0] as usize, corners[1] as usize, corners[2] as usize];
                let facing: f32 = (0..3).map(|k| normals[corners[0]][k] * normal[k]).sum();
                if facing < 0.9 {
                    continue;
                }
                // Walks over the triangle finely and notes the texels of points near the place.
                let steps = 160;
                for i in 0..=steps {
                    for j in 0..=steps - i {
                        let (b1, b2) = (i as f32 / steps as f32, j as f32 / steps as f32);
                        let weights = [1.0 - b1 - b2, b1, b2];
                        let mix = |value: &dyn Fn(usize) -> f32| -> f32 {
                            (0..3).map(|k| weights[k] * value(corners[k])).sum()
                        };
                        let point = [0, 1, 2].map(|c| mix(&|v| positions[v][c]) + origin[c]);
                        if (0..3).map(|c| (point[c] - at[c]).powi(2)).sum::<f32>() > radius * radius {
                            continue;
                        }
                        let x = ((mix(&|v| uvs[v][0]) * width as f32) as usize).min(width - 1);
                        let y = ((mix(&|v| uvs[v][1]) * height as f32) as usize).min(height - 1);
                        if mask.valid[y * width + x] {
                            texels.push(y * width + x);
                        }
                    }
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
