//! L1 adaptive controller for matched uncertainty (thesis, sections 3.2 and 3.3).
#![allow(non_snake_case)] // matrices have the names of the thesis

mod closed_form;
mod design;
mod estimates;
mod structure;

use nalgebra::DVector;

use crate::control::filter::Filter;
use crate::control::limits::within;
use crate::control::projection::projection;
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, Discrete, ErrorEstimate, Handle, Input, IntegerOf, Invalid, MatrixOf,
    Parameter, Point, Rates, Scalar, ScalarOf, Signal, Signals, State, Stride, System, Values, VectorOf, Warning,
    boolean, choice, diagonal, integer, matrix, scalar, vector,
};
use design::Design;
use structure::Plant;
pub use structure::{Baseline, InputGain, L1Structure, Regressor};

/// What the adaptive control starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AdaptiveStart {
    Zero,
    Bumpless,
}

impl Choice for AdaptiveStart {
    const TYPE: &'static str = "AdaptiveStart";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Zero, "zero", "u_ad starts at zero"),
        (Self::Bumpless, "bumpless", "u_ad starts such that the control starts at u_manual"),
    ];
}

/// L1 adaptive controller for a plant x' = A_m x + B (ω v + θ φ(x) + σ).
#[derive(Debug)]
pub struct L1 {
    plant: Plant,
    filter: Filter,
    /// The filter's state at rest, for an output of 1.
    filter_at_rest: DVector<f64>,
    regressor: Regressor,
    baseline: Baseline,
    design: Design,
    u_ad_start: ChoiceOf<Parameter, AdaptiveStart>,
    r: VectorOf<Input>,
    x: VectorOf<Input>,
    enabled: BooleanOf<Input>,
    u_manual: VectorOf<Input>,
    x_hat: VectorOf<State>,
    omega_hat: VectorOf<State>,
    theta_hat: MatrixOf<State>,
    sigma_hat: VectorOf<State>,
    /// State of the filters, channel by channel.
    f: VectorOf<State>,
    u: VectorOf<Signal>,
    u_ad: VectorOf<Signal>,
    eta_hat: VectorOf<Signal>,
    adaptation_frequency: ScalarOf<Signal>,
    /// K_m x
    feedback: VectorOf<Signal>,
    /// The control that the estimates see.
    v: VectorOf<Signal>,
    /// φ(x)
    phi: VectorOf<Signal>,
    /// s = −Bᵀ P x̃
    s: VectorOf<Signal>,
    /// What `enabled` was when it was last looked at: between events.
    active: BooleanOf<Discrete>,
    step_too_long: BooleanOf<Discrete>,
    projection_active: IntegerOf<Discrete>,
    /// Row and column of each estimated entry of ω̂.
    omega_entries: Vec<(usize, usize)>,
    at_bounds: Warning,
    long_step: Warning,
}

impl System for L1 {
    type Structure = L1Structure;
    const NAME: &'static str = "l1";
    const DOCUMENTATION: &'static str = include_str!("../../../docs/controllers/l1.md");

    fn indicators(&self) -> usize {
        1
    }

    fn declare(structure: L1Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let (plant, filter) = (structure.plant()?, structure.filter()?);
        let (n, m) = plant.B.shape();
        let units = structure.units((n, m))?;
        let full = structure.is_full();
        let omega_entries: Vec<_> =
            if full { (0..m * m).map(|k| (k % m, k / m)).collect() } else { (0..m).map(|i| (i, i)).collect() };
        let (omega_hat, u_ad) = ("estimate of the input gain omega", "adaptive control, the filtered estimate");
        let columns = if structure.regressor == Regressor::State { n } else { 1 };
        let theta_hat = "estimate of theta, the uncertainty's dependence on the state";
        let frequency = "frequency at which the estimates oscillate about their values";
        let l1 = L1 {
            filter_at_rest: filter.at_rest(),
            regressor: structure.regressor,
            baseline: structure.baseline,
            design: Design::declare(d, (n, m), &structure, &units.u),
            u_ad_start: d
                .parameter(choice::<AdaptiveStart>("u_ad_start", "what the adaptive control starts with").fixed()),
            r: d.input(vector("r", m, "reference").units(&units.r)),
            x: d.input(vector("x", n, "measured state of the plant").units(&units.x)),
            enabled: d.input(
                boolean("enabled", "whether the controller is in command; it takes over without a jump").start(true),
            ),
            u_manual: d.input(vector("u_manual", m, "control while the controller is not enabled").units(&units.u)),
            x_hat: d.state(vector("x_hat", n, "state of the predictor").units(&units.x)),
            omega_hat: if full {
                d.state(matrix("omega_hat", m, m, omega_hat)).elements()
            } else {
                d.state(diagonal("omega_hat", m, omega_hat))
            },
            theta_hat: d.state(matrix("theta_hat", m, columns, theta_hat)),
            sigma_hat: d.state(vector("sigma_hat", m, "estimate of the disturbance sigma")),
            f: if filter.is_integrator() {
                d.state(vector("u_ad", m, u_ad).units(&units.u))
            } else {
                d.state(matrix("filter_state", filter.order(), m, "state of the filter D(s) of a channel")).elements()
            },
            u: d.output(vector("u", m, "control").units(&units.u)),
            u_ad: d.local(if filter.is_integrator() {
                vector("#u_ad", m, "").hidden()
            } else {
                vector("u_ad", m, u_ad).units(&units.u)
            }),
            eta_hat: d.local(vector("eta_hat", m, "estimate of the matched uncertainty with the control's own effect")),
            adaptation_frequency: d.local(scalar("adaptation_frequency", frequency).unit("rad/s")),
            feedback: d.local(vector("#feedback", m, "").hidden()),
            v: d.local(vector("#v", m, "").hidden()),
            phi: d.local(vector("#phi", columns, "").hidden()),
            s: d.local(vector("#s", m, "").hidden()),
            active: d.discrete(boolean("#active", "").start(true).hidden()),
            step_too_long: d.discrete(
                boolean("step_too_long", "whether the communication step is too long for the adaptation gain").output(),
            ),
            projection_active: d.discrete(
                integer("projection_active", "number of estimates that are kept within their bounds").output(),
            ),
            omega_entries,
            at_bounds: d.warning("logProjection", "estimates at their bounds, or brought back to tightened ones"),
            long_step: d.warning("logStepTooLong", "communication step too long for the adaptation gain"),
            plant,
            filter,
        };
        l1.declare_dependence(d);
        Ok(l1)
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.design.prepare(&self.plant, &self.omega_entries, v)
    }

    /// The predictor starts at the measured state; ω̂ at the identity, which its bounds must hold, the other estimates
    /// at zero.
    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        let enabled = v.get(self.enabled);
        v.put(self.active, enabled);
        v.copy(self.x, self.x_hat);
        v[self.f].fill(0.0);
        if !enabled || v.get(self.u_ad_start) == AdaptiveStart::Bumpless {
            self.take_over(v);
        }
        let mut invalid = Invalid::none();
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            let start = f64::from(u8::from(i == j));
            if !(lo..=hi).contains(&start) {
                let name = format!("omega_min[{0},{1}] … omega_max[{0},{1}]", i + 1, j + 1);
                let allowed = format!("must hold the start value {start} of the estimate omega_hat");
                invalid.and(Invalid::new(name, format!("{lo} … {hi}"), allowed));
            }
            v[self.omega_hat][k] = start;
        }
        invalid.into_result()
    }

    fn parameters_changed(&self, _t: f64, v: &mut Point) {
        self.clip_estimates(v);
    }

    /// u = u_ad − K_m x within its limits; η̂ = ω̂ v + θ̂ φ(x) + σ̂ (+ K_m x); s = −Bᵀ P x̃.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let (x, x_hat, m) = (&v[self.x], &v[self.x_hat], self.u.len());
        let (active, K_m) = (v.get(self.active), self.design.K_m(v));
        for i in 0..m {
            let states = v[self.f].chunks_exact(self.filter.order()).nth(i).unwrap_or(&[]);
            let u_ad = states.iter().zip(self.filter.C_f.iter()).fold(S::from(0.0), |sum, (&f, &c)| sum + f * c);
            let feedback = K_m.as_ref().map_or(S::from(0.0), |K_m| dot(K_m.row(i).iter(), x));
            let wanted = if active { u_ad - feedback } else { v[self.u_manual][i] };
            let u = within(wanted, v[self.design.u_min][i], v[self.design.u_max][i]);
            (y[self.u_ad][i], y[self.feedback][i], y[self.u][i]) = (u_ad, feedback, u);
            y[self.v][i] = match self.baseline {
                Baseline::None | Baseline::Inside => u,
                Baseline::Outside if active => u_ad + (u - wanted),
                Baseline::Outside => u + feedback,
            };
        }
        match self.regressor {
            Regressor::State => y.set(self.phi, x),
            Regressor::InfinityNorm => y.set(self.phi, [infinity_norm(x)]),
        }
        let (theta_hat, PB) = (v.matrix(self.theta_hat), v.matrix(self.design.PB));
        for i in 0..m {
            let known = if self.baseline == Baseline::Inside { y[self.feedback][i] } else { S::from(0.0) };
            y[self.eta_hat][i] = v[self.sigma_hat][i] + known + dot(theta_hat.row(i).iter(), &y[self.phi]);
            let x_tilde = x_hat.iter().zip(x).map(|(&x_hat, &x)| x_hat - x);
            y[self.s][i] = -x_tilde.zip(PB.column(i).iter()).fold(S::from(0.0), |sum, (x, &p)| sum + x * p);
        }
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let term = v[self.omega_hat][k] * y[self.v][j];
            y[self.eta_hat][i] += term;
        }
        let excitation = squared(&y[self.v]) + squared(&y[self.phi]) + 1.0;
        y[self.adaptation_frequency] = (v[self.design.adaptation_gain] * v[self.design.lambda_max] * excitation).sqrt();
    }

    /// State predictor, adaptive laws with projection, and the control law u_ad = −K D(s) (η̂ − K_g r). While not
    /// enabled, estimates are frozen; the predictor follows the state, and the adaptive control the manual one.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (x, x_hat, active) = (&v[self.x], &v[self.x_hat], v.get(self.active));
        let A_m = self.design.A_m(v);
        for i in 0..x_hat.len() {
            dx[self.x_hat][i] = if active {
                let own = dot(A_m.row(i).iter(), x_hat);
                v[self.eta_hat].iter().enumerate().fold(own, |sum, (j, &eta)| sum + eta * self.plant.B[(i, j)])
            } else {
                dot(A_m.row(i).iter(), x_hat) - dot(A_m.row(i).iter(), x)
            };
        }
        if active {
            self.adaptive_laws(v, dx);
            self.control_law(v, dx);
            return;
        }
        dx[self.omega_hat].fill(S::from(0.0));
        dx.slice(self.theta_hat).fill(S::from(0.0));
        dx[self.sigma_hat].fill(S::from(0.0));
        for (k, rate) in dx[self.f].iter_mut().enumerate() {
            let (i, rest) = (k / self.filter.order(), self.filter_at_rest[k % self.filter.order()]);
            *rate = -v[self.design.follow_rate] * (v[self.f][k] - (v[self.u][i] + v[self.feedback][i]) * rest);
        }
    }

    /// Negative when `enabled` has changed.
    fn event_indicators(&self, _t: f64, v: &Values<f64>, z: &mut [f64]) {
        z[0] = if v.get(self.enabled) == v.get(self.active) { 1.0 } else { -1.0 };
    }

    fn event(&self, _t: f64, _crossed: &[bool], v: &mut Point) {
        let enabled = v.get(self.enabled);
        if enabled && !v.get(self.active) {
            v.copy(self.x, self.x_hat);
            self.take_over(v);
        }
        v.put(self.active, enabled);
    }

    fn step_completed(&self, _t: f64, step: f64, v: &mut Point) {
        let count = self.projections(&v.values());
        v.put(self.projection_active, count as i32);
        if count > 0 {
            v.warn(self.at_bounds, || {
                format!(
                    "{count} of the estimates at a bound: where that lasts, the plant is beyond it. Widen omega_min … \
                     omega_max, theta_bound or sigma_bound if tracking suffers"
                )
            });
        }
        let (frequency, limit) = (v[self.adaptation_frequency], v[self.design.step_phase_limit]);
        let too_long = v.get(self.active) && frequency * step > limit;
        v.put(self.step_too_long, too_long);
        if too_long {
            v.warn(self.long_step, || {
                format!(
                    "the communication step {step:.3e} s is too long for the adaptation, which turns at {frequency:.3e} \
                     rad/s now: while that lasts, peaks of the control grow. Use {:.1e} s or less",
                    limit / frequency
                )
            });
        }
    }

    fn steps_itself(&self) -> bool {
        true
    }

    fn workspace(&self) -> usize {
        self.closed_form_workspace()
    }

    /// Not while an estimate is at a bound, nor where a general method needs few steps.
    fn own_step_pays(&self, h: f64, v: &Values<f64>) -> bool {
        let phase = v[self.adaptation_frequency] * h;
        v.get(self.active) && phase >= v[self.design.closed_form_phase] && self.projections(v) == 0
    }

    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        self.closed_form(stride, v)
    }

    /// Of x̂, η̂ and u_ad: single estimates aren't determined where the regressor excites them little. The states are
    /// extrapolated to strides of no length.
    fn conclude(&self, whole: &Values<f64>, nominals: &[f64], v: &mut Point) -> ErrorEstimate {
        let halves = &v.values();
        let (x_hat, u_ad) = (&nominals[self.x_hat.span().range()], nominals[self.f.span().start]);
        let mut worst = 0.0;
        let mut compare = |whole: f64, halves: f64, magnitude: f64| {
            let error = (whole - halves).abs() / magnitude.max(whole.abs()).max(halves.abs());
            // Not a number, once it is.
            worst = if error > worst || error.is_nan() { error } else { worst };
        };
        for (k, &nominal) in x_hat.iter().enumerate() {
            compare(whole[self.x_hat][k], halves[self.x_hat][k], nominal);
        }
        for i in 0..self.u.len() {
            compare(whole[self.u_ad][i], halves[self.u_ad][i], u_ad);
            // η̂ passes through zero where what it is made of does not.
            compare(whole[self.eta_hat][i], halves[self.eta_hat][i], u_ad.max(self.magnitude(i, halves)));
        }
        let scaled = worst / halves[self.design.adaptation_tolerance];
        self.extrapolate(whole, v);
        ErrorEstimate { scaled, order: 2 }
    }
}

impl L1 {
    fn declare_dependence(&self, d: &mut Declaration) {
        let estimates: [&dyn Handle; 3] = [&self.omega_hat, &self.theta_hat, &self.sigma_hat];
        let control: &[&dyn Handle] = match self.baseline {
            Baseline::None => &[&self.f, &self.u_manual],
            Baseline::Outside | Baseline::Inside => &[&self.f, &self.u_manual, &self.x],
        };
        d.depends(self.u, control);
        d.depends(self.u_ad, &[&self.f]);
        d.depends(self.eta_hat, &[&estimates[..], control, &[&self.x]].concat());
        d.depends(self.adaptation_frequency, &[control, &[&self.x]].concat());
        d.depends(self.x_hat.rate(), &[&estimates[..], control, &[&self.x, &self.x_hat]].concat());
        d.depends(self.omega_hat.rate(), &[control, &[&self.x, &self.x_hat, &self.omega_hat]].concat());
        d.depends(self.theta_hat.rate(), &[&self.x, &self.x_hat, &self.theta_hat]);
        d.depends(self.sigma_hat.rate(), &[&self.x, &self.x_hat, &self.sigma_hat]);
        d.depends(self.f.rate(), &[&estimates[..], control, &[&self.x, &self.r]].concat());
    }

    /// Γ Proj(·, ·) of each estimate.
    fn adaptive_laws<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        let (phi, s) = (&v[self.phi], &v[self.s]);
        let (gamma, epsilon) = (v[self.design.adaptation_gain], v[self.design.projection_tolerance]);
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            dx[self.omega_hat][k] = gamma * projection(v[self.omega_hat][k], s[i] * v[self.v][j], lo, hi, epsilon);
        }
        for i in 0..s.len() {
            let (theta, sigma) = (v[self.design.theta_bound][i], v[self.design.sigma_bound][i]);
            for (j, &phi) in phi.iter().enumerate() {
                let entry = self.theta_hat.at(i, j);
                dx[entry] = gamma * projection(v[entry], s[i] * phi, -theta, theta, epsilon);
            }
            dx[self.sigma_hat][i] = gamma * projection(v[self.sigma_hat][i], s[i], -sigma, sigma, epsilon);
        }
    }

    /// f' = A_f f − B_f K (η̂ − K_g r) in each channel. K stands before the filter, so that tuning it never makes the
    /// control jump.
    fn control_law<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        let (r, eta_hat) = (&v[self.r], &v[self.eta_hat]);
        let (K, K_g) = (v.matrix(self.design.feedback_gain), v.matrix(self.design.K_g));
        let Filter { A_f, B_f, .. } = &self.filter;
        for i in 0..r.len() {
            let error = |j: usize| eta_hat[j] - dot(K_g.row(j).iter(), r);
            let driven = -(0..r.len()).fold(S::from(0.0), |sum, j| sum + K[(i, j)] * error(j));
            for k in 0..self.filter.order() {
                let states = &v[self.f][i * self.filter.order()..];
                let own = A_f.row(k).iter().zip(states).fold(driven * B_f[k], |sum, (&a, &f)| sum + f * a);
                dx[self.f][i * self.filter.order() + k] = own;
            }
        }
    }

    /// Where strides of no length would lead: the error of a stride is proportional to its length.
    fn extrapolate(&self, whole: &Values<f64>, v: &mut Point) {
        for handle in [self.x_hat, self.omega_hat, self.theta_hat.elements(), self.sigma_hat, self.f] {
            v[handle].iter_mut().zip(&whole[handle]).for_each(|(halves, whole)| *halves += *halves - whole);
        }
        self.bring_within_bounds(v);
    }

    /// Puts the adaptive control where the control is the manual one.
    fn take_over(&self, v: &mut Point) {
        for i in 0..self.u.len() {
            let feedback = self.design.K_m(&v.values()).map_or(0.0, |K_m| dot(K_m.row(i).iter(), &v[self.x]));
            let u = within(v[self.u_manual][i], v[self.design.u_min][i], v[self.design.u_max][i]);
            for (k, rest) in self.filter_at_rest.iter().enumerate() {
                v[self.f][i * self.filter.order() + k] = (u + feedback) * rest;
            }
        }
    }
}

fn dot<'a, S: Scalar>(row: impl Iterator<Item = &'a S>, column: &[S]) -> S {
    row.zip(column).fold(S::from(0.0), |sum, (&a, &b)| sum + a * b)
}

fn squared<S: Scalar>(x: &[S]) -> S {
    dot(x.iter(), x)
}

fn infinity_norm<S: Scalar>(x: &[S]) -> S {
    x[largest(x)].abs()
}

/// The place of the element of the largest magnitude.
fn largest<S: Scalar>(x: &[S]) -> usize {
    (1..x.len()).fold(0, |best, k| if x[k].re().abs() > x[best].re().abs() { k } else { best })
}
