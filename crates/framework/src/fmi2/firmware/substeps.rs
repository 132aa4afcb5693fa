//! The fewest Runge-Kutta steps in a period with which those modes of a controller decay that do so in its equations.

use std::sync::Arc;

use nalgebra::{Complex, DMatrix};

use super::functions::Structs;
use super::law::Law;
use super::vectors::{self, Signals, Source};
use super::{MOST_SUBSTEPS, Options};
use crate::eigenvalues::eigenvalues;
use crate::error::{Invalid, Number};
use crate::execution::Execution;
use crate::integrator::IntegrationMethod;
use crate::model::Model;
use crate::report::number;
use crate::system::Section;

/// Number of points along the signals of a loop at which eigenvalues are computed.
const LOOKS: usize = 100;
/// Larger systems take too long.
const MOST_STATES: usize = 250;
/// Difference of a step's amplification from 1 that counts as rounding.
const ROUNDING: f64 = 1e-9;

/// The mode that asks for the most Runge-Kutta steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fastest {
    /// Its eigenvalue, 1/s.
    pub value: Complex<f64>,
    /// Time at which it is this fast, s.
    pub time: f64,
    /// The fewest steps in a period with which it decays.
    pub least: u32,
}

impl Fastest {
    /// The fastest mode along the signals of a loop, or at the start; none of a controller without modes that decay.
    ///
    /// # Errors
    /// That no number of steps would be enough.
    pub fn of(
        law: &Law,
        structs: &Structs,
        model: &Arc<Model>,
        signals: Option<&Signals>,
    ) -> Result<Option<Self>, Invalid> {
        let states: Vec<usize> = structs.states.reals().map(|(_, place)| place).collect();
        if states.is_empty() || states.len() > MOST_STATES {
            return Ok(None);
        }
        let source = signals.map_or(Source::Start, Source::Loop);
        let rows = signals.and_then(|signals| signals.values().map(Vec::len).max()).unwrap_or(1);
        let inputs: Vec<usize> = structs.inputs.reals().map(|(_, place)| place).collect();
        let mut run = vectors::started(law, model, IntegrationMethod::Automatic);
        let mut fastest: Option<(Complex<f64>, f64)> = None;
        for step in 0..rows {
            let of = |(number, &place): (usize, &usize)| vectors::input(law, source, (number, place), step);
            let row: Vec<f64> = inputs.iter().enumerate().map(of).collect();
            // What can't be computed has no modes: a controller is looked at up to there.
            if !vectors::taken(&mut run, law, (&inputs, &row), step) {
                break;
            }
            if step % rows.div_ceil(LOOKS) != 0 {
                continue;
            }
            let time = (step + 1) as f64 * law.period;
            let asks = |value: &Complex<f64>| value.norm() / reach(value.unscale(value.norm()));
            let modes = decaying(&mut run, &states).into_iter().map(|value| (value, time));
            fastest = fastest.into_iter().chain(modes).max_by(|(a, _), (b, _)| asks(a).total_cmp(&asks(b)));
        }
        fastest.map(|(value, time)| Self::within(law.period, value, time)).transpose()
    }

    fn within(period: f64, value: Complex<f64>, time: f64) -> Result<Self, Invalid> {
        let least = (value.norm() * period / reach(value.unscale(value.norm())) * (1.0 - ROUNDING)).ceil().max(1.0);
        if least > f64::from(MOST_SUBSTEPS) {
            let longest = period * f64::from(MOST_SUBSTEPS) / least;
            let mode = Fastest { value, time, least: 0 }.to_text();
            let allowed = format!(
                "must be at most {} s: its fastest mode ({mode}) needs {least} Runge-Kutta steps in this one, and {MOST_SUBSTEPS} are possible",
                number(longest)
            );
            return Err(Invalid::new("period", Number(period), allowed));
        }
        Ok(Fastest { value, time, least: least as u32 })
    }

    /// The longest period with this number of Runge-Kutta steps in which it decays, s.
    pub fn longest(&self, substeps: u32) -> f64 {
        let size = self.value.norm();
        f64::from(substeps) * reach(self.value.unscale(size)) / size
    }

    /// The eigenvalue in words.
    pub fn to_text(self) -> String {
        let imaginary = self.value.im.abs();
        let both = if imaginary > 0.0 { format!(" +- {}j", number(imaginary)) } else { String::new() };
        format!("{}{both} 1/s after {} s", number(self.value.re), number(self.time))
    }
}

/// Takes the steps that the modes of a law ask for, where it may be more than it has.
///
/// # Errors
/// A number that was given and is too small.
pub(super) fn raise(law: &mut Law, options: &Options, fastest: Option<&Fastest>) -> Result<(), Invalid> {
    let Some(fastest) = fastest.filter(|fastest| law.substeps < fastest.least) else { return Ok(()) };
    if options.may_rise {
        law.substeps = fastest.least;
        return Ok(());
    }
    let (least, mode) = (fastest.least, fastest.to_text());
    let allowed = format!("must be at least {least}: with fewer its fastest mode ({mode}) grows");
    Err(Invalid::new("substeps", law.substeps, allowed))
}

/// Eigenvalues of the state equation where a controller is, of modes that decay.
fn decaying(run: &mut Execution, states: &[usize]) -> Vec<Complex<f64>> {
    let variables = run.model().variables();
    let rates = variables.reals(Section::Derivative).start - variables.reals(Section::State).start;
    let mut matrix = DMatrix::zeros(states.len(), states.len());
    for (column, &state) in states.iter().enumerate() {
        let changes = run.directional_derivative(&[state as u32], &[1.0]);
        states.iter().enumerate().for_each(|(row, state)| matrix[(row, column)] = changes[rates + state]);
    }
    let found = eigenvalues(&matrix).unwrap_or_default();
    found.iter().filter(|value| value.real < 0.0).map(|value| Complex::new(value.real, value.imaginary)).collect()
}

/// The length of the steps with which a mode decays in a direction of the complex plane, times the size of its eigenvalue.
fn reach(direction: Complex<f64>) -> f64 {
    // Below 2 all modes of the left half-plane decay, beyond 4 none does (Hairer and Wanner, Solving Ordinary Differential
    // Equations II, figure IV.2.1).
    let (mut stable, mut unstable) = (2.0, 4.0);
    for _ in 0..50 {
        let middle = 0.5 * (stable + unstable);
        if amplified(direction * middle) <= 1.0 + ROUNDING {
            stable = middle;
        } else {
            unstable = middle;
        }
    }
    stable
}

/// The size of the stability function of the classical Runge-Kutta method of order 4.
fn amplified(z: Complex<f64>) -> f64 {
    let one = Complex::new(1.0, 0.0);
    (one + z * (one + z.scale(0.5) * (one + z.unscale(3.0) * (one + z.scale(0.25))))).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_decays_with_the_fewest_steps_and_grows_with_one_less() {
        let period = 0.1;
        for (k, size) in (0..2000).map(|k| (f64::from(k), 10f64.powf(-2.0 + 7.0 * f64::from(k % 37) / 36.0))) {
            let value = Complex::from_polar(size, std::f64::consts::FRAC_PI_2 * (1.001 + 0.999 * k / 1999.0));
            let least = Fastest::within(period, value, 0.0).unwrap().least;
            // One step after the other.
            let after = |steps: u32| {
                let h = period / f64::from(steps);
                let mut x = Complex::new(1.0, 0.0);
                for _ in 0..20 {
                    let k1 = value * x;
                    let k2 = value * (x + k1.scale(0.5 * h));
                    let k3 = value * (x + k2.scale(0.5 * h));
                    let k4 = value * (x + k3.scale(h));
                    x += (k1 + (k2 + k3).scale(2.0) + k4).scale(h / 6.0);
                }
                x.norm()
            };
            assert!(after(least) < 1.0 + 1e-6, "{value} {least}");
            assert!(least == 1 || after(least - 1) > 1.0, "{value} {least}");
        }
    }

    #[test]
    fn a_step_may_be_so_long_and_a_mode_too_fast() {
        assert!((reach(Complex::new(-1.0, 0.0)) - 2.785_293_563_405_28).abs() < 1e-6);
        assert!((reach(Complex::new(0.0, 1.0)) - 8f64.sqrt()).abs() < 1e-6);
        let refused = Fastest::within(1.0, Complex::new(-1e6, 0.0), 0.0).unwrap_err().to_string();
        let rest = refused.split("must be at most ").nth(1).unwrap_or_else(|| panic!("{refused}"));
        let longest: f64 = rest.split(" s").next().unwrap().parse().unwrap();
        let within = |period: f64| Fastest::within(period, Complex::new(-1e6, 0.0), 0.0);
        assert!(within(0.999 * longest).is_ok() && within(1.001 * longest).is_err(), "{refused}");
    }
}
