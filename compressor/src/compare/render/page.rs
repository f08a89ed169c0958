//! What was shown, for people: a table of means, and a page, pictures first.

use super::super::table::Comparison;
use super::FRAMES;
use super::results::{Rendered, Seen, short, size};
use crate::mean::mean;
use dataset::observe::count;
use reports::plot::Plot;
use reports::{Report, Section};

impl Rendered {
    /// Means over all pictures of each method, for people: a header and rows.
    fn means(&self) -> ([&'static str; 8], Vec<Vec<String>>) {
        let header =
            ["method", "bpp", "size", "PSNR dB", "SSIM", "ꟻLIP", "PSNR dB between frames", "temporal error"];
        let mut rows: Vec<Vec<String>> = Vec::new();
        for first in &self.views {
            let method = &first.method;
            if rows.iter().any(|row| row[0] == *method) {
                continue;
            }
            let of = || self.views.iter().filter(|seen| seen.method == *method);
            let is_between = |hour: f64| self.times.iter().any(|m| m.hour == hour && m.frame.is_none());
            let cell = |value: Option<f64>, digits: usize| {
                value.map_or("–".to_owned(), |value| format!("{value:.digits$}"))
            };
            // What is only shown between frames has no mean over all.
            let all = || of().filter(|_| method != FRAMES);
            let line = self.lapse.iter().find(|line| line.method == *method);
            rows.push(vec![
                method.clone(),
                format!("{:.2}", first.bpp),
                size(first.bytes),
                cell(mean(all().map(|seen| seen.psnr_db)), 2),
                cell(mean(all().map(|seen| seen.ssim)), 4),
                cell(mean(all().map(|seen| seen.flip)), 4),
                cell(mean(of().filter(|seen| is_between(seen.hour)).map(|seen| seen.psnr_db)), 2),
                cell(line.map(|line| line.error), 5),
            ]);
        }
        (header, rows)
    }

    /// The means as lines of text.
    pub fn table(&self) -> Vec<String> {
        let (header, rows) = self.means();
        let mut lines = crate::evaluate::aligned(&header, &rows);
        lines.push(format!(
            "pictures by {} at {}; temporal error as a fraction of white, compared with a change of {:.5}",
            count(self.cameras.len(), "camera"),
            count(self.times.len(), "time"),
            self.lapse_change
        ));
        lines.extend(self.skipped.iter().map(|what| format!("not rendered: {what}")));
        lines
    }

    /// A page: pictures first, numbers below, folded.
    pub fn report(&self, comparison: &Comparison) -> Report {
        let mut report = Report::new(&format!("{}, rendered by method", self.scene));
        let mut lead = Section::new("Pictures");
        lead.paragraph(
            "Under each: PSNR (peak 255), SSIM and ꟻLIP of the 8-bit picture against the one in the dataset's light, over pixels that show \
             texels; bits per texel and frame; size over the whole day. All pictures of a row have the same exposure.",
        );
        for (title, pictures) in &self.rows {
            in_row(&mut lead, title, pictures);
        }
        report.lead(lead);
        let mut means = Section::new("Means");
        let effort = if comparison.draft { "draft effort: short training" } else { "full effort" };
        means.paragraph(&format!("Over all pictures above, at {effort}."));
        let (header, rows) = self.means();
        means.table(&header, &rows);
        report.push(means);
        let mut near = Section::new("Close-ups of tiles");
        near.paragraph(
            "Each at the hour of its greatest contrast. Sizes: a tile over the whole day, the method's mean. PSNR of linear light.",
        );
        for (title, pictures) in &self.near {
            in_row(&mut near, title, pictures);
        }
        report.push(near);
        report.push(self.of_day());
        let mut numbers = Section::new("All numbers");
        let header = ["camera", "hour", "method", "bpp", "PSNR dB", "SSIM", "ꟻLIP"];
        numbers.table(&header, &self.views.iter().map(Seen::cells).collect::<Vec<_>>());
        report.push(numbers.folded());
        let mut how = Section::new("How it was made");
        how.list(&self.how(comparison));
        report.push(how.folded());
        report
    }

    fn of_day(&self) -> Section {
        let mut section = Section::new("Over the day");
        section.plot(&Plot {
            title: format!("Temporal error by the camera “{}”", self.lapse_camera),
            x: "hour".to_owned(),
            y: "mean |Δ method − Δ reference|".to_owned(),
            log_x: false,
            log_y: true,
            lines: self.lapse.iter().map(|line| (line.method.clone(), line.steps.clone())).collect(),
        });
        section.paragraph(&format!(
            "From each half hour to the next: per pixel and channel, the error of the change of exposed light (1 is white, linear; both \
             times at the exposure of the brighter one). The change itself is {:.5} on average.",
            self.lapse_change
        ));
        let rows = self.lapse.iter().map(|line| {
            vec![
                line.method.clone(),
                format!("{:.5}", line.error),
                line.relative_error.map_or("–".to_owned(), |error| format!("{error:.3}")),
                format!("{:.5} at {} h", line.worst.1, short(line.worst.0)),
            ]
        });
        section.table(&["method", "error", "÷ the change", "worst step"], &rows.collect::<Vec<_>>());
        section
    }

    fn how(&self, comparison: &Comparison) -> Vec<String> {
        let mut lines = vec![
            "Times: the frames nearest to 8, 12 and 20 h; a quarter of an hour after the first; three minutes after the last time of day \
             at which a light group goes on."
                .to_owned(),
            "Between frames the reference is the dataset's own light: layers by their curves, the sun by its visibility. NDGI decodes the \
             hour; other methods are linear between the neighbouring frames, or at a switch the frame with the hour's light groups."
                .to_owned(),
            format!("“{FRAMES}” are the dataset's frames, uncompressed and interpolated linearly: the error of interpolation alone."),
            "“Bundle” is the file in the dataset's folder, of any profile, with all texels of its pages counted; the other methods are those of \
             the table of `compress compare`."
                .to_owned(),
            "Texels off surfaces are the mean of their valid neighbours, for every method and for the reference. Surfaces without texels \
             are lit evenly and not evaluated."
                .to_owned(),
        ];
        let missing = self.skipped.iter().chain(&comparison.skipped);
        lines.extend(missing.map(|what| format!("Not shown: {what}.")));
        lines
    }
}

/// Pictures side by side under their title.
fn in_row(section: &mut Section, title: &str, pictures: &[(String, Vec<u8>)]) {
    let stacks = pictures.iter().map(|(caption, png)| (caption.clone(), vec![png.clone()]));
    section.subheading(title).row(&stacks.collect::<Vec<_>>());
}

impl Seen {
    fn cells(&self) -> Vec<String> {
        vec![
            self.camera.clone(),
            short(self.hour),
            self.method.clone(),
            format!("{:.2}", self.bpp),
            format!("{:.2}", self.psnr_db),
            format!("{:.4}", self.ssim),
            format!("{:.4}", self.flip),
        ]
    }
}
