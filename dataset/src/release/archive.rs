//! `.tar.zst` archives: written with the same bytes for the same files, read without trust and without
//! writing anything.

use super::MAX_TEXT_BYTES;
use super::sums::Summed;
use crate::digest::Digest;
use crate::format::FileRef;
use crate::host::files::is_component;
use crate::host::signals::stop_if_interrupted;
use crate::observe::Meter;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Compression level. One thread per archive: more of them would cut the stream otherwise.
const LEVEL: i32 = 12;
/// Largest window of a stream that is read, as a power of two: 16 MiB, four times that of the level.
const MAX_WINDOW_LOG: u32 = 24;
/// Every file's time, 2000-01-01: some programs warn of 1970.
const TIME: u64 = 946_684_800;
/// Largest padding behind the last entry; writers fill records of 10 KiB.
const MAX_PADDING: u64 = 1 << 20;

/// A file to be packed.
pub(super) struct Member {
    /// Its name in the archive.
    pub path: String,
    pub content: Content,
}

/// Where a file's bytes come from.
pub(super) enum Content {
    Memory(Vec<u8>),
    /// A file, and what it is to hold where that is known.
    Disk(PathBuf, Option<FileRef>),
}

impl Member {
    pub(super) fn length(&self) -> Result<u64> {
        match &self.content {
            Content::Memory(bytes) => Ok(bytes.len() as u64),
            Content::Disk(_, Some(known)) => Ok(known.bytes),
            Content::Disk(path, None) => Ok(path.metadata().map_err(Error::io(path))?.len()),
        }
    }
}

/// Writes an archive; gives what it holds.
pub(super) fn pack(out: &Path, members: &[Member], progress: &dyn Meter) -> Result<Vec<FileRef>> {
    let file = File::create_new(out).map_err(Error::io(out))?;
    let files = pack_into(out, BufWriter::new(&file), members, progress)?;
    file.sync_all().map_err(Error::io(out))?;
    Ok(files)
}

fn pack_into(out: &Path, sink: impl Write, members: &[Member], progress: &dyn Meter) -> Result<Vec<FileRef>> {
    let mut encoder = zstd::Encoder::new(sink, LEVEL).map_err(Error::io(out))?;
    encoder.include_checksum(true).map_err(Error::io(out))?;
    let mut tar = tar::Builder::new(encoder);
    let mut files = Vec::with_capacity(members.len());
    for member in members {
        let bytes = member.length()?;
        let (place, source, known): (&Path, Box<dyn Read + '_>, _) = match &member.content {
            Content::Memory(content) => (Path::new(&member.path), Box::new(&**content), None),
            Content::Disk(path, known) => {
                (path, Box::new(File::open(path).map_err(Error::io(path))?), known.as_ref())
            }
        };
        let mut header = tar::Header::new_ustar();
        header.set_path(&member.path).map_err(|error| {
            Error::unsupported(&member.path, format!("{error}; tar archives cannot store this name"))
        })?;
        header.set_entry_type(tar::EntryType::Regular);
        header.set_mode(0o644);
        header.set_uid(0);
        header.set_gid(0);
        header.set_mtime(TIME);
        header.set_size(bytes);
        header.set_cksum();
        let mut source =
            Hashed { inner: source.take(bytes), hasher: blake3::Hasher::new(), failed: false, progress };
        let appended = tar.append(&header, &mut source);
        stop_if_interrupted()?;
        appended.map_err(Error::io(if source.failed { place } else { out }))?;
        let packed = FileRef {
            path: member.path.clone(),
            bytes: source.hasher.count(),
            blake3: source.hasher.finalize().into(),
        };
        let changed = packed.bytes != bytes || known.is_some_and(|known| known.blake3 != packed.blake3);
        if changed {
            let what = "the file changed while it was packed; run the command again";
            return Err(Error::unready(place.display(), what));
        }
        files.push(packed);
    }
    let mut sink = tar.into_inner().and_then(zstd::Encoder::finish).map_err(Error::io(out))?;
    sink.flush().map_err(Error::io(out))?;
    Ok(files)
}

/// A reader that keeps the BLAKE3 of what went through it, and whether it failed.
struct Hashed<'a, R> {
    inner: R,
    hasher: blake3::Hasher,
    failed: bool,
    progress: &'a dyn Meter,
}

impl<R: Read> Read for Hashed<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        stop_if_interrupted().map_err(io::Error::other)?;
        let read = self.inner.read(buffer).inspect_err(|_| self.failed = true)?;
        self.hasher.update(&buffer[..read]);
        self.progress.advance(read as u64);
        Ok(read)
    }
}

/// What a look into an archive found.
pub(super) struct Examined {
    /// The archive's own sum.
    pub sha256: String,
    pub faults: Vec<Error>,
    /// The content of the files that were to be kept.
    pub kept: BTreeMap<String, Vec<u8>>,
}

/// Reads an archive to its end and compares each file with what is `listed`. Nothing is written, and memory
/// does not grow with what the archive claims; the content of files that `keep` names is kept, up to
/// [`MAX_TEXT_BYTES`].
pub(super) fn examine(
    path: &Path,
    listed: &[FileRef],
    keep: impl Fn(&str) -> bool,
    progress: &dyn Meter,
) -> Result<Examined> {
    let file = File::open(path).map_err(Error::io(path))?;
    let mut source = Summed::new(file, progress);
    let (mut faults, mut kept) = (Vec::new(), BTreeMap::new());
    if let Err(fault) = entries(path, &mut source, listed, keep, &mut faults, &mut kept) {
        faults.push(fault);
    }
    let sha256 = source.finish();
    stop_if_interrupted()?;
    Ok(Examined { sha256: sha256.map_err(Error::io(path))?, faults, kept })
}

fn entries(
    path: &Path,
    source: &mut Summed<File>,
    listed: &[FileRef],
    keep: impl Fn(&str) -> bool,
    faults: &mut Vec<Error>,
    kept: &mut BTreeMap<String, Vec<u8>>,
) -> Result<()> {
    let damaged = |error: io::Error| Error::invalid(path.display(), format!("damaged archive: {error}"));
    let mut decoder = zstd::Decoder::new(source).map_err(damaged)?;
    decoder.window_log_max(MAX_WINDOW_LOG).map_err(damaged)?;
    let mut tar = tar::Archive::new(decoder);
    let mut missing: BTreeMap<&str, &FileRef> = listed.iter().map(|file| (&*file.path, file)).collect();
    // Raw: headers of extensions, which a reader would hold in memory, are entries like others, and none that
    // is expected.
    for entry in tar.entries().map_err(damaged)?.raw(true) {
        let mut entry = entry.map_err(damaged)?;
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let wrong = |what: String| Error::invalid(format!("{}, entry {name:?}", path.display()), what);
        let kind = entry.header().entry_type();
        if kind != tar::EntryType::Regular {
            return Err(wrong(format!("entry type {kind:?}; expected only regular files")));
        }
        if !name.split('/').all(is_component) {
            return Err(wrong("leads out of the folder; expected a path inside it".into()));
        }
        let Some(expected) = missing.remove(&*name) else {
            return Err(wrong(format!("not in {}, or twice in the archive", super::MANIFEST)));
        };
        if entry.size() != expected.bytes {
            let (found, expected) = (entry.size(), expected.bytes);
            return Err(wrong(format!("{found} bytes; {} says {expected}", super::MANIFEST)));
        }
        let mut hasher = blake3::Hasher::new();
        if keep(&name) {
            if entry.size() > MAX_TEXT_BYTES {
                return Err(wrong(format!("{} bytes; expected at most {MAX_TEXT_BYTES}", entry.size())));
            }
            let mut content = Vec::new();
            entry.read_to_end(&mut content).map_err(damaged)?;
            hasher.update(&content);
            kept.insert(name.clone(), content);
        } else {
            io::copy(&mut entry, &mut hasher).map_err(damaged)?;
        }
        if hasher.count() != expected.bytes {
            return Err(damaged(io::ErrorKind::UnexpectedEof.into()));
        }
        if Digest::from(hasher.finalize()) != expected.blake3 {
            faults.push(wrong(format!("the content is not that of {}", super::MANIFEST)));
        }
    }
    // Zeros alone may follow; the stream's own checksum stands at its end.
    let mut rest = tar.into_inner();
    let (mut buffer, mut padding) = ([0; 4096], 0);
    loop {
        let read = rest.read(&mut buffer).map_err(damaged)?;
        padding += read as u64;
        if buffer[..read].iter().any(|&byte| byte != 0) || padding > MAX_PADDING {
            return Err(Error::invalid(path.display(), "data after the end of the archive"));
        }
        if read == 0 {
            break;
        }
    }
    let absent = |file: &&FileRef| {
        Error::invalid(format!("{}, entry {:?}", path.display(), file.path), "not in the archive")
    };
    faults.extend(missing.values().map(absent));
    Ok(())
}
