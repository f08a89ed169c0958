//! Stiff and extreme cases, each with a stated expectation; `compressor/NUMERICS.md` is their table.

mod basis;
mod case;
mod levels;
mod pages;
mod times;
