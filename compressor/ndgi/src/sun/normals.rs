//! The normals of one tile, by blocks of 4×4 texels: one of a palette, one of its own, two and where each
//! texel lies between them, two to eight of which each texel has one, or one for each texel. So they are
//! exact to about a degree, in few bytes where surfaces are plain.

/// Most normals of a palette; the numbers behind them say that a block has its own.
const MOST: usize = 250;
const ONE: u8 = 250;
const TWO: u8 = 251;
const BETWEEN: u8 = 252;
const FOUR: u8 = 253;
const EIGHT: u8 = 254;
const EACH: u8 = 255;
/// Of a block that has its own: how many normals are told, and the bits by which each texel chooses.
const OWN: [(u8, usize, usize); 6] =
    [(ONE, 1, 0), (TWO, 2, 1), (BETWEEN, 2, 2), (FOUR, 4, 2), (EIGHT, 8, 3), (EACH, 16, 0)];
/// What a component of 1 is in a palette.
const UNIT: f32 = 32767.0;
/// How far a normal may be from what is told: a degree; from that of its palette: half of one.
const NEAR: f32 = 0.0175;
const ALIKE: f32 = 0.0087;
/// A normal that this many blocks have is worth its place in the palette.
const WORTH: usize = 3;

/// Whether nothing is known of a normal, or it does not matter.
fn is_any(normal: &[f32; 3]) -> bool {
    *normal == [0.0; 3]
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt()
}

fn unit(normal: [f32; 3]) -> [f32; 3] {
    let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length > 0.0 { normal.map(|x| x / length) } else { [0.0, 1.0, 0.0] }
}

/// The texels of a block, row by row.
fn texels(block: usize, width: usize) -> impl Iterator<Item = usize> {
    let across = width / 4;
    let corner = block / across * 4 * width + block % across * 4;
    (0..16).map(move |i| corner + i / 4 * width + i % 4)
}

/// The number of normals of the palette, and the bytes; none of both where there is no surface.
pub(super) fn encode(normals: &[[f32; 3]], width: usize) -> (usize, Vec<u8>) {
    if normals.iter().all(is_any) {
        return (0, Vec::new());
    }
    let (across, blocks) = (width / 4, normals.len() / 16);
    // The mean normal of each block whose texels are alike.
    let even: Vec<Option<[f32; 3]>> = (0..blocks)
        .map(|block| {
            let known: Vec<[f32; 3]> =
                texels(block, width).map(|i| normals[i]).filter(|n| !is_any(n)).collect();
            let mean = [0, 1, 2]
                .map(|c| known.iter().map(|normal| normal[c]).sum::<f32>() / known.len().max(1) as f32);
            (!known.is_empty() && known.iter().all(|normal| distance(*normal, mean) <= NEAR - ALIKE))
                .then_some(mean)
        })
        .collect();
    let mut palette: Vec<([f32; 3], usize)> = Vec::new();
    for normal in even.iter().flatten() {
        match palette.iter_mut().find(|(of, _)| distance(*of, *normal) <= ALIKE) {
            Some((_, count)) => *count += 1,
            None => palette.push((*normal, 1)),
        }
    }
    palette.retain(|(_, count)| *count >= WORTH);
    palette.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    palette.truncate(MOST);
    let component = |value: f32| ((value * UNIT).round() as i16).to_le_bytes();
    let mut bytes: Vec<u8> = palette.iter().flat_map(|(normal, _)| *normal).flat_map(component).collect();
    let mut table: Vec<u8> = Vec::with_capacity(blocks);
    let mut own = Vec::new();
    for block in 0..blocks {
        let of: [[f32; 3]; 16] = std::array::from_fn(|i| normals[texels(block, width).nth(i).unwrap_or(0)]);
        if of.iter().all(is_any) {
            // What does not matter continues the longest run.
            let above = block.checked_sub(across).map(|above| table[above]);
            let beside = above.or(table.last().copied()).filter(|kind| *kind < ONE);
            table.push(beside.unwrap_or(if palette.is_empty() { ONE } else { 0 }));
            if palette.is_empty() {
                own.extend(octahedral([0.0, 1.0, 0.0]));
            }
            continue;
        }
        if let Some(normal) = even[block] {
            let near = palette.iter().position(|(of, _)| distance(*of, normal) <= ALIKE);
            table.push(near.map_or(ONE, |at| at as u8));
            if near.is_none() {
                own.extend(octahedral(normal));
            }
            continue;
        }
        let (kind, reported) = several(&of);
        table.push(kind);
        own.extend(reported);
    }
    // Runs: this many blocks as above, then this many of one kind.
    let mut at = 0;
    while at < blocks {
        let is_above = |block: &usize| *block >= across && table[*block] == table[*block - across];
        let same = (at..blocks).take_while(is_above).take(255).count();
        at += same;
        let kind = table.get(at).copied().unwrap_or(0);
        let run =
            (at..blocks).take_while(|block| table[*block] == kind && !is_above(block)).take(255).count();
        at += run;
        bytes.extend([same as u8, run as u8, kind]);
    }
    bytes.extend(own);
    (palette.len(), bytes)
}

/// What is told of a block of several normals: as few as are near to all.
fn several(of: &[[f32; 3]; 16]) -> (u8, Vec<u8>) {
    let known: Vec<[f32; 3]> = of.iter().copied().filter(|normal| !is_any(normal)).collect();
    let coded: Vec<[u8; 2]> = known.iter().map(|normal| octahedral(*normal)).collect();
    // The two most different ones, and then always the one that is farthest from those that there are.
    let pairs = (0..known.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let order = |x: &(usize, usize), y: &(usize, usize)| {
        distance(known[x.0], known[x.1]).total_cmp(&distance(known[y.0], known[y.1]))
    };
    let (a, b) = pairs.max_by(order).unwrap_or_default();
    let mut chosen = vec![a, b];
    while chosen.len() < 8.min(known.len()) {
        let near = |i: usize| chosen.iter().map(|&of| distance(known[i], known[of])).fold(f32::MAX, f32::min);
        let farthest = (0..known.len()).max_by(|&x, &y| near(x).total_cmp(&near(y))).unwrap_or_default();
        chosen.push(farthest);
    }
    for (kind, reported, bits) in OWN {
        if bits == 0 || reported > chosen.len() && reported > 2 && chosen.len() < known.len() {
            continue;
        }
        let ends: Vec<[u8; 2]> = (0..reported).map(|i| coded[chosen[i.min(chosen.len() - 1)]]).collect();
        let tones = tones(kind, &ends);
        let far = |tone: usize, normal: &[f32; 3]| distance(tones[tone], unit(*normal));
        let nearest = |normal: &[f32; 3]| {
            (0..tones.len()).min_by(|a, b| far(*a, normal).total_cmp(&far(*b, normal))).unwrap_or(0)
        };
        let choice = of.map(|normal| if is_any(&normal) { 0 } else { nearest(&normal) });
        if of.iter().zip(choice).all(|(normal, tone)| is_any(normal) || far(tone, normal) <= NEAR) {
            let mut word = 0u64;
            choice.iter().enumerate().for_each(|(i, tone)| word |= (*tone as u64) << (bits * i));
            return (kind, [ends.as_flattened(), &word.to_le_bytes()[..2 * bits]].concat());
        }
    }
    (EACH, of.iter().flat_map(|normal| octahedral(if is_any(normal) { known[0] } else { *normal })).collect())
}

/// The normals that texels of a block may have.
fn tones(kind: u8, reported: &[[u8; 2]]) -> Vec<[f32; 3]> {
    match kind {
        BETWEEN => (0..4).map(|step| between([reported[0], reported[1]], step, 4)).collect(),
        _ => reported.iter().map(|two| from_octahedral(*two)).collect(),
    }
}

/// The normal this many steps from the first end to the second, the last of which is that.
fn between(ends: [[u8; 2]; 2], step: usize, steps: usize) -> [f32; 3] {
    let [a, b] = ends.map(from_octahedral);
    let part = step as f32 / (steps - 1) as f32;
    unit(std::array::from_fn(|c| a[c] * (1.0 - part) + b[c] * part))
}

/// The normals of a tile; what is left of the bytes.
///
/// # Errors
/// What the format forbids.
pub(super) fn decode(
    count: usize,
    mut bytes: &[u8],
    [width, height]: [usize; 2],
) -> Result<(Vec<[f32; 3]>, &[u8]), String> {
    let mut take = |n: usize| {
        let (part, rest) = bytes.split_at_checked(n).ok_or("normals are cut short")?;
        bytes = rest;
        Ok::<_, String>(part)
    };
    let component = |two: &[u8; 2]| f32::from(i16::from_le_bytes(*two)) / UNIT;
    let palette: Vec<[f32; 3]> = take(6 * count)?
        .as_chunks::<6>()
        .0
        .iter()
        .map(|six| std::array::from_fn(|c| component(&[six[2 * c], six[2 * c + 1]])))
        .collect();
    if count > MOST || palette.iter().any(|normal| normal.iter().map(|n| n * n).sum::<f32>() > 1.001) {
        return Err("a palette of too many normals, or one longer than 1".to_owned());
    }
    let (across, blocks) = (width / 4, width * height / 16);
    let mut table: Vec<u8> = Vec::with_capacity(blocks);
    while table.len() < blocks {
        let run = take(3)?;
        let (same, run, kind) = (usize::from(run[0]), usize::from(run[1]), run[2]);
        let is_known = kind >= ONE || usize::from(kind) < count || run == 0;
        if same + run == 0
            || !is_known
            || table.len() + same + run > blocks
            || same > 0 && table.len() < across
        {
            return Err("runs of normals that exceed the tile".to_owned());
        }
        for _ in 0..same {
            table.push(table[table.len() - across]);
        }
        table.resize(table.len() + run, kind);
    }
    let mut normals = vec![[0.0; 3]; width * height];
    for (block, kind) in table.into_iter().enumerate() {
        let Some(&(_, reported, bits)) = OWN.iter().find(|(own, ..)| *own == kind) else {
            texels(block, width).for_each(|texel| normals[texel] = palette[usize::from(kind)]);
            continue;
        };
        let tones = tones(kind, take(2 * reported)?.as_chunks::<2>().0);
        let choice = take(2 * bits)?.iter().rev().fold(0u64, |word, byte| word << 8 | u64::from(*byte));
        for (i, texel) in texels(block, width).enumerate() {
            let tone = match bits {
                0 => i.min(reported - 1),
                _ => (choice >> (bits * i)) as usize & ((1 << bits) - 1),
            };
            normals[texel] = tones[tone];
        }
    }
    Ok((normals, bytes))
}

/// A direction as the point of the octahedron |x| + |y| + |z| = 1 beneath it, its lower half folded outwards,
/// in 8 bits each.
fn octahedral([x, y, z]: [f32; 3]) -> [u8; 2] {
    let whole = (x.abs() + y.abs() + z.abs()).max(f32::MIN_POSITIVE);
    let (u, v) = (x / whole, z / whole);
    let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
    let (u, v) = if y < 0.0 { (fold(u, v), fold(v, u)) } else { (u, v) };
    [u, v].map(|value| (127.0 * value + 128.0).round().clamp(1.0, 255.0) as u8)
}

fn from_octahedral(two: [u8; 2]) -> [f32; 3] {
    let [u, v] = two.map(|value| ((f32::from(value) - 128.0) / 127.0).max(-1.0));
    let y = 1.0 - u.abs() - v.abs();
    let under = (-y).max(0.0);
    let unfold = |a: f32| if a < 0.0 { a + under } else { a - under };
    let (x, z) = (unfold(u), unfold(v));
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn degrees(a: [f32; 3], b: [f32; 3]) -> f64 {
        let dot = |a: [f32; 3], b: [f32; 3]| (0..3).map(|c| f64::from(a[c]) * f64::from(b[c])).sum::<f64>();
        (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()).min(1.0).acos().to_degrees()
    }

    fn direction(random: &mut Random) -> [f32; 3] {
        loop {
            let v: [f32; 3] = std::array::from_fn(|_| 2.0 * random.unit() - 1.0);
            let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
            if (0.1..1.0).contains(&length) {
                return v.map(|x| x / length);
            }
        }
    }

    #[test]
    fn all_normals_come_back_within_about_a_degree_and_plain_ones_in_a_few_bytes() {
        let mut random = Random(2);
        let walls: Vec<[f32; 3]> = (0..5).map(|_| direction(&mut random)).collect();
        let (width, height) = (128, 64);
        let chart = |i: usize| i % width / 40 + 3 * (i / width / 50);
        let cylinder = |i: usize| {
            let angle = (i % width) as f32 / 40.0;
            [angle.cos(), 0.0, angle.sin()]
        };
        let cases: [(&str, Vec<[f32; 3]>, usize); 5] = [
            ("nothing", vec![[0.0; 3]; width * height], 0),
            ("one wall", vec![walls[0]; width * height], 24),
            ("charts", (0..width * height).map(|i| walls[chart(i) % 5]).collect(), 400),
            ("a cylinder", (0..width * height).map(cylinder).collect(), width * height / 2 + 100),
            (
                "noise",
                (0..width * height).map(|_| direction(&mut random)).collect(),
                2 * width * height + 100,
            ),
        ];
        for (name, normals, most) in cases {
            let (count, bytes) = encode(&normals, width);
            assert!(bytes.len() <= most, "{name}: {} bytes", bytes.len());
            if bytes.is_empty() {
                continue;
            }
            let (again, rest) = decode(count, &bytes, [width, height]).unwrap();
            assert!(rest.is_empty());
            let worst = normals
                .iter()
                .zip(&again)
                .filter(|(normal, _)| !is_any(normal))
                .map(|(a, b)| degrees(*a, *b))
                .fold(0.0, f64::max);
            assert!(worst <= 1.15, "{name}: {worst}");
            for length in 0..bytes.len().min(200) {
                assert!(decode(count, &bytes[..length], [width, height]).is_err());
            }
        }
    }

    #[test]
    fn what_is_no_surface_takes_whatever_is_near() {
        let mut normals = vec![[0.0; 3]; 64];
        normals[27] = [0.0, 0.6, 0.8];
        let (count, bytes) = encode(&normals, 8);
        let (found, _) = decode(count, &bytes, [8, 8]).unwrap();
        assert!(degrees(found[27], normals[27]) < 0.7, "{:?}", found[27]);
    }
}
