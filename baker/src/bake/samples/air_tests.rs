//! Light is gathered at whatever brings points: here in the air, where there is no surface.

use super::Worker;
use crate::atlas::owners::Owners;
use crate::bake::errors::CellMap;
use crate::bake::prepare::{Options, prepare};
use crate::bake::store::{ALL_POINTS, BlockState, CELLS, SumKinds};
use crate::geometry::Geometry;
use crate::light::times::schedule::parse_hours;
use crate::receivers::{PlaceFinder, PlacePoints, ReceiverBlock, Receivers};
use crate::surface::BLOCK;
use crate::trace::paths::Transport;
use crate::trace::solids::{Receiver, Space};
use dataset::observe::Silent;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;
use std::fs;

/// Height of the points, far above all that is modelled.
const HEIGHT: f32 = 500.0;

/// A grid of points that look up, a metre apart, with every third left out.
struct Air;

impl PlacePoints for Air {
    fn is_covered(&self, place: usize) -> bool {
        !place.is_multiple_of(3)
    }

    fn receiver(&self, _: &Space, place: usize, _: Vec2) -> Option<Receiver> {
        let origin = Vec3::new((place % BLOCK) as f32, HEIGHT, (place / BLOCK) as f32);
        Some(Receiver { origin, triangle: u32::MAX, face_normal: Vec3::Y, normal: Vec3::Y })
    }

    fn rim(&self, _: &Space, _: usize) -> Vec<Receiver> {
        Vec::new()
    }

    fn along(&self, _: &Geometry, _: usize) -> Vec3 {
        Vec3::X
    }
}

impl Receivers for Air {
    fn size(&self) -> [usize; 2] {
        [100, 70]
    }

    fn blocks(&self) -> Vec<usize> {
        (0..self.all_blocks()).collect()
    }

    fn block(&self, block: usize) -> ReceiverBlock<'_> {
        ReceiverBlock::new(self.size(), block, Box::new(Air))
    }

    fn owners(&self) -> Owners {
        Owners::none(self.size())
    }

    fn place_finder(&self, _: &Geometry) -> PlaceFinder<'_> {
        Box::new(|_| None)
    }
}

#[test]
fn points_in_the_air_gather_the_light_of_sun_and_sky() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let floor = "v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nf 1 2 3 4\n";
    fs::write(path("floor.obj"), floor).unwrap();
    let scene = "[sky]\nmodel = \"constant\"\nradiance = [0.5, 0.6, 0.8]\n[sun]\n\
                 track = [{ hour = 12, direction = [1, 2, 2], irradiance = [9, 8, 7] }]\n[[object]]\nfile = \"floor.obj\"\n";
    fs::write(path("scene.toml"), scene).unwrap();
    let options = Options::new(parse_hours("12").unwrap());
    let prepared = prepare(&path("scene.toml"), &options, &Silent).unwrap();
    let (scene, plan) = (&prepared.scene, &prepared.plan);
    assert_eq!((plan.suns.len(), plan.sky_hours.len()), (1, 1));
    let lights = plan.lights(scene, &prepared.geometry, &[0, 1]);
    let rays = prepared.ray_tracer().unwrap();
    let transport = Transport::new(prepared.space(&rays), &lights, scene.bake.bounces);
    let worker = Worker { transport, receivers: &Air, seed: 1, guaranteed_samples: 16 };
    let (by_sun, by_sky) = (Vec3::new(9.0, 8.0, 7.0) * 2.0 / 3.0, Vec3::new(0.5, 0.6, 0.8) * PI);
    assert_eq!(worker.blocks(), [0, 1, 2, 3]);
    for block in worker.blocks() {
        let receivers = worker.block(block);
        assert_eq!((receivers.width, receivers.height), ([64, 36][block % 2], [64, 6][block / 2]));
        let covered: Vec<usize> = receivers.covered().collect();
        let mut state = BlockState::empty(covered.len(), SumKinds::of(&lights));
        worker.find_points(&receivers, &mut state);
        assert!(state.points.iter().all(|points| *points == ALL_POINTS), "{block}");
        worker.first_direct(&receivers, &mut state);
        worker.indirect(block, &receivers, &mut state, &[true; CELLS], 16, None);
        for texel in 0..covered.len() {
            for half in 0..2 {
                let mut light = vec![Vec3::ZERO; lights.layers()];
                state.means(texel, half, &lights, &mut light);
                for (found, expected) in light.into_iter().zip([by_sun, by_sky]) {
                    let error = ((found - expected) / expected).abs().max_element();
                    // (Each texel has its own points of the sun's disc.)
                    assert!(error < 4e-3, "{block} {texel}: {found} {expected}");
                }
            }
        }
    }
    // Nothing is seen from there but the sky, so that each cell is judged by its own light.
    let (cell_map, rays) = CellMap::find(&worker, &Silent).unwrap();
    assert_eq!((cell_map.grid().columns, cell_map.grid().rows), (8, 8));
    assert!(rays.inside > 0 && cell_map.chart_of(5, 5).is_none());
}
