//! Prepared tiles and pages against the decoder that reads one texel by the formulas, on real bundles, with
//! and without a sun.

use ndgi::Bundle;
use ndgi::bundle::MapCoding;
use ndgi::decode::{Decoder, Lights};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn bundles() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = std::fs::read_dir(root.join("../../tests/fuzz/corpus/bundle")).unwrap();
    let files = files.map(|file| file.unwrap().path()).filter(|path| Bundle::open(path).is_ok());
    let mut files: Vec<_> = files.collect();
    files.sort();
    assert!(files.len() >= 4, "{files:?}");
    files
}

fn assert_close(found: [f32; 3], expected: [f32; 3], scale: f32, what: &str) {
    for c in 0..3 {
        let bound = 1e-4 * expected[c].abs().max(scale);
        assert!((found[c] - expected[c]).abs() <= bound, "{what}: {found:?}, expected {expected:?}");
    }
}

#[test]
fn pages_and_tiles_give_what_the_decoder_gives() {
    let mut suns = 0;
    for path in bundles() {
        let decoder = Decoder::open(&path).unwrap();
        let bundle = decoder.bundle();
        suns += usize::from(bundle.header.sun.is_some());
        for hour in [0.0, 6.02, 9.3, 12.0, 18.1, 23.95] {
            for lights in [Lights::All, Lights::Baked, Lights::Sun] {
                let at = bundle.at(hour).unwrap().only(lights);
                for place in bundle.header.places() {
                    let what = format!("{}, {hour} h, {lights:?}, {place:?}", path.display());
                    let page = decoder.decode_page_of(lights, place.page, hour).unwrap();
                    let tile = at.tile(place).unwrap();
                    let mut texels = vec![[0.0; 3]; tile.width() * tile.height()];
                    tile.decode_into(&mut texels);
                    let corner = [place.column, place.row].map(|i| i * ndgi::model::PAYLOAD);
                    let largest = texels.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
                    assert!(!tile.is_black() || largest == 0.0);
                    for (i, texel) in texels.iter().enumerate() {
                        let [x, y] = [i % tile.width(), i / tile.width()];
                        // Whole tiles are the same to the bit, single texels but for the order of sums.
                        assert_eq!(
                            *texel,
                            page.texels[(corner[1] + y) * page.width + corner[0] + x],
                            "{what}"
                        );
                        if i % 7 == 0 {
                            assert_close(tile.texel(x, y), *texel, 0.01 * largest, &what);
                            let centre = tile.sample(x as f32 + 0.5, y as f32 + 0.5);
                            assert_close(centre, *texel, 0.01 * largest, &what);
                        }
                    }
                }
            }
            for page in 0..bundle.header.pages.len() {
                let whole = decoder.decode_page(page, hour).unwrap();
                let mean = whole.texels.iter().flatten().sum::<f32>() / (3 * whole.texels.len()) as f32;
                let mut sampler = bundle.at(hour).unwrap().page(page).unwrap().keeping(2);
                for i in 0..200 {
                    let [u, v] = [(i * 37 % 200) as f32 / 199.0, (i * 61 % 200) as f32 / 199.0];
                    let expected = decoder.sample(page, u.into(), v.into(), hour).unwrap();
                    let what = format!("{}, {hour} h, page {page}, ({u}, {v})", path.display());
                    assert_close(sampler.sample(u, v).unwrap(), expected, 0.01 * mean, &what);
                }
                assert!(sampler.texel(sampler.width(), 0).is_err());
            }
        }
    }
    assert!(suns > 0);
}

#[test]
fn what_is_not_a_number_is_an_error_and_what_is_beyond_a_page_is_its_edge() {
    let bundle = Bundle::open(&bundles()[0]).unwrap();
    for hour in [f64::NAN, f64::INFINITY] {
        assert!(bundle.at(hour).unwrap_err().to_string().contains("expected a finite number"));
    }
    let at = bundle.at(30.5).unwrap();
    let mut page = at.page(0).unwrap();
    assert_eq!(page.sample(f32::NAN, 0.5).unwrap_err().to_string(), "u: NaN; expected a number");
    assert_eq!(page.sample(0.5, f32::NAN).unwrap_err().to_string(), "v: NaN; expected a number");
    assert_eq!(page.sample(-3.0, 0.0).unwrap(), page.sample(0.0, f32::NEG_INFINITY).unwrap());
    assert_eq!(
        page.sample(0.3, 0.3).unwrap(),
        bundle.at(6.5).unwrap().page(0).unwrap().sample(0.3, 0.3).unwrap()
    );
    // A page and a tile that the bundle does not have: how many it has is said.
    let missing = bundle.header.pages.len();
    let nowhere = ndgi::grid::Place { page: missing, column: 0, row: 0 };
    for error in [at.page(missing).unwrap_err(), at.tile(nowhere).unwrap_err()] {
        let expected = format!("page {missing}: the bundle has {missing} page");
        assert!(error.to_string().contains(&expected), "{error}");
    }
    let nowhere = ndgi::grid::Place { page: 0, column: 1000, row: 0 };
    let (error, grid) = (at.tile(nowhere).unwrap_err().to_string(), bundle.grid(0).unwrap());
    let expected = format!(
        "page 0, tile (1000, 0): no such tile; the page has {} × {}, counted from 0",
        grid.columns(),
        grid.rows()
    );
    assert!(error.ends_with(&expected), "{error}");
    let error = Bundle::from_bytes(vec![0; 10]).unwrap_err().to_string();
    assert_eq!(error, "bundle: 10 bytes; expected at least 32: it is not a bundle, or cut short");
}

#[test]
fn a_bundle_is_read_from_memory_and_from_what_reads_at_an_offset() {
    #[derive(Debug)]
    struct Archive(Vec<u8>);
    impl ndgi::source::ReadAt for Archive {
        fn size(&self) -> std::io::Result<u64> {
            Ok(self.0.len() as u64 - 100)
        }
        fn read_at(&self, offset: u64, bytes: &mut [u8]) -> std::io::Result<()> {
            let from = 100 + offset as usize;
            bytes.copy_from_slice(&self.0[from..from + bytes.len()]);
            Ok(())
        }
    }
    for path in bundles() {
        let bytes = std::fs::read(&path).unwrap();
        let of_archive = Bundle::from_source(Archive([vec![7; 100], bytes.clone()].concat())).unwrap();
        let shared: Arc<[u8]> = bytes.into();
        let (of_memory, of_file) = (Bundle::from_bytes(shared).unwrap(), Bundle::open(&path).unwrap());
        for place in of_file.header.places() {
            if of_file.header.coding == MapCoding::Basis {
                let sets = of_file.sets(place).unwrap();
                assert!(sets == of_memory.sets(place).unwrap() && sets == of_archive.sets(place).unwrap());
                continue;
            }
            let tile = of_file.tile(place).unwrap();
            assert!(tile == of_memory.tile(place).unwrap() && tile == of_archive.tile(place).unwrap());
        }
    }
}

#[test]
fn formats_of_textures_hold_the_light() {
    let path = bundles().pop().unwrap();
    let bundle = Bundle::open(&path).unwrap();
    let at = bundle.at(12.0).unwrap();
    let place = bundle.header.places().find(|&place| !at.tile(place).unwrap().is_black()).unwrap();
    let tile = at.tile(place).unwrap();
    let count = tile.width() * tile.height();
    let mut light = vec![[0.0; 3]; count];
    tile.decode_into(&mut light);
    let peak = light.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
    let (mut halves, mut shared, mut bytes) = (vec![[0; 4]; count], vec![0; count], vec![[0; 4]; count]);
    tile.decode_rgba16f(1.0 / peak, &mut halves);
    tile.decode_rgb9e5(1.0 / peak, &mut shared);
    tile.decode_rgba8(peak, &mut bytes);
    for i in 0..count {
        for c in 0..3 {
            let expected = light[i][c] / peak;
            let half = ndgi::half::F16::from_bits(halves[i][c]).to_f32();
            assert!((half - expected).abs() <= 5e-4 * expected.max(1e-4), "{half} {expected}");
            let step = ((shared[i] >> 27) as f32 - 24.0).exp2();
            let nine = (shared[i] >> (9 * c) & 511) as f32 * step;
            assert!((nine - expected).abs() <= 0.502 * step, "{nine} {expected}");
            let eight = f32::from(bytes[i][c]) / 255.0;
            assert!((eight - expected.sqrt()).abs() <= 0.51 / 255.0, "{eight} {expected}");
        }
    }
}
