//! The shader against the decoder on the CPU: whole bundles.

use crate::common::*;
use ndgi::bundle::{self, Header, Payload};
use ndgi::decode::Lights;
use ndgi::grid::{Grid, Place};
use ndgi::model::{Contents, Profile};
use ndgi::{Bundle, testing};
use ndgi_gpu::{DecodeParams, Decoder, Options, Output, Page, Precision, Request, Target};

/// PSNR of a page against another, by its largest value.
fn psnr(found: &[[f32; 3]], expected: &[[f32; 3]]) -> f64 {
    let largest = expected.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
    let squares: f64 =
        found.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    10.0 * (f64::from(largest).powi(2) * (3 * found.len()) as f64 / squares.max(1e-300)).log10()
}

/// Midnight's wrap, both sides of a switch, between times of visibility and outside of them.
const HOURS: [f64; 9] = [0.0, 3.3, 5.95, 6.02, 6.7, 9.3, 12.0, 18.05, 23.95];

fn bundles() -> Vec<(String, Vec<u8>)> {
    let mut bundles = fixtures();
    bundles.push(("sunny".to_owned(), testing::sunny_bundle()));
    bundles.extend([16, 32, 64].map(|hidden| (format!("contents {hidden}"), testing::all_contents(hidden))));
    bundles
}

#[test]
fn bundles_of_planes_are_refused_with_what_to_do() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let bundle = Bundle::from_bytes(testing::basis_bundle()).unwrap();
    let refused =
        Decoder::new(&gpu.device, &gpu.queue, bundle, Options::default()).err().unwrap().to_string();
    assert!(refused.contains("planes (coding basis)") && refused.contains("--coding neural"), "{refused}");
}

#[test]
fn pages_are_those_of_the_cpu() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    for (name, bytes) in &bundles() {
        let mut decoder = gpu.decoder(bytes, Options::default());
        let all = [Lights::All, Lights::Baked, Lights::Sun];
        let lights = &all[..if decoder.bundle().header.sun.is_some() { 3 } else { 1 }];
        let mut largest = 0.0f32;
        for page in 0..decoder.bundle().header.pages.len() {
            let mut texture = decoder.page(page, Output::Rgba32Float).unwrap();
            for (hour, lights) in
                HOURS.iter().flat_map(|hour| lights.iter().map(move |lights| (hour, lights)))
            {
                let params = DecodeParams { lights: *lights, ..DecodeParams::at(*hour) };
                let found = gpu.floats(&mut decoder, &mut texture, &params);
                let worst = worst(&found, &by_cpu(decoder.bundle(), page, &params));
                assert!(worst <= 5e-5, "{name}, page {page}, {hour} h, {lights:?}: {worst:.1e}");
                largest = largest.max(worst);
            }
        }
        println!("{name}: at most {largest:.1e} of max(E, mean/100)");
    }
}

#[test]
fn half_precision_is_close_and_not_used_where_it_does_not_fit() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    if !gpu.has_half() {
        println!("skipped: the adapter has no 16-bit floats");
        return;
    }
    for (name, bytes) in &bundles() {
        let single = Options::default();
        let half = Options { precision: Precision::Half, ..single.clone() };
        let mut decoders = [gpu.decoder(bytes, single), gpu.decoder(bytes, half)];
        for hour in [0.0, 6.7, 12.0] {
            let [of_single, of_half] = decoders.each_mut().map(|decoder| {
                let mut texture = decoder.page(0, Output::Rgba32Float).unwrap();
                gpu.floats(decoder, &mut texture, &DecodeParams::at(hour))
            });
            let psnr = psnr(&of_half, &of_single);
            println!("{name}, {hour} h: {psnr:.1} dB");
            assert!(psnr >= 58.0, "{name}, {hour} h: {psnr:.1} dB");
            let is_black = of_single.iter().flatten().all(|e| *e == 0.0);
            assert!(is_black || of_half != of_single, "{name}, {hour} h: half precision was not used");
        }
    }
    // Weights that overflow in 16 bits: the same as in 32, to the bit.
    let mut header = Header { pages: vec![Grid { width: 30, height: 14 }], ..testing::header() };
    header.kinds.truncate(1);
    let place = Place { page: 0, column: 0, row: 0 };
    let mut tile = testing::tile(header.shape(place, &Profile::M.contents(4, 1)), 1);
    tile.mlp.iter_mut().for_each(|w| *w = ndgi::half::F16::from_f32(300.0 * w.to_f32()));
    tile.knots.push(testing::dusk());
    let bytes = bundle::encode(&header, &[bundle::encode_payload(&tile).unwrap()]).unwrap();
    let [of_single, of_half] = [Precision::Single, Precision::Half].map(|precision| {
        let mut decoder = gpu.decoder(&bytes, Options { precision, ..Options::default() });
        let mut texture = decoder.page(0, Output::Rgba32Float).unwrap();
        gpu.floats(&mut decoder, &mut texture, &DecodeParams::at(6.0))
    });
    assert!(of_half == of_single && of_single.iter().flatten().any(|e| *e > 1e6));
}

#[test]
fn blocks_unpacked_by_the_cpu_are_those_of_hardware() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    for bytes in [testing::sunny_bundle(), testing::all_contents(16)] {
        let [a, b] = [false, true].map(|unpacks| {
            let mut decoder = gpu.decoder(&bytes, Options { unpacks, ..Options::default() });
            let mut texture = decoder.page(0, Output::Rgba32Float).unwrap();
            gpu.floats(&mut decoder, &mut texture, &DecodeParams::at(9.3))
        });
        let largest = a.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
        assert!(largest > 0.0);
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!((a - b).abs() <= 2e-6 * a.max(0.01 * largest), "{a} {b}");
        }
    }
}

#[test]
fn outputs_are_rounded_as_the_cpu_rounds_them() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let mut decoder = gpu.decoder(&testing::sunny_bundle(), Options::default());
    let exposure = 1.0 / 64.0;
    let width = decoder.bundle().header.pages[0].width;
    let (mut differ, mut black, mut bytes) = (0, 0, 0);
    // By day; and at night, when tiles that have the sun alone are black.
    for hour in [9.3, 20.0] {
        let params = DecodeParams { exposure, ..DecodeParams::at(hour) };
        let mut page = decoder.page(0, Output::Rgba16Float).unwrap();
        let halves = gpu.decode(&mut decoder, &mut page, &params);
        let mut page = decoder.page(0, Output::Rgba8Unorm).unwrap();
        let eighths = gpu.decode(&mut decoder, &mut page, &params);
        bytes += eighths.len();
        let at = decoder.bundle().at(hour).unwrap();
        for place in decoder.bundle().header.places() {
            let tile = at.tile(place).unwrap();
            black += usize::from(tile.is_black());
            let mut of_halves = vec![[0; 4]; tile.width() * tile.height()];
            let mut of_eighths = vec![[0; 4]; tile.width() * tile.height()];
            tile.decode_rgba16f(exposure, &mut of_halves);
            tile.decode_rgba8(1.0 / exposure, &mut of_eighths);
            let corner = ndgi::model::PAYLOAD * (place.row * width + place.column);
            for i in 0..of_halves.len() {
                let texel = corner + i / tile.width() * width + i % tile.width();
                for c in 0..4 {
                    let found =
                        u16::from_le_bytes([halves[8 * texel + 2 * c], halves[8 * texel + 2 * c + 1]]);
                    // Hardware may cut instead of rounding.
                    assert!(found.abs_diff(of_halves[i][c]) <= 1, "{found:x} {:x}", of_halves[i][c]);
                    let byte = eighths[4 * texel + c];
                    assert!(byte.abs_diff(of_eighths[i][c]) <= 1, "{byte} {}", of_eighths[i][c]);
                    differ += usize::from(byte != of_eighths[i][c]);
                }
            }
        }
    }
    assert!(differ < bytes / 100 && black == 2, "{differ} {black}");
}

#[test]
fn black_tiles_are_not_dispatched_and_leave_nothing_stale() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let mut decoder = gpu.decoder(&testing::sunny_bundle(), Options::default());
    let mut page = decoder.page(0, Output::Rgba32Float).unwrap();
    let mut work = |page: &mut Page, hour, lights| {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let work = decoder
            .decode_page(&mut encoder, page, &DecodeParams { lights, ..DecodeParams::at(hour) })
            .unwrap();
        gpu.queue.submit([encoder.finish()]);
        work
    };
    // Six tiles: two have the sun alone, one the maps alone, the others both.
    let noon = work(&mut page, 12.0, Lights::All);
    assert_eq!((noon.tiles, noon.networks, noon.black.len()), (6, 4, 0));
    // Within an interval a job a tile is all that is uploaded.
    let later = work(&mut page, 12.5, Lights::All);
    assert!(later.bytes < noon.bytes && later.bytes <= 6 * 400, "{} {}", later.bytes, noon.bytes);
    let night = work(&mut page, 20.0, Lights::All);
    assert_eq!((night.tiles, night.networks, night.black.len()), (4, 4, 2));
    let found = gpu.read(&page.texture);
    let expected = {
        let mut fresh = decoder.page(0, Output::Rgba32Float).unwrap();
        gpu.decode(&mut decoder, &mut fresh, &DecodeParams::at(20.0))
    };
    assert!(found == expected);
}

#[test]
fn what_was_not_uploaded_is_uploaded_by_the_next_call() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let mut decoder = gpu.decoder(&testing::sunny_bundle(), Options::default());
    let mut page = decoder.page(0, Output::Rgba32Float).unwrap();
    let is_right = |decoder: &mut Decoder, page: &mut Page, hour| {
        let params = DecodeParams::at(hour);
        let found = gpu.floats(decoder, page, &params);
        let worst = worst(&found, &by_cpu(decoder.bundle(), 0, &params));
        assert!(worst <= 5e-5, "{hour} h: {worst:.1e}");
    };
    is_right(&mut decoder, &mut page, 6.7);
    // In another interval, a request after all tiles is refused.
    let request = |place| Request { place, to: [0, 0], with_border: false };
    let mut requests: Vec<Request> = decoder.bundle().header.places().map(request).collect();
    requests.push(request(Place { page: 3, column: 0, row: 0 }));
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let target = Target { view: page.view(), output: Output::Rgba32Float };
    assert!(decoder.decode(&mut encoder, &requests, target, &DecodeParams::at(8.1)).is_err());
    gpu.queue.submit([encoder.finish()]);
    is_right(&mut decoder, &mut page, 8.1);
    // An encoder is dropped: with new visibility, and with tiles that had light and are black.
    for (dropped, next) in [(11.0, 11.0), (20.0, 20.0), (8.1, 20.0), (8.1, 8.1)] {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        decoder.decode_page(&mut encoder, &mut page, &DecodeParams::at(dropped)).unwrap();
        drop(encoder);
        decoder.forget();
        is_right(&mut decoder, &mut page, next);
    }
}

#[test]
fn tall_tiles_do_not_read_a_row_of_the_map_too_many() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    // Stored heights at which rounding puts the first texel of a strip above its place on a map as large as
    // the tile.
    let pages: Vec<Grid> =
        [76, 84, 92, 100, 108].map(|height| Grid { width: 126, height: height - 2 }).into();
    let mut header = Header { pages, ..testing::header() };
    header.kinds = vec![header.kinds[0]; 5];
    let contents = Contents { uvt: 128, slices: 2, gates: 0, ..Profile::M.contents(4, 1) };
    let payload = |place: Place| {
        let mut tile = testing::tile(header.shape(place, &contents), place.page as u64);
        tile.knots.push(testing::dusk());
        bundle::encode_payload(&tile).unwrap()
    };
    let payloads: Vec<Payload> = header.places().map(payload).collect();
    let mut decoder = gpu.decoder(&bundle::encode(&header, &payloads).unwrap(), Options::default());
    for (page, grid) in header.pages.iter().enumerate() {
        let place = Place { page, column: 0, row: 0 };
        let texture = gpu.texture(128, grid.height as u32 + 2);
        let target = Target { view: &texture.create_view(&Default::default()), output: Output::Rgba32Float };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let request = Request { place, to: [0, 0], with_border: true };
        decoder.decode(&mut encoder, &[request], target, &DecodeParams::at(6.0)).unwrap();
        gpu.queue.submit([encoder.finish()]);
        let found = floats_of(&gpu.read(&texture));
        // All stored texels: the last column, a border, reads the end of the array.
        let tile = decoder.bundle().at(6.0).unwrap().tile(place).unwrap();
        let mean = decoder.bundle().knots(place).unwrap()[2].mean;
        let centre = |i: usize| [i % 128, i / 128].map(|at| at as f32 - 0.5);
        let expected = |i| {
            let [x, y] = centre(i);
            (tile.sample(x, y), mean)
        };
        let expected: Vec<_> = (0..found.len()).map(expected).collect();
        let worst = worst(&found, &expected);
        assert!(worst <= 2e-4, "{} rows: {worst:.1e}", grid.height + 2);
    }
}

#[test]
fn tiles_come_where_they_are_asked_for_with_their_border() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let mut decoder = gpu.decoder(&testing::sunny_bundle(), Options::default());
    let texture = gpu.texture(300, 140);
    let view = texture.create_view(&Default::default());
    let target = Target { view: &view, output: Output::Rgba32Float };
    let place = Place { page: 0, column: 1, row: 0 };
    let request = |to, with_border| Request { place, to, with_border };
    let requests = [request([5, 7], true), request([150, 7], false)];
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let params = DecodeParams::at(9.3);
    decoder.decode(&mut encoder, &requests, target, &params).unwrap();
    gpu.queue.submit([encoder.finish()]);
    let bytes = gpu.read(&texture);
    let texel = |x: usize, y: usize| &bytes[16 * (y * 300 + x)..][..16];
    let mut lit = 0;
    for (x, y) in (0..126).flat_map(|y| (0..126).map(move |x| (x, y))) {
        assert_eq!(texel(6 + x, 8 + y), texel(150 + x, 7 + y), "({x}, {y})");
        lit += usize::from(texel(150 + x, 7 + y)[..12] != [0; 12]);
    }
    assert!(lit > 10_000, "{lit}");
    // The border is written, and nothing beyond; without one the payload alone.
    let is_written = |x: usize, y: usize| texel(x, y)[12..] != [0; 4];
    assert!(is_written(5, 7) && is_written(132, 134) && !is_written(4, 7) && !is_written(133, 134));
    assert!(is_written(150, 7) && is_written(275, 132) && !is_written(149, 7) && !is_written(276, 132));
    // What makes no sense is refused.
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    for (hour, exposure) in [(f64::NAN, 1.0), (6.0, f32::NAN), (6.0, -1.0)] {
        let params = DecodeParams { exposure, ..DecodeParams::at(hour) };
        assert!(decoder.decode(&mut encoder, &requests, target, &params).is_err());
    }
    let nowhere = Request { place: Place { page: 3, ..place }, to: [0, 0], with_border: false };
    assert!(decoder.decode(&mut encoder, &[nowhere], target, &params).is_err());
    assert!(decoder.page(7, Output::Rgba8Unorm).is_err());
}

#[test]
fn changed_bundles_are_errors_or_light() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let (header, payloads) = testing::sunny();
    let (mut random, mut refused, options) =
        (testing::Random(5), 0, Options { pipelines: gpu.pipelines.clone(), ..Options::default() });
    for _ in 0..200 {
        // Sections are changed before their checksums are made.
        let mut bad = payloads.clone();
        for _ in 0..1 + random.below(3) {
            let payload = random.below(bad.len());
            let Payload { maps, sun, shadows, .. } = &mut bad[payload];
            let section = [maps, sun, shadows].into_iter().nth(random.below(3)).unwrap();
            if !section.bytes.is_empty() {
                let near =
                    if random.below(2) == 0 { 60.min(section.bytes.len()) } else { section.bytes.len() };
                section.bytes[random.below(near)] = random.byte();
            }
        }
        let bundle = Bundle::from_bytes(bundle::encode(&header, &bad).unwrap()).unwrap();
        match Decoder::new(&gpu.device, &gpu.queue, bundle, options.clone()) {
            Ok(mut decoder) => {
                let mut page = decoder.page(0, Output::Rgba32Float).unwrap();
                let found = gpu.floats(&mut decoder, &mut page, &DecodeParams::at(9.3));
                assert!(found.iter().flatten().all(|e| e.is_finite() && *e >= 0.0));
            }
            Err(_) => refused += 1,
        }
    }
    assert!((1..200).contains(&refused), "{refused}");
}

#[test]
fn nothing_and_the_smallest_are_decoded_too() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    // One texel; and a page whose tiles are all black.
    let header = |width, height| {
        let mut header = Header { pages: vec![Grid { width, height }], ..testing::header() };
        header.kinds.truncate(1);
        header
    };
    let place = Place { page: 0, column: 0, row: 0 };
    let of_one = header(1, 1);
    let mut tile = testing::tile(of_one.shape(place, &Contents::NONE), 3);
    tile.knots.push(testing::dusk());
    let one = bundle::encode(&of_one, &[bundle::encode_payload(&tile).unwrap()]).unwrap();
    let black = bundle::encode(&header(200, 5), &[Payload::default(), Payload::default()]).unwrap();
    for (bytes, tiles) in [(one, 1), (black, 0)] {
        let mut decoder = gpu.decoder(&bytes, Options::default());
        let mut page = decoder.page(0, Output::Rgba32Float).unwrap();
        let found = gpu.floats(&mut decoder, &mut page, &DecodeParams::at(5.0));
        let expected = by_cpu(decoder.bundle(), 0, &DecodeParams::at(5.0));
        assert!(worst(&found, &expected) <= 5e-5);
        assert_eq!(found.iter().flatten().any(|e| *e > 0.0), tiles > 0);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let target = Target { view: page.view(), output: Output::Rgba32Float };
        let work = decoder.decode(&mut encoder, &[], target, &DecodeParams::at(5.0)).unwrap();
        assert_eq!((work.tiles, work.bytes), (0, 0));
        assert_eq!(decoder.clear(&mut encoder, &[], target).unwrap().bytes, 0);
        gpu.queue.submit([encoder.finish()]);
    }
}
