//! Mathematics of controllers, plants and designs: limits, the projection operator, fuzzy inference, norms and margins.

pub mod angle;
pub mod balanced;
pub mod delay_margin;
pub mod exponential;
pub mod feedforward;
pub mod filter;
pub mod fuzzy;
pub mod l1_adaptation;
pub mod l1_advice;
pub mod l1_design;
pub mod l1_norm;
pub mod limits;
pub mod logarithm;
pub mod lyapunov;
pub mod matched_equivalent;
pub mod matrices;
pub mod performance;
pub mod pole_placement;
pub mod prediction_error;
pub mod projection;
pub mod root;
pub mod rotors;
