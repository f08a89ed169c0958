//! A command, ended before each of the calls by which it changes the disk.

use super::{Damage, Faults, Loss, Tree, copy, differences, text};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// How many runs go on at once.
const AT_ONCE: usize = 2;

/// A command that is ended at every call, and what must hold after that.
pub struct Sweep<'a> {
    /// What it is, for people.
    pub name: &'a str,
    /// What stands in the folder before; `None` for an empty one.
    pub start: Option<&'a Path>,
    /// The command for a folder, with one thread.
    pub command: &'a (dyn Fn(&Path) -> Command + Sync),
    /// What is wrong with what a folder holds after the command was ended: everything in it must be whole or
    /// clearly unfinished.
    pub faults: &'a (dyn Fn(&Path) -> Vec<String> + Sync),
    /// Whether the content of a file is the same at every run.
    pub is_same: fn(&Path) -> bool,
    /// Whether a file of a folder with these files counts. (What nothing refers to any more is removed by one
    /// run or the next.)
    pub counts: fn(&Tree, &Path) -> bool,
    /// What may be left after a power failure that follows a run's end: what it had removed.
    pub may_return: fn(&Path) -> bool,
}

/// What a sweep went through.
#[derive(Debug)]
pub struct Swept {
    /// Calls of an undisturbed run by kind.
    pub calls: BTreeMap<String, usize>,
    /// The points at which it was ended.
    pub points: usize,
    /// The different states of the disk from which it was run again.
    pub states: usize,
}

impl Sweep<'_> {
    /// Ends the command at every call, with each [`Loss`].
    ///
    /// # Panics
    /// With all that is wrong.
    pub fn run(&self, faults: &Faults) -> Swept {
        let begun = Instant::now();
        let work = faults.root().join(self.name.replace(' ', "-"));
        let whole = Case::new(&work, "whole");
        self.begin(&whole.folder);
        let output = self.watched(faults, &whole, 0).output().expect("it can be started");
        assert!(output.status.success(), "{}: {}", self.name, text(&output));
        let expected = self.tree(&whole.folder);
        let damage = whole.damage();
        let points = points(&damage);
        let wrong = Mutex::new(self.lost_at_the_end(&whole, &expected));

        let (next, seen) = (AtomicUsize::new(1), Mutex::new(BTreeSet::new()));
        std::thread::scope(|scope| {
            for _ in 0..AT_ONCE {
                scope.spawn(|| {
                    loop {
                        let point = next.fetch_add(1, Ordering::Relaxed);
                        if point > points || lock(&wrong).len() > 20 {
                            break;
                        }
                        let found = self.end_at(faults, &work, point, &expected, &seen);
                        lock(&wrong).extend(found);
                    }
                });
            }
        });
        let states = lock(&seen).len();
        println!(
            "{}: ended at each of {points} calls, {states} states of the disk, {:.0} s; {:?}",
            self.name,
            begun.elapsed().as_secs_f64(),
            damage.calls
        );
        let wrong = lock(&wrong);
        assert!(wrong.is_empty(), "{}:\n{}", self.name, wrong.join("\n"));
        Swept { calls: damage.calls, points, states }
    }

    fn begin(&self, folder: &Path) {
        match self.start {
            Some(start) => copy(start, folder),
            None => fs::create_dir_all(folder).expect("writable"),
        }
    }

    /// The files of a folder that count.
    fn tree(&self, folder: &Path) -> Tree {
        let all = Tree::read(folder);
        let files = all.0.iter().filter(|(path, _)| (self.counts)(&all, path));
        Tree(files.map(|(path, content)| (path.clone(), content.clone())).collect())
    }

    /// The command under the library; it is ended before call `at`, if that is not 0.
    fn watched(&self, faults: &Faults, case: &Case, at: usize) -> Command {
        let mut command = (self.command)(&case.folder);
        faults.over(&mut command, &case.folder);
        command.env("FAULTS_JOURNAL", &case.journal).env("FAULTS_KEEP", &case.keep);
        if at > 0 {
            command.env("FAULTS_AT", at.to_string());
        }
        command
    }

    /// Ends the command before a call, and gives what is wrong afterwards.
    fn end_at(
        &self,
        faults: &Faults,
        work: &Path,
        point: usize,
        expected: &Tree,
        seen: &Mutex<BTreeSet<(u64, bool)>>,
    ) -> Vec<String> {
        let case = Case::new(work, &point.to_string());
        self.begin(&case.folder);
        let output = self.watched(faults, &case, point).output().expect("it can be started");
        let is_killed = std::os::unix::process::ExitStatusExt::signal(&output.status) == Some(9);
        let mut wrong = Vec::new();
        if !is_killed {
            wrong.push(format!("call {point}: not reached: {}", text(&output)));
            return wrong;
        }
        let damage = case.damage();
        for loss in Loss::ALL.into_iter().filter(|loss| damage.is_more(*loss)).rev() {
            // The process's own state comes last: the run that continues from it changes it.
            let folder = match loss {
                Loss::Nothing => case.folder.clone(),
                _ => work.join(format!("{point}-{loss:?}")),
            };
            if loss != Loss::Nothing {
                copy(&case.folder, &folder);
                damage.apply(loss, &folder);
            }
            // (Equal states differ in what is durable of them, where the process alone was ended.)
            let is_new = lock(seen).insert((Tree::read(&folder).key(self.is_same), loss == Loss::Nothing));
            if is_new {
                let found = self.goes_on(faults, &case, &folder, loss, expected);
                wrong.extend(found.into_iter().map(|what| format!("call {point}, {loss:?}: {what}")));
            }
            if loss != Loss::Nothing {
                fs::remove_dir_all(&folder).expect("removable");
            }
        }
        if wrong.is_empty() {
            case.remove();
        }
        wrong
    }

    /// What is wrong with a folder in which the command was ended, and after the same command was given again
    /// there.
    fn goes_on(
        &self,
        faults: &Faults,
        case: &Case,
        folder: &Path,
        loss: Loss,
        expected: &Tree,
    ) -> Vec<String> {
        let mut wrong = (self.faults)(folder);
        let output = match loss {
            // The journal goes on, for the power may fail after it.
            Loss::Nothing => self.watched(faults, case, 0).output(),
            _ => (self.command)(folder).output(),
        };
        let output = output.expect("it can be started");
        if !output.status.success() {
            wrong.push(format!("the same command fails: {}", text(&output)));
            return wrong;
        }
        wrong.extend(differences(&self.tree(folder), expected, self.is_same));
        if loss == Loss::Nothing && wrong.is_empty() {
            wrong = self.lost_at_the_end(case, expected);
        }
        wrong
    }

    /// What a power failure right after the end of a run would take with it.
    fn lost_at_the_end(&self, case: &Case, expected: &Tree) -> Vec<String> {
        let damage = case.damage();
        let mut wrong = Vec::new();
        for loss in [Loss::Contents, Loss::Entries].into_iter().filter(|loss| damage.is_more(*loss)) {
            let folder = case.folder.with_extension("after");
            copy(&case.folder, &folder);
            damage.apply(loss, &folder);
            let mut found = self.tree(&folder);
            found.0.retain(|path, _| expected.0.contains_key(path) || !(self.may_return)(path));
            let lost = differences(&found, expected, self.is_same);
            wrong.extend(
                lost.into_iter().map(|what| format!("power failure after the end, {loss:?}: {what}")),
            );
            fs::remove_dir_all(&folder).expect("removable");
        }
        wrong
    }
}

/// A run, and what the library keeps of it.
struct Case {
    folder: PathBuf,
    journal: PathBuf,
    keep: PathBuf,
}

impl Case {
    fn new(work: &Path, name: &str) -> Self {
        let keep = work.join(format!("keep-{name}"));
        fs::create_dir_all(&keep).expect("writable");
        Case { folder: work.join(name), journal: work.join(format!("journal-{name}")), keep }
    }

    fn damage(&self) -> Damage {
        Damage::read(&self.journal, &self.folder, &self.keep)
    }

    fn remove(self) {
        fs::remove_dir_all(&self.keep).expect("removable");
        fs::remove_dir_all(&self.folder).expect("removable");
        fs::remove_file(&self.journal).expect("removable");
    }
}

/// The calls at which a run can be ended: all that the library counted, those that failed too.
fn points(damage: &Damage) -> usize {
    damage.calls.iter().filter(|(kind, _)| *kind != "write" && *kind != "stale").map(|(_, count)| count).sum()
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
