//! Which library finds the hits.

use crate::Error;
use std::fmt;
use std::str::FromStr;

/// What builds the hierarchy and traverses it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// Our own traversal of a hierarchy built by obvhs. Always there.
    #[default]
    Obvhs,
    /// Intel's Embree 4, in builds with the feature `embree`.
    Embree,
}

impl Backend {
    /// All of them, the default first.
    pub const ALL: [Backend; 2] = [Backend::Obvhs, Backend::Embree];

    /// Whether this build has it.
    pub fn is_built(self) -> bool {
        self == Backend::Obvhs || cfg!(feature = "embree")
    }

    /// Those that this build has.
    pub fn built() -> impl Iterator<Item = Backend> {
        Self::ALL.into_iter().filter(|b| b.is_built())
    }

    /// Checks that this build has it.
    ///
    /// # Errors
    /// `Unsupported` where it does not.
    pub fn expect_built(self) -> crate::Result<()> {
        if self.is_built() { Ok(()) } else { Err(self.missing()) }
    }

    fn missing(self) -> Error {
        Error::unsupported(
            format!("backend {self}"),
            "not in this build; run baker/third_party/fetch-embree.sh (or install libembree-dev 4.3 or newer), then \
             build with `cargo build --release -p bake --features embree`",
        )
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Backend::Obvhs => "obvhs",
            Backend::Embree => "embree",
        })
    }
}

impl FromStr for Backend {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        Self::ALL
            .into_iter()
            .find(|b| b.to_string() == text)
            .ok_or_else(|| Error::invalid("backend", format!("is \"{text}\"; expected obvhs or embree")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_others_are_refused() {
        for backend in Backend::ALL {
            assert_eq!(backend.to_string().parse::<Backend>().unwrap(), backend);
        }
        let error = "optix".parse::<Backend>().unwrap_err().to_string();
        assert!(error.contains("optix") && error.contains("obvhs"), "{error}");
    }
}
