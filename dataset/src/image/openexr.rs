//! EXR files, row by row: written for datasets, read from anywhere.

use super::refuse_size;
use crate::{Error, Result};
use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::meta::BlockDescription;
use exr::meta::header::{Header, LayerAttributes};
use exr::prelude::{ChannelDescription, Compression, LineOrder, SampleType, Vec2, f16};
use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Bytes in which a header tells the compression; its attributes are few and short.
const HEAD_BYTES: u64 = 1 << 16;

/// Names of the channels that hold red, green and blue; one name three times for a grey image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Channels(pub [String; 3]);

/// The bytes of an EXR file as [`super::Image::to_exr`] gives them, of an image that need not be in memory:
/// `fill(y, row)` writes the texels of row y.
///
/// # Panics
/// If the image has no texels.
pub fn exr_of(width: usize, height: usize, mut fill: impl FnMut(usize, &mut [[f32; 3]])) -> Vec<u8> {
    let mut bytes = Vec::new();
    let fill = |y: usize, row: &mut [[f32; 3]]| {
        fill(y, row);
        Ok(())
    };
    write_exr(Path::new("memory"), Cursor::new(&mut bytes), (width, height), fill)
        .expect("writing a valid image into memory cannot fail");
    bytes
}

/// [`exr_of`] into a file, named by `path` in errors. Neither the image nor the file is held in memory; an
/// error of `fill` ends the writing.
///
/// # Panics
/// If the image has no texels.
pub(crate) fn write_exr(
    path: &Path,
    out: impl Write + Seek,
    (width, height): (usize, usize),
    mut fill: impl FnMut(usize, &mut [[f32; 3]]) -> Result<()>,
) -> Result<()> {
    assert!(width > 0 && height > 0, "an EXR file needs at least one texel");
    // Scan lines in increasing order; channels are sorted by name in the file.
    let channel = |name: &str| ChannelDescription::named(name, SampleType::F32);
    let header = Header::new(
        Default::default(),
        (width, height),
        [channel("B"), channel("G"), channel("R")].into_iter().collect(),
    )
    .with_encoding(Compression::RLE, BlockDescription::ScanLines, LineOrder::Increasing)
    .with_attributes(LayerAttributes::default());
    let mut row = vec![[0.0; 3]; width];
    let mut filled = None;
    let mut refused = None;
    let written = exr::block::write(out, [header].into_iter().collect(), true, |meta, writer| {
        use exr::block::writer::ChunksWriter;
        for (index_in_header, block) in exr::block::enumerate_ordered_header_block_indices(&meta.headers) {
            let channels = &meta.headers[block.layer].channels;
            let block = UncompressedBlock::from_lines(channels, block, |line| {
                // Channel 0 is B, 2 is R.
                let component = 2 - line.location.channel;
                let y = line.location.position.y();
                // The row's channels come one after another.
                if filled.replace(y) != Some(y) && refused.is_none() {
                    refused = fill(y, &mut row).err();
                }
                for (bytes, texel) in line.value.as_chunks_mut::<4>().0.iter_mut().zip(&row) {
                    *bytes = texel[component].to_ne_bytes();
                }
            });
            if refused.is_some() {
                return Err(exr::error::Error::Aborted);
            }
            writer.write_chunk(index_in_header, block.compress_to_chunk(&meta.headers)?)?;
        }
        Ok(())
    });
    match (refused, written) {
        (Some(error), _) => Err(error),
        (None, Err(exr::error::Error::Io(source))) => Err(Error::Io { path: path.to_owned(), source }),
        (None, Err(error)) => Err(Error::invalid(path.display(), error)),
        (None, Ok(())) => Ok(()),
    }
}

/// Width and height of an EXR file with channels R, G, B, from its header alone.
pub fn read_exr_size(path: &Path) -> Result<(usize, usize)> {
    let reader = open_rgb(path)?;
    let size = reader.headers()[0].layer_size;
    Ok((size.width(), size.height()))
}

/// Reads rows `y0 .. y1` of an RGB EXR file (float32, or float16 widened) without reading the rest into
/// memory. The values are not checked. The file may be uncompressed or use RLE, ZIP or PIZ, in scan lines or
/// tiles.
pub fn read_exr_rows(path: &Path, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
    rows_of(path, open_rgb(path)?, &rgb(), y0, y1)
}

/// [`read_exr_rows`] of channels of any name, in a file of any compression that can be read.
pub(crate) fn read_rows_of(path: &Path, channels: &Channels, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
    rows_of(path, open_exr(path, channels)?, channels, y0, y1)
}

fn rows_of(path: &Path, reader: Reader, names: &Channels, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
    let header = reader.headers()[0].clone();
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    if y0 > y1 || y1 > height {
        return Err(Error::invalid(
            path.display(),
            format!("rows {y0}..{y1} asked for, the image has {height}"),
        ));
    }
    // Components (R 0, G 1, B 2) that each channel of the file gives.
    let given = |channel: &ChannelDescription| -> Vec<usize> {
        (0..3).filter(|&component| channel.name == *names.0[component]).collect()
    };
    let components: Vec<Vec<usize>> = header.channels.list.iter().map(given).collect();

    let mut texels = vec![[0.0f32; 3]; width * (y1 - y0)];
    let mut samples_in_row = vec![0usize; y1 - y0];
    guarded(path, || {
        // Only the blocks that touch the rows are read and decompressed.
        let chunks = reader.filter_chunks(true, |_, tile, block| {
            let top = block.pixel_position.y();
            tile.is_largest_resolution_level() && top < y1 && top + block.pixel_size.height() > y0
        })?;
        chunks.decompress_sequential(true, |_, block| {
            for line in block.lines(&header.channels) {
                let Vec2(x, y) = line.location.position;
                let components = &components[line.location.channel];
                if components.is_empty() || !(y0..y1).contains(&y) {
                    continue;
                }
                let start = (y - y0) * width + x;
                let Some(row) = texels.get_mut(start..start + line.location.sample_count) else {
                    return Err(exr::error::Error::Invalid("block outside the image".into()));
                };
                match header.channels.list[line.location.channel].sample_type {
                    SampleType::F32 => {
                        for (texel, bytes) in row.iter_mut().zip(line.value.as_chunks::<4>().0) {
                            components.iter().for_each(|&c| texel[c] = f32::from_ne_bytes(*bytes));
                        }
                    }
                    _ => {
                        for (texel, bytes) in row.iter_mut().zip(line.value.as_chunks::<2>().0) {
                            components.iter().for_each(|&c| texel[c] = f16::from_ne_bytes(*bytes).to_f32());
                        }
                    }
                }
                samples_in_row[y - y0] += components.len() * line.location.sample_count;
            }
            Ok(())
        })
    })?;
    // Every row must have come, once.
    match samples_in_row.iter().position(|&samples| samples != 3 * width) {
        Some(row) => {
            Err(Error::invalid(path.display(), format!("row {} is missing or occurs twice", y0 + row)))
        }
        None => Ok(texels),
    }
}

/// An opened file.
type Reader = exr::block::reader::Reader<BufReader<File>>;

/// The channels of a dataset's own files.
fn rgb() -> Channels {
    Channels(["R", "G", "B"].map(str::to_owned))
}

/// Opens an EXR file as a dataset has them: channels R, G, B, nothing lost by compression.
fn open_rgb(path: &Path) -> Result<Reader> {
    let reader = open_exr(path, &rgb())?;
    let header = &reader.headers()[0];
    let compression = header.compression;
    if header.channels.list.iter().any(|channel| !compression.is_lossless_for(channel.sample_type)) {
        let what = format!("{compression}; expected lossless compression: none, RLE, ZIP or PIZ");
        return Err(Error::unsupported(path.display(), what));
    }
    Ok(reader)
}

/// Finds the channels of red, green and blue, and the image's size. They may be called `R`, `r` or `Red`, or
/// there may be one of luminance (`Y`), or one of any name alone; where several layers have them, `layer`
/// names the one to take (all before the last dot).
pub(crate) fn find_channels(path: &Path, layer: Option<&str>) -> Result<(Channels, (usize, usize))> {
    let reader = open_header(path)?;
    let all: Vec<String> = reader.headers()[0].channels.list.iter().map(|c| c.name.to_string()).collect();
    let split = |name: &str| match name.rsplit_once('.') {
        Some((layer, channel)) => (layer.to_owned(), channel.to_ascii_lowercase()),
        None => (String::new(), name.to_ascii_lowercase()),
    };
    let find = |layer: &str, aliases: [&str; 2]| {
        all.iter().find(|name| {
            let (of, channel) = split(name);
            of == layer && aliases.contains(&channel.as_str())
        })
    };
    let of_layer = |layer: &str| -> Option<Channels> {
        let rgb = [["r", "red"], ["g", "green"], ["b", "blue"]].map(|aliases| find(layer, aliases).cloned());
        match (rgb, find(layer, ["y", "luminance"])) {
            ([Some(r), Some(g), Some(b)], _) => Some(Channels([r, g, b])),
            ([None, None, None], Some(grey)) => Some(Channels([(); 3].map(|()| grey.clone()))),
            _ => None,
        }
    };
    let mut layers: Vec<String> = all.iter().map(|name| split(name).0).collect();
    layers.sort();
    layers.dedup();
    let candidates: Vec<(&String, Channels)> =
        layers.iter().filter_map(|layer| Some((layer, of_layer(layer)?))).collect();
    let reported = |what: &str| format!("channels {}; {what}", all.join(", "));
    let found = match (layer, &*candidates) {
        (Some(layer), _) => {
            of_layer(layer).ok_or_else(|| reported(&format!("expected R, G, B of the layer {layer:?}")))
        }
        (None, []) => match &*all {
            [only] => Ok(Channels([(); 3].map(|()| only.clone()))),
            _ => Err(reported("expected R, G, B")),
        },
        (None, [(_, channels)]) => Ok(channels.clone()),
        // Channels without a layer are the image itself.
        (None, several) => match several.iter().find(|(layer, _)| layer.is_empty()) {
            Some((_, channels)) => Ok(channels.clone()),
            None => Err(reported("expected R, G, B of one layer; choose it with --layer")),
        },
    };
    let channels = found.map_err(|what| Error::unsupported(path.display(), what))?;
    let size = open_exr(path, &channels)?.headers()[0].layer_size;
    Ok((channels, (size.width(), size.height())))
}

/// Refuses other formats, and compression that cannot be read, by name; `head` is how the file begins.
fn refuse_foreign(path: &Path, head: &[u8]) -> Result<()> {
    let file = path.display();
    let convert = format!("`oiiotool {file} --compression zip -o converted.exr` converts it");
    if head.starts_with(b"#?") {
        let what = format!("a Radiance picture (.hdr); expected an OpenEXR file: {convert}");
        return Err(Error::unsupported(file, what));
    }
    if !head.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return Err(Error::invalid(file, "not an OpenEXR file, by its first bytes"));
    }
    // An attribute: its name, its type, the length of its value, its value.
    const ATTRIBUTE: &[u8] = b"compression\0compression\0\x01\0\0\0";
    let at = head.windows(ATTRIBUTE.len()).position(|bytes| bytes == ATTRIBUTE);
    let compression = match at.and_then(|at| head.get(at + ATTRIBUTE.len())) {
        None | Some(..10) => return Ok(()),
        Some(10 | 11) => "HTJ2K compression".to_owned(),
        Some(number) => format!("compression number {number} (ZSTD, or another of OpenEXR 3.5 or later)"),
    };
    Err(Error::unsupported(file, format!("{compression} is not read: {convert}")))
}

/// Opens an EXR file and checks that it is one flat image.
fn open_header(path: &Path) -> Result<Reader> {
    let mut file = File::open(path).map_err(Error::io(path))?;
    let mut head = Vec::new();
    (&mut file).take(HEAD_BYTES).read_to_end(&mut head).map_err(Error::io(path))?;
    refuse_foreign(path, &head)?;
    file.rewind().map_err(Error::io(path))?;
    let reader = guarded(path, || exr::block::read(BufReader::with_capacity(1 << 16, file), true))?;
    let unsupported = |what: String| Err(Error::unsupported(path.display(), what));
    match reader.headers() {
        [header] if header.deep => unsupported("deep data; expected a flat image".into()),
        [_] => Ok(reader),
        parts => unsupported(format!("{} parts; expected one image", parts.len())),
    }
}

/// Opens an EXR file and checks that this module reads the channels.
fn open_exr(path: &Path, channels: &Channels) -> Result<Reader> {
    let reader = open_header(path)?;
    let file_bytes = std::fs::metadata(path).map_err(Error::io(path))?.len();
    let unsupported = |what: String| Err(Error::unsupported(path.display(), what));
    let header = &reader.headers()[0];
    for name in &channels.0 {
        match header.channels.list.iter().find(|channel| channel.name == **name) {
            None => {
                let names: Vec<String> =
                    header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
                let expected = channels.0.join(", ");
                return unsupported(format!("channels {}; expected {expected}", names.join(", ")));
            }
            Some(channel) if channel.sample_type == SampleType::U32 => {
                return unsupported(format!("channel {name} holds integers; expected float32 or float16"));
            }
            Some(_) => {}
        }
    }
    if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return unsupported("sub-sampled channels; expected one sample per texel".into());
    }
    if header.own_attributes.layer_position != Vec2(0, 0) {
        return unsupported("a data window that does not start at (0, 0)".into());
    }
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    refuse_size(path, width, height, header.channels.bytes_per_pixel as u64, file_bytes)?;
    Ok(reader)
}

/// Runs a step of the EXR library; its errors, and a panic on bytes it did not foresee, become ours.
fn guarded<T>(path: &Path, step: impl FnOnce() -> exr::error::Result<T>) -> Result<T> {
    match catch_unwind(AssertUnwindSafe(step)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(exr::error::Error::Io(source))) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            Err(Error::Io { path: path.to_owned(), source })
        }
        Ok(Err(exr::error::Error::NotSupported(what))) => {
            Err(Error::unsupported(path.display(), format!("EXR feature not supported: {what}")))
        }
        Ok(Err(error)) => Err(Error::invalid(path.display(), format!("damaged EXR file: {error}"))),
        Err(_) => Err(Error::invalid(path.display(), "damaged EXR file")),
    }
}
