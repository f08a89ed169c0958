//! A bake that does not fit the disk is refused before light is traced.

use crate::pages::case;
use baker::bake::run::{Options, bake};
use baker::light::times::schedule::parse_hours;
use dataset::error::TRY_AGAIN;
use dataset::observe::Silent;

#[test]
fn a_bake_that_needs_more_than_is_free_is_refused_and_leaves_nothing() {
    let (stage, text) = case();
    stage.write("case.toml", text.as_bytes());
    let out = stage.path("set");
    let run = |free_bytes: fn(&std::path::Path) -> Option<u64>, force| {
        let hours = parse_hours("12,21").expect("hours");
        let options = Options { out: Some(out.clone()), free_bytes, force, ..Options::new(hours) };
        bake(&stage.path("case.toml"), &options, &Silent)
    };
    let refused = run(|_| Some(10_000), false).unwrap_err();
    // As when the disk is full later: the same command can succeed.
    assert_eq!(refused.exit_code(), TRY_AGAIN);
    let refused = refused.to_string();
    for what in [
        "at its peak",
        "10 kB are free",
        "--out DIR on another file system",
        "fewer --hours",
        "smaller [lightmap] size",
    ] {
        assert!(refused.contains(what), "{refused}");
    }
    assert!(!out.exists());
    // Where the system does not tell, and where there is room, it is baked.
    run(|_| None, false).unwrap();
    run(|_| Some(1 << 30), true).unwrap();
    // All layers are there: only the dataset is to be written, were it another one, and a layer denoised
    // again.
    stage.write("case.toml", text.replace("radiance = [8, 6, 4]", "radiance = [4, 3, 2]").as_bytes());
    let told = |force| run(|_| Some(1000), force).unwrap_err().to_string();
    assert!(
        told(false).contains("(work 0.0 kB,") && told(false).contains("1.0 kB are free"),
        "{}",
        told(false)
    );
    // `--force` traces all of them again.
    assert!(told(true).contains("(work ") && !told(true).contains("(work 0.0 kB,"), "{}", told(true));
    // (323 kB, and 18 kB of layers that are denoised again.)
    run(|_| Some(350_000), false).unwrap();
}
