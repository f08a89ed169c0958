//! The baked geometry with its lightmap coordinates, as glTF binary: what a viewer or a game needs beside the maps.

use super::glass_glb;
use crate::atlas::{Atlas, Face, Placement};
use crate::geometry::{Geometry, Instance, Wrap};
use crate::{Error, Result};
use glam::{DAffine3, DMat4, Vec2, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The name under which the dataset's geometry is found.
pub const NAME: &str = "scene.glb";

/// Writes every instance as a node below the node `scene`, which stands at the scene's origin.
///
/// Instances that share a layout share a mesh: it holds the first one's positions, and the other nodes the matrices from there.
/// TEXCOORD_1 holds layout coordinates (v down, as glTF), and a node that has texels says in its `extras` where they lie: page
/// coordinates = `lightmapScale` × TEXCOORD_1 + `lightmapOffset`, on page `lightmapPage`. An instance that is too large for one
/// page is several nodes of its name, one for the triangles on each page. Instances without texels share a mesh when they have
/// the same shape; they have neither TEXCOORD_1 nor `extras`.
pub fn to_glb(geometry: &Geometry, atlas: &Atlas) -> Result<Vec<u8>> {
    let mut out = Glb::default();
    let mut nodes = Vec::new();
    let mut meshes = Vec::new();
    // Per layout of the atlas, the mesh that holds it.
    let mut mesh_of_layout: Vec<Option<usize>> = vec![None; atlas.layouts.len()];
    // Per mesh of the geometry, the meshes of instances that are not lightmapped, and the first instance of each.
    let mut plain: BTreeMap<u32, Vec<(usize, usize)>> = BTreeMap::new();
    for (i, instance) in geometry.instances.iter().enumerate() {
        if instance.triangles.is_empty() {
            continue;
        }
        let placements = &atlas.placements[i];
        // A node for every page that has texels of it; one where none has.
        for part in 0..placements.len().max(1) {
            let placement = placements.get(part);
            let mut node = json!({ "name": instance.name });
            if let Some(Placement { page, scale, offset, .. }) = placement {
                node["extras"] =
                    json!({ "lightmapScale": scale, "lightmapOffset": offset, "lightmapPage": page });
            }
            // The mesh that is there already, and the map from the instance whose positions it holds.
            let layout = placement.and_then(|p| p.layout).map(|l| l as usize);
            let map_from = |(mesh, first): (usize, usize)| {
                let similarity = geometry.instances[first].similarity(instance, geometry.origin)?;
                Some((mesh, similarity.map))
            };
            let known = match layout {
                Some(l) => {
                    mesh_of_layout[l].and_then(|mesh| map_from((mesh, atlas.layouts[l].instance as usize)))
                }
                None if placement.is_some() => None,
                None => plain.get(&instance.mesh).into_iter().flatten().copied().find_map(map_from),
            };
            if let Some((mesh, map)) = known {
                node["mesh"] = json!(mesh);
                if map != DAffine3::IDENTITY {
                    node["matrix"] = json!(DMat4::from(map).as_mat4().to_cols_array());
                }
            } else {
                let number = meshes.len();
                node["mesh"] = json!(number);
                let all = instance.triangles.clone();
                meshes.push(if let Some(l) = layout {
                    mesh_of_layout[l] = Some(number);
                    mesh(geometry, all, Some(&atlas.layouts[l].faces), &mut out)
                } else if let Some(&Placement { page, .. }) = placement {
                    let faces = own_layout(atlas, instance, page);
                    if placements.len() == 1 {
                        mesh(geometry, all, Some(&faces), &mut out)
                    } else {
                        let part = part_on_page(atlas, instance, page, part == 0);
                        mesh(geometry, part.into_iter(), Some(&faces), &mut out)
                    }
                } else {
                    plain.entry(instance.mesh).or_default().push((number, i));
                    mesh(geometry, all, None, &mut out)
                });
            }
            nodes.push(node);
        }
    }
    let children: Vec<usize> = (0..nodes.len()).collect();
    nodes.push(json!({ "name": "scene", "translation": geometry.origin.to_array(), "children": children }));
    let (images, samplers, textures) = textures(geometry, &mut out)?;
    let root = json!({
        "asset": { "version": "2.0", "generator": concat!("bake ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": glass_glb::used(geometry),
        "scene": 0,
        "scenes": [{ "nodes": [nodes.len() - 1] }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials(geometry),
        "textures": textures,
        "samplers": samplers,
        "images": images,
        "accessors": out.accessors,
        "bufferViews": out.views,
        "buffers": [{ "byteLength": out.binary.len() }],
    });
    out.finish(&without_empty(root))
}

/// An instance's faces, ascending by triangle.
fn faces<'a>(atlas: &'a Atlas, instance: &Instance) -> &'a [Face] {
    let below = |end: usize| atlas.faces.partition_point(|face| (face.triangle as usize) < end);
    &atlas.faces[below(instance.triangles.start)..below(instance.triangles.end)]
}

/// The places of an instance's faces on a page, which is its layout, in page coordinates.
fn own_layout(atlas: &Atlas, instance: &Instance, page: u32) -> Vec<(u32, [Vec2; 3])> {
    let top = Vec2::new(0.0, atlas.page_rows(page).start as f32);
    let size = Vec2::new(atlas.width as f32, atlas.page_height as f32);
    let faces = faces(atlas, instance).iter().filter(|face| atlas.page_of(face) == page);
    faces.map(|face| (face.triangle, face.corners.map(|corner| (corner - top) / size))).collect()
}

/// The triangles of an instance on a page, ascending, and those without texels if asked for.
fn part_on_page(atlas: &Atlas, instance: &Instance, page: u32, with_degenerate: bool) -> Vec<usize> {
    let mut faces = faces(atlas, instance).iter().peekable();
    let is_here = |triangle: &usize| match faces.next_if(|face| face.triangle as usize == *triangle) {
        Some(face) => atlas.page_of(face) == page,
        None => with_degenerate,
    };
    instance.triangles.clone().filter(is_here).collect()
}

/// Writes triangles of one instance as they stand, ascending. `layout` holds lightmap coordinates per triangle, ascending;
/// triangles it leaves out have (0, 0).
fn mesh(
    geometry: &Geometry,
    triangles: impl Iterator<Item = usize> + Clone,
    layout: Option<&[(u32, [Vec2; 3])]>,
    out: &mut Glb,
) -> Value {
    let mut vertices: Vec<(u32, Vec2)> = Vec::new();
    let mut known = BTreeMap::new();
    let mut indices: Vec<u32> = Vec::new();
    let mut faces = layout.unwrap_or_default().iter().peekable();
    for triangle in triangles.clone() {
        let face = faces.next_if(|face| face.0 as usize == triangle);
        for k in 0..3 {
            let vertex = geometry.triangles[triangle][k];
            let uv = face.map_or(Vec2::ZERO, |face| face.1[k]);
            // A vertex on a chart's edge stands once per chart.
            let key = (vertex, uv.x.to_bits(), uv.y.to_bits());
            let index = *known.entry(key).or_insert_with(|| {
                vertices.push((vertex, uv));
                vertices.len() as u32 - 1
            });
            indices.push(index);
        }
    }
    let positions: Vec<Vec3> = vertices.iter().map(|v| geometry.positions[v.0 as usize]).collect();
    let normals: Vec<Vec3> = vertices.iter().map(|v| geometry.normals[v.0 as usize]).collect();
    let uvs: Vec<Vec2> = vertices.iter().map(|v| geometry.uvs[v.0 as usize]).collect();
    let low = positions.iter().fold(Vec3::INFINITY, |m, p| m.min(*p));
    let high = positions.iter().fold(Vec3::NEG_INFINITY, |m, p| m.max(*p));
    let mut position = out.accessor(bytemuck::cast_slice(&positions), positions.len(), 5126, "VEC3", 34962);
    position["min"] = json!(low.to_array());
    position["max"] = json!(high.to_array());
    let mut attributes = serde_json::Map::new();
    attributes.insert("POSITION".into(), out.push(position));
    let normal = out.accessor(bytemuck::cast_slice(&normals), normals.len(), 5126, "VEC3", 34962);
    attributes.insert("NORMAL".into(), out.push(normal));
    let uv = out.accessor(bytemuck::cast_slice(&uvs), uvs.len(), 5126, "VEC2", 34962);
    attributes.insert("TEXCOORD_0".into(), out.push(uv));
    if layout.is_some() {
        let uvs: Vec<Vec2> = vertices.iter().map(|v| v.1).collect();
        let uv = out.accessor(bytemuck::cast_slice(&uvs), uvs.len(), 5126, "VEC2", 34962);
        attributes.insert("TEXCOORD_1".into(), out.push(uv));
    }
    let index = out.accessor(bytemuck::cast_slice(&indices), indices.len(), 5125, "SCALAR", 34963);
    let index = out.push(index);
    let material = triangles.clone().next().map(|first| geometry.material_of[first]);
    json!({ "primitives": [{ "attributes": attributes, "indices": index, "material": material }] })
}

fn materials(geometry: &Geometry) -> Vec<Value> {
    let materials = geometry.materials.iter().enumerate().map(|(index, m)| {
        let mut pbr = json!({
            "baseColorFactor": [m.albedo.x, m.albedo.y, m.albedo.z, m.alpha],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        });
        if let Some(texture) = m.texture {
            pbr["baseColorTexture"] = json!({ "index": texture });
        }
        let mut material = json!({ "pbrMetallicRoughness": pbr, "doubleSided": m.two_sided });
        if let Some(cutoff) = m.alpha_cutoff {
            material["alphaMode"] = json!("MASK");
            material["alphaCutoff"] = json!(cutoff);
        }
        if let Some(glass) = geometry.glass_of(index as u32) {
            glass_glb::add(&mut material, glass);
        }
        material
    });
    materials.collect()
}

fn textures(geometry: &Geometry, out: &mut Glb) -> Result<(Vec<Value>, Vec<Value>, Vec<Value>)> {
    let wrap = |w: Wrap| match w {
        Wrap::Repeat => 10497,
        Wrap::Clamp => 33071,
        Wrap::Mirror => 33648,
    };
    let (mut images, mut samplers, mut textures) = (Vec::new(), Vec::new(), Vec::new());
    for (i, texture) in geometry.textures.iter().enumerate() {
        let mut png = std::io::Cursor::new(Vec::new());
        let pixels: Vec<u8> = texture.rgba.iter().flatten().copied().collect();
        let buffer = image::RgbaImage::from_raw(texture.width, texture.height, pixels);
        let Some(buffer) = buffer else {
            return Err(Error::invalid(
                "scene.glb",
                format!("texture {i}: its texels are not width × height"),
            ));
        };
        buffer.write_to(&mut png, image::ImageFormat::Png).map_err(|e| Error::invalid("scene.glb", e))?;
        let view = out.view(&png.into_inner(), None);
        images.push(json!({ "bufferView": view, "mimeType": "image/png" }));
        samplers.push(json!({ "wrapS": wrap(texture.wrap_u), "wrapT": wrap(texture.wrap_v) }));
        textures.push(json!({ "source": i, "sampler": i }));
    }
    Ok((images, samplers, textures))
}

/// glTF forbids empty arrays.
fn without_empty(mut root: Value) -> Value {
    if let Some(object) = root.as_object_mut() {
        object.retain(|_, v| v.as_array().is_none_or(|a| !a.is_empty()));
    }
    root
}

#[derive(Default)]
struct Glb {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Glb {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], count: usize, component: u32, kind: &str, target: u32) -> Value {
        let view = self.view(bytes, Some(target));
        json!({ "bufferView": view, "componentType": component, "count": count, "type": kind })
    }

    fn push(&mut self, accessor: Value) -> Value {
        self.accessors.push(accessor);
        json!(self.accessors.len() - 1)
    }

    fn finish(self, root: &Value) -> Result<Vec<u8>> {
        let mut text = serde_json::to_vec(root).map_err(|e| Error::invalid("scene.glb", e))?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.binary.len();
        let mut glb = Vec::with_capacity(total);
        glb.extend_from_slice(b"glTF");
        for word in [2, total as u32, text.len() as u32] {
            glb.extend_from_slice(&word.to_le_bytes());
        }
        glb.extend_from_slice(b"JSON");
        glb.extend_from_slice(&text);
        glb.extend_from_slice(&(self.binary.len() as u32).to_le_bytes());
        glb.extend_from_slice(b"BIN\0");
        glb.extend_from_slice(&self.binary);
        Ok(glb)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Lightmap;
    use crate::{atlas, geometry, scene};
    use glam::{DVec3, Mat3, Mat4};

    /// A unit cube, and a plate that shares no vertex with it, in an OBJ of two materials.
    const THINGS: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
        v 2 0 0\nv 4 0 0\nv 4 0 -1\no cube\nusemtl a\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\n\
        f 2 3 7 6\no plate\nusemtl b\nf 9 10 11\n";

    fn load(text: &str) -> Geometry {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("things.obj"), THINGS).unwrap();
        std::fs::write(folder.path().join("scene.toml"), text).unwrap();
        let (scene, _) = scene::load(&folder.path().join("scene.toml")).unwrap();
        geometry::load(&scene).unwrap().0
    }

    #[test]
    fn nodes_lie_where_the_instances_do_in_space_and_on_the_page() {
        let geometry = load(
            "[[object]]\nfile = \"things.obj\"\nrotate = [10, 20, 30]\ntranslate = [1e5, 0, 0]\ninstances = [\n\
             { scale = [1, 2, 3] }, { scale = [1, 2, 3], rotate = [0, 40, 0], translate = [9, 0, 0] },\n\
             { scale = [-2, 4, 6], translate = [0, 0, 20] }, { scale = [0.5, 1, -1.5], rotate = [5, 6, 7], translate = [0, 9, 0] },\n\
             { scale = [3, 2, 1], translate = [-9, 0, 0] } ]\n\
             [[object.part]]\nname = \"plate\"\nlightmap = false\n",
        );
        let size = scene::LightmapSize::Fixed { width: 256, height: 200 };
        let atlas =
            atlas::build(&geometry, &Lightmap { size, pages: 1, padding: 2, ..Lightmap::default() }).unwrap();
        let glb = gltf::Gltf::from_slice(&to_glb(&geometry, &atlas).unwrap()).unwrap();
        let blob = glb.blob.as_deref().unwrap();
        // The cubes and the plates: one shape four times, one stretched otherwise.
        assert_eq!((geometry.instances.len(), atlas.layouts.len(), glb.meshes().count()), (10, 1, 4));
        let root = glb.default_scene().unwrap().nodes().next().unwrap();
        assert_eq!((root.name(), root.children().count()), (Some("scene"), 10));
        let translation = DVec3::from(root.transform().decomposed().0.map(f64::from));
        assert!((translation - geometry.origin).length() < 1e-2);
        let mut mirrored = 0;
        for ((node, instance), placements) in root.children().zip(&geometry.instances).zip(&atlas.placements)
        {
            assert_eq!(node.name(), Some(&instance.name[..]));
            let matrix = Mat4::from_cols_array_2d(&node.transform().matrix());
            let primitive = node.mesh().unwrap().primitives().next().unwrap();
            let reader = primitive.reader(|_| Some(blob));
            let positions: Vec<Vec3> = reader.read_positions().unwrap().map(Vec3::from).collect();
            let normals: Vec<Vec3> = reader.read_normals().unwrap().map(Vec3::from).collect();
            let indices: Vec<usize> = reader.read_indices().unwrap().into_u32().map(|i| i as usize).collect();
            assert_eq!(indices.len(), 3 * instance.triangles.len());
            let place = node.extras().as_ref().map(|extras| {
                let extras: Value = serde_json::from_str(extras.get()).unwrap();
                assert_eq!(extras["lightmapPage"], 0);
                ["lightmapScale", "lightmapOffset"]
                    .map(|key| Vec2::from([0, 1].map(|i| extras[key][i].as_f64().unwrap() as f32)))
            });
            let uvs: Option<Vec<Vec2>> =
                reader.read_tex_coords(1).map(|uvs| uvs.into_f32().map(Vec2::from).collect());
            assert_eq!((place.is_some(), uvs.is_some()), (instance.lightmap, instance.lightmap));
            assert_eq!(placements.len(), usize::from(instance.lightmap));
            // A negative determinant turns the winding round (glTF 2.0, 3.7.4).
            let flip = matrix.determinant() < 0.0;
            mirrored += usize::from(flip);
            let normal_matrix = Mat3::from_mat4(matrix).inverse().transpose();
            for (triangle, corners) in instance.triangles.clone().zip(indices.chunks_exact(3)) {
                let order = if flip { [0, 2, 1] } else { [0, 1, 2] };
                let face = atlas.faces.iter().find(|f| f.triangle as usize == triangle);
                for k in 0..3 {
                    let (vertex, wanted) = (corners[order[k]], geometry.triangles[triangle][k] as usize);
                    let position = matrix.transform_point3(positions[vertex]);
                    assert!(position.distance(geometry.positions[wanted]) < 2e-5, "{}", instance.name);
                    let normal = (normal_matrix * normals[vertex]).normalize();
                    assert!(normal.distance(geometry.normals[wanted]) < 1e-5, "{}", instance.name);
                    if let (Some([scale, offset]), Some(uvs)) = (place, &uvs) {
                        let texel = (scale * uvs[vertex] + offset) * Vec2::new(256.0, 200.0);
                        assert!(texel.distance(face.unwrap().corners[k]) < 1e-3, "{}", instance.name);
                    }
                }
            }
        }
        // Two instances of both meshes.
        assert_eq!(mirrored, 4);
    }

    #[test]
    fn a_mesh_on_two_pages_is_two_nodes() {
        let geometry = load(
            "[[object]]\nfile = \"things.obj\"\n[[object.part]]\nname = \"plate\"\ndensity = 0.5\n\
             [[object]]\nfile = \"things.obj\"\ntranslate = [9, 0, 0]\nlightmap = false\n",
        );
        let size = scene::LightmapSize::Fixed { width: 60, height: 50 };
        let atlas =
            atlas::build(&geometry, &Lightmap { size, pages: 2, padding: 2, ..Lightmap::default() }).unwrap();
        assert_eq!((atlas.pages, atlas.page_height, atlas.stride, atlas.height), (2, 50, 128, 178));
        let pages: Vec<Vec<u32>> =
            atlas.placements.iter().map(|p| p.iter().map(|p| p.page).collect()).collect();
        assert_eq!(pages[0], [0, 1]);
        let glb = gltf::Gltf::from_slice(&to_glb(&geometry, &atlas).unwrap()).unwrap();
        let root = glb.default_scene().unwrap().nodes().next().unwrap();
        let mut nodes = root.children();
        let mut seen = Vec::new();
        for (instance, placements) in geometry.instances.iter().zip(&atlas.placements) {
            for placement in placements {
                let node = nodes.next().unwrap();
                assert_eq!(node.name(), Some(&instance.name[..]));
                let extras: Value = serde_json::from_str(node.extras().as_ref().unwrap().get()).unwrap();
                assert_eq!(extras["lightmapPage"], placement.page);
                let primitive = node.mesh().unwrap().primitives().next().unwrap();
                let reader = primitive.reader(|_| glb.blob.as_deref());
                let positions: Vec<Vec3> = reader.read_positions().unwrap().map(Vec3::from).collect();
                let uvs: Vec<Vec2> = reader.read_tex_coords(1).unwrap().into_f32().map(Vec2::from).collect();
                let indices: Vec<usize> =
                    reader.read_indices().unwrap().into_u32().map(|i| i as usize).collect();
                // Every triangle is one of the instance's on this page, and lies there where the atlas says.
                for corners in indices.chunks_exact(3) {
                    let is_it = |face: &&Face| {
                        let wanted = geometry.triangles[face.triangle as usize];
                        (0..3).all(|k| positions[corners[k]] == geometry.positions[wanted[k] as usize])
                    };
                    let face = atlas.faces.iter().find(is_it).unwrap();
                    assert!(instance.triangles.contains(&(face.triangle as usize)));
                    assert_eq!(atlas.page_of(face), placement.page);
                    let top = Vec2::new(0.0, atlas.page_rows(placement.page).start as f32);
                    for k in 0..3 {
                        let texel = uvs[corners[k]] * Vec2::new(60.0, 50.0) + top;
                        assert!(texel.distance(face.corners[k]) < 1e-3, "{texel} {:?}", face.corners[k]);
                    }
                    seen.push(face.triangle);
                }
            }
        }
        seen.sort_unstable();
        assert!(seen.iter().copied().eq(atlas.faces.iter().map(|face| face.triangle)), "{seen:?}");
    }
}
