//! Decoding on a device, on whatever adapter there is; with `NDGI_GPU` set there has to be one.

mod common;
mod equal;
mod pool;
