//! Pictures of the scene in the dataset's light and in the bundle's, compared as they look on a screen.
//!
//! An eye adapts to what it sees, and so does the exposure: by the dataset's picture of each hour, a night's
//! too ([`dataset::pictures::tone::automatic_exposure`]: the log-average luminance of surfaces with texels
//! becomes middle grey, 0.18, or less where the 95th percentile would come out above white). The bundle's
//! picture is exposed as the dataset's is.

use super::reference_law;
use super::strips::{decode, read};
use crate::Result;
use crate::decode::{Decoder, Lights};
use crate::mean::mean;
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::observe::Observer;
use dataset::pictures::View;
use dataset::pictures::metrics::compare_pictures;
use dataset::store::Dataset;
use reports::scene::PICTURE;

/// ꟻLIP (for pictures of 8 bits) of a picture's pixels that show texels, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureFlip {
    /// Mean over pixels.
    pub mean: f64,
    /// 95 % of pixels have at most this.
    pub p95: f64,
    /// 99 % of pixels have at most this.
    pub p99: f64,
}

/// ꟻLIP of the report's pictures of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFlip {
    /// The camera's name.
    pub camera: String,
    /// Per frame.
    pub by_frame: Vec<PictureFlip>,
}

impl SceneFlip {
    /// The mean over frames; `None` without frames.
    pub fn mean(&self) -> Option<f64> {
        mean(self.by_frame.iter().map(|flip| flip.mean))
    }
}

/// Compares the pictures of all frames. `None` if the dataset has no geometry with texels.
///
/// # Errors
/// As reading the dataset and the bundle.
pub(super) fn scene_flip(
    dataset: &Dataset,
    decoder: &Decoder,
    console: &dyn Observer,
) -> Result<Option<SceneFlip>> {
    let (config, law) = (&dataset.config, reference_law(decoder));
    let Some(view) = View::of(dataset, PICTURE)? else { return Ok(None) };
    let judged = with_texels(&view);
    let progress = console.progress("pictures of the scene", config.frames.len() as u64);
    let mut by_frame = Vec::new();
    for (frame, of) in config.frames.iter().enumerate() {
        stop_if_interrupted()?;
        let baked = view.light(config, |page, rows| read(dataset, &law, frame, page, &rows))?;
        let decoded = view.light(config, |page, rows| decode(decoder, Lights::All, page, of.hour, &rows))?;
        let exposure = view.exposure(&baked);
        let [reference, found] = [&baked, &decoded].map(|light| view.to_codes(light, exposure));
        let Some(quality) = compare_pictures(&found, &reference, &judged) else { return Ok(None) };
        by_frame.push(PictureFlip { mean: quality.flip, p95: quality.flip_p95, p99: quality.flip_p99 });
        progress.advance(1);
    }
    Ok(Some(SceneFlip { camera: view.camera.name.clone(), by_frame }))
}

/// The pixels of which most show texels: others are alike in all pictures.
pub(crate) fn with_texels(view: &View) -> Mask {
    let [width, height] = view.size();
    Mask { width, height, valid: view.with_texels().iter().map(|share| *share > 0.5).collect() }
}
