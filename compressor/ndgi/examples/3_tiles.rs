//! Tiles for a texture of half floats, by how bright they are: `cargo run --example 3_tiles -- yard.ndgi`.

use ndgi::decode::Lights;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("a bundle's path is missing")?;
    let bundle = ndgi::Bundle::open(path.as_ref())?;
    // A game that draws the sun itself asks for the rest.
    let now = bundle.at(12.0)?.only(Lights::Baked);
    for place in bundle.header.places() {
        // What the header says of a tile costs no read: a black one need not be decoded.
        let knots = bundle.knots(place)?;
        let peak = knots.iter().map(|knot| knot.peak).fold(0.0, f32::max);
        if peak == 0.0 && !knots.is_empty() {
            continue;
        }
        let tile = now.tile(place)?;
        let mut texels = vec![[0; 4]; tile.width() * tile.height()];
        // Half floats hold 256 times kilolux from starlight to 255 kilolux; the material divides by 256.
        tile.decode_rgba16f(256.0, &mut texels);
        println!(
            "page {}, tile ({}, {}): {} texels, {peak} at its brightest",
            place.page,
            place.column,
            place.row,
            texels.len()
        );
    }
    Ok(())
}
