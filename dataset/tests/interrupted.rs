//! A stopped import, export, halving or release leaves nothing. A test file of its own: the request to stop
//! is the whole process's.

mod common;

use common::{layouts, write_set};
use dataset::Error;
use dataset::exchange::{Origin, export, import};
use dataset::halve::halve;
use dataset::host::INTERRUPTED;
use dataset::layout::hprc2::Hprc2;
use dataset::observe::Silent;
use dataset::release::{release, verify};
use dataset::store::Dataset;
use std::fs;
use std::sync::atomic::Ordering;

#[test]
fn a_stopped_command_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [source, set, out] = ["contest", "set", "out"].map(|name| folder.path().join(name));
    layouts::write2(&source);
    write_set(&set, &[(20, 20)], 1).unwrap();
    let dataset = Dataset::open(&set).unwrap();
    INTERRUPTED.store(true, Ordering::SeqCst);
    let imported = import(&Origin::Folder(&Hprc2, source.clone()), &out, &Silent);
    assert!(matches!(imported, Err(Error::Interrupted)), "{imported:?}");
    let exported = export(&dataset, &Hprc2, &out, &Silent);
    assert!(matches!(exported, Err(Error::Interrupted)), "{exported:?}");
    let halved = halve(&dataset, &out, &Silent);
    assert!(matches!(halved, Err(Error::Interrupted)), "{halved:?}");
    let released = release(std::slice::from_ref(&set), &[], false, &out, &Silent);
    assert!(matches!(released, Err(Error::Interrupted)), "{released:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    // Asked again it is done.
    INTERRUPTED.store(false, Ordering::SeqCst);
    import(&Origin::Folder(&Hprc2, source), &out, &Silent).unwrap();
    let released = folder.path().join("release");
    release(&[set], &[], false, &released, &Silent).unwrap();
    INTERRUPTED.store(true, Ordering::SeqCst);
    let verified = verify(&released, &Silent);
    assert!(matches!(verified, Err(Error::Interrupted)), "{verified:?}");
    INTERRUPTED.store(false, Ordering::SeqCst);
    assert!(verify(&released, &Silent).unwrap().faults.is_empty());
}
