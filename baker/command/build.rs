//! With the feature `embree`, the command finds the library where the baker's build found it.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if let Ok(folder) = std::env::var("DEP_BAKER_XATLAS_EMBREE") {
        println!("cargo:rustc-link-arg=-Wl,-rpath,{folder}");
        // The library's own dependencies lie beside it and are found when it is loaded.
        println!("cargo:rustc-link-arg=-Wl,--allow-shlib-undefined");
    }
}
