//! `compress info`.

use super::open;

use commands::console::Console;
use compressor::bundle::{Bundle, MapCoding};
use compressor::model::Contents;
use compressor::{Result, of_bundle, printable};
use dataset::observe::count;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Tiles by their configuration, with number and bytes; the largest share of the bundle first.
fn contents(bundle: &Bundle) -> Vec<serde_json::Value> {
    let mut kinds: BTreeMap<String, (usize, u64)> = BTreeMap::new();
    for entry in bundle.index.iter().filter(|entry| entry.maps.length > 0) {
        let kind = match bundle.header.coding {
            MapCoding::Basis => count(entry.maps.word as usize, "plane"),
            MapCoding::Neural => {
                Contents::of_word(entry.maps.word).map_or(String::new(), |contents| contents.to_string())
            }
        };
        let (tiles, bytes) = kinds.entry(kind).or_default();
        (*tiles, *bytes) = (*tiles + 1, *bytes + u64::from(entry.maps.length));
    }
    let mut kinds: Vec<_> = kinds.into_iter().collect();
    kinds.sort_by_key(|(_, (_, bytes))| std::cmp::Reverse(*bytes));
    let object = |(has, (tiles, bytes))| json!({ "has": has, "tiles": tiles, "bytes": bytes });
    kinds.into_iter().map(object).collect()
}

pub(crate) fn info(path: PathBuf, console: &Console) -> Result<()> {
    let bundle = open(&path)?;
    let header = &bundle.header;
    bundle.verify().map_err(of_bundle)?;
    let held = header
        .places()
        .map(|place| bundle.bytes_held_of_sun(place))
        .sum::<Result<u64, _>>()
        .map_err(of_bundle)?;
    let pages: Vec<_> = header.pages.iter().map(|page| json!([page.width, page.height])).collect();
    let empty = bundle.index.iter().filter(|entry| entry.bytes() == 0).count();
    let groups: Vec<_> = header
        .groups
        .iter()
        .zip(&header.timeline.intervals)
        .map(|(name, on)| json!({ "name": name, "on": on }))
        .collect();
    let texels: f64 = header.pages.iter().map(|page| page.width as f64 * page.height as f64).sum();
    let bpp = bundle.bytes as f64 * 8.0 / (texels * header.timeline.hours.len() as f64);
    // The writer's notes are shown verbatim where they are not JSON.
    let written = serde_json::from_str(&header.info).unwrap_or_else(|_| json!(header.info));
    let object = json!({
        "scene": header.scene, "profile": written["profile"], "pages": pages, "hours": header.timeline.hours, "groups": groups,
        "tiles": bundle.index.len(), "tiles_empty": empty, "contents": contents(&bundle),
        "hours_between": header.timeline.between, "sun_times": header.sun.as_ref().map(|sun| &sun.times),
        "bytes_of_sun": bundle.index.iter().map(|entry| u64::from(entry.sun.length)).sum::<u64>(),
        "bytes_of_shadows": bundle.index.iter().map(|entry| u64::from(entry.shadows.length)).sum::<u64>(),
        "bytes_held_of_sun": held,
        "bytes_of_header": bytes_around(&bundle), "bytes_resident": bundle.bytes_resident,
        "bytes": bundle.bytes, "bpp": bpp, "written": written,
    });
    for (name, text) in in_words(&bundle, &written, bpp, held) {
        console.print(format!("{name:>8}  {text}"));
    }
    console.result(&object)?;
    Ok(())
}

/// Bytes of header and index: all that is neither a tile's nor resident.
fn bytes_around(bundle: &Bundle) -> u64 {
    bundle.bytes - bundle.bytes_resident - bundle.index.iter().map(|entry| entry.bytes()).sum::<u64>()
}

/// An hour as hh:mm.
fn clock(hour: f64) -> String {
    let minutes = (hour * 60.0).round() as u64;
    format!("{:02}:{:02}", minutes / 60, minutes % 60)
}

/// A bundle's contents as (label, text) lines without control characters.
fn in_words(
    bundle: &Bundle,
    written: &serde_json::Value,
    bpp: f64,
    held: u64,
) -> Vec<(&'static str, String)> {
    let header = &bundle.header;
    let hours = &header.timeline.hours;
    let mut lines = vec![("scene", header.scene.clone())];
    let pages: Vec<String> =
        header.pages.iter().map(|page| format!("{} × {}", page.width, page.height)).collect();
    lines.push(("pages", format!("{} texels", pages.join(", "))));
    let level = written["level"].as_u64().filter(|level| (1..32).contains(level));
    lines.extend(level.map(|level| {
        let (side, of) = (1u64 << level, "texels of full resolution");
        ("level", format!("{level}: a texel is the mean of {side} × {side} {of}; texel position p at full resolution is p / {side} here"))
    }));
    let (first, last) = (hours.first().copied().unwrap_or(0.0), hours.last().copied().unwrap_or(0.0));
    lines.push(("frames", format!("{}, from {} to {}", hours.len(), clock(first), clock(last))));
    for (name, on) in header.groups.iter().zip(&header.timeline.intervals) {
        let spans: Vec<String> =
            on.iter().map(|[from, to]| format!("{}–{}", clock(*from), clock(*to))).collect();
        lines.push((
            "group",
            format!("{name}, {}", if spans.is_empty() { "off".to_owned() } else { spans.join(", ") }),
        ));
    }
    let [around, resident] = [bytes_around(bundle), bundle.bytes_resident];
    let parts = format!("of these {around} header and index, {resident} resident data of all tiles");
    lines.push(("size", format!("{} bytes, {bpp:.3} bits per texel and frame; {parts}", bundle.bytes)));
    let empty = bundle.index.iter().filter(|entry| entry.bytes() == 0).count();
    lines.push(("tiles", format!("{}, {empty} of them empty", bundle.index.len())));
    let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    for kind in contents(bundle) {
        lines.push(("", format!("{} × {}: {} bytes", kind["tiles"], text(&kind["has"]), kind["bytes"])));
    }
    let of_sun: Vec<u64> =
        bundle.index.iter().map(|entry| u64::from(entry.sun.length)).filter(|n| *n > 0).collect();
    if let Some(sun) = &header.sun {
        let [first, last] =
            [sun.times.first(), sun.times.last()].map(|hour| hour.copied().unwrap_or_default());
        let times = format!("{} times from {} to {}", sun.times.len(), clock(first), clock(last));
        let moving: u64 = bundle.index.iter().map(|entry| u64::from(entry.shadows.length)).sum();
        let moving = match header.shadows {
            true => format!(", {moving} of moving shadows"),
            false => String::new(),
        };
        let bytes = of_sun.iter().sum::<u64>();
        lines.push((
            "sun",
            format!(
                "{times}, {} tiles: {bytes} bytes{moving}; at one time {held} bytes in memory in a compact layout",
                of_sun.len()
            ),
        ));
    }
    if written["sun"] == "left out" {
        lines.push(("sun", "omitted (--without-sun)".to_owned()));
    } else if written["sun"] == "apart" && header.sun.is_none() {
        lines.push(("sun", "lights nothing directly in any frame".to_owned()));
    }
    if written.is_object() {
        let choice = match (&written["profile"], &written["target_psnr_db"], &written["target_bpp"]) {
            (serde_json::Value::String(profile), ..) => format!("profile {profile}"),
            (_, serde_json::Value::Number(db), _) => format!("--target-psnr {db}"),
            (.., serde_json::Value::Number(bpp)) => format!("--target-bpp {bpp}"),
            _ => "no target".to_owned(),
        };
        let by = format!("{}, {choice}", text(&written["generator"]));
        let limit = written["time_limit_secs"].as_f64();
        let limit = limit.map_or(String::new(), |limit| format!(" at most, within {limit} s"));
        let steps = match bundle.header.coding {
            MapCoding::Neural => format!("{} steps{limit}, seed {}", written["iterations"], written["seed"]),
            MapCoding::Basis => "--coding basis".to_owned(),
        };
        lines.push(("written", format!("by {by}, {steps}")));
    }
    // Names come from the file.
    lines.into_iter().map(|(name, text)| (name, printable(&text))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_of_a_bundle_steers_the_terminal() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut bundle = open(&root.join("../../tests/fuzz/corpus/bundle/lamps.ndgi")).unwrap();
        bundle.header.scene = "yard\u{1b}[2J\nframes".to_owned();
        bundle.header.groups.iter_mut().for_each(|name| *name = "\u{9b}31mporch\u{7}".to_owned());
        let written = json!({ "generator": "\u{1b}]0;title\u{7}", "profile": "\u{1b}c", "iterations": "\u{9b}", "seed": 1 });
        let lines = in_words(&bundle, &written, 1.0, 0);
        assert!(lines.iter().all(|(_, text)| !text.contains(char::is_control)), "{lines:?}");
        assert_eq!(lines[0], ("scene", "yard\\u{1b}[2J\\nframes".to_owned()));
        let groups = lines.iter().filter(|(name, _)| *name == "group");
        assert!(groups.clone().count() > 0);
        assert!(groups.into_iter().all(|(_, text)| text.starts_with("\\u{9b}31mporch\\u{7}, ")), "{lines:?}");
    }

    #[test]
    fn planes_are_told_as_planes() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let bundle = open(&root.join("../../tests/fuzz/corpus/bundle/planes.ndgi")).unwrap();
        let written =
            json!({ "generator": "compress", "coding": "basis", "target_bpp": 0.4, "iterations": null });
        let lines = in_words(&bundle, &written, 1.0, 0);
        assert!(lines.iter().any(|(_, text)| text.starts_with("2 × 7 planes")), "{lines:?}");
        assert_eq!(lines.last().unwrap().1, "by compress, --target-bpp 0.4, --coding basis");
    }
}
