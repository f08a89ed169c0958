//! Several pages, and pages of extreme shapes.

use super::instances::{check_placements, room};
use super::*;
use crate::atlas::{charts, density, unwraps};

fn several(width: u32, height: u32, pages: u32) -> Lightmap {
    Lightmap { pages, ..fixed(width, height) }
}

/// The pages that hold faces of each instance are those of its placements, ascending, and no page is empty.
fn check_pages(geometry: &Geometry, atlas: &Atlas) {
    let mut seen = vec![false; atlas.pages as usize];
    for (instance, placements) in geometry.instances.iter().zip(&atlas.placements) {
        let faces = atlas.faces.iter().filter(|f| instance.triangles.contains(&(f.triangle as usize)));
        let mut pages: Vec<u32> = faces.map(|face| atlas.page_of(face)).collect();
        pages.sort_unstable();
        pages.dedup();
        assert!(placements.iter().map(|p| p.page).eq(pages.iter().copied()), "{placements:?} {pages:?}");
        pages.iter().for_each(|&page| seen[page as usize] = true);
    }
    assert!(seen.iter().all(|&s| s), "{seen:?}");
}

#[test]
fn boxes_on_several_pages_stay_whole_and_as_dense() {
    let geometry = boxes(200, 1.0);
    for (width, height, pages) in [(128, 96, 3), (129, 61, 5), (101, 128, 2)] {
        let atlas = build(&geometry, &several(width, height, pages)).unwrap();
        let stride = (height + 2).next_multiple_of(128);
        assert_eq!((atlas.pages, atlas.page_height, atlas.stride), (pages, height, stride));
        assert_eq!(atlas.page_rows(1), stride..stride + height);
        let touched = check(&geometry, &atlas, 2);
        check_pages(&geometry, &atlas);
        assert!((touched - atlas.utilisation).abs() < 0.02, "{touched} against {}", atlas.utilisation);
        assert!(atlas.placements.iter().all(|p| p.len() == 1));
        // One page of as many texels takes them hardly any larger.
        let one = build(&geometry, &fixed(width, height * pages)).unwrap();
        let ratio = atlas.texels_per_metre / one.texels_per_metre;
        assert!(ratio > 0.92 && ratio < 1.05, "{width} x {height} x {pages}: {ratio}");
    }
}

#[test]
fn shared_layouts_lie_on_one_page_each() {
    let geometry = room();
    for padding in [2, 5] {
        let atlas = build(&geometry, &Lightmap { padding, ..several(300, 256, 3) }).unwrap();
        assert_eq!(atlas.pages, 3);
        check(&geometry, &atlas, padding.into());
        // The floor takes more than a page's share and may be cut; the chairs never are.
        check_pages(&geometry, &atlas);
        check_placements(&geometry, &atlas);
        let layouts: Vec<_> = atlas.placements.iter().map(|p| p[0].layout).collect();
        assert_eq!(layouts, [None, Some(0), Some(0), Some(0), None, Some(0), None]);
    }
}

#[test]
fn a_mesh_too_large_for_one_page_is_spread() {
    let mut geometry = Geometry::default();
    let mut noise = Noise(5);
    let walls: Vec<_> = (0..60).flat_map(|_| cuboid(noise.point() * 90.0, noise.point() + 0.2)).collect();
    add(&mut geometry, &walls);
    add(&mut geometry, &cuboid(DVec3::splat(200.0), DVec3::ONE));
    let atlas = build(&geometry, &several(128, 128, 3)).unwrap();
    check(&geometry, &atlas, 2);
    check_pages(&geometry, &atlas);
    assert_eq!((atlas.placements[0].len(), atlas.placements[1].len()), (3, 1));
    let one = build(&geometry, &fixed(128, 128)).unwrap();
    let gain = atlas.texels_per_metre / one.texels_per_metre;
    // √3 by area, and more where padding counts.
    assert!(gain > 1.6, "{gain}");
}

#[test]
fn what_is_near_in_space_is_near_on_pages_of_a_given_density() {
    let (mut geometry, mut noise) = (Geometry::default(), Noise(9));
    let mut corner = Vec::new();
    for _ in 0..700 {
        let (at, size) = (noise.point() * 40.0, noise.point() + 0.2);
        corner.extend((at.max_element() < 20.0).then_some(geometry.instances.len()));
        add(&mut geometry, &cuboid(at, size));
    }
    let size = LightmapSize::TexelsPerMetre(12.0);
    let atlas = build(&geometry, &Lightmap { size, ..fixed(1, 1) }).unwrap();
    check(&geometry, &atlas, 2);
    let tiles = (atlas.width.div_ceil(128) * atlas.height.div_ceil(128)) as usize;
    let of_corner = |face: &&crate::atlas::Face| {
        corner.iter().any(|&i| geometry.instances[i].triangles.contains(&(face.triangle as usize)))
    };
    let tile = |corner: &Vec2| (corner.x as u32 / 128, corner.y as u32 / 128);
    let touched: std::collections::BTreeSet<(u32, u32)> =
        atlas.faces.iter().filter(of_corner).flat_map(|face| face.corners.each_ref().map(tile)).collect();
    // An eighth of the boxes. (By size alone they lie all over the page.)
    assert!(tiles >= 25 && touched.len() * 2 < tiles, "{} of {tiles} tiles", touched.len());
}

#[test]
fn pages_that_would_be_empty_are_left_out() {
    let mut geometry = Geometry::default();
    add(&mut geometry, &quad(DVec3::ZERO, DVec3::X, DVec3::Z));
    let atlas = build(&geometry, &several(40, 30, 3)).unwrap();
    assert_eq!((atlas.pages, atlas.height, atlas.stride), (1, 30, 30));
    assert!(atlas.notes[0].contains("1 of the 3 pages"), "{:?}", atlas.notes);
    check(&geometry, &atlas, 2);
    check_pages(&geometry, &atlas);
}

#[test]
fn a_density_gets_the_pages_it_needs() {
    let geometry = boxes(100, 1.0);
    let meshes = charts::flatten(&geometry, &[], &unwraps::AlwaysUnwrap).unwrap().meshes;
    let grown = |pages, density| density::grow(&meshes, density, pages, 2, 128);
    let one = grown(1, 1.0).unwrap();
    assert_eq!((one.pages, one.width % 4, one.height % 4), (1, 0, 0));
    // As many as needed, not as many as allowed.
    let pages = [1.0, 4.0, 12.0].map(|density| grown(40, density).unwrap().pages);
    assert!(pages[0] == 1 && pages[1] > 1 && pages[2] > pages[1] && pages[2] < 40, "{pages:?}");
    assert!(grown(pages[2] - 1, 12.0).is_err());
    // Where they are too few, both remedies the message names help.
    let what = grown(1, 12.0).err().unwrap().to_string();
    let number = |after: &str| -> f64 {
        let rest = what.split(after).nth(1).unwrap_or_else(|| panic!("{what}"));
        rest.trim_end_matches('`').split([' ', '`']).next().unwrap().parse().unwrap()
    };
    assert!(grown(number("`pages = ") as u32, 12.0).is_ok(), "{what}");
    assert!(grown(1, number("about ")).is_ok(), "{what}");
    // More pages are no help for a chart longer than any.
    let what = grown(3, 1e4).err().unwrap().to_string();
    assert!(!what.contains("`pages"), "{what}");
}

#[test]
fn the_thread_count_does_not_matter_on_several_pages() {
    let geometry = boxes(60, 1.0);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build(&geometry, &several(90, 90, 3)).unwrap())
    };
    let (one, four) = (run(1), run(4));
    assert_eq!(one.texels_per_metre.to_bits(), four.texels_per_metre.to_bits());
    assert_eq!(one.placements, four.placements);
    assert!(one.faces.iter().zip(&four.faces).all(|(a, b)| a.corners == b.corners && a.chart == b.chart));
}

#[test]
fn promises_hold_far_down_the_virtual_page() {
    // Beyond row 32768 corners are rounded to 1/512 of a texel.
    let geometry = boxes(60, 1.0);
    let atlas = build(&geometry, &several(64, 9001, 4)).unwrap();
    assert_eq!((atlas.pages, atlas.stride, atlas.height), (4, 9088, 3 * 9088 + 9001));
    check(&geometry, &atlas, 2);
    check_pages(&geometry, &atlas);
    let what = build(&geometry, &several(64, 16384, 8)).unwrap_err();
    assert!(matches!(what, Error::Unsupported { .. }) && what.to_string().contains("131072"), "{what}");
}

#[test]
fn extreme_pages() {
    let mut geometry = Geometry::default();
    add(&mut geometry, &[[DVec3::ZERO, DVec3::X, DVec3::Z]]);
    // Almost all of it is empty: a triangle is as large as the shorter side allows.
    for (width, height) in [(16384, 256), (256, 16384)] {
        let atlas = build(&geometry, &fixed(width, height)).unwrap();
        check_pages(&geometry, &atlas);
        assert!(atlas.utilisation < 0.02 && atlas.texels_per_metre > 240.0, "{}", atlas.texels_per_metre);
    }
    // One texel has no room for a chart, which ends half a texel inside the page; four have.
    for (width, height) in [(1, 1), (1, 64), (64, 1)] {
        let what = build(&geometry, &fixed(width, height)).unwrap_err();
        assert!(matches!(what, Error::Unsupported { .. }), "{what}");
        assert!(what.to_string().contains("at least 2 x 2"), "{what}");
    }
    let atlas = build(&geometry, &fixed(2, 2)).unwrap();
    check(&geometry, &atlas, 2);
    // Odd sides.
    for (width, height) in [(3, 5), (127, 1023), (129, 7)] {
        check(&geometry, &build(&geometry, &several(width, height, 1)).unwrap(), 2);
    }
    // No pages asked for: one.
    assert_eq!(build(&geometry, &several(16, 16, 0)).unwrap().pages, 1);
}
