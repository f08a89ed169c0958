//! What the commands share: the terminal, and arguments that people type.

#![warn(unreachable_pub)]

pub mod console;
pub mod typed;
