//! The sun's direct light at any time of the bake, from its path, its visibility and the normals.

use super::{Dataset, check};
use crate::format::{Between, FileRef, Normals, SunPath, Visibility};
use crate::image::Image;
use crate::{Error, Result};

/// What a page's direct light of the sun is made of.
#[derive(Debug)]
pub struct Sunlight {
    /// The sun by the minute.
    pub path: SunPath,
    /// What is seen of it.
    pub visibility: Visibility,
    /// What faces it.
    pub normals: Normals,
}

impl Sunlight {
    /// The direct light of the sun at an hour.
    ///
    /// # Errors
    /// [`Error::Invalid`] of an hour before the first time of the sun's path or after the last: nothing is
    /// known of the sun then. Those of [`Visibility::tile`].
    pub fn at(&self, hour: f64) -> Result<Image> {
        if self.path.at(hour).is_none() {
            return Err(self.path.outside("the sun's direct light", hour));
        }
        let [width, height] = self.visibility.size.map(|side| side as usize);
        let mut image = Image::black(width, height);
        let between = Between::new(&self.visibility.hours, hour);
        for (index, rect) in self.visibility.tiles.iter().enumerate() {
            let tile = self.visibility.tile(index)?;
            for texel in 0..tile.texels {
                let place = (rect.y0 + texel / rect.width()) * width + rect.x0 + texel % rect.width();
                let [before, after] = [between.before, between.after].map(|time| tile.level(texel, time));
                let top = f32::from(self.visibility.top);
                let seen = std::array::from_fn(|c| {
                    between.lerp(f32::from(before[c]) / top, f32::from(after[c]) / top)
                });
                image.texels[place] = self.path.light(hour, self.normals.normals[place], seen);
            }
        }
        Ok(image)
    }
}

impl Dataset {
    /// The sun by the minute, if the dataset has it; its checksum checked.
    ///
    /// # Errors
    /// Those of [`SunPath::read`].
    pub fn sun_path(&self) -> Result<Option<SunPath>> {
        let Some(file) = &self.config.sun_path else { return Ok(None) };
        SunPath::read(&self.verified(file)?).map(Some)
    }

    /// What the sun's direct light on a page is made of, if the dataset has it: sizes and checksums checked.
    ///
    /// # Errors
    /// Those of the files' readers; [`Error::Invalid`] of a file of another size than the page, or of times
    /// beyond the sun's path.
    ///
    /// # Panics
    /// If `page` is not below the number of pages.
    pub fn sunlight(&self, page: usize) -> Result<Option<Sunlight>> {
        let (Some(files), Some(path)) = (&self.config.visibility, self.sun_path()?) else { return Ok(None) };
        let (visibility, normals) = (self.visibility(&files.files[page], page)?, &files.normals[page]);
        let normals = self.normals(normals, page)?;
        let within = |hour: &f64| path.at(*hour).is_some();
        if let Some(hour) = visibility.hours.iter().find(|hour| !within(hour)) {
            let what = format!("time {hour} h; expected a time of the sun's path");
            return Err(Error::invalid(self.path(&files.files[page]).display(), what));
        }
        Ok(Some(Sunlight { path, visibility, normals }))
    }

    fn visibility(&self, file: &FileRef, page: usize) -> Result<Visibility> {
        let path = self.verified(file)?;
        let visibility = Visibility::open(&path)?;
        let [width, height] = visibility.size.map(|side| side as usize);
        check::size(&path, (width, height), &self.config.pages[page])?;
        Ok(visibility)
    }

    fn normals(&self, file: &FileRef, page: usize) -> Result<Normals> {
        let path = self.verified(file)?;
        let normals = Normals::read_png(&path)?;
        check::size(&path, (normals.width, normals.height), &self.config.pages[page])?;
        Ok(normals)
    }

    /// Everything that is wrong with the sun's path and visibility, files of `broken` paths omitted, which
    /// are known to be wrong.
    pub(super) fn verify_sunlight(&self, is_broken: impl Fn(&FileRef) -> bool) -> Vec<Error> {
        let files = self.config.visibility.iter().flat_map(|visibility| visibility.references());
        if files.chain(&self.config.sun_path).any(is_broken) {
            return Vec::new();
        }
        if let Err(fault) = self.sun_path() {
            return vec![fault];
        }
        let of_page = |page: usize| {
            let Some(sunlight) = self.sunlight(page)? else { return Ok(()) };
            let tiles = 0..sunlight.visibility.tiles.len();
            tiles.into_iter().try_for_each(|tile| {
                crate::host::signals::stop_if_interrupted()?;
                sunlight.visibility.tile(tile).map(drop)
            })
        };
        (0..self.config.pages.len()).filter_map(|page| of_page(page).err()).collect()
    }
}
