//! Another denoiser beside the own filters: the light of each layer as images for it to read, what it made of
//! them, and the error of all three.
//!
//! The folder gets, of layer 3, `03.traced.pfm`, `03.own.pfm` and `03.reference.pfm`: images of the virtual
//! page, black where no texel is valid; and `charts.pfm`, with 1 + the number of each texel's chart, 0 where
//! it is of none alone. Where `03.peer.pfm` lies beside them, and so for every layer, that is judged too, as
//! the baker judges bakes (`bake::errors::local_errors`), but by the distance to the reference: by the
//! indirect light of each set, and by that of each layer; likewise `03.apart.pfm`, a second way of the
//! peer's. `judged.json` tells.

use baker::Rgb;
use baker::bake::errors::{CellMap, LocalErrorSummary, Pieces, Sums};
use baker::bake::run::Denoise;
use baker::bake::store::{Parts, Value};
use glam::DVec3;
use serde_json::{Value as Json, json};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The ways to the light of a layer; the last ones may be missing.
const WAYS: [&str; 4] = ["traced", "own", "peer", "apart"];

/// Light of a layer or a set, by each way.
type Ways = Vec<Vec<Rgb>>;

/// The layers so far.
pub struct Peer {
    folder: PathBuf,
    cell_map: CellMap,
    size: (usize, usize),
    /// Indices on the page of the texels that count.
    indices: Vec<usize>,
    /// Per layer of the plan with light: name, light by each way, and the reference.
    layers: BTreeMap<usize, (String, Ways, Vec<Value>)>,
}

impl Peer {
    /// Of these texels of a page.
    pub fn new(folder: PathBuf, cell_map: CellMap, size: (usize, usize), indices: Vec<usize>) -> Self {
        std::fs::create_dir_all(&folder).unwrap();
        let peer = Peer { folder, cell_map, size, indices, layers: BTreeMap::new() };
        let chart = |&index: &usize| peer.cell_map.chart_of(index % size.0, index / size.0);
        let charts =
            peer.indices.iter().map(|index| Rgb::splat(chart(index).map_or(0.0, |c| c as f32 + 1.0)));
        std::fs::write(peer.folder.join("charts.pfm"), peer.image(&charts.collect::<Vec<_>>())).unwrap();
        peer
    }

    /// Writes a layer's images, and reads what the other denoiser made of it.
    pub fn add(&mut self, layer: usize, name: String, light: [Vec<Rgb>; 2], reference: Vec<Value>) {
        let path = |what: &str| self.folder.join(format!("{layer:02}.{what}.pfm"));
        let means: Vec<Rgb> = reference.iter().map(|value| value.mean).collect();
        for (what, light) in [("traced", &light[0]), ("own", &light[1]), ("reference", &means)] {
            std::fs::write(path(what), self.image(light)).unwrap();
        }
        let mut ways = Vec::from(light);
        let read = |way: &&str| std::fs::read(path(way)).ok().map(|bytes| self.light(&bytes));
        ways.extend(WAYS[2..].iter().map_while(read));
        self.layers.insert(layer, (name, ways, reference));
    }

    /// Judges all ways that are there for every layer.
    pub fn finish(self, sets: &[Parts], own: Json) {
        let ways = self.layers.values().map(|(_, ways, _)| ways.len()).min().unwrap_or(0);
        let layers: Vec<Json> = self
            .layers
            .values()
            .map(|(name, light, reference)| {
                let cells = self.cells(&light[..ways], reference);
                json!({ "name": name, "ways": told(&cells) })
            })
            .collect();
        let mut all = Vec::new();
        for parts in sets {
            let mut light = vec![vec![Rgb::ZERO; self.indices.len()]; ways];
            let mut reference = vec![Value::default(); self.indices.len()];
            for &(layer, scale) in parts {
                let Some((_, of_layer, truth)) = self.layers.get(&layer) else { continue };
                for (sum, part) in light.iter_mut().zip(of_layer) {
                    sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += *part * scale);
                }
                reference.iter_mut().zip(truth).for_each(|(sum, part)| *sum = sum.plus(part.times(scale)));
            }
            all.extend(self.cells(&light, &reference));
        }
        let judged = json!({ "method": Denoise::METHOD, "own": own, "layers": layers, "sets": told(&all) });
        let path = self.folder.join("judged.json");
        std::fs::write(path, serde_json::to_string_pretty(&judged).unwrap()).unwrap();
    }

    /// Per cell with valid texels, what is measured of each way: the local error, with the reference's own
    /// noise taken out.
    fn cells(&self, ways: &[Vec<Rgb>], reference: &[Value]) -> Vec<Cell> {
        let (width, grid) = (self.size.0, self.cell_map.grid());
        let place = |index: usize| (index % width, index / width);
        let key = |index: usize| {
            let (x, y) = place(index);
            (grid.at(x, y), self.cell_map.chart_of(x, y))
        };
        let mut sums = vec![Sums::default(); grid.cells()];
        Pieces::of_texels(&self.cell_map, width, self.indices.iter().copied()).add(reference, &mut sums);
        let floors = self.cell_map.floors(&sums);
        let mut pieces: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        self.indices.iter().enumerate().for_each(|(i, &index)| pieces.entry(key(index)).or_default().push(i));
        let mut cells: BTreeMap<usize, Cell> = BTreeMap::new();
        for ((cell, _), texels) in pieces {
            let truth = |i: usize| reference[i].mean.as_dvec3();
            let values = 3.0 * texels.len() as f64;
            let mean = texels.iter().map(|&i| truth(i).element_sum()).sum::<f64>() / values;
            let of_cell = cells.entry(cell).or_insert_with(|| Cell::new(ways.len(), floors[cell]));
            of_cell.texels += texels.len() as u64;
            for (way, light) in ways.iter().enumerate() {
                let squared = |i: usize| {
                    let off: DVec3 = light[i].as_dvec3() - truth(i);
                    off.length_squared() - reference[i].noise.as_dvec3().length_squared()
                };
                let squared: f64 = texels.iter().map(|&i| squared(i)).sum();
                of_cell.squared[way] += squared;
                of_cell.local[way] += if mean > 0.0 { squared / (mean * mean) } else { 0.0 };
                of_cell.light[way] += texels.iter().map(|&i| light[i].as_dvec3().element_sum()).sum::<f64>();
            }
        }
        cells.into_values().collect()
    }

    /// A colour PFM file: rows from the bottom up, little-endian.
    fn image(&self, light: &[Rgb]) -> Vec<u8> {
        let (width, height) = self.size;
        let mut texels = vec![[0.0f32; 3]; width * height];
        for (&index, light) in self.indices.iter().zip(light) {
            texels[(height - 1 - index / width) * width + index % width] = light.to_array();
        }
        let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
        bytes.extend(texels.iter().flatten().flat_map(|value| value.to_le_bytes()));
        bytes
    }

    /// The light of the texels that count, from such a file.
    fn light(&self, bytes: &[u8]) -> Vec<Rgb> {
        let (width, height) = self.size;
        let values = &bytes[bytes.len() - 12 * width * height..];
        let value = |i: usize| f32::from_le_bytes(values[4 * i..4 * i + 4].try_into().unwrap());
        let texel = |&index: &usize| {
            let first = 3 * ((height - 1 - index / width) * width + index % width);
            Rgb::new(value(first), value(first + 1), value(first + 2))
        };
        self.indices.iter().map(texel).collect()
    }
}

/// A cell at a set, or of a layer; by each way.
struct Cell {
    texels: u64,
    /// The light below which nothing is judged.
    floor: f64,
    squared: Vec<f64>,
    local: Vec<f64>,
    light: Vec<f64>,
}

impl Cell {
    fn new(ways: usize, floor: f64) -> Self {
        let zero = || vec![0.0; ways];
        Cell { texels: 0, floor, squared: zero(), local: zero(), light: zero() }
    }

    /// Its local error (as `bake::errors::local_errors::error`).
    fn error(&self, way: usize) -> f64 {
        let root = |squared: f64| (squared.max(0.0) / (3 * self.texels) as f64).sqrt();
        root(self.local[way]).min(root(self.squared[way]) / self.floor)
    }
}

/// Of cells, by each way: local error; how many texels are in cells that are worse than traced by more than 5
/// and 50 %; light gained.
fn told(cells: &[Cell]) -> Json {
    let texels: u64 = cells.iter().map(|cell| cell.texels).sum();
    let of_way = |way: usize| {
        let local = LocalErrorSummary::of(cells.iter().map(|cell| (cell.error(way), cell.texels)))?;
        let worse = |by: f64| {
            let worse = cells.iter().filter(|cell| cell.error(way) > by * cell.error(0));
            worse.map(|cell| cell.texels).sum::<u64>() as f64 / texels as f64
        };
        let light = |way: usize| cells.iter().map(|cell| cell.light[way]).sum::<f64>();
        let gained = light(way) / light(0) - 1.0;
        Some(json!({ "local": local, "worse": [worse(1.05), worse(1.5)], "gained": gained }))
    };
    let ways = cells.first().map_or(0, |cell| cell.local.len());
    (0..ways).map(|way| (WAYS[way].to_owned(), json!(of_way(way)))).collect::<serde_json::Map<_, _>>().into()
}
