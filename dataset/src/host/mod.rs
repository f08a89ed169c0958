//! What the machine is asked for, once for all commands: whole files, locks, signals, processes. It knows no
//! format of datasets.
//!
//! In: paths and bytes. Out: durable files, locks, and whether to stop. Callers: everyone.

pub mod system;
pub mod signals;
mod process;
pub mod inputs;
pub mod files;
pub mod lock;

pub(crate) use files::NewFolder;
pub use lock::CLAIM;
pub use process::Process;
pub use signals::INTERRUPTED;
pub use system::ReadExactAt;
