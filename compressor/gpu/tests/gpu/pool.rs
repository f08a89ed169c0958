//! Tiles that come and go, against the decoder on the CPU.

use crate::common::*;
use ndgi::Bundle;
use ndgi::bundle::{self, Payload};
use ndgi::decode::Lights;
use ndgi::grid::{Grid, Place};
use ndgi::model::{BORDER, STORED};
use ndgi::sun::{Coder, Shadows, TileSun};
use ndgi::testing::{self, Random};
use ndgi_gpu::{
    DecodeParams, Error, Features, Interval, Options, Output, Pool, Request, SlotRequest, Target, Work,
};
use std::sync::Arc;

/// Nine hours of the day: night, both sides of switches, between times of visibility and outside of them.
const HOURS: [f64; 9] = [0.0, 3.3, 5.95, 6.02, 6.7, 9.3, 12.0, 18.05, 23.95];

fn opened(bytes: Vec<u8>) -> Arc<Bundle> {
    Arc::new(Bundle::from_bytes(bytes).unwrap())
}

fn place(column: usize, row: usize) -> Place {
    Place { page: 0, column, row }
}

/// A pool, and a texture on which its slots' tiles stand side by side.
struct Bench {
    gpu: &'static Gpu,
    pool: Pool,
    texture: wgpu::Texture,
}

impl Bench {
    fn new(gpu: &'static Gpu, bundles: &[Arc<Bundle>], slots: u32, unpacks: bool) -> Self {
        let options = Options { unpacks, pipelines: gpu.pipelines.clone(), ..Options::default() };
        let pool = Pool::new(&gpu.device, &gpu.queue, bundles, slots, options).unwrap();
        let texture = gpu.texture(slots * STORED as u32, STORED as u32);
        Bench { gpu, pool, texture }
    }

    fn read(&self, bundle: usize, place: Place) -> Result<Features, Error> {
        Features::read(&self.pool.bundles()[bundle], place, self.pool.options())
    }

    /// Reads a tile into a slot, and what it sees of the sun in an interval.
    fn load(
        &mut self,
        slot: u32,
        bundle: usize,
        place: Place,
        times: Option<[usize; 2]>,
    ) -> Result<(), Error> {
        let features = self.read(bundle, place)?;
        self.pool.load(&self.gpu.queue, slot, bundle, &features)?;
        assert_eq!(self.pool.interval_of(slot), None);
        let Some(times) = times else { return Ok(()) };
        let interval = features.interval(&self.pool.bundles()[bundle], times)?;
        self.pool.set_interval(&self.gpu.queue, slot, &interval)?;
        assert_eq!(self.pool.interval_of(slot), Some(times));
        Ok(())
    }

    /// Decodes slots, and gives the whole texture.
    fn decode(&mut self, slots: &[u32], params: &DecodeParams) -> (Work<SlotRequest>, Vec<[f32; 4]>) {
        let request = |slot: &u32| SlotRequest {
            slot: *slot,
            to: [(slot * STORED as u32) as i32, 0],
            with_border: false,
        };
        let requests: Vec<SlotRequest> = slots.iter().map(request).collect();
        let view = self.texture.create_view(&Default::default());
        let target = Target { view: &view, output: Output::Rgba32Float };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let work = self.pool.decode(&mut encoder, &requests, target, params).unwrap();
        self.gpu.queue.submit([encoder.finish()]);
        let bytes = self.gpu.read(&self.texture);
        let float = |four: &[u8]| f32::from_le_bytes(four.try_into().unwrap());
        (work, bytes.chunks(16).map(|texel| [0, 4, 8, 12].map(|at| float(&texel[at..at + 4]))).collect())
    }

    /// The own texels of a slot's tile.
    fn texels(&self, texture: &[[f32; 4]], slot: u32, bundle: usize, place: Place) -> Vec<[f32; 3]> {
        let (width, height) =
            self.pool.bundles()[bundle].header.pages[place.page].payload(place.column, place.row);
        let across = self.texture.width() as usize;
        let texel = |i: usize| texture[i / width * across + slot as usize * STORED + i % width];
        (0..width * height)
            .map(|i| {
                let [r, g, b, alpha] = texel(i);
                assert_eq!(alpha, 1.0, "texel {i} of slot {slot} was not written");
                [r, g, b]
            })
            .collect()
    }

    /// That a slot's tile is what the CPU decodes.
    fn is_right(
        &self,
        texture: &[[f32; 4]],
        slot: u32,
        (bundle, place): (usize, Place),
        params: &DecodeParams,
    ) {
        let found = self.texels(texture, slot, bundle, place);
        let of = &self.pool.bundles()[bundle];
        let at = of.at(params.hour).unwrap().only(params.lights);
        let worst = worst(&found, &tile_by_cpu(&at, of, place, params));
        assert!(worst <= 5e-5, "{place:?} of bundle {bundle} in slot {slot}, {params:?}: {worst:.1e}");
    }
}

/// The times of visibility around an hour; any for a bundle without a sun.
fn around(bundle: &Bundle, hour: f64) -> Option<[usize; 2]> {
    bundle.at(hour).unwrap().sun().map(|sun| sun.times)
}

#[test]
fn tiles_that_come_and_go_are_those_of_the_cpu() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    // Of several timelines and widths, with and without a sun: 6 + 15 + 15 + 2 tiles and more, in five slots.
    let bundles: Vec<Arc<Bundle>> = [
        testing::sunny_bundle(),
        testing::all_contents(16),
        testing::all_contents(32),
        testing::switching_bundle(),
    ]
    .into_iter()
    .chain(fixtures().into_iter().map(|(_, bytes)| bytes))
    .map(opened)
    .collect();
    for unpacks in [false, true] {
        let mut bench = Bench::new(gpu, &bundles, 5, unpacks);
        let (mut random, mut held) = (Random(7), [None; 5]);
        let (mut black, mut networks, mut sunlit) = (0, 0, 0);
        for round in 0..60 {
            let hour = HOURS[random.below(HOURS.len())];
            let lights = [Lights::All, Lights::All, Lights::Baked, Lights::Sun][random.below(4)];
            let params = DecodeParams { lights, ..DecodeParams::at(hour) };
            for _ in 0..1 + random.below(3) {
                let slot = random.below(5);
                if random.below(6) == 0 {
                    bench.pool.unload(slot as u32);
                    held[slot] = None;
                    continue;
                }
                // The sunny one more often.
                let bundle = random.below(bundles.len() + 3).saturating_sub(3);
                let places: Vec<Place> = bundles[bundle].header.places().collect();
                let place = places[random.below(places.len())];
                bench.load(slot as u32, bundle, place, around(&bundles[bundle], hour)).unwrap();
                held[slot] = Some((bundle, place));
            }
            // Those that stayed go on to the time's interval.
            let filled: Vec<u32> = (0..5).filter(|slot| held[*slot as usize].is_some()).collect();
            for slot in &filled {
                let (bundle, place) = held[*slot as usize].unwrap();
                if let Some(times) = around(&bundles[bundle], hour)
                    .filter(|times| bench.pool.interval_of(*slot) != Some(*times))
                {
                    let interval =
                        bench.read(bundle, place).unwrap().interval(&bundles[bundle], times).unwrap();
                    bench.pool.set_interval(&gpu.queue, *slot, &interval).unwrap();
                }
            }
            let (work, texture) = bench.decode(&filled, &params);
            assert_eq!(work.tiles + work.black.len(), filled.len());
            for slot in &filled {
                bench.is_right(&texture, *slot, held[*slot as usize].unwrap(), &params);
            }
            black += work.black.len();
            networks += work.networks;
            sunlit += work.tiles - work.networks;
            assert!(round > 0 || bench.pool.bytes() > 0);
        }
        assert!(black > 5 && networks > 40 && sunlit > 2, "{black} {networks} {sunlit}");
    }
}

/// A tile's light where visibility is held at one of its times: maps, and visibility · cosine · irradiance.
fn held_at(bundle: &Bundle, place: Place, params: &DecodeParams, time: usize) -> Vec<Expected> {
    let at = bundle.at(params.hour).unwrap();
    let mut out = tile_by_cpu(
        &at.clone().only(Lights::Baked),
        bundle,
        place,
        &DecodeParams { lights: Lights::Baked, ..*params },
    );
    let (sun, tile) = (bundle.header.sun.as_ref().unwrap(), bundle.sun(place).unwrap().unwrap());
    let (direction, irradiance) = sun.path.at(params.hour).unwrap();
    let seen = tile.visibility(sun, sun.times[time]);
    let width = bundle.header.pages[0].payload(place.column, place.row).0;
    for (i, (texel, mean)) in out.iter_mut().enumerate() {
        let stored = (i / width + BORDER) * tile.width + i % width + BORDER;
        let cosine = (0..3).map(|c| tile.normals[stored][c] * direction[c]).sum::<f32>().max(0.0);
        for c in 0..3 {
            texel[c] += seen[stored][c] * cosine * irradiance[c];
            mean[c] = mean[c].max(irradiance[c]);
        }
    }
    out
}

#[test]
fn an_interval_of_another_time_is_held_at_its_nearer_end() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let bundle = opened(testing::sunny_bundle());
    let mut bench = Bench::new(gpu, &[Arc::clone(&bundle)], 2, false);
    // Its times are 6, 7.5, 9 and 13 h. Interval, hour, and the time at which it is held.
    let cases = [
        ([0, 1], 8.2, 1),
        ([0, 1], 13.5, 1),
        ([1, 2], 6.7, 1),
        ([1, 2], 11.0, 2),
        ([2, 3], 8.9, 2),
        ([2, 3], 5.8, 2),
        ([3, 3], 7.0, 3),
        ([0, 0], 9.5, 0),
    ];
    for place in [place(1, 0), place(0, 1), place(0, 0)] {
        let features = bench.read(0, place).unwrap();
        assert!(features.has_sun() && features.has_maps() == (place != self::place(0, 0)));
        let sunlight = features.sunlight();
        for (times, hour, time) in cases {
            let params = DecodeParams::at(hour);
            bench.pool.load(&gpu.queue, 1, 0, &features).unwrap();
            let interval = sunlight.interval(&bundle, times).unwrap();
            assert_eq!((interval.times(), interval.place()), (times, place));
            bench.pool.set_interval(&gpu.queue, 1, &interval).unwrap();
            let (work, texture) = bench.decode(&[1], &params);
            assert_eq!((work.tiles, work.black.len()), (1, 0));
            let found = bench.texels(&texture, 1, 0, place);
            let worst = worst(&found, &held_at(&bundle, place, &params, time));
            assert!(worst <= 5e-5, "{place:?}, {times:?} at {hour} h: {worst:.1e}");
        }
        // Within the interval it moves; without one there is no sun, and by night none either.
        bench.load(1, 0, place, Some([1, 2])).unwrap();
        let (_, texture) = bench.decode(&[1], &DecodeParams::at(8.2));
        bench.is_right(&texture, 1, (0, place), &DecodeParams::at(8.2));
        bench.load(1, 0, place, None).unwrap();
        let (work, texture) = bench.decode(&[1], &DecodeParams::at(8.2));
        bench.is_right_baked(&texture, place);
        assert_eq!(work.black.len(), usize::from(!features.has_maps()));
    }
    assert!(bench.read(0, place(1, 0)).unwrap().interval(&bundle, [0, 2]).is_err());
    assert!(bench.read(0, place(1, 0)).unwrap().interval(&bundle, [3, 4]).is_err());
    assert!(bench.read(0, place(1, 0)).unwrap().interval(&bundle, [1, 0]).is_err());
}

impl Bench {
    /// That slot 1 has a tile without the sun at 8.2 h.
    fn is_right_baked(&self, texture: &[[f32; 4]], place: Place) {
        let bundle = &self.pool.bundles()[0];
        let params = DecodeParams { lights: Lights::Baked, ..DecodeParams::at(8.2) };
        let at = bundle.at(8.2).unwrap().only(Lights::Baked);
        let found = self.texels(texture, 1, 0, place);
        assert!(worst(&found, &tile_by_cpu(&at, bundle, place, &params)) <= 5e-5);
    }
}

#[test]
fn a_pool_without_room_says_so_and_goes_on() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let bundle = opened(testing::sunny_bundle());
    let mut bench = Bench::new(gpu, &[Arc::clone(&bundle)], 6, false);
    // There is room for all six tiles, but not twice for the one that is largest, of three channels.
    let (large, small, params) = (place(1, 0), place(2, 1), DecodeParams::at(9.3));
    bench.load(0, 0, large, Some([2, 3])).unwrap();
    bench.load(1, 0, small, Some([2, 3])).unwrap();
    for _ in 0..3 {
        let refused = bench.load(1, 0, large, Some([2, 3])).unwrap_err();
        assert!(matches!(refused, Error::Full { words, free, .. } if free < words), "{refused}");
        // The slot is empty, and the other is as it was.
        let request = SlotRequest { slot: 1, to: [0, 0], with_border: false };
        let view = bench.texture.create_view(&Default::default());
        let target = Target { view: &view, output: Output::Rgba32Float };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let refused = bench.pool.decode(&mut encoder, &[request], target, &params);
        assert!(matches!(refused, Err(Error::Invalid(_))) && bench.pool.interval_of(1).is_none());
        let (_, texture) = bench.decode(&[0], &params);
        bench.is_right(&texture, 0, (0, large), &params);
    }
    // Small ones still have room, and where the large one was there is room for it.
    bench.load(2, 0, small, Some([2, 3])).unwrap();
    bench.pool.unload(0);
    bench.load(1, 0, large, Some([2, 3])).unwrap();
    let (_, texture) = bench.decode(&[1, 2], &params);
    bench.is_right(&texture, 1, (0, large), &params);
    bench.is_right(&texture, 2, (0, small), &params);
    // Emptied, it has all its room again: every tile, in any order.
    let places: Vec<Place> = bundle.header.places().collect();
    for round in 0..6 {
        (0..6).for_each(|slot| bench.pool.unload(slot));
        for i in 0..6 {
            bench.load(i as u32, 0, places[(i * 5 + round) % 6], Some([2, 3])).unwrap();
        }
        let (_, texture) = bench.decode(&[0, 1, 2, 3, 4, 5], &params);
        (0..6).for_each(|i| bench.is_right(&texture, i as u32, (0, places[(i * 5 + round) % 6]), &params));
    }
}

/// A page of tiles that see all of the sun, with a normal of its own on every texel: in number as many words
/// as there can be.
fn rough_bundle() -> Bundle {
    let (mut header, _) = testing::sunny();
    header.pages[0] = Grid { width: 700, height: 300 };
    let sun = header.sun.as_ref().unwrap();
    let (coder, mut random, times) = (Coder::new(&sun.tables), Random(3), sun.times.len());
    let payload = |place: Place| {
        let (width, height) = header.pages[0].stored(place.column, place.row);
        let mut normal = || {
            let by = 1.5 * random.unit();
            [by.sin(), by.cos(), 0.0]
        };
        let normals = (0..width * height).map(|_| normal()).collect();
        let levels = vec![TileSun::TOP; times * width * height];
        let tile = TileSun { width, height, times, levels, normals, shadows: Shadows::default() };
        Payload { sun: tile.encode(&coder), ..Payload::default() }
    };
    let payloads: Vec<Payload> = header.places().map(payload).collect();
    Bundle::from_bytes(bundle::encode(&header, &payloads).unwrap()).unwrap()
}

#[test]
fn buffers_grow_and_keep_what_they_have() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let bundle = Arc::new(rough_bundle());
    let places: Vec<Place> = bundle.header.places().collect();
    let mut bench = Bench::new(gpu, &[Arc::clone(&bundle)], places.len() as u32, false);
    let (params, mut bytes, mut grown) = (DecodeParams::at(9.3), bench.pool.bytes(), 0);
    for (slot, place) in (0..).zip(&places) {
        bench.load(slot, 0, *place, Some([2, 3])).unwrap();
        if bench.pool.bytes() > bytes {
            (bytes, grown) = (bench.pool.bytes(), grown + 1);
            let filled: Vec<u32> = (0..=slot).collect();
            let (work, texture) = bench.decode(&filled, &params);
            assert_eq!(work.tiles, filled.len());
            filled
                .iter()
                .for_each(|slot| bench.is_right(&texture, *slot, (0, places[*slot as usize]), &params));
        }
    }
    assert!((1..4).contains(&grown), "{grown}");
    // Once grown it stays.
    (0..places.len() as u32).for_each(|slot| bench.pool.unload(slot));
    bench.load(0, 0, places[1], Some([2, 3])).unwrap();
    assert_eq!(bench.pool.bytes(), bytes);
}

#[test]
fn damaged_tiles_and_wrong_use_leave_the_pool_as_it_was() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let (header, mut payloads) = testing::sunny();
    // One tile whose weights are no numbers, and one whose shadows are damaged, which only their interval
    // tells.
    let weights = payloads[3].maps.bytes.len();
    payloads[3].maps.bytes[weights - 200..weights - 100].fill(0xff);
    let end = payloads[5].shadows.bytes.len();
    payloads[5].shadows.bytes[end - 60..].fill(0xff);
    let damaged = opened(bundle::encode(&header, &payloads).unwrap());
    let bundles = [damaged, opened(testing::sunny_bundle())];
    let mut bench = Bench::new(gpu, &bundles, 3, false);
    let places: Vec<Place> = header.places().collect();
    let params = DecodeParams::at(9.3);
    bench.load(0, 0, places[1], Some([2, 3])).unwrap();
    let is_right = |bench: &mut Bench| {
        let (_, texture) = bench.decode(&[0], &params);
        bench.is_right(&texture, 0, (0, places[1]), &params);
    };
    is_right(&mut bench);
    assert!(matches!(bench.read(0, places[3]), Err(Error::Bundle(_))));
    assert!(bench.read(0, place(3, 0)).is_err());
    let of_5 = bench.read(0, places[5]).unwrap();
    let bad: Vec<[usize; 2]> = [[0, 1], [1, 2], [2, 3]]
        .into_iter()
        .filter(|times| of_5.interval(&bundles[0], *times).is_err())
        .collect();
    assert!((1..3).contains(&bad.len()), "{bad:?}");
    is_right(&mut bench);
    // A bundle's tile as another's, and what there is not.
    let of_1 = bench.read(0, places[1]).unwrap();
    assert!(matches!(bench.pool.load(&gpu.queue, 0, 1, &of_5), Err(Error::Invalid(_))));
    assert!(
        bench.pool.load(&gpu.queue, 0, 2, &of_1).is_err()
            && bench.pool.load(&gpu.queue, 3, 0, &of_1).is_err()
    );
    let options = Options { unpacks: true, ..bench.pool.options().clone() };
    let unpacked = Features::read(&bundles[0], places[1], &options).unwrap();
    let is_refused = bench.pool.load(&gpu.queue, 0, 0, &unpacked).is_err();
    assert!(is_refused || bench.pool.options().unpacks);
    let interval: Interval = of_5.interval(&bundles[0], [0, 0]).unwrap();
    assert!(bench.pool.set_interval(&gpu.queue, 0, &interval).is_err());
    assert!(bench.pool.set_interval(&gpu.queue, 1, &interval).is_err());
    assert!(bench.pool.set_interval(&gpu.queue, 7, &interval).is_err());
    // The same place of another bundle.
    bench.load(1, 0, places[5], None).unwrap();
    let interval = bench.read(1, places[5]).unwrap().interval(&bundles[1], [0, 0]).unwrap();
    assert!(
        bench.pool.set_interval(&gpu.queue, 1, &interval).is_err() && bench.pool.interval_of(1).is_none()
    );
    assert_eq!(bench.pool.interval_of(0), Some([2, 3]));
    bench.pool.unload(9);
    is_right(&mut bench);
    let none = Pool::new(&gpu.device, &gpu.queue, &[], 3, Options::default());
    assert!(matches!(none, Err(Error::Invalid(_))));
    assert!(Pool::new(&gpu.device, &gpu.queue, &bundles, 0, Options::default()).is_err());
    for (hour, exposure) in [(f64::NAN, 1.0), (6.0, f32::NAN), (6.0, -1.0)] {
        let view = bench.texture.create_view(&Default::default());
        let target = Target { view: &view, output: Output::Rgba32Float };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let request = SlotRequest { slot: 0, to: [0, 0], with_border: false };
        assert!(
            bench
                .pool
                .decode(
                    &mut encoder,
                    &[request],
                    target,
                    &DecodeParams { exposure, ..DecodeParams::at(hour) }
                )
                .is_err()
        );
    }
}

#[test]
fn black_tiles_are_written_black() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let bundles = [opened(testing::sunny_bundle()), opened(testing::bundle().2)];
    let mut bench = Bench::new(gpu, &bundles, 4, false);
    // The sun alone; the maps alone; nothing.
    bench.load(0, 0, place(0, 0), Some([2, 3])).unwrap();
    bench.load(1, 0, place(2, 0), Some([2, 3])).unwrap();
    bench.load(2, 1, place(1, 0), None).unwrap();
    let nothing = bench.read(1, place(1, 0)).unwrap();
    assert!(!nothing.has_maps() && !nothing.has_sun() && nothing.bytes() == 0);
    let blacks =
        |work: &Work<SlotRequest>| work.black.iter().map(|request| request.slot).collect::<Vec<u32>>();
    let of = [(0, place(0, 0)), (0, place(2, 0)), (1, place(1, 0))];
    for (lights, hour, expected) in [
        (Lights::All, 9.3, vec![2]),
        (Lights::Sun, 9.3, vec![1, 2]),
        (Lights::Baked, 9.3, vec![0, 2]),
        (Lights::All, 20.0, vec![0, 2]),
        (Lights::Sun, 20.0, vec![0, 1, 2]),
    ] {
        let params = DecodeParams { lights, ..DecodeParams::at(hour) };
        let (work, texture) = bench.decode(&[0, 1, 2], &params);
        assert_eq!(blacks(&work), expected, "{params:?}");
        assert_eq!(work.tiles, 3 - expected.len());
        for slot in 0..3 {
            bench.is_right(&texture, slot, of[slot as usize], &params);
        }
    }
    // Places become black without a slot, too.
    let view = bench.texture.create_view(&Default::default());
    let target = Target { view: &view, output: Output::Rgba32Float };
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let (_, texture) = bench.decode(&[0], &DecodeParams::at(9.3));
    assert!(bench.texels(&texture, 0, 0, place(0, 0)).iter().flatten().any(|e| *e > 0.0));
    let request = Request { place: place(0, 0), to: [0, 0], with_border: false };
    bench.pool.clear(&mut encoder, 0, &[request], target).unwrap();
    assert!(bench.pool.clear(&mut encoder, 2, &[request], target).is_err());
    gpu.queue.submit([encoder.finish()]);
    let (_, texture) = bench.decode(&[], &DecodeParams::at(9.3));
    assert!(bench.texels(&texture, 0, 0, place(0, 0)).iter().flatten().all(|e| *e == 0.0));
}

#[test]
fn changed_tiles_are_errors_or_light() {
    let (_turn, Some(gpu)) = (TURN.lock(), gpu()) else { return };
    let (header, payloads) = testing::sunny();
    let (mut random, mut refused, mut shown) = (Random(5), 0, 0);
    for _ in 0..40 {
        // Sections are changed before their checksums are made.
        let mut bad = payloads.clone();
        for Payload { maps, sun, shadows, .. } in &mut bad {
            let section = [maps, sun, shadows].into_iter().nth(random.below(3)).unwrap();
            if !section.bytes.is_empty() {
                let near = [60.min(section.bytes.len()), section.bytes.len()][random.below(2)];
                section.bytes[random.below(near)] = random.byte();
            }
        }
        let bundle = opened(bundle::encode(&header, &bad).unwrap());
        let mut bench = Bench::new(gpu, &[bundle], 6, false);
        let filled: Vec<u32> = (0..6)
            .zip(header.places())
            .filter(|(slot, place)| bench.load(*slot, 0, *place, Some([2, 3])).is_ok())
            .map(|(slot, _)| slot)
            .collect();
        let (_, texture) = bench.decode(&filled, &DecodeParams::at(9.3));
        assert!(texture.iter().flatten().all(|e| e.is_finite() && *e >= 0.0));
        refused += 6 - filled.len();
        shown += filled.len();
    }
    assert!(refused > 5 && shown > 60, "{refused} {shown}");
}

#[test]
fn tiles_are_read_on_any_thread() {
    fn any<T: Send + Sync>() {}
    any::<Features>();
    any::<Interval>();
    any::<ndgi_gpu::Sunlight>();
    any::<Pool>();
}
