//! The layers of a bake, kept beside the dataset: what a later bake of the same scene under other schedules,
//! colours or intensities is put together from, without a ray.
//!
//! One file per layer, named by its digest, and for suns and light groups a second one of the light that
//! comes straight from them: per covered texel, in the order of the blocks, the mean irradiance (3 × f32) and
//! half the difference of the two halves (3 × bf16), which is an independent estimate of the standard error;
//! both ÷ the scale of the layer's group. Beside them stands what filters made of them ([`super::denoise`]):
//! the mean (3 × f32), what was added (3 × bf16) and half the difference that is left (3 × bf16). One file
//! per page layout says which texels these are. Byte order: the machine's. All end in a checksum: 32 bytes of
//! BLAKE3 of the file's name and of all before. What does not fit it is not there, and made again.

use super::layer_file::{CHECKSUM, Partial, Source, file_name, is_whole, records};
use crate::bake::prepare::Part;
use crate::bake::rounds::{BlockHistory, Traced, Tracer};
use crate::bake::store::{CHARTS_FILE, Filtered, LAYERS_FOLDER, StoredValue, Value, json};
use crate::trace::counts::RayCounts;
use crate::{Error, Result, Rgb};
use bytemuck::{Pod, Zeroable};
use dataset::host::ReadExactAt;
use dataset::observe::Observer;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Name of the file that says which changes of the folder are being made.
const CHANGES: &str = "changes.json";

/// A covered texel of the page.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Texel {
    /// Its index on the page, row by row.
    pub index: u32,
    /// 1 where enough of its points are its surface, else 0.
    pub usable: u8,
    /// 1 where its surface is closed in by two-sided bodies ([`Space::is_closed_in`]), else 0.
    ///
    /// [`Space::is_closed_in`]: crate::trace::solids::Space::is_closed_in
    pub closed_in: u8,
    /// Those of its points that are its surface, a bit each.
    pub points: u16,
}

/// The layer of this digest after a filter, under a name that tells what it was made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FilteredLayer {
    /// The digest of the layer.
    pub digest: String,
    /// That of the filter, of what was traced, and of the texels that count.
    pub name: String,
}

/// The folder of layers of a dataset.
#[derive(Debug)]
pub struct Layers {
    root: PathBuf,
}

impl Layers {
    /// The folder below `dataset`.
    pub fn new(dataset: &Path) -> Self {
        Layers { root: dataset.join(LAYERS_FOLDER) }
    }

    /// A folder within it for the layers of a round, which are not kept.
    pub fn provisional(&self) -> Layers {
        Layers { root: self.root.join("provisional") }
    }

    /// Takes over what a filter left of provisional layers, and discards the rest. (What cannot be
    /// taken over is filtered again.)
    pub fn take_filtered_from(&self, provisional: &Layers) {
        for entry in std::fs::read_dir(&provisional.root).into_iter().flatten().flatten() {
            if entry.path().extension().is_some_and(|extension| extension == "filtered") {
                let _ = std::fs::rename(entry.path(), self.root.join(entry.file_name()));
            }
        }
        let _ = dataset::host::files::remove_folder(&provisional.root);
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Creates the folder, where it is missing.
    pub fn create(&self) -> Result<()> {
        dataset::host::files::create_folders(&self.root).map_err(Error::io(&self.root))
    }

    fn path(&self, digest: &str, part: Part) -> PathBuf {
        let extension = match part {
            Part::Direct => "direct",
            Part::Rest => "layer",
        };
        self.root.join(format!("{}.{extension}", &digest[..32]))
    }

    /// The folder of the tiles of the sun's visibility that have this digest.
    pub fn visibility_folder(&self, digest: &str) -> PathBuf {
        self.root.join(format!("{}.visibility", &digest[..32]))
    }

    fn rounds_path(&self, base: &str) -> PathBuf {
        self.root.join(format!("{}.rounds", &base[..32]))
    }

    /// How the last tracing of layers of this page went.
    pub fn traced(&self, base: &str) -> Option<Traced> {
        serde_json::from_slice(&std::fs::read(self.rounds_path(base)).ok()?).ok()
    }

    fn texels_path(&self, base: &str) -> PathBuf {
        self.root.join(format!("{}.texels", &base[..32]))
    }

    /// Whether a layer is there, whatever its texels.
    pub fn holds(&self, digest: &str) -> bool {
        self.changes().current_path(&self.path(digest, Part::Rest)).exists()
    }

    /// Whether a layer of these parts is there, whole, for `texels` texels.
    pub fn has(&self, digest: &str, texels: usize, parts: &[Part]) -> bool {
        let is_there = |&part: &Part| {
            let (path, length) = (self.path(digest, part), texels * size_of::<StoredValue>() + CHECKSUM);
            let current_path = self.changes().current_path(&path);
            // (The length first: a layer of other texels need not be read.)
            let is_as_long = std::fs::metadata(&current_path).is_ok_and(|m| m.len() == length as u64);
            is_as_long && is_whole(&path, &current_path)
        };
        parts.iter().all(is_there)
    }

    /// The covered texels of the page that `base` describes, if a bake left them.
    pub fn texels(&self, base: &str) -> Option<Vec<Texel>> {
        let path = self.texels_path(base);
        records(&path, &self.changes().current_path(&path))
    }

    /// Goes through a part of a layer as traced, in the order of the texels.
    pub fn each(&self, digest: &str, part: Part, value: impl FnMut(usize, Value)) -> Result<()> {
        self.reader(digest, part)?.each(value)
    }

    /// A part of a layer as traced, to be read piece by piece.
    pub fn reader(&self, digest: &str, part: Part) -> Result<LayerReader> {
        Ok(LayerReader { traced: Source::open::<StoredValue>(self.path(digest, part))?, filtered: None })
    }

    /// A layer after a filter, likewise.
    pub fn reader_of_filtered(&self, layer: &FilteredLayer) -> Result<LayerReader> {
        let filtered = Some(Source::open::<Filtered>(self.filtered_path(&layer.name))?);
        Ok(LayerReader { traced: self.open(layer)?, filtered })
    }

    /// A part of a layer, likewise; filtered if `filtered` is given and the part is filtered.
    pub fn reader_of(
        &self,
        digest: &str,
        part: Part,
        filtered: Option<&FilteredLayer>,
    ) -> Result<LayerReader> {
        match filtered {
            Some(filtered) if part == Part::Rest => self.reader_of_filtered(filtered),
            _ => self.reader(digest, part),
        }
    }

    /// A part of a layer as traced, in the order of the texels.
    pub fn read(&self, digest: &str, part: Part) -> Result<Vec<Value>> {
        let mut values = Vec::new();
        self.each(digest, part, |_, value| values.push(value))?;
        Ok(values)
    }

    /// A layer after a filter, in the order of the texels.
    pub fn read_filtered(&self, layer: &FilteredLayer) -> Result<Vec<Value>> {
        let mut values = Vec::new();
        self.reader_of_filtered(layer)?.each(|_, value| values.push(value))?;
        Ok(values)
    }

    /// A part of a layer as traced at some of the texels, by their positions among all; no others are read.
    pub fn read_at(&self, digest: &str, part: Part, positions: &[usize]) -> Result<Vec<Value>> {
        Source::open::<StoredValue>(self.path(digest, part))?.read_at(positions)
    }

    /// A layer after a filter at some of the texels.
    pub fn read_filtered_at(&self, layer: &FilteredLayer, positions: &[usize]) -> Result<Vec<Value>> {
        let mut values = self.read_at(&layer.digest, Part::Rest, positions)?;
        let filtered = Source::open::<Filtered>(self.filtered_path(&layer.name))?;
        let filtered = filtered.records::<Filtered>(positions)?;
        values.iter_mut().zip(filtered).for_each(|(value, filtered)| *value = filtered.value(value));
        Ok(values)
    }

    /// Opens what was traced of a layer that is to be filtered.
    pub fn open(&self, layer: &FilteredLayer) -> Result<Source> {
        Source::open::<StoredValue>(self.path(&layer.digest, Part::Rest))
    }

    fn filtered_path(&self, name: &str) -> PathBuf {
        self.root.join(format!("{name}.filtered"))
    }

    /// What a layer is called after a filter: by the filter, the texels that count, and what was traced.
    pub fn filtered(&self, digest: &str, method: &str, valid: &[u8; 32]) -> Result<FilteredLayer> {
        let path = self.path(digest, Part::Rest);
        let file = File::open(&path).map_err(Error::io(&path))?;
        let length = file.metadata().map_err(Error::io(&path))?.len();
        let mut checksum = [0; CHECKSUM];
        let at = length.saturating_sub(CHECKSUM as u64);
        file.read_exact_at(&mut checksum, at).map_err(Error::io(&path))?;
        let mut hash = blake3::Hasher::new();
        hash.update(method.as_bytes()).update(valid).update(digest.as_bytes()).update(&checksum);
        Ok(FilteredLayer { digest: digest.to_owned(), name: hash.finalize().to_hex()[..32].to_owned() })
    }

    /// Whether a layer after a filter is there, whole, for `texels` texels.
    pub fn has_filtered(&self, layer: &FilteredLayer, texels: usize) -> bool {
        let path = self.filtered_path(&layer.name);
        let length = (texels * size_of::<Filtered>() + CHECKSUM) as u64;
        std::fs::metadata(&path).is_ok_and(|m| m.len() == length) && is_whole(&path, &path)
    }

    /// Begins the file of a layer after a filter.
    pub fn create_filtered(&self, layer: &FilteredLayer) -> Result<Partial> {
        Partial::create(self.filtered_path(&layer.name))
    }

    /// Ends such files, and gives them their names.
    pub fn keep_filtered(&self, files: Vec<Partial>) -> Result<()> {
        let files = files.into_iter().map(|file| file.seal()?.finish()).collect::<Result<Vec<_>>>()?;
        self.change(&Changes { name: files, ..Changes::default() })
    }

    /// Writes the layers that were traced, `digests` in their order, and the page's texels. Gives the rays of
    /// blocks that had to be traced again.
    pub fn write(
        &self,
        tracer: &Tracer,
        history: &BlockHistory,
        base: &str,
        digests: &[String],
        traced: &Traced,
        console: &dyn Observer,
    ) -> Result<RayCounts> {
        self.create()?;
        dataset::host::files::remove_stale_temporaries(&self.root)?;
        let worker = &tracer.worker;
        let lights = worker.transport.lights;
        let blocks = worker.blocks();
        let mut rays = RayCounts::default();
        let progress = console.progress("keeping layers", blocks.len() as u64);
        let is_split = |layer: usize| lights.is_sky_apart || !lights.sky_layers().contains(&layer);
        let parts: Vec<(usize, Part)> = (0..digests.len())
            .flat_map(|l| is_split(l).then_some((l, Part::Direct)).into_iter().chain([(l, Part::Rest)]))
            .collect();
        let create = |&(layer, part): &(usize, Part)| Partial::create(self.path(&digests[layer], part));
        let mut files = parts.iter().map(create).collect::<Result<Vec<_>>>()?;
        let mut texels: Vec<Texel> = Vec::new();
        let black = || [0, 1].map(|_| vec![Rgb::ZERO; lights.layers()]);
        let (mut direct, mut rest) = (black(), black());
        for block in blocks {
            let receivers = worker.block(block);
            let covered: Vec<usize> = receivers.covered().collect();
            let state = tracer.block_state(block, &receivers, history, &mut rays)?;
            let closed_in = worker.closed_in(&receivers, &covered, &state, &mut rays);
            let mut stored: Vec<Vec<StoredValue>> = vec![Vec::with_capacity(covered.len()); parts.len()];
            for (i, &texel) in covered.iter().enumerate() {
                let index = receivers.page_index(texel) as u32;
                let (usable, closed_in) = (u8::from(state.is_usable(i)), u8::from(closed_in[i]));
                texels.push(Texel { index, usable, closed_in, points: state.points[i] });
                for half in 0..2 {
                    state.indirect(i, half, lights, &mut rest[half]);
                    direct[half].fill(Rgb::ZERO);
                    state.add_direct(i, half, lights, |_| true, &mut direct[half]);
                }
                for (stored, &(layer, part)) in stored.iter_mut().zip(&parts) {
                    let halves = if part == Part::Direct { &direct } else { &rest };
                    stored.push(StoredValue::new(halves[0][layer], halves[1][layer]));
                }
            }
            for (file, stored) in files.iter_mut().zip(&stored) {
                file.write(bytemuck::cast_slice(stored))?;
            }
            progress.advance(1);
        }
        history.report_retraced(console);
        let whole = |path: PathBuf, bytes: &[u8]| {
            let mut file = Partial::create(path)?;
            file.write(bytes)?;
            Ok(file)
        };
        files.push(whole(self.texels_path(base), bytemuck::cast_slice(&texels))?);
        let mut files = files.into_iter().map(Partial::seal).collect::<Result<Vec<_>>>()?;
        files.push(whole(self.rounds_path(base), &json::bytes(traced, "rounds")?)?);
        let name = files.into_iter().map(Partial::finish).collect::<Result<_>>()?;
        self.change(&Changes { name, ..Changes::default() })?;
        Ok(rays)
    }

    /// Forgets some layers, all at once: a bake that is to trace them again, and is killed, finds them
    /// missing and goes on.
    pub fn remove<'a>(&self, digests: impl Iterator<Item = &'a String>) -> Result<()> {
        let names =
            |digest: &String| [Part::Direct, Part::Rest].map(|part| file_name(&self.path(digest, part)));
        let remove = digests.flat_map(names).collect();
        self.change(&Changes { remove, ..Changes::default() })
    }

    /// The changes that were begun, of which some may be made.
    fn changes(&self) -> Changes {
        let bytes = std::fs::read(self.root.join(CHANGES)).unwrap_or_default();
        serde_json::from_slice(&bytes).unwrap_or_default()
    }

    /// Makes changes as one: a run that is killed amid them finds them written down, and the next makes the
    /// rest.
    fn change(&self, changes: &Changes) -> Result<()> {
        dataset::host::files::write_atomically(&self.root.join(CHANGES), &json::bytes(changes, CHANGES)?)?;
        self.finish_changes()
    }

    /// Makes what is left of the changes that a killed run began.
    pub fn finish_changes(&self) -> Result<()> {
        let journal = self.root.join(CHANGES);
        if !journal.exists() {
            return Ok(());
        }
        let changes = self.changes();
        let fine_if_gone = |path: &Path, done: std::io::Result<()>| match done {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(Error::io(path)(e)),
            _ => Ok(()),
        };
        for (temporary, name) in &changes.name {
            let path = self.root.join(name);
            fine_if_gone(&path, std::fs::rename(self.root.join(temporary), &path))?;
        }
        for path in changes.remove.iter().map(|name| self.root.join(name)) {
            fine_if_gone(&path, std::fs::remove_file(&path))?;
        }
        dataset::host::files::sync_folder_of(&journal);
        fine_if_gone(&journal, std::fs::remove_file(&journal))
    }

    /// Removes all files but those of these layers, before and after a filter, of this page and of the
    /// charts, and tells how many layers that were. `visibility`: the folder of the tiles of the sun's
    /// visibility to keep; a bake that needs none keeps those of another for a later one.
    pub fn keep_only(
        &self,
        base: &str,
        digests: &[String],
        filtered: &[Option<FilteredLayer>],
        visibility: Option<&Path>,
    ) -> usize {
        let paths = |digest: &String| [Part::Direct, Part::Rest].map(|part| self.path(digest, part));
        let mut keep: BTreeSet<PathBuf> = digests.iter().flat_map(paths).collect();
        keep.extend([self.texels_path(base), self.rounds_path(base), self.root.join(CHARTS_FILE)]);
        keep.extend(filtered.iter().flatten().map(|layer| self.filtered_path(&layer.name)));
        keep.extend(visibility.map(Path::to_owned));
        let Ok(entries) = std::fs::read_dir(&self.root) else { return 0 };
        let is_kept = |path: &PathBuf| {
            let is_visibility = path.extension().is_some_and(|extension| extension == "visibility");
            keep.contains(path) || is_visibility && visibility.is_none()
        };
        let others = entries.flatten().map(|e| e.path()).filter(|path| !is_kept(path));
        let remove = |path: &PathBuf| match path.is_dir() {
            true => dataset::host::files::remove_folder(path).is_ok(),
            false => std::fs::remove_file(path).is_ok(),
        };
        let removed = others.filter(remove);
        removed.filter(|path| path.extension().is_some_and(|e| e == "layer")).count()
    }

    /// Forgets all layers.
    pub fn clear(&self) -> Result<()> {
        dataset::host::files::remove_folder(&self.root)
    }
}

/// A part of a layer that is read piece by piece.
pub struct LayerReader {
    traced: Source,
    /// What a filter made of it.
    filtered: Option<Source>,
}

impl LayerReader {
    /// Reads some texels, by their positions among all: `value` is given each, counted from the first of
    /// them.
    pub fn read(&self, positions: Range<usize>, mut value: impl FnMut(usize, Value)) -> Result<()> {
        let traced = self.traced.run::<StoredValue>(positions.clone())?;
        match &self.filtered {
            None => traced.iter().enumerate().for_each(|(i, stored)| value(i, stored.value())),
            Some(filtered) => {
                let filtered = filtered.run::<Filtered>(positions)?;
                let both = filtered.iter().zip(&traced).enumerate();
                both.for_each(|(i, (filtered, stored))| value(i, filtered.value(&stored.value())));
            }
        }
        Ok(())
    }

    /// Reads all texels, some at a time.
    pub fn each(&self, value: impl FnMut(usize, Value)) -> Result<()> {
        self.each_of(0..self.traced.texels(), value)
    }

    /// Reads the texels at some positions; `value` is given each one's position in the layer.
    pub fn each_of(&self, positions: Range<usize>, mut value: impl FnMut(usize, Value)) -> Result<()> {
        for some in at_once(positions) {
            self.read(some.clone(), |i, v| value(some.start + i, v))?;
        }
        Ok(())
    }
}

/// Goes through all `texels` with the sum of some parts of layers at each; each part is multiplied by its
/// colour. Only some texels at a time are in memory.
pub(crate) fn each_sum(
    parts: &[(LayerReader, Rgb)],
    texels: usize,
    mut each: impl FnMut(usize, &Value),
) -> Result<()> {
    let mut sums = Vec::new();
    for range in at_once(0..texels) {
        sums.clear();
        sums.resize(range.len(), Value::default());
        for (reader, scale) in parts {
            reader.read(range.clone(), |i, value| sums[i] = sums[i].plus(value.times(*scale)))?;
        }
        range.zip(&sums).for_each(|(texel, value)| each(texel, value));
    }
    Ok(())
}

/// Cuts positions into ranges that fit into memory.
fn at_once(positions: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    const AT_ONCE: usize = 1 << 14;
    positions.clone().step_by(AT_ONCE).map(move |first| first..(first + AT_ONCE).min(positions.end))
}

/// What becomes of files of the folder, by their names, all at once.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Changes {
    /// Whole files under temporary names, and the names they get.
    #[serde(default)]
    name: Vec<(String, String)>,
    /// Files that go.
    #[serde(default)]
    remove: Vec<String>,
}

impl Changes {
    /// Where the content is that `path` has after the changes.
    fn current_path(&self, path: &Path) -> PathBuf {
        let name = file_name(path);
        if self.remove.contains(&name) {
            return path.with_extension("removed");
        }
        let temporary =
            self.name.iter().find(|(_, to)| *to == name).map(|(from, _)| path.with_file_name(from));
        temporary.filter(|temporary| temporary.exists()).unwrap_or_else(|| path.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_texels_of_a_layer_are_those_of_the_whole() {
        let dir = tempfile::tempdir().unwrap();
        let layers = Layers::new(dir.path());
        let digest = "0123456789abcdef0123456789abcdef";
        std::fs::create_dir(&layers.root).unwrap();
        let record = |i: u32| {
            let (mean, noise) = (Rgb::new(i as f32, 0.5, 2.0), Rgb::splat(0.25 * i as f32));
            StoredValue::new(mean + noise, mean - noise)
        };
        let stored: Vec<StoredValue> = (0..100).map(record).collect();
        let write = || {
            let mut file = Partial::create(layers.path(digest, Part::Rest)).unwrap();
            file.write(bytemuck::cast_slice(&stored)).unwrap();
            let (temporary, name) = file.seal().unwrap().finish().unwrap();
            std::fs::rename(layers.root.join(temporary), layers.root.join(name)).unwrap();
        };
        write();
        let (all, positions) = (layers.read(digest, Part::Rest).unwrap(), [99, 0, 17, 17]);
        assert_eq!(
            layers.read_at(digest, Part::Rest, &positions).unwrap(),
            positions.map(|position| all[position])
        );
        let error = layers.read_at(digest, Part::Rest, &[100]).unwrap_err().to_string();
        assert!(error.contains(layers.path(digest, Part::Rest).to_str().unwrap()), "{error}");
        // A layer of two parts is there with both of them.
        assert!(!layers.has(digest, 100, &[Part::Direct, Part::Rest]));
        // Cut short, with any bit turned, or under another name it is not there.
        let whole = std::fs::read(layers.path(digest, Part::Rest)).unwrap();
        assert!(layers.has(digest, 100, &[Part::Rest]) && !layers.has(digest, 99, &[Part::Rest]));
        for bit in (0..8 * whole.len()).step_by(61) {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(layers.path(digest, Part::Rest), bytes).unwrap();
            assert!(!layers.has(digest, 100, &[Part::Rest]), "bit {bit}");
        }
        std::fs::write(layers.path(digest, Part::Rest), &whole[..whole.len() - 1]).unwrap();
        assert!(!layers.has(digest, 100, &[Part::Rest]));
        let other = "fedcba9876543210fedcba9876543210";
        std::fs::write(layers.path(other, Part::Rest), &whole).unwrap();
        assert!(!layers.has(other, 100, &[Part::Rest]));
    }

    #[test]
    fn changes_are_made_as_one() {
        let dir = tempfile::tempdir().unwrap();
        let layers = Layers::new(dir.path());
        std::fs::create_dir(&layers.root).unwrap();
        let digests = ["a", "b", "c"].map(|digest| digest.repeat(32));
        let bytes = vec![0; 2 * size_of::<StoredValue>()];
        let held = || digests.iter().map(|digest| layers.has(digest, 2, &[Part::Rest])).collect::<Vec<_>>();
        let partial = digests.iter().map(|digest| {
            let mut file = Partial::create(layers.path(digest, Part::Rest)).unwrap();
            file.write(&bytes).unwrap();
            file.seal().unwrap().finish().unwrap()
        });
        let mut name: Vec<_> = partial.collect();
        let (last, path) = name.pop().unwrap();
        std::fs::rename(layers.root.join(last), layers.root.join(path)).unwrap();
        assert_eq!(held(), [false, false, true]);
        // As a run leaves it that was killed after the first of its renames.
        let changes =
            Changes { name: name.clone(), remove: vec![file_name(&layers.path(&digests[2], Part::Rest))] };
        std::fs::write(layers.root.join(CHANGES), json::bytes(&changes, "").unwrap()).unwrap();
        std::fs::rename(layers.root.join(&name[0].0), layers.path(&digests[0], Part::Rest)).unwrap();
        let after = [true, true, false];
        assert_eq!(held(), after);
        assert!(
            layers.path(&digests[2], Part::Rest).exists() && !layers.path(&digests[1], Part::Rest).exists()
        );
        layers.finish_changes().unwrap();
        assert_eq!(held(), after);
        assert_eq!(std::fs::read_dir(&layers.root).unwrap().count(), 2);
        layers.remove(digests[..1].iter()).unwrap();
        assert_eq!(held(), [false, true, false]);
    }
}
