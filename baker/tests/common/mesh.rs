//! OBJ and glTF files written by hand.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DVec3, dvec3};
use std::fmt::Write;

/// An OBJ being written.
#[derive(Clone, Default)]
pub struct Obj {
    text: String,
    vertices: usize,
}

impl Obj {
    /// Begins a mesh with a name.
    pub fn mesh(mut self, name: &str) -> Self {
        writeln!(self.text, "o {name}").unwrap();
        self
    }

    /// The material of what follows.
    pub fn material(mut self, name: &str) -> Self {
        writeln!(self.text, "usemtl {name}").unwrap();
        self
    }

    /// Names a material library.
    pub fn library(mut self, file: &str) -> Self {
        writeln!(self.text, "mtllib {file}").unwrap();
        self
    }

    /// A polygon whose front sees its corners counter-clockwise.
    pub fn polygon(mut self, corners: &[DVec3]) -> Self {
        for p in corners {
            writeln!(self.text, "v {:?} {:?} {:?}", p.x, p.y, p.z).unwrap();
        }
        let first = self.vertices + 1;
        self.vertices += corners.len();
        let list: Vec<String> = (first..=self.vertices).map(|v| v.to_string()).collect();
        writeln!(self.text, "f {}", list.join(" ")).unwrap();
        self
    }

    /// A polygon with texture coordinates.
    pub fn textured(mut self, corners: &[DVec3], uvs: &[[f64; 2]]) -> Self {
        for (p, t) in corners.iter().zip(uvs) {
            writeln!(self.text, "v {:?} {:?} {:?}\nvt {:?} {:?}", p.x, p.y, p.z, t[0], t[1]).unwrap();
        }
        // Negative numbers count back from here.
        let list: Vec<String> = (1..=corners.len()).rev().map(|i| format!("-{i}/-{i}")).collect();
        self.vertices += corners.len();
        writeln!(self.text, "f {}", list.join(" ")).unwrap();
        self
    }

    /// A parallelogram whose front is on the side of `u × v`.
    pub fn quad(self, corner: DVec3, u: DVec3, v: DVec3) -> Self {
        self.polygon(&[corner, corner + u, corner + u + v, corner + v])
    }

    /// A level square that looks up, around `centre`.
    pub fn floor(self, centre: DVec3, side: f64) -> Self {
        let half = side / 2.0;
        self.quad(centre + dvec3(-half, 0.0, half), DVec3::X * side, DVec3::NEG_Z * side)
    }

    /// A level square that looks down, around `centre`.
    pub fn ceiling(self, centre: DVec3, side: f64) -> Self {
        let half = side / 2.0;
        self.quad(centre + dvec3(-half, 0.0, -half), DVec3::X * side, DVec3::Z * side)
    }

    /// Five walls and a ceiling or all six sides of a box, seen from inside or outside. `sides` picks from
    /// −x, +x, −y, +y, −z, +z.
    pub fn sides(mut self, low: DVec3, high: DVec3, inside: bool, sides: &[usize]) -> Self {
        let size = high - low;
        for &side in sides {
            let (axis, upper) = (side / 2, side % 2 == 1);
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let edge = |a: usize| DVec3::AXES[a] * size[a];
            let corner = if upper { low + edge(axis) } else { low };
            // u × v is +axis; the outside of the upper side.
            let outwards = upper != inside;
            let (u, v) = if outwards { (edge(u), edge(v)) } else { (edge(v), edge(u)) };
            self = self.quad(corner, u, v);
        }
        self
    }

    /// A closed box seen from inside.
    pub fn room(self, low: DVec3, high: DVec3) -> Self {
        self.sides(low, high, true, &[0, 1, 2, 3, 4, 5])
    }

    /// A closed box seen from outside.
    pub fn block(self, low: DVec3, high: DVec3) -> Self {
        self.sides(low, high, false, &[0, 1, 2, 3, 4, 5])
    }

    /// The file.
    pub fn text(self) -> String {
        self.text
    }
}

/// A glTF with one mesh; `material` is the JSON object of its material, `TEXCOORD_1` where `lightmap_uvs` are
/// given.
pub fn gltf(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    lightmap_uvs: Option<&[[f32; 2]]>,
    material: &str,
) -> String {
    let mut bytes: Vec<u8> = Vec::new();
    positions.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    let indices_at = bytes.len();
    triangles.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    let uvs_at = bytes.len();
    lightmap_uvs.unwrap_or(&[]).iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    let (mut views, mut accessors, mut attribute) = (String::new(), String::new(), "");
    let low = [0, 1, 2].map(|a| positions.iter().map(|p| p[a]).fold(f32::INFINITY, f32::min));
    let high = [0, 1, 2].map(|a| positions.iter().map(|p| p[a]).fold(f32::NEG_INFINITY, f32::max));
    write!(
        views,
        r#"{{"buffer":0,"byteLength":{indices_at}}},{{"buffer":0,"byteOffset":{indices_at},"byteLength":{}}}"#,
        uvs_at - indices_at
    )
    .unwrap();
    write!(
        accessors,
        r#"{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3","min":{low:?},"max":{high:?}}},{{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}"#,
        positions.len(),
        triangles.len() * 3
    )
    .unwrap();
    if let Some(uvs) = lightmap_uvs {
        write!(views, r#",{{"buffer":0,"byteOffset":{uvs_at},"byteLength":{}}}"#, uvs.len() * 8).unwrap();
        write!(accessors, r#",{{"bufferView":2,"componentType":5126,"count":{},"type":"VEC2"}}"#, uvs.len())
            .unwrap();
        attribute = r#","TEXCOORD_1":2"#;
    }
    let data = STANDARD.encode(&bytes);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"name":"node"}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0{attribute}}},"indices":1,"material":0}}]}}],
"materials":[{material}],"bufferViews":[{views}],"accessors":[{accessors}],
"buffers":[{{"byteLength":{},"uri":"data:application/octet-stream;base64,{data}"}}]}}"#,
        bytes.len()
    )
}

/// A PNG of `width` texels in one row.
pub fn png(texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbaImage::from_raw(texels.len() as u32, 1, texels.concat()).expect("a row");
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).expect("a PNG");
    bytes
}
