use super::*;

const WHO: &str = "another bake is writing here";
const ADVICE: &str = "wait for it";

/// A `flock` that does not wait.
type Flock = fn(&File) -> Result<(), TryLockError>;

fn unsupported(_: &File) -> Result<(), TryLockError> {
    Err(TryLockError::Error(ErrorKind::Unsupported.into()))
}

fn without_effect(_: &File) -> Result<(), TryLockError> {
    Ok(())
}

/// Locks a folder of a network with that `flock`, as a process.
fn locked(
    folder: &Path,
    flock: &dyn Fn(&File) -> Result<(), TryLockError>,
    process: &Process,
) -> Result<Lock, String> {
    let system = System { flock, is_local: &|_| false, process };
    system.lock(folder, WHO, ADVICE).map_err(|error| error.to_string())
}

/// The flocks of this world: one that works, one that is not there, one that does nothing.
const FLOCKS: [Flock; 3] = [File::try_lock, unsupported, without_effect];

#[test]
fn one_at_a_time_whatever_flock_does() {
    for flock in FLOCKS {
        let folder = tempfile::tempdir().unwrap();
        let this = Process::this();
        let held = locked(folder.path(), &flock, this).unwrap();
        let refused = locked(folder.path(), &flock, this).unwrap_err();
        assert!(refused.contains(WHO) && refused.contains(ADVICE), "{refused}");
        drop(held);
        // Nothing is in the way of the next, and the last one leaves no claim.
        drop(locked(folder.path(), &flock, this).unwrap());
        assert!(!folder.path().join(CLAIM).exists());
    }
}

#[test]
fn on_a_local_disk_flock_is_enough_and_says_who() {
    let folder = tempfile::tempdir().unwrap();
    let system = System { flock: &File::try_lock, is_local: &|_| true, process: Process::this() };
    let held = system.lock(folder.path(), WHO, ADVICE).unwrap();
    assert!(!folder.path().join(CLAIM).exists());
    let refused = system.lock(folder.path(), WHO, ADVICE).unwrap_err().to_string();
    assert!(refused.contains(&format!("(process {} on {})", std::process::id(), Process::this().host)));
    drop(held);
    // A claim that a killed run left on a network says nothing here.
    fs::write(folder.path().join(CLAIM), b"").unwrap();
    system.lock(folder.path(), WHO, ADVICE).unwrap();
}

#[test]
fn a_claim_of_a_process_that_ended_here_is_taken_over() {
    let this = Process::this();
    for gone in [
        Process { pid: u32::MAX, ..this.clone() },
        Process { start: this.start + 1, ..this.clone() },
        Process { boot: "before".to_owned(), ..this.clone() },
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(CLAIM), serde_json::to_vec(&gone).unwrap()).unwrap();
        let held = locked(folder.path(), &unsupported, this).unwrap();
        let mut file = File::open(folder.path().join(CLAIM)).unwrap();
        assert_eq!(holder(&mut file).as_ref(), Some(this));
        drop(held);
    }
}

#[test]
fn a_claim_of_another_machine_is_left_and_the_error_says_how_to_remove_it() {
    let folder = tempfile::tempdir().unwrap();
    let other =
        Process { host: "node7".to_owned(), machine: "other".to_owned(), pid: 12, ..Process::this().clone() };
    let claim = folder.path().join(CLAIM);
    for content in [serde_json::to_vec(&other).unwrap(), Vec::new(), b"torn {".to_vec()] {
        fs::write(&claim, &content).unwrap();
        for flock in FLOCKS {
            let refused = locked(folder.path(), &flock, Process::this()).unwrap_err();
            assert!(refused.contains(&format!("remove {}", claim.display())), "{refused}");
            assert!(content.is_empty() || content[0] != b'{' || refused.contains("process 12 on node7"));
            assert_eq!(fs::read(&claim).unwrap(), content);
        }
        // Those who would share the folder are told the same.
        let refused = share(folder.path(), WHO, ADVICE).unwrap_err();
        assert_eq!(refused.exit_code(), crate::error::TRY_AGAIN);
        assert!(refused.to_string().contains(&format!("remove {}", claim.display())), "{refused}");
    }
    fs::remove_file(&claim).unwrap();
    drop(share(folder.path(), WHO, ADVICE).unwrap());
    locked(folder.path(), &unsupported, Process::this()).unwrap();
}

#[test]
fn a_process_id_of_another_namespace_says_nothing_here() {
    // Containers of one machine share its name and its start, and each counts processes from 1: there the
    // holder runs, whether or not a process of that id runs here.
    for pid in [std::process::id(), 1, u32::MAX] {
        let folder = tempfile::tempdir().unwrap();
        let other = Process { machine: "container".to_owned(), pid, ..Process::this().clone() };
        let claim = folder.path().join(CLAIM);
        fs::write(&claim, serde_json::to_vec(&other).unwrap()).unwrap();
        for flock in FLOCKS {
            let refused = locked(folder.path(), &flock, Process::this()).unwrap_err();
            assert!(
                refused.contains(&format!("process {pid} on")) && refused.contains("remove"),
                "{refused}"
            );
        }
        assert!(!other.is_gone());
    }
}

#[test]
fn a_claim_that_is_a_link_to_nothing_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let claim = folder.path().join(CLAIM);
    std::os::unix::fs::symlink(folder.path().join("nowhere"), &claim).unwrap();
    for flock in FLOCKS {
        let refused = locked(folder.path(), &flock, Process::this()).unwrap_err();
        assert!(refused.contains(CLAIM) && refused.contains("symbolic link"), "{refused}");
        assert!(claim.is_symlink());
    }
    fs::remove_file(&claim).unwrap();
    locked(folder.path(), &unsupported, Process::this()).unwrap();
}

#[test]
fn of_many_at_once_one_gets_it_also_where_a_stale_claim_lies() {
    for flock in FLOCKS {
        for _ in 0..20 {
            let folder = tempfile::tempdir().unwrap();
            let gone = Process { pid: u32::MAX, ..Process::this().clone() };
            fs::write(folder.path().join(CLAIM), serde_json::to_vec(&gone).unwrap()).unwrap();
            let all = std::sync::Barrier::new(4);
            let held = std::thread::scope(|scope| {
                let try_it = || {
                    all.wait();
                    let lock = locked(folder.path(), &flock, Process::this()).ok();
                    all.wait();
                    usize::from(lock.is_some())
                };
                let threads: Vec<_> = (0..4).map(|_| scope.spawn(try_it)).collect();
                threads.into_iter().map(|thread| thread.join().unwrap()).sum::<usize>()
            });
            assert_eq!(held, 1);
        }
    }
}
