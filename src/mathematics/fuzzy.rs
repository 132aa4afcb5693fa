//! Fuzzy inference from two inputs, in closed form (Mamdani: minimum, maximum, centre of sums).
//!
//! E. H. Mamdani and S. Assilian, An experiment in linguistic synthesis with a fuzzy logic controller, Int. J.
//! Man-Machine Studies 7 (1975) 1–13.

use crate::system::{Scalar, larger, smaller};

/// Number of sets of each input and of the output: zero, very small, small, large, very large.
pub const SETS: usize = 5;

/// Output sets by their place.
const Z: usize = 0;
const VS: usize = 1;
const S: usize = 2;
const L: usize = 3;
const VL: usize = 4;

/// The output set of each rule: a row for each set of the second input, a column for each of the first.
pub const RULES: [[usize; SETS]; SETS] =
    [[Z, VS, VS, S, L], [VS, VS, S, L, VL], [VS, S, L, VL, VL], [S, L, VL, VL, VL], [L, VL, VL, VL, VL]];

/// A triangular set of the output: it rises from `low` to 1 at `centre` and falls to `high`. An edge may be upright.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle<T> {
    /// Lower end.
    pub low: T,
    /// Place of the value 1.
    pub centre: T,
    /// Upper end, above `low`.
    pub high: T,
}

impl<T: Scalar> Triangle<T> {
    /// Area under the triangle cut off at a height of 0 … 1, and its moment about zero.
    fn clipped(&self, height: T) -> (T, T) {
        // The triangle without its tip, which is similar to it: h (3 − 3 h + h²) = 1 − (1 − h)³.
        let per_side = (height * height - height * 3.0 + 3.0) * (self.low + self.high);
        let of_centre = height * (-height * 2.0 + 3.0) * self.centre;
        let base = (self.high - self.low) * height;
        (base * (-height + 2.0) / 2.0, base * (per_side + of_centre) / 6.0)
    }
}

/// Degrees to which a value belongs to each set of an input: triangles between the neighbours of its increasing
/// centres, with shoulders below the first and above the last.
pub fn memberships<T: Scalar>(value: T, centres: &[T; SETS]) -> [T; SETS] {
    let part = |from: usize, to: usize| (value - centres[from]) / (centres[to] - centres[from]);
    std::array::from_fn(|k| {
        let rising = if k > 0 { part(k - 1, k) } else { T::from(1.0) };
        let falling = if k + 1 < SETS { part(k + 1, k) } else { T::from(1.0) };
        larger(smaller(smaller(rising, falling), T::from(1.0)), T::from(0.0))
    })
}

/// The output: each rule holds as far as both its inputs belong to its sets, each output set is cut off where its
/// strongest rule holds, and the result is the centre of the areas, those that overlap counted for each set.
pub fn infer<T: Scalar>(inputs: [T; 2], centres: &[T; SETS], sets: &[Triangle<T>; SETS]) -> T {
    let [first, second] = inputs.map(|input| memberships(input, centres));
    let mut heights = [T::from(0.0); SETS];
    for (row, &of_second) in RULES.iter().zip(&second) {
        for (&set, &of_first) in row.iter().zip(&first) {
            heights[set] = larger(heights[set], smaller(of_first, of_second));
        }
    }
    let zero = (T::from(0.0), T::from(0.0));
    let (area, moment) = sets.iter().zip(heights).fold(zero, |(areas, moments), (set, height)| {
        let (area, moment) = set.clipped(height);
        (areas + area, moments + moment)
    });
    moment / area
}

#[cfg(test)]
mod tests;
