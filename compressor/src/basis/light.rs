//! The light of one source of a tile, as numbers that a linear basis can hold: by frame and component, the
//! square root of light over its mean.

use crate::planes::components;
use crate::tile::Coverage;

/// One light source of a tile.
#[derive(Clone, Copy, Debug)]
pub struct SourceLight<'a> {
    /// 0 for daylight, g + 1 for light group g.
    pub source: u16,
    /// The frames that it lights, row by row of texels; those that are the same may be the same slice.
    pub frames: &'a [&'a [[f32; 3]]],
    /// Means of the frames as they are stored.
    pub means: &'a [[f32; 3]],
    /// How much each of the frames counts: the square root of what the square of its error is multiplied by.
    pub weights: &'a [f64],
}

/// The texels that count: the valid ones. (Those around charts, which filtering reads, are filled: at full
/// precision they would cost a sixth of the bytes.)
pub(super) fn counted(coverage: &[Coverage]) -> Vec<usize> {
    (0..coverage.len()).filter(|&i| coverage[i] == Coverage::Valid).collect()
}

/// Luminance and colour differences of a frame's texels, in the domain of planes.
pub(super) fn transformed(light: &[[f32; 3]], mean: [f32; 3], texels: &[usize]) -> [Vec<f32>; 3] {
    let mut out = [const { Vec::new() }; 3];
    out.iter_mut().for_each(|component| component.reserve_exact(texels.len()));
    for &i in texels {
        let value = |c: usize| (f64::from(light[i][c]) / f64::from(mean[c])).sqrt();
        let mut rgb = [0, 1, 2].map(|c| if mean[c] > 0.0 { value(c) } else { 0.0 });
        // A colour without light has that of the others, so that there is no difference to store.
        let lit = (0..3).filter(|c| mean[*c] > 0.0).count().max(1) as f64;
        let other = rgb.iter().sum::<f64>() / lit;
        (0..3).filter(|c| mean[*c] <= 0.0).for_each(|c| rgb[c] = other);
        for (component, value) in out.iter_mut().zip(components(rgb)) {
            component.push(value as f32);
        }
    }
    out
}
