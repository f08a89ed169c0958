//! One texel over a day: `cargo run --example 2_day -- yard.ndgi 0.25 0.75`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, u, v] = &arguments[..] else {
        return Err("expected a bundle's path, u and v".into());
    };
    let (u, v) = (u.parse()?, v.parse()?);
    let bundle = ndgi::Bundle::open(path.as_ref())?;
    for quarter in 0..96 {
        let hour = f64::from(quarter) / 4.0;
        let [r, g, b] = bundle.at(hour)?.page(0)?.sample(u, v)?;
        println!("{hour:5.2} h {r:9.4} {g:9.4} {b:9.4}");
    }
    Ok(())
}
