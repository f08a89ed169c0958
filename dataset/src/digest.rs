//! BLAKE3 digests: of files in the manifest, of the light that a bundle was made from.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::io::{self, Read};
use std::str::FromStr;

/// Characters of a digest as text.
const DIGITS: usize = 64;

/// A BLAKE3 digest. As text, also in JSON, 64 lower-case hexadecimal digits; any other text is an error where
/// it is read.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest of some bytes.
    pub fn of(bytes: &[u8]) -> Self {
        blake3::hash(bytes).into()
    }

    /// The digest of what is left to read, and its length.
    ///
    /// # Errors
    /// Those of reading.
    pub fn read(source: impl Read) -> io::Result<(Self, u64)> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(source)?;
        Ok((hasher.finalize().into(), hasher.count()))
    }

    /// The first hexadecimal digits.
    ///
    /// # Panics
    /// If more than 64 are asked for.
    pub fn first(&self, digits: usize) -> String {
        self.to_string()[..digits].to_owned()
    }
}

impl From<blake3::Hash> for Digest {
    fn from(hash: blake3::Hash) -> Self {
        Digest(hash.into())
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from(self.0).to_hex())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for Digest {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_hex = |digit: u8| matches!(digit, b'0'..=b'9' | b'a'..=b'f');
        let hash = blake3::Hash::from_hex(text).ok().filter(|_| text.bytes().all(is_hex));
        hash.map(Digest::from)
            .ok_or_else(|| format!("digest {text:?}; expected {DIGITS} lower-case hexadecimal digits"))
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_is_64_digits_and_nothing_else_is() {
        let digest = Digest::of(b"light");
        let text = digest.to_string();
        assert_eq!((text.parse(), text.len()), (Ok(digest), DIGITS));
        assert_eq!(serde_json::to_string(&digest).unwrap(), format!("{text:?}"));
        assert_eq!(Digest::read(&b"light"[..]).unwrap(), (digest, 5));
        assert_eq!(text.strip_prefix(&digest.first(12)).map(str::len), Some(52));
        for wrong in ["", "00", &text[1..], &format!("{text}0"), &text.to_uppercase(), &"é".repeat(32)] {
            let error = serde_json::from_str::<Digest>(&format!("{wrong:?}")).unwrap_err().to_string();
            assert!(error.contains("expected 64 lower-case hexadecimal digits"), "{wrong}: {error}");
        }
    }
}
