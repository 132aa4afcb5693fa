//! What `info` tells about a build, and whether the functions of the C library are bound to their first versions.

use std::env;
use std::process::Command;

use adaptive_fmu_sources as sources;

fn main() {
    println!("cargo::rustc-env=ADAPTIVE_FMU_TARGET={}", env::var("TARGET").unwrap_or_default());
    println!("cargo::rustc-env=ADAPTIVE_FMU_COMPILER={}", compiler());
    let optimised = env::var("OPT_LEVEL").is_ok_and(|level| level != "0" && level != "1");
    println!("cargo::rustc-env=ADAPTIVE_FMU_OPTIMISED={optimised}");
    sources::track(&["src", "Cargo.toml", "build.rs"]);
    println!("cargo::rustc-check-cfg=cfg(old_glibc)");
    if links_glibc() {
        println!("cargo::rustc-cfg=old_glibc");
    }
}

/// True if a library of this target is linked with glibc, as it is loaded, on a processor that fmi2/old_glibc.rs knows.
fn links_glibc() -> bool {
    let of_target = |name: &str| env::var(format!("CARGO_CFG_TARGET_{name}")).unwrap_or_default();
    let within = of_target("FEATURE").split(',').any(|feature| feature == "crt-static");
    // A fuzzer's library leaves functions to the program that loads it.
    let fuzzing = env::var_os("CARGO_CFG_FUZZING").is_some();
    let glibc = of_target("OS") == "linux" && of_target("ENV") == "gnu" && !within && !fuzzing;
    glibc && ["x86_64", "aarch64"].contains(&of_target("ARCH").as_str())
}

fn compiler() -> String {
    let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = Command::new(rustc).arg("--version").output().map(|output| output.stdout).unwrap_or_default();
    String::from_utf8_lossy(&version).trim().to_owned()
}
