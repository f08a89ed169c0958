//! A page of a bundle as a texture.

use crate::decoder::Decoder;
use crate::request::{DecodeParams, Request, Target, Work};
use crate::shader::Output;
use crate::{Error, Result};
use ndgi::grid::Place;

/// A page's texture, with the state of its tiles.
#[derive(Debug)]
pub struct Page {
    /// The texture: the page's size.
    pub texture: wgpu::Texture,
    view: wgpu::TextureView,
    output: Output,
    page: usize,
    /// Per tile, whether black was written to it last.
    is_black: Vec<bool>,
    /// [`Decoder::forgotten`] when it was written last.
    forgotten: Option<u64>,
}

impl Page {
    /// A view of the texture.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}

impl Decoder {
    /// A texture of a page, which [`Decoder::decode_page`] fills. Its first call writes every texel; until
    /// then all is 0, alpha too.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a page that the bundle does not have; [`Error::Device`] for one larger than a
    /// texture may be.
    pub fn page(&self, page: usize, output: Output) -> Result<Page> {
        let grid = self.bundle.grid(page)?;
        let most = self.stage.device.limits().max_texture_dimension_2d as usize;
        if grid.width.max(grid.height) > most {
            return Err(Error::Device(format!(
                "page {page} has {} × {} texels; the device's textures have at most {most}: decode single tiles instead",
                grid.width, grid.height
            )));
        }
        let texture = self.stage.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("ndgi page"),
            size: wgpu::Extent3d {
                width: grid.width as u32,
                height: grid.height as u32,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: output.format(),
            usage: wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        Ok(Page { texture, view, output, page, is_black: vec![false; grid.tiles()], forgotten: None })
    }

    /// Records the decoding of a whole page. Tiles that are black and were black before are skipped.
    ///
    /// # Errors
    /// As [`Decoder::decode`].
    pub fn decode_page(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        page: &mut Page,
        params: &DecodeParams,
    ) -> Result<Work> {
        let grid = self.bundle.header.pages[page.page];
        let request = |place: Place| {
            let (x, y) = place.origin();
            let border = ndgi::model::BORDER as isize;
            Request { place, to: [x + border, y + border].map(|at| at as i32), with_border: false }
        };
        let requests: Vec<Request> = grid.places(page.page).map(request).collect();
        let target = Target { view: &page.view, output: page.output };
        let mut work = self.decode(encoder, &requests, target, params)?;
        let index = |request: &Request| request.place.row * grid.columns() + request.place.column;
        let is_known = page.forgotten.replace(self.forgotten) == Some(self.forgotten);
        let was_black = std::mem::replace(&mut page.is_black, vec![false; grid.tiles()]);
        work.black.iter().for_each(|request| page.is_black[index(request)] = true);
        let is_stale = |request: &&Request| !(is_known && was_black[index(request)]);
        let stale: Vec<Request> = work.black.iter().filter(is_stale).copied().collect();
        if !stale.is_empty() {
            let cleared = self.clear(encoder, &stale, target)?;
            work.bytes += cleared.bytes;
        }
        Ok(work)
    }
}
