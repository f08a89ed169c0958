//! Nanoseconds a texel of a bundle's decoding, on one thread:
//! `cargo bench -p compressor --bench decode -- BUNDLE`.
//!
//! Of a bundle of planes: milliseconds to read and unpack a tile, once for all times, and by the instruction
//! sets of this processor the light of all frames from it.
//!
//! Of others, by the instruction sets: a tile unpacked and decoded at one set, BC7 included, and the
//! mean over all sets of a tile that stays unpacked; and what the sun of such a tile adds, at its times and
//! between them.

use compressor::bundle::{Bundle, MapCoding};
use compressor::decode::TileDecoder;
use compressor::lanes::Tier;
use compressor::planes::TilePlanes;
use std::time::Instant;

fn main() {
    let path =
        std::env::args().skip(1).find(|argument| !argument.starts_with("--")).expect("a bundle's path");
    let bundle = Bundle::open(path.as_ref()).expect("a bundle");
    match bundle.header.coding {
        MapCoding::Neural => features(&bundle),
        MapCoding::Basis => planes(&bundle),
    }
    sun(&bundle);
}

fn planes(bundle: &Bundle) {
    let header = &bundle.header;
    let unpack = || -> Vec<TilePlanes> {
        let tile = |place: compressor::grid::Place| {
            let sets = bundle.sets(place).expect("a tile");
            let size = header.pages[place.page].stored(place.column, place.row).into();
            let brightness = bundle.brightness(place).expect("a tile");
            (!sets.is_empty()).then(|| TilePlanes::new(&sets, size, &header.timeline, brightness))
        };
        header.places().filter_map(tile).collect()
    };
    let milliseconds = |_| {
        let start = Instant::now();
        std::hint::black_box(unpack());
        1e3 * start.elapsed().as_secs_f64()
    };
    let least = (0..10).map(milliseconds).fold(f64::INFINITY, f64::min);
    let tiles = unpack();
    let texels: usize = tiles.iter().map(|tile| tile.size[0] * tile.size[1]).sum();
    let count: usize = tiles.iter().flat_map(|tile| &tile.sources).map(|source| source.planes).sum();
    let full = 128.0 * 128.0 / texels as f64;
    println!(
        "{} tiles, {:.1} planes each; {:.2} ms to read and unpack 128×128 texels",
        tiles.len(),
        count as f64 / tiles.len() as f64,
        least * full
    );
    let times = bundle.maps_timeline();
    for tier in Tier::available() {
        tier.limit();
        let run = |_| {
            let start = Instant::now();
            for tile in &tiles {
                let mut light = vec![[0.0; 3]; tile.size[0] * tile.size[1]];
                for (frame, state) in header.timeline.states.iter().enumerate() {
                    let is_on = |lamp: usize| {
                        let is_of = |group: &usize| header.lamp(*group) == Some(lamp);
                        (0..state.len()).find(is_of).is_some_and(|group| state[group])
                    };
                    let place = |group: u16| header.lamp(usize::from(group));
                    let at = tile.at(&times.hold(frame), place, |lamp| f32::from(u8::from(is_on(lamp))));
                    at.decode_into(&mut light);
                }
                std::hint::black_box(light);
            }
            1e9 * start.elapsed().as_secs_f64() / (texels * header.timeline.hours.len()) as f64
        };
        let least = (0..5).map(run).fold(f64::INFINITY, f64::min);
        println!("{:12}  {least:8.1} ns a texel and frame", format!("{tier:?}"));
    }
}

fn features(bundle: &Bundle) {
    let timeline = &bundle.header.timeline;
    let tiles: Vec<_> =
        bundle.header.places().filter_map(|place| bundle.tile(place).expect("a tile")).collect();
    let texels: usize = tiles.iter().map(|tile| tile.shape.width * tile.shape.height).sum();
    let points: Vec<_> = timeline.hours.iter().map(|&hour| timeline.at(hour)).collect();
    println!("{} tiles, {texels} texels, {} sets; ns a texel and set", tiles.len(), points.len());
    println!("instructions  one set, BC7 included  all sets");
    for tier in Tier::available() {
        // The least of some runs: others only add what else the machine does.
        let run = |frames: usize| {
            let start = Instant::now();
            for tile in &tiles {
                let decoder = TileDecoder::new(tile, timeline).expect("a tile that was read").with_tier(tier);
                for point in points.iter().cycle().skip(points.len() / 2).take(frames) {
                    std::hint::black_box(decoder.decode_tile(point));
                }
            }
            1e9 * start.elapsed().as_secs_f64() / (texels * frames) as f64
        };
        let least = |frames: usize, runs: usize| (0..runs).map(|_| run(frames)).fold(f64::INFINITY, f64::min);
        println!("{:12}  {:21.1}  {:8.1}", format!("{tier:?}"), least(1, 20), least(points.len(), 3));
    }
}

fn sun(bundle: &Bundle) {
    let Some(sun) = &bundle.header.sun else { return };
    let tiles: Vec<_> =
        bundle.header.places().filter_map(|place| bundle.sun(place).expect("a tile")).collect();
    let texels: usize = tiles.iter().map(|tile| tile.width * tile.height).sum();
    let between: Vec<f64> = sun.times.windows(2).map(|pair| 0.7 * pair[0] + 0.3 * pair[1]).collect();
    for (name, hours) in [("the sun, at its times", &sun.times), ("the sun, between them", &between)] {
        let run = || {
            let start = Instant::now();
            for tile in &tiles {
                let mut light = vec![[0.0; 3]; tile.width * tile.height];
                hours.iter().for_each(|hour| tile.add_light(sun, *hour, &mut light));
                std::hint::black_box(light);
            }
            1e9 * start.elapsed().as_secs_f64() / (texels * hours.len().max(1)) as f64
        };
        let least = (0..5).map(|_| run()).fold(f64::INFINITY, f64::min);
        println!("{name:35}  {least:8.1}");
    }
}
