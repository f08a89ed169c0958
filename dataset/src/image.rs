//! Images in memory and their files: RGB float32 EXR and 8-bit masks.

use crate::{Error, Result};
use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::meta::BlockDescription;
use exr::meta::header::{Header, LayerAttributes};
use exr::prelude::{ChannelDescription, Compression, LineOrder, SampleType, Vec2, f16};
use image::ImageDecoder;
use std::fs::File;
use std::io::{BufReader, Cursor};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Largest width and height that is read.
pub const MAX_SIDE: usize = 65536;

/// No compression of EXR or PNG shrinks data by more than this factor (deflate: 1032); a file that claims more
/// texels than its length can hold is refused before anything is allocated.
const MAX_COMPRESSION_RATIO: u64 = 1100;

/// A row-major RGB float32 image, linear Rec. 709.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// `width · height` texels, row by row from the top.
    pub texels: Vec<[f32; 3]>,
}

/// A row-major validity mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// True where the texel lies on a surface.
    pub valid: Vec<bool>,
}

impl Image {
    /// A black image.
    pub fn black(width: usize, height: usize) -> Self {
        Image { width, height, texels: vec![[0.0; 3]; width * height] }
    }

    /// The image as the bytes of an EXR file (channels R, G, B; float32; RLE), the same for the same texels.
    ///
    /// # Panics
    /// If the image has no texels, or their number is not `width · height`.
    pub fn to_exr(&self) -> Vec<u8> {
        assert_eq!(
            self.texels.len(),
            self.width * self.height,
            "texels of a {}×{} image",
            self.width,
            self.height
        );
        exr_of(self.width, self.height, |y, row| {
            row.copy_from_slice(&self.texels[y * self.width..(y + 1) * self.width])
        })
    }

    /// Reads an EXR file with channels R, G, B. Every texel must be finite; layers' negative values are the caller's rule.
    pub fn read_exr(path: &Path) -> Result<Self> {
        let image = Self::read_exr_unchecked(path)?;
        refuse_texels(path, image.width, 0, &image.texels, |value| !value.is_finite(), "a finite value")?;
        Ok(image)
    }

    /// [`Image::read_exr`] without a look at the values.
    pub(crate) fn read_exr_unchecked(path: &Path) -> Result<Self> {
        let (width, height) = read_exr_size(path)?;
        Ok(Image { width, height, texels: read_exr_rows(path, 0, height)? })
    }
}

/// The bytes of an EXR file as [`Image::to_exr`] gives them, of an image that need not be in memory: `fill(y, row)` writes the texels of
/// row y.
///
/// # Panics
/// If the image has no texels.
pub fn exr_of(width: usize, height: usize, mut fill: impl FnMut(usize, &mut [[f32; 3]])) -> Vec<u8> {
    assert!(width > 0 && height > 0, "an EXR file needs at least one texel");
    // Scan lines in increasing order; channels stand in the file by ascending name.
    let channel = |name: &str| ChannelDescription::named(name, SampleType::F32);
    let header = Header::new(
        Default::default(),
        (width, height),
        [channel("B"), channel("G"), channel("R")].into_iter().collect(),
    )
    .with_encoding(Compression::RLE, BlockDescription::ScanLines, LineOrder::Increasing)
    .with_attributes(LayerAttributes::default());
    let mut bytes = Vec::new();
    let mut row = vec![[0.0; 3]; width];
    let mut filled = None;
    exr::block::write(Cursor::new(&mut bytes), [header].into_iter().collect(), true, |meta, writer| {
        use exr::block::writer::ChunksWriter;
        for (index_in_header, block) in exr::block::enumerate_ordered_header_block_indices(&meta.headers) {
            let channels = &meta.headers[block.layer].channels;
            let block = UncompressedBlock::from_lines(channels, block, |line| {
                // Channel 0 is B, 2 is R.
                let component = 2 - line.location.channel;
                let y = line.location.position.y();
                // The row's channels come one after another.
                if filled.replace(y) != Some(y) {
                    fill(y, &mut row);
                }
                for (bytes, texel) in line.value.as_chunks_mut::<4>().0.iter_mut().zip(&row) {
                    *bytes = texel[component].to_ne_bytes();
                }
            });
            writer.write_chunk(index_in_header, block.compress_to_chunk(&meta.headers)?)?;
        }
        Ok(())
    })
    .expect("writing a valid image into memory cannot fail");
    bytes
}

/// Width and height of an EXR file with channels R, G, B, from its header alone.
pub fn read_exr_size(path: &Path) -> Result<(usize, usize)> {
    let reader = open_exr(path)?;
    let size = reader.headers()[0].layer_size;
    Ok((size.width(), size.height()))
}

/// Reads rows `y0 .. y1` of an RGB EXR file (float32, or float16 widened) without reading the rest into memory.
/// The values are not looked at. The file may be uncompressed or use RLE, ZIP or PIZ, in scan lines or tiles.
pub fn read_exr_rows(path: &Path, y0: usize, y1: usize) -> Result<Vec<[f32; 3]>> {
    let reader = open_exr(path)?;
    let header = reader.headers()[0].clone();
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    if y0 > y1 || y1 > height {
        return Err(Error::invalid(
            path.display(),
            format!("rows {y0}..{y1} asked for, the image has {height}"),
        ));
    }
    // Component (R 0, G 1, B 2) of each channel of the file.
    let components: Vec<Option<usize>> = header
        .channels
        .list
        .iter()
        .map(|channel| ["R", "G", "B"].iter().position(|name| channel.name == **name))
        .collect();

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
                let (Some(component), true) = (components[line.location.channel], (y0..y1).contains(&y))
                else {
                    continue;
                };
                let start = (y - y0) * width + x;
                let Some(row) = texels.get_mut(start..start + line.location.sample_count) else {
                    return Err(exr::error::Error::Invalid("block outside the image".into()));
                };
                match header.channels.list[line.location.channel].sample_type {
                    SampleType::F32 => {
                        for (texel, bytes) in row.iter_mut().zip(line.value.as_chunks::<4>().0) {
                            texel[component] = f32::from_ne_bytes(*bytes);
                        }
                    }
                    _ => {
                        for (texel, bytes) in row.iter_mut().zip(line.value.as_chunks::<2>().0) {
                            texel[component] = f16::from_ne_bytes(*bytes).to_f32();
                        }
                    }
                }
                samples_in_row[y - y0] += line.location.sample_count;
            }
            Ok(())
        })
    })?;
    // Every row must have come, once.
    match samples_in_row.iter().position(|&samples| samples != 3 * width) {
        Some(row) => {
            Err(Error::invalid(path.display(), format!("row {} is missing or there twice", y0 + row)))
        }
        None => Ok(texels),
    }
}

/// Opens an EXR file and checks that it is one image of channels R, G, B that this module reads.
fn open_exr(path: &Path) -> Result<exr::block::reader::Reader<BufReader<File>>> {
    let file = File::open(path).map_err(Error::io(path))?;
    let file_bytes = file.metadata().map_err(Error::io(path))?.len();
    let reader = guarded(path, || exr::block::read(BufReader::with_capacity(1 << 16, file), true))?;
    let unsupported = |what: String| Err(Error::unsupported(path.display(), what));
    let [header] = reader.headers() else {
        return unsupported(format!("{} parts; expected one image", reader.headers().len()));
    };
    if header.deep {
        return unsupported("deep data; expected a flat image".into());
    }
    for name in ["R", "G", "B"] {
        match header.channels.list.iter().find(|channel| channel.name == *name) {
            None => {
                let names: Vec<String> =
                    header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
                return unsupported(format!("channels {}; expected R, G, B", names.join(", ")));
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
    if !header.compression.is_lossless_for(SampleType::F32) {
        return unsupported(format!(
            "{}; expected a lossless one: none, RLE, ZIP or PIZ",
            header.compression
        ));
    }
    if header.own_attributes.layer_position != Vec2(0, 0) {
        return unsupported("a data window that does not start at (0, 0)".into());
    }
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    refuse_size(path, width, height, header.channels.bytes_per_pixel as u64, file_bytes)?;
    Ok(reader)
}

/// Refuses sizes of zero, beyond [`MAX_SIDE`], or beyond what `file_bytes` can hold.
fn refuse_size(path: &Path, width: usize, height: usize, texel_bytes: u64, file_bytes: u64) -> Result<()> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        let what = format!("size {width}×{height}; expected 1 to {MAX_SIDE} texels on a side");
        return Err(Error::unsupported(path.display(), what));
    }
    if width as u64 * height as u64 * texel_bytes > file_bytes * MAX_COMPRESSION_RATIO {
        let what =
            format!("{file_bytes} bytes cannot hold the {width}×{height} texels that the header names");
        return Err(Error::invalid(path.display(), what));
    }
    Ok(())
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

/// The first texel with a value that is `bad`, as an error that names file, (x, y), channel and value.
/// `texels` are whole rows of `width` texels from row `y0` on.
pub(crate) fn refuse_texels(
    path: &Path,
    width: usize,
    y0: usize,
    texels: &[[f32; 3]],
    bad: impl Fn(f32) -> bool,
    expected: &str,
) -> Result<()> {
    let Some(index) = texels.iter().position(|texel| texel.iter().any(|&value| bad(value))) else {
        return Ok(());
    };
    let channel = texels[index].iter().position(|&value| bad(value)).unwrap_or(0);
    let (x, y) = (index % width, y0 + index / width);
    let place = format!("{}, texel ({x}, {y})", path.display());
    let what =
        format!("channel {} is {}; expected {expected}", ["R", "G", "B"][channel], texels[index][channel]);
    Err(Error::invalid(place, what))
}

impl Mask {
    /// The mask as the bytes of an 8-bit grey PNG: 255 valid, 0 not.
    ///
    /// # Panics
    /// If the mask has no texels, or their number is not `width · height`.
    pub fn to_png(&self) -> Vec<u8> {
        let grey: Vec<u8> = self.valid.iter().map(|&valid| if valid { 255 } else { 0 }).collect();
        encode_png(&grey, self.width, self.height, image::ExtendedColorType::L8)
    }

    /// Reads a grey PNG whose texels are 0 or 255.
    pub fn read_png(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path))?;
        let file_bytes = file.metadata().map_err(Error::io(path))?.len();
        let damaged = |error: image::ImageError| match error {
            image::ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
                Error::Io { path: path.to_owned(), source }
            }
            error => Error::invalid(path.display(), format!("damaged PNG file: {error}")),
        };
        let decoder = image::codecs::png::PngDecoder::new(BufReader::new(file)).map_err(damaged)?;
        if decoder.color_type() != image::ColorType::L8 {
            let what = format!("colour type {:?}; expected 8-bit grey", decoder.color_type());
            return Err(Error::unsupported(path.display(), what));
        }
        let (width, height) = decoder.dimensions();
        let (width, height) = (width as usize, height as usize);
        refuse_size(path, width, height, 1, file_bytes)?;
        let mut grey = vec![0; width * height];
        decoder.read_image(&mut grey).map_err(damaged)?;
        if let Some(index) = grey.iter().position(|&value| value != 0 && value != 255) {
            let place = format!("{}, texel ({}, {})", path.display(), index % width, index / width);
            return Err(Error::invalid(place, format!("mask value {}; expected 0 or 255", grey[index])));
        }
        Ok(Mask { width, height, valid: grey.iter().map(|&value| value == 255).collect() })
    }

    /// Number of valid texels.
    pub fn count(&self) -> usize {
        self.valid.iter().filter(|&&valid| valid).count()
    }
}

/// `width · height` samples of the colour type as a PNG file.
pub(crate) fn encode_png(
    samples: &[u8],
    width: usize,
    height: usize,
    colour: image::ExtendedColorType,
) -> Vec<u8> {
    use image::ImageEncoder;
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(samples, width as u32, height as u32, colour)
        .expect("writing a valid picture into memory cannot fail");
    bytes
}
