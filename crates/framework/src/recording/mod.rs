//! Equations, recorded once: a [`System`](crate::system::System) run over a scalar that writes down what is done with
//! it.
//!
//! A recording is a list of [`Operation`]s, each over earlier ones. Common subexpressions are shared, and operations on
//! constants are computed during recording, by the very functions that the equations call. Nothing else is changed.
//! Dependences and the sparsity of every Jacobian follow from it.
//!
//! Conditions select: of a [`Scalar::branch`](crate::system::Scalar::branch) both ways are recorded, and a
//! [`Point::when`](crate::system::Point::when) is recorded as a selection between the old and the new values.

mod adjoint;
mod evaluate;
mod guard;
mod instructions;
mod iteration;
mod method;
mod node;
mod simplified;
mod structure;
mod tangent;
mod tape;
mod writer;

pub use crate::scalar::Opaque;
pub use evaluate::Given;
pub(crate) use guard::{Guard, Literal, decided, followed, guards, literals};
pub use instructions::{Instructions, Registers, slopes};
pub use iteration::Body;
pub use method::{Method, Recording};
pub(crate) use node::on_tape;
pub use node::{Condition, Recorded};
pub use tangent::needed;
pub use tape::{Binary, Comparison, Leaf, Node, Note, Operation, Tape, Unary};
