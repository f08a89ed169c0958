//! EXR and mask files: round trips bit for bit, rows, foreign files, and hostile bytes.

mod common;

use common::{Random, noise_image};
use dataset::Error;
use dataset::exchange::{Origin, import};
use dataset::image::{Image, Mask, read_exr_rows, read_exr_size};
use dataset::observe::Silent;
use exr::prelude as rs;
use exr::prelude::{WritableImage, f16};
use std::fs;
use std::path::{Path, PathBuf};

fn in_file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    // A new file each time: some file systems flush one that is cut to nothing and written again.
    let _ = fs::remove_file(&path);
    fs::write(&path, bytes).unwrap();
    path
}

fn bits(texels: &[[f32; 3]]) -> Vec<[u32; 3]> {
    texels.iter().map(|texel| texel.map(f32::to_bits)).collect()
}

#[test]
fn exr_keeps_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let special = [
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        f32::from_bits(1),
        -f32::from_bits(0x7f_ffff),
        f32::MAX,
        f32::MIN,
        1.0 / 3.0,
    ];
    for (width, height) in [(1, 1), (1, 300), (129, 3), (300, 1), (37, 21)] {
        let mut random = Random(width as u64);
        let texels = (0..width * height).map(|_| {
            std::array::from_fn(|_| match random.below(3) {
                0 => special[random.below(special.len())],
                1 => random.unit(),
                // Any finite bits.
                _ => Some(f32::from_bits(random.bits() as u32))
                    .filter(|value| value.is_finite())
                    .unwrap_or(1.0),
            })
        });
        let image = Image { width, height, texels: texels.collect() };
        let bytes = image.to_exr();
        assert_eq!(bytes, image.to_exr(), "equal texels, equal bytes");
        let path = in_file(folder.path(), "a.exr", &bytes);
        let read = Image::read_exr(&path).unwrap();
        assert_eq!((read.width, read.height), (width, height));
        assert_eq!(bits(&read.texels), bits(&image.texels));
        assert_eq!(read_exr_size(&path).unwrap(), (width, height));
    }
}

#[test]
fn runs_compress() {
    assert!(Image::black(512, 512).to_exr().len() < 512 * 512 * 12 / 40);
}

#[test]
fn rows_are_the_rows_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let image = noise_image(33, 50, 1);
    let path = in_file(folder.path(), "a.exr", &image.to_exr());
    for (y0, y1) in [(0, 50), (0, 1), (49, 50), (7, 7), (50, 50), (13, 31)] {
        let rows = read_exr_rows(&path, y0, y1).unwrap();
        assert_eq!(bits(&rows), bits(&image.texels[y0 * 33..y1 * 33]), "{y0}..{y1}");
    }
    for (y0, y1) in [(0, 51), (51, 51), (5, 4)] {
        assert!(matches!(read_exr_rows(&path, y0, y1), Err(Error::Invalid { .. })));
    }
}

/// Reading rows must not read the rest: all other rows of the file are overwritten with rubbish.
#[test]
fn rows_need_no_other_rows() {
    let folder = tempfile::tempdir().unwrap();
    let image = noise_image(64, 40, 2);
    let mut bytes = image.to_exr();
    let tail = bytes.len() - 20_000;
    bytes[tail..].fill(0xee);
    let path = in_file(folder.path(), "a.exr", &bytes);
    assert_eq!(read_exr_rows(&path, 3, 9).unwrap(), image.texels[3 * 64..9 * 64]);
    Image::read_exr(&path).unwrap_err();
}

/// Writes a 70×45 image by the EXR library's own means.
macro_rules! foreign {
    ($folder:expr, $encoding:expr, $channels:expr) => {{
        let path = $folder.join("foreign.exr");
        let layer = rs::Layer::new((70, 45), rs::LayerAttributes::named("any"), $encoding, $channels);
        rs::Image::from_layer(layer).write().non_parallel().to_file(&path).unwrap();
        path
    }};
}

#[test]
fn foreign_files_are_read_or_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let image = noise_image(70, 45, 3);
    let at = |position: rs::Vec2<usize>| image.texels[position.1 * 70 + position.0];
    let encodings = [
        rs::Encoding::UNCOMPRESSED,
        rs::Encoding::FAST_LOSSLESS,
        rs::Encoding::SMALL_LOSSLESS,
        rs::Encoding {
            compression: rs::Compression::ZIP16,
            blocks: rs::Blocks::ScanLines,
            line_order: rs::LineOrder::Decreasing,
        },
    ];
    for encoding in encodings {
        // Float32, with a channel that is not requested.
        let channels = rs::SpecificChannels::rgba(|position| {
            let [r, g, b] = at(position);
            (r, g, b, 0.5f32)
        });
        let path = foreign!(folder.path(), encoding, channels);
        assert_eq!(Image::read_exr(&path).unwrap(), image, "{encoding:?}");
        assert_eq!(read_exr_rows(&path, 5, 40).unwrap(), image.texels[5 * 70..40 * 70]);
        // Float16.
        let channels = rs::SpecificChannels::rgb(|position| {
            let [r, g, b] = at(position).map(f16::from_f32);
            (r, g, b)
        });
        let path = foreign!(folder.path(), encoding, channels);
        let widened = image.texels.iter().map(|texel| texel.map(|value| f16::from_f32(value).to_f32()));
        assert_eq!(Image::read_exr(&path).unwrap().texels, widened.collect::<Vec<_>>());
    }
    let refused = |path: PathBuf, word: &str| match Image::read_exr(&path) {
        Err(Error::Unsupported { what, .. }) => assert!(what.contains(word), "{what}"),
        other => panic!("{other:?}"),
    };
    let lossy = rs::Encoding { compression: rs::Compression::PXR24, ..rs::Encoding::UNCOMPRESSED };
    let channels = rs::SpecificChannels::rgb(|position| <(f32, f32, f32)>::from(at(position)));
    refused(foreign!(folder.path(), lossy, channels), "pxr24");
    let channels = rs::SpecificChannels::rgb(|_| (1u32, 2u32, 3u32));
    refused(foreign!(folder.path(), rs::Encoding::UNCOMPRESSED, channels), "integers");
    let grey = rs::SpecificChannels::build().with_channel("Y").with_pixel_fn(|_| (1.0f32,));
    refused(foreign!(folder.path(), rs::Encoding::UNCOMPRESSED, grey), "expected R, G, B");
}

#[test]
fn a_value_that_is_not_finite_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for (value, text) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (f32::NEG_INFINITY, "-inf")] {
        let mut image = noise_image(10, 10, 4);
        image.texels[73][1] = value;
        let path = in_file(folder.path(), "bad.exr", &image.to_exr());
        let message = Image::read_exr(&path).unwrap_err().to_string();
        assert!(
            message.contains("bad.exr, texel (3, 7): channel G is") && message.contains(text),
            "{message}"
        );
    }
}

/// No truncation, no flipped bytes may panic; what is read in spite of them has the right size.
#[test]
fn hostile_exr_files_give_errors() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(5);
    let whole = noise_image(9, 7, 6).to_exr();
    for length in 0..whole.len() {
        let path = in_file(folder.path(), "cut.exr", &whole[..length]);
        assert!(Image::read_exr(&path).is_err(), "length {length}");
    }
    for _ in 0..20_000 {
        let mut bytes = whole.clone();
        for _ in 0..1 + random.below(4) {
            // Mostly in the header, where sizes and types stand.
            let reach = if random.below(3) == 0 { bytes.len() } else { 400 };
            let index = random.below(reach);
            bytes[index] = match random.below(3) {
                0 => bytes[index] ^ (1 << random.below(8)),
                1 => 0xff,
                _ => random.bits() as u8,
            };
        }
        let path = in_file(folder.path(), "flipped.exr", &bytes);
        if let Ok(image) = Image::read_exr(&path) {
            assert_eq!(image.texels.len(), image.width * image.height);
        }
        if let Ok((_, height)) = read_exr_size(&path) {
            let _ = read_exr_rows(&path, height / 2, height);
        }
    }
}

#[test]
fn a_header_cannot_ask_for_more_memory_than_its_file_can_fill() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = noise_image(9, 7, 6).to_exr();
    // dataWindow: box2i, length 16, then xMin yMin xMax yMax.
    let window = bytes.windows(10).position(|window| window == b"dataWindow").unwrap();
    let max = window + b"dataWindow\0box2i\0".len() + 4 + 8;
    bytes[max..max + 4].copy_from_slice(&60_000i32.to_le_bytes());
    let path = in_file(folder.path(), "wide.exr", &bytes);
    let message = Image::read_exr(&path).unwrap_err().to_string();
    assert!(message.contains("cannot hold the 60001×7"), "{message}");
}

#[test]
fn a_missing_file_is_an_io_error_that_names_it() {
    let error = Image::read_exr(Path::new("no/such.exr")).unwrap_err();
    assert!(matches!(error, Error::Io { .. }) && error.to_string().contains("no/such.exr"));
}

#[test]
fn masks_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(7);
    for (width, height) in [(1, 1), (129, 5), (64, 64)] {
        let valid = (0..width * height).map(|_| random.below(2) == 0).collect();
        let mask = Mask { width, height, valid };
        let path = in_file(folder.path(), "mask.png", &mask.to_png());
        assert_eq!(Mask::read_png(&path).unwrap(), mask);
    }
}

fn png(samples: &[u8], width: u32, height: u32, colour: image::ExtendedColorType) -> Vec<u8> {
    use image::ImageEncoder;
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes).write_image(samples, width, height, colour).unwrap();
    bytes
}

#[test]
fn other_png_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path =
        in_file(folder.path(), "grey.png", &png(&[0, 255, 255, 254], 2, 2, image::ExtendedColorType::L8));
    let message = Mask::read_png(&path).unwrap_err().to_string();
    assert!(message.contains("grey.png, texel (1, 1): mask value 254"), "{message}");
    for (colour, bytes) in [(image::ExtendedColorType::Rgb8, 3), (image::ExtendedColorType::L16, 2)] {
        let path = in_file(folder.path(), "colour.png", &png(&vec![0; 4 * bytes], 2, 2, colour));
        assert!(matches!(Mask::read_png(&path), Err(Error::Unsupported { .. })));
    }
}

#[test]
fn hostile_png_files_give_errors() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(8);
    let whole = common::full_mask(9, 7).to_png();
    for length in 0..whole.len() {
        let path = in_file(folder.path(), "cut.png", &whole[..length]);
        // The end mark may be missing where all texels are there.
        if let Ok(mask) = Mask::read_png(&path) {
            assert!(length + 12 >= whole.len(), "length {length}");
            assert_eq!(mask, common::full_mask(9, 7));
        }
    }
    for _ in 0..1000 {
        let mut bytes = whole.clone();
        let index = random.below(bytes.len());
        bytes[index] = random.bits() as u8;
        let path = in_file(folder.path(), "flipped.png", &bytes);
        if let Ok(mask) = Mask::read_png(&path) {
            assert_eq!(mask.valid.len(), mask.width * mask.height);
        }
    }
}

/// Compression of newer files, and other formats, are told by name, wherever a file is read.
#[test]
fn what_is_no_exr_that_can_be_read_is_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("light_12.exr");
    let whole = Image::black(4, 2).to_exr();
    let attribute = b"compression\0compression\0\x01\0\0\0";
    let at = whole.windows(attribute.len()).position(|bytes| bytes == attribute).unwrap() + attribute.len();
    let with = |compression: u8| {
        let mut bytes = whole.clone();
        bytes[at] = compression;
        bytes
    };
    for (bytes, told) in [
        (with(10), "HTJ2K compression is not read: `oiiotool "),
        (with(11), "HTJ2K compression is not read: `oiiotool "),
        (
            with(12),
            "compression number 12 (ZSTD, or another of OpenEXR 3.5 or later) is not read: `oiiotool ",
        ),
        (b"#?RADIANCE\n".to_vec(), "a Radiance picture (.hdr); expected an OpenEXR file: `oiiotool "),
        (b"\x89PNG".to_vec(), "not an OpenEXR file, by its first bytes"),
        (Vec::new(), "not an OpenEXR file, by its first bytes"),
        (whole[..at].to_vec(), "damaged EXR file"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let read = Image::read_exr(&path).unwrap_err().to_string();
        let pattern = "light_{hour}.exr".to_owned();
        let origin = Origin::Pattern { folder: folder.path().to_owned(), pattern, mask: None, layer: None };
        let out = folder.path().join("out");
        let imported = import(&origin, &out, &Silent).unwrap_err().to_string();
        for message in [read, imported] {
            assert!(message.contains("light_12.exr") && message.contains(told), "{message}");
        }
    }
}
