//! The text of a new plain MRAC.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::Mrac;
use super::design::{Design as Numbers, OF_DEAD_TIME};
use crate::catalogue::Catalogued;
use crate::controllers::l1::template::{found, write_dynamics, write_structure};
use crate::controllers::template::{first, stop_time, write_nominal};
use crate::design::digits;
use crate::design::l1::design::{Design, is_full};
use crate::error::Invalid;
use crate::mathematics::{feedforward, lyapunov};
use crate::report::{no_less, no_more};
use crate::template::{
    Begun, Plant, Request, Text, list, number, one_or_each, round_down, rows, three_digits, write_limits,
    write_magnitudes,
};

/// Ratio of the adaptation's frequency to the desired dynamics, with usual signals.
const FASTER: f64 = 10.0;
/// Steps of that oscillation.
const STEPS: f64 = 0.1;
/// Width of the layer at the bounds in which projection acts.
const LAYER: f64 = 0.1;
/// Input gains beyond these aren't estimated.
const LEAST_GAIN: f64 = 0.01;
const LARGEST_GAIN: f64 = 100.0;

/// An adaptation that turns ten times as fast as the desired dynamics, those that a new L1 controller has.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (design, bandwidth) = found(request, &plant, false, [1.0, 1.0])?;
    let adaptation = Adaptation::new(&plant, &design, bandwidth)?;
    let mut text = request.begin(&Mrac::PAGE, stop_time(bandwidth), round_down(adaptation.step));
    let spread = (&design.omega[1] - &design.omega[0]) * 0.5;
    write_structure(&mut text, &plant, &design.desired, |text| {
        text.set("regressor", "\"state\"", "theta multiplies x; \"infinity_norm\": its largest element");
        text.set("state_scale", list(&design.peaks), "usual magnitudes of x: theta multiplies x/state_scale");
        let entries = if is_full(&spread) { "\"full\"" } else { "\"diagonal\"" };
        text.set("input_gain", entries, "kappa; \"full\" where inputs act on each other's channels");
    });
    text.table("start");
    adaptation.write(&mut text, &plant, &design.references);
    write_dynamics(&mut text, &design);
    text.set(
        "adaptation_gain",
        number(adaptation.gain),
        "Gamma: larger follows the model closer, and tolerates less delay",
    );
    let Q = DMatrix::from_diagonal(&DVector::from_vec(design.Q.clone()));
    text.set("Q", rows(&Q), "1/(peak of x)^2 in a step of the reference");
    write_bounds(&mut text, &design, &spread);
    write_limits(&mut text, Some(&plant), plant.sizes().1);
    write_magnitudes(&mut text, request.plant.as_ref(), (&design.references, bandwidth), |of| {
        let estimates = [("theta_hat", (&design.theta_bound).into()), ("sigma_hat", (&design.sigma_bound).into())];
        estimates.into_iter().chain([("x_m", (&of.x).into()), ("u", (&of.u).into())]).collect()
    });
    write_nominal(&mut text, request, bandwidth, &request.uncertainty_or_usual());
    Ok(text.finish())
}

/// Bounds that are wider than the assumed uncertainty, so that it lies where projection doesn't act.
fn write_bounds(text: &mut Text, design: &Design, spread: &DMatrix<f64>) {
    let wider = (1.0 + LAYER).sqrt();
    let up = |value: f64| no_less(wider * value, 3);
    let of_gain = |k: usize| {
        let [low, high] = [&design.omega[0], &design.omega[1]].map(|omega| 1.0 - 1.0 / omega[(k, k)].max(LEAST_GAIN));
        let (middle, half) = (0.5 * (low + high), 0.5 * wider * (high - low));
        let gain = |kappa: f64| (1.0 / (1.0 - kappa).max(1.0 / LARGEST_GAIN)).max(LEAST_GAIN);
        [no_more(gain(middle - half), 3).min(1.0), no_less(gain(middle + half), 3).max(1.0)]
    };
    let gains: Vec<_> = (0..spread.nrows()).map(of_gain).collect();
    let side = |side: usize| list(&gains.iter().map(|gain| gain[side]).collect::<Vec<_>>());
    text.set("omega_min", side(0), "input gain, in parts of B, at least");
    text.set("omega_max", side(1), "and at most");
    if is_full(spread) {
        let coupling = |(i, j): (usize, usize)| if i == j { 0.0 } else { spread[(i, j)] };
        let m = spread.nrows();
        let most = (0..m * m).map(|k| coupling((k % m, k / m))).fold(0.0, f64::max);
        let least = gains.iter().map(|gain| gain[0]).fold(1.0, f64::min);
        text.set(
            "kappa_coupling",
            number(up(most / (least * least))),
            "of what one input does in the channel of another",
        );
    }
    text.set("theta_bound", rows(&design.theta_bound.map(up)), "of each element of theta, in the unit of u");
    text.set(
        "sigma_bound",
        list(&design.sigma_bound.iter().map(|&bound| up(bound)).collect::<Vec<_>>()),
        "of the disturbance, in the unit of u",
    );
}

/// Γ and the communication step, s, with what they lead to.
struct Adaptation {
    gain: f64,
    step: f64,
    /// rad/s, and s.
    frequency: f64,
    dead_time: f64,
    /// K_g
    K_g: DMatrix<f64>,
}

impl Adaptation {
    fn new(plant: &Plant, design: &Design, bandwidth: f64) -> Result<Self, Invalid> {
        let Q = DMatrix::from_diagonal(&DVector::from_vec(design.Q.clone()));
        let P = lyapunov::solve(&design.A_m, &Q)?;
        let K_g = feedforward::gain(&design.A_m, &plant.B, &plant.C, "A_m")?;
        let [BPB, BQB] = Numbers::weights(&plant.B, &P, &Q);
        let (stiffness, damped) = (BPB.symmetric_eigenvalues().max(), BQB.symmetric_eigenvalues().min());
        // Every state at its peak, and all references stepped together.
        let signals = 1.0
            + design.peaks.len() as f64
            + (&K_g * DMatrix::from_diagonal(&DVector::from_column_slice(&design.references))).norm_squared();
        let frequency = FASTER * bandwidth;
        let gain = three_digits(frequency * frequency / (stiffness * signals));
        let dead_time = damped / stiffness / (frequency * frequency);
        let step = (STEPS / frequency).min(OF_DEAD_TIME * dead_time);
        if [gain, step].iter().all(|number| number.is_normal() && *number > 0.0) {
            return Ok(Adaptation { gain, step, frequency, dead_time, K_g });
        }
        let text = "the plant, the bandwidth and the reference differ by too many powers of ten for a design in double precision: \
                    choose other units";
        Err(Invalid::because(text))
    }

    /// Writes what the adaptation tolerates, and notes what can't be done.
    fn write(&self, text: &mut Text, plant: &Plant, references: &[f64]) {
        let (frequency, dead_time) = (digits(self.frequency), digits(self.dead_time));
        text.comment(&format!(
            "The adaptation turns at up to {frequency} rad/s with usual signals, and tolerates about {dead_time} s of dead time."
        ));
        let delay = plant.delay.iter().copied().fold(0.0, f64::max);
        if delay > self.dead_time {
            text.note(&format!(
                "The dead time of the plant, {} s, is longer than this controller tolerates, about {dead_time} s: `new l1-limit` or \
                 `new l1-sampled` tolerate more.",
                digits(delay)
            ));
        }
        let of_control = |i: usize| {
            let row = self.K_g.row(i);
            let all = row.iter().zip(references).map(|(gain, size)| gain * size);
            all.fold([0.0_f64; 2], |[low, high], u| [low.min(u), high.max(u)])
        };
        let extremes: Vec<_> = (0..self.K_g.nrows()).map(of_control).collect();
        if let Some(needed) = first::beyond_limits(plant, &extremes) {
            text.note(&format!(
                "A step of the reference to {} needs controls {needed} immediately, beyond u_min and u_max: the reference model waits \
                 for them.",
                one_or_each(references)
            ));
        }
    }
}
