//! Recorded equations as machine code, in memory of this process. It gives the same bits as the generic equations: each
//! operation is one instruction, or a call of the very function that these call.

#[cfg(not(target_family = "wasm"))]
mod emitter;
#[cfg(not(target_family = "wasm"))]
#[allow(unsafe_code)]
mod machine;
#[cfg(target_family = "wasm")]
mod nowhere;

#[cfg(not(target_family = "wasm"))]
pub use machine::{Compiled, refused};
#[cfg(target_family = "wasm")]
pub use nowhere::{Compiled, refused};
