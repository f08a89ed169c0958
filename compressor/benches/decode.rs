//! Nanoseconds a texel of a bundle's decoding, on one thread: `cargo bench -p compressor --bench decode -- BUNDLE`.
//!
//! By the instruction sets of this processor: a tile unpacked and decoded at one set, BC7 included, and the mean over all sets of a
//! tile that stays unpacked.

use compressor::bundle::Bundle;
use compressor::decode::TileDecoder;
use compressor::lanes::Tier;
use std::time::Instant;

fn main() {
    let path =
        std::env::args().skip(1).find(|argument| !argument.starts_with("--")).expect("a bundle's path");
    let bundle = Bundle::open(path.as_ref()).expect("a bundle");
    let timeline = &bundle.header.timeline;
    let tiles: Vec<_> =
        bundle.header.places().filter_map(|place| bundle.tile(place).expect("a tile")).collect();
    let texels: usize = tiles.iter().map(|tile| tile.shape.width * tile.shape.height).sum();
    let moments: Vec<_> = timeline.hours.iter().map(|&hour| timeline.at(hour)).collect();
    println!("{} tiles, {texels} texels, {} sets; ns a texel and set", tiles.len(), moments.len());
    println!("instructions  one set, BC7 included  all sets");
    for tier in Tier::available() {
        // The least of some runs: others only add what else the machine does.
        let run = |sets: usize| {
            let start = Instant::now();
            for tile in &tiles {
                let decoder = TileDecoder::new(tile, timeline).expect("a tile that was read").with_tier(tier);
                for moment in moments.iter().cycle().skip(moments.len() / 2).take(sets) {
                    std::hint::black_box(decoder.decode_tile(moment));
                }
            }
            1e9 * start.elapsed().as_secs_f64() / (texels * sets) as f64
        };
        let least = |sets: usize, runs: usize| (0..runs).map(|_| run(sets)).fold(f64::INFINITY, f64::min);
        println!("{:12}  {:21.1}  {:8.1}", format!("{tier:?}"), least(1, 20), least(moments.len(), 3));
    }
}
