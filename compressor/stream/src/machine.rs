//! The state machine: what is seen and what has arrived go in, what is to be done comes out.
//!
//! Per tile there are two things: its *data* (absent, being read, arrived in memory, held on the device), and its *slot*, decoded texels of some hour. A
//! step passes the files of this folder in this order: what is wanted, what arrived, what is loaded, what is decoded, and which slot each tile shows.

mod arrive;
mod decode;
mod load;
mod show;
mod want;

use crate::{Budgets, Now, Pyramid, Result, Tile};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The times of visibility around an hour, as `ndgi::at::SunAt::times`.
pub type Times = [usize; 2];

/// A tile that a view shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// The tile, at the level that the view asks for.
    pub tile: Tile,
    /// How many pixels it covers.
    pub pixels: u32,
}

/// An answer to a [`Read`].
#[derive(Clone, Debug, PartialEq)]
pub struct Completion {
    /// The read's number.
    pub ticket: u64,
    /// What came of it.
    pub answer: Answer,
}

/// What came of a read.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// What was asked for is in memory.
    Arrived,
    /// The read failed. One that may work later is tried again ([`Budgets::retries`]); one of a damaged tile is not.
    Failed {
        /// Whether another try would fail too.
        is_lasting: bool,
        /// Why, in words.
        what: String,
    },
}

/// Data that is to be brought into memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// A number of its own; the [`Completion`] has the same.
    pub ticket: u64,
    /// The tile.
    pub tile: Tile,
    /// Whether the tile's features are read, and not only what it sees of the sun.
    pub features: bool,
    /// The interval of visibility that is made ready with it.
    pub times: Option<Times>,
}

/// Data that is to be put on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// The tile.
    pub tile: Tile,
    /// The place for features on the device. What was there is gone.
    pub place: u32,
    /// Whether the tile's features are loaded, and not only what it sees of the sun.
    pub features: bool,
    /// The interval of visibility that is loaded.
    pub times: Option<Times>,
}

/// A tile that is to be decoded at the step's hour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decode {
    /// The tile.
    pub tile: Tile,
    /// Its place for features.
    pub place: u32,
    /// The slot that is written.
    pub slot: u32,
    /// Whether its maps are decoded.
    pub maps: bool,
    /// Whether its sun is decoded.
    pub sun: bool,
}

/// What is shown where a tile is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// The tile's mean: nothing that covers it is decoded, or it has no light at all.
    Mean,
    /// A slot, of the tile itself or of one that covers it.
    Slot {
        /// The slot.
        slot: u32,
        /// The level of the tile in it.
        level: u8,
    },
}

/// A tile that cannot be read. It is shown by the tiles that cover it.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// The tile.
    pub tile: Tile,
    /// Why, in words.
    pub what: String,
}

/// What is to be done, in this order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Commands {
    /// To be started, the most urgent first.
    pub reads: Vec<Read>,
    /// Tiles whose data in memory is no longer needed.
    pub drops: Vec<Tile>,
    /// Places for features that are empty now.
    pub unloads: Vec<u32>,
    /// Before anything of this step is decoded. What is loaded is decoded in the next step at the earliest: where the device has no room, call
    /// [`Stream::refuse`] until then.
    pub loads: Vec<Load>,
    /// Before anything of this step is sampled.
    pub decodes: Vec<Decode>,
    /// Tiles that lost their slots: for statistics.
    pub evictions: Vec<Tile>,
    /// Entries of the page table that are different now.
    pub table: Vec<(Tile, Entry)>,
    /// By how many levels coarser than its own resolution the view shall ask: rises where it wants more tiles than there are slots.
    pub mip_bias: f32,
    /// Tiles that cannot be read, each told once.
    pub failures: Vec<Failure>,
}

/// Where a tile's data is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Data {
    #[default]
    Absent,
    /// Being read, for the n-th time after it failed.
    Reading { ticket: u64, tries: u32 },
    /// It failed; tried again from a step on.
    Waiting { step: u64, tries: u32 },
    /// In memory, with an interval.
    Arrived { times: Option<Times> },
    /// On the device, since a step.
    Held { place: u32, since: u64 },
    /// It cannot be read.
    Failed,
}

/// What a tile on the device has of the sun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Visible {
    /// The interval on the device.
    held: Option<Times>,
    /// One that is being read.
    asked: Option<(u64, Times)>,
    /// One that is in memory.
    ready: Option<Times>,
}

/// A decoded tile.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    slot: u32,
    /// [`Pyramid::travelled`] when its maps were decoded.
    travelled: f32,
    /// The step at which they were.
    step: u64,
    /// The hour of its sun; `None` where that is black, or has to be decoded again.
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
    /// Its pixels then.
    pixels: u32,
    /// How often the device had no room for its features.
    refused: u32,
}

/// Decides what is read, loaded, decoded and shown. See [`Stream::step`].
#[derive(Clone, Debug)]
pub struct Stream {
    pyramid: Arc<Pyramid>,
    budgets: Budgets,
    step: u64,
    tickets: u64,
    tiles: Vec<State>,
    /// By place for features and by slot: whose it is.
    places: Vec<Option<Tile>>,
    slots: Vec<Option<Tile>>,
    /// Tiles being read or arrived.
    under_way: Vec<Tile>,
    /// Tiles of which an interval is being read: by ticket.
    intervals: BTreeMap<u64, Tile>,
    /// Roots that always keep their slots.
    pinned: Vec<Tile>,
    /// Tiles of the last feedbacks: their pixels, and how many feedbacks ago.
    seen: BTreeMap<Tile, (u32, u32)>,
    /// What is wanted by them, and its pixels.
    wanted: BTreeMap<Tile, u32>,
    mip_bias: f32,
    table: Vec<Entry>,
    /// Tiles that got a slot or lost it in this step.
    altered: Vec<Tile>,
    /// The hour of the last step, and the light groups that were on.
    before: Option<(f64, Vec<bool>)>,
}

impl Stream {
    /// A stream of nothing yet: every tile shows its mean.
    ///
    /// # Errors
    /// [`Error::Invalid`] for budgets under which nothing could be shown.
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

    /// One frame. `seen`: what the view shows, as the latest feedback tells; `None` where there is none since the last step. `completions`: answers
    /// to reads since the last step. Afterwards the page table says what is sampled, once the commands are carried out in their order.
    ///
    /// # Errors
    /// [`Error::Bundle`] for an hour that is not a finite number: nothing has changed then.
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

    /// Takes up other bundles in the place of those there were, such as a scene baked anew. Data is read again; slots are shown until their tiles
    /// are decoded anew, where the levels have the same sizes as before.
    ///
    /// # Errors
    /// None but what [`Stream::new`] says.
    pub fn replace(&mut self, pyramid: Arc<Pyramid>) -> Result<()> {
        let mut fresh = Stream::new(pyramid, self.budgets.clone())?;
        let sizes = |pyramid: &Pyramid| -> Vec<Vec<ndgi::grid::Grid>> {
            (0..pyramid.levels()).map(|level| pyramid.bundle(level).header.pages.clone()).collect()
        };
        // Numbers of reads go on: answers to old ones are not taken for new ones.
        (fresh.tickets, fresh.step, fresh.mip_bias) = (self.tickets, self.step, self.mip_bias);
        if sizes(&fresh.pyramid) == sizes(&self.pyramid) {
            let is_lit = |tile: &Tile| !fresh.pyramid.facts(*tile).is_black();
            fresh.wanted = std::mem::take(&mut self.wanted);
            fresh.wanted.retain(|tile, _| is_lit(tile));
            fresh.slots = self.slots.iter().map(|owner| owner.filter(is_lit)).collect();
            for tile in fresh.slots.iter().flatten() {
                // What it was decoded from is no more.
                let shown = self.tiles[tile.0 as usize].shown;
                fresh.tiles[tile.0 as usize].shown =
                    shown.map(|shown| Shown { travelled: f32::NAN, ..shown });
            }
        }
        // The table that the device has is the old one: what is different is told.
        fresh.table = std::mem::take(&mut self.table);
        fresh.table.resize(fresh.pyramid.tiles(), Entry::Mean);
        fresh.altered = (0..fresh.pyramid.tiles() as u32).map(Tile).collect();
        *self = fresh;
        Ok(())
    }

    /// Says that the last step's [`Load`] of a tile's features could not be carried out for want of room. It is read again later, and one tile
    /// that is not wanted gives up its place until then.
    pub fn refuse(&mut self, tile: Tile, commands: &mut Commands) {
        self.free_place(tile, commands);
        let tries = self.state(tile).refused;
        self.state_mut(tile).refused += 1;
        let step = self.step;
        if let Some(place) =
            oldest(&self.places, |other| Some(self.state(other).wanted).filter(|last| *last < step))
            && let Some(other) = self.places[place as usize]
        {
            self.free_place(other, commands);
        }
        self.state_mut(tile).data = Data::Waiting { step: self.step + (1 << tries.min(8)), tries: 0 };
    }

    /// What is known of the tiles.
    pub fn pyramid(&self) -> &Arc<Pyramid> {
        &self.pyramid
    }

    /// The budgets.
    pub fn budgets(&self) -> &Budgets {
        &self.budgets
    }

    /// What is sampled where a tile is.
    ///
    /// # Panics
    /// For a tile that there is not.
    pub fn entry(&self, tile: Tile) -> Entry {
        self.table[tile.0 as usize]
    }

    /// The tiles that the view wants, as far as there are slots for them, and their pixels.
    pub fn wanted(&self) -> impl Iterator<Item = Seen> + '_ {
        self.wanted.iter().map(|(tile, pixels)| Seen { tile: *tile, pixels: *pixels })
    }

    /// How far a tile's light has changed since it was decoded, relative to what it is; `None` where it is not decoded.
    pub fn staleness(&self, tile: Tile, now: &Now) -> Option<f32> {
        let shown = self.state(tile).shown?;
        Some(self.change(tile, shown.travelled, now, 0.0))
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

    /// The next read's number.
    fn ticket(&mut self) -> u64 {
        self.tickets += 1;
        self.tickets
    }

    /// The interval that a tile needs, if any.
    fn times(&self, tile: Tile, now: &Now) -> Option<Times> {
        let sun = self.pyramid.sun(tile, now).filter(|_| self.pyramid.facts(tile).has_sun);
        sun.map(|(times, _)| times)
    }

    /// How far a tile's light changed since it had travelled so far, relative to its light now or to `floor`.
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

/// The entry that was used least recently among those of `owners` that may be taken, or an empty one.
fn oldest(owners: &[Option<Tile>], last: impl Fn(Tile) -> Option<u64>) -> Option<u32> {
    let age = |owner: &Option<Tile>| match owner {
        None => Some((0, None)),
        Some(tile) => last(*tile).map(|step| (step + 1, Some(*tile))),
    };
    let ages = owners.iter().enumerate().filter_map(|(i, owner)| age(owner).map(|age| (age, i as u32)));
    ages.min().map(|(_, i)| i)
}
