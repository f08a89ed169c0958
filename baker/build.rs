//! Compiles xatlas and the C shim over it. Needs a C++ compiler, no libclang.

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
}
