//! Round trips, and hostile files.

use super::*;
use crate::sun::{Counts, SunPath};
use crate::testing::{self, Random};
use crate::time::{Axis, Coding};

/// Reads everything there is; the re-encoded bytes.
fn read_all(bytes: Vec<u8>) -> Result<Vec<u8>> {
    let bundle = Bundle::from_bytes(bytes)?;
    let mut payloads = Vec::new();
    for place in bundle.header.places() {
        let tile = bundle.tile(place)?;
        payloads.push(
            tile.map_or(Payload::default(), |tile| {
                encode_payload(&tile).expect("what was read can be written")
            }),
        );
    }
    encode(&bundle.header, &payloads)
}

/// Makes the header's checksum right again, so that a damaged header reaches the parser behind it.
fn seal(bytes: &mut [u8]) {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    if let Some(rest) = bytes.get(32..length) {
        let sum = checksum(&[&bytes[..24], rest]);
        bytes[24..32].copy_from_slice(&sum.to_le_bytes());
    }
}

fn header_len(bytes: &[u8]) -> usize {
    u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize
}

#[test]
fn bytes_parse_to_the_same_values_and_the_same_bytes() {
    let (header, payloads, bytes) = testing::bundle();
    let bundle = Bundle::from_bytes(bytes.clone()).unwrap();
    assert_eq!(bundle.header, header);
    for (i, place) in header.places().enumerate() {
        assert_eq!(header.position(place), Some(i));
        assert_eq!(bundle.tile(place).unwrap(), testing::tile_of(&header, i, place));
        assert_eq!(bundle.index[i].maps.word, payloads[i].maps.word);
        assert_eq!(
            bundle.knots(place).unwrap(),
            testing::tile_of(&header, i, place).map_or(vec![], |tile| tile.knots)
        );
    }
    assert_eq!(read_all(bytes.clone()).unwrap(), bytes);
    assert!(bundle.tile(Place { page: 0, column: 2, row: 0 }).is_err());
    assert!(bundle.tile(Place { page: 2, column: 0, row: 0 }).is_err());
}

#[test]
fn a_file_reads_as_memory_does() {
    let (header, _, bytes) = testing::bundle();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ndgi");
    std::fs::write(&path, &bytes).unwrap();
    let (file, memory) = (Bundle::open(&path).unwrap(), Bundle::from_bytes(bytes).unwrap());
    for place in header.places() {
        assert_eq!(file.tile(place).unwrap(), memory.tile(place).unwrap());
    }
    assert!(Bundle::open(&folder.path().join("absent")).is_err());
}

#[test]
fn payloads_are_aligned_and_one_of_full_size_takes_the_paper_s_bits() {
    let (_, _, bytes) = testing::bundle();
    let bundle = Bundle::from_bytes(bytes).unwrap();
    assert!(bundle.index.iter().all(|entry| entry.maps.offset % 16 == 0));
    // Profile M, 26 frames, 128²: 0.68 bits per texel and frame in the paper.
    let contents = crate::model::Profile::M.contents(26, 0);
    let shape = Shape::new(&contents, 128, 128, 26, Coding::Standard);
    let bpp = full_len(&shape) as f64 * 8.0 / (128.0 * 128.0 * 26.0);
    assert!((0.67..0.69).contains(&bpp), "{bpp}");
}

#[test]
fn truncation_at_every_byte_is_an_error() {
    let (_, _, bytes) = testing::bundle();
    for end in 0..bytes.len() {
        assert!(read_all(bytes[..end].to_vec()).is_err(), "cut at {end}");
        // Also when the file's own length field agrees.
        if end >= 24 {
            let mut cut = bytes[..end].to_vec();
            cut[16..24].copy_from_slice(&(end as u64).to_le_bytes());
            if end >= header_len(&bytes) {
                seal(&mut cut);
            }
            assert!(read_all(cut).is_err(), "cut and relabelled at {end}");
        }
    }
    let mut longer = bytes;
    longer.push(0);
    assert!(read_all(longer).is_err());
}

#[test]
fn any_flipped_bit_is_noticed() {
    let (_, _, bytes) = testing::bundle();
    let mut random = Random(7);
    for i in 0..20_000 {
        // The header bit by bit, then anywhere.
        let bit = if i < 8 * header_len(&bytes) { i } else { random.below(8 * bytes.len()) };
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(read_all(damaged).is_err(), "bit {bit}");
    }
}

#[test]
fn hostile_headers_with_a_right_checksum_never_panic() {
    let (_, _, bytes) = testing::bundle();
    let length = header_len(&bytes);
    let mut random = Random(11);
    let mut accepted = 0;
    for _ in 0..20_000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + random.below(3) {
            let at = random.below(length);
            match random.below(4) {
                0 => damaged[at] ^= 1 << random.below(8),
                1 => damaged[at] = random.byte(),
                2 => {
                    // A count, offset or length replaced by an extreme.
                    let at = at & !3;
                    let value = [0, 1, 0x7fff_ffff, 0xffff_ffff, 0x0010_0000][random.below(5)];
                    damaged[at..at + 4].copy_from_slice(&u32::to_le_bytes(value));
                }
                _ => {
                    let from = random.below(length);
                    damaged.copy_within(from..(from + 8).min(length), at.min(length - 8));
                }
            }
        }
        seal(&mut damaged);
        // What is accepted must be written back as it was read.
        if let Ok(again) = read_all(damaged.clone()) {
            accepted += 1;
            assert_eq!(again, damaged);
        }
    }
    // Some changes are harmless: another hour, another letter in a name.
    assert!(accepted > 100, "{accepted}");
}

#[test]
fn each_count_and_offset_is_checked() {
    let (_, payloads, bytes) = testing::bundle();
    // Fixed positions of FORMAT.md: length, frames, pages, groups, streams, times, zero, scene length; the
    // offset of the last index line, found by its length and word.
    let Section { word, bytes: last } = &payloads.last().unwrap().maps;
    let line = [(last.len() as u32).to_le_bytes(), word.to_le_bytes()].concat();
    let last = bytes[..header_len(&bytes)].windows(8).rposition(|window| window == line).unwrap() - 8;
    for at in [12, 40, 48, 52, 56, 60, 64, 68, 80, last] {
        for value in [0, 3, 0xffff_ffff_u32] {
            let mut damaged = bytes.clone();
            if damaged[at..at + 4] == value.to_le_bytes() {
                continue;
            }
            damaged[at..at + 4].copy_from_slice(&value.to_le_bytes());
            seal(&mut damaged);
            assert!(read_all(damaged).is_err(), "{value:#x} at {at}");
        }
    }
}

#[test]
fn bundles_of_other_versions_are_refused_with_what_to_do() {
    let (_, _, bytes) = testing::bundle();
    let advice = [
        (0, "compress its dataset again"),
        (VERSION - 1, "compress its dataset again"),
        (VERSION + 1, "use the program that wrote it"),
        (u32::MAX, "use the program that wrote it"),
    ];
    for (version, expected) in advice {
        let mut other = bytes.clone();
        other[8..12].copy_from_slice(&version.to_le_bytes());
        seal(&mut other);
        let refused = read_all(other).unwrap_err();
        assert!(matches!(refused, Error::Unsupported { .. }), "{refused:?}");
        let text = refused.to_string();
        assert!(
            text.contains(&format!("bundle version {version}; this program reads version {VERSION}")),
            "{text}"
        );
        assert!(text.contains(expected), "{text}");
    }
}

fn read(bytes: &[u8], word: u32, shape: Shape, like: &TileParams) -> Result<TileParams, String> {
    payload::decode_section(bytes, word, shape, 2, like.knots.clone())
}

#[test]
fn payloads_with_forbidden_values_are_refused() {
    let header = testing::header();
    let good = testing::tile_of(&header, 0, Place { page: 0, column: 0, row: 0 }).unwrap();
    let shape = good.shape;
    assert!(encode_payload(&good).is_ok());
    for mean in [f32::NAN, f32::INFINITY, -1.0] {
        let mut bad = good.clone();
        bad.knots[2].mean[1] = mean;
        assert!(encode_payload(&bad).is_err());
    }
    let mut bad = good.clone();
    bad.mlp[5] = crate::half::F16::INFINITY;
    assert!(encode_payload(&bad).is_err());
    let mut bad = good.clone();
    bad.f_uvt[0] = [0; 16];
    assert!(encode_payload(&bad).is_err());
    let mut bad = good.clone();
    bad.f_ut.pop();
    assert!(encode_payload(&bad).is_err());

    for places in [vec![1, 1, 1, 1], vec![0, 1, 0, 1], vec![0, 2, 1, 2], vec![0, 0, 1], vec![0, 0, 1, 8]] {
        let axis = Axis { length: 8, places };
        assert!(encode_payload(&TileParams { axis, ..good.clone() }).is_err());
    }

    // The same in a file whose checksums are right.
    let Section { word, bytes } = encode_payload(&good).unwrap().maps;
    let axis_at = 16 * (good.f_uv.len() + good.f_uvt.len());
    let gates_at = axis_at + 2 + 2 * good.axis.places.len();
    let grey_blocks = crate::bc7::encode(&crate::bc7::GREY).repeat(10);
    let end = bytes.len() - 1;
    let patches = [
        (0, vec![0], "mode"),
        (0, grey_blocks, "grey blocks that must be omitted"),
        (axis_at, vec![1], "time axis"),
        (axis_at + 2, vec![1], "time axis"),
        (gates_at, vec![2], "group 2"),
        (end, vec![1], "zeros"),
    ];
    for (at, patch, what) in patches {
        let mut bad = bytes.clone();
        bad[at..at + patch.len()].copy_from_slice(&patch);
        let message = read(&bad, word, shape, &good).unwrap_err();
        assert!(message.contains(what), "at {at}: {message}");
    }
    assert_eq!(read(&bytes, word, shape, &good).unwrap(), good);

    // A map whose grey blocks are omitted, or not as the word says.
    let place = Place { page: 1, column: 0, row: 0 };
    let sparse = testing::tile_of(&header, 2, place).unwrap();
    let Section { word: sparse_word, bytes } = encode_payload(&sparse).unwrap().maps;
    assert_eq!(sparse_word & !word & Contents::SPARE, Contents::SPARE);
    assert!(bytes.len() < full_len(&sparse.shape));
    let read = |bytes: &[u8], word: u32| read(bytes, word, sparse.shape, &sparse);
    assert_eq!(read(&bytes, sparse_word).unwrap(), sparse);
    for flag in [1 << 30, 1 << 31] {
        assert!(read(&bytes, sparse_word ^ flag).is_err());
    }
    // The bit field: bits too many, all, one that is not there, none.
    for field in [0xff, 0x07, 0x03, 0x00] {
        let mut bad = bytes.clone();
        bad[0] = field;
        assert!(read(&bad, sparse_word).is_err(), "{field:#x}");
    }
    for longer in [bytes.len() - 16, bytes.len() + 16] {
        let mut bad = bytes.clone();
        bad.resize(longer, 0);
        assert!(read(&bad, sparse_word).is_err(), "{longer} bytes");
    }
}

#[test]
fn headers_that_cannot_be_read_are_not_written() {
    let (header, payloads, _) = testing::bundle();
    let refused = |change: &dyn Fn(&mut Header)| {
        let mut header = header.clone();
        change(&mut header);
        encode(&header, &payloads).is_err()
    };
    assert!(!refused(&|_| {}));
    assert!(refused(&|h| h.timeline.hours[1] = 24.0));
    assert!(refused(&|h| h.timeline.hours[1] = f64::NAN));
    assert!(refused(&|h| h.timeline.hours[1] = h.timeline.hours[2]));
    assert!(refused(&|h| h.timeline.intervals[0][0][1] = 30.0));
    assert!(refused(&|h| h.timeline.states[0].clear()));
    assert!(refused(&|h| h.groups.truncate(1)));
    assert!(refused(&|h| h.pages.truncate(1)));
    assert!(refused(&|h| h.kinds.truncate(1)));
    assert!(refused(&|h| h.timeline.between[0] = 6.0));
    assert!(refused(&|h| h.timeline.between.clear()));
    assert!(refused(&|h| h.timeline.coding = Coding::Paper));
    let sun = |times: usize| Sun {
        path: SunPath { hours: vec![6.0], direction: vec![[0.0, 1.0, 0.0]], irradiance: vec![[1.0; 3]] },
        times: (0..times).map(|i| i as f64 / 100.0).collect(),
        tables: Counts::default().tables(),
    };
    assert!(!refused(&|h| h.sun = Some(sun(1024))));
    assert!(refused(&|h| h.sun = Some(sun(1025))) && refused(&|h| h.sun = Some(sun(0))));
    assert!(refused(&|h| h.sun = Some(Sun { path: SunPath::default(), ..sun(1) })));
    assert!(refused(&|h| h.sun.get_or_insert(sun(1)).path.irradiance[0][1] = f32::NAN));
    assert!(refused(&|h| h.sun.get_or_insert(sun(1)).path.direction[0] = [1.0; 3]));
}

#[test]
fn unknown_streams_and_sections_are_skipped_unless_they_are_required() {
    let (header, payloads, bytes) = testing::bundle();
    // A second stream, behind the features of each tile: 16 bytes in the last one.
    let read = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let head = read(12);
    let ndgi = [0u32, 0, 1].map(u32::to_le_bytes).concat();
    let streams_at = bytes[..head].windows(12).rposition(|window| window == ndgi).unwrap();
    // And a second section of the file, of 5 bytes, behind the resident block.
    let with = |stream: [u32; 3], section: [u32; 2]| {
        let (table, resident) = bytes[streams_at + 12..].split_at(24);
        let resident_len = (read(streams_at + 20)).next_multiple_of(16);
        let mut out = bytes[..streams_at + 12].to_vec();
        out[56..60].copy_from_slice(&2u32.to_le_bytes());
        out[68..72].copy_from_slice(&2u32.to_le_bytes());
        out.extend(stream.map(u32::to_le_bytes).concat());
        out.extend(table);
        out.extend(section.map(u32::to_le_bytes).concat());
        out.extend([5, checksum(&[&[8; 5]])].map(u64::to_le_bytes).concat());
        let lines = resident[..24 * header.tiles()].chunks_exact(24);
        let new_head = (out.len() + 40 * header.tiles()).next_multiple_of(16);
        let moved = (new_head - head) as u64 + 16;
        for (i, line) in lines.enumerate() {
            let offset = u64::from_le_bytes(line[..8].try_into().unwrap()) + moved;
            out.extend(offset.to_le_bytes());
            out.extend(&line[8..]);
            let extra = if i + 1 == header.tiles() { 16u32 } else { 0 };
            out.extend([extra, 7].map(u32::to_le_bytes).concat());
            out.extend(if extra > 0 { checksum(&[&[9; 16]]) } else { 0 }.to_le_bytes());
        }
        out.resize(new_head, 0);
        out[12..16].copy_from_slice(&(new_head as u32).to_le_bytes());
        out.extend(&bytes[head..head + resident_len]);
        out.extend([8; 5]);
        out.extend([0; 11]);
        out.extend(&bytes[head + resident_len..]);
        out.extend([9; 16]);
        let length = out.len() as u64;
        out[16..24].copy_from_slice(&length.to_le_bytes());
        seal(&mut out);
        out
    };
    let bundle = Bundle::from_bytes(with([9, 3, 0], [7, 0])).unwrap();
    bundle.verify().unwrap();
    // A byte behind the second section, which no checksum covers.
    let mut padded = with([9, 3, 0], [7, 0]);
    let at = bundle.index[0].maps.offset as usize - 1;
    padded[at] = 1;
    let error = Bundle::from_bytes(padded).unwrap().verify().unwrap_err().to_string();
    assert!(error.contains("bytes behind a section that are not zero"), "{error}");
    for (i, place) in header.places().enumerate() {
        assert_eq!(bundle.tile(place).unwrap(), testing::tile_of(&header, i, place));
    }
    assert_eq!(bundle.header, header);
    assert_eq!(payloads.len(), bundle.index.len());
    let refused = Bundle::from_bytes(with([9, 3, 1], [7, 0])).unwrap_err();
    assert!(matches!(refused, Error::Unsupported { .. }));
    assert!(refused.to_string().contains("required stream of unknown kind 9"), "{refused}");
    let refused = Bundle::from_bytes(with([9, 3, 0], [7, 1])).unwrap_err();
    assert!(refused.to_string().contains("required section of unknown kind 7"), "{refused}");
    for wrong in [[0, 0, 1], [0, 0, 0], [1, 0, 0], [3, 0, 1]] {
        assert!(Bundle::from_bytes(with(wrong, [7, 0])).is_err(), "{wrong:?}");
    }
    assert!(Bundle::from_bytes(with([9, 3, 0], [0, 1])).is_err());
}
