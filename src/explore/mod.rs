//! A loop in the browser: a page with sliders for its parameters, and a server on this machine that runs the loop as often
//! as one is moved.

mod blocks;
mod http;
mod kept;
mod server;
mod session;
mod sliders;

pub use server::{Server, token};
pub use session::{Base, Session};
