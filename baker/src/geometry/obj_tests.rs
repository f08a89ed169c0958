//! Tests of OBJ and MTL files: what exporters write, and what is wrong.

use super::*;
use crate::geometry::texture::linear_from_srgb;
use glam::{Vec2, Vec3};

#[test]
fn a_library_is_read_for_what_the_baker_uses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    std::fs::write(&path, text).unwrap();
    let albedo = |library: &[u8]| {
        std::fs::write(folder.path().join("a.mtl"), library).unwrap();
        let model = load(&path, false, &mut TextureStore::default(), &mut Notes::default())?;
        Ok::<_, Error>(model.materials[0].albedo)
    };
    assert_eq!(albedo(b"newmtl m\n Kd 0.1 0.2 0.3\n").unwrap(), Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(albedo(b"newmtl m\nKd 0.25").unwrap(), Vec3::splat(0.25));
    // A statement that is wrong, another of two numbers, and a comment that is no UTF-8.
    assert_eq!(albedo(b"newmtl m\nNs bright\nKe 2 1\n# \xe9\nKd 0.5 0.5 0.5\n").unwrap(), Vec3::splat(0.5));
    for wrong in ["Kd 0.1 0.2", "Kd", "Kd red", "Kd 0.1 0.2 z"] {
        let error = albedo(format!("newmtl m\n{wrong}\nd 1\n").as_bytes()).unwrap_err().to_string();
        let told = format!("a.mtl:2: `{wrong}`: expected one number or three");
        assert!(error.contains(&told), "{error}");
    }
}

#[test]
fn faces_that_name_a_vertex_twice_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 2 2 3\nf 3 1 1\n").unwrap();
    let mut notes = Notes::default();
    let model = load(&path, false, &mut TextureStore::default(), &mut notes).unwrap();
    let warnings: Vec<String> = notes.lines().collect();
    assert_eq!(model.meshes[0].triangles.len(), 1);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(
        warning.contains("a.obj") && warning.contains("(2 triangles): faces with two corners"),
        "{warning}"
    );
}

#[test]
fn faces_too_short_to_have_an_area_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n f 1 2\nl 1 2\nf 3\n").unwrap();
    let mut notes = Notes::default();
    let model = load(&path, false, &mut TextureStore::default(), &mut notes).unwrap();
    let warnings: Vec<String> = notes.lines().collect();
    assert_eq!(model.meshes.len(), 1);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.contains("a.obj: line 5 ") && warning.contains("and 1 more"), "{warning}");
}

/// What an OBJ holds that lies beside these files, and the warnings.
fn read(obj: &[u8], files: &[(&str, &[u8])]) -> Result<(Model, TextureStore, Vec<String>)> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files.iter().chain(&[("a.obj", obj)]) {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let (mut textures, mut notes) = (TextureStore::default(), Notes::default());
    let model = load(&folder.path().join("a.obj"), false, &mut textures, &mut notes)?;
    Ok((model, textures, notes.lines().collect()))
}

/// A triangle of the material `m`.
const TRIANGLE: &str = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.55 0.5\nvt 0.95 0.5\nvt 0.55 0.25\nf 1/1 2/2 3/3\n";
const GREY: &[u8] = b"newmtl m\nKd 0.25 0.25 0.25\n";

/// A texture of a white and a black texel, side by side.
fn half_white() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let texels = image::GrayImage::from_raw(2, 1, vec![255, 0]).unwrap();
    texels.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn what_exporters_write_is_read() {
    let utf16: Vec<u8> =
        "\u{feff}".encode_utf16().chain(TRIANGLE.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let with = |from: &str, to: &str| TRIANGLE.replace(from, to).into_bytes();
    let two = [&b"newmtl z\nKd 1 1 1\n"[..], GREY];
    for (what, obj, libraries) in [
        ("as it is", with("", ""), vec![("a.mtl", GREY)]),
        ("a byte order mark", [b"\xef\xbb\xbf", TRIANGLE.as_bytes()].concat(), vec![("a.mtl", GREY)]),
        ("one in the library", with("", ""), vec![("a.mtl", b"\xef\xbb\xbfnewmtl m\nKd 0.25\n" as &[u8])]),
        ("UTF-16", utf16, vec![("a.mtl", GREY)]),
        (
            "Latin-1",
            [b"# f\xfcr\ng Stra\xdfe\n", TRIANGLE.as_bytes()].concat(),
            vec![("a.mtl", b"# M\xfcller\nnewmtl m\nKd 0.25\n")],
        ),
        ("continued lines", with("2/2 ", "\\\n 2/2\\\r\n "), vec![("a.mtl", GREY)]),
        ("CR", with("\n", "\r"), vec![("a.mtl", b"newmtl m\rKd 0.25\r")]),
        (
            "comments",
            with("\n", " # a\n"),
            vec![("a.mtl", b"newmtl m # b\nKd 0.25 0.25 0.25 # c\nd 1 # e\n")],
        ),
        ("two libraries", with("a.mtl", "b c.mtl a.mtl"), vec![("b c.mtl", two[0]), ("a.mtl", two[1])]),
        (
            "two in one folder",
            with("a.mtl", "a.mtl  ./b c.mtl"),
            vec![("b c.mtl", two[0]), ("a.mtl", two[1])],
        ),
        ("escaped blanks", with("a.mtl", "b\\ c.mtl a.mtl"), vec![("b c.mtl", two[0]), ("a.mtl", two[1])]),
        ("no name", with("usemtl m", "usemtl"), vec![("a.mtl", b"newmtl \nKd 0.25\n")]),
        ("indices of normals that are left out", with(" 2/2", " 2/2/7"), vec![("a.mtl", GREY)]),
        ("quotes", with("a.mtl", "\"b c.mtl\" a.mtl"), vec![("b c.mtl", two[0]), ("a.mtl", two[1])]),
        ("a name with blanks", with("a.mtl", "a b.mtl c.mtl"), vec![("a b.mtl c.mtl", GREY)]),
        ("a path of elsewhere", with("a.mtl", "C:\\Users\\me\\a.mtl"), vec![("a.mtl", GREY)]),
        ("another case", with("", ""), vec![("a.mtl", b"NEWMTL m\nkd 0.25\n")]),
        ("one name for two", with("", ""), vec![("a.mtl", b"newmtl m\nKd 1\nnewmtl m\nKd 0.25\n")]),
    ] {
        let (model, _, warnings) = read(&obj, &libraries).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(warnings, Vec::<String>::new(), "{what}");
        let [mesh] = &model.meshes[..] else { panic!("{what}: {} meshes", model.meshes.len()) };
        assert!(mesh.triangles.len() == 1 && mesh.uvs.len() == 3, "{what}");
        assert_eq!(model.materials[mesh.material].albedo, Vec3::splat(0.25), "{what}");
    }
    let (model, ..) = read(&[b"g Stra\xdfe\n", TRIANGLE.as_bytes()].concat(), &[("a.mtl", GREY)]).unwrap();
    assert_eq!(model.meshes[0].name, "Straße");
}

#[test]
fn a_texture_lies_by_its_offset_and_scale() {
    // Albedo at u = 0.55 … 0.95, right of the middle, where the texture is black.
    for (options, albedo) in [
        ("", 0.0),
        ("-s 0.5 1 1", 0.8),
        ("-s 0.5", 0.8),
        ("-o 0.5 0 0", 0.8),
        ("-o 0.2 -s 0.5 1 1 -o 0.5 0 0 ", 0.0),
        ("-o -0.5", 0.8),
        ("-t 0 0 0 -mm 0 1 -blendu on -cc off -boost 2 -texres 512 -bm 1", 0.0),
        ("-S .5 1 1 -clamp on", 0.8),
    ] {
        let library = format!("newmtl m\nKd .8 .8 .8\nmap_Kd {options} t.png # halves\n");
        let files = [("a.mtl", library.as_bytes()), ("t.png", &half_white())];
        let (model, textures, warnings) = read(TRIANGLE.as_bytes(), &files).unwrap();
        assert_eq!(warnings, Vec::<String>::new(), "{options}");
        let (mesh, material) = (&model.meshes[0], &model.materials[0]);
        let texture = &textures.textures[material.texture.unwrap() as usize];
        // In the middle of its texels the texture is what they are.
        let u = ((mesh.uvs[0].x + mesh.uvs[1].x) / 2.0).rem_euclid(1.0);
        assert_eq!(
            material.albedo * texture.sample(Vec2::new(if u < 0.5 { 0.25 } else { 0.75 }, 0.5)).0,
            Vec3::splat(albedo),
            "{options}: {u}"
        );
    }
    let library = b"newmtl m\nmap_Kd -s 2 4 -o 0.5 0.25 t.png\nmap_Ke -s 3 3 3 t.png\n";
    let (model, ..) = read(TRIANGLE.as_bytes(), &[("a.mtl", library), ("t.png", &half_white())]).unwrap();
    let mesh = &model.meshes[0];
    // (1.1 + 0.5, 1 − (2 + 0.25)) and (1.65, 1 − 1.5).
    assert!(mesh.uvs[0].abs_diff_eq(Vec2::new(1.6, -1.25), 1e-6), "{}", mesh.uvs[0]);
    assert!(mesh.emission_uvs[0].abs_diff_eq(Vec2::new(1.65, -0.5), 1e-6), "{}", mesh.emission_uvs[0]);
}

#[test]
fn options_that_would_change_the_texture_are_refused() {
    for (statement, told) in [
        ("map_Kd -t 0.1 0 0 t.png", "a.mtl:2: `map_Kd -t 0.1 0 0 t.png`: the option -t"),
        ("map_Kd -mm 0.2 1 t.png", "a.mtl:2: `map_Kd -mm 0.2 1 t.png`: the option -mm"),
        ("map_Ke -mm 0 0.5 t.png", "the option -mm"),
        ("map_Kd -imfchan r t.png", "the option -imfchan"),
        ("map_Kd -s nan 1 t.png", "expected finite numbers after -o and -s"),
        ("d half", "a.mtl:2: `d half`: expected a number from 0 to 1"),
    ] {
        let library = format!("newmtl m\n{statement}\n");
        let files = [("a.mtl", library.as_bytes()), ("t.png", &half_white())];
        let error = read(TRIANGLE.as_bytes(), &files).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
    }
    let library = b"newmtl m\nmap_Kd -foo 2 t.png\nmap_d -imfchan m t.png\n";
    let (model, _, warnings) =
        read(TRIANGLE.as_bytes(), &[("a.mtl", library), ("t.png", &half_white())]).unwrap();
    assert!(model.materials[0].texture.is_some() && model.materials[0].alpha_cutoff == Some(0.5));
    assert!(warnings[0].contains("option -foo (map_Kd, line 2): the option is unknown"), "{warnings:?}");
}

#[test]
fn textures_are_looked_for_beside_library_and_model() {
    for (name, at) in [
        ("t.png", "lib/t.png"),
        ("t.png", "t.png"),
        ("maps\\t.png", "lib/maps/t.png"),
        ("D:\\work\\maps\\t.png", "lib/t.png"),
        ("/home/me/t.png", "t.png"),
        ("\"t 1.png\"", "t 1.png"),
    ] {
        let library = format!("newmtl m\nmap_Kd {name}\n");
        let obj = TRIANGLE.replace("a.mtl", "lib/a.mtl");
        let (model, _, warnings) =
            read(obj.as_bytes(), &[("lib/a.mtl", library.as_bytes()), (at, &half_white())]).unwrap();
        assert!(model.materials[0].texture.is_some(), "{name}: {warnings:?}");
    }
    let (_, _, warnings) = read(TRIANGLE.as_bytes(), &[("a.mtl", b"newmtl m\nKd 1\nmap_Kd\n")]).unwrap();
    assert!(warnings[0].contains("material m (it names no file): map_Kd cannot be read"), "{warnings:?}");
}

#[test]
fn vertex_colours_multiply_the_albedo() {
    let linear = |c: f64| linear_from_srgb(c) as f32;
    let half = linear(0.5);
    for (obj, library, albedo, colours) in [
        // Alone, with a material, as bytes, by ZBrush, and of one vertex only.
        ("v 0 0 0 .5 .5 .5\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\n", "", 1.0, [half, 1.0, 0.0]),
        (
            "mtllib a.mtl\nv 0 0 0 .5 .5 .5\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nusemtl m\nf 1 2 3\n",
            "newmtl m\nKd 0.25\n",
            0.25,
            [half, 1.0, 0.0],
        ),
        ("v 0 0 0 51 51 51\nv 1 0 0 255 255 255\nv 0 1 0 0 0 0\nf 1 2 3\n", "", 1.0, [linear(0.2), 1.0, 0.0]),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n#MRGB ff333333ffffffff\n#MRGB ff000000\nf 1 2 3\n",
            "",
            1.0,
            [linear(0.2), 1.0, 0.0],
        ),
        ("v 0 0 0\nv 1 0 0 0 0 0\nv 0 1 0\nf 1 2 3\n", "", 1.0, [1.0, 0.0, 1.0]),
        // A weight is no colour.
        ("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n", "", 0.5, [f32::NAN; 3]),
    ] {
        let (model, _, warnings) = read(obj.as_bytes(), &[("a.mtl", library.as_bytes())]).unwrap();
        assert_eq!(warnings, Vec::<String>::new());
        let (mesh, material) = (&model.meshes[0], &model.materials[0]);
        assert!(material.albedo == Vec3::splat(albedo) && material.undefined == (albedo == 0.5), "{obj}");
        assert_eq!(mesh.colours.len(), if albedo == 0.5 { 0 } else { 3 });
        for (found, expected) in mesh.colours.iter().zip(colours) {
            assert!(
                (*found - Vec3::splat(expected).extend(1.0)).abs().max_element() < 1e-6,
                "{obj}: {found}"
            );
        }
    }
    // Meshes without colours keep the default albedo beside those that have them.
    let obj =
        "v 0 0 0 0 0 0\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\no b\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n";
    let (model, ..) = read(obj.as_bytes(), &[]).unwrap();
    let albedo: Vec<f32> = model.meshes.iter().map(|mesh| model.materials[mesh.material].albedo.x).collect();
    assert_eq!(albedo, [1.0, 0.5]);
    let error =
        read(b"v 0 0 0 nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &[]).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("vertex colour"), "{error}");
}

#[test]
fn what_is_left_out_is_told() {
    let obj = "cstype bezier\nsurf 0 1 0 1 1\ncurv 0 1 1 2\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let (_, _, warnings) = read(obj.as_bytes(), &[]).unwrap();
    assert!(warnings[0].contains("a.obj: line 2 (and 1 more like it): free-form curves"), "{warnings:?}");
}

/// A few lines that name a library and its materials again and again are read in one go.
#[test]
fn a_library_is_read_once() {
    let obj = "mtllib a.mtl\n".repeat(5000) + TRIANGLE;
    let library = "newmtl m\nKd 0.5\n".repeat(2000);
    let (model, ..) = read(obj.as_bytes(), &[("a.mtl", library.as_bytes())]).unwrap();
    assert_eq!(model.materials.len(), 1);
}
