//! A scene of many copies of another one, as large as a test needs it.

use std::fmt::Write;

/// Metres between copies: no scene of this folder is longer.
const SPACING: f64 = 270.0;

/// The scene file of `copies` copies of the geometry file `file`, on a square grid, with sun and sky, on one
/// page of `size`².
///
/// Everything gets texels, down to window handles: a page of this scene holds far more charts than it has
/// room for.
pub fn scene(file: &str, copies: usize, size: u32) -> String {
    let columns = (copies as f64).sqrt().ceil() as usize;
    let mut text = String::from(
        "description = \"Many copies of one scene\"\n\n\
         [place]\nlatitude = 48.2\nlongitude = 11.6\nutc_offset = 2.0\ndate = \"2026-04-18\"\n\n\
         [sun]\n\n[sky]\nmodel = \"hosek-wilkie\"\n\n",
    );
    let _ = writeln!(text, "[[object]]\nfile = \"{file}\"\ninstances = [");
    for copy in 0..copies {
        let (x, z) = (SPACING * (copy % columns) as f64, SPACING * (copy / columns) as f64);
        // Quarter turns, as blocks of a real town are turned.
        let turn = 90 * (copy % 4);
        let _ = writeln!(text, "  {{ translate = [{x:.1}, 0.0, {z:.1}], rotate = [0, {turn}, 0] }},");
    }
    let _ = writeln!(text, "]\n\n[lightmap]\nsize = {size}");
    text
}
