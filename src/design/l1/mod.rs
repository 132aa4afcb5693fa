//! First designs of L1 controllers, and what holds for a plant whose entries are uncertain.
//!
//! From a nominal plant, a bandwidth W and bounds of what each entry of A and B may be off: desired dynamics, bounds of the
//! estimates, the filter's gain K, the communication step and the adaptation gain Γ. Two answers go with it: λ*, which proves
//! stability while the plant changes within its bounds, and the region of plants as they stand, each of which is tried.
//!
//! States are in [balanced](crate::mathematics::balanced) coordinates and times in 1/W, as for the other first designs.

pub mod adaptation;
pub mod assess;
pub mod closed;
pub mod design;
pub mod desired;
pub mod lambda;

#[cfg(test)]
mod tests;
