//! The binary `bake` as a user meets it: killed and continued, its flags, bad input, one JSON object.

// (Not all helpers are used by every target.)
#[allow(dead_code)]
#[path = "../../../tests/common/mod.rs"]
mod common;
mod lost;
mod new;
mod existing;
mod stopped;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn bake(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_bake")).args(arguments).output().unwrap()
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures").join(name)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The content of every file the manifest stands for, by name.
fn data(dataset: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(dataset.join("data"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .map(|p| (p.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(p).unwrap()))
        .collect();
    files.push(("config.json".to_owned(), std::fs::read(dataset.join("config.json")).unwrap()));
    files.sort();
    files
}

const INTEGRATORS: [&str; 2] = ["cached", "path"];

/// Bakes three hours of the court; `samples` per texel.
fn court(out: &Path, samples: &str, integrator: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
    command.args(["--hours", "9,12,18.1", "--quiet", "--samples", samples, "--out", text(out)]);
    command.args(["--integrator", integrator]);
    command.arg(fixture("court.toml"));
    command
}

/// Starts a bake of the court and kills it midway; whether it was still running.
fn kill_midway(out: &Path, samples: &str, integrator: &str) -> bool {
    let killed = kill_after_a_round(&mut court(out, samples, integrator), out);
    assert!(!killed || !out.join("config.json").exists());
    killed
}

/// Starts a bake and kills it with SIGKILL as soon as a round is on disk; whether it was still running.
fn kill_after_a_round(command: &mut Command, out: &Path) -> bool {
    let mut child = command.stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let has_rounds = || {
        let folders = std::fs::read_dir(out.join(".bake")).into_iter().flatten().flatten();
        folders.map(|f| f.path().join("rounds.json")).any(|p| p.exists())
    };
    while !has_rounds() && child.try_wait().unwrap().is_none() && start.elapsed() < Duration::from_secs(600) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    !child.wait().unwrap().success()
}

#[test]
fn a_killed_bake_continues_to_the_same_bytes() {
    for integrator in INTEGRATORS {
        let dir = tempfile::tempdir().unwrap();
        let (whole, killed) = (dir.path().join("whole"), dir.path().join("killed"));
        assert!(court(&whole, "128", integrator).status().unwrap().success());
        // Killed twice.
        let midway = (0..2).filter(|_| kill_midway(&killed, "128", integrator)).count();
        assert!(midway > 0, "the bake was too quick to be killed");
        assert!(court(&killed, "128", integrator).status().unwrap().success());
        assert_eq!(data(&whole), data(&killed));
        assert!(!killed.join(".bake").exists());
    }
}

#[test]
fn what_is_traced_again_for_a_target_continues_where_it_was_killed() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, whole, killed) =
        (dir.path().join("court.toml"), dir.path().join("whole"), dir.path().join("killed"));
    std::fs::copy(fixture("court.obj"), dir.path().join("court.obj")).unwrap();
    let lamp = |lumens: &str| {
        let text = std::fs::read_to_string(fixture("court.toml")).unwrap();
        std::fs::write(&scene, text.replace("lumens = 800", &format!("lumens = {lumens}"))).unwrap();
    };
    let bake = |out: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        command.args([text(&scene), "--hours", "20", "--samples", "8192", "--target-error", "4%"]);
        command.args(["--integrator", "path", "--out", text(out)]);
        command
    };
    lamp("0.000001");
    for out in [&whole, &killed] {
        assert!(bake(out).arg("--quiet").status().unwrap().success());
    }
    lamp("80000");
    assert!(bake(&whole).arg("--quiet").status().unwrap().success());
    assert!(kill_after_a_round(&mut bake(&killed), &killed), "the bake was too quick to be killed");
    let output = bake(&killed).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("continuing after"), "{said}");
    assert!(data(&whole) == data(&killed) && !killed.join(".bake").exists());
}

#[test]
fn inputs_that_are_missing_or_of_another_kind_are_named_with_what_was_expected() {
    let dir = tempfile::tempdir().unwrap();
    let (none, scene) = (dir.path().join("none"), fixture("court.toml"));
    let (none, folder, scene) = (text(&none), text(dir.path()), text(&scene));
    let drawn = |option, path| vec!["preview", scene, "--hour", "12", option, path];
    for (arguments, path, expected) in [
        (vec![none], none, "no such file; expected a scene"),
        (vec![folder], folder, "is a folder; expected a scene file"),
        (vec!["preview", none, "--hour", "12"], none, "no such file; expected a scene"),
        (vec!["new", none], none, "no such file; expected a model"),
        (
            drawn("--bundle", none),
            none,
            "no such file; expected a bundle, a .ndgi file, as `compress <dataset>`",
        ),
        (drawn("--bundle", folder), folder, "is a folder; expected a bundle"),
        (drawn("--dataset", none), none, "no finished dataset; expected one of the scene \"court\""),
    ] {
        let output = bake(&arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        let expected = format!("error: {path}: {expected}");
        assert!(output.status.code() == Some(1) && said.contains(&expected), "{arguments:?}: {said}");
        assert!(!said.contains("os error"), "{said}");
    }
}

#[test]
fn what_a_killed_bake_left_does_not_change_another_one() {
    let dir = tempfile::tempdir().unwrap();
    let (fresh, left) = (dir.path().join("fresh"), dir.path().join("left"));
    assert!(court(&fresh, "4", "cached").status().unwrap().success());
    // Its first round alone has more samples than are asked for next.
    assert!(kill_midway(&left, "256", "path"), "the bake was too quick to be killed");
    assert!(court(&left, "4", "cached").arg("--force").status().unwrap().success());
    assert_eq!(data(&fresh), data(&left));
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    for integrator in INTEGRATORS {
        let of_threads = |threads: &str| {
            let out = dir.path().join(format!("{integrator}-{threads}"));
            let mut command = court(&out, "8", integrator);
            assert!(command.env("RAYON_NUM_THREADS", threads).status().unwrap().success());
            data(&out)
        };
        let one = of_threads("1");
        assert!(one == of_threads("2") && one == of_threads("5"), "{integrator}");
    }
    // Of a transfer, too, with the light that it is told by.
    let transfer = |threads: &str| {
        let out = dir.path().join(format!("transfer-{threads}"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        command
            .args(["--transfer", "--quiet", "--samples", "4", "--out", text(&out)])
            .arg(fixture("court.toml"));
        assert!(command.env("RAYON_NUM_THREADS", threads).status().unwrap().success());
        data(&out)
    };
    assert!(transfer("1") == transfer("3"));
    // A target error hands out samples in rounds, by what all threads found.
    let towards = |threads: &str| {
        let out = dir.path().join(format!("target-{threads}"));
        let scene = fixture("court.toml");
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        command.args([text(&scene), "--hours", "12", "--quiet", "--target-error", "8%", "--out", text(&out)]);
        assert!(command.env("RAYON_NUM_THREADS", threads).status().unwrap().success());
        data(&out)
    };
    assert!(towards("1") == towards("2"));
}

/// Runs `bake` on the court with `--json`; it must succeed.
fn json(arguments: &[&str]) -> serde_json::Value {
    let scene = fixture("court.toml");
    let output = bake(&[&[text(&scene), "--json"], arguments].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn the_plan_predicts_by_the_bake_that_is_there() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let run = |more: &[&str]| json(&[&["--hours", "12", "--out", text(&out)], more].concat());
    assert!(run(&["--plan"])["expected"].is_null());
    let outcome = run(&["--samples", "32"]);
    // The same bake again: its own seconds and errors.
    let expected = &run(&["--plan", "--samples", "32"])["expected"];
    let worst = &outcome["local"]["frames"][outcome["local"]["worst_frame"].as_u64().unwrap() as usize];
    let point = &expected["points"][2];
    assert_eq!((&expected["from_samples"], &point["samples"]), (&32.into(), &32.into()));
    assert_eq!((&point["p95"], &point["median"]), (&worst["p95"], &outcome["local"]["all"]["median"]));
    assert!(expected["target"].is_null() && expected["points"].as_array().unwrap().len() == 5);
    // (Texels covered, and not all of them valid.)
    let [seconds, traced] =
        [&point["seconds"], &outcome["rounds"][1]["seconds"]].map(|v| v.as_f64().unwrap());
    assert!((1.0..1.3).contains(&(seconds / traced)), "{seconds} s instead of {traced}");
    let target = &run(&["--plan", "--target-error", "1%"])["expected"]["target"];
    assert!((target["p95"].as_f64().unwrap() - 0.01).abs() < 1e-3, "{target}");
    // From cells that stop early nothing is predicted.
    run(&["--samples", "256", "--target-error", "3%"]);
    assert!(run(&["--plan"])["expected"].is_null());
}

#[test]
fn a_target_error_is_reached_and_told() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let object = json(&["--hours", "12", "--target-error", "2%", "--out", text(&out)]);
    assert!(object["local"]["all"]["p95"].as_f64().unwrap() <= 0.0204, "{object}");
    assert_eq!(object["out_of_time"], false);
    let rounds = object["rounds"].as_array().unwrap();
    assert_eq!(rounds[rounds.len() - 1]["is_missed"], false);
    // Texels under the crate's edge, sampled at few points, would never reach it: no samples are spent on
    // waiting for them.
    assert!(object["samples"].as_u64().unwrap() <= 2048, "{object}");
    // Cells that were good enough got no more.
    assert!(object["mean_samples"].as_f64().unwrap() < object["samples"].as_f64().unwrap(), "{object}");
    // At most so many samples, target or not.
    let few = dir.path().join("few");
    let object = json(&["--hours", "12", "--target-error", "0.01%", "--samples", "32", "--out", text(&few)]);
    assert_eq!(object["samples"], 32);
    let last = object["rounds"].as_array().unwrap().last().unwrap();
    assert!(last["unconverged_cells"].as_u64().unwrap() > 0 && last["is_missed"] == true);
}

#[test]
fn a_time_limit_leaves_a_whole_dataset_that_says_its_error() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let start = Instant::now();
    let object = json(&["--time-limit", "1s", "--integrator", "path", "--out", text(&out)]);
    // Loading, the first round and writing come on top; a bake without the limit would take minutes.
    assert!(start.elapsed() < Duration::from_secs(60));
    assert_eq!(object["out_of_time"], true);
    let error = object["relative_error"].as_f64().unwrap();
    assert!(error > 0.0 && error < 1.0, "{error}");
    assert!(object["facts"].to_string().contains("time limit"), "{object}");
    let dataset = dataset::store::Dataset::open(&out).unwrap();
    let found = dataset.verify(|| {});
    assert!(found.faults.is_empty(), "{:?}", found.faults);
    assert!(dataset.config.frames.iter().any(|s| s.relative_error.is_some_and(|e| e > 0.0)));
    assert!(dataset.noise().unwrap().is_some());
}

#[test]
fn a_plan_traces_nothing_and_writes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let scene = fixture("court.toml");
    let arguments = [text(&scene), "--plan", "--hours", "0..24", "--extra-times", "0"];
    let run = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        let output = command.current_dir(dir.path()).args(arguments).args(more).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let words = run(&[]);
    for expected in [
        "trace sun at 6:00, 7:00 … 18:06 (14 layers)",
        "trace sky at 0:00, 5:00 … 19:00 (18 layers)",
        "trace group \"lamp\"",
        "no alpha tests: ",
    ] {
        assert!(words.contains(expected), "{words}");
    }
    let transfer = Command::new(env!("CARGO_BIN_EXE_bake"))
        .args([text(&scene), "--plan", "--transfer"])
        .current_dir(dir.path())
        .output()
        .unwrap();
    let words = String::from_utf8(transfer.stdout).unwrap();
    for expected in ["trace harmonic 0, 0, positive", "trace harmonic 3, -3, negative", "no sun and no lamps"]
    {
        assert!(words.contains(expected), "{words}");
    }
    let object: serde_json::Value = serde_json::from_str(&run(&["--json"])).unwrap();
    assert!(object["times"].as_array().unwrap().len() >= 24, "{object}");
    assert!(object["layers"].to_string().contains("lamp"), "{object}");
    assert!(object["skipped"].to_string().contains("cut-outs"), "{object}");
    assert_eq!(object["integrator"], "cached");
    assert!(object["warnings"].is_array());
    let forecast = &object["forecast"];
    assert_eq!((&forecast["size"], &forecast["pages"]), (&serde_json::json!([96, 96]), &1.into()));
    assert!(forecast["escaping_rays"].as_u64().unwrap() > 100, "{forecast}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "a plan wrote something");
}

#[test]
fn a_plan_lists_the_extra_times_and_what_they_avoid() {
    let scene = fixture("court.toml");
    let run = |more: &[&str]| {
        let output = bake(&[&[text(&scene), "--plan"], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let object = |more: &[&str]| -> serde_json::Value {
        serde_json::from_str(&run(&[more, &["--json"]].concat())).unwrap()
    };
    let times = |object: &serde_json::Value| object["times"].as_array().unwrap().len();
    let (day, without) = (object(&[]), object(&["--extra-times", "0"]));
    let added = day["extra_times"]["added"].as_array().unwrap();
    assert_eq!((times(&day), added.len()), (times(&without) + 6, 6));
    let errors = |object: &serde_json::Value| {
        ["error_before", "error_after"].map(|key| object["extra_times"][key].as_f64().unwrap())
    };
    let [before, after] = errors(&day);
    assert!(after < 0.5 * before, "{before} {after}");
    assert_eq!(errors(&without), [before; 2]);
    for time in added {
        assert!(day["times"].as_array().unwrap().contains(&time["hour"]), "{time}");
        assert!(time["error_after"].as_f64() < time["error_before"].as_f64(), "{time}");
    }
    assert_eq!(run(&[]).lines().filter(|line| line.starts_with("  extra time ")).count(), 6);
    assert!(run(&["--extra-times", "1"]).contains("  no more than 1 extra time (--extra-times)"));
    // One hour is not a range, and has no time between.
    let noon = object(&["--hours", "12"]);
    assert_eq!((times(&noon), &noon["visibility"]), (1, &serde_json::Value::Null));
    assert_eq!(day["visibility"]["minutes"], 15.0);
    assert_eq!(object(&["--final"])["visibility"]["minutes"], 2.5);
    assert!(run(&[]).contains("find the sun's visibility at "));
    assert!(run(&["--hours", "12"]).contains("  no visibility of the sun over time: one time is baked"));
    assert!(run(&["--indirect"]).contains("  no visibility of the sun: its direct light is not baked"));
}

#[test]
fn a_plan_of_a_scene_with_glowing_surfaces_is_told() {
    // A lit box around its own light: rays from its walls meet what glows.
    let dir = tempfile::tempdir().unwrap();
    let square = |y: f64, order: &str| {
        let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)];
        corners.iter().map(|(x, z)| format!("v {x} {y} {z}\n")).collect::<String>() + &format!("f {order}\n")
    };
    std::fs::write(dir.path().join("a.obj"), square(0.0, "1 2 3 4") + &square(1.0, "8 7 6 5")).unwrap();
    let scene = dir.path().join("glow.toml");
    let words = "[sky]\nmodel = \"constant\"\nradiance = [1, 1, 1]\n[[object]]\nfile = \"a.obj\"\nalbedo = 0.5\n\
        emission = [1, 1, 1]\ngroup = \"glow\"\n[[group]]\nname = \"glow\"\n[lightmap]\nsize = 16\n";
    std::fs::write(&scene, words).unwrap();
    let output = bake(&[text(&scene), "--plan", "--hours", "12", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(told["forecast"]["size"], serde_json::json!([16, 16]));
}

#[test]
fn a_check_tells_the_measured_error() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let object = json(&["--hours", "12", "--samples", "16", "--check", "256", "--out", text(&out)]);
    let check = &object["check"];
    assert_eq!((&check["samples"], &check["texels"]), (&256.into(), &512.into()));
    let set = &check["frames"][0];
    let number = |key: &str| set[key].as_f64().unwrap_or_else(|| panic!("no {key}: {check}"));
    // The true error is of the size of the estimate; with a cache, a little more.
    let (real, estimated) = (number("measured_error"), number("estimated_error"));
    assert!(real > 0.0 && estimated > 0.0 && real < 3.0 * estimated + 0.02, "{check}");
    assert!(number("mean_difference").abs() < 0.02 && number("reference_noise") < 0.2, "{check}");
}

#[test]
fn json_is_one_object_with_the_documented_keys() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    let output = bake(&[
        text(&fixture("court.toml")),
        "--hours",
        "12",
        "--samples",
        "4",
        "--json",
        "--out",
        text(&out),
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for key in [
        "scene",
        "dataset",
        "up_to_date",
        "integrator",
        "size",
        "pages",
        "frames",
        "texels",
        "samples",
        "mean_samples",
        "layers",
        "relative_error",
        "out_of_time",
        "seconds",
        "rays",
        "rounds",
        "facts",
        "skipped",
        "warnings",
        "report",
    ] {
        assert!(object.get(key).is_some(), "no key {key}");
    }
    assert_eq!(object["frames"], 1);
    // The scene comes first.
    let report = std::fs::read_to_string(object["report"].as_str().unwrap()).unwrap();
    let (lead, _) = report.split_once("<nav>").unwrap();
    assert!(lead.contains("<figcaption>12 h</figcaption>") && lead.matches("<img").count() == 1);
    // At noon the lamps are off: nothing of them is traced, and the run says so.
    assert_eq!(object["rays"]["lamp"], 0);
    assert!(object["skipped"].to_string().contains("lamp"));
}

#[test]
fn bad_input_is_refused_with_its_place_and_nothing_is_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    assert!(
        bake(&[
            text(&fixture("court.toml")),
            "--hours",
            "12",
            "--samples",
            "2",
            "--quiet",
            "--out",
            text(&out)
        ])
        .status
        .success()
    );
    let before = data(&out);

    let obj = std::fs::read_to_string(fixture("court.obj")).unwrap();
    std::fs::write(dir.path().join("court.obj"), obj.replacen("v 4 0 -4", "v 4 nan -4", 1)).unwrap();
    std::fs::copy(fixture("court.toml"), dir.path().join("court.toml")).unwrap();
    let scene = dir.path().join("court.toml");
    let check = |arguments: &[&str], expected: &[&str]| {
        let output = bake(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{message}");
        for word in expected {
            assert!(message.contains(word), "{message:?} does not say {word:?}");
        }
        assert_eq!(data(&out), before);
    };
    let told = ["court.obj", "v 4 NaN -4: expected finite numbers"];
    check(&[text(&scene), "--hours", "12", "--out", text(&out)], &told);
    let toml = std::fs::read_to_string(&scene).unwrap();
    let far = dir.path().join("far.toml");
    std::fs::copy(fixture("court.obj"), dir.path().join("whole.obj")).unwrap();
    let object = "file = \"whole.obj\"\ntranslate = [1e13, 0, 0]";
    std::fs::write(&far, toml.replacen("file = \"court.obj\"", object, 1)).unwrap();
    check(&[text(&far), "--hours", "12", "--out", text(&out)], &["expected 1e12 from zero at most"]);
    check(&[text(&scene), "--hours", "25", "--out", text(&out)], &["--hours", "25"]);
    check(&["no-such.toml", "--out", text(&out)], &["no-such.toml"]);
    check(
        &[text(&fixture("court.toml")), "--samples", "3", "--out", text(&out)],
        &["--samples", "power of two"],
    );
    check(
        &[text(&fixture("court.toml")), "--time-limit", "30s", "--samples", "5", "--out", text(&out)],
        &["--samples", "power of two"],
    );
    #[cfg(not(feature = "embree"))]
    check(
        &[text(&fixture("court.toml")), "--backend", "embree", "--force", "--out", text(&out)],
        &["embree", "not in this build", "--features embree"],
    );
}

#[test]
fn bad_values_of_flags_are_usage_errors() {
    let scene = fixture("court.toml");
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("court");
    for (flag, values, expected) in [
        ("--target-error", &["0", "0%", "100%", "2", "-1%", "nan", "inf", "two", "%", ""][..], "such as 2%"),
        ("--time-limit", &["0s", "5", "-5m", "0.5s", "1d", "nans", "infh", "s", ""][..], "such as 90s"),
        ("--integrator", &["bdpt", ""][..], "cached"),
        ("--backend", &["optix", "Embree", ""][..], "expected obvhs or embree"),
        ("--check", &["1", "0", "-1", "many"][..], "--check"),
        ("--samples", &["-1", "1.5", "many"][..], "--samples"),
        ("--threads", &["0", "-1", "1025", "all", ""][..], "expected a number of threads from 1 to 1024"),
    ] {
        for value in values {
            let output = bake(&[text(&scene), &format!("{flag}={value}"), "--out", text(&out)]);
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{flag} {value}: {message}");
            assert!(message.contains(expected), "{flag} {value}: {message}");
        }
    }
    assert!(!out.exists());
}

#[test]
fn a_size_that_a_draft_halves_is_refused_by_its_line() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("court.toml");
    let words = std::fs::read_to_string(fixture("court.toml")).unwrap().replace("size = 96", "size = 1");
    let line = 1 + words.lines().position(|line| line == "size = 1").unwrap();
    std::fs::write(&scene, words).unwrap();
    std::fs::copy(fixture("court.obj"), dir.path().join("court.obj")).unwrap();
    let written = format!("error: {}:{line}: size = 1", text(&scene));
    for plan in [&["--plan"][..], &[]] {
        for (draft, expected) in [
            (&["--draft"][..], ", halved by --draft: size 1 x 1: no chart fits at any density"),
            (&[], ": size 1 x 1: no chart fits at any density"),
        ] {
            let out = dir.path().join("court");
            let output = bake(&[&[text(&scene), "--hours", "12", "--out", text(&out)], plan, draft].concat());
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{message}");
            assert!(message.contains(&format!("{written}{expected}")), "{message}");
            assert!(message.contains("at least 2 x 2"), "{message}");
        }
    }
}

#[test]
fn a_model_for_a_scene_is_told_how_it_becomes_one() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("court.obj");
    std::fs::copy(fixture("court.obj"), &model).unwrap();
    let output = bake(&[text(&model), "--plan"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    let (said, scene) = message.split_once(":\n").unwrap();
    assert!(said.starts_with(&format!("error: {}: is a model; expected a scene", text(&model))), "{message}");
    assert_eq!(scene.lines().count(), 3, "{message}");
    // They are what they are said to be.
    let file = dir.path().join("court.toml");
    std::fs::write(&file, scene).unwrap();
    let output = bake(&[text(&file), "--plan", "--hours", "12"]);
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("trace sky"), "{output:?}");
}

#[test]
fn a_time_limit_ends_a_round_within_a_block() {
    let dir = tempfile::tempdir().unwrap();
    let words = std::fs::read_to_string(fixture("court.toml")).unwrap().replace("size = 96", "size = 32");
    std::fs::write(dir.path().join("court.toml"), words).unwrap();
    std::fs::copy(fixture("court.obj"), dir.path().join("court.obj")).unwrap();
    // The page is one block, and the last round would take as long as all before it. (The limit may fall into
    // the last slice.)
    let is_cut = ["1s", "1.4s", "1.8s"].iter().any(|limit| {
        let (scene, out) = (dir.path().join("court.toml"), dir.path().join(limit));
        let output =
            bake(&[text(&scene), "--hours", "12", "--time-limit", limit, "--json", "--out", text(&out)]);
        assert!(output.status.success(), "{output:?}");
        let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let (mean, most) = (object["mean_samples"].as_f64().unwrap(), object["samples"].as_f64().unwrap());
        let found = dataset::store::Dataset::open(&out).unwrap().verify(|| {});
        assert!(found.faults.is_empty(), "{:?}", found.faults);
        object["out_of_time"] == true && mean > most / 2.0 && mean < most
    });
    assert!(is_cut, "a block was never left before its round was done");
}

#[test]
fn a_group_whose_light_reaches_nothing_is_told() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n").unwrap();
    let lamp = |name: &str, y: f64| {
        format!(
            "[[group]]\nname = \"{name}\"\n[[group.sphere]]\ncentre = [0.2, {y}, -0.2]\nradius = 0.05\nradiance = [1, 1, 1]\n"
        )
    };
    let text_of = format!(
        "[[object]]\nfile = \"a.obj\"\n{}{}[lightmap]\nsize = 8\n",
        lamp("above", 1.0),
        lamp("below", -1.0)
    );
    let scene = dir.path().join("s.toml");
    std::fs::write(&scene, text_of).unwrap();
    let output =
        bake(&[text(&scene), "--hours", "12", "--samples", "2", "--out", text(&dir.path().join("out"))]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("no light of the group \"below\"") && !said.contains("\"above\""), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn an_answer_that_cannot_be_written_is_an_error() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let scene = fixture("court.toml");
    let output = Command::new(env!("CARGO_BIN_EXE_bake"))
        .args([text(&scene), "--plan"])
        .stdout(full)
        .output()
        .unwrap();
    // (A full disk: the same command can succeed later.)
    assert_eq!(output.status.code(), Some(75));
    assert!(String::from_utf8(output.stderr).unwrap().contains("standard output"));
}

#[test]
fn more_groups_than_files_may_be_open_at_first() {
    let dir = tempfile::tempdir().unwrap();
    let group = |i: usize| {
        format!(
            "[[group]]\nname = \"lamp {i}\"\non = [[\"00:00\", \"24:00\"]]\n[[group.sphere]]\ncentre = [{i}, 3, 0]\nradius = 0.1\n\
            radiance = [5, 5, 5]\n"
        )
    };
    let groups: String = (0..60).map(group).collect();
    let scene = "[[object]]\nfile = \"a.obj\"\nalbedo = 0.5\n[lightmap]\nsize = 16\n[bake]\nsamples = 2\n";
    std::fs::write(dir.path().join("a.obj"), "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nf 1 2 3 4\n").unwrap();
    std::fs::write(dir.path().join("many.toml"), format!("{scene}{groups}")).unwrap();
    // A shell whose children may open 64 files, and ask for more.
    let command =
        format!("ulimit -Sn 64; exec {} many.toml --hours 12 --out out --quiet", env!("CARGO_BIN_EXE_bake"));
    let output = Command::new("sh").args(["-c", &command]).current_dir(dir.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
