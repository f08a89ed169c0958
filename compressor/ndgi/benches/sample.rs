//! Nanoseconds of what a game asks for, on one thread: `cargo bench -p ndgi --bench sample -- BUNDLE`.
//!
//! A tile made ready at an hour, a texel of a ready tile, a bilinear sample of a page whose tiles are ready,
//! a whole tile in f32 and in half floats, and `Decoder::sample`, which makes nothing ready. The least of
//! some runs each: others only add what else the machine does.

use ndgi::Bundle;
use ndgi::decode::{Decoder, Lights};
use std::hint::black_box;
use std::time::Instant;

/// The least seconds of one of `count` things, over nine runs.
fn least(count: usize, mut run: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64() / count as f64
    };
    (0..9).map(time).fold(f64::INFINITY, f64::min)
}

fn main() {
    let path =
        std::env::args().skip(1).find(|argument| !argument.starts_with("--")).expect("a bundle's path");
    let bundle = Bundle::open(path.as_ref()).expect("a bundle");
    let hour = 12.03;
    println!(
        "{:8}{:>12}{:>10}{:>10}{:>14}{:>16}",
        "light", "ready, µs", "texel, ns", "sample, ns", "tile, ns/texel", "RGBA16F, ns/texel"
    );
    for (name, lights) in [("all", Lights::All), ("baked", Lights::Baked)] {
        let at = bundle.at(hour).expect("an hour").only(lights);
        let places: Vec<_> = bundle.header.places().filter(|place| place.page == 0).collect();
        let ready = least(places.len(), || {
            places.iter().for_each(|&place| drop(black_box(at.tile(place).expect("a tile"))));
        });
        let tiles: Vec<_> = places.iter().map(|&place| at.tile(place).expect("a tile")).collect();
        let tiles: Vec<_> = tiles.into_iter().filter(|tile| !tile.is_black()).collect();
        let texels: usize = tiles.iter().map(|tile| tile.width() * tile.height()).sum();
        let texel = least(texels, || {
            for tile in &tiles {
                for y in 0..tile.height() {
                    for x in 0..tile.width() {
                        black_box(tile.texel(x, y));
                    }
                }
            }
        });
        let mut page = at.page(0).expect("a page");
        let count = 100_000;
        let sample = least(count, || {
            for i in 0..count {
                // A walk over the page, as pixels of a picture take.
                let [u, v] = [(i % 317) as f32 / 317.0, (i / 317) as f32 / 316.0];
                black_box(page.sample(u, v).expect("a sample"));
            }
        });
        let mut light = vec![[0.0; 3]; 128 * 128];
        let tile = least(texels, || {
            for tile in &tiles {
                tile.decode_into(black_box(&mut light[..tile.width() * tile.height()]));
            }
        });
        let mut halves = vec![[0; 4]; 128 * 128];
        let packed = least(texels, || {
            for tile in &tiles {
                tile.decode_rgba16f(1000.0, black_box(&mut halves[..tile.width() * tile.height()]));
            }
        });
        println!(
            "{name:8}{:>12.1}{:>10.0}{:>10.0}{:>14.1}{:>16.1}",
            ready * 1e6,
            texel * 1e9,
            sample * 1e9,
            tile * 1e9,
            packed * 1e9
        );
    }
    let decoder = Decoder::new(bundle);
    let count = 2000;
    let literal = least(count, || {
        for i in 0..count {
            black_box(
                decoder.sample(0, (i % 47) as f64 / 47.0, (i / 47) as f64 / 43.0, hour).expect("a sample"),
            );
        }
    });
    println!("Decoder::sample: {:.0} ns", literal * 1e9);
}
