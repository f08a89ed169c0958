//! Writes manual pages and shell completions of `bake`, `compress` and `dataset`, from the same definitions
//! as their `--help`:
//!
//!     cargo run --release -p bake --example manpages -- OUT
//!
//! OUT gets `man1/*.1`, `bash/`, `fish/` and `zsh/`. To install for one user, copy `man1` to
//! `~/.local/share/man/`, `bash/*` to `~/.local/share/bash-completion/completions/`, `fish/*` to
//! `~/.config/fish/completions/`, and `zsh/*` to a folder of `$fpath`.

use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate_to};
use std::fs;
use std::path::Path;

// The commands themselves, of which only what clap knows is used. (What is in a binary is not a library's.)
#[allow(dead_code)]
#[path = "../src/main.rs"]
mod bake_command;
#[allow(dead_code)]
#[path = "../../../compressor/command/src/main.rs"]
mod compress_command;
#[allow(dead_code)]
#[path = "../../../dataset/commands/src/bin/dataset/main.rs"]
mod dataset_command;

/// Gives the definition of a command line.
type Define = fn() -> Command;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("expected a folder to write")?;
    let out = Path::new(&out);
    let pages = out.join("man1");
    fs::create_dir_all(&pages)?;
    let commands: [(&str, Define); 3] = [
        ("bake", bake_command::Cli::command),
        ("compress", compress_command::args::Cli::command),
        ("dataset", dataset_command::Arguments::command),
    ];
    for (name, command) in commands {
        if command().get_name() != name {
            return Err(format!("the command {name} calls itself {}", command().get_name()).into());
        }
        clap_mangen::generate_to(command(), &pages)?;
        for (shell, folder) in [(Shell::Bash, "bash"), (Shell::Fish, "fish"), (Shell::Zsh, "zsh")] {
            let folder = out.join(folder);
            fs::create_dir_all(&folder)?;
            generate_to(shell, &mut command(), name, &folder)?;
        }
    }
    for folder in ["man1", "bash", "fish", "zsh"] {
        let folder = out.join(folder);
        println!("{}: {} files", folder.display(), fs::read_dir(&folder)?.count());
    }
    Ok(())
}
