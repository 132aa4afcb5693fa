//! Linear equations of the stiff method by an elimination whose pattern is fixed when the model is built.
//!
//! Rows and columns are exchanged once, such that little fills in, and not again: pivots stay on the diagonal. The
//! matrix is I/(γh) − J, whose diagonal is nonzero whatever J is. If a pivot is nevertheless the difference of large
//! numbers, the elimination reports it, and one with pivoting takes its place.

use std::sync::Arc;

use super::sparsity::Sparsity;

/// Part of the entries above which a sparse elimination gains nothing.
const DENSE: f64 = 0.5;
/// Smallest ratio of a pivot, and of the matrix's entry there, to the sum of the magnitudes in the pivot: seven digits
/// may be lost, and the loss is 1e-9 of the matrix's entry.
pub const LOST: f64 = 1e-7;

/// Entries of a decomposition and their order: the same for all instances of an FMU.
#[derive(Debug, PartialEq, Eq)]
pub struct Pattern {
    /// Order of rows and columns, and the inverse of that.
    order: Vec<u32>,
    places: Vec<u32>,
    /// Places of each row left of the diagonal, and right of it.
    left: Vec<Vec<u32>>,
    right: Vec<Vec<u32>>,
}

/// A decomposition A = L U without exchanges, in storage of its own, over a pattern.
#[derive(Debug)]
pub struct Elimination {
    sparsity: Arc<Sparsity>,
    /// Entries by rows; empty until it is needed, in memory that exists from the start.
    a: Vec<f64>,
    /// The inverse pivots.
    inverse: Vec<f64>,
    solution: Vec<f64>,
}

impl Pattern {
    /// Pattern for the entries of a Jacobian, by columns; none if it fills in too much to be worth it.
    pub fn new(columns: &[Vec<u32>]) -> Option<Self> {
        let n = columns.len();
        let most = (DENSE * (n * n) as f64) as usize;
        let mut meetings = Meetings::new(columns);
        if n == 0 || meetings.entries() > most {
            return None;
        }
        let order = meetings.order();
        let mut places = vec![0; n];
        order.iter().enumerate().for_each(|(place, &row)| places[row as usize] = place as u32);
        let (mut left, mut right) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (place, &row) in order.iter().enumerate() {
            let mut row: Vec<u32> = meetings.of(row as usize).map(|column| places[column]).collect();
            row.sort_unstable();
            let diagonal = row.partition_point(|&column| (column as usize) < place);
            right.push(row[diagonal + 1..].to_vec());
            row.truncate(diagonal);
            left.push(row);
        }
        let filled: usize = left.iter().chain(&right).map(Vec::len).sum();
        (filled + n <= most).then_some(Pattern { order, places, left, right })
    }

    /// Order of rows and columns.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Place of a row or column in that order.
    pub fn place(&self, row: usize) -> usize {
        self.places[row] as usize
    }

    /// Places of each row left of the diagonal, and right of it.
    pub fn rows(&self) -> impl Iterator<Item = (&[u32], &[u32])> {
        self.left.iter().zip(&self.right).map(|(left, right)| (&left[..], &right[..]))
    }
}

impl Elimination {
    /// Elimination for a model's Jacobian, if its pattern is worth it.
    pub fn new(sparsity: &Arc<Sparsity>) -> Option<Self> {
        let n = sparsity.columns().len();
        sparsity.pattern().is_some().then(|| Elimination {
            sparsity: Arc::clone(sparsity),
            a: Vec::with_capacity(n * n),
            inverse: vec![0.0; n],
            solution: vec![0.0; n],
        })
    }

    /// Decomposes `diagonal` I − J, J by columns with this pattern. Returns true if the result is accurate.
    pub fn decompose(&mut self, diagonal: f64, jacobian: &[f64]) -> bool {
        let (n, sparsity) = (self.inverse.len(), Arc::clone(&self.sparsity));
        let Some(pattern) = sparsity.pattern() else { return false };
        self.a.resize(n * n, 0.0);
        for (i, row) in self.a.chunks_exact_mut(n).enumerate() {
            pattern.left[i].iter().chain(&pattern.right[i]).for_each(|&j| row[j as usize] = 0.0);
            row[i] = diagonal;
        }
        for (j, rows) in sparsity.columns().iter().enumerate() {
            let column = pattern.places[j] as usize;
            for &i in rows {
                self.a[pattern.places[i as usize] as usize * n + column] -= jacobian[j * n + i as usize];
            }
        }
        (0..n).all(|i| self.eliminate(i, pattern))
    }

    /// Eliminates the entries left of the diagonal in a row. Returns true if its pivot is accurate.
    fn eliminate(&mut self, i: usize, pattern: &Pattern) -> bool {
        let n = self.inverse.len();
        let (above, rest) = self.a.split_at_mut(i * n);
        let row = &mut rest[..n];
        let size = row[i].abs();
        let mut sum = size;
        for &k in &pattern.left[i] {
            let k = k as usize;
            let source = &above[k * n..][..n];
            let factor = row[k] * self.inverse[k];
            row[k] = factor;
            sum += (factor * source[i]).abs();
            pattern.right[k].iter().for_each(|&j| row[j as usize] -= factor * source[j as usize]);
        }
        self.inverse[i] = row[i].recip();
        sum.is_finite() && row[i].abs() > LOST * sum && size > LOST * sum
    }

    /// Replaces b by the solution x of A x = b.
    pub fn solve(&mut self, b: &mut [f64]) {
        let (n, x) = (self.inverse.len(), &mut self.solution);
        let Some(Pattern { order, left, right, .. }) = self.sparsity.pattern() else { return };
        for i in 0..n {
            let row = &self.a[i * n..][..n];
            let known = left[i].iter().map(|&k| row[k as usize] * x[k as usize]);
            x[i] = known.fold(b[order[i] as usize], |sum, known| sum - known);
        }
        for i in (0..n).rev() {
            let row = &self.a[i * n..][..n];
            let known = right[i].iter().map(|&j| row[j as usize] * x[j as usize]);
            x[i] = known.fold(x[i], |sum, known| sum - known) * self.inverse[i];
            b[order[i] as usize] = x[i];
        }
    }
}

/// Rows and columns that meet in the pattern or its transpose: a set of bits per row.
struct Meetings {
    /// Number of words in a set.
    words: usize,
    bits: Vec<u64>,
}

impl Meetings {
    fn new(columns: &[Vec<u32>]) -> Self {
        let (n, words) = (columns.len(), columns.len().div_ceil(64));
        let mut meetings = Meetings { words, bits: vec![0; n * words] };
        for (j, rows) in columns.iter().enumerate() {
            meetings.meet(j, j);
            for &i in rows {
                meetings.meet(i as usize, j);
                meetings.meet(j, i as usize);
            }
        }
        meetings
    }

    fn meet(&mut self, i: usize, j: usize) {
        self.bits[i * self.words + j / 64] |= 1 << (j % 64);
    }

    /// Those that a row meets, in increasing order.
    fn of(&self, row: usize) -> impl Iterator<Item = usize> {
        members(&self.bits[row * self.words..][..self.words])
    }

    /// Number of entries.
    fn entries(&self) -> usize {
        self.bits.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Number of a row's entries in a set.
    fn degree(&self, row: usize, set: &[u64]) -> u32 {
        let own = &self.bits[row * self.words..][..self.words];
        own.iter().zip(set).map(|(own, set)| (own & set).count_ones()).sum()
    }

    /// The row with the fewest neighbours first, whose neighbours then meet each other.
    fn order(&mut self) -> Vec<u32> {
        let n = self.bits.len() / self.words.max(1);
        let mut waiting = vec![0_u64; self.words];
        (0..n).for_each(|row| waiting[row / 64] |= 1 << (row % 64));
        let mut degrees: Vec<u32> = (0..n).map(|row| self.degree(row, &waiting)).collect();
        let mut order = Vec::with_capacity(n);
        while let Some(next) = members(&waiting).min_by_key(|&row| degrees[row]) {
            waiting[next / 64] &= !(1 << (next % 64));
            order.push(next as u32);
            let own = &self.bits[next * self.words..][..self.words];
            let meet: Vec<u64> = own.iter().zip(&waiting).map(|(own, waiting)| own & waiting).collect();
            for row in members(&meet) {
                self.bits[row * self.words..][..self.words].iter_mut().zip(&meet).for_each(|(own, meet)| *own |= meet);
                degrees[row] = self.degree(row, &waiting);
            }
        }
        order
    }
}

/// The members of a set, in increasing order.
fn members(set: &[u64]) -> impl Iterator<Item = usize> {
    set.iter().enumerate().flat_map(|(place, &word)| {
        let bits = |bits: u64| (bits != 0).then_some(bits);
        let words = std::iter::successors(bits(word), move |&word| bits(word & (word - 1)));
        words.map(move |word| place * 64 + word.trailing_zeros() as usize)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::lu::Lu;

    /// A pattern with this number of entries off the diagonal per column, and a matrix over it, by a small generator.
    fn random(n: usize, entries: usize, seed: u64) -> (Arc<Sparsity>, Vec<f64>) {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31)
        };
        let mut columns = vec![Vec::new(); n];
        let mut matrix = vec![0.0; n * n];
        for (j, rows) in columns.iter_mut().enumerate() {
            for i in 0..n {
                if i == j || next() < entries as f64 / n as f64 {
                    rows.push(i as u32);
                    matrix[j * n + i] = (next() - 0.5) * 10.0_f64.powf(4.0 * next());
                }
            }
        }
        (Arc::new(Sparsity::new(columns)), matrix)
    }

    #[test]
    fn solutions_are_those_of_an_elimination_with_pivoting() {
        let mut accurate = 0;
        for seed in 0..60 {
            let n = 5 + (seed as usize * 7) % 40;
            let (sparsity, jacobian) = random(n, 2, seed);
            let Some(mut elimination) = Elimination::new(&sparsity) else { continue };
            for diagonal in [1e5, 300.0, 10.0] {
                if !elimination.decompose(diagonal, &jacobian) {
                    continue;
                }
                accurate += 1;
                let mut lu = Lu::new(n);
                lu.matrix().iter_mut().zip(&jacobian).for_each(|(a, j)| *a = -j);
                lu.matrix().iter_mut().step_by(n + 1).for_each(|a| *a += diagonal);
                assert!(lu.decompose());
                let b: Vec<f64> = (0..n).map(|k| 1.0 + (k as f64).sin()).collect();
                let (mut x, mut expected) = (b.clone(), b);
                elimination.solve(&mut x);
                lu.solve(&mut expected);
                let size = expected.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
                for (x, expected) in x.iter().zip(&expected) {
                    assert!((x - expected).abs() < 1e-6 * size, "n = {n}, seed {seed}, {diagonal}: {x} {expected}");
                }
            }
        }
        assert!(accurate > 60, "{accurate}");
    }

    #[test]
    fn a_lost_pivot_is_noticed() {
        // Row 2 is row 1 but for the last digits.
        let sparsity = Arc::new(Sparsity::new(vec![vec![0, 1], vec![0, 1], vec![2], vec![3]]));
        let mut elimination = Elimination::new(&sparsity).unwrap();
        let mut jacobian = vec![0.0; 16];
        (jacobian[1], jacobian[4]) = (1.0, 1.0 - 1e-15);
        assert!(!elimination.decompose(1.0, &jacobian));
        assert!(!elimination.decompose(f64::NAN, &jacobian));
        assert!(elimination.decompose(2.0, &jacobian));
    }

    #[test]
    fn a_row_and_a_column_in_common_fill_nothing_wherever_they_are() {
        for common in [0, 17, 39] {
            let column = |j: u32| if j == common { (0..40).collect() } else { vec![j.min(common), j.max(common)] };
            let columns: Vec<Vec<u32>> = (0..40).map(column).collect();
            let pattern = Pattern::new(&columns).expect("it is sparse");
            let entries: usize = pattern.rows().map(|(left, right)| left.len() + right.len()).sum();
            assert_eq!(entries, 2 * 39);
        }
    }

    #[test]
    fn a_full_pattern_is_left_to_pivoting() {
        assert!(Elimination::new(&Arc::new(Sparsity::new(vec![(0..6).collect(); 6]))).is_none());
    }
}
