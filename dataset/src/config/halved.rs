//! What the manifest of a dataset of half the resolution says of the dataset that it was made from.

use super::Config;
use serde::{Deserialize, Serialize};

/// Where a dataset of `dataset halve` comes from: the key `halved` of [`Config::settings`].
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
    /// Where a halved dataset comes from; `None` for one of full resolution.
    pub fn halved(&self) -> Option<Halved> {
        serde_json::from_value(self.settings.get(KEY)?.clone()).ok()
    }

    /// What a dataset says that is made from this one by halving it.
    pub(crate) fn halved_again(&self) -> Halved {
        match self.halved() {
            Some(before) => Halved { times: before.times.saturating_add(1), ..before },
            None => Halved { times: 1, inputs: self.inputs.clone(), light: self.digest_of_light() },
        }
    }

    /// Notes in the settings where the dataset comes from. Settings that are no object stand under the key `settings` then.
    pub(crate) fn set_halved(&mut self, halved: &Halved) {
        if !self.settings.is_object() {
            self.settings = serde_json::json!({ "settings": self.settings });
        }
        self.settings[KEY] = serde_json::json!(halved);
    }
}
