//! The numbers of Dormand and Prince's method: A family of embedded Runge–Kutta formulae, J. Comput. Appl. Math. 6 (1980)
//! 19–26, table 2.

/// Stages of a step; the last is the first of the next.
pub const STAGES: usize = 7;

/// Weights of the earlier stages, in stage 2.
pub const A2: [f64; 1] = [1.0 / 5.0];
/// Weights in stage 3.
pub const A3: [f64; 2] = [3.0 / 40.0, 9.0 / 40.0];
/// Weights in stage 4.
pub const A4: [f64; 3] = [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0];
/// Weights in stage 5.
pub const A5: [f64; 4] = [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0];
/// Weights in stage 6.
pub const A6: [f64; 5] = [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0];
/// Weights in stage 7, which are those of the solution of order 5.
pub const A7: [f64; 6] = [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0];

/// Difference of the solutions of order 5 and 4.
pub const E: [f64; STAGES] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

/// Node of each stage, in parts of the step, and its weights.
pub const TABLEAU: [(f64, &[f64]); STAGES] =
    [(0.0, &[]), (1.0 / 5.0, &A2), (3.0 / 10.0, &A3), (4.0 / 5.0, &A4), (8.0 / 9.0, &A5), (1.0, &A6), (1.0, &A7)];
