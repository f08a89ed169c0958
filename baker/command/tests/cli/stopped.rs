//! A bake that is asked to stop, or killed early, and what the next one finds.

use crate::{bake, court, data, fixture, text};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Sends a signal by its name.
fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Waits until something holds, or the child has ended; whether it holds.
fn wait_until(child: &mut Child, mut holds: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < Duration::from_secs(120), "nothing happened");
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// A scene whose unwrapping takes long: one bumpy sheet of so many squares a side.
fn big(folder: &Path, side: usize) -> std::path::PathBuf {
    let mut obj = String::new();
    for (z, x) in (0..=side).flat_map(|z| (0..=side).map(move |x| (z, x))) {
        obj += &format!("v {x} {} {}\n", (x * 7919 + z * 104_729) % 13, -(z as f64));
    }
    let at = |z: usize, x: usize| z * (side + 1) + x + 1;
    for (z, x) in (0..side).flat_map(|z| (0..side).map(move |x| (z, x))) {
        obj += &format!("f {} {} {} {}\n", at(z, x), at(z, x + 1), at(z + 1, x + 1), at(z + 1, x));
    }
    std::fs::write(folder.join("big.obj"), obj).unwrap();
    let scene = folder.join("big.toml");
    let words = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"big.obj\"\nalbedo = 0.5\n[lightmap]\nsize = 4096\n";
    std::fs::write(&scene, words).unwrap();
    scene
}

/// The same command with signals at their defaults, also where this test runs in the background and ignores
/// some.
fn heeding(command: &Command) -> Command {
    let mut heeding = Command::new("env");
    heeding.arg("--default-signal=INT,HUP,TERM").arg(command.get_program()).args(command.get_args());
    heeding
}

#[test]
fn a_signal_ends_a_bake_at_every_stage() {
    let dir = tempfile::tempdir().unwrap();
    let scene = big(dir.path(), 300);
    let has_rounds = |out: &Path| {
        let works = std::fs::read_dir(out.join(".bake")).into_iter().flatten().flatten();
        works.map(|work| work.path().join("rounds.json")).any(|path| path.exists())
    };
    for (name, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        for stage in ["unwrapping", "planning", "tracing"] {
            let out = dir.path().join(format!("{name}-{stage}"));
            let mut command = match stage {
                "tracing" => {
                    // (Under a time limit the first round is short.)
                    let mut command = court(&out, "4096", "cached");
                    command.args(["--time-limit", "1h"]);
                    command
                }
                _ => {
                    let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
                    command.args([text(&scene), "--hours", "12", "--quiet", "--out", text(&out)]);
                    command
                }
            };
            if stage == "planning" {
                command.arg("--plan");
            }
            let mut command = heeding(&command);
            let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            match stage {
                // The folder is locked right before its geometry is unwrapped.
                "unwrapping" => assert!(wait_until(&mut child, || out.join(".lock").exists())),
                "planning" => std::thread::sleep(Duration::from_millis(300)),
                _ => assert!(wait_until(&mut child, || has_rounds(&out))),
            }
            assert!(child.try_wait().unwrap().is_none(), "{stage} was over before it was stopped");
            let start = Instant::now();
            signal(&child, name);
            let output = child.wait_with_output().unwrap();
            let took = start.elapsed();
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(code), "{name}, {stage}: {said}");
            assert!(took < Duration::from_secs(2), "{name}, {stage}: {took:?}");
            assert_eq!(said.matches("interrupted; run the same command again").count(), 1, "{said}");
        }
    }
}

#[test]
fn a_stopped_bake_keeps_what_was_finished_and_leaves_no_temporaries() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, out) = (dir.path().join("whole"), dir.path().join("out"));
    assert!(court(&whole, "128", "cached").status().unwrap().success());
    let mut stopped = 0;
    for after in [0, 60, 150, 300, 500] {
        let mut child = court(&out, "128", "cached").stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(after));
        if child.try_wait().unwrap().is_none() {
            signal(&child, "TERM");
            stopped += usize::from(!child.wait().unwrap().success());
        }
    }
    assert!(stopped > 1, "the bake was too quick to be stopped");
    let output = court(&out, "128", "cached").output().unwrap();
    assert!(output.status.success() && data(&whole) == data(&out), "{output:?}");
    for folder in [out.clone(), out.join("data"), out.join(".layers")] {
        assert_eq!(dataset::host::files::temporaries(&folder).unwrap(), Vec::<std::path::PathBuf>::new());
    }
}

#[test]
fn nohup_and_background_jobs_are_not_ended_by_what_they_ignore() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let scene = fixture("court.toml");
    let script = "trap '' HUP; exec \"$0\" \"$1\" --hours 12 --samples 64 --quiet --out \"$2\"";
    let mut command = Command::new("sh");
    command.args(["-c", script, env!("CARGO_BIN_EXE_bake"), text(&scene), text(&out)]);
    let mut child = command.stderr(Stdio::null()).spawn().unwrap();
    assert!(wait_until(&mut child, || out.join(".bake").exists()));
    signal(&child, "HUP");
    assert!(child.wait().unwrap().success());
}

#[test]
fn a_bake_killed_while_it_makes_its_folders_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    // In the order in which they are made.
    for made in [&[][..], &[".lock"], &[".lock", ".bake"], &[".lock", ".bake", "data"]] {
        let _ = std::fs::remove_dir_all(&out);
        std::fs::create_dir(&out).unwrap();
        for name in made {
            match *name {
                ".lock" => std::fs::write(out.join(name), b"").unwrap(),
                name => std::fs::create_dir(out.join(name)).unwrap(),
            }
        }
        let output = court(&out, "2", "cached").output().unwrap();
        assert!(output.status.success(), "{made:?}: {output:?}");
        assert!(!out.join(".bake").exists());
    }
    // A forced one that is killed after it has dropped all layers and all work, and before it has traced any.
    std::fs::remove_file(out.join("config.json")).unwrap();
    std::fs::remove_dir_all(out.join(".layers")).unwrap();
    std::fs::create_dir(out.join(".bake")).unwrap();
    assert!(court(&out, "2", "cached").status().unwrap().success());
    // A folder that is no bake's stays refused.
    std::fs::remove_file(out.join("config.json")).unwrap();
    std::fs::remove_dir_all(out.join(".layers")).unwrap();
    let output = court(&out, "2", "cached").output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
}

/// A library that gives the process another `flock`: one that fails, or one that does nothing.
fn other_flock(folder: &Path, body: &str) -> std::path::PathBuf {
    let (source, library) = (folder.join("flock.c"), folder.join("flock.so"));
    std::fs::write(&source, format!("#include <errno.h>\nint flock(int f, int o) {{ {body} }}\n")).unwrap();
    let built =
        Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&library, &source]).status().unwrap();
    assert!(built.success());
    library
}

#[cfg(target_os = "linux")]
#[test]
fn two_bakes_into_one_folder_where_flock_fails_or_does_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole");
    assert!(court(&whole, "64", "cached").status().unwrap().success());
    for (name, body) in [("fails", "errno = ENOLCK; return -1;"), ("idle", "return 0;")] {
        let folder = dir.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        let (library, out) = (other_flock(&folder, body), folder.join("out"));
        let start = || {
            let mut command = court(&out, "64", "cached");
            command.env("LD_PRELOAD", &library).stderr(Stdio::piped()).spawn().unwrap()
        };
        // A bake that is killed leaves its claim, which the next takes over.
        let mut child = start();
        assert!(wait_until(&mut child, || out.join(".bake").exists()), "{name}");
        assert!(out.join(".lock-claim").exists(), "{name}");
        child.kill().unwrap();
        child.wait().unwrap();
        let bakes: Vec<Child> = (0..3).map(|_| start()).collect();
        let outputs: Vec<_> = bakes.into_iter().map(|child| child.wait_with_output().unwrap()).collect();
        let refused: Vec<String> = outputs
            .iter()
            .filter(|output| !output.status.success())
            .map(|output| String::from_utf8_lossy(&output.stderr).into_owned())
            .collect();
        assert!(refused.len() < 3, "{name}: {refused:?}");
        assert!(refused.iter().all(|said| said.contains("another bake is writing here")), "{refused:?}");
        assert!(data(&whole) == data(&out), "{name}: other bytes");
        assert!(!out.join(".lock-claim").exists(), "{name}");
    }
}

#[test]
fn who_comes_second_is_told_whom_it_waits_for() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut first = court(&out, "4096", "cached").stderr(Stdio::null()).spawn().unwrap();
    assert!(wait_until(&mut first, || out.join(".bake").exists()));
    let scene = fixture("court.toml");
    let second = bake(&[text(&scene), "--hours", "12", "--out", text(&out)]);
    first.kill().unwrap();
    first.wait().unwrap();
    let said = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(75), "{said}");
    assert!(said.contains(&format!("another bake is writing here (process {} on ", first.id())), "{said}");
}
