//! A loop in the browser: a page with a control for each of its parameters. A server on this machine runs the loop
//! whenever one is moved. On a page without a server, this package's library does so itself, as WebAssembly.

#[cfg(target_family = "wasm")]
mod alone;
mod blocks;
mod cases;
#[cfg(not(target_family = "wasm"))]
mod files;
#[cfg(not(target_family = "wasm"))]
mod http;
#[cfg(not(target_family = "wasm"))]
mod page;
mod parameters;
#[cfg(not(target_family = "wasm"))]
mod server;
mod session;
mod set;
mod steps;

#[cfg(target_family = "wasm")]
pub use alone::begun;
pub use cases::{Base, cases, coarse};
#[cfg(not(target_family = "wasm"))]
pub use page::write_page;
#[cfg(not(target_family = "wasm"))]
pub(crate) use page::{LIBRARY_SCRIPT, PROGRAM, compressed, program};
pub(crate) use parameters::{Rank, rank};
#[cfg(not(target_family = "wasm"))]
pub use server::{Server, token};
pub use session::Session;
#[cfg(target_family = "wasm")]
pub(crate) use session::Wanted;
