//! The room of what the machine is asked for, once for all commands: files that are whole or not there,
//! locks, signals, processes. It knows no format.
//!
//! In: paths and bytes. Out: the same, durable. Callers: everyone.

pub mod system;
pub mod signals;
mod process;
pub mod files;
pub mod lock;

pub(crate) use files::NewFolder;
pub use lock::CLAIM;
pub use process::Process;
pub use signals::INTERRUPTED;
pub use system::ReadExactAt;
