//! Light at one place and time: `cargo run --example 1_texel -- yard.ndgi`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("a bundle's path is missing")?;
    let bundle = ndgi::Bundle::open(path.as_ref())?;
    let light = bundle.at(18.05)?.page(0)?.sample(0.25, 0.75)?;
    println!("{light:?}");
    Ok(())
}
