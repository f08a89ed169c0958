//! What stands on roofs: dormers, chimneys, vents, a stair house.

use crate::mesh::Mesh;
use crate::model::Model;
use crate::shapes::{ALL, BOTTOM, EAST, NORTH, SOUTH, TOP, WEST, bevelled, block, lathe, prism, tube};
use glam::DVec3;

/// Meshes, each about the middle of its foot; dormers face the street.
pub struct Tops {
    /// In a steep slope.
    pub dormer: Vec<usize>,
    /// In a tiled roof.
    pub small_dormer: Vec<usize>,
    /// A stack with four pots.
    pub chimney: Vec<usize>,
    /// A ventilator with its cap.
    pub vent: Vec<usize>,
    /// The top of a staircase.
    pub stair_house: Vec<usize>,
}

impl Tops {
    /// Builds them, not yet placed.
    pub fn new(model: &mut Model) -> Self {
        Self {
            dormer: dormer(model, "dormer_detail", [0.72, 2.1], 1.5, "slate"),
            small_dormer: dormer(model, "small_dormer_detail", [0.6, 1.25], 2.6, "roof_tiles"),
            chimney: chimney(model),
            vent: vent(model),
            stair_house: stair_house(model),
        }
    }
}

/// A window under a small gable, reaching `depth` back into the roof.
fn dormer(model: &mut Model, name: &str, [half, h]: [f64; 2], depth: f64, cover: &str) -> Vec<usize> {
    let body = block([-half, -0.3, -depth], [half, h, 0.0], EAST | WEST);
    let mesh = model.shape(name, "zinc", body);
    // A frame around the pane.
    let (x, bar) = (half - 0.02, 0.13);
    let wood = |x0: f64, y0: f64, x1: f64, y1: f64, out: f64| bevelled([x0, y0, -0.2], [x1, y1, out], 0.015);
    let mut frame = wood(-half - 0.02, -0.3, -x + bar, h + 0.02, 0.06);
    frame.append(wood(x - bar, -0.3, half + 0.02, h + 0.02, 0.06));
    frame.append(wood(-x, -0.32, x, 0.12, 0.05).with(wood(-x, h - 0.16, x, h + 0.01, 0.05)));
    frame.append(wood(-0.03, 0.1, 0.03, h - 0.1, -0.02));
    frame.append(wood(-x, h * 0.62, x, h * 0.62 + 0.05, -0.025));
    frame.append(wood(-half - 0.08, -0.02, half + 0.08, 0.06, 0.13));
    model.shape(name, "white_wood", frame);
    model.shape(name, "glass", block([-x, 0.0, -1.0], [x, h, -0.06], SOUTH));
    // The gable's ridge runs into the roof: a prism, turned a quarter.
    let (out, rise) = (0.16, half * 0.62);
    let section = [
        [-half - out, h - 0.05],
        [half + out, h - 0.05],
        [half + out, h + 0.04],
        [0.0, h + rise + 0.04],
        [-half - out, h + 0.04],
    ];
    let (sides, ends) = prism(&section, -0.2, depth + 0.4);
    let roof = sides.into_iter().fold(Mesh::default(), Mesh::with).turned(90.0);
    model.shape(name, cover, roof);
    model.shape(name, "white_wood", ends.turned(90.0));
    vec![mesh]
}

fn chimney(model: &mut Model) -> Vec<usize> {
    let stack = block([-0.75, -1.8, -0.35], [0.75, 1.5, 0.35], ALL & !BOTTOM & !TOP);
    let lit = model.shape("roof_chimney", "brick", stack);
    let cap = bevelled([-0.85, 1.42, -0.45], [0.85, 1.6, 0.45], 0.03);
    let detail = model.shape("chimney_detail", "stucco", cap);
    for k in 0..4 {
        let x = -0.54 + 0.36 * f64::from(k);
        let pot = lathe(
            &[
                &[(0.12, 1.55), (0.13, 1.66), (0.1, 1.72), (0.085, 2.05), (0.11, 2.1)],
                &[(0.11, 2.1), (0.075, 2.1)],
                &[(0.075, 2.1), (0.07, 1.95), (0.0, 1.95)],
            ],
            12,
        );
        model.shape("chimney_detail", "clay", pot.translated(x, 0.0, 0.0));
    }
    vec![lit, detail]
}

fn vent(model: &mut Model) -> Vec<usize> {
    let pipe = lathe(
        &[
            &[(0.22, 0.0), (0.22, 0.7)],
            &[(0.22, 0.7), (0.36, 0.74)],
            &[(0.36, 0.74), (0.36, 0.84), (0.05, 1.0)],
            &[(0.05, 1.0), (0.0, 1.0)],
        ],
        16,
    );
    let mut mesh = pipe;
    mesh.append(bevelled([0.45, 0.0, -0.4], [1.35, 0.75, 0.4], 0.03).standing());
    for k in 0..6 {
        let y = 0.15 + 0.09 * f64::from(k);
        mesh.append(block([0.55, y, 0.38], [1.25, y + 0.05, 0.43], ALL & !NORTH));
    }
    vec![model.shape("vent_detail", "zinc", mesh)]
}

fn stair_house(model: &mut Model) -> Vec<usize> {
    let lit =
        model.shape("roof_stairs", "grey", block([-1.5, 0.0, -1.4], [1.5, 2.5, 1.4], ALL & !BOTTOM & !TOP));
    let slab = bevelled([-1.65, 2.45, -1.55], [1.65, 2.65, 1.55], 0.03);
    let detail = model.shape("stairs_detail", "zinc", slab);
    let leaf = bevelled([-0.45, 0.02, 1.3], [0.45, 2.05, 1.44], 0.01);
    model.shape("stairs_detail", "red_wood", leaf);
    let mast =
        |x: f64, h: f64| tube(&[(DVec3::new(x, 2.6, -0.8), 0.025), (DVec3::new(x, h, -0.8), 0.015)], 6);
    let mut antenna = mast(1.1, 5.2);
    for k in 0..6 {
        let (y, r) = (4.2 + 0.16 * f64::from(k), 0.5 - 0.05 * f64::from(k));
        antenna
            .append(tube(&[(DVec3::new(1.1 - r, y, -0.8), 0.008), (DVec3::new(1.1 + r, y, -0.8), 0.008)], 5));
    }
    model.shape("stairs_detail", "steel", antenna);
    vec![lit, detail]
}
