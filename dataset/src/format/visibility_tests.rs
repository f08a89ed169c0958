use super::*;

/// A page of 130 × 3 texels: a tile of 128 columns whose texel i is lit from time i % 5 on, through glass
/// from column 100 on if `is_tinted`, and one of 2 columns that is dark.
fn file(is_tinted: bool) -> (Vec<u8>, Planes) {
    let (texels, hours) = (128 * 3, [6.0, 6.25, 6.5, 7.0]);
    let mut levels = vec![0; 3 * hours.len() * texels];
    for channel in 0..3 {
        for time in 0..hours.len() {
            for texel in 0..texels {
                let lit = if is_tinted && texel % 128 >= 100 && channel == 2 { 3 } else { 8 };
                levels[(channel * hours.len() + time) * texels + texel] =
                    if time >= texel % 5 { lit } else { 0 };
            }
        }
    }
    let planes = Planes { texels, channels: 3, levels };
    let dark = Planes { texels: 2 * 3, channels: 3, levels: vec![0; 3 * hours.len() * 6] };
    let payloads = [planes.to_payload(), dark.to_payload()];
    assert_eq!((payloads[0].1, payloads[1].1), (if is_tinted { 3 } else { 1 }, 0));
    (to_bytes([130, 3], 8, &hours, &payloads), planes)
}

fn open(bytes: &[u8]) -> (tempfile::TempDir, Result<Visibility>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("page.vis");
    std::fs::write(&path, bytes).unwrap();
    let opened = Visibility::open(&path);
    (folder, opened)
}

#[test]
fn what_is_written_is_read_back() {
    for is_tinted in [false, true] {
        let (bytes, planes) = file(is_tinted);
        let (_folder, opened) = open(&bytes);
        let opened = opened.unwrap();
        assert_eq!((opened.size, opened.top, opened.tiles.len()), ([130, 3], 8, 2));
        assert_eq!(opened.hours, [6.0, 6.25, 6.5, 7.0]);
        let read = opened.tile(0).unwrap();
        for (texel, time) in (0..planes.texels).flat_map(|texel| (0..4).map(move |time| (texel, time))) {
            assert_eq!(read.level(texel, time), planes.level(texel, time), "texel {texel}, time {time}");
        }
        let dark = opened.tile(1).unwrap();
        assert!((0..6).all(|texel| dark.level(texel, 3) == [0; 3]));
    }
}

#[test]
fn between_times_values_lie_on_a_line_and_hold_beyond() {
    let hours = [6.0, 6.25, 7.0];
    let at = |hour| {
        let between = Between::new(&hours, hour);
        between.lerp([0.0, 1.0, 0.5][between.before], [0.0, 1.0, 0.5][between.after])
    };
    let found = [5.0, 6.0, 6.125, 6.25, 6.625, 7.0, 23.0].map(at);
    assert_eq!(found, [0.0, 0.0, 0.5, 1.0, 0.75, 0.5, 0.5]);
    assert_eq!(Between::new(&[12.0], 3.0), Between { before: 0, after: 0, part: 0.0 });
}

#[test]
fn damage_is_an_error_and_never_a_panic() {
    let (bytes, _) = file(true);
    let fails = |bytes: &[u8]| {
        let (_folder, opened) = open(bytes);
        opened.map_or_else(
            |error| Some(error.to_string()),
            |file| {
                (0..file.tiles.len()).find_map(|tile| file.tile(tile).err()).map(|error| error.to_string())
            },
        )
    };
    assert_eq!(fails(&bytes), None);
    for end in 0..bytes.len() {
        assert!(fails(&bytes[..end]).is_some(), "cut after {end} bytes");
    }
    let with = |at: usize, word: u32| {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        fails(&bytes).unwrap_or_default()
    };
    let first_tile = 8 + 16 + 4 * 8;
    for (at, word, expected) in [
        (0, 0, "expected it to begin with TLMVIS01"),
        (8, 0, "a page of 0 × 3 texels"),
        (8, 70_000, "expected 1 to 65536"),
        (16, 0, "level 0 for 1"),
        (16, 256, "level 256 for 1"),
        (16, 7, "level 8, expected 0 to 7"),
        (20, 0, "0 times"),
        (20, u32::MAX, "times: expected 1 to 4096"),
        (first_tile, 1, "expected"),
        (first_tile + 4, 2, "2 channels"),
        (first_tile + 4, 1, "expected 1536"),
        (first_tile + 8, 5, "expected 1 or 3 channels, or 0 of no bytes"),
        (first_tile + 12, 3, "expected 1 or 3 channels, or 0 of no bytes"),
    ] {
        let found = with(at, word);
        assert!(found.contains(expected), "{word} at {at}: {found}");
    }
    let mut other = bytes.clone();
    other[7] = b'2';
    assert!(fails(&other).unwrap().contains("this program reads version \"01\""));
    let mut back = bytes.clone();
    back[24..32].copy_from_slice(&f64::NAN.to_le_bytes());
    assert!(fails(&back).unwrap().contains("ascending"));
    // Seeded damage of single bytes: an error, or other levels that are in range.
    let mut state = 12_345u32;
    for _ in 0..2000 {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let mut damaged = bytes.clone();
        damaged[(state >> 8) as usize % bytes.len()] ^= (state >> 24) as u8 | 1;
        let _ = fails(&damaged);
    }
}

#[test]
fn a_payload_that_unpacks_to_more_is_refused_before_it_fills_memory() {
    // The second one needs a dictionary of megabytes already.
    for (times, expected) in
        [(256, "unpacks to 1537 bytes or more, expected 1536"), (4096, "not a complete .xz stream")]
    {
        let planes = Planes { texels: 384, channels: 1, levels: vec![1; 384 * 4 * times] };
        let (packed, channels) = planes.to_payload();
        let bytes = to_bytes([130, 3], 8, &[6.0, 6.25, 6.5, 7.0], &[(packed, channels), (Vec::new(), 0)]);
        let (_folder, opened) = open(&bytes);
        let error = opened.unwrap().tile(0).unwrap_err().to_string();
        assert!(error.contains(&format!("tile at texel (0, 0): {expected}")), "{error}");
    }
}
