//! From a bundle to a device: all of its tiles, read once.

use crate::Result;
use crate::place::Spot;
use crate::shader;
use crate::tile::{Maps, Seen, Tile};
use ndgi::Bundle;
use ndgi::bc7;
use ndgi::grid::Place;
use ndgi::model::Contents;

/// The sizes of all maps of BC7, in the order in which [`Loading::tile`] asks for their places, and the most that a strip reads of F_uvt. The index
/// tells them.
pub(crate) fn sizes(bundle: &Bundle) -> (Vec<[u32; 2]>, usize) {
    let (mut sizes, mut coarse) = (Vec::new(), 0);
    for (entry, place) in bundle.index.iter().zip(bundle.header.places()) {
        let contents = Contents::of_word(entry.ndgi.word).filter(|_| entry.ndgi.length > 0);
        let Some(shape) = contents.map(|contents| bundle.header.shape(place, &contents)) else { continue };
        let [width, height, slices] = shape.uvt;
        sizes.extend(shape.contents.uv.then_some([shape.width as u32, shape.height as u32]));
        sizes.extend(vec![[width as u32, height as u32]; slices]);
        coarse = coarse.max(shader::coarse([width, height], shape.height));
    }
    (sizes, coarse)
}

/// What is being put on a device.
pub(crate) struct Loading<'a> {
    pub queue: &'a wgpu::Queue,
    pub texture: &'a wgpu::Texture,
    pub unpacks: bool,
    pub resident: Vec<u32>,
    /// Words of the interval's buffer so far.
    pub interval: u32,
}

impl Loading<'_> {
    /// Reads a tile and uploads its maps.
    pub fn tile(
        &mut self,
        bundle: &Bundle,
        place: Place,
        spots: &mut impl Iterator<Item = Spot>,
    ) -> Result<Tile> {
        let mut tile = Tile::default();
        if let Some(params) = bundle.tile(place)? {
            let shape = params.shape;
            let [width, height, slices] = shape.uvt;
            let uv = if shape.contents.uv { spots.next() } else { None };
            let of_slices: Vec<Spot> = spots.take(slices).collect();
            if let Some(spot) = uv {
                self.upload([shape.width, shape.height], spot, &params.f_uv)?;
            }
            for (spot, blocks) in of_slices.iter().zip(params.f_uvt.chunks((width * height / 16).max(1))) {
                self.upload([width, height], *spot, blocks)?;
            }
            tile.maps = Some(Maps::new(params, uv, of_slices, &mut self.resident));
        }
        if let Some(sun) = bundle.sun(place)? {
            tile.seen = Some(Seen::new(&sun, &mut self.resident, &mut self.interval));
        }
        Ok(tile)
    }

    /// Puts a map of BC7 blocks in its place, unpacked if need be.
    fn upload(&self, [width, height]: [usize; 2], [x, y, layer]: Spot, blocks: &[[u8; 16]]) -> Result<()> {
        let mut texels = Vec::new();
        if self.unpacks {
            texels.resize(4 * width * height, 0);
            for (i, block) in blocks.iter().enumerate() {
                let corner = i / (width / 4) * 4 * width + i % (width / 4) * 4;
                for (j, texel) in bc7::decode(block)?.iter().enumerate() {
                    let at = 4 * (corner + j / 4 * width + j % 4);
                    texels[at..at + 4].copy_from_slice(texel);
                }
            }
        } else {
            blocks.iter().try_for_each(bc7::check)?;
        }
        // A row of texels of four bytes, or of blocks of 16 that are four texels wide.
        let bytes_per_row = Some(4 * width as u32);
        self.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: self.texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x, y, z: layer },
                aspect: wgpu::TextureAspect::All,
            },
            if self.unpacks { &texels } else { blocks.as_flattened() },
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None },
            wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: 1 },
        );
        Ok(())
    }
}
