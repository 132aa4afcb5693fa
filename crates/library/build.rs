//! Linker flags of the shared library.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // A fuzzer's library leaves symbols of its sanitizer to the program that loads it.
    let fuzzing = env::var_os("CARGO_CFG_FUZZING").is_some();
    if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") && !fuzzing {
        // An undefined symbol is an error here, not in a user's tool.
        println!("cargo::rustc-link-arg-cdylib=-Wl,-z,defs");
    }
}
