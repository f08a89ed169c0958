//! Random traces of views, clocks and disks: what the stream's commands must never do, whatever happens.

#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use common::{Disk, Model, pyramid};
use ndgi::testing::Random;
use ndgi_stream::{Answer, Budgets, Commands, Completion, Entry, Pyramid, Seen, Stream, Tile};
use std::sync::Arc;

fn tight() -> Budgets {
    Budgets { slots: 12, features: 16, reads: 5, loads: 2, decodes: 3, suns: 4, ..Budgets::default() }
}

/// A view that walks: some tiles, that change little from step to step, and jump at times.
fn view(random: &mut Random, pyramid: &Pyramid, around: &mut u32) -> Vec<Seen> {
    let n = pyramid.tiles();
    if random.below(40) == 0 {
        *around = random.below(n) as u32;
    }
    *around = (*around + random.below(3) as u32) % n as u32;
    // A number that no tile has is left aside.
    let tile = |i: u32| Tile((*around + i) % (n as u32 + 1));
    let count = [1, 4, 8, 30][random.below(4)];
    (0..count).map(|i| Seen { tile: tile(i * 7 / 4), pixels: 1 + random.below(900) as u32 }).collect()
}

fn trace(pyramid: &Arc<Pyramid>, seed: u64, steps: usize) -> Vec<Commands> {
    let mut random = Random(seed);
    let budgets = tight();
    let mut stream = Stream::new(Arc::clone(pyramid), budgets.clone()).unwrap();
    let mut model = Model::new(Arc::clone(pyramid), budgets);
    let mut disk = Disk::new([0, 3, 40][random.below(3)], [0, 10, 300][random.below(3)]);
    let (mut hour, mut around, mut all) = (24.0 * f64::from(random.unit()), 0, Vec::new());
    let pace = [0.0, 1.0 / 1800.0, 0.02, 0.3, -0.05][random.below(5)];
    for step in 0..steps {
        hour += if random.below(100) == 0 { 24.0 * f64::from(random.unit()) } else { pace };
        let seen = (random.below(3) > 0).then(|| view(&mut random, pyramid, &mut around));
        let answers = disk.answers(step, &mut random);
        let mut commands = stream.step(seen.as_deref(), &answers, hour).unwrap();
        model.check(&stream, &commands, hour);
        disk.start(step, &commands, &mut random);
        if random.below(60) == 0
            && let Some(load) = commands.loads.iter().find(|load| load.features)
        {
            let mut more = Commands::default();
            stream.refuse(load.tile, None, &mut more);
            model.refuse(&more);
            commands.unloads.extend(more.unloads);
        }
        all.push(commands);
    }
    all
}

#[test]
fn random_traces_keep_every_rule_and_give_the_same_commands_again() {
    let pyramid = pyramid();
    let mut done = [0; 4];
    for seed in 0..150 {
        let commands = trace(&pyramid, seed, 300);
        for step in &commands {
            let of = [step.decodes.len(), step.evictions.len(), step.failures.len(), step.unloads.len()];
            done.iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
        }
        if seed % 10 == 0 {
            assert_eq!(commands, trace(&pyramid, seed, 300), "seed {seed}");
        }
    }
    // The traces do meet what they are to test.
    assert!(done.iter().all(|count| *count > 100), "{done:?}");
}

/// Steps with one view and a disk that answers, until nothing is done any more.
fn settle(stream: &mut Stream, seen: &[Seen], hour: f64, disk: &mut Disk, most: usize) -> usize {
    let mut random = Random(9);
    let mut quiet = 0;
    for step in 0..most {
        let answers = disk.answers(step, &mut random);
        let commands = stream.step(Some(seen), &answers, hour).unwrap();
        disk.start(step, &commands, &mut random);
        let is_quiet = commands.reads.is_empty() && commands.loads.is_empty() && commands.decodes.is_empty();
        quiet = if is_quiet && disk.is_idle() { quiet + 1 } else { 0 };
        if quiet == 3 {
            return step;
        }
    }
    panic!("still busy after {most} steps");
}

#[test]
fn what_fits_is_shown_at_last_and_then_nothing_is_done() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let lit: Vec<Tile> = common::lit(&pyramid).take(7).collect();
    let seen: Vec<Seen> = lit.iter().map(|tile| Seen { tile: *tile, pixels: 50 }).collect();
    // One read in three fails at first.
    let mut disk = Disk::new(5, 0);
    disk.failing = 333;
    settle(&mut stream, &seen, 8.3, &mut disk, 2000);
    for tile in lit {
        let own = pyramid.spot(tile).unwrap().level as u8;
        assert!(matches!(stream.entry(tile), Entry::Slot { level, .. } if level == own), "{tile:?}");
    }
}

#[test]
fn a_view_of_more_than_fits_asks_for_coarser_levels_until_it_fits() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let mut disk = Disk::new(0, 0);
    let mut random = Random(1);
    let mut biases = Vec::new();
    for step in 0..400 {
        // Page 0 as a whole, at the level that the bias says.
        let level = (stream_bias(&biases).floor() as usize).min(pyramid.levels() - 1);
        let Tile(first) = pyramid.first(level, 0);
        let tiles = pyramid.bundle(level).header.pages[0].tiles() as u32;
        let seen: Vec<Seen> = (first..first + tiles).map(|i| Seen { tile: Tile(i), pixels: 100 }).collect();
        let answers = disk.answers(step, &mut random);
        let commands = stream.step(Some(&seen), &answers, 8.3).unwrap();
        disk.start(step, &commands, &mut random);
        biases.push(commands.mip_bias);
    }
    assert!(biases.iter().all(|bias| (0.0..=2.0).contains(bias)));
    assert!(biases.is_sorted() || stream_bias(&biases) > 0.5, "{biases:?}");
    assert!(biases.windows(2).all(|two| (two[1] - two[0]).abs() <= 0.1 + 1e-6), "it changes smoothly");
    let wanted = stream.wanted().count();
    assert!((4..=12).contains(&wanted), "{wanted}");
    // With little in view it goes back to nothing.
    let seen = [Seen { tile: pyramid.first(0, 1), pixels: 100 }];
    for _ in 0..400 {
        biases.push(stream.step(Some(&seen), &[], 8.3).unwrap().mip_bias);
    }
    assert_eq!(stream_bias(&biases), 0.0);
}

fn stream_bias(biases: &[f32]) -> f32 {
    biases.last().copied().unwrap_or(0.0)
}

#[test]
fn under_a_clock_that_runs_no_tile_is_left_behind() {
    let pyramid = pyramid();
    let budgets = Budgets { decodes: 1, tolerance: 1e-6, ..tight() };
    let mut stream = Stream::new(Arc::clone(&pyramid), budgets).unwrap();
    let lit: Vec<Tile> =
        common::lit(&pyramid).filter(|tile| common::changes(&pyramid, *tile)).take(6).collect();
    let seen: Vec<Seen> = lit
        .iter()
        .enumerate()
        .map(|(i, tile)| Seen { tile: *tile, pixels: if i == 0 { 1 } else { 9999 } })
        .collect();
    settle(&mut stream, &seen, 1.0, &mut Disk::new(0, 0), 500);
    let mut last = vec![0; lit.len()];
    let mut longest = 0;
    for step in 1..200 {
        let commands = stream.step(Some(&seen), &[], 1.0 + step as f64 * 1e-3).unwrap();
        for decode in commands.decodes.iter().filter(|decode| decode.maps) {
            if let Some(i) = lit.iter().position(|tile| *tile == decode.tile) {
                longest = longest.max(step - last[i]);
                last[i] = step;
            }
        }
    }
    assert!(lit.len() > 3);
    let waiting = last.iter().map(|last| 200 - last).max().unwrap();
    // Tiles that change, and roots: each comes round when it waited longest.
    assert!(longest.max(waiting) <= 12, "{longest} {waiting}");
}

#[test]
fn a_damaged_tile_is_reported_once_and_its_parent_is_shown() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let damaged = common::lit(&pyramid).next().unwrap();
    let mut disk = Disk::new(1, 0);
    disk.damaged = Some(damaged);
    let seen = [Seen { tile: damaged, pixels: 100 }];
    let mut random = Random(3);
    let mut reported = Vec::new();
    for step in 0..100 {
        let answers = disk.answers(step, &mut random);
        let commands = stream.step(Some(&seen), &answers, 8.3).unwrap();
        disk.start(step, &commands, &mut random);
        reported.extend(commands.failures);
    }
    assert_eq!(reported.len(), 1);
    assert_eq!((reported[0].tile, reported[0].what.as_str()), (damaged, "damaged"));
    assert!(matches!(stream.entry(damaged), Entry::Slot { level: 1.., .. }), "{:?}", stream.entry(damaged));
}

#[test]
fn another_bundle_is_taken_up_while_the_old_one_is_shown() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let tile = common::lit(&pyramid).next().unwrap();
    let seen = [Seen { tile, pixels: 100 }];
    settle(&mut stream, &seen, 8.3, &mut Disk::new(0, 0), 200);
    let before = stream.entry(tile);
    stream.replace(common::pyramid()).unwrap();
    let commands = stream.step(Some(&seen), &[], 8.3).unwrap();
    assert_eq!(stream.entry(tile), before, "it is shown until the new one is there");
    assert!(commands.reads.iter().any(|read| read.tile == tile));
    let mut disk = Disk::new(0, 0);
    let mut random = Random(1);
    disk.start(0, &commands, &mut random);
    let mut decoded = 0;
    for step in 1..20 {
        let answers = disk.answers(step, &mut random);
        let commands = stream.step(Some(&seen), &answers, 8.3).unwrap();
        disk.start(step, &commands, &mut random);
        decoded += commands.decodes.iter().filter(|decode| decode.tile == tile && decode.maps).count();
    }
    assert_eq!(decoded, 1);
    // Pages of other sizes: nothing of the old is shown.
    stream.replace(common::other()).unwrap();
    stream.step(None, &[], 8.3).unwrap();
    assert!((0..stream.pyramid().tiles()).all(|i| stream.entry(Tile(i as u32)) == Entry::Mean));
}

#[test]
fn bundles_that_are_no_levels_and_budgets_of_nothing_are_refused() {
    let pyramid = pyramid();
    let levels = [0, 1].map(|level| Arc::clone(pyramid.bundle(level)));
    let error = Pyramid::new(vec![Arc::clone(&levels[0]), Arc::clone(&levels[0])]).unwrap_err().to_string();
    assert!(error.contains("level 1 has page 0 of 700 × 400 texels; expected 350 × 200"), "{error}");
    let planes = ndgi::Bundle::from_bytes(ndgi::testing::basis_bundle()).unwrap();
    let error = Pyramid::new(vec![Arc::new(planes)]).unwrap_err().to_string();
    assert!(error.contains("planes (coding basis)") && error.contains("--coding neural"), "{error}");
    assert!(Pyramid::new(Vec::new()).is_err());
    assert!(Pyramid::new(levels.to_vec()).is_ok());
    for budgets in [
        Budgets { slots: 0, ..Budgets::default() },
        Budgets { features: 255, ..Budgets::default() },
        Budgets { tolerance: f32::NAN, ..Budgets::default() },
    ] {
        assert!(Stream::new(Arc::clone(&pyramid), budgets).is_err());
    }
    let mut stream = Stream::new(pyramid, tight()).unwrap();
    assert!(stream.step(None, &[], f64::NAN).is_err());
}

#[test]
fn every_tile_has_a_place_and_every_place_its_tile() {
    let pyramid = pyramid();
    for i in 0..pyramid.tiles() as u32 {
        let spot = pyramid.spot(Tile(i)).unwrap();
        assert_eq!(pyramid.tile(spot), Some(Tile(i)));
        if let Some(parent) = pyramid.parent(Tile(i)) {
            let above = pyramid.spot(parent).unwrap();
            assert_eq!(above.level, spot.level + 1);
            assert_eq!((above.place.column, above.place.row), (spot.place.column / 2, spot.place.row / 2));
        } else {
            assert_eq!(spot.level + 1, pyramid.levels());
        }
    }
    assert_eq!(pyramid.spot(Tile(pyramid.tiles() as u32)), None);
}

/// A tile of level 0 that sees the sun and has maps.
fn sunlit(pyramid: &Arc<Pyramid>) -> Tile {
    let bundle = pyramid.bundle(0);
    let has_both = |tile: &Tile| {
        let entry = &bundle.index[tile.0 as usize];
        entry.sun.length > 0 && entry.maps.length > 0
    };
    common::lit(pyramid).find(has_both).unwrap()
}

#[test]
fn the_sun_is_decoded_when_it_moves_and_again_when_its_interval_has_arrived() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let tile = sunlit(&pyramid);
    let seen = [Seen { tile, pixels: 100 }];
    // Intervals of visibility begin at 6, 7.5 and 9.
    settle(&mut stream, &seen, 7.4, &mut Disk::new(0, 0), 200);
    let suns = |commands: &Commands| {
        commands.decodes.iter().filter(|decode| decode.tile == tile && decode.sun).count()
    };
    for step in 1..5 {
        let commands = stream.step(Some(&seen), &[], 7.4 + 0.001 * f64::from(step)).unwrap();
        assert_eq!(suns(&commands), 1, "the hour moved");
        assert!(!commands.decodes.iter().any(|decode| decode.maps), "the lamps did not");
        assert!(commands.reads.is_empty(), "{:?}", commands.reads);
    }
    // A new interval is unpacked: until it is there the sun goes on with the old one.
    let commands = stream.step(Some(&seen), &[], 7.6).unwrap();
    assert_eq!(suns(&commands), 1);
    let asked: Vec<_> = commands.reads.iter().filter(|read| read.tile == tile).collect();
    assert!(matches!(asked[..], [read] if !read.features && read.times == Some([1, 2])), "{asked:?}");
    let answer = [Completion { ticket: asked[0].ticket, answer: Answer::Arrived }];
    // At the same hour: decoded again for the new interval's sake, once.
    let commands = stream.step(Some(&seen), &answer, 7.6).unwrap();
    assert!(
        commands.loads.iter().any(|load| load.tile == tile && !load.features && load.times == Some([1, 2]))
    );
    assert_eq!(suns(&commands), 1);
    assert_eq!(suns(&stream.step(Some(&seen), &[], 7.6).unwrap()), 0);
    // At night it is decoded once more, black.
    let night: Vec<usize> =
        (0..5).map(|i| suns(&stream.step(Some(&seen), &[], 14.1 + 0.1 * f64::from(i)).unwrap())).collect();
    assert_eq!(night, [1, 0, 0, 0, 0]);
}

#[test]
fn a_day_later_the_light_is_the_same() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let tile = common::lit(&pyramid).find(|tile| common::changes(&pyramid, *tile)).unwrap();
    let seen = [Seen { tile, pixels: 100 }];
    settle(&mut stream, &seen, 23.95, &mut Disk::new(0, 0), 200);
    let staleness = |hour: f64| stream.staleness(tile, &pyramid.at(hour).unwrap()).unwrap();
    assert!(staleness(23.95 - 24.0) < 1e-6);
    let (little, more) = (staleness(0.05), staleness(2.0));
    assert!(little < 0.1 * more && more > 0.05, "{little} {more}");
}

#[test]
fn what_covers_a_view_is_loaded_first_even_where_not_all_of_it_can_stay() {
    let pyramid = pyramid();
    // Three roots are too many to be kept for good.
    let budgets = Budgets { slots: 8, features: 8, ..tight() };
    let mut stream = Stream::new(Arc::clone(&pyramid), budgets).unwrap();
    assert!(pyramid.roots().count() > 2);
    let seen = [Seen { tile: sunlit(&pyramid), pixels: 100 }];
    let commands = stream.step(Some(&seen), &[], 7.4).unwrap();
    let read: Vec<usize> = commands.reads.iter().map(|read| pyramid.spot(read.tile).unwrap().level).collect();
    assert_eq!(read, [2, 0]);
}

#[test]
fn a_tile_that_finds_no_room_is_given_that_of_one_that_is_not_wanted() {
    let pyramid = pyramid();
    let mut stream = Stream::new(Arc::clone(&pyramid), tight()).unwrap();
    let lit: Vec<Tile> = common::lit(&pyramid).take(10).collect();
    let seen =
        |tiles: &[Tile]| -> Vec<Seen> { tiles.iter().map(|tile| Seen { tile: *tile, pixels: 50 }).collect() };
    settle(&mut stream, &seen(&lit[..4]), 8.3, &mut Disk::new(0, 0), 200);
    // Those are left behind; another one finds no room on the device, though there are places.
    for _ in 0..10 {
        stream.step(Some(&[]), &[], 8.3).unwrap();
    }
    let (mut disk, mut random) = (Disk::new(0, 0), Random(1));
    for step in 0..20 {
        let answers = disk.answers(step, &mut random);
        let commands = stream.step(Some(&seen(&lit[9..])), &answers, 8.3).unwrap();
        disk.start(step, &commands, &mut random);
        if let Some(load) = commands.loads.iter().find(|load| load.tile == lit[9]) {
            let mut more = Commands::default();
            stream.refuse(load.tile, None, &mut more);
            assert!(more.drops.len() == 2 && more.drops[0] == lit[9], "{more:?}");
            assert!(lit[..4].contains(&more.drops[1]), "{more:?}");
            assert_eq!(more.unloads.len(), 2, "its own place and that of the other: {more:?}");
            return;
        }
    }
    panic!("it was never loaded");
}

#[test]
fn groups_switched_while_a_bundle_is_replaced_are_shown_in_their_new_state() {
    let pyramid = pyramid();
    let budgets = tight();
    let mut stream = Stream::new(Arc::clone(&pyramid), budgets.clone()).unwrap();
    let mut model = Model::new(Arc::clone(&pyramid), budgets);
    let seen: Vec<Seen> = common::lit(&pyramid).take(7).map(|tile| Seen { tile, pixels: 50 }).collect();
    let lamps = |hour: f64| pyramid.at(hour).unwrap().state;
    let hours: Vec<f64> = (0..24 * 60).map(|minute| f64::from(minute) / 60.0).collect();
    let switch = hours.windows(2).find(|two| lamps(two[0]) != lamps(two[1])).unwrap();
    let (mut disk, mut random) = (Disk::new(0, 0), Random(1));
    for step in 0..40 {
        let answers = disk.answers(step, &mut random);
        let commands = stream.step(Some(&seen), &answers, switch[0]).unwrap();
        model.check(&stream, &commands, switch[0]);
        disk.start(step, &commands, &mut random);
    }
    assert!(seen.iter().any(|seen| stream.entry(seen.tile) != Entry::Mean));
    stream.replace(common::pyramid()).unwrap();
    model.forget_places();
    let commands = stream.step(Some(&seen), &[], switch[1]).unwrap();
    model.check(&stream, &commands, switch[1]);
}

#[test]
fn while_a_view_moves_what_it_shows_is_still_decoded_again() {
    let pyramid = pyramid();
    let lit: Vec<Tile> = common::lit(&pyramid).filter(|tile| common::changes(&pyramid, *tile)).collect();
    for decodes in [1, 2, 3, 4] {
        let budgets = Budgets { decodes, loads: 8, reads: 16, tolerance: 1e-6, ..tight() };
        let mut stream = Stream::new(Arc::clone(&pyramid), budgets).unwrap();
        let stays = lit[0];
        settle(&mut stream, &[Seen { tile: stays, pixels: 100 }], 1.0, &mut Disk::new(0, 0), 500);
        let (mut disk, mut random, mut again) = (Disk::new(0, 0), Random(1), 0);
        for step in 0..120 {
            // Four others in each step.
            let others = (0..4).map(|i| lit[1 + (4 * step + i) % (lit.len() - 1)]);
            let seen: Vec<Seen> = others.chain([stays]).map(|tile| Seen { tile, pixels: 100 }).collect();
            let answers = disk.answers(step, &mut random);
            let commands = stream.step(Some(&seen), &answers, 1.0 + step as f64 * 1e-3).unwrap();
            disk.start(step, &commands, &mut random);
            again += commands.decodes.iter().filter(|decode| decode.maps && decode.tile == stays).count();
        }
        assert!(again >= 5, "{decodes} a step: {again}");
    }
}

#[test]
fn more_levels_than_page_table_entries_can_encode_are_refused() {
    let small = common::of_pages(&[[1, 1]], 1);
    let levels = |count: usize| Pyramid::new(vec![Arc::clone(small.bundle(0)); count]);
    assert!(levels(16).is_ok());
    assert!(levels(17).unwrap_err().to_string().contains("17 levels; expected at most 16"));
}
