//! Limits of the controls, and the steps of the references that they allow.

/// A control that moves to one side only is not to be at its other limit by rounding.
pub fn without_rounding([lowest, highest]: [f64; 2]) -> [f64; 2] {
    let least = 1e-6 * highest.max(-lowest);
    [if -lowest > least { lowest } else { 0.0 }, if highest > least { highest } else { 0.0 }]
}

/// True if a control that starts at 0 goes beyond its limits.
pub fn is_beyond(range: [f64; 2], [min, max]: [f64; 2]) -> bool {
    let [lowest, highest] = without_rounding(range);
    lowest < min.min(0.0) * (1.0 + 1e-9) || highest > max.max(0.0) * (1.0 + 1e-9)
}

/// The largest factor of a step whose control, with this range, stays within its limits.
pub fn allowed(range: [f64; 2], [min, max]: [f64; 2]) -> f64 {
    // From 0, where the plant is at rest.
    let within = |bound: f64, peak: f64| if peak > 0.0 { (bound / peak).max(0.0) } else { f64::INFINITY };
    let [lowest, highest] = without_rounding(range);
    within(max, highest).min(within(-min, -lowest))
}
