//! The linear controller that an L1 controller tends to as its adaptation gets fast, Γ → ∞.
//!
//! The estimates then equal the deviation of the plant from its desired dynamics: η = B⁺ (x' − A_m x), and with
//! unmatched uncertainty (η, η_2) = B̄⁺ (x' − A_m x), B̄ = (B B_um). R. Ortega and E. Panteley, Adaptation is
//! unnecessary in L1-"adaptive" control: what makes an adaptive controller "adaptive"?, IEEE Control Systems 36 (2016)
//! 47–52, arXiv 1409.2389, for state feedback and D(s) = 1/s; the rest is this package's.
#![allow(non_snake_case)] // matrices have the names of the thesis

mod report;
mod structure;
mod template;
mod turning;

use nalgebra::{DMatrix, DVector};

use super::angles::Jumps;
use super::at_limit::{Limited, manual, unlimited};
use super::in_command::InCommand;
use super::l1::tracking::{self, BY_GAIN};
use super::l1::{Cancellation, Commands, Dynamics, L1, PlantMatrices, SETTLED, Symbols, Zeros, add_product, dot};
use super::origins::Origins;
use super::supervised::Supervised;
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::filter::Filter;
use crate::mathematics::limits::{self, within};
use crate::mathematics::{feedforward, lyapunov};
use crate::pages::{self, Page};
use crate::system::{
    Choice, ChoiceOf, Class, Declaration, DesignReport, Discrete, Input, Invalid, MatrixOf, Parameter, Point, Prepared,
    Rates, Scalar, ScalarOf, Signal, Signals, State, System, Values, VectorOf, choice, matrix, scalar, vector,
};
use crate::template::{Needs, Sizes, Template};
pub use structure::L1LimitStructure;

/// Parameters of an L1 controller that nothing is left of here.
const OF_ADAPTATION: [&str; 12] = [
    "adaptation_gain",
    "Q",
    "omega_min",
    "omega_max",
    "theta_bound",
    "sigma_bound",
    "theta_bound_unmatched",
    "sigma_bound_unmatched",
    "projection_tolerance",
    "adaptation_tolerance",
    "closed_form_phase",
    "step_phase_limit",
];

/// Start of u_ad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LinearStart {
    Zero,
    Bumpless,
}

impl Choice for LinearStart {
    const TYPE: &'static str = "LinearStart";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Zero, "zero", "u_ad starts at zero"),
        (Self::Bumpless, "bumpless", "u_ad starts such that the control starts at u_manual"),
    ];
}

/// u = u_ad − K_m x, u_ad = −K D(s)(η + H_m⁻¹ H_um η_2 − K_g r), (η, η_2) = B̄⁺ (x' − A_m x), without differentiating x.
#[derive(Debug)]
pub struct L1Limit {
    plant: PlantMatrices,
    /// B̄⁺, the pseudoinverse of (B B_um).
    inverse: DMatrix<f64>,
    filter: Filter,
    /// The filter's state at rest, for an output of 1.
    filter_at_rest: DVector<f64>,
    dynamics: Dynamics,
    K: MatrixOf<Parameter>,
    inertia: Option<VectorOf<Parameter>>,
    tracking_time: VectorOf<Parameter>,
    /// T_f, if η_2 has feedthrough to u_ad.
    T_f: Option<ScalarOf<Parameter>>,
    u_ad_start: ChoiceOf<Parameter, LinearStart>,
    /// In a box: compiled code may read within what isn't there, in vain, but for checkers of memory.
    cancellation: Option<Box<Cancellation>>,
    K_g: MatrixOf<Prepared>,
    settling_time: ScalarOf<Prepared>,
    /// L of the parameters, and the one in force.
    L: MatrixOf<Prepared>,
    L_in_force: MatrixOf<Discrete>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    r: VectorOf<Input>,
    units_of_r: Vec<&'static str>,
    of_r: Vec<String>,
    x: VectorOf<Input>,
    origins: Option<Origins>,
    jumps: Option<Jumps>,
    in_command: InCommand,
    /// f − L x
    w: VectorOf<State>,
    /// States of D(s), channel by channel; then those of H_m⁻¹ H_um; then h, what is differentiated of η_2.
    f: VectorOf<Signal>,
    /// A_m x
    drift: VectorOf<Signal>,
    /// K_g r
    command: VectorOf<Signal>,
    /// K_m x
    feedback: VectorOf<Signal>,
    u_ad: VectorOf<Signal>,
    u: VectorOf<Signal>,
    /// Difference that the limits make to the control, in the units of u_ad.
    added: VectorOf<Signal>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    supervised: Supervised,
}

impl Tracking for L1Limit {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_r.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_r.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let error = v[self.r][channel] - self.plant.output(channel, &v[self.x]);
        if self.is_angle(channel) { error.wrap() } else { error }
    }
}

impl System for L1Limit {
    type Structure = L1LimitStructure;
    const NAME: &'static str = "l1-limit";
    const DOCUMENTATION: &'static str = pages::L1_LIMIT.text;

    fn declare(structure: L1LimitStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let structure = structure.of_l1;
        let (plant, filter) = (structure.plant()?, structure.filter()?);
        let inverse = structure::inverse(&plant)?;
        let ((n, m), k) = (plant.B.shape(), plant.B_um.ncols());
        let units = structure.units((n, m))?;
        let (angles, turning) = structure.angles(&plant, &units.x)?;
        turning::require_moving(&turning)?;
        let dynamics = Dynamics::declare(d, &plant, &structure);
        let cancellation = if k > 0 { Some(Box::new(Cancellation::declare(d, &plant, &filter)?)) } else { None };
        let is_direct = cancellation.as_ref().is_some_and(|cancellation| cancellation.direct.is_some());
        let zeros = cancellation.as_ref().and_then(|cancellation| cancellation.order()).unwrap_or(0);
        let order = m * filter.order() + zeros + if is_direct { k } else { 0 };
        d.without_effect(OF_ADAPTATION);
        let Symbols { r, x, u, command, inertia, of_r, of_x, of_u } = &units;
        let hidden = |name: &str, len: usize| vector(name, len, "").hidden();
        let limited = Limited::declare(d, (u, of_u), "that the actuator can give", "");
        let unlimited = unlimited(d, m);
        Ok(L1Limit {
            filter_at_rest: filter.at_rest(),
            K: d.parameter(
                matrix("feedback_gain", m, m, "feedback gain K of the filter K D(s)").unit("1/s").identity(),
            ),
            inertia: (structure.commands == Commands::Acceleration).then(|| {
                let text = "nominal inertia that turns a commanded acceleration into the control";
                d.parameter(vector("nominal_inertia", m, text).units(inertia).start(1.0).positive())
            }),
            tracking_time: {
                let text = "time constant with which u_ad tracks the limited control (anti-windup); \
                            -1 s: 1/K, 0: off";
                d.parameter(vector("tracking_time", m, text).unit("s").start(BY_GAIN).min(BY_GAIN))
            },
            T_f: is_direct.then(|| {
                let text =
                    "time constant with which the unmatched uncertainty is differentiated for its feedthrough to u_ad";
                d.parameter(scalar("unmatched_filter_time", text).unit("s").start(1e-3).positive())
            }),
            u_ad_start: d.parameter(choice::<LinearStart>("u_ad_start", "start of the filtered control").fixed()),
            K_g: d.prepared(matrix("K_g", m, m, "feedforward gain -(C A_m^-1 B)^-1 for unit steady-state gain")),
            settling_time: d.prepared(scalar("#settling time", "").hidden()),
            L: d.prepared(matrix("#L", order, n, "").hidden()),
            L_in_force: d.discrete(matrix("#L in force", order, n, "").hidden()),
            r: d.input(vector("r", m, "reference").about(of_r, "reference of {}").units(r)),
            x: d.input(vector("x", n, "measured state of the plant").about(of_x, "measured {}").units(x)),
            origins: Origins::declare(d, turning, "a reference"),
            jumps: None,
            in_command: InCommand::declare(d, "it takes over without a jump", manual(u, of_u)),
            w: d.state(
                vector("w", order, "state of the controller: that of its filters, less L x")
                    .source("Hashim (3.4), (3.22), (3.62), as adaptation gets fast"),
            ),
            f: d.local(hidden("#f", order)),
            drift: d.local(hidden("#A_m x", n)),
            command: d.local(hidden("#K_g r", m)),
            feedback: d.local(hidden("#K_m x", m)),
            u_ad: d.local(
                vector("u_ad", m, "control that the filter gives")
                    .about(of_u, "control for the {} that the filter gives")
                    .units(command),
            ),
            added: d.local(hidden("#added by limits", m)),
            unlimited,
            supervised: Supervised::declare(d, limited),
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            units_of_r: units.r,
            of_r: units.of_r,
            plant,
            inverse,
            filter,
            dynamics,
            cancellation,
        }
        .watching(&units.x, &angles, d))
    }

    /// K_m, A_m, K_g, and H_m⁻¹ H_um.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.dynamics.prepare(&self.plant, v)?;
        let (name, A_m) = (self.dynamics.name_of_A_m(&v.values()), self.dynamics.A_m(&v.values()).into_owned());
        v[self.settling_time] = (SETTLED / lyapunov::slowest_decay(&name, &A_m)?).min(f64::MAX);
        let K_g = feedforward::gain(&A_m, &self.plant.B, &self.plant.C, &name)?;
        v.matrix_mut(self.K_g).copy_from(&K_g);
        let Some(cancellation) = &self.cancellation else { return Ok(()) };
        cancellation.prepare((&name, &A_m), &self.plant, &self.filter, v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        tracking::check(self.tracking_time, v);
        if let Some(cancellation) = &self.cancellation {
            cancellation.relate(self.K, v);
        }
        self.relate_L(v);
    }

    /// The filters start at zero, f = 0, or where the manual control has them.
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        let enabled = self.in_command.begin(v);
        self.start_origins(v);
        v.copy(self.L, self.L_in_force);
        for k in 0..self.w.len() {
            v[self.w][k] = -self.of_state(k, &v.values());
        }
        let takes_over = !enabled | v.get(self.u_ad_start).is(LinearStart::Bumpless);
        v.when(takes_over, |v| self.take_over(v));
    }

    /// f stays where it is under another L.
    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        for k in 0..self.w.len() {
            let f = v[self.w][k] + self.of_state(k, &v.values());
            v[self.w][k] = f - self.times_state(self.L, k, &v.values());
        }
        v.copy(self.L, self.L_in_force);
    }

    /// f = w + L x; u_ad = C_f f − feedthrough of η_2; u = u_ad − K_m x, or the manual control, within the limits.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for k in 0..self.w.len() {
            y[self.f][k] = v[self.w][k] + self.of_state(k, v);
        }
        y[self.drift].fill(S::from(0.0));
        add_product(&mut y[self.drift], self.dynamics.A_m(v), (0..self.x.len()).map(|k| self.state(k, v)));
        y[self.command].fill(S::from(0.0));
        add_product(&mut y[self.command], v.matrix(self.K_g), (0..self.r.len()).map(|i| self.reference(i, v)));
        let active = self.in_command.is_active(v);
        for i in 0..self.u.len() {
            let (u_ad, feedback) = (self.filtered(i, &y[self.f], v), self.feedback(i, v));
            let inertia = self.inertia(i, v);
            let wanted = S::branch(active, || (u_ad - feedback) * inertia, || v[self.in_command.u_manual][i]);
            let u = within(wanted, v[self.u_min][i], v[self.u_max][i]);
            y[self.unlimited][i] = wanted;
            (y[self.u][i], y[self.feedback][i], y[self.added][i]) = (u, feedback, (u - wanted) / inertia);
            y[self.u_ad][i] = S::branch(active, || u_ad, || u / inertia + feedback);
        }
    }

    /// w' = f' − L x'. Under manual control the filters of the channels rest, to be set when it ends; states that
    /// depend on x only continue.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let active = self.in_command.is_active(v);
        for k in 0..self.w.len() {
            let beyond_drift = || self.driven(k, v) - dot(v.matrix(self.L_in_force).row(k).iter(), &v[self.drift]);
            dx[self.w][k] =
                if k < self.of_filters() { S::branch(active, beyond_drift, || S::from(0.0)) } else { beyond_drift() };
        }
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.in_command.event_indicators(v, z);
        self.origin_indicators(v, z);
    }

    /// Takes over, or hands over, where `enabled` has changed; moves origins of angles.
    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.in_command.event(v, |v| self.take_over(v));
        self.move_origins(v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let (active, settling_time) = (self.in_command.is_active(&v.values()), v[self.settling_time]);
        self.supervised.look((t, step), settling_time, active, v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }
}

impl L1Limit {
    /// Number of states of the filters D(s) of all channels.
    fn of_filters(&self) -> usize {
        self.u.len() * self.filter.order()
    }

    /// Number of states of H_m⁻¹ H_um.
    fn zeros(&self) -> usize {
        self.cancellation.as_ref().and_then(|cancellation| cancellation.order()).unwrap_or(0)
    }

    /// First of the states h that differentiate η_2; none if it isn't needed.
    fn differentiated(&self) -> Option<usize> {
        self.T_f.map(|_| self.of_filters() + self.zeros())
    }

    /// L in force, times x.
    fn of_state<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        self.times_state(self.L_in_force, k, v)
    }

    /// A row of a matrix times x.
    fn times_state<S: Scalar, C: Class>(&self, matrix: MatrixOf<C>, row: usize, v: &Values<S>) -> S {
        (0..self.x.len()).fold(S::from(0.0), |sum, k| sum + v[matrix.at(row, k)] * self.state(k, v))
    }

    /// L, by which f' = … + L (x' − A_m x): what (η, η_2) = B̄⁺ (x' − A_m x) drives.
    fn relate_L<S: Scalar>(&self, v: &mut Point<S>) {
        let n = self.x.len();
        for (k, column) in (0..self.w.len()).flat_map(|k| (0..n).map(move |column| (k, column))) {
            let entry = self.entry_of_L(k, column, v);
            v[self.L.at(k, column)] = entry;
        }
    }

    fn entry_of_L<S: Scalar>(&self, k: usize, column: usize, v: &Point<S>) -> S {
        let (m, order, none) = (self.u.len(), self.filter.order(), S::from(0.0));
        let matched = |j: usize| self.inverse[(j, column)];
        let unmatched = |l: usize| self.inverse[(m + l, column)];
        if let Some((T_f, first)) = self.T_f.zip(self.differentiated()).filter(|(_, first)| k >= *first) {
            return v[T_f].recip() * unmatched(k - first);
        }
        let at_once = self.cancellation.as_ref().filter(|_| self.T_f.is_none());
        let of_unmatched = |matrix: MatrixOf<Prepared>, row: usize| {
            (0..self.plant.B_um.ncols()).fold(none, |sum, l| sum + v[matrix.at(row, l)] * unmatched(l))
        };
        if k >= self.of_filters() {
            let zeros = at_once.and_then(|cancellation| cancellation.zeros.as_ref());
            return zeros.map_or(none, |zeros| of_unmatched(zeros.B_z, k - self.of_filters()));
        }
        let (i, place) = (k / order, k % order);
        let driven = (0..m).fold(none, |sum, j| sum + v[self.K.at(i, j)] * matched(j)) * self.filter.B_f[place];
        at_once.map_or(-driven, |cancellation| -driven - of_unmatched(cancellation.input, k))
    }

    /// f' but for L (x' − A_m x): A_f f + B_f K K_g r, less what H_m⁻¹ H_um has; what the limits add.
    fn driven<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        let f = &v[self.f];
        let (order, filters) = (self.filter.order(), self.of_filters());
        let (z, h) = f[filters..].split_at(self.zeros());
        if k >= filters + z.len() {
            return self.T_f.map_or(S::from(0.0), |T_f| -f[k] / v[T_f]);
        }
        let cancellation = self.cancellation.as_ref();
        let zeros = cancellation.and_then(|cancellation| cancellation.zeros.as_ref());
        if let Some(Zeros { A_z, B_z, .. }) = zeros.filter(|_| k >= filters) {
            let row = k - filters;
            return dot(v.matrix(*A_z).row(row).iter(), z) + dot(v.matrix(*B_z).row(row).iter(), h);
        }
        let (i, place) = (k / order, k % order);
        let of_channel = &f[i * order..][..order];
        let K_row = || v.matrix(self.K);
        let own = self.filter.A_f.row(place).iter().zip(of_channel).fold(S::from(0.0), |sum, (&a, &f)| sum + f * a);
        let mut wanted = dot(K_row().row(i).iter(), &v[self.command]);
        if let Some(Zeros { KC_z, .. }) = zeros {
            wanted -= dot(v.matrix(*KC_z).row(i).iter(), z);
        }
        let mut rate = own + wanted * self.filter.B_f[place];
        if let Some(cancellation) = cancellation.filter(|_| !h.is_empty()) {
            rate -= dot(v.matrix(cancellation.input).row(k).iter(), h);
        }
        let tracking = || {
            tracking::rate(v[self.tracking_time][i], K_row().row(i).iter(), self.filter_at_rest[0])
                * v[self.added][i]
                * self.filter_at_rest[place]
        };
        rate + S::branch(v[self.added][i].equals(S::from(0.0)), || S::from(0.0), tracking)
    }

    /// Output of a channel's filter for these states.
    fn filtered<S: Scalar>(&self, i: usize, f: &[S], v: &Values<S>) -> S {
        let of_channel = &f[i * self.filter.order()..][..self.filter.order()];
        let u_ad = of_channel.iter().zip(self.filter.C_f.iter()).fold(S::from(0.0), |sum, (&f, &c)| sum + f * c);
        self.differentiated().map_or(u_ad, |first| u_ad - self.at_once(i, &f[first..], v))
    }

    /// Feedthrough of h to u_ad of a channel.
    fn at_once<S: Scalar>(&self, i: usize, h: &[S], v: &Values<S>) -> S {
        let direct = self.cancellation.as_ref().and_then(|cancellation| cancellation.direct);
        direct.map_or(S::from(0.0), |direct| dot(v.matrix(direct).row(i).iter(), h))
    }

    /// K_m x of a channel.
    fn feedback<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.dynamics.gain().map_or(S::from(0.0), |K_m| self.times_state(K_m, i, v))
    }

    /// Factor from the command of a channel to its control.
    fn inertia<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.inertia.map_or(S::from(1.0), |inertia| v[inertia][i])
    }

    /// Puts the filters where u_ad − K_m x is the manual control, within the limits, and they rest.
    fn take_over<S: Scalar>(&self, v: &mut Point<S>) {
        let order = self.filter.order();
        for i in 0..self.u.len() {
            let values = v.values();
            let manual = within(v[self.in_command.u_manual][i], v[self.u_min][i], v[self.u_max][i]);
            let direct = self.cancellation.as_ref().and_then(|cancellation| cancellation.direct);
            let at_once = self.differentiated().zip(direct).map_or(S::from(0.0), |(first, direct)| {
                let h = |l: usize| v[self.w][first + l] + self.of_state(first + l, &values);
                (0..direct.shape().1).fold(S::from(0.0), |sum, l| sum + v[direct.at(i, l)] * h(l))
            });
            let u_ad = manual / self.inertia(i, &values) + self.feedback(i, &values) + at_once;
            for place in 0..order {
                let k = i * order + place;
                v[self.w][k] = u_ad * self.filter_at_rest[place] - self.of_state(k, &v.values());
            }
        }
    }
}

impl Catalogued for L1Limit {
    const PAGE: Page = pages::L1_LIMIT;
    const LIMIT_OF: Option<&'static str> = Some(L1::NAME);
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: Some(Needs::States),
        tried: &[Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(2, 2), Sizes::plant(3, 1), Sizes::plant(6, 3)],
    });
}
