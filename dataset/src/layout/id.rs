//! What layouts call their lightmaps.

use crate::host::files::is_component;
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// The id of a lightmap as its configuration has it: the number 1 or the text "1". Both are the same id,
/// which is part of file names.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Id {
    /// A whole number.
    Number(i64),
    /// A text.
    Text(String),
}

/// Most bytes of a text.
const MAX_BYTES: usize = 64;
/// What an id can be.
const EXPECTED: &str = "a whole number, or a text of 1 to 64 bytes that can be part of a file name";

impl fmt::Display for Id {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Id::Number(number) => number.fmt(out),
            Id::Text(text) => text.fmt(out),
        }
    }
}

impl<'de> Deserialize<'de> for Id {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl Visitor<'_> for Reader {
            type Value = Id;
            fn expecting(&self, out: &mut fmt::Formatter) -> fmt::Result {
                out.write_str(EXPECTED)
            }
            fn visit_i64<E: Error>(self, number: i64) -> Result<Id, E> {
                Ok(Id::Number(number))
            }
            fn visit_u64<E: Error>(self, number: u64) -> Result<Id, E> {
                let wrong = |_| E::custom(format!("id {number}; expected at most {}", i64::MAX));
                i64::try_from(number).map(Id::Number).map_err(wrong)
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Id, E> {
                match is_component(text) && text.len() <= MAX_BYTES && !text.contains(char::is_control) {
                    true => Ok(Id::Text(text.to_owned())),
                    false => Err(E::custom(format!("id {text:?}; expected {EXPECTED}"))),
                }
            }
        }
        deserializer.deserialize_any(Reader)
    }
}
