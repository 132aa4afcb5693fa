//! Linear equations of the stiff method: nalgebra's decomposition allocates its permutation at every call.

/// A decomposition P A = L U of a square matrix with partial pivoting, in storage of its own.
#[derive(Debug)]
pub struct Lu {
    size: usize,
    /// Entries by columns: first A; then U, and below its diagonal L, whose own diagonal is 1. Empty until it is
    /// needed, in memory that exists from the start.
    a: Vec<f64>,
    /// Row that was exchanged with row k.
    pivots: Vec<usize>,
}

impl Lu {
    /// Storage for matrices with this number of rows.
    pub fn new(size: usize) -> Self {
        Lu { size, a: Vec::with_capacity(size * size), pivots: vec![0; size] }
    }

    /// The matrix by columns, to write before [`Lu::decompose`].
    pub fn matrix(&mut self) -> &mut [f64] {
        self.a.resize(self.size * self.size, 0.0);
        &mut self.a
    }

    /// Decomposes the matrix. Returns true if it is regular.
    pub fn decompose(&mut self) -> bool {
        let n = self.size;
        for k in 0..n {
            let (done, rest) = self.a.split_at_mut((k + 1) * n);
            let column = &mut done[k * n..];
            let larger = |p: usize, i: usize| if column[i].abs() > column[p].abs() { i } else { p };
            let pivot = (k + 1..n).fold(k, larger);
            self.pivots[k] = pivot;
            if column[pivot] == 0.0 || !column[pivot].is_finite() {
                return false;
            }
            column.swap(k, pivot);
            let scale = column[k].recip();
            column[k + 1..].iter_mut().for_each(|l| *l *= scale);
            for other in rest.chunks_exact_mut(n) {
                other.swap(k, pivot);
                subtract(&mut other[k..], &column[k..]);
            }
        }
        self.permute_multipliers();
        true
    }

    /// Brings the multipliers of each column into the order that the exchanges after it made.
    fn permute_multipliers(&mut self) {
        for (k, column) in self.a.chunks_exact_mut(self.size).enumerate() {
            for later in k + 1..self.size {
                column.swap(later, self.pivots[later]);
            }
        }
    }

    /// Replaces b by the solution x of A x = b.
    pub fn solve(&self, b: &mut [f64]) {
        let n = self.size;
        for (k, &pivot) in self.pivots.iter().enumerate() {
            b.swap(k, pivot);
        }
        for (k, column) in self.a.chunks_exact(n).enumerate() {
            subtract(&mut b[k..], &column[k..]);
        }
        for (k, column) in self.a.chunks_exact(n).enumerate().rev() {
            b[k] /= column[k];
            let x = b[k];
            b[..k].iter_mut().zip(column).for_each(|(b, u)| *b -= u * x);
        }
    }
}

/// Eliminates below the first of `values` with the multipliers below the first of `column`.
fn subtract(values: &mut [f64], column: &[f64]) {
    let [first, rest @ ..] = values else { return };
    rest.iter_mut().zip(&column[1..]).for_each(|(value, l)| *value -= l * *first);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_that_is_singular_or_no_numbers_is_not_regular() {
        let regular = |columns: [f64; 9]| {
            let mut lu = Lu::new(3);
            lu.matrix().copy_from_slice(&columns);
            lu.decompose()
        };
        assert!(regular([0.0, 2.0, 1.0, 4.0, 0.0, 0.0, 1.0, 1.0, 3.0]));
        assert!(!regular([0.0; 9]));
        assert!(!regular([1.0, 2.0, 0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0]));
        assert!(!regular([1.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0, 0.0, 0.0, 1.0]));
        assert!(!regular([f64::NAN, f64::NAN, f64::NAN, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]));
    }
}
