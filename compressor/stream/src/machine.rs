//! The state machine: tiles seen and reads completed go in, commands come out.
//!
//! A tile has two things: its *data* (absent, being read, arrived in memory, or held on the device), and its
//! *slot* with its decoded texels at some hour. A step takes the files of this folder in this order: `want`,
//! `arrive`, `load` (which also starts reads), `decode`, `show`.
//!
//! A *place* here is a numbered slot of `ndgi_gpu::Pool`, which holds a tile's features. A *slot* holds
//! decoded texels.

mod arrive;
mod decode;
mod load;
mod show;
mod want;

use crate::{Budgets, Now, Pyramid, Result, Tile};
use std::collections::BTreeMap;
use std::sync::Arc;

/// An interval of visibility: the stored times before and after an hour, as in `ndgi::at::SunAt::times`.
pub type Times = [usize; 2];

/// A tile that a view needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// The tile, at the level that the view needs.
    pub tile: Tile,
    /// The number of pixels that it covers.
    pub pixels: u32,
}

/// The answer to a [`Read`].
#[derive(Clone, Debug, PartialEq)]
pub struct Completion {
    /// The ticket of the read.
    pub ticket: u64,
    /// The outcome.
    pub answer: Answer,
}

/// The outcome of a read.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// The data is in memory.
    Arrived,
    /// The read failed. It is tried again, and reported after some failures ([`Budgets::retries`]), unless
    /// the failure is lasting, as for a damaged tile.
    Failed {
        /// Whether another try would fail too.
        is_lasting: bool,
        /// Why, as text.
        what: String,
    },
}

/// A command: bring data into memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// A unique number, which the [`Completion`] repeats.
    pub ticket: u64,
    /// The tile.
    pub tile: Tile,
    /// Whether the tile's features are read; otherwise only its interval of visibility is unpacked.
    pub features: bool,
    /// The interval of visibility to unpack, if any.
    pub times: Option<Times>,
}

/// A command: put data on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// The tile.
    pub tile: Tile,
    /// The place for its features (`ndgi_gpu::Pool`). If features are loaded, they replace what was there.
    pub place: u32,
    /// Whether the tile's features are loaded; otherwise only its interval of visibility is.
    pub features: bool,
    /// The interval of visibility to load, if any.
    pub times: Option<Times>,
}

/// A command: decode a tile at the step's hour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decode {
    /// The tile.
    pub tile: Tile,
    /// The place of its features.
    pub place: u32,
    /// The slot to write.
    pub slot: u32,
    /// Whether its maps are decoded.
    pub maps: bool,
    /// Whether its sun is decoded.
    pub sun: bool,
}

/// An entry of the page table: what is sampled for a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// The tile's mean: no tile that covers it is decoded, or it has no light at all.
    Mean,
    /// The slot of the tile itself, or of a coarser tile that covers it.
    Slot {
        /// The slot.
        slot: u32,
        /// The level of the tile in the slot.
        level: u8,
    },
}

/// A tile that cannot be read. Coarser tiles that cover it are shown instead.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// The tile.
    pub tile: Tile,
    /// Why, as text.
    pub what: String,
}

/// The commands of a step, to be carried out in the order of the fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Commands {
    /// Tiles whose data in memory is no longer needed.
    pub drops: Vec<Tile>,
    /// Places to empty.
    pub unloads: Vec<u32>,
    /// Data to load before this step decodes anything. It is decoded in the next step at the earliest; if the
    /// device has no room for it, call [`Stream::refuse`] before that step.
    pub loads: Vec<Load>,
    /// Reads to start, most urgent first: after the loads, because an interval may be unpacked from features
    /// that are only loaded now.
    pub reads: Vec<Read>,
    /// Tiles to decode before anything is sampled.
    pub decodes: Vec<Decode>,
    /// Tiles that lost their slots: for statistics.
    pub evictions: Vec<Tile>,
    /// Entries of the page table that have changed.
    pub table: Vec<(Tile, Entry)>,
    /// The number of levels, in fractions too, by which the view is to ask for coarser tiles. It rises when
    /// slots run short.
    pub mip_bias: f32,
    /// Tiles that cannot be read, each reported once.
    pub failures: Vec<Failure>,
}

/// Where a tile's data is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Data {
    #[default]
    Absent,
    /// Being read, after `tries` failures.
    Reading { ticket: u64, tries: u32 },
    /// The read failed; it is tried again from `step` on.
    Waiting { step: u64, tries: u32 },
    /// In memory, with an interval if it needs one.
    Arrived { times: Option<Times> },
    /// On the device since a step.
    Held { place: u32, since: u64 },
    /// It cannot be read.
    Failed,
}

/// The intervals of visibility of a tile on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Visible {
    /// The interval on the device.
    held: Option<Times>,
    /// The one that is being unpacked.
    asked: Option<(u64, Times)>,
    /// The one that is in memory.
    ready: Option<Times>,
}

/// A decoded tile.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    slot: u32,
    /// [`Pyramid::travelled`] when its maps were decoded.
    travelled: f32,
    /// The step at which its maps were decoded.
    step: u64,
    /// The hour at which its sun was decoded; `None` if that is black, or has to be decoded again.
    sun: Option<f64>,
    /// The step at which its sun was decoded.
    sun_step: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    data: Data,
    visible: Visible,
    shown: Option<Shown>,
    /// The last step at which it was wanted.
    wanted: u64,
    /// Its pixels at that step.
    pixels: u32,
    /// How often the device had no room for its features.
    refused: u32,
    /// Whether it was reported that it cannot be read.
    reported: bool,
}

/// Decides what is read, loaded, decoded and shown. See [`Stream::step`].
#[derive(Clone, Debug)]
pub struct Stream {
    pyramid: Arc<Pyramid>,
    budgets: Budgets,
    step: u64,
    tickets: u64,
    tiles: Vec<State>,
    /// The tile in each place, and in each slot.
    places: Vec<Option<Tile>>,
    slots: Vec<Option<Tile>>,
    /// Tiles that are being read, or have arrived.
    under_way: Vec<Tile>,
    /// Tiles of which an interval alone is being unpacked, by ticket.
    intervals: BTreeMap<u64, Tile>,
    /// Roots (tiles of the last level) that always keep their slots.
    pinned: Vec<Tile>,
    /// Tiles of the last feedbacks: their pixels, and how many feedbacks ago they were seen.
    seen: BTreeMap<Tile, (u32, u32)>,
    /// The tiles wanted now, and their pixels.
    wanted: BTreeMap<Tile, u32>,
    mip_bias: f32,
    table: Vec<Entry>,
    /// Tiles that got a slot or lost it in this step.
    altered: Vec<Tile>,
    /// The hour of the last step, and the light groups that were on.
    before: Option<(f64, Vec<bool>)>,
}

impl Stream {
    /// A stream in which nothing is read yet, and every tile shows its mean.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for budgets under which nothing could be shown.
    pub fn new(pyramid: Arc<Pyramid>, budgets: Budgets) -> Result<Self> {
        budgets.check()?;
        let is_lit = |tile: &Tile| !pyramid.facts(*tile).is_black();
        let roots: Vec<Tile> = pyramid.roots().filter(is_lit).collect();
        let pinned = if roots.len() <= budgets.slots as usize / 4 { roots } else { Vec::new() };
        Ok(Stream {
            step: 0,
            tickets: 0,
            tiles: vec![State::default(); pyramid.tiles()],
            places: vec![None; budgets.features as usize],
            slots: vec![None; budgets.slots as usize],
            under_way: Vec::new(),
            intervals: BTreeMap::new(),
            pinned,
            seen: BTreeMap::new(),
            wanted: BTreeMap::new(),
            mip_bias: 0.0,
            table: vec![Entry::Mean; pyramid.tiles()],
            altered: Vec::new(),
            before: None,
            pyramid,
            budgets,
        })
    }

    /// Makes the decisions of one frame. `seen` is the feedback that arrived since the last step, if any;
    /// `completions` are the answers to reads since then. The page table holds from the moment that the
    /// commands are carried out.
    ///
    /// # Errors
    /// [`crate::Error::Bundle`] for an hour that is not a finite number. Nothing has changed then.
    pub fn step(&mut self, seen: Option<&[Seen]>, completions: &[Completion], hour: f64) -> Result<Commands> {
        let now = self.pyramid.at(hour)?;
        self.step += 1;
        let mut commands = Commands::default();
        if let Some(seen) = seen {
            self.want(seen);
        }
        self.mark();
        self.arrive(completions, &mut commands);
        self.load(&now, &mut commands);
        self.read(&now, &mut commands);
        self.decode(&now, &mut commands);
        self.show(&mut commands);
        commands.mip_bias = self.mip_bias;
        Ok(commands)
    }

    /// Replaces the bundles, for instance when the scene was baked again. All data is read again. If all
    /// pages have the same sizes as before, slots stay in use until their tiles are decoded from the new
    /// data.
    ///
    /// # Errors
    /// Those of [`Stream::new`].
    pub fn replace(&mut self, pyramid: Arc<Pyramid>) -> Result<()> {
        let mut fresh = Stream::new(pyramid, self.budgets.clone())?;
        let sizes = |pyramid: &Pyramid| -> Vec<Vec<ndgi::grid::Grid>> {
            (0..pyramid.levels()).map(|level| pyramid.bundle(level).header.pages.clone()).collect()
        };
        // Tickets go on, so that an answer to an old read is not taken for one to a new read.
        (fresh.tickets, fresh.step, fresh.mip_bias) = (self.tickets, self.step, self.mip_bias);
        // Lamps that are switched meanwhile are not shown as they were.
        fresh.before = self.before.take();
        if sizes(&fresh.pyramid) == sizes(&self.pyramid) {
            let is_lit = |tile: &Tile| !fresh.pyramid.facts(*tile).is_black();
            fresh.wanted = std::mem::take(&mut self.wanted);
            fresh.wanted.retain(|tile, _| is_lit(tile));
            fresh.slots = self.slots.iter().map(|owner| owner.filter(is_lit)).collect();
            for tile in fresh.slots.iter().flatten() {
                // The data it was decoded from is gone.
                let shown = self.tiles[tile.0 as usize].shown;
                fresh.tiles[tile.0 as usize].shown =
                    shown.map(|shown| Shown { travelled: f32::NAN, ..shown });
            }
        }
        // The device still has the old table: the next step reports what differs.
        fresh.table = std::mem::take(&mut self.table);
        fresh.table.resize(fresh.pyramid.tiles(), Entry::Mean);
        fresh.altered = (0..fresh.pyramid.tiles() as u32).map(Tile).collect();
        *self = fresh;
        Ok(())
    }

    /// Reports that a [`Load`] of the last step could not be carried out: for want of room on the device, or
    /// `why`. The tile is read again later, and one tile that is not wanted is unloaded at once to make room.
    /// `commands` receives what has to be unloaded and dropped.
    pub fn refuse(&mut self, tile: Tile, why: Option<String>, commands: &mut Commands) {
        if let Some(what) = why {
            self.report(tile, &what, commands);
        }
        self.free_place(tile, commands);
        let tries = self.state(tile).refused;
        self.state_mut(tile).refused += 1;
        // An empty place has no room to give. Nor has what was to be loaded in this very step.
        let may_go = |other: &Tile| {
            let State { data, wanted, .. } = self.state(*other);
            *wanted < self.step && matches!(data, Data::Held { since, .. } if *since < self.step)
        };
        let others = self.places.iter().flatten().copied().filter(may_go);
        if let Some(other) = others.min_by_key(|other| (self.state(*other).wanted, *other)) {
            self.free_place(other, commands);
        }
        self.state_mut(tile).data = Data::Waiting { step: self.step + (1 << tries.min(8)), tries: 0 };
    }

    /// The tiles.
    pub fn pyramid(&self) -> &Arc<Pyramid> {
        &self.pyramid
    }

    /// The budgets.
    pub fn budgets(&self) -> &Budgets {
        &self.budgets
    }

    /// The tile's entry in the page table: what is sampled for it.
    ///
    /// # Panics
    /// For a tile that does not exist.
    pub fn entry(&self, tile: Tile) -> Entry {
        self.table[tile.0 as usize]
    }

    /// The wanted tiles, at most there are slots, and their pixels.
    pub fn wanted(&self) -> impl Iterator<Item = Seen> + '_ {
        self.wanted.iter().map(|(tile, pixels)| Seen { tile: *tile, pixels: *pixels })
    }

    /// The change of a tile's light since it was decoded, relative to its light now; `None` if it is not
    /// decoded.
    pub fn staleness(&self, tile: Tile, now: &Now) -> Option<f32> {
        let shown = self.state(tile).shown?;
        Some(self.change(tile, shown.travelled, now, 0.0))
    }

    /// Reports once that a tile cannot be read.
    fn report(&mut self, tile: Tile, what: &str, commands: &mut Commands) {
        if !std::mem::replace(&mut self.state_mut(tile).reported, true) {
            commands.failures.push(Failure { tile, what: what.to_owned() });
        }
    }

    fn state(&self, tile: Tile) -> &State {
        &self.tiles[tile.0 as usize]
    }

    fn state_mut(&mut self, tile: Tile) -> &mut State {
        &mut self.tiles[tile.0 as usize]
    }

    fn is_wanted(&self, tile: Tile) -> bool {
        self.state(tile).wanted == self.step
    }

    fn ticket(&mut self) -> u64 {
        self.tickets += 1;
        self.tickets
    }

    /// The interval of visibility that a tile needs now, if any.
    fn times(&self, tile: Tile, now: &Now) -> Option<Times> {
        let sun = self.pyramid.sun(tile, now).filter(|_| self.pyramid.facts(tile).has_sun);
        sun.map(|(times, _)| times)
    }

    /// The change of a tile's light since its mean had travelled `travelled`, relative to its light now or to
    /// `floor`, whichever is greater.
    fn change(&self, tile: Tile, travelled: f32, now: &Now, floor: f32) -> f32 {
        if travelled.is_nan() {
            return f32::INFINITY;
        }
        let [at, whole] = self.pyramid.travelled(tile, now);
        let way = (at - travelled).abs();
        // A day later it is where it was; a clock may go either way.
        let way = way.min((whole - way).max(0.0));
        let light: f32 = self.pyramid.mean(tile, now).iter().sum();
        let light = light.max(floor);
        if way == 0.0 { 0.0 } else { way / light.max(f32::MIN_POSITIVE) }
    }
}

/// An empty entry of `owners`, or else the least recently used one. `last` gives the step of an owner's last
/// use, or `None` if it must stay.
fn oldest(owners: &[Option<Tile>], last: impl Fn(Tile) -> Option<u64>) -> Option<u32> {
    let age = |owner: &Option<Tile>| match owner {
        None => Some((0, None)),
        Some(tile) => last(*tile).map(|step| (step + 1, Some(*tile))),
    };
    let ages = owners.iter().enumerate().filter_map(|(i, owner)| age(owner).map(|age| (age, i as u32)));
    ages.min().map(|(_, i)| i)
}
