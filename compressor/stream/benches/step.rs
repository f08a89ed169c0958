//! Microseconds of a step of the stream, by the number of tiles: `cargo bench -p ndgi-stream`.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench")]

use ndgi::grid::Grid;
use ndgi::{Bundle, testing};
use ndgi_stream::{Answer, Budgets, Completion, Pyramid, Seen, Stream, Tile};
use std::sync::Arc;
use std::time::Instant;

/// Steps that are timed.
const STEPS: usize = 2000;

/// Three levels of pages of 20 + 6 + 2 tiles.
fn pyramid(pages: usize) -> Arc<Pyramid> {
    let level = |level: u32| {
        let side = |side: usize| side.div_ceil(1 << level);
        let (header, payloads) = testing::sunny_pages(vec![Grid { width: side(630), height: side(504) }]);
        let one = Bundle::from_bytes(ndgi::bundle::encode(&header, &payloads).unwrap()).unwrap();
        Arc::new(Bundle::from_bytes(one.repeated(pages).unwrap()).unwrap())
    };
    Arc::new(Pyramid::new((0..3).map(level).collect()).unwrap())
}

fn main() {
    println!("tiles    view   µs a step: median   99 %   most    µs of Pyramid::at");
    for pages in [5, 150, 750] {
        let pyramid = pyramid(pages);
        for view in [30u32, 150] {
            let mut stream = Stream::new(Arc::clone(&pyramid), Budgets::default()).unwrap();
            let mut answers: Vec<Completion> = Vec::new();
            let mut times = Vec::new();
            for step in 0..STEPS {
                // The view moves on by a tile every four steps; a minute of the day per second.
                let first = step as u32 / 4;
                let tile = |i: u32| Tile((first + i) % (20 * pages as u32));
                let seen: Vec<Seen> = (0..view).map(|i| Seen { tile: tile(i), pixels: 1 + i % 7 }).collect();
                let hour = 6.0 + step as f64 / 1800.0;
                let began = Instant::now();
                let commands = stream.step(Some(&seen), &answers, hour).unwrap();
                times.push(began.elapsed().as_secs_f64() * 1e6);
                answers = commands
                    .reads
                    .iter()
                    .map(|read| Completion { ticket: read.ticket, answer: Answer::Arrived })
                    .collect();
            }
            let began = Instant::now();
            (0..100).for_each(|i| drop(pyramid.at(6.0 + f64::from(i) / 100.0).unwrap()));
            let at = began.elapsed().as_secs_f64() * 1e4;
            times.sort_by(f64::total_cmp);
            println!(
                "{:6} {view:6} {:18.0} {:7.0} {:6.0} {at:18.1}",
                pyramid.tiles(),
                times[STEPS / 2],
                times[STEPS * 99 / 100],
                times[STEPS - 1]
            );
        }
    }
}
