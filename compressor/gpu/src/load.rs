//! From a bundle towards a device: a tile's data in the form in which they are uploaded.

use crate::Result;
use crate::place::{Spot, shelves};
use crate::survey;
use crate::tile::Maps;
use ndgi::bc7;
use ndgi::model::TileParams;

/// A tile's large data, as they are uploaded.
#[derive(Debug, Default)]
pub(crate) struct Data {
    /// Its part of the resident buffer: weights, F_ut and F_vt, normals.
    pub words: Vec<u32>,
    pub picture: Picture,
}

/// All maps of BC7 of a tile, put together.
#[derive(Debug, Default)]
pub(crate) struct Picture {
    /// Width and height, in texels.
    pub size: [u32; 2],
    /// Where maps lie on it, and their sizes, in the order of [`survey::maps`].
    pub maps: Vec<(Spot, [u32; 2])>,
    /// Row by row of blocks, or of RGBA8 texels.
    bytes: Vec<u8>,
    pub unpacks: bool,
}

impl Data {
    /// Of what [`ndgi::Bundle::tile`] gave, which checked it.
    pub(crate) fn maps(&mut self, mut params: TileParams, unpacks: bool) -> Result<Maps> {
        let mut blocks = std::mem::take(&mut params.f_uv);
        blocks.append(&mut params.f_uvt);
        self.picture = Picture::new(&survey::maps(&params.shape), &blocks, unpacks)?;
        Ok(Maps::new(params, &mut self.words))
    }
}

impl Picture {
    fn new(sizes: &[[u32; 2]], blocks: &[[u8; 16]], unpacks: bool) -> Result<Self> {
        let (size, spots) = shelves(sizes);
        let texel = if unpacks { 4 } else { 1 };
        let bytes = vec![0; texel * size[0] as usize * size[1] as usize];
        let mut picture =
            Picture { size, maps: spots.into_iter().zip(sizes.iter().copied()).collect(), bytes, unpacks };
        let mut blocks = blocks.iter();
        for map in 0..picture.maps.len() {
            let ([x, y, _], [width, height]) = picture.maps[map];
            for (y, x) in
                (y..y + height).step_by(4).flat_map(|y| (x..x + width).step_by(4).map(move |x| (y, x)))
            {
                let Some(block) = blocks.next() else { break };
                picture.put([x, y], block)?;
            }
        }
        Ok(picture)
    }

    /// Puts a block in its place, unpacked if need be.
    fn put(&mut self, at: [u32; 2], block: &[u8; 16]) -> Result<()> {
        let start = self.offset(at);
        if !self.unpacks {
            self.bytes[start..start + 16].copy_from_slice(block);
            return Ok(());
        }
        let stride = 4 * self.size[0] as usize;
        for (i, texel) in bc7::decode(block)?.iter().enumerate() {
            let at = start + i / 4 * stride + i % 4 * 4;
            self.bytes[at..at + 4].copy_from_slice(texel);
        }
        Ok(())
    }

    /// Where in `bytes` the block at a texel begins.
    fn offset(&self, [x, y]: [u32; 2]) -> usize {
        // A row of texels of four bytes, or of blocks of 16 that are four texels wide.
        let (stride, row) = (4 * self.size[0] as usize, if self.unpacks { y } else { y / 4 });
        row as usize * stride + 4 * x as usize
    }

    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes.len() as u64
    }

    /// Uploads a rectangle of it, whose corner and size are multiples of 4, before the next submission.
    pub(crate) fn upload(
        &self,
        queue: &wgpu::Queue,
        texture: &wgpu::Texture,
        from: [u32; 2],
        [width, height]: [u32; 2],
        [x, y, z]: Spot,
    ) {
        if width * height == 0 {
            return;
        }
        let offset = self.offset(from) as u64;
        queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x, y, z },
                aspect: wgpu::TextureAspect::All,
            },
            &self.bytes,
            wgpu::TexelCopyBufferLayout {
                offset,
                bytes_per_row: Some(4 * self.size[0]),
                rows_per_image: None,
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
}
