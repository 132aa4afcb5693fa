//! All eigenvalues of a matrix, without allocation: nalgebra's Schur decomposition allocates, and needs the same care.
//!
//! Rows and columns are permuted and scaled first (Parlett and Reinsch, Balancing a matrix for calculation of
//! eigenvalues and eigenvectors, Numer. Math. 13 (1969) 293–304): a loop's states differ by many orders of magnitude, and
//! parts that nothing feeds back to have their eigenvalues on the diagonal. Then reflections bring the matrix to
//! Hessenberg form, and Francis' implicit double shifts split it (Golub and Van Loan, Matrix Computations, 7.4 and 7.5).

use std::ops::Range;

use nalgebra::Complex;

/// Shifts tried for one eigenvalue before it is given up. Two or three are usual.
const MOST_SHIFTS: usize = 60;
/// Number of shifts without success after which one of another kind is tried. From then on an entry counts as zero if
/// it is no larger than the rounding errors of the whole matrix. Many equal eigenvalues next to a large one are not
/// separated any further.
const UNUSUAL: usize = 10;

/// Eigenvalues of square matrices of one size, in storage of their own.
#[derive(Debug)]
pub struct Spectrum {
    size: usize,
    /// Entries by rows: what is left of the matrix while it is split. Its memory exists from the start.
    a: Vec<f64>,
    values: Vec<Complex<f64>>,
    /// Range of those that took more than a permutation to find, and the rounding errors of that.
    found: Range<usize>,
    noise: f64,
}

/// A reflection I − v (β v)ᵀ of up to three rows.
struct Reflection<const N: usize> {
    v: [f64; N],
    scaled: [f64; N],
}

impl<const N: usize> Reflection<N> {
    /// The reflection that takes x to a multiple of the first axis; none where x is zero.
    fn of(x: [f64; N]) -> Option<Self> {
        let largest = x.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
        if largest == 0.0 {
            return None;
        }
        let mut v = x.map(|x| x / largest);
        let length = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        v[0] += length.copysign(v[0]);
        let beta = 2.0 / v.iter().map(|v| v * v).sum::<f64>();
        Some(Reflection { v, scaled: v.map(|v| beta * v) })
    }

    #[inline]
    fn apply(&self, x: [&mut f64; N]) {
        let product: f64 = x.iter().zip(&self.scaled).map(|(x, scaled)| **x * scaled).sum();
        x.into_iter().zip(&self.v).for_each(|(x, v)| *x -= product * v);
    }
}

impl Spectrum {
    /// Storage for matrices with this number of rows.
    pub fn new(size: usize) -> Self {
        Spectrum {
            size,
            a: Vec::with_capacity(size * size),
            values: vec![Complex::new(0.0, 0.0); size],
            found: 0..0,
            noise: 0.0,
        }
    }

    /// Finds the eigenvalues of a matrix, by columns or by rows. Returns false if it can't.
    pub fn find(&mut self, matrix: &[f64]) -> bool {
        // Zeros have no sign here: reflections would go by it.
        self.a.clear();
        self.a.extend(matrix.iter().map(|entry| entry + 0.0));
        // The shifts need squares of the entries.
        if !self.a.iter().map(|a| a * a).sum::<f64>().is_finite() {
            return false;
        }
        let active = self.permute();
        self.scale(active.clone());
        let norm = active.clone().flat_map(|i| active.clone().map(move |j| (i, j)));
        let norm = norm.map(|(i, j)| self.a[i * self.size + j].powi(2)).sum::<f64>().sqrt();
        self.noise = 10.0 * self.size as f64 * f64::EPSILON * norm;
        self.found = active.clone();
        self.hessenberg(active.clone());
        self.split(active, norm)
    }

    /// The eigenvalues that were found, in no order, each with how large its rounding error may be.
    pub fn values(&self) -> impl Iterator<Item = (Complex<f64>, f64)> {
        let noise = |k| if self.found.contains(&k) { self.noise } else { 0.0 };
        self.values.iter().enumerate().map(move |(k, &value)| (value, noise(k)))
    }

    fn at(&self, row: usize, column: usize) -> f64 {
        self.a[row * self.size + column]
    }

    /// Splits off eigenvalues that have a row or a column without other entries in the remaining matrix; returns the
    /// rows and columns that are left.
    fn permute(&mut self) -> Range<usize> {
        let (mut low, mut high) = (0, self.size);
        let alone = |a: &[f64], n: usize, i: usize, range: Range<usize>, row: bool| {
            range.filter(|&j| j != i).all(|j| if row { a[i * n + j] == 0.0 } else { a[j * n + i] == 0.0 })
        };
        let n = self.size;
        while let Some(i) = (low..high).find(|&i| alone(&self.a, n, i, low..high, true)) {
            high -= 1;
            self.exchange(i, high);
            self.values[high] = Complex::new(self.at(high, high), 0.0);
        }
        while let Some(i) = (low..high).find(|&i| alone(&self.a, n, i, low..high, false)) {
            self.exchange(i, low);
            self.values[low] = Complex::new(self.at(low, low), 0.0);
            low += 1;
        }
        low..high
    }

    /// Exchanges two rows, and the same columns.
    fn exchange(&mut self, i: usize, j: usize) {
        if i != j {
            let n = self.size;
            (0..n).for_each(|k| self.a.swap(i * n + k, j * n + k));
            (0..n).for_each(|k| self.a.swap(k * n + i, k * n + j));
        }
    }

    /// Scales rows and columns by powers of two until each row is about as large as its column.
    fn scale(&mut self, active: Range<usize>) {
        // Each round halves what is left; a matrix that needs more is beyond the range of numbers.
        for _ in 0..64 {
            let mut scaled = false;
            for i in active.clone() {
                let sum = |of: &dyn Fn(usize) -> f64| active.clone().filter(|&j| j != i).map(of).sum::<f64>();
                let (row, column) = (sum(&|j| self.at(i, j).abs()), sum(&|j| self.at(j, i).abs()));
                if row == 0.0 || column == 0.0 {
                    continue;
                }
                let factor = (0.5 * (row / column).log2()).round().exp2();
                if (column * factor + row / factor) < 0.95 * (column + row) {
                    scaled = true;
                    active.clone().for_each(|j| self.a[j * self.size + i] *= factor);
                    active.clone().for_each(|j| self.a[i * self.size + j] /= factor);
                }
            }
            if !scaled {
                return;
            }
        }
    }

    /// Brings what is left to Hessenberg form: zeros below the first subdiagonal.
    fn hessenberg(&mut self, active: Range<usize>) {
        let n = self.size;
        for k in active.start..active.end.saturating_sub(2) {
            let rows = k + 1..active.end;
            // v lies in the column that it clears.
            let length = rows.clone().map(|i| self.at(i, k).powi(2)).sum::<f64>().sqrt();
            if length == 0.0 {
                continue;
            }
            let first = self.at(k + 1, k);
            let image = -length.copysign(first);
            self.a[(k + 1) * n + k] = first - image;
            let beta = 1.0 / (length * (length + first.abs()));
            for j in k + 1..active.end {
                let product: f64 = rows.clone().map(|i| self.at(i, k) * self.at(i, j)).sum();
                rows.clone().for_each(|i| self.a[i * n + j] -= beta * product * self.a[i * n + k]);
            }
            for i in active.clone() {
                let product: f64 = rows.clone().map(|j| self.at(i, j) * self.at(j, k)).sum();
                rows.clone().for_each(|j| self.a[i * n + j] -= beta * product * self.a[j * n + k]);
            }
            rows.for_each(|i| self.a[i * n + k] = 0.0);
            self.a[(k + 1) * n + k] = image;
        }
    }

    /// Splits the Hessenberg matrix into blocks of one and two rows, from its end. Returns true if that succeeds.
    fn split(&mut self, active: Range<usize>, norm: f64) -> bool {
        let (mut end, mut shifts) = (active.end, 0);
        while end > active.start {
            let least = if shifts < UNUSUAL { 0.0 } else { norm };
            let start = self.block(active.start, end, (least, norm));
            match end - start {
                1 => self.values[start] = Complex::new(self.at(start, start), 0.0),
                2 => {
                    let pair = self.pair(start);
                    self.values[start..end].copy_from_slice(&pair);
                }
                _ if shifts >= MOST_SHIFTS => return false,
                _ => {
                    shifts += 1;
                    self.shift(start..end, shifts % UNUSUAL == 0);
                    continue;
                }
            }
            (end, shifts) = (start, 0);
        }
        self.values.iter().all(|value| value.re.is_finite() && value.im.is_finite())
    }

    /// Begin of the last block that doesn't split: the entry before it is negligible compared with its neighbours, or
    /// with a given least size.
    fn block(&mut self, low: usize, end: usize, (least, norm): (f64, f64)) -> usize {
        for k in (low + 1..end).rev() {
            let neighbours = (self.at(k, k).abs() + self.at(k - 1, k - 1).abs()).max(least);
            let size = if neighbours == 0.0 { norm } else { neighbours };
            if self.at(k, k - 1).abs() <= f64::EPSILON * size {
                self.a[k * self.size + k - 1] = 0.0;
                return k;
            }
        }
        low
    }

    /// The eigenvalues of the block of two rows at k.
    fn pair(&self, k: usize) -> [Complex<f64>; 2] {
        let (a, d) = (self.at(k, k), self.at(k + 1, k + 1));
        let (half, product) = (0.5 * (a - d), self.at(k, k + 1) * self.at(k + 1, k));
        let discriminant = half * half + product;
        if discriminant < 0.0 {
            let (real, imaginary) = (d + half, (-discriminant).sqrt());
            return [Complex::new(real, imaginary), Complex::new(real, -imaginary)];
        }
        let root = half + discriminant.sqrt().copysign(half);
        let second = if root == 0.0 { d } else { d - product / root };
        [Complex::new(d + root, 0.0), Complex::new(second, 0.0)]
    }

    /// One implicit double shift of a block. An unusual one leaves a cycle of the usual ones.
    fn shift(&mut self, block: Range<usize>, unusual: bool) {
        let (l, m) = (block.start, block.end - 1);
        let at = |i, j| self.at(i, j);
        let (sum, product) = if unusual {
            let size = at(m, m - 1).abs() + at(m - 1, m - 2).abs();
            (1.5 * size, size * size)
        } else {
            (at(m, m) + at(m - 1, m - 1), at(m, m) * at(m - 1, m - 1) - at(m, m - 1) * at(m - 1, m))
        };
        let mut x = [
            at(l, l) * (at(l, l) - sum) + at(l, l + 1) * at(l + 1, l) + product,
            at(l + 1, l) * (at(l, l) + at(l + 1, l + 1) - sum),
            at(l + 1, l) * at(l + 2, l + 1),
        ];
        for k in l..m - 1 {
            if let Some(reflection) = Reflection::of(x) {
                self.reflect(&reflection, k, &block);
            }
            x = [self.at(k + 1, k), self.at(k + 2, k), if k + 3 <= m { self.at(k + 3, k) } else { 0.0 }];
        }
        if let Some(reflection) = Reflection::of([x[0], x[1]]) {
            self.reflect(&reflection, m - 1, &block);
        }
        (l + 2..=m).for_each(|i| (l.max(i.saturating_sub(3))..i - 1).for_each(|j| self.a[i * self.size + j] = 0.0));
    }

    /// Reflects rows and columns from k on, within a block.
    fn reflect<const N: usize>(&mut self, reflection: &Reflection<N>, k: usize, block: &Range<usize>) {
        let n = self.size;
        for j in k.saturating_sub(1).max(block.start)..block.end {
            let mut rest = self.a[k * n..].chunks_mut(n).map(|row| &mut row[j]);
            reflection.apply(std::array::from_fn(|_| rest.next().expect("the block has N rows from k on")));
        }
        for i in block.start..(k + N + 1).min(block.end) {
            let mut row = self.a[i * n + k..].iter_mut();
            reflection.apply(std::array::from_fn(|_| row.next().expect("the block has N columns from k on")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }

    fn eigenvalues(a: &DMatrix<f64>) -> Vec<Complex<f64>> {
        let mut spectrum = Spectrum::new(a.nrows());
        assert!(spectrum.find(a.as_slice()), "{a}");
        spectrum.values().map(|(value, _)| value).collect()
    }

    /// The largest distance between eigenvalues and those that are expected, each taken once, relative to its magnitude.
    fn apart(found: &[Complex<f64>], expected: &[Complex<f64>]) -> f64 {
        let mut left = found.to_vec();
        let far = expected.iter().map(|&value| {
            let distance = |k: usize| (left[k] - value).norm();
            let nearest = (0..left.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap();
            let distance = distance(nearest);
            left.swap_remove(nearest);
            distance / value.norm().max(1e-3)
        });
        far.fold(0.0, f64::max)
    }

    #[test]
    fn the_eigenvalues_of_random_matrices_of_any_size_are_those_they_were_made_with() {
        let mut state = 1;
        for size in (1..=24).chain([60]) {
            for _ in 0..20 {
                // Blocks of known eigenvalues from 0.1 to 1e5 rad/s, seen in other coordinates.
                let mut blocks = DMatrix::zeros(size, size);
                let mut expected = Vec::new();
                while expected.len() < size {
                    let k = expected.len();
                    let frequency = 10_f64.powf(2.0 + 6.0 * random(&mut state));
                    let real = random(&mut state) * frequency;
                    blocks[(k, k)] = real;
                    if k + 1 < size && random(&mut state) > 0.0 {
                        (blocks[(k + 1, k + 1)], blocks[(k, k + 1)], blocks[(k + 1, k)]) =
                            (real, frequency, -frequency);
                        expected.extend([Complex::new(real, frequency), Complex::new(real, -frequency)]);
                    } else {
                        expected.push(Complex::new(real, 0.0));
                    }
                }
                let basis = DMatrix::from_fn(size, size, |_, _| random(&mut state)).qr().q();
                let scale =
                    DMatrix::from_fn(size, size, |i, j| if i == j { 10_f64.powi(i as i32 % 9 - 4) } else { 0.0 });
                let a = &scale * &basis * blocks * basis.transpose() * scale.clone().try_inverse().unwrap();
                let off = apart(&eigenvalues(&a), &expected);
                // Fast and slow eigenvalues in one dense matrix: the slow ones are as exact as rounding leaves them.
                assert!(off < 1e-5, "{size}: off by {off:e}");
            }
        }
    }

    #[test]
    fn many_equal_eigenvalues_among_large_ones_are_found() {
        // As a network's: each of its weights decays at one rate, and two products of vectors couple them.
        let mut state = 3;
        for (size, large) in [(40, 90.0), (64, 2e3), (64, 1e6), (184, 1e6), (184, 2e9)] {
            for _ in 0..3 {
                let mut vector = || DVector::from_fn(size, |_, _| random(&mut state));
                let (p, q) = (vector().normalize(), vector());
                let (r, s) = (vector(), vector());
                let q = &q / q.dot(&p);
                let s = &s - &q * s.dot(&p);
                let r = &r - &p * q.dot(&r);
                let s = &s / s.dot(&r);
                // q·p = s·r = 1, s·p = q·r = 0: the products' eigenvectors are p and r.
                let a = DMatrix::identity(size, size) * -0.75 - &p * q.transpose() * large - &r * s.transpose() * 3.0;
                let mut expected = vec![Complex::new(-0.75, 0.0); size];
                (expected[0].re, expected[1].re) = (-0.75 - large, -3.75);
                let mut spectrum = Spectrum::new(size);
                assert!(spectrum.find(a.as_slice()), "{size}, {large:e}");
                let found: Vec<_> = spectrum.values().collect();
                let noise = found[0].1;
                let values: Vec<_> = found.into_iter().map(|(value, _)| value).collect();
                let off = apart(&values, &expected);
                assert!(off < 100.0 * noise, "{size}, {large:e}: off by {off:e}, noise {noise:e}");
            }
        }
    }

    #[test]
    fn many_equal_pairs_next_to_a_large_one_are_found() {
        let mut state = 5;
        for (size, large) in [(24, 1e3), (60, 1e4), (100, 1e7)] {
            let mut blocks = DMatrix::zeros(size, size);
            let mut expected = Vec::new();
            for k in (0..size).step_by(2) {
                let (growth, frequency) = if k == 0 { (-0.1 * large, large) } else { (-0.2, 3.0) };
                let block = [growth, -frequency, frequency, growth];
                blocks.view_mut((k, k), (2, 2)).copy_from_slice(&block);
                expected.extend([Complex::new(growth, frequency), Complex::new(growth, -frequency)]);
            }
            let basis = DMatrix::from_fn(size, size, |_, _| random(&mut state)).qr().q();
            let a = &basis * blocks * basis.transpose();
            let off = apart(&eigenvalues(&a), &expected);
            assert!(off < 1e-13 * large, "{size}, {large:e}: off by {off:e}");
        }
    }

    #[test]
    fn isolated_eigenvalues_are_exact() {
        // A stiff chain, triangular in some order of its states.
        let a = DMatrix::from_row_slice(
            4,
            4,
            &[-1e9, 0.0, 3e5, 0.0, 1e3, 0.25, 7.0, 1e8, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0, 1e4, 0.0],
        );
        let mut found: Vec<_> = eigenvalues(&a).iter().map(|value| value.re).collect();
        found.sort_by(f64::total_cmp);
        assert_eq!(found, [-1e9, -3.0, 0.0, 0.25]);
    }

    #[test]
    fn multiple_and_zero_eigenvalues_are_found() {
        assert_eq!(eigenvalues(&DMatrix::zeros(5, 5)), [Complex::new(0.0, 0.0); 5]);
        // Cyclic shifts of four and of five states: the roots of one.
        for size in [4, 5] {
            let cycle = DMatrix::from_fn(size, size, |i, j| if j == (i + 1) % size { 1.0 } else { 0.0 });
            let roots: Vec<_> =
                (0..size).map(|k| Complex::from_polar(1.0, std::f64::consts::TAU * k as f64 / size as f64)).collect();
            assert!(apart(&eigenvalues(&cycle), &roots) < 1e-13);
        }
        let jordan = DMatrix::from_fn(3, 3, |i, j| {
            if i == j {
                -2.0
            } else if j == i + 1 {
                1.0
            } else {
                0.0
            }
        });
        assert_eq!(eigenvalues(&jordan), [Complex::new(-2.0, 0.0); 3]);
    }

    #[test]
    fn a_matrix_without_numbers_is_refused() {
        for bad in [f64::NAN, f64::INFINITY, 1e200] {
            assert!(!Spectrum::new(2).find(&[bad, 1.0, 1.0, 2.0]));
        }
        assert!(Spectrum::new(0).find(&[]));
    }
}
