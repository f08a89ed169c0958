//! The command line, and the scenarios.

use clap::{Parser, ValueEnum};
use std::path::PathBuf;

/// Streams a dataset's bundle under a budget, headless. Writes frames as PNG, measurements as `play.json`,
/// and plots as `play.html`.
#[derive(Debug, Parser)]
#[command(after_help = "Examples:
  play dataset/city                                  walk through the city; a minute of its day passes per second
  play dataset/city --scenario all --copies 53       all scenarios over 53 copies of it, about 4100 tiles
  play dataset/city --camera pan --clock 6..22/120s --seconds 120
                                                     turn around while a day passes in two minutes")]
pub struct Args {
    /// The dataset: geometry, masks, and its bundle NAME.ndgi with the levels NAME.1.ndgi, NAME.2.ndgi …
    /// beside it
    pub dataset: PathBuf,
    /// The bundle, if it is not DATASET/NAME.ndgi
    #[arg(long)]
    pub bundle: Option<PathBuf>,
    /// The scenario; --camera, --clock, --slots and --disk replace parts of it
    #[arg(long, value_enum, default_value = "walk")]
    pub scenario: Scenario,
    /// How the camera moves
    #[arg(long, value_enum)]
    pub camera: Option<Motion>,
    /// First and last hour of the clock, and the seconds between them: 6..22/120s. How long is played is
    /// --seconds
    #[arg(long, value_parser = clock)]
    pub clock: Option<Clock>,
    /// Seconds played, at 30 frames a second; the first one is not measured
    #[arg(long, value_parser = seconds, default_value_t = 10.0)]
    pub seconds: f64,
    /// Copies of the scene, side by side, each with pages and tiles of its own
    #[arg(long, value_parser = copies, default_value_t = 1)]
    pub copies: usize,
    /// Decoded tiles that the cache holds
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub slots: Option<u32>,
    /// The simulated disk: latency in milliseconds, and megabytes a second, such as 100,2
    #[arg(long, value_parser = disk)]
    pub disk: Option<Disk>,
    /// The frame's size
    #[arg(long, value_parser = size, default_value = "640x360")]
    pub size: [u32; 2],
    /// Writes every N-th frame as a picture, and compares it with the fully decoded pages; 0 for none
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub every: usize,
    /// The output folder; files in it are overwritten
    #[arg(long, default_value = "play")]
    pub out: PathBuf,
}

/// A named scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scenario {
    /// Walking, a minute of scene time a second
    Walk,
    /// Turning around on the spot
    Pan,
    /// Jumping elsewhere every two seconds
    Teleport,
    /// Walking with a cache of 64 tiles
    SmallCache,
    /// Walking while an hour passes per second
    TimeLapse,
    /// Walking while the lamps of the evening go on
    Switch,
    /// Walking with a disk of 100 ms and 2 MB a second
    SlowDisk,
    /// Standing while the night passes, 42 minutes per second
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

/// A scenario with the command line's replacements.
#[derive(Clone, Copy, Debug)]
pub struct Play {
    pub name: &'static str,
    pub camera: Motion,
    pub clock: Clock,
    pub slots: u32,
    pub disk: Disk,
}

impl Args {
    /// The scenarios to play. `switch`: an hour at which lamps go on.
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
    parse().ok_or_else(|| "expected hours and seconds, such as 6..22/120s".to_owned())
}

fn disk(text: &str) -> Result<Disk, String> {
    let parse = || {
        let (latency, speed) = text.split_once(',')?;
        let (latency, speed) = (latency.parse::<f64>().ok()?, speed.parse::<f64>().ok()?);
        (latency >= 0.0 && speed > 0.0)
            .then_some(Disk { latency_secs: latency / 1000.0, bytes_per_second: speed * 1e6 })
    };
    parse().ok_or_else(|| "expected milliseconds and megabytes a second, such as 100,2".to_owned())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = || {
        let (width, height) = text.split_once('x')?;
        let size = [width.parse().ok()?, height.parse().ok()?];
        size.iter().all(|side| (8..=4096).contains(side)).then_some(size)
    };
    parse().ok_or_else(|| "expected a size from 8x8 to 4096x4096, such as 640x360".to_owned())
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|seconds| *seconds > 1.0 && *seconds <= 3600.0);
    number.ok_or_else(|| {
        "expected more than 1 second, because the first is not measured, and at most 3600".to_owned()
    })
}

fn copies(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|copies| (1..=4096).contains(copies));
    number.ok_or_else(|| "expected a number from 1 to 4096".to_owned())
}
