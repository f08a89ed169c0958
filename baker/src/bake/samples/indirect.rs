//! Path-traced light (indirect light, and that straight from the sky) at the texels of a block: paths that
//! end in the cache, and bright-surface samples.

use super::allocate::shared;
use super::block::{Stream, Worker};
use crate::Rgb;
use crate::bake::store::{BlockState, CELLS, cell_of};
use crate::receivers::ReceiverBlock;
use crate::trace::counts::{RayCounts, sum};
use crate::trace::irradiance::bright_facets::{BrightFacet, BrightSelection, MOST_CLUSTERS, sides};
use crate::trace::irradiance::{BrightFacetIndex, BrightSurfaceView, BrightSurfaces, CacheHalf, CacheMap};
use crate::trace::paths::Sample;
use crate::trace::paths::path::{Arrival, balance_heuristic};
use crate::trace::rays::Hit;
use crate::trace::solids::Receiver;
use crate::trace::sources::light_subset::{FEW_GROUPS, SystematicSampler, chances};
use dataset::host::signals::interrupted;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// A filled cache: where its entries are, and its two halves.
pub struct Cache<'a> {
    /// Where entries are.
    pub map: CacheMap<'a>,
    /// One per half of the samples.
    pub halves: [CacheHalf; 2],
    /// Its bright surfaces: those of daylight and those of each group, where there are any.
    pub bright_surfaces: Vec<BrightSurfaces>,
    /// Which of their facets hold a point.
    index: BrightFacetIndex,
    /// How many of `bright_surfaces` are daylight's. They stand first: one list per room, then one of all
    /// surfaces.
    of_daylight: usize,
    /// The bright surfaces of light groups among `bright_surfaces`, where groups are many.
    of_many_groups: Range<usize>,
    /// Per block and cell, what is seen of each of them, once somebody asked.
    views: Vec<OnceLock<Vec<Option<CellView>>>>,
}

/// What a cell sees of the bright surfaces of one light group, or of daylight.
struct CellView {
    view: BrightSurfaceView,
    /// The probability that a path is joined by a sample of them.
    chance: f32,
}

impl<'a> Cache<'a> {
    /// Finds the bright surfaces.
    pub fn new(worker: &Worker, map: CacheMap<'a>, halves: [CacheHalf; 2]) -> Self {
        let (geometry, lights) = (worker.transport.space.geometry, worker.transport.lights);
        // Each cell looks at each cluster: many groups have fewer of them.
        let most_clusters = match lights.groups.len() {
            ..=FEW_GROUPS => MOST_CLUSTERS,
            many => (MANY_CLUSTERS / many).clamp(LEAST_CLUSTERS, MOST_CLUSTERS),
        };
        let of_group = |g| {
            let layer = lights.group_layer(g);
            BrightSelection { layers: layer..layer + 1, key: lights.groups[g].key, most_clusters, room: None }
        };
        let daylight = |room| BrightSelection {
            layers: 0..lights.sky_layers().end,
            key: 0,
            most_clusters: MOST_CLUSTERS,
            room,
        };
        let places = lights.rooms.iter().copied().map(Some).chain([None]);
        let all_layers = places.map(daylight).chain((0..lights.groups.len()).map(of_group));
        let sides = sides(geometry, &map);
        let find = |selection| BrightSurfaces::new(geometry, &map, &halves, &sides, selection);
        let bright_surfaces: Vec<BrightSurfaces> = all_layers.filter_map(find).collect();
        let cells = if bright_surfaces.is_empty() { 0 } else { worker.receivers.all_blocks() * CELLS };
        let views = (0..cells).map(|_| OnceLock::new()).collect();
        let facets: Vec<&[BrightFacet]> = bright_surfaces.iter().map(BrightSurfaces::facets).collect();
        let index = BrightFacetIndex::new(geometry.triangles.len(), &facets);
        // (Daylight stands first, if it has any.)
        let of_daylight = bright_surfaces
            .iter()
            .take_while(|surfaces| surfaces.layers.end <= lights.sky_layers().end)
            .count();
        let has_many_groups = lights.groups.len() > FEW_GROUPS;
        let of_many_groups = if has_many_groups { of_daylight..bright_surfaces.len() } else { 0..0 };
        Cache { map, halves, bright_surfaces, index, of_daylight, of_many_groups, views }
    }

    /// The index of daylight's list for a cell: that of the room which holds most of its receivers, else that
    /// of all surfaces, if there is one.
    fn daylight_for(&self, receivers: &[(Receiver, Sample)]) -> Option<usize> {
        let is_for = |surfaces: &BrightSurfaces| {
            surfaces.room.is_none_or(|room| {
                let inside = receivers.iter().filter(|(at, _)| room.holds_surface(at.origin(), at.normal()));
                2 * inside.count() > receivers.len()
            })
        };
        // (Those of rooms stand first.)
        self.bright_surfaces[..self.of_daylight].iter().position(is_for)
    }

    /// Each view with the chance of a sample: where groups are many, in proportion to the light that arrives
    /// beside the mean of their layers. Daylight is always sampled.
    fn cell_views(&self, views: Vec<Option<BrightSurfaceView>>) -> Vec<Option<CellView>> {
        let mut sample_chances = vec![1.0; views.len()];
        let of_many_groups = &mut sample_chances[self.of_many_groups.clone()];
        let worth = |view: &Option<BrightSurfaceView>| view.as_ref().map_or(0.0, BrightSurfaceView::worth);
        of_many_groups
            .iter_mut()
            .zip(&views[self.of_many_groups.clone()])
            .for_each(|(chance, view)| *chance = worth(view));
        chances(of_many_groups, BRIGHT_GROUPS_PER_PATH);
        let cell_view =
            |(view, chance): (Option<BrightSurfaceView>, f32)| Some(CellView { view: view?, chance });
        views.into_iter().zip(sample_chances).map(cell_view).collect()
    }

    /// What a cell sees of the bright surfaces of each light group, and of daylight.
    fn visible_from(&self, block: usize, cell: usize) -> &[Option<CellView>] {
        self.views.get(block * CELLS + cell).and_then(OnceLock::get).map_or(&[], Vec::as_slice)
    }
}

/// Clusters of bright facets of all light groups together, where there are more than [`FEW_GROUPS`].
const MANY_CLUSTERS: usize = 1024;

/// Least clusters of a group.
const LEAST_CLUSTERS: usize = 16;

/// Light groups whose bright surfaces are sampled with each path, on average, where there are more than
/// [`FEW_GROUPS`].
const BRIGHT_GROUPS_PER_PATH: usize = 2;

/// Whether one group's bright surfaces are sampled: the random number for that.
const SELECTION: u32 = 0x6c6f_6f6b;

/// An entry of the cache that a path ended at, to be read a few samples later: by then it has come from
/// memory.
pub(super) struct PendingRead {
    entry: u32,
    /// Irradiance at the texel per unit of it there.
    weight: Rgb,
    /// The layers it counts for.
    layers: Range<usize>,
}

/// What is nearer to a texel than so many lengths of its own entries is not read: there light differs over an
/// entry, and paths go on.
const NEAR_ENTRY_LENGTHS: f64 = 2.0;

/// Samples after which the pending reads are made. (Sums are taken in this order: it decides the bytes of
/// every bake.)
const READ_EVERY: u32 = 8;

/// One half of the cache, as the paths of one texel read it.
pub struct CacheReader<'a> {
    cache: &'a Cache<'a>,
    half: &'a CacheHalf,
    /// What the texel's cell sees of the bright surfaces.
    visible: &'a [Option<CellView>],
    pending: &'a mut Vec<PendingRead>,
}

impl CacheReader<'_> {
    /// Makes the pending reads and adds them to `out`.
    fn read(&mut self, out: &mut [Rgb]) {
        for PendingRead { entry, weight, layers } in self.pending.drain(..) {
            self.half.add_layers(entry, weight, layers.clone(), &mut out[layers]);
        }
    }
}

impl Worker<'_> {
    /// Brings the indirect light of the texels of the `active` cells to `target` samples a half, times each
    /// texel's share.
    pub fn indirect(
        &self,
        block: usize,
        receivers: &ReceiverBlock,
        state: &mut BlockState,
        active: &[bool; CELLS],
        target: u32,
        cache: Option<&Cache>,
    ) -> RayCounts {
        let (layers, hit_lights) = (self.transport.lights.layers(), self.transport.lights.hit_lights());
        let covered: Vec<usize> = receivers.covered().collect();
        let goal = |texel: usize| state.log2_shares.get(texel).map_or(target, |&share| shared(target, share));
        let goals: Vec<u32> = (0..covered.len()).map(goal).collect();
        let mut counts = self.views(block, receivers, state, active, cache);
        // (No group that can be met: an empty slice for each texel.)
        let mut none: Vec<[Rgb; 0]> = vec![[]; covered.len()];
        let hit_sums_of_texels: Vec<&mut [Rgb]> = match hit_lights {
            0 => none.iter_mut().map(|none| &mut none[..]).collect(),
            _ => state.hit_sums.chunks_mut(2 * hit_lights).collect(),
        };
        let texels = state
            .sums
            .par_chunks_mut((2 * layers).max(1))
            .zip(hit_sums_of_texels)
            .zip(&mut state.taken)
            .zip(&mut state.drawn)
            .zip(&goals)
            .zip(&state.points)
            .zip(&covered)
            .with_min_len(64);
        let traced = texels.map_init(
            Vec::new,
            |pending, ((((((sums, hit_sums), taken), drawn), &goal), &points), &texel)| {
                let mut counts = RayCounts::default();
                let cell = cell_of(receivers, texel);
                if points == 0 || !active[cell] || interrupted() {
                    return counts;
                }
                let visible = cache.map_or(&[][..], |c| c.visible_from(block, cell));
                for half in 0..2 {
                    let sequence = self.sequence(receivers, texel, Stream::Indirect, half);
                    let out = &mut sums[half * layers..(half + 1) * layers];
                    let hit_light = &mut hit_sums[half * hit_lights..(half + 1) * hit_lights];
                    let mut reader =
                        cache.map(|cache| CacheReader { cache, half: &cache.halves[half], visible, pending });
                    for i in *drawn..goal {
                        let sample = sequence.sample(i);
                        if let Some(at) = self.receiver(receivers, texel, sample, points, &mut counts) {
                            taken[half] += 1;
                            self.trace_path(&at, sample, reader.as_mut(), out, hit_light, &mut counts);
                        }
                        if let Some(reader) = &mut reader
                            && (i % READ_EVERY == READ_EVERY - 1 || i + 1 == goal)
                        {
                            reader.read(out);
                        }
                    }
                }
                *drawn = goal.max(*drawn);
                counts
            },
        );
        counts += sum(traced.collect::<Vec<_>>());
        counts
    }

    /// One path, ended where the cache knows the light, and a sample of its bright surfaces. Reads of
    /// the cache are pending until `CacheReader::read`; light straight from emissive surfaces goes to
    /// `hit_light`.
    pub fn trace_path(
        &self,
        at: &Receiver,
        sample: Sample,
        reader: Option<&mut CacheReader>,
        out: &mut [Rgb],
        hit_light: &mut [Rgb],
        counts: &mut RayCounts,
    ) {
        let Some(CacheReader { cache, half, visible, pending }) = reader else {
            self.transport.indirect(at, sample, |_, _, _| false, out, Some(hit_light), counts);
            return;
        };
        let (transport, map) = (&self.transport, &cache.map);
        let layers = out.len();
        let is_near = |hit: &Hit, is_back| {
            f64::from(hit.t)
                < NEAR_ENTRY_LENGTHS * map.length_on(transport.space.geometry, hit.triangle, is_back)
        };
        let on_arrival = |arrival: &Arrival, _: &mut [Rgb], counts: &mut RayCounts| {
            let Arrival { hit, is_back, weight, .. } = arrival;
            if arrival.is_first && is_near(hit, *is_back) {
                return false;
            }
            let Some(entry) = map.entry(&transport.space, hit, *is_back, counts) else { return false };
            half.prefetch(entry);
            let mut put = |weight, layers: Range<usize>| pending.push(PendingRead { entry, weight, layers });
            // What a bright-surface sample finds too is shared between both.
            // (They stand in the order of their layers, which do not overlap.)
            let mut rest = 0;
            let facets =
                if arrival.is_first && !visible.is_empty() { cache.index.at(hit, *is_back) } else { &[] };
            for facet in facets {
                let Some(CellView { view, chance }) = &visible[facet.list as usize] else { continue };
                let bright_surfaces = &cache.bright_surfaces[facet.list as usize];
                let density = chance * bright_surfaces.density(view, facet.facet as usize);
                if density > 0.0 {
                    let from = transport.space.front(hit.triangle).dot(arrival.direction).abs();
                    let share = balance_heuristic(arrival.pdf, density * hit.t * hit.t / from);
                    put(*weight, rest..bright_surfaces.layers.start);
                    put(*weight * share, bright_surfaces.layers.clone());
                    rest = bright_surfaces.layers.end;
                }
            }
            put(*weight, rest..layers);
            true
        };
        transport.indirect(at, sample, on_arrival, out, Some(hit_light), counts);
        let mut sampler =
            SystematicSampler::new(if visible.is_empty() { 0.0 } else { sample.number(SELECTION) });
        for (bright_surfaces, cell_view) in cache.bright_surfaces.iter().zip(*visible) {
            if let Some(CellView { view, chance }) = cell_view
                && sampler.selects(*chance)
                && let Some((hit, is_back, weight)) =
                    bright_surfaces.reflected(&transport.space, at, view, *chance, sample, counts)
                && !is_near(&hit, is_back)
                && let Some(entry) = map.entry(&transport.space, &hit, is_back, counts)
            {
                half.prefetch(entry);
                pending.push(PendingRead { entry, weight, layers: bright_surfaces.layers.clone() });
            }
        }
    }

    /// Finds out what is seen of the bright surfaces from each active cell, unless that is known.
    fn views(
        &self,
        block: usize,
        receivers: &ReceiverBlock,
        state: &BlockState,
        active: &[bool; CELLS],
        cache: Option<&Cache>,
    ) -> RayCounts {
        /// Points of a cell from which it is found out, where that many samples read it.
        const MOST_RECEIVERS: usize = 8;
        let most = (self.guaranteed_samples as usize).min(MOST_RECEIVERS);
        let Some(cache) = cache.filter(|c| !c.bright_surfaces.is_empty()) else {
            return RayCounts::default();
        };
        let mut texels = vec![Vec::new(); CELLS];
        for (texel, points) in receivers.covered().zip(&state.points).filter(|(_, points)| **points != 0) {
            texels[cell_of(receivers, texel)].push((texel, *points));
        }
        let find_views = |cell: usize| {
            let (mut counts, texels) = (RayCounts::default(), &texels[cell]);
            let known = &cache.views[block * CELLS + cell];
            if !active[cell] || texels.is_empty() || known.get().is_some() {
                return counts;
            }
            let receivers: Vec<(Receiver, Sample)> = (0..most)
                .filter_map(|k| {
                    let (texel, points) = texels[(2 * k + 1) * texels.len() / (2 * most)];
                    let sample = self.sequence(receivers, texel, Stream::BrightSurfaces, 0).sample(k as u32);
                    Some((self.receiver(receivers, texel, sample, points, &mut counts)?, sample))
                })
                .collect();
            let daylight = cache.daylight_for(&receivers);
            let view = |(i, surfaces): (usize, &BrightSurfaces)| {
                let is_used = i >= cache.of_daylight || Some(i) == daylight;
                is_used.then(|| surfaces.view(&self.transport.space, &receivers, &mut counts))?
            };
            let views = cache.bright_surfaces.iter().enumerate().map(view).collect();
            let _ = known.set(cache.cell_views(views));
            counts
        };
        sum((0..CELLS).into_par_iter().map(find_views).collect::<Vec<_>>())
    }
}
