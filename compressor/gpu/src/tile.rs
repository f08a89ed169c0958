//! A tile's data as the shader reads them: resident maps, and the job for one time.

use crate::place::Site;
use crate::request::Request;
use crate::shader::{self, HAS_MAPS, HAS_UT, HAS_UV, HAS_UVT, HAS_VT, Job};
use crate::sun::{Held, Seen};
use ndgi::Bundle;
use ndgi::at::SunAt;
use ndgi::decode::{Inputs, Lights, along_tau};
use ndgi::model::{BORDER, Shape, TileParams};
use ndgi::time::{TimePoint, Timeline};

/// Beyond this a value does not fit into a 16-bit float.
const HALF_MAX: f32 = 65504.0;

/// What is known of a tile's section of features; its large maps are on the device.
#[derive(Debug)]
pub(crate) struct Maps {
    /// Without the blocks, and without F_ut and F_vt.
    params: TileParams,
    /// In texels of two bytes of its part of the resident buffer, which the weights begin.
    ut: u32,
    vt: u32,
    /// Whether its network may be evaluated in 16 bits.
    pub fits_half: bool,
}

/// A tile with its place on the device.
pub(crate) struct Placed<'a> {
    pub maps: Option<&'a Maps>,
    pub seen: Option<&'a Seen>,
    pub site: &'a Site,
    /// What it sees in the interval that its part of the interval's buffer is of.
    pub held: Option<Held>,
}

/// A job, with the biases behind it.
pub(crate) struct Full {
    pub job: Job,
    pub bias: Vec<f32>,
    /// Width of the hidden layers; 0 without a network: where the sun alone is decoded, or nothing.
    pub hidden: usize,
    pub fits_half: bool,
}

impl Full {
    /// Of what a job says of the sun alone; of a blank one: black.
    pub(crate) fn without_network(job: Job) -> Self {
        Full { job, bias: Vec::new(), hidden: 0, fits_half: true }
    }
}

impl Placed<'_> {
    /// The tile's job at a time, made of a blank one; `None` if it is black. `sun`: within the interval that
    /// is held.
    pub(crate) fn job(
        &self,
        timeline: &Timeline,
        point: &TimePoint,
        lights: Lights,
        sun: Option<&SunAt>,
        blank: Job,
    ) -> Option<Full> {
        let mut job = blank;
        let maps = self.maps.filter(|_| lights != Lights::Sun);
        let maps = maps.and_then(|maps| Some((maps, maps.job(self.site, timeline, point, &mut job)?)));
        let seen = self.seen.zip(self.held).zip(sun);
        let is_sunlit = seen.is_some_and(|((seen, held), sun)| seen.job(self.site, held, sun, &mut job));
        match maps {
            Some((maps, bias)) => {
                Some(Full { job, bias, hidden: maps.shape().hidden, fits_half: maps.fits_half })
            }
            None => is_sunlit.then(|| Full::without_network(job)),
        }
    }
}

/// 16-bit floats, two a word.
fn halves(values: [u16; 4]) -> [u32; 2] {
    let [a, b, c, d] = values.map(u32::from);
    [a | b << 16, c | d << 16]
}

/// Texels of two bytes, two a word.
fn pairs(texels: &[[u8; 2]]) -> impl Iterator<Item = u32> {
    texels.chunks(2).map(|two| {
        let [a, b] = [0, 1].map(|i| two.get(i).map_or(0, |texel| u32::from(u16::from_le_bytes(*texel))));
        a | b << 16
    })
}

impl Maps {
    /// Puts into its part of the resident buffer, still empty, what a tile has beside BC7 blocks.
    pub(crate) fn new(mut params: TileParams, resident: &mut Vec<u32>) -> Self {
        weights_of(&params, resident);
        let mut plane = |texels: &[[u8; 2]]| {
            let at = 2 * resident.len() as u32;
            resident.extend(pairs(texels));
            at
        };
        let (ut, vt) = (plane(&params.f_ut), plane(&params.f_vt));
        let fits_half = largest(&params) < HALF_MAX;
        (params.f_uv, params.f_uvt, params.f_ut, params.f_vt) = Default::default();
        Maps { params, ut, vt, fits_half }
    }

    /// The sizes of its maps.
    pub(crate) fn shape(&self) -> &Shape {
        &self.params.shape
    }

    /// The last light group that has a gate.
    pub(crate) fn last_gate(&self) -> Option<u16> {
        self.params.gates.last().copied()
    }

    /// Number of knots that it tells of.
    pub(crate) fn knots(&self) -> usize {
        self.params.knots.len()
    }

    /// Fills in what a job says of the maps at a time, and gives the biases of the first layer; `None` if
    /// they are black.
    fn job(&self, site: &Site, timeline: &Timeline, point: &TimePoint, job: &mut Job) -> Option<Vec<f32>> {
        let (shape, has) = (&self.params.shape, &self.params.shape.contents);
        let inputs = Inputs::at(&self.params, timeline, point);
        if inputs.means == [0.0; 3] {
            return None;
        }
        job.has |= HAS_MAPS;
        job.weights = site.resident;
        job.mean[..3].copy_from_slice(&inputs.means);
        let spot = |map: usize| {
            let [x, y, layer] = site.maps[map];
            [x, y, layer, 0]
        };
        if has.uv {
            job.has |= HAS_UV;
            job.uv = spot(0);
        }
        if has.uvt > 0 {
            let (first, second, share) = along_tau(inputs.tau, shape.uvt[2]);
            let slice = |i: usize| spot(usize::from(has.uv) + i);
            (job.first, job.second, job.share_of_slice) = (slice(first), slice(second), share);
            job.uvt = [shape.uvt[0] as u32, shape.uvt[1] as u32];
            job.has |= HAS_UVT;
        }
        if has.ut || has.vt {
            let (first, second, share) = along_tau(inputs.tau, shape.rows);
            let rows = |at: u32, side: usize| {
                [first, second].map(|row| 2 * site.resident + at + (row * side) as u32)
            };
            (job.ut, job.vt, job.share_of_row) = (rows(self.ut, shape.ut), rows(self.vt, shape.vt), share);
            job.sides = [shape.ut as u32, shape.vt as u32];
            job.has |= if has.ut { HAS_UT } else { 0 } | if has.vt { HAS_VT } else { 0 };
        }
        Some(self.bias(&inputs.gamma, &timeline.states[point.a]))
    }

    /// b₁ with γ and the gates, which are the same for all texels.
    fn bias(&self, of_gamma: &[f32; 4], state: &[bool]) -> Vec<f32> {
        let (shape, mlp) = (&self.params.shape, &self.params.mlp);
        let (inputs, [.., gamma, gates]) = (shape.inputs(), shape.columns());
        let given: Vec<f32> =
            of_gamma[..gamma.len()].iter().copied().chain(self.params.gate_inputs(state)).collect();
        let unit = |j: usize| {
            let row = &mlp[j * inputs..][gamma.start..gates.end];
            let of_time: f32 = row.iter().zip(&given).map(|(w, g)| w.to_f32() * g).sum();
            mlp[shape.hidden * inputs + j].to_f32() + of_time
        };
        (0..shape.hidden).map(unit).collect()
    }
}

/// A tile's weights as matrices of four inputs to four outputs, and its biases; 0 for what the tile does not
/// have.
fn weights_of(params: &TileParams, out: &mut Vec<u32>) {
    let (shape, hidden) = (&params.shape, params.shape.hidden);
    let (inputs, columns, start) = (shape.inputs(), shape.columns(), out.len());
    let [uvt, uv, ut, vt, ..] = &columns;
    let (w2, b2) = (hidden * inputs + hidden, hidden * inputs + hidden + hidden * hidden);
    let (w3, b3) = (b2 + hidden, b2 + hidden + 3 * hidden);
    let at = |i: usize| params.mlp[i].0;
    // The four inputs of a group, by their columns of W₁.
    let four = |range: &std::ops::Range<usize>| [0, 1, 2, 3].map(|c| range.clone().nth(c));
    let planes = [ut.clone().next(), ut.clone().nth(1), vt.clone().next(), vt.clone().nth(1)];
    let mut matrix = |column: &dyn Fn(usize) -> [u16; 4]| (0..4).for_each(|c| out.extend(halves(column(c))));
    for group in [four(uvt), four(uv), planes] {
        for j in (0..hidden).step_by(4) {
            matrix(&|c| [0, 1, 2, 3].map(|r| group[c].map_or(0, |input| at((j + r) * inputs + input))));
        }
    }
    for j in (0..hidden).step_by(4) {
        for k in (0..hidden).step_by(4) {
            matrix(&|c| [0, 1, 2, 3].map(|r| at(w2 + (j + r) * hidden + k + c)));
        }
    }
    for k in (0..hidden).step_by(4) {
        matrix(&|c| [0, 1, 2, 3].map(|r| if r < 3 { at(w3 + r * hidden + k + c) } else { 0 }));
    }
    for j in (0..hidden).step_by(4) {
        out.extend(halves([0, 1, 2, 3].map(|r| at(b2 + j + r))));
    }
    out.extend(halves([at(b3), at(b3 + 1), at(b3 + 2), 0]));
    debug_assert_eq!(out.len() - start, shader::words(hidden));
}

/// A bound of all that a tile's network sums up, whatever its maps hold.
fn largest(params: &TileParams) -> f32 {
    let shape = &params.shape;
    let mlp: Vec<f32> = params.mlp.iter().map(|w| w.to_f32().abs()).collect();
    let [w1, b1, w2, b2, w3, b3] = shape.split_mlp(&mlp);
    let layer = |weights: &[f32], biases: &[f32], inputs: &[f32]| -> Vec<f32> {
        let row = |j: usize| weights[j * inputs.len()..][..inputs.len()].iter().zip(inputs);
        let sum = |j: usize| biases[j] + row(j).map(|(w, x)| w * x).sum::<f32>();
        (0..biases.len()).map(sum).collect()
    };
    // Features are within ±3/2, γ and gates within ±1; the activation makes nothing larger.
    let h1 = layer(w1, b1, &vec![1.5; shape.inputs()]);
    let h2 = layer(w2, b2, &h1);
    let y = layer(w3, b3, &h2);
    [h1, h2, y].concat().into_iter().fold(0.0, f32::max)
}

/// The job of a tile that has nothing yet: its size, which texels are written, and where.
///
/// # Errors
/// [`Error::Bundle`](crate::Error::Bundle) for a place that the bundle does not have.
pub(crate) fn blank(bundle: &Bundle, request: Request, exposure: f32) -> crate::Result<Job> {
    let Request { place, to, with_border } = request;
    // A place that the bundle does not have is refused here.
    bundle.knots(place)?;
    let grid = &bundle.header.pages[place.page];
    let (width, height) = grid.stored(place.column, place.row);
    let (own_width, own_height) = grid.payload(place.column, place.row);
    let border = if with_border { 0 } else { BORDER };
    let rim = 2 * (BORDER - border);
    let own = [border, border, border + own_width + rim, border + own_height + rim].map(|x| x as u32);
    let border = border as i32;
    let mut job = Job { size: [width as u32, height as u32], own, ..Job::default() };
    job.to = to.map(|at| at - border);
    job.mean[3] = exposure;
    Ok(job)
}
