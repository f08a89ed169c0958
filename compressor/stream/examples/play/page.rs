//! The page of plots.

use crate::stats::{Row, Stats};
use reports::plot::Plot;
use serde_json::Value;

/// A scenario that was played.
pub struct Played {
    pub name: &'static str,
    pub stats: Stats,
    pub summary: Value,
    /// File names of its pictures.
    pub pictures: Vec<String>,
}

/// What a plot shows: names and values.
type Lines = &'static [(&'static str, fn(&Row) -> Option<f64>)];

/// The page, as HTML.
pub fn page(scene: &str, device: &str, played: &[Played], memory: &str) -> String {
    let mut out = format!(
        "<!doctype html><meta charset=utf-8><title>{scene}, streamed</title><style>body{{font:15px/1.5 system-ui;max-width:75rem;margin:2rem auto;padding:0 1rem}}\
         table{{border-collapse:collapse}}td,th{{padding:.2rem .7rem;text-align:right}}th:first-child,td:first-child{{text-align:left}}\
         img{{width:31%;margin:.5%}}svg{{width:48%}}</style><h1>{scene}, streamed</h1><p>On {device}. {memory}</p>"
    );
    out += "<table><tr><th>scenario<th>hits, % of pixels<th>faults a frame<th>frames to shown, p50 / p95 / p99<th>decoded a frame<th>suns a frame\
            <th>uploaded, KB a frame<th>evictions<th>again within 60 frames<th>staleness, %<th>PSNR, dB, mean / least<th>thread, ms, mean / longest<th>unlit pixels</tr>";
    for Played { name, summary, .. } in played {
        // What was not measured, as with `--every 0`, is a dash.
        let of = |path: &str, scale: f64, digits: usize| {
            let value = summary.pointer(path).and_then(Value::as_f64);
            value.map_or("–".to_owned(), |value| format!("{:.digits$}", scale * value))
        };
        let waits = "/frames_from_request_to_shown";
        out += &format!(
            "<tr><td>{name}<td>{}<td>{}<td>{} / {} / {}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{} / {}<td>{} / {}<td>{}</tr>",
            of("/hits_by_pixels", 100.0, 2),
            of("/faults_a_frame", 1.0, 2),
            of(&format!("{waits}/p50"), 1.0, 0),
            of(&format!("{waits}/p95"), 1.0, 0),
            of(&format!("{waits}/p99"), 1.0, 0),
            of("/decoded_a_frame", 1.0, 1),
            of("/suns_a_frame", 1.0, 1),
            of("/upload_bytes_a_frame", 1e-3, 0),
            of("/evictions", 1.0, 0),
            of("/faults_again_within_60_frames", 1.0, 0),
            of("/staleness_by_pixels", 100.0, 2),
            of("/psnr/mean", 1.0, 1),
            of("/psnr/min", 1.0, 1),
            of("/thread_ms/mean", 1.0, 2),
            of("/thread_ms/longest", 1.0, 1),
            of("/unlit_pixels", 1.0, 0),
        );
    }
    out += "</table>";
    for Played { name, stats, pictures, .. } in played {
        out += &format!("<h2>{name}</h2>");
        for picture in pictures {
            out += &format!("<img src=\"{picture}\" alt=\"{picture}\">");
        }
        out += "<br>";
        let plots: [(&str, &str, Lines); 4] = [
            (
                "Shown at the requested level",
                "% of pixels",
                &[("hits", |row| Some(100.0 * row.hits_by_pixels))],
            ),
            (
                "Tiles a frame",
                "tiles",
                &[
                    ("seen", |row| Some(row.tiles as f64)),
                    ("decoded", |row| Some(row.decoded as f64)),
                    ("suns alone", |row| Some(row.suns as f64)),
                    ("loaded", |row| Some(row.loaded as f64)),
                    ("evicted", |row| Some(row.evictions as f64)),
                ],
            ),
            ("Against the fully decoded pages", "dB", &[("PSNR", |row| row.psnr)]),
            ("Frame thread", "ms", &[("runtime", |row| Some(row.thread_ms))]),
        ];
        for (title, y, lines) in plots {
            let line = |(name, value): &(&str, fn(&Row) -> Option<f64>)| {
                let point = |(i, row): (usize, &Row)| value(row).map(|y| (i as f64 / 30.0, y));
                let rows = &stats.rows[..stats.rows.len().saturating_sub(1)];
                ((*name).to_owned(), rows.iter().enumerate().filter_map(point).collect())
            };
            let plot = Plot {
                title: title.to_owned(),
                x: "seconds".to_owned(),
                y: y.to_owned(),
                log_x: false,
                log_y: false,
                lines: lines.iter().map(line).collect(),
            };
            out += &plot.to_svg();
        }
    }
    out
}
