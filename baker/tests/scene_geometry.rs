//! Geometry files: what stands where after loading, and what broken ones say.

use baker::geometry::{self, Emission, Geometry};
use baker::scene;
use glam::{DVec3, Vec2, Vec3};
use std::fs;
use std::path::Path;

/// A unit cube around (0.5, 0.5, 0.5), counter-clockwise outside, one quad per side.
const CUBE: &str = "\
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6\n";

fn load(folder: &Path, text: &str) -> dataset::Result<(Geometry, Vec<String>)> {
    fs::write(folder.join("scene.toml"), text).unwrap();
    let (scene, _) = scene::load(&folder.join("scene.toml"))?;
    geometry::load(&scene)
}

fn message(folder: &Path, text: &str) -> String {
    load(folder, text).map(|_| ()).expect_err("it loaded").to_string()
}

/// Signed volume: positive when the faces look outwards.
fn volume(g: &Geometry, triangles: std::ops::Range<usize>) -> f32 {
    triangles
        .map(|t| {
            let [a, b, c] = g.corners(t);
            a.dot(b.cross(c)) / 6.0
        })
        .sum()
}

#[test]
fn mirrored_and_turned_instances_keep_their_outside_outside() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cube.obj"), CUBE).unwrap();
    // With smooth normals, from the centre: an OBJ of eight corners.
    let normals: String = (0..8)
        .map(|i| {
            format!("vn {} {} {}\n", [-1, 1, 1, -1][i % 4], [-1, -1, 1, 1][i % 4], if i < 4 { -1 } else { 1 })
        })
        .collect();
    let smooth = CUBE.lines().map(|l| match l.strip_prefix("f ") {
        Some(f) => format!("f {}\n", f.split(' ').map(|v| format!("{v}//{v}")).collect::<Vec<_>>().join(" ")),
        None => format!("{l}\n"),
    });
    fs::write(folder.path().join("smooth.obj"), normals + &smooth.collect::<String>()).unwrap();
    for file in ["cube.obj", "smooth.obj"] {
        let (g, _) = load(
            folder.path(),
            &format!(
                "[[object]]\nfile = \"{file}\"\nrotate = [10, 20, 30]\nscale = [1, 2, 3]\ninstances = [{{}}, \
                 {{ scale = [-1, 1, 1], translate = [9, 0, 0] }}, {{ scale = [-1, -2, -1], rotate = [0, 40, 0] }}, \
                 {{ scale = -0.5, translate = [0, 0, 7] }}]\n"
            ),
        )
        .unwrap();
        assert_eq!(g.instances.len(), 4);
        assert_eq!(g.triangles.len(), 48);
        for (instance, expected) in g.instances.iter().zip([6.0, 6.0, 12.0, 0.75]) {
            let v = volume(&g, instance.triangles.clone());
            assert!((v - expected).abs() < 1e-4, "{file} {}: volume {v}", instance.name);
            let corners = g.positions[instance.vertices.clone()].iter();
            let centre = corners.clone().sum::<Vec3>() / corners.len() as f32;
            for t in instance.triangles.clone() {
                for v in g.triangles[t] {
                    assert!(instance.vertices.contains(&(v as usize)));
                    let (n, p) = (g.normals[v as usize], g.positions[v as usize]);
                    assert!((n.length() - 1.0).abs() < 1e-5);
                    assert!(n.dot(p - centre) > 0.0 && n.dot(g.normal(t)) > 0.0, "{file} {}", instance.name);
                }
            }
        }
    }
}

#[test]
fn instances_of_one_mesh_with_one_look_share_its_number() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cube.obj"), CUBE).unwrap();
    fs::write(folder.path().join("other.obj"), CUBE).unwrap();
    let text = "[[object]]\nfile = \"cube.obj\"\ninstances = [{}, { scale = [1, -2, 3], translate = [9, 0, 0] }]\n\
                [[object]]\nfile = \"other.obj\"\ntranslate = [0, 0, 9]\n\
                [[object]]\nfile = \"cube.obj\"\nalbedo = 0.25\n\
                [[object]]\nfile = \"cube.obj\"\nlightmap = false\n\
                [[object]]\nfile = \"cube.obj\"\ndensity = 2\ntranslate = [0, 9, 0]\n";
    let (g, _) = load(folder.path(), text).unwrap();
    assert_eq!(g.instances.iter().map(|i| i.mesh).collect::<Vec<_>>(), [0, 0, 1, 2, 3, 0]);
    // What places one of them places its vertices.
    for instance in &g.instances {
        let from_first = instance.world_from_mesh * g.instances[0].world_from_mesh.inverse();
        for (a, b) in g.instances[0].triangles.clone().zip(instance.triangles.clone()) {
            let moved = g.corners(a).map(|p| from_first.transform_point3(g.origin + p.as_dvec3()) - g.origin);
            let [p, q, r] = g.corners(b).map(Vec3::as_dvec3);
            let placed = if from_first.matrix3.determinant() < 0.0 { [p, r, q] } else { [p, q, r] };
            assert!((0..3).all(|k| moved[k].distance(placed[k]) < 1e-5), "{}", instance.name);
        }
    }
}

#[test]
fn normals_go_by_the_inverse_transpose() {
    let folder = tempfile::tempdir().unwrap();
    // A plane of slope 1 whose file says so; stretched threefold in x its slope is a third.
    let obj = "v 0 0 0\nv 1 1 0\nv 0 0 -1\nvn -1 1 0\nf 1//1 2//1 3//1\n";
    fs::write(folder.path().join("slope.obj"), obj).unwrap();
    let (g, _) = load(folder.path(), "[[object]]\nfile = \"slope.obj\"\nscale = [3, 1, 1]\n").unwrap();
    let expected = Vec3::new(-1.0, 3.0, 0.0).normalize();
    assert!(
        g.normals.iter().all(|n| (n - expected).length() < 1e-6) && (g.normal(0) - expected).length() < 1e-6
    );
}

#[test]
fn materials_that_no_library_defines_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let faces = "usemtl pait\nf 1 2 3\nusemtl oka\nf 1 3 2\n";
    fs::write(folder.path().join("a.obj"), format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}")).unwrap();
    let (_, warnings) = load(folder.path(), "[[object]]\nfile = \"a.obj\"\n").unwrap();
    let told = "albedo 0.5 for want of a defined material (oka, pait): 2 meshes";
    assert!(warnings.iter().any(|warning| warning.ends_with(told)), "{warnings:?}");
}

#[test]
fn far_from_zero_millimetres_stay() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cube.obj"), CUBE).unwrap();
    // Offset in the scene file, and in the OBJ itself.
    let far = "v 1000000.001 0 0\nv 1000000.004 0 0\nv 1000000.001 0.002 0\nf 1 2 3\n";
    fs::write(folder.path().join("far.obj"), far).unwrap();
    let text = "[[object]]\nfile = \"cube.obj\"\ntranslate = [1e6, 0.25, -2e6]\nscale = 0.001\n";
    let (g, _) = load(folder.path(), text).unwrap();
    assert!((g.origin - DVec3::new(1e6 + 5e-4, 0.2505, -2e6 + 5e-4)).length() < 1e-9);
    assert!((volume(&g, 0..12) - 1e-9).abs() < 1e-14);
    let (g, _) = load(folder.path(), "[[object]]\nfile = \"far.obj\"\n").unwrap();
    assert!((g.area(0) - 3e-6).abs() < 1e-11, "{}", g.area(0));
}

#[test]
fn parts_override_what_their_names_fit() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "mtllib lost.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\no trunk\nusemtl bark\nf 1 2 3\no leaf.001\nusemtl green\nf 1 2 3\n\
               o leaf.002\nusemtl autumn\nf 1 2 3\n";
    fs::write(folder.path().join("tree.obj"), obj).unwrap();
    let text = "[[object]]\nfile = \"tree.obj\"\nalbedo = 0.4\ndensity = 2\n\
                [[object.part]]\nname = \"leaf*\"\nalbedo = [0.1, 0.3, 0.1]\ntwo_sided = true\nlightmap = false\n\
                [[object.part]]\nname = \"autumn\"\nalbedo = [0.5, 0.2, 0.1]\nemission = [1, 2, 3]\ngroup = \"glow\"\n\
                [[group]]\nname = \"other\"\n[[group]]\nname = \"glow\"\n";
    let (g, warnings) = load(folder.path(), text).unwrap();
    assert!(warnings.iter().any(|w| w.contains("lost.mtl")), "{warnings:?}");
    let albedo: Vec<Vec3> = (0..3).map(|t| g.albedo_at(t, Vec3::splat(1.0 / 3.0))).collect();
    assert_eq!(albedo, [Vec3::splat(0.4), Vec3::new(0.1, 0.3, 0.1), Vec3::new(0.5, 0.2, 0.1)]);
    let materials: Vec<_> = g.material_of.iter().map(|&m| &g.materials[m as usize]).collect();
    assert_eq!(materials.iter().map(|m| m.two_sided).collect::<Vec<_>>(), [false, true, true]);
    assert_eq!(
        materials[2].emission,
        Some(Emission { radiance: Vec3::new(1.0, 2.0, 3.0), group: 1, map: None })
    );
    assert!(materials[0].emission.is_none() && materials[1].emission.is_none());
    assert_eq!(g.instances.iter().map(|i| i.lightmap).collect::<Vec<_>>(), [true, false, false]);
    assert!(g.instances.iter().all(|i| i.density == 2.0));
    let error =
        message(folder.path(), "[[object]]\nfile = \"tree.obj\"\n[[object.part]]\nname = \"leav*\"\n");
    assert!(error.contains("scene.toml:4: part name = \"leav*\": no node, mesh or material"), "{error}");
    assert!(error.ends_with("similar names: mesh \"leaf.001\", mesh \"leaf.002\""), "{error}");
}

/// A PNG of 2 × 1 texels.
fn png(texels: [[u8; 4]; 2]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_raw(2, 1, texels.concat())
        .unwrap()
        .write_to(&mut bytes, image::ImageFormat::Png)
        .unwrap();
    bytes.into_inner()
}

#[test]
fn obj_materials_have_factor_texture_and_cut_out() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("maps")).unwrap();
    let texels = [[255, 0, 0, 255], [0, 255, 0, 0]];
    fs::write(folder.path().join("maps/leaf 1.png"), png(texels)).unwrap();
    let mtl = "newmtl leaf\nKd 0.5 0.5 0.5\nmap_Kd -clamp on maps\\leaf 1.png\nmap_d maps\\leaf 1.png\nnewmtl red\nKd 0.8 0.1 0.1\n";
    fs::write(folder.path().join("leaf.mtl"), mtl).unwrap();
    let obj = "mtllib leaf.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0\nvt 0.75 0.5\nvt 0.25 1\nusemtl leaf\nf 1/1 2/2 3/3\n\
               usemtl red\nf 1/1 3/3 2/2\n";
    fs::write(folder.path().join("leaf.obj"), obj).unwrap();
    let (g, warnings) = load(folder.path(), "[[object]]\nfile = \"leaf.obj\"\nvt = \"lightmap\"\n").unwrap();
    assert_eq!(warnings, Vec::<String>::new());
    // v is turned to run down.
    assert_eq!(g.uvs[0], Vec2::new(0.25, 1.0));
    assert_eq!(g.lightmap_uvs[1], Vec2::new(0.75, 0.5));
    assert!(g.instances.iter().all(|i| i.has_lightmap_uvs));
    assert_eq!(g.albedo_at(0, Vec3::X), Vec3::new(0.5, 0.0, 0.0));
    assert_eq!((g.alpha_at(0, Vec3::X), g.alpha_at(0, Vec3::Y)), (1.0, 0.0));
    assert!(g.is_solid_at(0, Vec3::X) && !g.is_solid_at(0, Vec3::Y));
    assert_eq!(g.albedo_at(1, Vec3::X), Vec3::new(0.8, 0.1, 0.1));
    assert!(g.is_solid_at(1, Vec3::Y));
    // An albedo override keeps the cut-out.
    let (g, _) = load(folder.path(), "[[object]]\nfile = \"leaf.obj\"\nalbedo = 0.25\n").unwrap();
    assert_eq!(g.albedo_at(0, Vec3::Y), Vec3::splat(0.25));
    assert!(g.is_solid_at(0, Vec3::X) && !g.is_solid_at(0, Vec3::Y));
}

#[test]
fn broken_objs_say_where() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[[object]]\nfile = \"broken.obj\"\n";
    for (obj, expected) in [
        (
            "o roof\nv 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n",
            "broken.obj: roof: v 1 NaN 0: expected finite numbers",
        ),
        ("v 0 0 0\nv 1 x 0\n", "broken.obj:2: `v 1 x 0`: expected three numbers after `v`"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n", "broken.obj:4: a face names v 9, but the file has 3"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 -9\n", "broken.obj:4: `f 1 2 -9`: expected v, v/vt"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n", "broken.obj:4: `f 0 1 2`: expected v, v/vt"),
        (
            "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nf 1/1 2/2 3/1\n",
            "broken.obj:5: a face names vt 2, but the file has 1",
        ),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nvt nan 0\nf 1/1 2/1 3/1\n", "vertex 0: texture coordinate"),
        ("v 0 0 0\n", "broken.obj: expected at least one triangle"),
        ("", "broken.obj: expected at least one triangle"),
        ("mtllib broken.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl a\nf 1 2 3\n", "broken.mtl:2: "),
        (
            "mtllib white.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl a\nf 1 2 3\n",
            "white.mtl:2: Kd = [1.5, 0.0, 0.0]",
        ),
        ("v 0 0 0\nv 1e300 0 0\nv 1 1 0\nf 1 2 3\n", "vertex 1: position"),
    ] {
        fs::write(folder.path().join("broken.obj"), obj).unwrap();
        fs::write(folder.path().join("broken.mtl"), "newmtl a\nKd 1 x 1\n").unwrap();
        fs::write(folder.path().join("white.mtl"), "newmtl a\nKd 1.5 0 0\n").unwrap();
        let error = message(folder.path(), text);
        assert!(error.contains(expected), "expected: {expected}\n     got: {error}");
    }
}

#[test]
fn copies_of_triangles_and_of_placed_meshes_are_told_and_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let corners = "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\n";
    let faces = "f 1 2 3 4\n".repeat(100) + "f 3 4 1 2\nf 4 3 2 1\n";
    fs::write(folder.path().join("a.obj"), corners.to_owned() + &faces).unwrap();
    let object = "[[object]]\nfile = \"a.obj\"\n";
    let (g, warnings) = load(folder.path(), object).unwrap();
    // Eight quads seen from above and one from below. (The turned quad may be cut along the other diagonal.)
    assert!((18..=20).contains(&g.triangles.len()), "{}", g.triangles.len());
    let told =
        |warnings: &[String], what: &str| assert!(warnings.iter().any(|w| w.contains(what)), "{warnings:?}");
    told(&warnings, "triangles): copies of other triangles of the mesh");
    // The same mesh ten times in one place, and once elsewhere.
    let instances = format!("instances = [{}{{ translate = [0, 0, 1e-3] }}]\n", "{}, ".repeat(10));
    let (g, warnings) = load(folder.path(), &(object.to_owned() + &instances)).unwrap();
    assert_eq!(g.instances.len(), 9);
    told(&warnings, "2 placed meshes (a.obj");
}

#[test]
fn faces_that_cross_themselves_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let corners: String = (0..9).map(|i| format!("v {} 0 {}\n", i % 3, i / 3)).collect();
    let indices: String = (0..5000u64).map(|i| format!(" {}", 1 + i * i * 7919 % 1009 % 9)).collect();
    fs::write(folder.path().join("a.obj"), format!("{corners}f 1 4 5 2\nf{indices}\n")).unwrap();
    let (g, warnings) = load(folder.path(), "[[object]]\nfile = \"a.obj\"\n").unwrap();
    assert!(warnings.iter().any(|w| w.contains("(1 face): faces that cross themselves")), "{warnings:?}");
    // Nine places have few triangles, each seen from two sides and eight times.
    assert!(g.triangles.len() <= 8 * 2 * 84, "{}", g.triangles.len());
}

#[test]
fn thousands_of_faces_about_one_edge_get_texels() {
    use baker::atlas;
    use baker::scene::Lightmap;
    let folder = tempfile::tempdir().unwrap();
    let pages: String =
        (0..3000).map(|i| format!("v {} 0.5 {}\n", f64::from(i).cos(), f64::from(i).sin())).collect();
    let faces: String = (0..3000).map(|i| format!("f 1 2 {}\n", i + 3)).collect();
    fs::write(folder.path().join("a.obj"), format!("v 0 0 0\nv 0 1 0\n{pages}{faces}")).unwrap();
    let (g, _) = load(folder.path(), "[[object]]\nfile = \"a.obj\"\n").unwrap();
    let atlas = atlas::build(&g, &Lightmap::default()).unwrap();
    assert_eq!(atlas.faces.len(), 3000);
}
