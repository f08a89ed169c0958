//! A layer at one texel: its light, and what is known of its error; and how that is stored.

use crate::Rgb;
use bytemuck::{Pod, Zeroable};
use half::bf16;

/// The layers a frame is made of, and what each is multiplied by.
pub type Parts = Vec<(usize, Rgb)>;

/// A layer at one texel, or a sum of layers: all of it adds up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Value {
    /// Mean irradiance.
    pub mean: Rgb,
    /// Half the difference of the halves as they were traced: an estimate of the standard error of what was
    /// traced, with a sign.
    pub noise: Rgb,
    /// What a filter has added.
    pub shift: Rgb,
    /// Half the difference of the halves after filtering: an estimate of the standard error that is left,
    /// bias apart.
    pub residual: Rgb,
}

impl Value {
    /// As traced, by half the difference of the halves.
    pub fn traced(mean: Rgb, noise: Rgb) -> Value {
        Value { mean, noise, shift: Rgb::ZERO, residual: noise }
    }

    /// The sum.
    pub fn plus(self, other: Value) -> Value {
        Value {
            mean: self.mean + other.mean,
            noise: self.noise + other.noise,
            shift: self.shift + other.shift,
            residual: self.residual + other.residual,
        }
    }

    /// Times a colour.
    pub fn times(self, scale: Rgb) -> Value {
        Value {
            mean: self.mean * scale,
            noise: self.noise * scale,
            shift: self.shift * scale,
            residual: self.residual * scale,
        }
    }

    /// Of the squared error, summed over the channels, an unbiased estimate of the part that is chance.
    pub fn variance(&self) -> f64 {
        self.residual.as_dvec3().length_squared()
    }

    /// An unbiased estimate of the filter's squared bias, summed over the channels. It may be negative at a
    /// texel, and is 0 where nothing was filtered.
    pub fn squared_bias(&self) -> f64 {
        let lost = (self.noise - self.residual).as_dvec3();
        self.shift.as_dvec3().length_squared() - lost.length_squared()
    }
}

/// A part of a layer as traced, as stored.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct StoredValue {
    mean: [f32; 3],
    noise: [bf16; 3],
    zero: u16,
}

impl StoredValue {
    /// From the means of both halves.
    pub(crate) fn new(a: Rgb, b: Rgb) -> Self {
        let noise = ((a - b) * 0.5).to_array().map(bf16::from_f32);
        StoredValue { mean: ((a + b) * 0.5).to_array(), noise, zero: 0 }
    }

    /// The value.
    pub(crate) fn value(&self) -> Value {
        Value::traced(Rgb::from_array(self.mean), Rgb::from_array(self.noise.map(bf16::to_f32)))
    }
}

/// A part of a layer after a filter, as stored. What was traced stands in the layer's own file.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Filtered {
    mean: [f32; 3],
    shift: [bf16; 3],
    residual: [bf16; 3],
}

impl Filtered {
    /// Of a value.
    pub(crate) fn new(value: &Value) -> Self {
        let small = |v: Rgb| v.to_array().map(bf16::from_f32);
        Filtered { mean: value.mean.to_array(), shift: small(value.shift), residual: small(value.residual) }
    }

    /// The value, with what was traced there.
    pub(crate) fn value(&self, traced: &Value) -> Value {
        let wide = |v: [bf16; 3]| Rgb::from_array(v.map(bf16::to_f32));
        Value {
            mean: Rgb::from_array(self.mean),
            noise: traced.noise,
            shift: wide(self.shift),
            residual: wide(self.residual),
        }
    }
}
