//! A report's summary: the scene at four hours, baked and decoded, and in three lines quality, size, time and
//! the next step.

use crate::Result;
use crate::compress::Outcome;
use crate::decode::{Decoder, Lights};
use crate::evaluate::{Evaluation, Quality, cell, decode, read, reference_law};
use dataset::observe::count;
use dataset::pictures::View;
use dataset::store::Dataset;
use reports::Section;
use reports::scene::{PICTURE, remark as of_view, shown_frames};

/// A bundle so close to the bake's own error, in dB, is limited by the bake.
const CLOSE_DB: f64 = 1.0;

/// Pictures and summary, and whether the scene could be shown. `remark` says by how much a target was missed.
///
/// # Errors
/// As reading the dataset and the bundle. If the geometry file is damaged, the section says so.
pub fn lead(
    dataset: &Dataset,
    decoder: &Decoder,
    outcome: &Outcome,
    evaluation: &Evaluation,
    remark: Option<&str>,
) -> Result<(Section, bool)> {
    let mut section = Section::new("Summary");
    let view = match View::of(dataset, PICTURE) {
        Ok(view) => view,
        Err(error) => {
            section.paragraph(&format!("The scene is not shown: {error}."));
            None
        }
    };
    if let Some(view) = &view {
        pictures(view, dataset, decoder, evaluation, &mut section)?;
    }
    section.summary(&[
        ("How good", how_good(evaluation)),
        ("How large, how long", how_large(dataset, outcome, evaluation)),
        ("What next", what_next(dataset, outcome, evaluation, remark)),
    ]);
    Ok((section, view.is_some()))
}

/// The scene at some frames, the dataset's light above the bundle's.
fn pictures(
    view: &View,
    dataset: &Dataset,
    decoder: &Decoder,
    evaluation: &Evaluation,
    section: &mut Section,
) -> Result<()> {
    let law = reference_law(decoder);
    let mut stacks = Vec::new();
    for frame in shown_frames(&dataset.config) {
        let hour = dataset.config.frames[frame].hour;
        let config = &dataset.config;
        let baked = view.light(config, |page, rows| read(dataset, &law, frame, page, &rows))?;
        let decoded = view.light(config, |page, rows| decode(decoder, Lights::All, page, hour, &rows))?;
        let exposure = view.exposure(&baked);
        let pair = [baked, decoded].map(|light| view.to_png(&light, exposure));
        let quality = evaluation.by_hour.iter().find(|(of, _)| *of == hour);
        let quality = quality.and_then(|(_, quality)| quality.psnr_db);
        let quality = quality.map_or(String::new(), |db| format!(", {db:.1} dB"));
        stacks.push((format!("{hour} h{quality}"), pair.into()));
    }
    section.row(&stacks);
    let sun = match evaluation.sun_is_omitted {
        true => " Both are without the sun's direct light, which the bundle omits.",
        false => "",
    };
    section.paragraph(&format!("Above: baked. Below: decoded from the bundle.{sun} {}", of_view(view)));
    Ok(())
}

/// Such as `653 kB`.
fn bytes(bytes: f64) -> String {
    match bytes {
        0.0..1e6 => format!("{:.0} kB", bytes / 1e3),
        1e6..1e7 => format!("{:.1} MB", bytes / 1e6),
        1e7..1e9 => format!("{:.0} MB", bytes / 1e6),
        _ => format!("{:.1} GB", bytes / 1e9),
    }
}

/// Such as `30 ms` or `4.3 min`.
fn time(seconds: f64) -> String {
    match seconds {
        0.0..1.0 => format!("{:.0} ms", seconds * 1e3),
        1.0..10.0 => format!("{seconds:.1} s"),
        10.0..100.0 => format!("{seconds:.0} s"),
        100.0..6000.0 => format!("{:.1} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

fn how_good(evaluation: &Evaluation) -> String {
    let all = &evaluation.all;
    let [mean, worst] = [all.psnr_db, all.psnr_worst_percent_db].map(|db| cell(db, 1));
    let ceiling = all
        .noise_ceiling_db
        .map_or(String::new(), |db| format!("; the bake's sampling error, as a PSNR, is {db:.1} dB"));
    format!(
        "{}. PSNR {mean} dB on average over tiles and frames, {worst} dB in the worst 1 %{ceiling}.",
        evaluation.seen_sentence()
    )
}

fn how_large(dataset: &Dataset, outcome: &Outcome, evaluation: &Evaluation) -> String {
    let (config, size) = (&dataset.config, evaluation.bytes as f64);
    let texels: f64 = config.pages.iter().map(|page| f64::from(page.width) * f64::from(page.height)).sum();
    let raw = texels * 12.0 * config.frames.len() as f64;
    format!(
        "{} instead of {} (1 : {:.0}), {:.3} bits per texel and frame; {} of CPU time to {}, {} to decode {}.",
        bytes(size),
        bytes(raw),
        raw / size,
        evaluation.bpp,
        time(outcome.training_seconds),
        if outcome.is_basis { "encode the maps" } else { "train" },
        time(evaluation.decode_seconds),
        count(config.frames.len(), "frame")
    )
}

/// What would make the bundle better.
fn advice(all: &Quality, is_basis: bool, remark: Option<&str>) -> String {
    match (all.psnr_db.zip(all.noise_ceiling_db), remark) {
        (_, Some(remark)) => format!("{remark}."),
        (Some((psnr, ceiling)), _) if psnr > ceiling - CLOSE_DB => {
            "Bake with more samples: the bake's sampling error is about as large as the bundle's error, or larger.".to_owned()
        }
        _ if is_basis => "For a smaller error: a higher --target-psnr or --target-bpp.".to_owned(),
        _ => "For a smaller error: --preset final trains longer, --profile M or H store more; compress sweep shows what each gains."
            .to_owned(),
    }
}

fn what_next(dataset: &Dataset, outcome: &Outcome, evaluation: &Evaluation, remark: Option<&str>) -> String {
    let (root, bundle) = (dataset.root.display(), outcome.bundle.display());
    let look = format!(" To play it in a browser: compress view {root} --bundle {bundle}");
    advice(&evaluation.all, outcome.is_basis, remark) + &look
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_times_are_printed_in_their_units() {
        assert_eq!([6.53e5, 1.26e8, 2.5e6, 3.2e9].map(bytes), ["653 kB", "126 MB", "2.5 MB", "3.2 GB"]);
        assert_eq!(
            [0.03, 4.26, 59.7, 205.0, 9000.0].map(time),
            ["30 ms", "4.3 s", "60 s", "3.4 min", "2.5 h"]
        );
    }

    #[test]
    fn what_is_worst_is_mended_first() {
        let at = |psnr: f64, ceiling: Option<f64>| Quality {
            psnr_db: Some(psnr),
            noise_ceiling_db: ceiling,
            ..Quality::default()
        };
        for (all, remark, expected) in [
            (at(46.0, Some(46.2)), None, "Bake with more samples"),
            (at(46.0, Some(60.0)), None, "--preset final"),
            (at(46.0, None), None, "--preset final"),
            (at(46.0, Some(46.2)), Some("--target-psnr 50: missed"), "--target-psnr 50: missed."),
        ] {
            let reported = advice(&all, false, remark);
            assert!(reported.contains(expected), "{reported}");
        }
    }
}
