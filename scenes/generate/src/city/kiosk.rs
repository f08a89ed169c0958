//! An octagonal newspaper kiosk and an advertising column.

use super::{AVENUE, PAVED, STREET, Site};
use crate::mesh::Mesh;
use crate::model::Model;
use crate::shapes::{bevelled, lathe, tube};
use glam::DVec3;
use std::f64::consts::PI;

/// Radius of the kiosk's corners.
const RADIUS: f64 = 1.15;

pub fn build(model: &mut Model) {
    let site = Site::new(DVec3::new(AVENUE[0] - 1.75, PAVED, STREET[0] + 14.2), -90.0);
    kiosk(model, &site);
    for (x, z, turn) in [(-AVENUE[0] + 1.55, STREET[0] + 14.4, 10.0), (20.6, -STREET[1] - 1.6, 60.0)] {
        column(model, &Site::new(DVec3::new(x, PAVED, z), turn));
    }
}

/// Eight panels, a counter towards the pavement, an onion roof.
fn kiosk(model: &mut Model, site: &Site) {
    let apothem = RADIUS * (PI / 8.0).cos();
    let half = RADIUS * (PI / 8.0).sin();
    for k in 0..8 {
        let face = site.within(0.0, 0.0, 0.0, 45.0 * f64::from(k));
        let open = k == 0;
        let mut wall = Mesh::default();
        let p = |x: f64, y: f64| DVec3::new(x, y, apothem);
        wall.quad(p(-half, -0.03), p(half, -0.03), p(half, 2.45), p(-half, 2.45));
        model.add("kiosk", "green_wood", face.set(wall));
        let frame = |x0: f64, y0: f64, x1: f64, y1: f64, out: f64| {
            bevelled([x0, y0, apothem - 0.05], [x1, y1, apothem + out], 0.01)
        };
        let mut wood = frame(-half + 0.02, 0.1, half - 0.02, 0.2, 0.03);
        wood.append(frame(-half + 0.02, 0.85, half - 0.02, 0.95, 0.04));
        wood.append(frame(-half + 0.02, 2.2, half - 0.02, 2.4, 0.04));
        for side in [-1.0, 1.0] {
            let x = side * (half - 0.03);
            wood.append(frame(x - 0.06, -0.02, x + 0.06, 2.46, 0.05));
        }
        model.add("kiosk_detail", "green_wood", face.set(wood));
        // Papers hang on the closed sides, the open one is dark above its counter.
        if open {
            model.add("kiosk_detail", "glass", face.set(frame(-half + 0.1, 1.0, half - 0.1, 2.15, 0.012)));
            model.add("kiosk_detail", "oak", face.set(frame(-half - 0.05, 0.93, half + 0.05, 0.99, 0.35)));
        } else {
            for (n, paper) in ["paper", "red_cloth", "linen", "blue_cloth"].into_iter().enumerate() {
                let (i, j) = (n % 2, n / 2);
                let (x, y) = (-0.3 + 0.32 * i as f64, 1.04 + 0.56 * j as f64);
                model.add("kiosk_detail", paper, face.set(frame(x, y, x + 0.27, y + 0.48, 0.015)));
            }
        }
    }
    let eave = RADIUS + 0.45;
    let roof = lathe(
        &[
            &[(0.9, 2.4), (eave, 2.46)],
            &[(eave, 2.46), (eave, 2.56)],
            &[(eave, 2.56), (1.1, 2.68), (0.85, 2.95), (0.8, 3.2), (0.55, 3.5), (0.15, 3.75), (0.05, 4.0)],
            &[(0.05, 4.0), (0.1, 4.08), (0.0, 4.2)],
        ],
        24,
    );
    model.add("kiosk roof", "copper", site.set(roof));
    for k in 0..16 {
        let turn = site.within(0.0, 0.0, 0.0, 22.5 * f64::from(k));
        let tooth = bevelled([-0.12, 2.33, eave - 0.06], [0.12, 2.5, eave + 0.02], 0.015);
        model.add("kiosk_detail", "copper", turn.set(tooth));
    }
}

/// A round column with posters, a plinth and a cap.
fn column(model: &mut Model, site: &Site) {
    let drum = lathe(&[&[(0.62, 0.3), (0.62, 2.75)]], 32);
    model.add("columns", "paper", site.set(drum));
    let trim = lathe(
        &[
            &[(0.72, -0.03), (0.72, 0.28)],
            &[(0.72, 0.28), (0.6, 0.34)],
            &[(0.6, 2.7), (0.76, 2.78)],
            &[(0.76, 2.78), (0.76, 2.9)],
            &[(0.76, 2.9), (0.55, 3.1), (0.3, 3.3), (0.08, 3.4)],
        ],
        32,
    );
    model.add("columns_detail", "green_wood", site.set(trim));
    let finial = tube(&[(DVec3::Y * 3.36, 0.09), (DVec3::Y * 3.5, 0.05), (DVec3::Y * 3.75, 0.01)], 10);
    model.add("columns_detail", "green_wood", site.set(finial));
    for k in 0..9 {
        let cloth = ["red_cloth", "mustard", "blue_cloth", "linen"][k % 4];
        let (y, h) = (0.55 + 0.68 * (k % 3) as f64, 0.3);
        let a0 = k as f64 * 0.69;
        let sheet =
            crate::relief::full(&crate::relief::steps(a0, a0 + 0.55, 5), &[y, y + 2.0 * h], |a, y| {
                DVec3::new(0.628 * a.sin(), y, 0.628 * a.cos())
            });
        model.add("columns_detail", cloth, site.set(sheet));
    }
}
