//! Values as JSON bytes, with an error where a value cannot be one.

use crate::{Error, Result};
use serde::Serialize;

/// `value` as indented JSON; `what` names it in the error.
pub(crate) fn bytes<T: Serialize>(value: &T, what: &str) -> Result<Vec<u8>> {
    serde_json::to_vec_pretty(value).map_err(|e| Error::invalid(what, e))
}
