//! Equations, recorded once: a [`System`](crate::system::System) run over a scalar that writes down what is done with it.
//!
//! A recording is a list of [`Operation`]s, each over earlier ones: common subexpressions are shared, what follows from
//! constants alone is computed at once, by the very functions that the equations call, and nothing else is changed. What
//! depends on what follows from it, and the sparsity of every Jacobian.
//!
//! Conditions select: of a [`Scalar::branch`](crate::system::Scalar::branch) both ways are recorded, and a
//! [`Point::when`](crate::system::Point::when) is recorded as a selection between what stood and what it leaves.

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
pub(crate) use guard::{Guard, Literal, decided, guards, literals};
pub use instructions::{Instructions, Registers, slopes};
pub use iteration::Body;
pub use method::{Method, Recording};
pub(crate) use node::on_tape;
pub use node::{Condition, Recorded};
pub use tangent::needed;
pub use tape::{Binary, Comparison, Leaf, Node, Note, Operation, Tape, Unary};
