//! The functions of `include/ndgi.h`.

#![allow(unsafe_code, reason = "pointers of C")]

use crate::at::Tile;
use crate::bundle::Bundle;
use crate::decode::Lights;
use crate::grid::Place;
use crate::{Error, Result};
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::null_mut;

thread_local! {
    static ERROR: RefCell<CString> = RefCell::default();
}

fn keep(error: &str) {
    // A zero byte would end the text.
    let text = CString::new(error.replace('\0', " ")).unwrap_or_default();
    ERROR.with(|kept| *kept.borrow_mut() = text);
}

/// What some work gives; with an error, or a panic, `None`, and the error is kept.
fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Option<T> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => Some(value),
        Ok(Err(error)) => {
            keep(&error.to_string());
            None
        }
        Err(_) => {
            keep("a fault inside ndgi");
            None
        }
    }
}

fn boxed<T>(value: Option<T>) -> *mut T {
    value.map_or(null_mut(), |value| Box::into_raw(Box::new(value)))
}

/// What went wrong last on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn ndgi_error() -> *const c_char {
    ERROR.with(|kept| kept.borrow().as_ptr())
}

/// Opens a bundle file.
///
/// # Safety
/// `path` is a text that ends in 0.
#[cfg(all(feature = "file", any(unix, windows)))]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_open(path: *const c_char) -> *mut Bundle {
    boxed(guarded(|| {
        if path.is_null() {
            return Err(Error::invalid("path", "is null"));
        }
        // SAFETY: as the caller says.
        let path = unsafe { CStr::from_ptr(path) };
        let path = path.to_str().map_err(|_| Error::invalid("path", "is not UTF-8"))?;
        Bundle::open(path.as_ref())
    }))
}

/// A bundle in memory, which is copied.
///
/// # Safety
/// `bytes` are `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_open_bytes(bytes: *const u8, length: usize) -> *mut Bundle {
    boxed(guarded(|| {
        if bytes.is_null() {
            return Err(Error::invalid("bytes", "are null"));
        }
        // SAFETY: as the caller says.
        Bundle::from_bytes(unsafe { std::slice::from_raw_parts(bytes, length) }.to_vec())
    }))
}

/// Frees a bundle; null is nothing.
///
/// # Safety
/// It came from here and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_close(bundle: *mut Bundle) {
    if !bundle.is_null() {
        // SAFETY: as the caller says.
        drop(unsafe { Box::from_raw(bundle) });
    }
}

/// Width and height in texels of a page; false where there is none.
///
/// # Safety
/// The bundle is open; `size` has two places.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_page_size(bundle: *const Bundle, page: usize, size: *mut usize) -> bool {
    guarded(|| {
        // SAFETY: as the caller says.
        let bundle = unsafe { bundle.as_ref() }.ok_or_else(|| Error::invalid("bundle", "is null"))?;
        let grid = bundle.grid(page)?;
        // SAFETY: as the caller says.
        unsafe {
            size.write(grid.width);
            size.add(1).write(grid.height);
        }
        Ok(())
    })
    .is_some()
}

/// A tile at an hour, ready. `lights`: 0 all, 1 without the sun's own stream, 2 that alone.
///
/// # Safety
/// The bundle is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_tile(
    bundle: *const Bundle,
    hour: f64,
    lights: i32,
    page: usize,
    column: usize,
    row: usize,
) -> *mut Tile {
    boxed(guarded(|| {
        // SAFETY: as the caller says.
        let bundle = unsafe { bundle.as_ref() }.ok_or_else(|| Error::invalid("bundle", "is null"))?;
        let lights = match lights {
            0 => Lights::All,
            1 => Lights::Baked,
            2 => Lights::Sun,
            other => return Err(Error::invalid("lights", format!("{other}; expected 0, 1 or 2"))),
        };
        bundle.at(hour)?.only(lights).tile(Place { page, column, row })
    }))
}

/// Frees a tile; null is nothing.
///
/// # Safety
/// It came from here and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_tile_free(tile: *mut Tile) {
    if !tile.is_null() {
        // SAFETY: as the caller says.
        drop(unsafe { Box::from_raw(tile) });
    }
}

/// Width and height in texels of a tile.
///
/// # Safety
/// The tile is not freed; `size` has two places.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_tile_size(tile: *const Tile, size: *mut usize) {
    // SAFETY: as the caller says.
    unsafe {
        let (width, height) = tile.as_ref().map_or((0, 0), |tile| (tile.width(), tile.height()));
        size.write(width);
        size.add(1).write(height);
    }
}

/// Light bilinear between texel centres, which are at halves.
///
/// # Safety
/// The tile is not freed; `rgb` has three places.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_tile_sample(tile: *const Tile, x: f32, y: f32, rgb: *mut [f32; 3]) {
    // SAFETY: as the caller says.
    unsafe { rgb.write(tile.as_ref().map_or([0.0; 3], |tile| tile.sample(x, y))) }
}

/// All texels as RGB of 32-bit floats; false where `count`, of texels, is not the tile's.
///
/// # Safety
/// The tile is not freed; `texels` has places for `count` texels.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_tile_decode(tile: *const Tile, texels: *mut [f32; 3], count: usize) -> bool {
    // SAFETY: as the caller says.
    unsafe { decode(tile, texels, count, |tile, out| tile.decode_into(out)) }
}

/// The same as RGBA of 16-bit floats, light times `exposure`.
///
/// # Safety
/// As [`ndgi_tile_decode`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ndgi_tile_decode_rgba16f(
    tile: *const Tile,
    exposure: f32,
    texels: *mut [u16; 4],
    count: usize,
) -> bool {
    // SAFETY: as the caller says.
    unsafe { decode(tile, texels, count, |tile, out| tile.decode_rgba16f(exposure, out)) }
}

unsafe fn decode<T: Default + Copy>(
    tile: *const Tile,
    texels: *mut T,
    count: usize,
    work: impl FnOnce(&Tile, &mut [T]),
) -> bool {
    guarded(|| {
        // SAFETY: as the caller says.
        let tile = unsafe { tile.as_ref() }.ok_or_else(|| Error::invalid("tile", "is null"))?;
        let expected = tile.width() * tile.height();
        if count != expected || texels.is_null() {
            return Err(Error::invalid("texels", format!("{count} elements; expected {expected}")));
        }
        // What the caller's memory holds may be no number yet.
        let mut out = vec![T::default(); count];
        work(tile, &mut out);
        // SAFETY: as the caller says.
        unsafe { std::ptr::copy_nonoverlapping(out.as_ptr(), texels, count) };
        Ok(())
    })
    .is_some()
}
