//! A bright room with a small window beside a sunlit yard a hundred times its size: what little light comes
//! in bounces often.

use crate::common::mesh::Obj;
use crate::common::{Baked, INTEGRATORS, Measured, SEEDS, Stage, green};
use glam::{DVec3, dvec3};

/// The room, [−3, 3]² × [0, 3], its walls 20 cm thick; in the one towards +x a window of 60 cm, 1 m up, with
/// its reveals. The sun stands on the other side: all light in the room has met the ground of 80 m first.
fn stage() -> Stage {
    let (low, high) = (dvec3(-3.0, 0.0, -3.0), dvec3(3.0, 3.0, 3.0));
    let wall = DVec3::splat(0.2);
    let rooms = Obj::default().mesh("room").sides(low, high, true, &[0, 2, 3, 4, 5]);
    let rooms = around_window(rooms, low, high, 3.0, false);
    let (y0, y1, z0, z1) = WINDOW;
    let rooms = rooms.mesh("reveal").sides(dvec3(3.0, y0, z0), dvec3(3.2, y1, z1), true, &[2, 3, 4, 5]);
    let shell = Obj::default().mesh("shell").sides(low - wall, high + wall, false, &[0, 2, 3, 4, 5]);
    let shell = around_window(shell, low - wall, high + wall, 3.2, true);
    let ground = Obj::default().mesh("ground").floor(dvec3(0.0, -0.3, 0.0), 80.0);
    Stage::new(&[("room.obj", rooms.text()), ("shell.obj", shell.text()), ("ground.obj", ground.text())])
}

/// y0, y1, z0, z1.
const WINDOW: (f64, f64, f64, f64) = (1.0, 1.6, -0.3, 0.3);

/// The wall at `x` without its window: below, above and beside it.
fn around_window(mut obj: Obj, low: DVec3, high: DVec3, x: f64, outwards: bool) -> Obj {
    let (y0, y1, z0, z1) = WINDOW;
    let parts =
        [(low.y, y0, low.z, high.z), (y1, high.y, low.z, high.z), (y0, y1, low.z, z0), (y0, y1, z1, high.z)];
    for (y0, y1, z0, z1) in parts {
        // y × z is +x.
        let (y, z) = (DVec3::Y * (y1 - y0), DVec3::Z * (z1 - z0));
        let (u, v) = if outwards { (y, z) } else { (z, y) };
        obj = obj.quad(dvec3(x, y0, z0), u, v);
    }
    obj
}

fn scene() -> String {
    "[sun]\ndisc_angle = 0.5\ntrack = [{ hour = 12, direction = [-0.6, 1, 0.1], irradiance = [100, 100, 100] }]\n\
         [[object]]\nfile = \"ground.obj\"\nalbedo = 0.2\ndensity = 0.25\n\
         [[object]]\nfile = \"shell.obj\"\nalbedo = 0.2\ndensity = 0.25\n\
         [[object]]\nfile = \"room.obj\"\nalbedo = 0.85\n[lightmap]\nsize = 112\n"
        .to_owned()
}

/// The room's mean light; a texel that was found black is light lost too.
fn in_room(baked: &Baked) -> f64 {
    let image = baked.first();
    let texels: Vec<_> = baked.covered("room").into_iter().filter(|t| t.whole).collect();
    assert!(texels.len() > 200, "{}", texels.len());
    texels.iter().map(|t| green(&image, t)).sum::<f64>() / texels.len() as f64
}

#[test]
fn the_cache_brings_as_much_light_into_the_room_as_paths_to_their_end() {
    // Judged by the light of the whole scene, the cache's passes would end while the room has a sixth of its
    // light.
    let scene = scene();
    let [cached, path] =
        INTEGRATORS.map(|integrator| stage().by(integrator).measure("12", 64, &scene, in_room));
    cached.agree(path, 0.05);
}

#[test]
fn light_that_a_few_texels_send_out_is_known_well_all_over_the_page() {
    // A patch of sun of 4 to 9 texels is all the light of a closed room of 1500: what the cache took it for,
    // it takes it for everywhere.
    let (low, high) = (dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 2.0, 1.0));
    let mut obj = Obj::default().mesh("room").sides(low, high, true, &[0, 1, 2, 4, 5]).mesh("ceiling");
    for (x0, x1, z0, z1) in
        [(-1.0, 1.0, -1.0, -0.1), (-1.0, 1.0, 0.1, 1.0), (-1.0, -0.1, -0.1, 0.1), (0.1, 1.0, -0.1, 0.1)]
    {
        obj = obj.quad(dvec3(x0, 2.0, z0), dvec3(x1 - x0, 0.0, 0.0), dvec3(0.0, 0.0, z1 - z0));
    }
    let scene = "[sun]\ndisc_angle = 0.5\ntrack = [{ hour = 12, direction = [0.1, 1, 0.07], irradiance = [100, 100, 100] }]\n\
                 [[object]]\nfile = \"a.obj\"\nalbedo = 0.6\n[lightmap]\nsize = 64\n";
    let ceiling = |baked: &Baked| {
        let image = baked.first();
        baked.on("ceiling").iter().map(|t| green(&image, t)).sum::<f64>()
    };
    let Measured { mean, sigma } = Stage::new(&[("a.obj", obj.text())]).measure("12", 64, scene, ceiling);
    let of_one_bake = sigma * (SEEDS as f64).sqrt();
    assert!(of_one_bake < 0.06 * mean, "{of_one_bake} of {mean}");
}
