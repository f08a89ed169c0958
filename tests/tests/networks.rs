//! `bake`, `compress` and `dataset release` in folders of a network: without `flock`, where open files can be
//! neither replaced nor removed, where what another machine did is not seen at once, with other machines'
//! processes and clocks. The programs run under a library ([`pipeline_tests::faults`]) that makes it so.
//!
//! `cargo test --release -p pipeline-tests --test networks`

use dataset::host::CLAIM;
use dataset::store::Dataset;
use pipeline_tests::faults::{Faults, Tree, copy, court, differences, program, text};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, SystemTime};

/// A scene, and what is made of it under the library.
struct Place {
    faults: Faults,
    scene: PathBuf,
    out: PathBuf,
}

impl Place {
    fn new() -> Self {
        let faults = Faults::new();
        let root = faults.root().to_owned();
        let scene = court(&root, 16, 800);
        fs::create_dir(root.join("shared")).unwrap();
        Place { scene, out: root.join("shared/court"), faults }
    }

    fn under(&self, mut command: Command, settings: &[(&str, &str)]) -> Command {
        self.faults.over(&mut command, &self.faults.root().join("shared"));
        command.envs(settings.iter().copied());
        command
    }

    fn bake(&self, hours: &str, settings: &[(&str, &str)]) -> Output {
        let mut command = program("bake");
        command.arg(&self.scene).args(["--hours", hours, "--samples", "16", "--out"]).arg(&self.out);
        self.under(command, settings).output().unwrap()
    }

    fn compress(&self, iterations: &str, settings: &[(&str, &str)]) -> Output {
        let mut command = program("compress");
        command.arg(&self.out).args(["--quiet", "--iterations", iterations]);
        self.under(command, settings).output().unwrap()
    }

    fn release(&self, name: &str, settings: &[(&str, &str)]) -> Output {
        let mut command = program("dataset");
        command.arg("release").arg(&self.out).args(["--quiet", "--out"]).arg(self.release_at(name));
        self.under(command, settings).output().unwrap()
    }

    fn release_at(&self, name: &str) -> PathBuf {
        self.faults.root().join("shared").join(name)
    }

    /// All three, one after the other.
    fn all(&self, settings: &[(&str, &str)]) {
        for output in
            [self.bake("11,12", settings), self.compress("20", settings), self.release("release", settings)]
        {
            assert!(output.status.success(), "{}", text(&output));
        }
    }

    /// What they made, without what tells of the runs; its paths begin in the shared folder.
    fn made(&self) -> Tree {
        let mut tree = Tree::read(&self.faults.root().join("shared"));
        let told = ["run.json", "report.html", ".run.json", "court.html", ".lock", ".rounds"];
        let is_told = |path: &Path| told.iter().any(|name| path.to_string_lossy().ends_with(name));
        tree.0.iter_mut().filter(|(path, _)| is_told(path)).for_each(|(_, content)| *content = None);
        tree
    }

    /// The lines of a journal that begin so.
    fn told(&self, journal: &Path, kind: &str) -> Vec<String> {
        let text = fs::read_to_string(journal).unwrap_or_default();
        text.lines().filter(|line| line.starts_with(kind)).map(str::to_owned).collect()
    }

    fn hours(&self) -> usize {
        let dataset = Dataset::open(&self.out).unwrap();
        assert!(dataset.verify(|| {}).faults.is_empty());
        dataset.config.frames.len()
    }
}

fn string(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn on_networks_of_all_kinds_the_same_is_made_and_nothing_stays() {
    let plain = Place::new();
    plain.all(&[]);
    let expected = plain.made();
    assert!(expected.0.contains_key(Path::new("release/court.ndgi")), "{:?}", expected.0.keys());
    for settings in [
        &[("FAULTS_FLOCK", "fail")][..],
        &[("FAULTS_FLOCK", "idle")],
        &[("FAULTS_BUSY", "/")],
        &[("FAULTS_SILLY", "1"), ("FAULTS_FLOCK", "fail")],
    ] {
        let place = Place::new();
        let journal = place.faults.root().join("journal");
        let all = [settings, &[("FAULTS_JOURNAL", string(&journal))]].concat();
        place.all(&all);
        let (found, busy) = (place.made(), place.told(&journal, "busy"));
        let other = differences(&found, &expected, |_| true);
        assert!(other.is_empty() && busy.is_empty(), "{settings:?}: {other:?} {busy:?}");
        if settings.iter().any(|(name, _)| *name == "FAULTS_SILLY") {
            assert!(!place.told(&journal, "silly").is_empty());
        }
    }
}

#[test]
fn what_cannot_be_replaced_is_refused_and_stays_whole() {
    let place = Place::new();
    place.all(&[]);
    let before = place.made();
    // Another program reads the manifest, and later the bundle.
    let manifest = place.out.join("config.json");
    let refused = place.bake("11,12,13", &[("FAULTS_BUSY", string(&manifest))]);
    assert_eq!(refused.status.code(), Some(75), "{}", text(&refused));
    assert!(text(&refused).contains("config.json") && text(&refused).contains("busy"), "{}", text(&refused));
    assert_eq!(place.hours(), 2);
    let bundle = place.out.join("court.ndgi");
    let refused = place.compress("30", &[("FAULTS_BUSY", string(&bundle))]);
    assert_eq!(refused.status.code(), Some(75), "{}", text(&refused));
    assert!(text(&refused).contains("court.ndgi") && text(&refused).contains("busy"), "{}", text(&refused));
    let after = place.made();
    assert_eq!(before.0.get(Path::new("court/court.ndgi")), after.0.get(Path::new("court/court.ndgi")));
    let temporaries =
        after.0.keys().filter(|path| path.to_string_lossy().contains(".tmp-")).collect::<Vec<_>>();
    assert!(temporaries.is_empty(), "{temporaries:?}");
    // When it is closed, the same commands go on.
    for output in [place.bake("11,12,13", &[]), place.compress("30", &[])] {
        assert!(output.status.success(), "{}", text(&output));
    }
    assert_eq!(place.hours(), 3);
}

#[test]
fn what_another_machine_just_made_is_not_replaced_by_less() {
    let place = Place::new();
    place.all(&[]);
    let root = place.faults.root();
    let journal = root.join("journal");
    // What the other machine asked for before any of it was there.
    let stale = |list: &str, names: &[&str]| {
        let paths = names.iter().map(|name| place.out.join(name).display().to_string() + "\n");
        fs::write(root.join(list), paths.collect::<String>()).unwrap();
        root.join(list).display().to_string()
    };
    let all =
        stale("all", &["config.json", "run.json", "scene.glb", "report.html", "data", ".layers", ".bake"]);
    let bundle = stale("bundle", &["court.ndgi", "court.ndgi.run.json"]);
    let dataset = [("FAULTS_STALE", &*all), ("FAULTS_JOURNAL", string(&journal))];
    let bundle = [("FAULTS_STALE", &*bundle), ("FAULTS_JOURNAL", string(&journal))];
    let before = place.made();
    let refused = place.bake("12", &dataset);
    assert!(!refused.status.success() && text(&refused).contains("hour"), "{}", text(&refused));
    let refused = place.compress("10", &bundle);
    assert!(
        !refused.status.success() && text(&refused).contains("trained for 20 steps"),
        "{}",
        text(&refused)
    );
    assert!(!place.told(&journal, "stale").is_empty());
    assert!(before == place.made());
    // The same bake is done, or done again, to the same bytes.
    for output in [place.bake("11,12", &dataset), place.compress("20", &bundle)] {
        assert!(output.status.success(), "{}", text(&output));
    }
    let other = differences(&place.made(), &before, |_| true);
    assert!(other.is_empty(), "{other:?}");
}

/// A machine: what tells it from others.
fn machine(root: &Path, name: &str, hostname: &str, namespace: &str, boot: &str) -> String {
    let folder = root.join(name);
    fs::create_dir(&folder).unwrap();
    for (file, content) in [
        ("hostname", hostname),
        ("machine-id", "0123456789abcdef"),
        ("boot_id", boot),
        ("pid-namespace", namespace),
    ] {
        fs::write(folder.join(file), content).unwrap();
    }
    string(&folder).to_owned()
}

#[test]
fn two_machines_in_one_folder_leave_each_other_alone() {
    for flock in ["fail", "idle"] {
        let place = Place::new();
        let root = place.faults.root();
        let one = machine(root, "one", "node1", "pid:[1]", "a");
        // Another machine, and another container on the first: of one name, with process ids of its own.
        let others =
            [machine(root, "two", "node2", "pid:[1]", "b"), machine(root, "three", "node1", "pid:[2]", "a")];
        let journal = root.join("journal");
        let bake = |of: &str, more: &[(&str, &str)]| {
            place.bake("11,12", &[&[("FAULTS_HOST", of), ("FAULTS_FLOCK", flock)], more].concat())
        };
        // Killed in the middle of it: its claim and a temporary stay.
        let killed = bake(&one, &[("FAULTS_AT", "40"), ("FAULTS_JOURNAL", string(&journal))]);
        assert!(killed.status.code().is_none(), "{}", text(&killed));
        let claim = place.out.join(CLAIM);
        let held = fs::read_to_string(&claim).unwrap();
        assert!(held.contains("node1"), "{held}");
        let before = place.made();
        for other in &others {
            // (A process with the id of the holder runs here; it is another.)
            let mut told: serde_json::Value = serde_json::from_str(&held).unwrap();
            for pid in [told["pid"].as_u64().unwrap(), u64::from(std::process::id())] {
                told["pid"] = pid.into();
                fs::write(&claim, told.to_string()).unwrap();
                let refused = bake(other, &[]);
                let said = text(&refused);
                assert_eq!(refused.status.code(), Some(75), "{said}");
                assert!(
                    said.contains("another bake is writing here")
                        && said.contains(&format!("remove {}", claim.display())),
                    "{said}"
                );
            }
            fs::write(&claim, &held).unwrap();
            assert!(before == place.made(), "{flock}: files of another machine were touched");
        }
        // The machine itself takes the claim over, and goes on; then the others find it done.
        for host in [&one, &others[0]] {
            let done = bake(host, &[]);
            assert!(done.status.success(), "{}", text(&done));
        }
        assert!(!claim.exists() && place.hours() == 2);
        let left = place.made().0.into_keys().filter(|path| path.to_string_lossy().contains(".tmp-")).count();
        assert_eq!(left, 0);
    }
}

#[test]
fn after_a_restart_of_the_machine_its_claims_are_free() {
    let place = Place::new();
    let root = place.faults.root();
    let (before, after) =
        (machine(root, "before", "node1", "pid:[1]", "a"), machine(root, "after", "node1", "pid:[1]", "b"));
    let killed =
        place.bake("11,12", &[("FAULTS_HOST", &before), ("FAULTS_FLOCK", "fail"), ("FAULTS_AT", "40")]);
    assert!(killed.status.code().is_none() && place.out.join(CLAIM).exists(), "{}", text(&killed));
    // Its process's id is that of another by now.
    let claim = place.out.join(CLAIM);
    let mut told: serde_json::Value = serde_json::from_slice(&fs::read(&claim).unwrap()).unwrap();
    told["pid"] = std::process::id().into();
    fs::write(&claim, told.to_string()).unwrap();
    let done = place.bake("11,12", &[("FAULTS_HOST", &after), ("FAULTS_FLOCK", "fail")]);
    assert!(done.status.success() && place.hours() == 2, "{}", text(&done));
}

#[test]
fn clocks_that_are_wrong_by_an_hour_change_nothing() {
    let plain = Place::new();
    plain.all(&[]);
    let expected = plain.made();
    let hour = Duration::from_secs(3600);
    let now = SystemTime::UNIX_EPOCH + SystemTime::UNIX_EPOCH.elapsed().unwrap();
    for time in [now - hour, now + hour, SystemTime::UNIX_EPOCH] {
        let place = Place::new();
        let set = || {
            let shared = place.faults.root().join("shared");
            for (path, content) in Tree::read(&shared).0 {
                let file =
                    File::options().read(true).write(content.is_some()).open(shared.join(path)).unwrap();
                file.set_times(fs::FileTimes::new().set_modified(time).set_accessed(time)).unwrap();
            }
        };
        // Killed, with old and new times in one folder, then done.
        for at in ["30", "90"] {
            let killed = place.bake("11,12", &[("FAULTS_AT", at)]);
            assert!(killed.status.code().is_none(), "{}", text(&killed));
            set();
        }
        place.all(&[]);
        set();
        let again = [place.bake("11,12", &[]), place.compress("20", &[])];
        assert!(again.iter().all(|output| output.status.success()));
        assert!(text(&again[0]).contains("already holds this bake"), "{}", text(&again[0]));
        let other = differences(&place.made(), &expected, |_| true);
        assert!(other.is_empty(), "{other:?}");
        // A copy has the times at which it was copied.
        let moved = place.faults.root().join("moved");
        copy(&place.out, &moved);
        assert!(Dataset::open(&moved).unwrap().verify(|| {}).faults.is_empty());
    }
}
