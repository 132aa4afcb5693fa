//! A loop in the browser: a page with a control for each of its parameters, and a server on this machine that runs the loop as often
//! as one is moved.

mod blocks;
mod http;
mod kept;
mod parameters;
mod server;
mod session;

pub use server::{Server, token};
pub use session::{Base, Session};
