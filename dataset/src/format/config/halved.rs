//! The manifest key of a halved dataset that names its source.

use super::Config;
use serde::{Deserialize, Serialize};

/// The source of a dataset made by `dataset halve`: the key `halved` of [`Config::settings`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Halved {
    /// How often the resolution was halved since: the level, from 1.
    pub times: u32,
    /// [`Config::inputs`] of the dataset of full resolution.
    pub inputs: String,
    /// [`Config::digest_of_light`] of the dataset of full resolution.
    pub light: String,
}

/// The key in the settings.
const KEY: &str = "halved";

impl Config {
    /// The source of a halved dataset; `None` at full resolution.
    pub fn halved(&self) -> Option<Halved> {
        serde_json::from_value(self.settings.get(KEY)?.clone()).ok()
    }

    /// The key of a dataset that is made by halving this one.
    pub(crate) fn halved_again(&self) -> Halved {
        match self.halved() {
            Some(before) => Halved { times: before.times.saturating_add(1), ..before },
            None => Halved { times: 1, inputs: self.inputs.clone(), light: self.digest_of_light() },
        }
    }

    /// Adds the source to the settings. Settings that are not an object are moved to the key `settings`.
    pub(crate) fn set_halved(&mut self, halved: &Halved) {
        if !self.settings.is_object() {
            self.settings = serde_json::json!({ "settings": self.settings });
        }
        self.settings[KEY] = serde_json::json!(halved);
    }
}
