//! The matched equivalent T(s) = H_m(s)⁻¹ H_um(s) of an unmatched disturbance: what has to enter along with the control
//! to act on the output just as the disturbance does.
//!
//! T(s) is the inverse of x' = A_m x + B u + B_um d, y = C x: it gives −u for which y stays zero. y is differentiated
//! until the control shows in it (L. M. Silverman, Inversion of multivariable linear systems, IEEE Trans. Automatic
//! Control 14 (1969) 270–276). Whatever doesn't show the control yet is an equation between x, d and the derivatives of
//! d; those left free by these equations are the states of the inverse, whose poles are the zeros of H_m(s).
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::allocator::Allocator;
use nalgebra::{Complex, DMatrix, DVector, DefaultAllocator, Dim, OMatrix, RowDVector};

use crate::eigenvalues::complex as eigenvalues;
use crate::error::Invalid;
use crate::mathematics::filter::Filter;
use crate::mathematics::lyapunov::eigenvalue_text;

/// Smallest size of a term, relative to its standard deviation in [`Equation`], that counts as nonzero.
const ROUNDING: f64 = 1e-12;

/// Least distance of a zero from the imaginary axis, relative to ‖A_z‖, to count as stable.
const MARGIN: f64 = 1e-10;

/// Largest distance of H_m(s) T(s) from H_um(s), relative to the sizes of both factors.
const ACCURACY: f64 = 1e-6;

/// T(s) = Σ h_j s^j + C_z (sI − A_z)⁻¹ B_z = H_m(s)⁻¹ H_um(s), with H_m(s) = C (sI − A_m)⁻¹ B and
/// H_um(s) = C (sI − A_m)⁻¹ B_um.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchedEquivalent {
    /// The coefficients h_j, m × k, constant first. At least one.
    pub polynomial: Vec<DMatrix<f64>>,
    /// n_z × n_z. Its eigenvalues are the zeros of H_m(s).
    pub A_z: DMatrix<f64>,
    /// n_z × k.
    pub B_z: DMatrix<f64>,
    /// m × n_z.
    pub C_z: DMatrix<f64>,
}

/// The polynomial part behind a filter D(s), on the filter's own states.
///
/// A channel f' = A_f f + B_f w with the output C_f f becomes f' = A_f f + B_f w + Σ A_f^j B_f (h_j d)_i, with the output
/// C_f f + direct (h_ρ d)_i, where ρ is the relative degree of D(s).
#[derive(Debug, Clone, PartialEq)]
pub struct FilteredPolynomial {
    /// A_f^j B_f, one for each coefficient.
    pub inputs: Vec<DVector<f64>>,
    /// C_f A_f^(ρ−1) B_f where the degree is ρ, else zero.
    pub direct: f64,
}

impl MatchedEquivalent {
    /// T(s) for A_m (n × n, with the name that messages call it by), B (n × m), C (m × n) and B_um (n × k).
    ///
    /// # Errors
    /// [`Invalid`] when H_m(s) has no inverse or none that is stable, or rounding would spoil it.
    pub fn new(
        (name, A_m): (&str, &DMatrix<f64>),
        B: &DMatrix<f64>,
        C: &DMatrix<f64>,
        B_um: &DMatrix<f64>,
    ) -> Result<Self, Invalid> {
        if [A_m, B, C, B_um].iter().any(|matrix| !matrix.norm_squared().is_finite()) {
            return Err(too_bad(name));
        }
        let (plant, input_scales) = Plant::scaled(A_m, B, C, B_um);
        let (constraints, direct) = plant.structure(name)?;
        let mut equivalent = plant.equivalent(&constraints, &direct).ok_or_else(|| too_bad(name))?;
        equivalent.require_minimum_phase(name)?;
        if !plant.is_matched_by(&equivalent) {
            return Err(too_bad(name));
        }
        for (i, scale) in input_scales.iter().enumerate() {
            equivalent.C_z.row_mut(i).scale_mut(*scale);
            equivalent.polynomial.iter_mut().for_each(|h| h.row_mut(i).scale_mut(*scale));
        }
        Ok(equivalent)
    }

    /// Degree of the polynomial part, the order of the highest derivative of the disturbance in T(s) d.
    pub fn degree(&self) -> usize {
        self.polynomial.len() - 1
    }

    /// The zeros of H_m(s), 1/s. `None` where A_z is too badly scaled to find its eigenvalues.
    pub fn zeros(&self) -> Option<Vec<Complex<f64>>> {
        eigenvalues(&self.A_z)
    }

    /// T(s). Infinite at a zero of H_m(s).
    pub fn at(&self, s: Complex<f64>) -> DMatrix<Complex<f64>> {
        let zero = DMatrix::zeros(self.C_z.nrows(), self.B_z.ncols());
        let polynomial = self.polynomial.iter().rev().fold(zero, |sum, h| sum * s + complex(h));
        if self.A_z.is_empty() {
            return polynomial;
        }
        let shifted = DMatrix::identity(self.A_z.nrows(), self.A_z.nrows()) * s - complex(&self.A_z);
        match shifted.lu().solve(&complex(&self.B_z)) {
            Some(states) => polynomial + complex(&self.C_z) * states,
            None => polynomial.map(|_| Complex::from(f64::INFINITY)),
        }
    }

    /// The polynomial part behind D(s), without differentiating anything.
    ///
    /// # Errors
    /// [`Invalid`] when its degree exceeds the relative degree of D(s).
    pub fn behind(&self, filter: &Filter) -> Result<FilteredPolynomial, Invalid> {
        let (degree, relative_degree) = (self.degree(), filter.relative_degree());
        if degree > relative_degree {
            let allowed = format!(
                "must be at least {degree}, the highest power of s in H_m(s)^-1 H_um(s), for D(s) H_m(s)^-1 H_um(s) to \
                 be proper: give D(s) more poles"
            );
            return Err(Invalid::new("D(s): relative degree", relative_degree, allowed));
        }
        // D(s) s^j = C_f (sI − A_f)⁻¹ A_f^j B_f + Σ C_f A_f^i B_f s^(j−1−i) over i < j, where only i = ρ − 1 is left.
        let inputs = filter.inputs(degree);
        let direct = if degree == relative_degree { (&filter.C_f * &inputs[degree - 1])[0] } else { 0.0 };
        Ok(FilteredPolynomial { inputs, direct })
    }

    fn require_minimum_phase(&self, name: &str) -> Result<(), Invalid> {
        let margin = MARGIN * self.A_z.norm();
        let Some(zeros) = self.zeros() else {
            let text = format!("the zeros of C (sI - {name})^-1 B can't be found: {name}, B, C are too badly scaled");
            return Err(Invalid::because(text));
        };
        match zeros.into_iter().find(|zero| zero.re >= -margin) {
            None => Ok(()),
            Some(zero) => Err(Invalid::new(
                format!("zero of C (sI - {name})^-1 B"),
                eigenvalue_text(&zero),
                "must have a negative real part, or its inverse is unstable: choose other outputs C",
            )),
        }
    }
}

/// An equation a x + b u + c_0 d + c_1 d' + … = 0 that holds at all times while the output stays zero.
#[derive(Clone)]
struct Equation {
    /// a, b, c_0, c_1, … side by side.
    terms: RowDVector<f64>,
    /// The variance of each term, were every entry of A_m, B, C and B_um uncertain by its own size.
    variances: RowDVector<f64>,
}

impl Equation {
    fn subtract(&mut self, factor: f64, other: &Equation) {
        self.terms -= &other.terms * factor;
        self.variances += &other.variances * factor.powi(2);
    }

    /// Takes out the term in column `j` by another equation that has one.
    fn eliminate(&mut self, j: usize, other: &Equation) {
        self.subtract(self.terms[j] / other.terms[j], other);
        (self.terms[j], self.variances[j]) = (0.0, 0.0);
    }
}

/// x' = A x + B u + E d, y = C x.
struct Plant {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    E: DMatrix<f64>,
}

impl Plant {
    /// The plant in units of states, inputs and outputs that bring its entries near to each other, and the units of
    /// the inputs. All are powers of two, which leave no rounding.
    ///
    /// The logarithms of the entries are levelled by least squares, up to the unit of time (after A. R. Curtis, J. K. Reid, On
    /// the automatic scaling of matrices for Gaussian elimination, IMA J. Appl. Math. 10 (1972) 118–124), so that the
    /// units in which a plant is given don't matter.
    fn scaled(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>, E: &DMatrix<f64>) -> (Plant, Vec<f64>) {
        let (n, m) = B.shape();
        // Unknown exponents: states, inputs, outputs, time. An entry of A, B, C changes by those of its column and row.
        let (input, output, time) = (n, n + m, n + 2 * m);
        let (mut equations, mut levels) = (Vec::new(), Vec::new());
        for (matrix, row, column) in [(A, 0, 0), (B, 0, input), (C, output, 0)] {
            for (j, i) in (0..matrix.ncols()).flat_map(|j| (0..matrix.nrows()).map(move |i| (j, i))) {
                if matrix[(i, j)] != 0.0 {
                    let mut equation = RowDVector::zeros(time + 1);
                    equation[column + j] += 1.0;
                    equation[row + i] -= 1.0;
                    equation[time] = if row == column { -1.0 } else { 0.0 };
                    equations.push(equation);
                    levels.push(-matrix[(i, j)].abs().log2());
                }
            }
        }
        let exponents = DMatrix::from_rows(&equations).svd(true, true).solve(&DVector::from_vec(levels), 1e-9);
        let units = exponents.map_or(vec![1.0; time], |e| e.iter().map(|e| e.round().exp2()).collect());
        let (x, u, y) = (&units[..n], &units[input..output], &units[output..time]);
        let plant = Plant {
            A: DMatrix::from_fn(n, n, |i, j| A[(i, j)] * x[j] / x[i]),
            B: DMatrix::from_fn(n, m, |i, j| B[(i, j)] * u[j] / x[i]),
            C: DMatrix::from_fn(m, n, |i, j| C[(i, j)] * x[j] / y[i]),
            E: DMatrix::from_fn(n, E.ncols(), |i, j| E[(i, j)] / x[i]),
        };
        (plant, u.to_vec())
    }

    /// The equations between only states and disturbances, orthonormal in the states, and those that give the inputs.
    ///
    /// # Errors
    /// [`Invalid`] when there are fewer of these than inputs.
    fn structure(&self, name: &str) -> Result<(Vec<Equation>, Vec<Equation>), Invalid> {
        let (n, m) = self.B.shape();
        let (mut constraints, mut direct) = (Vec::<Equation>::new(), Vec::new());
        let mut pending: Vec<_> = self.C.row_iter().map(|row| self.equation(row.into_owned())).collect();
        while !pending.is_empty() {
            take_direct(&mut pending, &mut direct, n..n + m);
            for equation in &mut pending {
                equation.terms.columns_mut(n, m).fill(0.0);
                // Twice: once leaves the rounding of the larger parts.
                for known in constraints.iter().chain(&constraints) {
                    equation.subtract(equation.terms.columns(0, n).dot(&known.terms.columns(0, n)), known);
                }
                let left = equation.terms.columns(0, n).norm();
                if !left.is_finite() {
                    return Err(too_bad(name));
                }
                // There are no more independent equations than states.
                if constraints.len() == n || left <= ROUNDING * equation.variances.columns(0, n).sum().sqrt() {
                    return Err(Invalid::because(format!(
                        "C (sI - {name})^-1 B is singular, or nearly so, at every s: the inputs don't move the outputs \
                         independently of each other; choose other outputs C"
                    )));
                }
                equation.terms /= left;
                equation.variances /= left.powi(2);
                constraints.push(equation.clone());
                *equation = self.derivative(equation);
            }
        }
        Ok((constraints, direct.into_iter().map(|(_, equation)| equation).collect()))
    }

    /// c x = 0.
    fn equation(&self, c: RowDVector<f64>) -> Equation {
        // No equation is differentiated more often than there are states.
        let (n, m, k) = (self.A.nrows(), self.B.ncols(), self.E.ncols());
        let terms = c.resize_horizontally(n + m + k * n, 0.0);
        Equation { variances: squares(&terms), terms }
    }

    /// The derivative of an equation without inputs.
    fn derivative(&self, equation: &Equation) -> Equation {
        let (n, m, k) = (self.A.nrows(), self.B.ncols(), self.E.ncols());
        let along = |row: &RowDVector<f64>, A: &DMatrix<f64>, B: &DMatrix<f64>, E: &DMatrix<f64>| {
            let mut rate = RowDVector::zeros(row.len());
            let x = row.columns(0, n);
            rate.columns_mut(0, n).copy_from(&(x * A));
            rate.columns_mut(n, m).copy_from(&(x * B));
            rate.columns_mut(n + m, k).copy_from(&(x * E));
            rate.columns_mut(n + m + k, k * (n - 1)).copy_from(&row.columns(n + m, k * (n - 1)));
            rate
        };
        Equation {
            terms: along(&equation.terms, &self.A, &self.B, &self.E),
            variances: along(&equation.variances, &squares(&self.A), &squares(&self.B), &squares(&self.E)),
        }
    }

    /// T(s) from the equations of the structure. `None` when rounding leaves the inputs undetermined.
    fn equivalent(&self, constraints: &[Equation], direct: &[Equation]) -> Option<MatchedEquivalent> {
        let (n, m) = self.B.shape();
        let stack = |rows: &[Equation], of: fn(&Equation) -> &RowDVector<f64>| {
            DMatrix::from_fn(rows.len(), n + m + self.E.ncols() * n, |i, j| of(&rows[i])[j])
        };
        let known = stack(constraints, |equation| &equation.terms);
        let driven = stack(direct, |equation| &equation.terms);
        let D_inverse = driven.columns(n, m).into_owned().try_inverse()?;
        let given = &D_inverse * driven;
        // A basis of the states that the constraints leave free.
        let basis = known.columns(0, n).transpose().resize(n, n, 0.0).qr().q();
        let W = basis.columns(known.nrows(), n - known.nrows()).into_owned();
        let inverse = Inverse::new(self, -1.0, &known, &given, W);
        let (mut polynomial, B_z) = inverse.divided();
        let variances = {
            let plant = Plant { A: squares(&self.A), B: squares(&self.B), C: squares(&self.C), E: squares(&self.E) };
            let known = stack(constraints, |equation| &equation.variances);
            let driven = stack(direct, |equation| &equation.variances);
            let given = squares(&D_inverse) * (&driven + driven.columns(n, m) * squares(&given));
            Inverse::new(&plant, 1.0, &known, &given, squares(&inverse.W)).divided().0
        };
        let beyond_rounding = |(h, variance): (&DMatrix<f64>, &DMatrix<f64>)| {
            h.iter().zip(variance).any(|(h, variance)| h.abs() > ROUNDING * variance.sqrt())
        };
        let degree = polynomial.iter().zip(&variances).rposition(beyond_rounding).unwrap_or(0);
        polynomial.truncate(degree + 1);
        Some(MatchedEquivalent { polynomial, C_z: &inverse.K_x * &inverse.W, A_z: inverse.A_z, B_z })
    }

    /// True if H_m(s) T(s) = H_um(s) where neither is large for a reason of its own: at the mirror images of stable poles,
    /// and beyond all poles where one isn't stable.
    fn is_matched_by(&self, equivalent: &MatchedEquivalent) -> bool {
        let (n, m) = self.B.shape();
        let Some(poles) = eigenvalues(&self.A) else { return false };
        let beyond = Complex::from(2.0 * self.A.norm());
        poles.into_iter().map(|pole| if pole.re < 0.0 { -pole.conj() } else { beyond }).all(|point| {
            let shifted = DMatrix::identity(n, n) * point - complex(&self.A);
            let lu = shifted.lu();
            let (Some(x_m), Some(x_um)) = (lu.solve(&complex(&self.B)), lu.solve(&complex(&self.E))) else {
                return false;
            };
            let (H_m, H_um, T) = (complex(&self.C) * x_m, complex(&self.C) * x_um, equivalent.at(point));
            let error = &H_m * &T - &H_um;
            let size = |i: usize, j: usize| H_m.row(i).norm() * T.column(j).norm() + H_um[(i, j)].norm();
            (0..T.ncols()).all(|j| (0..m).all(|i| error[(i, j)].norm() <= ACCURACY * size(i, j)))
        })
    }
}

/// Moves to `direct` as many of the pending equations as give inputs (their columns are named) independently of each
/// other, each with the column of the input that it gives, and takes these inputs out of the others.
fn take_direct(pending: &mut Vec<Equation>, direct: &mut Vec<(usize, Equation)>, inputs: std::ops::Range<usize>) {
    for equation in pending.iter_mut() {
        direct.iter().for_each(|(j, given)| equation.eliminate(*j, given));
    }
    loop {
        let candidates = pending.iter().enumerate().flat_map(|(i, equation)| {
            let size = equation.variances.columns_range(inputs.clone()).max().sqrt();
            inputs.clone().map(move |j| (equation.terms[j].abs(), ROUNDING * size, i, j))
        });
        let certain = candidates.filter(|(term, rounding, ..)| term > rounding);
        let Some((.., i, j)) = certain.max_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1))) else { return };
        let given = pending.remove(i);
        pending.iter_mut().for_each(|equation| equation.eliminate(j, &given));
        direct.push((j, given));
    }
}

/// The system that keeps the output at zero, x = W z + V(s) d: z' = A_z z + b(s) d, −u = K_x x + K_d(s) d. Polynomials
/// in s are lists of coefficients, constant first.
struct Inverse {
    W: DMatrix<f64>,
    V: Vec<DMatrix<f64>>,
    K_x: DMatrix<f64>,
    K_d: Vec<DMatrix<f64>>,
    A_z: DMatrix<f64>,
    b: Vec<DMatrix<f64>>,
}

impl Inverse {
    /// From L x + … = 0 and K_x x + u + … = 0, given with all their terms. What is subtracted has the sign −1; with
    /// variances in place of terms, squares in place of the plant and W, and the sign 1, each entry is its variance.
    fn new(plant: &Plant, sign: f64, known: &DMatrix<f64>, given: &DMatrix<f64>, W: DMatrix<f64>) -> Self {
        let (n, m) = plant.B.shape();
        let k = plant.E.ncols();
        let order = |rows: &DMatrix<f64>, j: usize| rows.columns(n + m + k * j, k).into_owned();
        let K_x = given.columns(0, n).into_owned();
        let K_d: Vec<_> = (0..n).map(|j| order(given, j)).collect();
        let V: Vec<_> = (0..n).map(|j| known.columns(0, n).transpose() * order(known, j) * sign).collect();
        let closed = &plant.A + &plant.B * &K_x * sign;
        let b = (0..n).map(|j| {
            let driven = &plant.B * &K_d[j] * sign + if j == 0 { plant.E.clone() } else { plant.E.clone() * 0.0 };
            W.transpose() * (&closed * &V[j] + driven)
        });
        Inverse { b: b.collect(), A_z: W.transpose() * &closed * &W, W, V, K_x, K_d }
    }

    /// The polynomial part of −u and the input matrix of what is left: b(s) = (sI − A_z) q(s) + B_z.
    fn divided(&self) -> (Vec<DMatrix<f64>>, DMatrix<f64>) {
        let mut remainder = DMatrix::zeros(self.A_z.nrows(), self.b[0].ncols());
        let mut polynomial = Vec::with_capacity(self.b.len());
        for (j, b) in self.b.iter().enumerate().rev() {
            // Still q_j, the quotient's coefficient.
            polynomial.push(&self.K_x * (&self.W * &remainder + &self.V[j]) + &self.K_d[j]);
            remainder = b + &self.A_z * remainder;
        }
        polynomial.reverse();
        (polynomial, remainder)
    }
}

fn too_bad(name: &str) -> Invalid {
    Invalid::because(format!("{name}, B, C: too badly scaled to invert C (sI - {name})^-1 B in double precision"))
}

/// The square of each entry.
fn squares<R: Dim, C: Dim>(matrix: &OMatrix<f64, R, C>) -> OMatrix<f64, R, C>
where
    DefaultAllocator: Allocator<R, C>,
{
    matrix.component_mul(matrix)
}

fn complex(matrix: &DMatrix<f64>) -> DMatrix<Complex<f64>> {
    matrix.map(Complex::from)
}

#[cfg(test)]
mod tests;
