//! What is seen of errors, in words, rows and JSON.

use super::reference::{Against, Converged};
use super::table::{aligned, cell};
use super::worst::{VISIBLE_LUX, WorstTile};
use super::{Evaluation, Quality};
use crate::seen::{Figures, Quantiles};
use serde_json::{Value, json};

/// Columns of [`Evaluation::seen_rows`], without those of pictures.
const COLUMNS: [&str; 10] = [
    "hour",
    "local error %: median",
    "95 %",
    "99 %",
    "chroma %: median",
    "95 %",
    "99 %",
    "Δu′v′: median",
    "95 %",
    "99 %",
];
/// Columns of the scene's pictures.
const PICTURE_COLUMNS: [&str; 3] = ["picture's ꟻLIP: mean", "95 %", "99 %"];
/// Columns of [`Evaluation::against_rows`].
const AGAINST_COLUMNS: [&str; 9] = [
    "compared",
    "PSNR dB",
    "pooled dB",
    "worst 1 % dB",
    "local error %: median",
    "95 %",
    "99 %",
    "chroma %: 95 %",
    "Δu′v′: 99 %",
];

/// A time of day, such as `22:00`.
pub(crate) fn clock(hour: f64) -> String {
    let minutes = (hour * 60.0).round() as u64 % (24 * 60);
    format!("{:02}:{:02}", minutes / 60, minutes % 60)
}

/// A share in per cent, to two digits.
pub(crate) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        9.95.. => format!("{percent:.0} %"),
        0.995.. => format!("{percent:.1} %"),
        _ => format!("{percent:.2} %"),
    }
}

/// Median, 95 % and 99 %, times a factor.
fn cells(quantiles: Option<Quantiles>, factor: f64, digits: usize) -> [String; 3] {
    let of = |value: fn(Quantiles) -> f64| cell(quantiles.map(|q| factor * value(q)), digits);
    [of(|q| q.median), of(|q| q.p95), of(|q| q.p99)]
}

fn row(name: String, Figures { local, chroma, colour }: &Figures) -> Vec<String> {
    let figures = [cells(*local, 100.0, 1), cells(*chroma, 100.0, 1), cells(*colour, 1.0, 4)];
    std::iter::once(name).chain(figures.into_iter().flatten()).collect()
}

impl Evaluation {
    /// Columns of [`Evaluation::seen_rows`].
    pub fn seen_columns(&self) -> Vec<&'static str> {
        let pictures = self.scene_flip.iter().flat_map(|_| PICTURE_COLUMNS);
        COLUMNS.into_iter().chain(pictures).collect()
    }

    /// What is seen of the errors: every frame, then all of them.
    pub fn seen_rows(&self) -> Vec<Vec<String>> {
        let of_frame = |(k, (hour, quality)): (usize, &(f64, Quality))| {
            let mut row = row(hour.to_string(), &quality.seen);
            let flip = self.scene_flip.iter().map(|flip| flip.by_frame[k]);
            row.extend(flip.flat_map(|f| [f.mean, f.p95, f.p99]).map(|flip| format!("{flip:.4}")));
            row
        };
        let mut rows: Vec<_> = self.by_hour.iter().enumerate().map(of_frame).collect();
        let mut all = row("all".to_owned(), &self.all.seen);
        // (Of all pictures together there are no shares of pixels.)
        let flip = self.scene_flip.iter().flat_map(|flip| [flip.mean(), None, None]);
        all.extend(flip.map(|flip| cell(flip, 4)));
        rows.push(all);
        rows
    }

    /// What is seen, in a sentence: the worst hour.
    pub fn seen_sentence(&self) -> String {
        let worst = self.worst_hour.map(|frame| &self.by_hour[frame]);
        match worst.and_then(|(hour, quality)| Some((hour, quality.seen.local?))) {
            Some((hour, local)) => format!(
                "At {} one texel in twenty is off by {} or more of the light around it",
                clock(*hour),
                percent(local.p95)
            ),
            None => format!("No hour has light to judge (a mean of at least {VISIBLE_LUX} lux)"),
        }
    }

    /// The worst tile, in words; `None` without one.
    pub fn worst_tile_sentence(&self) -> Option<String> {
        let WorstTile { frame, page, rect, local_p95 } = self.worst_tile?;
        Some(format!(
            "worst tile: page {page}, texels {}–{}, {}–{} at {}: one texel in twenty is off by {} or more of the light around it",
            rect.x0,
            rect.x1,
            rect.y0,
            rect.y1,
            clock(self.by_hour[frame].0),
            percent(local_p95)
        ))
    }

    /// Columns of [`Evaluation::against_rows`].
    pub fn against_columns(&self) -> &'static [&'static str] {
        &AGAINST_COLUMNS
    }

    /// Bundle and dataset against each other and against the reference; nothing without one.
    pub fn against_rows(&self) -> Vec<Vec<String>> {
        let Some(Converged { bundle, dataset }) = &self.converged else { return Vec::new() };
        let row = |name: &str, q: &Quality| {
            let of = |value: Option<f64>, factor: f64, digits: usize| cell(value.map(|v| factor * v), digits);
            let mut row = vec![name.to_owned()];
            row.extend([q.psnr_db, q.psnr_pooled_db, q.psnr_worst_percent_db].map(|db| cell(db, 2)));
            row.extend(cells(q.seen.local, 100.0, 1));
            row.push(of(q.seen.chroma.map(|q| q.p95), 100.0, 1));
            row.push(of(q.seen.colour.map(|q| q.p99), 1.0, 4));
            row
        };
        vec![
            row("bundle, dataset", &self.all),
            row("bundle, reference", &bundle.all),
            row("dataset, reference", &dataset.all),
        ]
    }

    /// The tables of what is seen as lines of text.
    pub(super) fn seen_lines(&self) -> Vec<String> {
        let mut lines = aligned(&self.seen_columns(), &self.seen_rows());
        let against = self.against_rows();
        if !against.is_empty() {
            lines.extend(aligned(self.against_columns(), &against));
        }
        lines
    }

    /// Adds the keys of what is seen to a `--json` object.
    pub(super) fn add_seen_json(&self, object: &mut Value) {
        add_figures(object, &self.all.seen);
        if let Some(hours) = object["hours"].as_array_mut() {
            for (k, hour) in hours.iter_mut().enumerate() {
                add_figures(hour, &self.by_hour[k].1.seen);
                hour["mean_light"] = json!(self.mean_light[k]);
                let flip = self.scene_flip.as_ref().map(|flip| flip.by_frame[k]);
                hour["scene_flip"] = json!(flip.map(|flip| flip.mean));
                hour["scene_flip_p95"] = json!(flip.map(|flip| flip.p95));
                hour["scene_flip_p99"] = json!(flip.map(|flip| flip.p99));
            }
        }
        object["worst_hour"] = json!(self.worst_hour.map(|frame| self.by_hour[frame].0));
        object["worst_tile"] = worst_tile(self.worst_tile, &self.by_hour);
        object["scene_flip"] = json!(self.scene_flip.as_ref().and_then(|flip| flip.mean()));
        object["reference"] = match &self.converged {
            None => Value::Null,
            Some(Converged { bundle, dataset }) => {
                json!({ "bundle": against(bundle), "dataset": against(dataset) })
            }
        };
    }
}

/// The figures as keys of an object.
fn add_figures(object: &mut Value, Figures { local, chroma, colour }: &Figures) {
    for (name, quantiles) in [("local_error", local), ("chroma_error", chroma), ("colour_distance", colour)] {
        object[format!("{name}_median")] = json!(quantiles.map(|q| q.median));
        object[format!("{name}_p95")] = json!(quantiles.map(|q| q.p95));
        object[format!("{name}_p99")] = json!(quantiles.map(|q| q.p99));
    }
}

fn worst_tile(tile: Option<WorstTile>, by_hour: &[(f64, Quality)]) -> Value {
    let of = |WorstTile { frame, page, rect, local_p95 }: WorstTile| {
        json!({ "hour": by_hour[frame].0, "page": page, "x0": rect.x0, "y0": rect.y0, "x1": rect.x1, "y1": rect.y1,
            "local_error_p95": local_p95 })
    };
    tile.map_or(Value::Null, of)
}

fn against(of: &Against) -> Value {
    let object = |q: &Quality| {
        let mut object = json!({ "psnr_db": q.psnr_db, "psnr_pooled_db": q.psnr_pooled_db, "psnr_worst_percent_db": q.psnr_worst_percent_db });
        add_figures(&mut object, &q.seen);
        object
    };
    let hour = |(hour, quality): &(f64, Quality)| {
        let mut object = object(quality);
        object["hour"] = json!(hour);
        object
    };
    let mut all = object(&of.all);
    all["worst_hour"] = json!(of.worst_hour.map(|frame| of.by_hour[frame].0));
    all["worst_tile"] = worst_tile(of.worst_tile, &of.by_hour);
    all["hours"] = of.by_hour.iter().map(hour).collect();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_shares_are_short() {
        assert_eq!([22.0, 5.9, 18.1, 23.9999, 0.0].map(clock), ["22:00", "05:54", "18:06", "00:00", "00:00"]);
        assert_eq!(
            [0.224, 0.0995, 0.052, 0.0098, 0.0, 1.5].map(percent),
            ["22 %", "10 %", "5.2 %", "0.98 %", "0.00 %", "150 %"]
        );
    }
}
