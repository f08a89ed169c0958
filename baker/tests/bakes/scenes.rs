//! Four small scenes: outdoors, a room, the same with a patch of sun, instances with cut-outs.

use crate::Stage;
use image::{ImageFormat, Rgba, RgbaImage};
use std::fmt::Write;
use std::io::Cursor;

/// An OBJ file under construction.
#[derive(Default)]
pub struct Obj {
    text: String,
    vertices: usize,
}

impl Obj {
    /// Begins a mesh.
    pub fn mesh(mut self, name: &str) -> Self {
        writeln!(self.text, "o {name}").expect("written");
        self
    }

    /// A parallelogram whose front is on the side of `u × v`; `vt` runs along both edges.
    pub fn quad(mut self, corner: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Self {
        let first = self.vertices + 1;
        for (a, b) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let at = |i: usize| corner[i] + a * u[i] + b * v[i];
            writeln!(self.text, "v {} {} {}\nvt {a} {b}", at(0), at(1), at(2)).expect("written");
        }
        self.vertices += 4;
        let corners: String = (first..first + 4).map(|i| format!(" {i}/{i}")).collect();
        writeln!(self.text, "f{corners}").expect("written");
        self
    }

    /// A box without its bottom, seen from outside.
    pub fn block(self, [x, y, z]: [f64; 3], [w, h, d]: [f64; 3]) -> Self {
        self.quad([x, y, z + d], [w, 0.0, 0.0], [0.0, h, 0.0])
            .quad([x + w, y, z], [-w, 0.0, 0.0], [0.0, h, 0.0])
            .quad([x, y, z], [0.0, 0.0, d], [0.0, h, 0.0])
            .quad([x + w, y, z + d], [0.0, 0.0, -d], [0.0, h, 0.0])
            .quad([x, y + h, z + d], [w, 0.0, 0.0], [0.0, 0.0, -d])
    }

    /// A level quad that looks up.
    pub fn floor(self, [x, y, z]: [f64; 3], w: f64, d: f64) -> Self {
        self.quad([x, y, z + d], [w, 0.0, 0.0], [0.0, 0.0, -d])
    }

    /// The file.
    pub fn bytes(self) -> Vec<u8> {
        self.text.into_bytes()
    }

    /// A line as it is.
    pub fn line(mut self, line: &str) -> Self {
        writeln!(self.text, "{line}").expect("written");
        self
    }
}

/// A scene with its files; `[bake]` is left to the test.
pub struct Case {
    pub stage: Stage,
    pub text: String,
    pub hours: &'static str,
}

/// A crate on the ground under sun and sky.
pub fn outdoors() -> Case {
    let obj = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    let obj = obj.mesh("crate").block([-0.5, -0.05, -0.5], [1.0, 1.05, 1.0]);
    let text = "[place]\nlatitude = 48.0\nlongitude = 16.0\nutc_offset = 1.0\ndate = 2026-06-21\n[sun]\n\
        [sky]\nmodel = \"hosek-wilkie\"\n[[object]]\nfile = \"a.obj\"\nalbedo = [0.6, 0.5, 0.3]\n\
        [lightmap]\nsize = 40\n";
    Case { stage: Stage::new(&[("a.obj", obj.bytes())]), text: text.to_owned(), hours: "8,12" }
}

/// The floor of a room of 2 × 2 × 2 m, and its walls and ceiling with a window.
pub fn shell() -> [Obj; 2] {
    let floor = Obj::default().mesh("floor").floor([-1.0, 0.0, -1.0], 2.0, 2.0);
    let walls = Obj::default()
        .mesh("walls")
        .quad([-1.0, 2.0, -1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0])
        .quad([-1.0, 0.0, -1.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0])
        .quad([-1.0, 0.0, 1.0], [0.0, 0.0, -2.0], [0.0, 2.0, 0.0])
        .quad([1.0, 0.0, -1.0], [0.0, 0.0, 2.0], [0.0, 2.0, 0.0])
        .quad([-1.0, 0.0, 1.0], [0.0, 2.0, 0.0], [0.5, 0.0, 0.0])
        .quad([0.5, 0.0, 1.0], [0.0, 2.0, 0.0], [0.5, 0.0, 0.0])
        .quad([-0.5, 0.0, 1.0], [0.0, 0.7, 0.0], [1.0, 0.0, 0.0])
        .quad([-0.5, 1.6, 1.0], [0.0, 0.4, 0.0], [1.0, 0.0, 0.0]);
    [floor, walls]
}

/// A room with a window and a lamp.
pub fn room() -> Case {
    let [floor, walls] = shell();
    let text = "[sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n\
        [[portal]]\ncorner = [-0.5, 0.7, 1]\nedge_u = [1, 0, 0]\nedge_v = [0, 0.9, 0]\n\
        [[object]]\nfile = \"floor.obj\"\nalbedo = [0.7, 0.6, 0.5]\n\
        [[object]]\nfile = \"walls.obj\"\nalbedo = [0.7, 0.6, 0.5]\n\
        [[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0.3, 1.5, -0.4]\nradius = 0.1\nradiance = [40, 30, 20]\n\
        [lightmap]\nsize = 40\n";
    let files = [("floor.obj", floor.bytes()), ("walls.obj", walls.bytes())];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// Two rooms apart, alike but for their lamps: one has a thousandth of the other's light. The plate under
/// each lamp shades walls and floor: they get what the ceiling reflects.
pub fn bright_and_dim() -> Case {
    let [floor, walls] = shell();
    let plate = Obj::default().mesh("plate").block([-0.1, 1.6, -0.8], [0.8, 0.02, 0.8]);
    let files = [("floor.obj", floor), ("walls.obj", walls), ("plate.obj", plate)];
    let mut text = "[lightmap]\nsize = 56\n".to_owned();
    for (x, radiance) in [(0.0, [4e4; 3]), (50.0, [40.0; 3])] {
        let at = format!("centre = [{}, 1.75, -0.4]\nradius = 0.1\nradiance = {radiance:?}\n", x + 0.3);
        writeln!(text, "[[group]]\nname = \"{x}\"\n[[group.sphere]]\n{at}").expect("written");
        for (file, _) in &files {
            let object = format!("file = \"{file}\"\nalbedo = [0.7, 0.6, 0.5]\ntranslate = [{x:?}, 0, 0]\n");
            writeln!(text, "[[object]]\n{object}").expect("written");
        }
    }
    let files = files.map(|(name, obj)| (name, obj.bytes()));
    Case { stage: Stage::new(&files), text, hours: "12" }
}

/// A room with a lamp, and a plate 2 cm before a wall: hardly any light gets between them. All lengths are
/// times `scale`.
pub fn plate_before_a_wall(scale: f64) -> Case {
    let [floor, walls] = shell();
    let plate = Obj::default().mesh("plate").block([-0.98, -0.01, -0.9], [0.02, 1.91, 1.8]);
    let files = [("floor.obj", floor), ("walls.obj", walls), ("plate.obj", plate)];
    let object = |file: &str| format!("[[object]]\nfile = \"{file}\"\nalbedo = 0.2\nscale = {scale:?}\n");
    let objects: String = files.iter().map(|(file, _)| object(file)).collect();
    let centre = [0.3, 1.5, -0.4].map(|x| x * scale);
    let text = format!(
        "{objects}[[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = {centre:?}\nradius = {:?}\n\
         radiance = [40, 30, 20]\n[lightmap]\nsize = 96\n",
        0.1 * scale
    );
    let files = files.map(|(name, obj)| (name, obj.bytes()));
    Case { stage: Stage::new(&files), text, hours: "12" }
}

/// The room, and the sun through its window: a bright patch on the floor.
pub fn sunlit_room() -> Case {
    let sun = "[sun]\ndisc_angle = 1\n\
        track = [{ hour = 12, direction = [0.1, 1, 0.9], irradiance = [90, 80, 70] }]\n";
    let room = room();
    Case { text: sun.to_owned() + &room.text, ..room }
}

/// A house with a window, its outside in the sun: beside that, the patch of sun on its floor is not bright.
pub fn house() -> Case {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/house.glb");
    let text = "[place]\nlatitude = 48.0\nlongitude = 11.5\nutc_offset = 2.0\ndate = 2026-06-21\n[sun]\n\
        [sky]\nmodel = \"hosek-wilkie\"\n[[object]]\nfile = \"house.glb\"\n[lightmap]\nsize = 48\n";
    let stage = Stage::new(&[("house.glb", std::fs::read(file).expect("readable"))]);
    Case { stage, text: text.to_owned(), hours: "12" }
}

/// The sunlit room with a screen of tinted glass in front of the window, which reflects a part of the light.
pub fn glazed_room() -> Case {
    let room = sunlit_room();
    let sheet = Obj::default().mesh("sheet").quad([-0.9, 0.1, 0.6], [1.6, 0.0, 0.0], [0.0, 1.7, 0.0]);
    room.stage.write("sheet.obj", &sheet.bytes());
    let sheet =
        "[[object]]\nfile = \"sheet.obj\"\nalbedo = 0.8\ntransmission = [0.7, 0.6, 0.4]\ntwo_sided = true\n";
    Case { text: sheet.to_owned() + &room.text, ..room }
}

/// A room that the sun alone lights, by way of its floor, which has no texels.
pub fn sunlit_floor() -> Case {
    let [floor, walls] = shell();
    let text = "[sun]\ndisc_angle = 1\n\
        track = [{ hour = 12, direction = [-0.3, 0.7, 0.9], irradiance = [90, 80, 70] }]\n\
        [[object]]\nfile = \"walls.obj\"\nalbedo = 0.7\n\
        [[object]]\nfile = \"floor.obj\"\nalbedo = 0.7\nlightmap = false\n\
        [lightmap]\nsize = 40\n";
    let files = [("floor.obj", floor.bytes()), ("walls.obj", walls.bytes())];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// A shed of one-sided outer walls with a door, on a floor without texels; the underside of a table in it has
/// texels. From inside, nearly all that a path meets are backs.
pub fn shed() -> Case {
    let mut obj = Obj::default().mesh("floor");
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (f64::from(i), f64::from(j)))) {
        obj = obj.floor([i - 3.0, 0.0, j - 3.0], 1.0, 1.0);
    }
    let walls = obj
        .mesh("walls")
        .quad([-3.0, 2.4, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0])
        .quad([3.0, 0.0, -3.0], [-6.0, 0.0, 0.0], [0.0, 2.4, 0.0])
        .quad([-3.0, 0.0, -3.0], [0.0, 0.0, 6.0], [0.0, 2.4, 0.0])
        .quad([3.0, 0.0, 3.0], [0.0, 0.0, -6.0], [0.0, 2.4, 0.0])
        .quad([-3.0, 0.0, 3.0], [4.5, 0.0, 0.0], [0.0, 2.4, 0.0])
        .quad([2.5, 0.0, 3.0], [0.5, 0.0, 0.0], [0.0, 2.4, 0.0])
        .quad([1.5, 2.0, 3.0], [1.0, 0.0, 0.0], [0.0, 0.4, 0.0]);
    let table = Obj::default().mesh("table").quad([-0.5, 0.8, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let text = "[sun]\ndisc_angle = 20\n\
        track = [{ hour = 12, direction = [0.6, 0.5, 1.0], irradiance = [9, 8, 7] }]\n\
        [sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n\
        [[object]]\nfile = \"table.obj\"\nalbedo = 0\n\
        [[object]]\nfile = \"shed.obj\"\nalbedo = 0.8\nlightmap = false\n\
        [lightmap]\nsize = 20\n";
    let files = [("table.obj", table.bytes()), ("shed.obj", walls.bytes())];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// A ceiling over a floor without texels. Slabs cover half of the floor; the floor under them is dark and
/// unseen.
pub fn slabs_on_a_floor() -> Case {
    let ceiling = Obj::default().mesh("ceiling").quad([-1.0, 1.0, -1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]);
    let mut floor = Obj::default().mesh("floor").floor([-2.0, 0.0, -2.0], 4.0, 4.0).mesh("slabs");
    for (i, j) in (0..20).flat_map(|i| (0..20).map(move |j| (f64::from(i), f64::from(j)))) {
        let (x, z) = (0.2 * i - 1.98, 0.2 * j - 1.98);
        let (low, size) = ([x, 0.0, z], [0.14, 0.001, 0.14]);
        floor = floor.block(low, size);
        // Every second one is a closed solid.
        if (i + j) % 2.0 == 0.0 {
            floor = floor.quad(low, [size[0], 0.0, 0.0], [0.0, 0.0, size[2]]);
        }
    }
    let text = "[sun]\ndisc_angle = 20\n\
        track = [{ hour = 12, direction = [1.0, 0.8, 0.2], irradiance = [90, 80, 70] }]\n\
        [[object]]\nfile = \"ceiling.obj\"\nalbedo = 0\n\
        [[object]]\nfile = \"floor.obj\"\nalbedo = 0.8\nlightmap = false\n\
        [[object.part]]\nname = \"slabs\"\nalbedo = 0\n\
        [lightmap]\nsize = 20\n";
    let files = [("ceiling.obj", ceiling.bytes()), ("floor.obj", floor.bytes())];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// Three white walls that meet, and a lamp in their corner, two texels from each: light that differs over
/// every texel there.
pub fn corner() -> Case {
    let obj = Obj::default()
        .mesh("floor")
        .floor([0.0, 0.0, 0.0], 1.5, 1.5)
        .mesh("walls")
        .quad([0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 1.5, 0.0])
        .quad([0.0, 0.0, 1.5], [0.0, 0.0, -1.5], [0.0, 1.5, 0.0]);
    let text = "[[object]]\nfile = \"a.obj\"\nalbedo = 0.8\n\
        [[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0.14, 0.14, 0.14]\nradius = 0.02\nradiance = [400, 300, 200]\n\
        [lightmap]\nsize = 40\n";
    Case { stage: Stage::new(&[("a.obj", obj.bytes())]), text: text.to_owned(), hours: "12" }
}

/// The same with walls of coarser cache: without texels, or with larger ones, as `walls` says; the floor has
/// texels of about 7 cm.
pub fn coarse_corner(walls: &str, size: u32) -> Case {
    let floor = Obj::default().mesh("floor").floor([0.0, 0.0, 0.0], 1.5, 1.5);
    let wall = Obj::default().mesh("walls").quad([0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 1.5, 0.0]).quad(
        [0.0, 0.0, 1.5],
        [0.0, 0.0, -1.5],
        [0.0, 1.5, 0.0],
    );
    let text = format!(
        "[[object]]\nfile = \"floor.obj\"\nalbedo = 0.8\n[[object]]\nfile = \"walls.obj\"\nalbedo = 0.8\n{walls}\n\
        [[group]]\nname = \"lamp\"\n[[group.sphere]]\ncentre = [0.14, 0.14, 0.14]\nradius = 0.02\nradiance = [400, 300, 200]\n\
        [lightmap]\nsize = {size}\n"
    );
    let files = [("floor.obj", floor.bytes()), ("walls.obj", wall.bytes())];
    Case { stage: Stage::new(&files), text, hours: "12" }
}

/// A ground under the sun and wires whose shadows are an eighth of a texel wide.
pub fn wires() -> Case {
    let ground = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    let wires = (0..9).fold(Obj::default().mesh("wires"), |obj, i| {
        let x = -1.8 + 0.437 * f64::from(i);
        obj.quad([x, 0.3, -2.5], [0.0125, 0.0, 0.0], [0.3, 0.0, 5.0])
    });
    let text = "[sun]\ndisc_angle = 0.1\ntrack = [{ hour = 12, direction = [0.1, 1, 0.2], irradiance = [90, 80, 70] }]\n\
        [[object]]\nfile = \"ground.obj\"\nalbedo = 0\n\
        [[object]]\nfile = \"wires.obj\"\nalbedo = 0\nlightmap = false\ntwo_sided = true\n\
        [lightmap]\nsize = 40\n";
    let files = [("ground.obj", ground.bytes()), ("wires.obj", wires.bytes())];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// A ground in the slanting sun and low walls, each of which divides a row of texels into lit and shaded
/// parts.
pub fn low_walls() -> Case {
    let ground = Obj::default().mesh("ground").floor([-2.0, 0.0, -2.0], 4.0, 4.0);
    let walls = (0..8).fold(Obj::default().mesh("walls"), |obj, i| {
        let x = -1.8 + 0.487 * f64::from(i);
        obj.quad([x, -0.05, -2.5], [0.0, 0.2, 0.0], [0.0, 0.0, 5.0])
    });
    let text = "[sun]\ndisc_angle = 1\ntrack = [{ hour = 12, direction = [1, 1, 0.1], irradiance = [90, 80, 70] }]\n\
        [sky]\nmodel = \"constant\"\nradiance = [0.1, 0.1, 0.1]\n\
        [[object]]\nfile = \"ground.obj\"\nalbedo = 0\n\
        [[object]]\nfile = \"walls.obj\"\nalbedo = 0\nlightmap = false\ntwo_sided = true\n\
        [lightmap]\nsize = 40\n";
    let files = [("ground.obj", ground.bytes()), ("walls.obj", walls.bytes())];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// A material whose picture has holes in every other texel.
fn holed() -> [(&'static str, Vec<u8>); 2] {
    let texel = |x: u32, y: u32| if (x + y).is_multiple_of(2) { [60, 160, 60, 255] } else { [0, 0, 0, 0] };
    let mut png = Cursor::new(Vec::new());
    RgbaImage::from_fn(8, 8, |x, y| Rgba(texel(x, y))).write_to(&mut png, ImageFormat::Png).expect("a PNG");
    let mtl = b"newmtl holed\nKd 1 1 1\nmap_Kd holed.png\nmap_d holed.png\n".to_vec();
    [("sheet.mtl", mtl), ("holed.png", png.into_inner())]
}

/// Three blocks of one mesh, turned and mirrored, under a sheet with holes.
pub fn instances() -> Case {
    let block = Obj::default().mesh("block").block([-0.3, 0.0, -0.3], [0.6, 0.5, 0.4]).bytes();
    let ground = Obj::default().mesh("ground").floor([-1.5, 0.0, -1.5], 3.0, 3.0).bytes();
    let sheet = Obj::default().line("mtllib sheet.mtl").mesh("sheet").line("usemtl holed");
    let sheet = sheet.quad([-1.0, 1.2, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, -2.0]).bytes();
    let text = "[sun]\ndisc_angle = 2\ntrack = [{ hour = 12, direction = [0.3, 1, 0.2], irradiance = [50, 48, 45] }]\n\
        [sky]\nmodel = \"constant\"\nradiance = [3, 4, 5]\n\
        [[object]]\nfile = \"ground.obj\"\nalbedo = 0.5\n\
        [[object]]\nfile = \"sheet.obj\"\nlightmap = false\ntwo_sided = true\n\
        [[object]]\nfile = \"block.obj\"\nalbedo = 0.6\ninstances = [\n\
        { translate = [-0.8, 0, 0] },\n{ translate = [0.6, 0, 0.5], rotate = [0, 30, 0], scale = [-1, 1, 1] },\n\
        { translate = [0.4, 0, -0.7], scale = [1, 2, 1] },\n]\n\
        [lightmap]\nsize = 40\n";
    let [material, picture] = holed();
    let files = [("block.obj", block), ("ground.obj", ground), ("sheet.obj", sheet), material, picture];
    Case { stage: Stage::new(&files), text: text.to_owned(), hours: "12" }
}

/// A closed box of reflectance ½ that emits ½ kcd/m² everywhere: every texel has an irradiance of π.
pub fn furnace() -> Case {
    let obj = Obj::default()
        .mesh("furnace")
        .quad([-1.0, 0.0, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, -2.0])
        .quad([-1.0, 2.0, -1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0])
        .quad([-1.0, 0.0, -1.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0])
        .quad([1.0, 0.0, 1.0], [-2.0, 0.0, 0.0], [0.0, 2.0, 0.0])
        .quad([-1.0, 0.0, 1.0], [0.0, 0.0, -2.0], [0.0, 2.0, 0.0])
        .quad([1.0, 0.0, -1.0], [0.0, 0.0, 2.0], [0.0, 2.0, 0.0]);
    let text = "[[object]]\nfile = \"a.obj\"\nalbedo = 0.5\nemission = [0.5, 0.5, 0.5]\ngroup = \"walls\"\n\
        [[group]]\nname = \"walls\"\n[lightmap]\nsize = 40\n";
    Case { stage: Stage::new(&[("a.obj", obj.bytes())]), text: text.to_owned(), hours: "12" }
}
