//! The filter D(s) of an L1 adaptive law, in state space.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix, DVector, RowDVector};
use serde::Deserialize;

use crate::error::{Invalid, Number};

/// D(s) = gain · (product of numerator factors) / (product of denominator factors).
///
/// A factor is a polynomial of degree one or two, highest power first: s/25 + 1 is `[0.04, 1]`. Without factors D(s) is
/// 1/s.
#[derive(Debug, Clone, PartialEq, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilterDescription {
    /// Its factor.
    pub gain: f64,
    /// Its zeros: factors of first or second degree, highest power of s first, none of them 0.
    pub numerator: Vec<Vec<f64>>,
    /// Its poles, likewise: one at 0 (`[1.0, 0.0]`), the others stable, more than there are zeros.
    pub denominator: Vec<Vec<f64>>,
}

impl Default for FilterDescription {
    fn default() -> Self {
        FilterDescription { gain: 1.0, numerator: vec![], denominator: vec![vec![1.0, 0.0]] }
    }
}

/// One channel of D(s): f' = A_f f + B_f w, with the output C_f f.
///
/// A cascade of sections of unit static gain behind an integrator, which stays well scaled where the coefficients of
/// the expanded polynomials spread over decades. The first state is the integral of w.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// n_f × n_f.
    pub A_f: DMatrix<f64>,
    /// n_f.
    pub B_f: DVector<f64>,
    /// n_f. The row that gives the output.
    pub C_f: RowDVector<f64>,
}

impl Filter {
    /// The filter of a description.
    ///
    /// # Errors
    /// [`Invalid`] naming the factor that has no place in a D(s): strictly proper, with exactly one pole at 0 and all
    /// others in the open left half plane.
    pub fn new(description: &FilterDescription) -> Result<Self, Invalid> {
        let FilterDescription { gain, numerator, denominator } = description;
        if !gain.is_finite() || *gain == 0.0 {
            return Err(Invalid::new("D(s): gain", Number(*gain), "must be finite and not zero"));
        }
        let numerator = factors("numerator", numerator)?;
        if let Some(zero) = numerator.iter().find(|factor| factor.last() == Some(&0.0)) {
            let allowed = "must have no root at 0, which would cancel the integrator";
            return Err(Invalid::new("D(s): numerator factor", format!("{zero:?}"), allowed));
        }
        let (mut gain, mut sections) = (*gain, Vec::new());
        for factor in factors("denominator", denominator)? {
            gain /= take_poles(&factor, &mut sections)?;
        }
        let integrators = sections.iter().filter(|section| section.poles == Poles::Integrator).count();
        if integrators != 1 {
            let allowed = "must be exactly one, as in the factor [1, 0]: D(s) needs an integrator";
            return Err(Invalid::new("D(s): denominator roots at 0", integrators, allowed));
        }
        require_strictly_proper(&numerator, &sections)?;
        // A stable sort: the integrator first, the others as described.
        sections.sort_by_key(|section| section.poles != Poles::Integrator);
        attach(numerator, &mut sections);
        Ok(realise(&sections, gain))
    }

    /// Number of states.
    pub fn order(&self) -> usize {
        self.B_f.len()
    }

    /// Excess of the denominator's degree over the numerator's in D(s): the number of differentiations of the output
    /// until the input appears.
    pub fn relative_degree(&self) -> usize {
        // The cascade leaves exact zeros before: no sum in it cancels.
        let mut input = self.B_f.clone();
        let mut degree = 1;
        while (&self.C_f * &input)[0] == 0.0 && degree < self.order() {
            input = &self.A_f * input;
            degree += 1;
        }
        degree
    }

    /// A_f^j B_f for j = 0 … degree.
    pub fn inputs(&self, degree: usize) -> Vec<DVector<f64>> {
        std::iter::successors(Some(self.B_f.clone()), |input| Some(&self.A_f * input)).take(degree + 1).collect()
    }

    /// True if D(s) = 1/s, its state being the output.
    pub fn is_integrator(&self) -> bool {
        self.order() == 1 && (self.A_f[(0, 0)], self.B_f[0], self.C_f[0]) == (0.0, 1.0, 1.0)
    }

    /// The state in which the filter rests with an output of 1 while nothing drives it.
    pub fn at_rest(&self) -> DVector<f64> {
        // One pole at 0: A_f f = 0 leaves one direction, and C_f f = 1 its length.
        let n = self.order();
        let mut system = DMatrix::zeros(n + 1, n);
        system.rows_mut(0, n).copy_from(&self.A_f);
        system.row_mut(n).copy_from(&self.C_f);
        let mut right = DVector::zeros(n + 1);
        right[n] = 1.0;
        system.svd(true, true).solve(&right, 0.0).unwrap_or_else(|_| DVector::zeros(n))
    }

    /// D(s). Infinite at a pole.
    pub fn at(&self, s: Complex<f64>) -> Complex<f64> {
        let n = self.order();
        let shifted = DMatrix::identity(n, n) * s - self.A_f.map(Complex::from);
        let states = shifted.lu().solve(&self.B_f.map(Complex::from));
        states.map_or(Complex::from(f64::INFINITY), |f| (self.C_f.map(Complex::from) * f)[0])
    }
}

/// Poles of a section of the cascade.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Poles {
    /// 1/s.
    Integrator,
    /// 1/(s/p + 1).
    One(f64),
    /// 1/(s²/ω² + 2ζω s/ω² + 1): ω and 2ζω.
    Two(f64, f64),
}

/// Poles, and the zeros attached to them: constant first, no more than there are poles.
#[derive(Debug, Clone, PartialEq)]
struct Section {
    poles: Poles,
    zeros: Vec<f64>,
}

impl Section {
    fn new(poles: Poles) -> Self {
        Section { poles, zeros: vec![1.0] }
    }

    fn order(&self) -> usize {
        if matches!(self.poles, Poles::Two(..)) { 2 } else { 1 }
    }

    /// Number of zeros that can still be added.
    fn room(&self) -> usize {
        self.order() + 1 - self.zeros.len()
    }
}

/// Factors of finite numbers, of degree one or two.
fn factors(name: &str, described: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, Invalid> {
    let unfit = |factor: &&Vec<f64>| {
        !(2..=3).contains(&factor.len()) || factor[0] == 0.0 || factor.iter().any(|entry| !entry.is_finite())
    };
    match described.iter().find(unfit) {
        None => Ok(described.to_vec()),
        Some(factor) => Err(Invalid::new(
            format!("D(s): {name} factor"),
            format!("{factor:?}"),
            "must be two or three finite numbers, highest power first, the first not zero",
        )),
    }
}

/// Adds the sections of a denominator factor; gives the constant by which the factor exceeds theirs.
fn take_poles(factor: &[f64], sections: &mut Vec<Section>) -> Result<f64, Invalid> {
    match *factor {
        [a, 0.0] => Ok(add(sections, Poles::Integrator, a)),
        // s (a s + b).
        [a, b, 0.0] => {
            let constant = take_poles(&[a, b], sections)?;
            Ok(add(sections, Poles::Integrator, constant))
        }
        [a, b] if b / a > 0.0 => Ok(add(sections, Poles::One(b / a), b)),
        [a, b, c] if b / a > 0.0 && c / a > 0.0 => Ok(add(sections, Poles::Two((c / a).sqrt(), b / a), c)),
        _ => Err(Invalid::new(
            "D(s): denominator factor",
            format!("{factor:?}"),
            "must have its roots in the open left half plane (but for one root at 0): coefficients of one sign",
        )),
    }
}

/// Adds a section, for a factor that is this constant times the section's.
fn add(sections: &mut Vec<Section>, poles: Poles, constant: f64) -> f64 {
    sections.push(Section::new(poles));
    constant
}

fn require_strictly_proper(numerator: &[Vec<f64>], sections: &[Section]) -> Result<(), Invalid> {
    let zeros: usize = numerator.iter().map(|factor| factor.len() - 1).sum();
    let poles: usize = sections.iter().map(Section::order).sum();
    if zeros < poles {
        return Ok(());
    }
    let allowed = format!(
        "must be below the degree of the denominator, {poles}: otherwise the control law u = -K D(s) (eta - K_g r) \
         contains an algebraic loop"
    );
    Err(Invalid::new("D(s): degree of the numerator", zeros, allowed))
}

/// Gives each numerator factor to a section with room for it, the integrator last, so that its state stays the
/// integral of the input.
fn attach(mut numerator: Vec<Vec<f64>>, sections: &mut Vec<Section>) {
    numerator.iter_mut().for_each(|factor| factor.reverse());
    let (pairs, singles): (Vec<_>, Vec<_>) = numerator.into_iter().partition(|factor| factor.len() == 3);
    while sections.iter().filter(|section| section.order() == 2).count() < pairs.len() {
        join_two(sections);
    }
    for factor in pairs.into_iter().chain(singles) {
        let fits = |section: &&mut Section| section.room() + 1 >= factor.len();
        let section = sections.iter_mut().rev().find(fits).expect("there are more poles than zeros");
        section.zeros = product(&section.zeros, &factor);
    }
}

/// Joins two sections of one pole, so that a pair of complex zeros finds a place.
fn join_two(sections: &mut Vec<Section>) {
    let pole = |(k, section): (usize, &Section)| if let Poles::One(p) = section.poles { Some((k, p)) } else { None };
    let single: Vec<_> = sections.iter().enumerate().filter_map(pole).take(2).collect();
    let [(first, p), (second, q)] = single[..] else { panic!("there are more poles than zeros") };
    sections[first] = Section::new(Poles::Two((p * q).sqrt(), p + q));
    sections.remove(second);
}

/// Product of polynomials, constant first.
fn product(p: &[f64], q: &[f64]) -> Vec<f64> {
    let mut coefficients = vec![0.0; p.len() + q.len() - 1];
    for (i, a) in p.iter().enumerate() {
        for (j, b) in q.iter().enumerate() {
            coefficients[i + j] += a * b;
        }
    }
    coefficients
}

/// The cascade as one system. Every signal in it is a row over the states and, last, the input.
fn realise(sections: &[Section], gain: f64) -> Filter {
    let n = sections.iter().map(Section::order).sum();
    let unit = |k: usize| RowDVector::from_fn(n + 1, |_, j| f64::from(u8::from(j == k)));
    let mut rates = DMatrix::zeros(n, n + 1);
    let mut signal = unit(n);
    let mut k = 0;
    for section in sections {
        // The section's own output, and its derivatives as far as they are wanted.
        let mut derivatives = vec![unit(k)];
        match section.poles {
            Poles::Integrator => derivatives.push(signal),
            Poles::One(p) => derivatives.push((signal - unit(k)) * p),
            Poles::Two(omega, damping) => {
                // Two states of one size: x1' = ω x2, x2' = ω (in − x1) − 2ζω x2.
                let second = (signal - unit(k)) * omega - unit(k + 1) * damping;
                rates.set_row(k + 1, &second);
                derivatives.extend([unit(k + 1) * omega, second * omega]);
            }
        }
        rates.set_row(k, &derivatives[1]);
        k += section.order();
        signal = section.zeros.iter().zip(&derivatives).fold(RowDVector::zeros(n + 1), |sum, (b, d)| sum + d * *b);
    }
    Filter {
        A_f: rates.columns(0, n).into_owned(),
        B_f: rates.column(n).into_owned(),
        C_f: signal.columns(0, n) * gain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_rest_nothing_moves_and_the_output_is_1() {
        let description = FilterDescription {
            gain: 3.0,
            numerator: vec![vec![0.5, 1.0]],
            denominator: vec![vec![1.0, 0.0], vec![0.04, 1.0], vec![6.25e-4, 0.045, 1.0]],
        };
        let filter = Filter::new(&description).unwrap();
        let f = filter.at_rest();
        assert!((&filter.A_f * &f).norm() < 1e-12 && ((&filter.C_f * &f)[0] - 1.0).abs() < 1e-12, "{f}");
        assert!(!filter.is_integrator() && Filter::new(&FilterDescription::default()).unwrap().is_integrator());
    }

    fn description(gain: f64, numerator: &[&[f64]], denominator: &[&[f64]]) -> FilterDescription {
        let owned = |factors: &[&[f64]]| factors.iter().map(|factor| factor.to_vec()).collect();
        FilterDescription { gain, numerator: owned(numerator), denominator: owned(denominator) }
    }

    fn refusal(gain: f64, numerator: &[&[f64]], denominator: &[&[f64]]) -> String {
        Filter::new(&description(gain, numerator, denominator)).unwrap_err().to_string()
    }

    /// The quotient as it is written.
    fn quotient(d: &FilterDescription, s: Complex<f64>) -> Complex<f64> {
        let product = |factors: &[Vec<f64>]| -> Complex<f64> {
            factors.iter().map(|f| f.iter().fold(Complex::from(0.0), |sum, &a| sum * s + a)).product()
        };
        product(&d.numerator) / product(&d.denominator) * d.gain
    }

    #[test]
    fn without_a_description_it_is_an_integrator() {
        let described: FilterDescription = toml::from_str("").unwrap();
        let filter = Filter::new(&described).unwrap();
        assert_eq!((filter.A_f[(0, 0)], filter.B_f[0], filter.C_f[0], filter.order()), (0.0, 1.0, 1.0, 1));
        assert!(toml::from_str::<FilterDescription>("zeros = []").is_err());
    }

    #[test]
    fn a_filter_of_fifth_order_is_a_well_scaled_cascade() {
        let text = "denominator = [[1, 0], [0.04, 1], [0.014285714285714285, 1], [6.25e-4, 0.045, 1]]";
        let filter = Filter::new(&toml::from_str(text).unwrap()).unwrap();
        // i' = w, p' = 25 (i − p), q' = 70 (p − q), w1' = 40 w2, w2' = 40 (q − w1) − 72 w2, output w1.
        let rows = [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [25.0, -25.0, 0.0, 0.0, 0.0],
            [0.0, 70.0, -70.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 40.0],
            [0.0, 0.0, 40.0, -40.0, -72.0],
        ];
        let expected = DMatrix::from_row_slice(5, 5, &rows.concat());
        assert!((&filter.A_f - expected).amax() < 1e-12, "{}", filter.A_f);
        assert_eq!(filter.B_f.as_slice(), [1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(filter.C_f.as_slice(), [0.0, 0.0, 0.0, 1.0, 0.0]);
    }

    #[test]
    fn the_cascade_is_the_quotient_of_its_factors() {
        let filters = [
            description(3.0, &[], &[&[2.0, 0.0]]),
            description(2.0, &[&[1.0, 1.8]], &[&[1.0, 0.0], &[0.5, 4.0], &[-1.0, -70.0]]),
            description(1.0, &[&[1.0, 0.2, 9.0]], &[&[0.04, 1.0], &[1.0, 0.0], &[0.01, 2.0]]),
            description(-0.7, &[&[1.0, -3.0], &[2.0, 5.0]], &[&[1.0, 3.0, 9.0], &[1.0, 0.0]]),
            description(1.0, &[&[1.0, 3.0]], &[&[1.0, 2.0, 0.0]]),
            description(
                5.0,
                &[&[1.0, 0.0, 4.0], &[3.0, 1.0], &[1.0, 1.0, 16.0], &[0.1, -1.0]],
                &[&[1.0, 2.0], &[1.0, 5.0], &[0.02, 1.0], &[1.0, 0.0], &[1.0, 4.0, 100.0], &[0.2, 3.0]],
            ),
        ];
        for described in filters {
            let filter = Filter::new(&described).unwrap();
            for s in [(0.3, 0.0), (0.0, 0.01), (0.0, 1.0), (-0.4, 7.0), (2.0, -30.0), (0.0, 1e4)] {
                let s = Complex::new(s.0, s.1);
                let (found, expected) = (filter.at(s), quotient(&described, s));
                assert!(
                    (found - expected).norm() < 1e-9 * expected.norm(),
                    "{described:?} at {s}: {found}, {expected}"
                );
            }
        }
    }

    #[test]
    fn a_step_response_is_the_known_one() {
        // D = 3 / (s (s + 2)): impulse response 1.5 (1 − e^−2t).
        let filter = Filter::new(&description(3.0, &[], &[&[1.0, 0.0], &[1.0, 2.0]])).unwrap();
        for t in [0.1, 1.0, 3.0_f64] {
            let found = (&filter.C_f * (&filter.A_f * t).exp() * &filter.B_f)[0];
            assert!((found - 1.5 * (1.0 - (-2.0 * t).exp())).abs() < 1e-14);
        }
    }

    #[test]
    fn factors_that_make_no_filter_are_named() {
        let integrator: &[f64] = &[1.0, 0.0];
        for factor in [&[1.0][..], &[1.0, 2.0, 3.0, 4.0], &[0.0, 1.0], &[1.0, f64::NAN]] {
            let message = refusal(1.0, &[], &[integrator, factor]);
            assert!(message.contains(&format!("denominator factor = {factor:?}: must be two or three")), "{message}");
        }
        for factor in [&[1.0, -2.0][..], &[1.0, 0.0, 4.0], &[1.0, -0.1, 4.0], &[1.0, 1.0, -4.0], &[1.0, -1.0, 0.0]] {
            let message = refusal(1.0, &[], &[integrator, factor]);
            assert!(message.contains("open left half plane"), "{message}");
        }
        for factors in [&[integrator, integrator][..], &[integrator, &[1.0, 2.0, 0.0]], &[&[1.0, 1.0]], &[]] {
            let message = refusal(1.0, &[], factors);
            assert!(message.contains("denominator roots at 0") && message.contains("exactly one"), "{message}");
        }
        assert!(refusal(1.0, &[&[1.0, 0.0]], &[integrator, &[1.0, 1.0]]).contains("cancel the integrator"));
        assert!(refusal(0.0, &[], &[integrator]).contains("gain = 0"));
        let message = refusal(1.0, &[&[1.0, 1.0]], &[integrator]);
        assert!(
            message.contains("degree of the numerator = 1: must be below the degree of the denominator, 1"),
            "{message}"
        );
        assert!(refusal(1.0, &[&[1.0, 1.0, 1.0]], &[integrator]).contains("must be below"));
    }
}
