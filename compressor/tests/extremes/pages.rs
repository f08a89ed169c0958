//! Where: masks, borders, one texel.

use crate::case::Case;
use compressor::compress::{Options, compress};
use dataset::observe::Silent;

fn light(k: usize, x: usize, y: usize) -> [f32; 3] {
    let day = 1.0 + (k as f32 * 0.7).sin();
    let soft = 1.0 + 0.4 * (x as f32 * 0.11).sin() * (y as f32 * 0.07).cos();
    [day * soft + 0.1, day * soft * 0.8 + 0.1, 0.3 * soft]
}

#[test]
fn one_valid_texel_of_a_tile_is_met() {
    let error = Case::new(128, 128, 12, light).valid(|x, y| (x, y) == (77, 40)).run().worst_relative_error();
    assert!(error < 0.01, "{error}");
}

#[test]
fn an_edge_tile_of_one_texel_is_met() {
    // 127 × 127 texels: the last tile owns the corner alone.
    let corner = |x: usize, y: usize| (x, y) == (126, 126);
    let result = Case::new(127, 127, 12, light).valid(corner).run();
    assert_eq!(result.outcome.tiles, 4);
    let alone = Case::new(1, 1, 12, light).run();
    let errors = [result.worst_relative_error(), alone.worst_relative_error()];
    assert!(errors.iter().all(|e| *e < 0.01), "{errors:?}");
}

#[test]
fn a_mask_of_isolated_texels_is_met() {
    let sparse = Case::new(96, 96, 12, light).valid(|x, y| x % 7 == 3 && y % 7 == 5).run();
    let checkers = Case::new(96, 96, 12, light).valid(|x, y| (x + y) % 2 == 0).run();
    let errors = [sparse, checkers].map(|result| result.worst_relative_error());
    assert!(errors.iter().all(|e| *e < 0.01), "{errors:?}");
}

#[test]
fn the_borders_of_pages_are_as_good_as_their_middle() {
    for (width, height) in [(127, 5), (126, 126), (129, 130), (3, 260)] {
        let result = Case::new(width, height, 6, light).run();
        let outer = |x: usize, y: usize| x == 0 || y == 0 || x == width - 1 || y == height - 1;
        for k in 0..6 {
            let error = result.relative_error(k, outer);
            assert!(error < 0.015, "{width} × {height}, set {k}: {error}");
        }
    }
}

#[test]
fn tiles_of_a_smooth_page_do_not_show() {
    let result = Case::new(252, 252, 6, light).run();
    // Mean step between neighbours at borders of tiles over that inside tiles, as it is and as it should be.
    let ratio = |texels: &[[f32; 3]]| {
        let (mut steps, mut counts) = ([0.0f64; 2], [0.0f64; 2]);
        let mut step = |i: usize, j: usize, border: bool| {
            let difference = (0..3).map(|c| f64::from((texels[i][c] - texels[j][c]).abs()));
            steps[usize::from(border)] += difference.sum::<f64>();
            counts[usize::from(border)] += 1.0;
        };
        for y in 0..251 {
            for x in 0..251 {
                step(y * 252 + x, y * 252 + x + 1, x == 125);
                step(y * 252 + x, (y + 1) * 252 + x, y == 125);
            }
        }
        steps[1] / counts[1] / (steps[0] / counts[0])
    };
    for (decoded, reference) in result.decoded.iter().zip(&result.references) {
        let seam = ratio(&decoded.texels) / ratio(&reference.texels);
        assert!((0.9..1.1).contains(&seam), "{seam}");
    }
    // What is wrong with the steps: errors inside tiles are as smooth as this page, which has neither noise
    // nor texture. Of one training it is 1.3 to 2.0; the mean of these is known to 0.08. It was 1.68, and
    // 2.10 where texels beside another tile counted as others do.
    let ratio =
        |seed: u64| Case { seed, ..Case::new(252, 252, 6, light) }.run().evaluation.seam_ratio.unwrap();
    let mean = (0..8).map(ratio).sum::<f64>() / 8.0;
    assert!((0.5..1.9).contains(&mean), "{mean}");
}

#[test]
fn light_that_is_none_is_refused_with_its_place_and_value() {
    for (bad, said) in
        [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (f32::NEG_INFINITY, "-inf"), (-0.25, "-0.25")]
    {
        let folder = tempfile::tempdir().unwrap();
        let light = |k: usize, x: usize, y: usize| {
            if (k, x, y) == (1, 5, 7) { [1.0, bad, 1.0] } else { light(k, x, y) }
        };
        Case::new(20, 12, 3, light).write(folder.path());
        let message = compress(folder.path(), &Options::default(), &Silent).unwrap_err().to_string();
        for part in ["map-1", "texel (5, 7)", "channel G", said] {
            assert!(message.contains(part), "{part}: {message}");
        }
        assert!(!folder.path().join("case.ndgi").exists());
    }
}
