//! A loop in the browser: a page with a control for each of its parameters. A server on this machine runs the loop
//! whenever one is moved. On a page without a server, this package's library does so itself, as WebAssembly.

mod blocks;
#[cfg(target_family = "wasm")]
#[allow(unsafe_code)]
mod browser;
mod cases;
#[allow(unsafe_code)]
mod clock;
#[cfg(not(target_family = "wasm"))]
mod http;
#[cfg(not(target_family = "wasm"))]
mod kept;
#[cfg(not(target_family = "wasm"))]
mod page;
mod parameters;
#[cfg(not(target_family = "wasm"))]
mod server;
mod session;
mod set;
mod steps;

pub use cases::{Base, cases, coarse};
#[cfg(not(target_family = "wasm"))]
pub use page::write_page;
#[cfg(not(target_family = "wasm"))]
pub use server::{Server, token};
pub use session::Session;
