//! Neuro-adaptive control with prescribed performance (thesis, chapter 5 and section 6.5).
#![allow(non_snake_case)] // matrices have the names of the thesis

mod input_gain;
mod network;
mod order;
mod report;
mod template;

use serde::Deserialize;

use super::angles::{Angles, Jumps};
use super::at_limit::unlimited;
use super::funnel::{self, Funnel};
use super::moves::Moves;
use crate::catalogue::{Catalogued, Role, Trial};
use crate::mathematics::limits::{self, within};
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, DesignReport, Discrete, Input, Invalid, MatrixOf, Parameter, Point, Rates, Scalar,
    ScalarOf, Signal, Signals, State, System, Unit, Values, VectorOf, Warning, boolean, matrix, quantities, scalar,
    vector,
};
use crate::template::{Sizes, Template};
use input_gain::{Channels, InputGainNetwork, MOST_CHANNELS};
use network::{Network, sum};
pub use network::{NetworkStructure, WeightRule};
use order::Order;

/// The funnel of chapter 5: rho_0, rho_inf, decay_rate.
const FUNNEL: [f64; 3] = [1.1, 0.005, 2.0];

/// The description of the controller's structure.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeuroPpfStructure {
    /// After how many derivatives of a tracked variable the control shows: 1 or 2.
    relative_degree: usize,
    /// Number of tracked variables, each with a control of its own.
    channels: usize,
    /// True if the input gain is estimated, too.
    #[serde(default = "yes")]
    input_gain_network: bool,
    /// The neurons.
    network: NetworkStructure,
    /// Channels whose tracked variable is an angle, counted from 1: values that differ by whole turns are the same. Their unit is rad,
    /// and the neurons see an angle's sine and cosine.
    #[serde(default)]
    angles: Vec<usize>,
    /// Units of the signals.
    #[serde(default)]
    units: Units,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// Quantities of the signals, an element each; descriptions count elements where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Quantities {
    /// Quantities of the tracked variables.
    r: Vec<String>,
    /// Quantities of the control.
    u: Vec<String>,
}

fn yes() -> bool {
    true
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Units {
    /// Units of the reference.
    r: Vec<String>,
    /// Units of the control.
    u: Vec<String>,
}

/// ν_b = F_f + R⁻¹ V + k R⁻¹ E + n_f R E; u = ν_a − (η_Ga |ν_a|² + η_Gb |ν_b|²) R E.
#[derive(Debug)]
pub struct NeuroPpf {
    network: Network,
    input_gain: Option<InputGainNetwork>,
    order: Order,
    funnel: Funnel,
    k: ScalarOf<Parameter>,
    n_f: ScalarOf<Parameter>,
    eta_Gb: ScalarOf<Parameter>,
    sigma: ScalarOf<Parameter>,
    /// Γ
    network_gain: ScalarOf<Parameter>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    r: VectorOf<Input>,
    x: VectorOf<Input>,
    theta_f: MatrixOf<State>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    E: VectorOf<Signal>,
    F_f: VectorOf<Signal>,
    nu_b: VectorOf<Signal>,
    Z: VectorOf<Signal>,
    /// R_i E_i
    RE: VectorOf<Signal>,
    moves: Moves,
    step_too_long: BooleanOf<Discrete>,
    long_step: Warning,
    jumps: Option<Jumps>,
}

impl System for NeuroPpf {
    type Structure = NeuroPpfStructure;
    const NAME: &'static str = "neuro-ppf";
    const DOCUMENTATION: &'static str = pages::NEURO_PPF.text;

    fn declare(structure: NeuroPpfStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let (m, degree) = structure.size()?;
        let r = Unit::symbols("r", &structure.units.r, m)?;
        let angles = Angles::of(&structure.angles, "r", &r)?;
        let network = Network::new(&structure.network, m * degree, &angles)?;
        let neurons = network.neurons();
        let u = Unit::symbols("u", &structure.units.u, m)?;
        let x: Vec<_> = r.iter().copied().chain(r.iter().map(|unit| Unit::per_second(unit))).take(m * degree).collect();
        let state = if degree == 1 { "measured state of the plant" } else { "measured coordinates, then their rates" };
        let number = |name: &str, text: &str, start: f64| scalar(name, text).start(start).min(0.0);
        let weight = "weight of a neuron in the estimate of a channel's dynamics";
        let of_r = quantities("r", &structure.quantities.r, m)?;
        let of_u = quantities("u", &structure.quantities.u, m)?;
        let rates = of_r.iter().map(|quantity| format!("rate of {quantity}"));
        let of_x: Vec<_> = of_r.iter().cloned().chain(rates).take(of_r.len() * degree).collect();
        let limit = |name: &str, size: &str| {
            let text = "that the actuator can give";
            let about = format!("{size} {{}} {text}");
            vector(name, m, &format!("{size} control {text}")).about(&of_u, &about).units(&u)
        };
        let law = NeuroPpf {
            funnel: Funnel::declare(d, (&r, &of_r), FUNNEL).of_angles(angles.clone()),
            k: d.parameter(number("k", "gain of the filtered error", 0.5).unit("1/s")),
            n_f: d.parameter(number("n_f", "gain of the robust term for the estimate of the dynamics", 0.2)),
            eta_Gb: d.parameter(number("eta_Gb", "gain of the robust term for nu_b", 0.2)),
            sigma: d.parameter(number("sigma", "leakage of the networks' weights", 7.5)),
            network_gain: d.parameter(scalar("network_gain", "adaptation gain of the networks").start(0.1).positive()),
            u_min: d.parameter(limit("u_min", "smallest").no_lower_limit()),
            u_max: d.parameter(limit("u_max", "largest").no_upper_limit()),
            r: d.input(vector("r", m, "reference").about(&of_r, "reference of {}").units(&r)),
            order: if degree == 1 {
                Order::first(d, (&r, &of_r), &angles)
            } else {
                Order::second(d, (&r, &of_r), &angles)
            },
            x: d.input(vector("x", x.len(), state).about(&of_x, "measured {}").units(&x)),
            theta_f: d.state(matrix("theta_f", neurons, m, weight).source("Hashim (5.26)")),
            input_gain: structure.input_gain_network.then(|| InputGainNetwork::declare(d, neurons, &u)),
            u: d.output(vector("u", m, "control").about(&of_u, "commanded {}").units(&u).source("Hashim (5.22)")),
            unlimited: unlimited(d, m),
            E: d.local(
                vector("E", m, "filtered error: the transformed error, for relative degree 2 with its rate")
                    .source("Hashim (5.10)"),
            ),
            F_f: d.local(vector("F_f", m, "estimate of the plant's dynamics").source("Hashim (5.18)")),
            nu_b: d.local(vector("nu_b", m, "control for an input gain of 1").source("Hashim (5.24)")),
            Z: d.local(vector("#Z", neurons, "").hidden()),
            RE: d.local(vector("#RE", m, "").hidden()),
            moves: {
                let is_stepped = d.is_stepped();
                Moves::declare(d, m, is_stepped)
            },
            step_too_long: d.discrete(
                boolean("step_too_long", "whether the communication step is too long for the control").output(),
            ),
            long_step: d.warning("logStepTooLong", "communication step too long for the control"),
            network,
            jumps: None,
        };
        let jumps = Jumps::declare(d, law.x, &x, &angles);
        Ok(NeuroPpf { jumps, ..law })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.funnel.relate(v);
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.order.initialise(v);
        if let Some(input_gain) = &self.input_gain {
            input_gain.initialise(&self.network, self.x, v);
        }
        self.funnel.open(t, |i, v| self.error(i, v), v);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        self.network.outputs(&v[self.x], &mut y[self.Z]);
        let theta_f = v.matrix(self.theta_f);
        let mut nu_b = [S::from(0.0); MOST_CHANNELS];
        for i in 0..self.r.len() {
            let inside = self.funnel.inside(i, t, self.error(i, v), v);
            self.funnel.show(i, &inside, y);
            let motion = self.order.motion(i, &inside, [self.r, self.x], v);
            let F_f = sum(&y[self.Z], theta_f.column(i).as_slice());
            let RE = inside.R * motion.E;
            nu_b[i] = F_f + (motion.V + v[self.k] * motion.E) / inside.R + v[self.n_f] * RE;
            y[self.E.at(i)] = motion.E;
            y[self.F_f.at(i)] = F_f;
            y[self.nu_b.at(i)] = nu_b[i];
            y[self.RE.at(i)] = RE;
        }
        self.control(nu_b, v, y);
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        self.order.derivatives(self.r, v, dx);
        let (gain, sigma) = (v[self.network_gain], v[self.sigma]);
        for i in 0..self.r.len() {
            for j in 0..self.network.neurons() {
                let theta = self.theta_f.at(j, i);
                dx[theta] = gain * (v[self.Z.at(j)] * v[self.RE.at(i)] - sigma * v[theta]);
            }
        }
        if let Some(input_gain) = &self.input_gain {
            input_gain.derivatives([self.Z, self.RE], [gain, sigma], v, dx);
        }
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }

    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.funnel.check(t, |i, v| self.error(i, v), v);
    }

    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        self.funnel.event_indicators(t, |i, v| self.error(i, v), v, z);
    }

    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.funnel.event(t, |i, v| self.error(i, v), v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
        let moved = self.moves.look(self.u, step, v);
        v.put(self.step_too_long, moved.flag);
        v.when(moved.flag, |v| v.warn(self.long_step, |_| moved.warning(step, ", or a single FMU")));
    }
}

impl NeuroPpf {
    fn error<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.order.error(i, [self.r, self.x], v)
    }

    /// Writes u, within its limits.
    fn control<S: Scalar>(&self, nu_b: Channels<S>, v: &Values<S>, y: &mut Signals<S>) {
        let (nu_a, of_nu_a) = match &self.input_gain {
            Some(input_gain) => input_gain.outputs(self.Z, nu_b, v, y),
            None => ([S::from(0.0); MOST_CHANNELS], S::from(0.0)),
        };
        let robust = of_nu_a + v[self.eta_Gb] * sum(&nu_b, &nu_b);
        for (i, nu_a) in nu_a.into_iter().enumerate().take(self.r.len()) {
            let wanted = nu_a - robust * y[self.RE.at(i)];
            y[self.unlimited.at(i)] = wanted;
            y[self.u.at(i)] = within(wanted, v[self.u_min.at(i)], v[self.u_max.at(i)]);
        }
    }
}

impl NeuroPpfStructure {
    /// Channels, and their relative degree.
    fn size(&self) -> Result<(usize, usize), Invalid> {
        let mut invalid = Invalid::none();
        if !(1..=MOST_CHANNELS).contains(&self.channels) {
            let allowed =
                format!("must be within 1 … {MOST_CHANNELS}: the adjugate of larger input gains isn't provided for");
            invalid.and(Invalid::new("channels", self.channels, allowed));
        }
        if !(1..=2).contains(&self.relative_degree) {
            invalid.and(Invalid::new("relative_degree", self.relative_degree, "must be 1 or 2"));
        }
        invalid.into_result()?;
        Ok((self.channels, self.relative_degree))
    }
}

impl Catalogued for NeuroPpf {
    const PAGE: Page = pages::NEURO_PPF;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: None,
        tried: &[Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(3, 3), Sizes::plant(6, 3)],
    });
    const TRIAL: Trial = Trial {
        alone: funnel::OPEN,
        // An error of 0 has no room in a funnel that allows no overshoot.
        steady: "overshoot = 1.0",
        ..Trial::NONE
    };
}
