//! A scene of three levels, a disk that is slow and fails, and a model of the device that checks every
//! command.

#![allow(clippy::unwrap_used, dead_code, reason = "tests, of which none needs all")]

use ndgi::Bundle;
use ndgi::grid::Grid;
use ndgi::testing::{self, Random};
use ndgi_stream::{Answer, Budgets, Commands, Completion, Entry, Pyramid, Read, Spot, Stream, Tile};
use std::collections::BTreeMap;
use std::sync::Arc;

pub fn of_pages(sizes: &[[usize; 2]], levels: u32) -> Arc<Pyramid> {
    let level = |level: u32| {
        let page = |[width, height]: &[usize; 2]| Grid {
            width: width.div_ceil(1 << level),
            height: height.div_ceil(1 << level),
        };
        let (header, payloads) = testing::sunny_pages(sizes.iter().map(page).collect());
        Arc::new(Bundle::from_bytes(ndgi::bundle::encode(&header, &payloads).unwrap()).unwrap())
    };
    Arc::new(Pyramid::new((0..levels).map(level).collect()).unwrap())
}

/// Two pages of three levels: 24 and 6 tiles, 6 and 2, 2 and 1.
pub fn pyramid() -> Arc<Pyramid> {
    of_pages(&[[700, 400], [300, 140]], 3)
}

/// The same sizes, with other light.
pub fn shuffled() -> Arc<Pyramid> {
    let of = pyramid();
    let level = |level: usize| {
        let (header, mut payloads) = testing::sunny_pages(of.bundle(level).header.pages.clone());
        // Tiles of one size change places.
        let whole: Vec<usize> = header
            .places()
            .enumerate()
            .filter(|(_, place)| header.pages[place.page].stored(place.column, place.row) == (128, 128))
            .map(|(i, _)| i)
            .collect();
        whole.windows(2).for_each(|two| payloads.swap(two[0], two[1]));
        Arc::new(Bundle::from_bytes(ndgi::bundle::encode(&header, &payloads).unwrap()).unwrap())
    };
    Arc::new(Pyramid::new((0..of.levels()).map(level).collect()).unwrap())
}

pub fn other() -> Arc<Pyramid> {
    of_pages(&[[128, 300]], 2)
}

/// Tiles of level 0 that have light.
pub fn lit(pyramid: &Arc<Pyramid>) -> impl Iterator<Item = Tile> {
    let bundle = Arc::clone(pyramid.bundle(0));
    let numbers = 0..bundle.index.len() as u32;
    numbers.filter(move |i| bundle.index[*i as usize].bytes() > 0).map(Tile)
}

/// Whether a tile has maps, whose light changes with the hour.
pub fn changes(pyramid: &Pyramid, tile: Tile) -> bool {
    let [a, b] = [1.0, 1.2].map(|hour| pyramid.mean(tile, &pyramid.at(hour).unwrap()));
    a != b
}

/// A disk: this many steps for a read, this many reads in a thousand fail.
pub struct Disk {
    latency: usize,
    /// Reads in a thousand that fail.
    pub failing: usize,
    /// A tile that cannot be read.
    pub damaged: Option<Tile>,
    under_way: Vec<(usize, Read)>,
}

impl Disk {
    pub fn new(latency: usize, failing: usize) -> Self {
        Disk { latency, failing, damaged: None, under_way: Vec::new() }
    }

    pub fn is_idle(&self) -> bool {
        self.under_way.is_empty()
    }

    pub fn start(&mut self, step: usize, commands: &Commands, random: &mut Random) {
        for read in &commands.reads {
            self.under_way.push((step + 1 + random.below(self.latency + 1), *read));
        }
    }

    /// What is done by now; and at times an answer that nobody waits for.
    pub fn answers(&mut self, step: usize, random: &mut Random) -> Vec<Completion> {
        let (done, left) = std::mem::take(&mut self.under_way).into_iter().partition(|(at, _)| *at <= step);
        self.under_way = left;
        let done: Vec<(usize, Read)> = done;
        let mut answer = |(_, read): &(usize, Read)| {
            let answer = if self.damaged == Some(read.tile) {
                Answer::Failed { is_lasting: true, what: "damaged".to_owned() }
            } else if read.features && random.below(1000) < self.failing {
                Answer::Failed { is_lasting: random.below(5) == 0, what: "bad luck".to_owned() }
            } else {
                Answer::Arrived
            };
            Completion { ticket: read.ticket, answer }
        };
        let mut answers: Vec<Completion> = done.iter().map(&mut answer).collect();
        if random.below(20) == 0 {
            answers.push(Completion { ticket: u64::MAX, answer: Answer::Arrived });
        }
        answers
    }
}

/// What the device would hold.
pub struct Model {
    pyramid: Arc<Pyramid>,
    budgets: Budgets,
    step: usize,
    asked: BTreeMap<u64, Read>,
    /// By place: the tile, the step at which it was loaded, and its interval.
    places: Vec<Option<(Tile, usize)>>,
    /// By slot: the tile, and the lamps when it was decoded.
    slots: Vec<Option<(Tile, Vec<bool>)>>,
    table: Vec<Entry>,
    before: Option<(f64, Vec<bool>)>,
    reported: Vec<Tile>,
}

impl Model {
    pub fn new(pyramid: Arc<Pyramid>, budgets: Budgets) -> Self {
        Model {
            step: 0,
            asked: BTreeMap::new(),
            places: vec![None; budgets.features as usize],
            slots: vec![None; budgets.slots as usize],
            table: vec![Entry::Mean; pyramid.tiles()],
            before: None,
            reported: Vec::new(),
            pyramid,
            budgets,
        }
    }

    pub fn refuse(&mut self, commands: &Commands) {
        commands.unloads.iter().for_each(|place| self.places[*place as usize] = None);
    }

    /// What the device has after a replacement: slots alone.
    pub fn forget_places(&mut self) {
        self.places.fill(None);
        self.asked.clear();
    }

    pub fn check(&mut self, stream: &Stream, commands: &Commands, hour: f64) {
        self.step += 1;
        let now = self.pyramid.at(hour).unwrap();
        let jumps = self.before.as_ref().is_some_and(|(before, state)| {
            let way = (before - now.hour).abs();
            *state != now.state || way.min(24.0 - way) > 1.0
        });
        for read in &commands.reads {
            assert!(self.asked.insert(read.ticket, *read).is_none(), "a ticket of its own");
            assert!(read.features || read.times.is_some());
        }
        let of = |features: bool| commands.reads.iter().filter(move |read| read.features == features).count();
        assert!(of(true) <= self.budgets.reads && of(false) <= self.budgets.reads);
        commands.unloads.iter().for_each(|place| self.places[*place as usize] = None);
        let wanted: Vec<Tile> = stream.wanted().map(|seen| seen.tile).collect();
        assert!(wanted.len() <= self.budgets.slots as usize);
        let loads = commands.loads.iter().filter(|load| load.features).count();
        assert!(loads <= self.budgets.loads && commands.loads.len() <= 2 * self.budgets.loads);
        for load in &commands.loads {
            let place = &mut self.places[load.place as usize];
            if load.features {
                *place = Some((load.tile, self.step));
            } else {
                assert_eq!(place.map(|(tile, _)| tile), Some(load.tile), "an interval comes to its tile");
            }
        }
        let mut held: Vec<Tile> = self.places.iter().flatten().map(|(tile, _)| *tile).collect();
        let count = held.len();
        held.sort();
        held.dedup();
        assert_eq!(held.len(), count, "no tile is on the device twice");
        self.check_decodes(commands, &now.state, jumps);
        if !jumps {
            let lost = commands.evictions.iter().find(|tile| wanted.contains(tile));
            assert_eq!(lost, None, "nothing that is wanted is taken");
        }
        self.check_table(stream, commands, &now.state);
        for failure in &commands.failures {
            assert!(!self.reported.contains(&failure.tile), "told once: {failure:?}");
            self.reported.push(failure.tile);
        }
        self.before = Some((now.hour, now.state));
    }

    fn check_decodes(&mut self, commands: &Commands, state: &[bool], jumps: bool) {
        for decode in &commands.decodes {
            let held = self.places[decode.place as usize].unwrap();
            assert_eq!(held.0, decode.tile);
            assert!(held.1 < self.step, "loaded in an earlier step: {commands:?}");
            assert!(decode.maps || decode.sun);
            let state = match (&self.slots[decode.slot as usize], decode.maps) {
                (_, true) => state.to_vec(),
                (Some((tile, state)), false) => {
                    assert_eq!(*tile, decode.tile, "a sun alone comes to its own tile");
                    state.clone()
                }
                (None, false) => panic!("a sun alone in an empty slot"),
            };
            self.slots[decode.slot as usize] = Some((decode.tile, state));
        }
        let maps = commands.decodes.iter().filter(|decode| decode.maps).count();
        assert!(jumps || maps <= self.budgets.decodes, "{maps} decoded");
        assert!(commands.decodes.len() - maps <= self.budgets.suns);
        let mut tiles: Vec<Tile> = commands.decodes.iter().map(|decode| decode.tile).collect();
        tiles.sort();
        assert!(tiles.is_sorted_by(|a, b| a < b), "a tile is decoded once a step");
    }

    fn check_table(&mut self, stream: &Stream, commands: &Commands, state: &[bool]) {
        commands.table.iter().for_each(|(tile, entry)| self.table[tile.0 as usize] = *entry);
        for (number, entry) in self.table.iter().enumerate() {
            let tile = Tile(number as u32);
            assert_eq!(*entry, stream.entry(tile));
            let Entry::Slot { slot, level } = *entry else { continue };
            let (owner, decoded) = self.slots[slot as usize].as_ref().unwrap();
            let mut above = tile;
            while above != *owner {
                above = self.pyramid.parent(above).expect("the slot's tile covers this one");
            }
            let Spot { level: of_owner, place } = self.pyramid.spot(*owner).unwrap();
            assert_eq!(usize::from(level), of_owner);
            let bundle = self.pyramid.bundle(of_owner);
            let word = bundle.index[bundle.header.position(place).unwrap()].maps.word;
            let gates = ndgi::model::Contents::of_word(word).map_or(0, |contents| contents.gates);
            assert!(gates == 0 || decoded == state, "{owner:?} shows lamps as they were");
        }
    }
}
