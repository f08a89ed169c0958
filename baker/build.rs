//! Compiles xatlas and the C shim over it. Needs a C++ compiler, no libclang.
//!
//! With the feature `embree`, links libembree4 from, in this order: the folder named by `EMBREE_DIR`;
//! `target/embree`, where `third_party/fetch-embree.sh` puts it; the system (Debian 13: `libembree-dev`).

use std::path::PathBuf;

fn main() {
    let shim = "src/atlas/shim.cpp";
    println!("cargo:rerun-if-changed={shim}");
    println!("cargo:rerun-if-changed=third_party/xatlas/xatlas.cpp");
    println!("cargo:rerun-if-changed=third_party/xatlas/xatlas.h");
    cc::Build::new()
        .cpp(true)
        .std("c++14")
        // Unwrapping unoptimised takes minutes, so debug builds optimise it too.
        .opt_level(2)
        // No fused multiply-add: the same charts from every x86-64 and ARM compiler that rounds IEEE.
        .flag_if_supported("-ffp-contract=off")
        .warnings(false)
        .include("third_party/xatlas")
        .file(shim)
        .compile("baker_xatlas");
    if std::env::var_os("CARGO_FEATURE_EMBREE").is_some() {
        link_embree();
    }
}

fn link_embree() {
    println!("cargo:rerun-if-env-changed=EMBREE_DIR");
    let fetched = || {
        let manifest = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR")?);
        let folder = manifest.parent()?.join("target/embree");
        println!("cargo:rerun-if-changed={}", folder.display());
        folder.join("libembree4.so").exists().then_some(folder)
    };
    if let Some(folder) = std::env::var_os("EMBREE_DIR").map(PathBuf::from).or_else(fetched) {
        println!("cargo:rustc-link-search=native={}", folder.display());
        println!("cargo:rustc-link-arg=-Wl,-rpath,{}", folder.display());
        // The library's own dependencies lie beside it and are found when it is loaded.
        println!("cargo:rustc-link-arg=-Wl,--allow-shlib-undefined");
        // For the command, a package of its own: what links it needs the same.
        println!("cargo::metadata=EMBREE={}", folder.display());
    }
    println!("cargo:rustc-link-lib=dylib=embree4");
}
