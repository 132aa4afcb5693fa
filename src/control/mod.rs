//! What controllers share: the projection operator and the mathematics of their design.

pub mod exponential;
pub mod lyapunov;
pub mod projection;
