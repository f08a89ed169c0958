//! Where the bytes of a bundle come from: a file, memory, or anything that reads at an offset.
//!
//! All that differs from platform to platform is here.

use std::fmt::Debug;
use std::io::{Error, ErrorKind, Result};

/// Something that reads at an offset, from several threads at once.
///
/// ```
/// use ndgi::source::ReadAt;
/// use std::io::{Error, ErrorKind, Result};
///
/// /// A bundle inside an archive.
/// #[derive(Debug)]
/// struct Part(&'static [u8]);
///
/// impl ReadAt for Part {
///     fn size(&self) -> Result<u64> {
///         Ok(self.0.len() as u64)
///     }
///
///     fn read_at(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
///         let from = usize::try_from(offset).unwrap_or(usize::MAX);
///         let found = self.0.get(from..).and_then(|rest| rest.get(..bytes.len()));
///         bytes.copy_from_slice(found.ok_or(ErrorKind::UnexpectedEof)?);
///         Ok(())
///     }
/// }
///
/// # let archive: &'static [u8] = ndgi::testing::sunny_bundle().leak();
/// let bundle = ndgi::Bundle::from_source(Part(archive))?;
/// # Ok::<(), ndgi::Error>(())
/// ```
pub trait ReadAt: Debug + Send + Sync {
    /// How many bytes there are.
    ///
    /// # Errors
    /// What the system says.
    fn size(&self) -> Result<u64>;

    /// Fills `bytes` with those from `offset` on.
    ///
    /// # Errors
    /// What the system says; `UnexpectedEof` where there are fewer.
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> Result<()>;
}

/// Bytes in memory.
pub(crate) struct Memory<T>(pub T);

impl<T: AsRef<[u8]>> Debug for Memory<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes in memory", self.0.as_ref().len())
    }
}

impl<T: AsRef<[u8]> + Send + Sync> ReadAt for Memory<T> {
    fn size(&self) -> Result<u64> {
        Ok(self.0.as_ref().len() as u64)
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        let from = usize::try_from(offset).ok();
        let range = from.and_then(|from| Some(from..from.checked_add(bytes.len())?));
        let found = range.and_then(|range| self.0.as_ref().get(range));
        bytes.copy_from_slice(found.ok_or_else(|| Error::from(ErrorKind::UnexpectedEof))?);
        Ok(())
    }
}

#[cfg(all(feature = "file", any(unix, windows)))]
impl ReadAt for std::fs::File {
    fn size(&self) -> Result<u64> {
        Ok(self.metadata()?.len())
    }

    #[cfg(unix)]
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(self, bytes, offset)
    }

    #[cfg(windows)]
    fn read_at(&self, mut offset: u64, mut bytes: &mut [u8]) -> Result<()> {
        while !bytes.is_empty() {
            match std::os::windows::fs::FileExt::seek_read(self, bytes, offset) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(read) => (offset, bytes) = (offset + read as u64, &mut bytes[read..]),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
