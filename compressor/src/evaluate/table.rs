//! An evaluation as table, CSV and JSON.

use super::{Between, Evaluation, Quality, Sample, Shadows, VISIBLE_LUX};
use crate::seen::Figures;
use serde_json::{Value, json};
use std::fmt::Write;

/// Columns of [`Evaluation::rows`].
pub const COLUMNS: [&str; 10] = [
    "hour",
    "PSNR dB",
    "pooled dB",
    "worst 1 % dB",
    "8-bit dB",
    "log dB",
    "noise ceiling dB",
    "1 − SSIM",
    "relative error",
    "in the dark",
];

/// A table as lines of text, its columns aligned on the right.
pub(crate) fn aligned(header: &[&str], rows: &[Vec<String>]) -> Vec<String> {
    let header: Vec<String> = header.iter().map(|&name| name.to_owned()).collect();
    let lines: Vec<&Vec<String>> = std::iter::once(&header).chain(rows).collect();
    let width = |c: usize| lines.iter().map(|line| line[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let text = |line: &&Vec<String>| {
        let cells = line.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}"));
        cells.collect::<Vec<_>>().join("  ")
    };
    lines.iter().map(text).collect()
}

/// A number of `digits` decimals, or a dash.
pub(crate) fn cell(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".to_owned(), |value| format!("{value:.digits$}"))
}

fn row(name: String, q: &Quality) -> Vec<String> {
    vec![
        name,
        cell(q.psnr_db, 2),
        cell(q.psnr_pooled_db, 2),
        cell(q.psnr_worst_percent_db, 2),
        cell(q.psnr_8bit_db, 2),
        cell(q.psnr_log_db, 2),
        cell(q.noise_ceiling_db, 2),
        cell(q.one_minus_ssim, 5),
        cell(q.relative_error, 5),
        cell(q.dark_relative_error, 5),
    ]
}

/// The hours of the frames that are marked, neighbours as one range.
fn ranges(hours: &[f64], marked: &[bool]) -> String {
    let firsts = (0..marked.len()).filter(|&k| marked[k] && (k == 0 || !marked[k - 1]));
    let range = |first: usize| {
        let last = (first..marked.len()).take_while(|&k| marked[k]).last().unwrap_or(first);
        let (from, to) = (hours[first], hours[last]);
        if first == last { format!("{from}") } else { format!("{from}–{to}") }
    };
    firsts.map(range).collect::<Vec<_>>().join(", ")
}

impl Evaluation {
    /// The quality table's rows: every frame, then all of them.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let mut rows: Vec<_> = self.by_hour.iter().map(|(hour, q)| row(format!("{hour}"), q)).collect();
        rows.push(row("all".to_owned(), &self.all));
        rows
    }

    /// The tables of quality and of what is seen, and their remarks, line by line.
    pub fn lines(&self) -> Vec<String> {
        self.table().into_iter().chain(self.seen_lines()).chain(self.remarks()).collect()
    }

    /// The quality table as lines of text.
    pub fn table(&self) -> Vec<String> {
        aligned(&COLUMNS, &self.rows())
    }

    /// What is seen at the worst hour, and remarks on what the table does not show, in sentences.
    pub fn remarks(&self) -> Vec<String> {
        let q = &self.all;
        let [of_valid, of_distinct] = self.bits_of_valid;
        let mut remarks = vec![self.seen_sentence()];
        remarks.extend(self.worst_tile_sentence());
        remarks.push(format!(
            "{:.3} bits per texel and frame; {of_valid:.3} per valid texel and frame, {of_distinct:.3} where equal frames count once; {} bytes, {:.0} per \
             tile; {} (tile, frame) pairs evaluated",
            self.bpp,
            self.bytes,
            self.bytes as f64 / self.tiles.max(1) as f64,
            q.samples
        ));
        let figures = |q: &Quality| {
            let [mean, pooled, worst] =
                [q.psnr_db, q.psnr_pooled_db, q.psnr_worst_percent_db].map(|db| cell(db, 2));
            format!("mean {mean} dB, pooled {pooled} dB, worst 1 % {worst} dB")
        };
        if let Some(sunny) = &self.sunny {
            remarks.push(format!("over the frames that the sun lights directly: {}", figures(sunny)));
        }
        if self.sun_is_omitted {
            remarks.push(
                "the sun's direct light is omitted (--without-sun), in the bundle and in its reference"
                    .to_owned(),
            );
        }
        if let Some(baked) = &self.without_sun {
            let [sun, shadows] =
                [self.bytes_of_sun, self.bytes_of_shadows].map(|n| n as f64 / self.bytes as f64 * of_valid);
            let moving = match self.bytes_of_shadows {
                0 => String::new(),
                _ => format!(" and {shadows:.3} for moving shadows"),
            };
            remarks.push(format!(
                "without the sun's direct light, which takes {sun:.3} of these bits{moving}: {}",
                figures(baked)
            ));
        }
        if q.black > 0 {
            remarks.push(format!(
                "{} (tile, frame) pairs are black and not evaluated; their largest error is {}",
                q.black, q.black_largest_error
            ));
        }
        if q.constant > 0 {
            let error = cell(q.constant_relative_error, 6);
            remarks.push(format!(
                "{} (tile, frame) pairs are constant in space and evaluated separately: mean relative error {error}",
                q.constant
            ));
        }
        if self.distinct_frames < self.by_hour.len() {
            remarks.push(format!(
                "{} of {} frames differ; over only these the mean is {} dB, pooled {} dB",
                self.distinct_frames,
                self.by_hour.len(),
                cell(self.distinct.psnr_db, 2),
                cell(self.distinct.psnr_pooled_db, 2)
            ));
        }
        let noisy = |s: &&Sample| {
            s.noise_ceiling_db.zip(s.quality.psnr_db).is_some_and(|(ceiling, psnr)| ceiling < psnr)
        };
        let noisy = self.samples.iter().filter(noisy).count();
        if noisy > 0 {
            remarks.push(format!(
                "in {noisy} (tile, frame) pairs the bake's sampling error is larger than the codec's: bake with more samples rather than \
                 compressing with more bits"
            ));
        }
        let below =
            |q: &Quality| q.noise_ceiling_db.zip(q.psnr_db).is_some_and(|(ceiling, psnr)| ceiling < psnr);
        let hours: Vec<f64> = self.by_hour.iter().map(|(hour, _)| *hour).collect();
        let met: Vec<bool> = self.by_hour.iter().map(|(_, q)| below(q)).collect();
        let dark: Vec<bool> = self
            .by_hour
            .iter()
            .map(|(_, q)| q.dark_relative_error.is_some_and(|error| error > 1.0))
            .collect();
        if dark.contains(&true) {
            remarks.push(format!(
                "in the darkest quarter of {} of {} frames the error exceeds the light, which PSNR does not show ({} h; frames with a mean below {VISIBLE_LUX} lux \
                 are ignored)",
                dark.iter().filter(|dark| **dark).count(),
                self.by_hour.len(),
                ranges(&hours, &dark)
            ));
        }
        if met.contains(&true) {
            remarks.push(format!(
                "the PSNR of {} of {} frames is above their noise ceiling ({} h): there it measures how closely the bake's noise is reproduced",
                met.iter().filter(|met| **met).count(),
                self.by_hour.len(),
                ranges(&hours, &met)
            ));
        }
        if let Some(Between { median_db, worst, linear_median_db, points }) = self.between {
            let (worst, hour) = worst;
            let decoder = format!(
                "median pooled PSNR of the decoder {median_db:.2} dB (lowest {worst:.2} dB, at {hour:.2} h)"
            );
            let sun = if self.without_sun.is_some() { ", without the sun's direct light" } else { "" };
            remarks.push(match linear_median_db {
                None => format!(
                    "between frames, at {points} times: {decoder} against the dataset's light, interpolated by its layers{sun}"
                ),
                Some(linear) => format!(
                    "between frames, at {points} times of the withheld bake: {decoder}; linear interpolation of the \
                     uncompressed frames: {linear:.2} dB"
                ),
            });
        }
        if let Some(Shadows { pooled_db, mean_db, worst_db, pairs }) = self.shadows {
            let how = if self.bytes_of_shadows > 0 { "move" } else { "fade" };
            remarks.push(format!(
                "the sun's direct light between frames, against the dataset's visibility, {pairs} (tile, time) pairs: pooled {pooled_db:.2} dB, mean \
                 {mean_db:.2} dB, worst 5 % {worst_db:.2} dB; shadows {how} between the times of the visibility"
            ));
        }
        if self.steps.smooth.or(self.steps.switch).is_some() {
            let percent = |error: Option<f64>| {
                error.map_or("–".to_owned(), |error| format!("{:.2} %", 100.0 * error))
            };
            remarks.push(format!(
                "error of the change of light between consecutive frames, RMS, relative to the change: {}; across switches of light groups: {}",
                percent(self.steps.smooth),
                percent(self.steps.switch)
            ));
        }
        if let Some(lpips) = self.all.lpips {
            remarks.push(format!("mean LPIPS {lpips:.4}"));
        }
        if let Some(flip) = self.all.flip {
            remarks.push(format!("mean HDR-ꟻLIP {flip:.4}"));
        }
        if let Some(flip) = &self.scene_flip {
            remarks.push(format!(
                "ꟻLIP of pictures of the scene, exposed as an eye adapts to each hour, from the camera “{}”: mean {}",
                flip.camera,
                cell(flip.mean(), 4)
            ));
        }
        if let Some(ratio) = self.seam_ratio {
            remarks.push(format!(
                "the error of differences between neighbouring texels is {ratio:.3} times as large across tile borders as inside tiles"
            ));
        }
        remarks
    }

    /// Every (tile, frame) that has a valid texel, black ones too, as comma-separated values.
    pub fn csv(&self) -> String {
        let mut out = String::from(
            "hour,page,x0,y0,x1,y1,valid_texels,peak,range,mean,constant,mse,psnr_db,psnr_range_db,ssim,ssim_uniform,psnr_8bit_db,noise_ceiling_db,psnr_log_db,lpips,flip,relative_error,local_error_median,local_error_p95,local_error_p99,chroma_error_median,chroma_error_p95,chroma_error_p99,colour_distance_median,colour_distance_p95,colour_distance_p99\n",
        );
        for s in &self.samples {
            let (q, r) = (&s.quality, &s.rect);
            let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let place = format!("{},{},{},{},{},{}", self.by_hour[s.frame].0, s.page, r.x0, r.y0, r.x1, r.y1);
            let plain = format!("{},{},{},{},{},{}", q.texels, q.peak, q.range, q.mean, q.constant, q.mse());
            let rest = [
                q.psnr_db,
                q.psnr_range_db,
                q.ssim,
                q.ssim_uniform,
                s.psnr_8bit_db,
                s.noise_ceiling_db,
                s.psnr_log_db,
                s.lpips,
                s.flip,
            ]
            .map(number)
            .join(",");
            let Figures { local, chroma, colour } = s.seen;
            let seen = [local, chroma, colour]
                .map(|of| [of.map(|q| q.median), of.map(|q| q.p95), of.map(|q| q.p99)].map(number).join(","));
            let _ = writeln!(out, "{place},{plain},{rest},{},{}", s.relative_error, seen.join(","));
        }
        out
    }

    /// The keys that every `--json` object with a quality has.
    pub fn json(&self) -> Value {
        let q = &self.all;
        let hours: Vec<_> = self
            .by_hour
            .iter()
            .map(|(hour, q)| json!({ "hour": hour, "psnr_db": q.psnr_db, "psnr_range_db": q.psnr_range_db, "psnr_pooled_db": q.psnr_pooled_db,
                "psnr_worst_percent_db": q.psnr_worst_percent_db, "noise_ceiling_db": q.noise_ceiling_db, "psnr_log_db": q.psnr_log_db,
                "one_minus_ssim": q.one_minus_ssim, "relative_error": q.relative_error, "dark_relative_error": q.dark_relative_error }))
            .collect();
        let steps: Vec<_> = self
            .steps
            .each
            .iter()
            .map(|step| json!({ "from": step.from, "to": step.to, "switch": step.switch, "error": step.error }))
            .collect();
        let mut object = json!({
            "psnr_db": q.psnr_db,
            "psnr_range_db": q.psnr_range_db,
            "psnr_pooled_db": q.psnr_pooled_db,
            "psnr_distinct_db": self.distinct.psnr_db,
            "frames_distinct": self.distinct_frames,
            "psnr_8bit_db": q.psnr_8bit_db,
            "psnr_log_db": q.psnr_log_db,
            "psnr_worst_percent_db": q.psnr_worst_percent_db,
            "psnr_unquantised_db": Value::Null,
            "psnr_8bit_features_db": Value::Null,
            "noise_ceiling_db": q.noise_ceiling_db,
            "one_minus_ssim": q.one_minus_ssim,
            "one_minus_ssim_uniform": q.one_minus_ssim_uniform,
            "psnr_256_db": self.large.psnr_db,
            "psnr_range_256_db": self.large.psnr_range_db,
            "one_minus_ssim_256": self.large.one_minus_ssim,
            "lpips": q.lpips,
            "flip": q.flip,
            "relative_error": q.relative_error,
            "dark_relative_error": q.dark_relative_error,
            "constant_relative_error": q.constant_relative_error,
            "pairs": q.samples,
            "pairs_constant": q.constant,
            "pairs_black": q.black,
            "bpp": self.bpp,
            "bytes": self.bytes,
            "bits_per_valid_texel": self.bits_of_valid[0],
            "bits_per_valid_texel_distinct": self.bits_of_valid[1],
            "bytes_of_sun": self.bytes_of_sun,
            "psnr_sunny_db": self.sunny.and_then(|q| q.psnr_db),
            "psnr_pooled_sunny_db": self.sunny.and_then(|q| q.psnr_pooled_db),
            "psnr_without_sun_db": self.without_sun.and_then(|q| q.psnr_db),
            "psnr_pooled_without_sun_db": self.without_sun.and_then(|q| q.psnr_pooled_db),
            "seam_ratio": self.seam_ratio,
            "between_median_db": self.between.map(|between| between.median_db),
            "between_worst_db": self.between.map(|between| between.worst.0),
            "between_linear_median_db": self.between.and_then(|between| between.linear_median_db),
            "step_error": self.steps.smooth,
            "switch_error": self.steps.switch,
            "hours": hours,
            "steps": steps,
        });
        object["bytes_of_shadows"] = json!(self.bytes_of_shadows);
        let of_shadows = |value: fn(Shadows) -> f64| json!(self.shadows.map(value));
        object["sun_between_pooled_db"] = of_shadows(|shadows| shadows.pooled_db);
        object["sun_between_mean_db"] = of_shadows(|shadows| shadows.mean_db);
        object["sun_between_worst_db"] = of_shadows(|shadows| shadows.worst_db);
        self.add_seen_json(&mut object);
        object
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_frames_are_one_range() {
        let hours = [0.0, 1.0, 5.9, 6.0, 23.6];
        assert_eq!(ranges(&hours, &[true, true, false, true, true]), "0–1, 6–23.6");
        assert_eq!(ranges(&hours, &[false, false, true, false, false]), "5.9");
        assert_eq!(ranges(&hours, &[true; 5]), "0–23.6");
        assert_eq!(ranges(&hours, &[false; 5]), "");
    }
}
