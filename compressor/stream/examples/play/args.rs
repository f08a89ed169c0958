//! What was typed, and the scenarios.

use clap::{Parser, ValueEnum};
use std::path::PathBuf;

/// Plays a bundle by a stream under a budget, headless: frames as PNG, `play.json` with what was measured, and `play.html` with plots.
#[derive(Debug, Parser)]
#[command(after_help = "Examples:
  play dataset/city                                  walk through the city, a minute of its day per second
  play dataset/city --scenario all --copies 53       all scenarios over 53 copies of it, some 4100 tiles
  play dataset/city --camera pan --clock 6..22/120s  turn around while a day passes in two minutes")]
pub struct Args {
    /// The dataset: its bundle (NAME.ndgi, and levels NAME.1.ndgi … beside it), geometry and masks
    pub dataset: PathBuf,
    /// The bundle, where it is another file than DATASET/NAME.ndgi
    #[arg(long)]
    pub bundle: Option<PathBuf>,
    /// What is played; the options below replace parts of it
    #[arg(long, value_enum, default_value = "walk")]
    pub scenario: Scenario,
    /// How the camera moves
    #[arg(long, value_enum)]
    pub camera: Option<Motion>,
    /// Hours of the day, and the seconds in which they pass, such as 6..22/120s
    #[arg(long, value_parser = clock)]
    pub clock: Option<Clock>,
    /// Seconds played, at 30 frames a second
    #[arg(long, default_value_t = 10.0)]
    pub seconds: f64,
    /// Copies of the scene, side by side, each with pages and tiles of its own
    #[arg(long, default_value_t = 1)]
    pub copies: usize,
    /// Decoded tiles that the cache holds
    #[arg(long)]
    pub slots: Option<u32>,
    /// The disk: milliseconds until a read begins to arrive, and megabytes a second
    #[arg(long, value_parser = disk)]
    pub disk: Option<Disk>,
    /// The frame's size
    #[arg(long, value_parser = size, default_value = "640x360")]
    pub size: [u32; 2],
    /// Every how many frames a picture is written and compared with the fully decoded pages; 0 for none
    #[arg(long, default_value_t = 10)]
    pub every: usize,
    /// The folder that is written
    #[arg(long, default_value = "play")]
    pub out: PathBuf,
}

/// What is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scenario {
    /// Walking, a minute of scene time a second
    Walk,
    /// Turning around on the spot
    Pan,
    /// Elsewhere every two seconds
    Teleport,
    /// Walking with a cache of 64 tiles
    SmallCache,
    /// Walking while an hour passes per second
    TimeLapse,
    /// Walking while the lamps of the evening go on
    Switch,
    /// Walking with a disk of 100 ms and 2 MB a second
    SlowDisk,
    /// Standing while the night passes in ten seconds
    Night,
    /// All of them, one after another
    All,
}

/// How the camera moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Motion {
    Stand,
    Walk,
    Pan,
    Teleport,
}

/// Hours that pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    pub from: f64,
    /// Hours per second.
    pub pace: f64,
}

/// How fast the disk is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    pub latency_secs: f64,
    pub bytes_per_second: f64,
}

/// A scenario with all its parts.
#[derive(Clone, Copy, Debug)]
pub struct Play {
    pub name: &'static str,
    pub camera: Motion,
    pub clock: Clock,
    pub slots: u32,
    pub disk: Disk,
}

impl Args {
    /// What is to be played. `switch`: an hour at which lamps go on.
    pub fn plays(&self, switch: Option<f64>) -> Vec<Play> {
        let of = |scenario| self.play(scenario, switch);
        match self.scenario {
            Scenario::All => Scenario::value_variants()[..8].iter().map(|scenario| of(*scenario)).collect(),
            scenario => vec![of(scenario)],
        }
    }

    fn play(&self, scenario: Scenario, switch: Option<f64>) -> Play {
        let minute = Clock { from: 10.0, pace: 1.0 / 60.0 };
        let ssd = Disk { latency_secs: 0.002, bytes_per_second: 500e6 };
        let base = Play { name: "walk", camera: Motion::Walk, clock: minute, slots: 256, disk: ssd };
        let play = match scenario {
            Scenario::Walk | Scenario::All => base,
            Scenario::Pan => Play { name: "pan", camera: Motion::Pan, ..base },
            Scenario::Teleport => Play { name: "teleport", camera: Motion::Teleport, ..base },
            Scenario::SmallCache => Play { name: "small-cache", slots: 64, ..base },
            Scenario::TimeLapse => Play { name: "time-lapse", clock: Clock { from: 6.0, pace: 1.0 }, ..base },
            Scenario::Switch => {
                // The lamps go on in the middle.
                let (at, pace) = (switch.unwrap_or(20.0), 1.0 / 600.0);
                Play { name: "switch", clock: Clock { from: at - pace * self.seconds / 2.0, pace }, ..base }
            }
            Scenario::SlowDisk => {
                Play { name: "slow-disk", disk: Disk { latency_secs: 0.1, bytes_per_second: 2e6 }, ..base }
            }
            Scenario::Night => {
                Play { name: "night", camera: Motion::Stand, clock: Clock { from: 22.0, pace: 0.7 }, ..base }
            }
        };
        Play {
            camera: self.camera.unwrap_or(play.camera),
            clock: self.clock.unwrap_or(play.clock),
            slots: self.slots.unwrap_or(play.slots),
            disk: self.disk.unwrap_or(play.disk),
            ..play
        }
    }
}

fn clock(text: &str) -> Result<Clock, String> {
    let parse = || {
        let (hours, seconds) = text.split_once('/')?;
        let (from, to) = hours.split_once("..")?;
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
        let (from, to, seconds) = (number(from)?, number(to)?, number(seconds.strip_suffix('s')?)?);
        (seconds > 0.0).then_some(Clock { from, pace: (to - from) / seconds })
    };
    parse().ok_or_else(|| format!("{text}; expected hours and seconds, such as 6..22/120s"))
}

fn disk(text: &str) -> Result<Disk, String> {
    let parse = || {
        let (latency, speed) = text.split_once(',')?;
        let (latency, speed) = (latency.parse::<f64>().ok()?, speed.parse::<f64>().ok()?);
        (latency >= 0.0 && speed > 0.0)
            .then_some(Disk { latency_secs: latency / 1000.0, bytes_per_second: speed * 1e6 })
    };
    parse().ok_or_else(|| format!("{text}; expected milliseconds and megabytes a second, such as 100,2"))
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = || {
        let (width, height) = text.split_once('x')?;
        let size = [width.parse().ok()?, height.parse().ok()?];
        size.iter().all(|side| (8..=4096).contains(side)).then_some(size)
    };
    parse().ok_or_else(|| format!("{text}; expected a size from 8x8 to 4096x4096, such as 640x360"))
}
