//! The L1 law: state predictor, adaptive laws, control law (thesis, sections 3.2 to 3.4).
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{DMatrix, DMatrixView, DVector};

use super::design::Design;
use super::ports::Ports;
use super::structure::{Baseline, L1Structure, PlantMatrices, Regressor};
use super::unmatched::Unmatched;
use super::{AdaptiveStart, add_product, dot, infinity_norm, squared};
use crate::controllers::angles::Jumps;
use crate::controllers::at_limit::AtLimit;
use crate::controllers::in_command::InCommand;
use crate::controllers::moves::Moves;
use crate::controllers::origins::Origins;
use crate::mathematics::filter::Filter;
use crate::mathematics::projection::projection;
use crate::system::{
    BooleanOf, ChoiceOf, Declaration, Discrete, IntegerOf, Invalid, MatrixOf, Memory, Parameter, Point, Rates, Scalar,
    ScalarOf, Signal, Signals, State, Values, VectorOf, Warning, boolean, choice, diagonal, integer, larger, matrix,
    scalar, vector,
};

/// Addition of an FMU to the adaptive control. The predictor knows of it, and the estimates don't see it.
#[derive(Debug, Clone, Copy)]
pub(in crate::controllers) struct AddedControl {
    /// In units of u_ad; 0 while the controller isn't in command.
    pub now: VectorOf<Signal>,
    /// Its value when the controller takes over without a jump, or starts.
    pub at_takeover: VectorOf<Discrete>,
}

/// Goal of the controller.
#[derive(Debug, Clone, Copy)]
pub(in crate::controllers) enum Goal<'a, S> {
    /// The reference of the outputs.
    Reference(&'a [S]),
    /// Replacement of K_g r.
    Command(VectorOf<Signal>),
}

/// Controller for a plant x' = A_m x + B (ω v + θ φ(x) + σ) + B_um (θ_2 ‖x‖∞ + σ_2).
#[derive(Debug)]
pub(in crate::controllers) struct Law {
    pub(super) plant: PlantMatrices,
    /// (B B_um)
    pub(super) directions: DMatrix<f64>,
    pub(super) filter: Filter,
    /// The filter's state at rest, for an output of 1.
    pub(super) filter_at_rest: DVector<f64>,
    pub(super) regressor: Regressor,
    /// Factors of x in φ(x) = x; empty if there are none.
    pub(super) regressor_gains: Vec<f64>,
    pub(super) baseline: Baseline,
    pub(super) design: Design,
    u_ad_start: ChoiceOf<Parameter, AdaptiveStart>,
    pub(super) ports: Ports,
    pub(super) origins: Option<Origins>,
    pub(super) jumps: Option<Jumps>,
    pub(super) x_hat: VectorOf<State>,
    pub(super) omega_hat: VectorOf<State>,
    pub(super) theta_hat: MatrixOf<State>,
    pub(super) sigma_hat: VectorOf<State>,
    /// State of the filters, channel by channel.
    pub(super) f: VectorOf<State>,
    pub(super) unmatched: Option<Unmatched>,
    pub(super) added: Option<AddedControl>,
    pub(super) u_ad: VectorOf<Signal>,
    /// True if u_ad is the state f itself, and has its name.
    u_ad_is_state: bool,
    pub(super) eta_hat: VectorOf<Signal>,
    /// η̂ − K_g r, which u_ad is to take away.
    excess: VectorOf<Signal>,
    pub(super) adaptation_frequency: ScalarOf<Signal>,
    /// K_m x
    pub(super) feedback: VectorOf<Signal>,
    /// The control that the estimates see.
    pub(super) v: VectorOf<Signal>,
    /// φ(x)
    pub(super) phi: VectorOf<Signal>,
    /// s = −(B B_um)ᵀ P x̃
    s: VectorOf<Signal>,
    pub(super) in_command: InCommand,
    pub(super) step_too_long: BooleanOf<Discrete>,
    pub(super) moves: Moves,
    pub(super) at_limit: AtLimit,
    pub(super) projection_active: IntegerOf<Discrete>,
    /// Row and column of each estimated entry of ω̂.
    pub(super) omega_entries: Vec<(usize, usize)>,
    pub(super) at_bounds: Warning,
    pub(super) long_step: Warning,
}

impl Law {
    /// The controller of a description, between these ports.
    ///
    /// # Errors
    /// [`Invalid`] when the description contradicts itself.
    pub fn declare(structure: &L1Structure, ports: Ports, d: &mut Declaration) -> Result<Self, Invalid> {
        Self::with(structure, ports, None, d)
    }

    /// The controller of a description, between these ports, with the addition of an FMU to the control.
    ///
    /// # Errors
    /// [`Invalid`] when the description contradicts itself.
    pub fn with(
        structure: &L1Structure,
        ports: Ports,
        added: Option<AddedControl>,
        d: &mut Declaration,
    ) -> Result<Self, Invalid> {
        let (plant, filter) = (structure.plant()?, structure.filter()?);
        let (n, m) = plant.B.shape();
        let units = structure.units((n, m))?;
        let (angles, turning) = structure.angles(&plant, &units.x)?;
        let full = structure.is_full();
        let omega_entries: Vec<_> =
            if full { (0..m * m).map(|k| (k % m, k / m)).collect() } else { (0..m).map(|i| (i, i)).collect() };
        let (omega_hat, u_ad) = ("estimate of the input gain omega", "adaptive control, the filtered estimate");
        let columns = if structure.regressor == Regressor::State { n } else { 1 };
        let theta_hat = "estimate of theta, the uncertainty's dependence on the state";
        let frequency = "frequency at which the estimates oscillate about their values";
        let design = Design::declare(d, &plant, structure, &units, added.is_none())?;
        let unmatched = Unmatched::declare(d, &plant, &filter)?;
        // Where nothing else makes u_ad, the integrator's state is u_ad itself.
        let is_state = filter.is_integrator()
            && unmatched.as_ref().is_none_or(|unmatched| unmatched.cancellation.direct.is_none());
        let adaptive = vector("u_ad", m, u_ad).about(&units.of_u, "adaptive control for the {}, the filtered estimate");
        let law = Law {
            filter_at_rest: filter.at_rest(),
            regressor: structure.regressor,
            regressor_gains: structure.regressor_gains(n)?,
            baseline: structure.baseline,
            design,
            u_ad_start: d.parameter(choice::<AdaptiveStart>("u_ad_start", "start of the adaptive control").fixed()),
            ports,
            x_hat: d.state(
                vector("x_hat", n, "state of the predictor")
                    .about(&units.of_x, "predicted {}")
                    .units(&units.x)
                    .source("Hashim (3.2), (3.19), (3.60)"),
            ),
            omega_hat: if full {
                d.state(matrix("omega_hat", m, m, omega_hat).source("Hashim (3.3), (3.21), (3.61)")).elements()
            } else {
                d.state(diagonal("omega_hat", m, omega_hat).source("Hashim (3.3), (3.21), (3.61)"))
            },
            theta_hat: d.state(matrix("theta_hat", m, columns, theta_hat).source("Hashim (3.3), (3.21), (3.61)")),
            sigma_hat: d.state(
                vector("sigma_hat", m, "estimate of the disturbance sigma").source("Hashim (3.3), (3.21), (3.61)"),
            ),
            f: if is_state {
                d.state(adaptive.clone().units(&units.command).source("Hashim (3.4), (3.22), (3.62)"))
            } else {
                d.state(
                    matrix("filter_state", filter.order(), m, "state of the filter D(s) of a channel")
                        .source("Hashim (3.4), (3.22), (3.62)"),
                )
                .elements()
            },
            u_ad: d.local(if is_state { vector("#u_ad", m, "").hidden() } else { adaptive.units(&units.command) }),
            u_ad_is_state: is_state,
            eta_hat: d.local(
                vector("eta_hat", m, "estimate of the matched uncertainty with the control's own effect")
                    .source("Hashim (3.4), (3.22), (3.62)"),
            ),
            excess: d.local(vector("#eta_hat - K_g r", m, "").hidden()),
            adaptation_frequency: d.local(scalar("adaptation_frequency", frequency).unit("rad/s").in_own_unit()),
            feedback: d.local(vector("#feedback", m, "").hidden()),
            v: d.local(vector("#v", m, "").hidden()),
            phi: d.local(vector("#phi", columns, "").hidden()),
            s: d.local(vector("#s", m + plant.B_um.ncols(), "").hidden()),
            in_command: InCommand::by(d, ports.enabled, ports.u_manual),
            step_too_long: d.discrete(
                boolean("step_too_long", "whether the communication step is too long for the control").output(),
            ),
            moves: {
                let is_stepped = d.is_stepped();
                Moves::declare(d, m, is_stepped)
            },
            at_limit: AtLimit::declare(d, ports.limited),
            origins: Origins::declare(d, turning, "a reference"),
            jumps: Jumps::declare(d, ports.x, &units.x, &angles),
            projection_active: d.discrete(
                integer("projection_active", "number of estimates limited to their bounds by projection").output(),
            ),
            omega_entries,
            at_bounds: d.warning("logProjection", "estimates at their bounds, or brought back to tightened ones"),
            long_step: d.warning("logStepTooLong", "communication step too long for the control"),
            directions: plant.all_directions(),
            unmatched,
            added,
            plant,
            filter,
        };
        Ok(law)
    }

    /// Designs matrices from parameters.
    ///
    /// # Errors
    /// [`Invalid`] with every reason.
    pub fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.design.prepare(&self.plant, v)?;
        let Some(unmatched) = &self.unmatched else { return Ok(()) };
        let (name, A_m) = (self.design.name_of_A_m(&v.values()), self.design.A_m(&v.values()).into_owned());
        unmatched.cancellation.prepare((&name, &A_m), &self.plant, &self.filter, v)
    }

    /// Computes numbers from parameters by arithmetic, and checks their relations.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        self.design.relate(v);
        if let Some(unmatched) = &self.unmatched {
            unmatched.cancellation.relate(self.design.feedback_gain, v);
        }
    }

    /// The predictor starts at the measured state; ω̂ at the identity, which its bounds must hold, the other estimates
    /// at zero.
    pub fn initialise<S: Scalar>(&self, v: &mut Point<S>) {
        let enabled = self.in_command.begin(v);
        self.start_predictor(v);
        v[self.f].fill(S::from(0.0));
        let takes_over = !enabled | v.get(self.u_ad_start).is(AdaptiveStart::Bumpless);
        v.when(takes_over, |v| self.take_over(v));
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            let start = S::from(f64::from(u8::from(i == j)));
            v.refuse(!(lo.at_most(start) & start.at_most(hi)), |v| {
                let [min, max] = [v.name(self.design.omega_min.at(k)), v.name(self.design.omega_max.at(k))];
                let allowed = format!(
                    "must contain the start value {} of the estimate {}",
                    start.to_text(),
                    v.name(self.omega_hat)
                );
                Invalid::new(format!("{min} … {max}"), format!("{} … {}", lo.to_text(), hi.to_text()), allowed)
            });
            v[self.omega_hat][k] = start;
        }
    }

    /// K, unless another matrix replaces it.
    pub fn feedback_gain(&self) -> MatrixOf<Parameter> {
        self.design.feedback_gain
    }

    /// y = C x of a channel.
    pub fn output<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.plant.output(channel, &v[self.ports.x])
    }

    /// y' = C A_m x of a channel, as it follows from the state for the nominal plant: without uncertainty, and where the
    /// control doesn't enter it (C B = 0).
    pub fn output_rate<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let (A_m, x) = (self.design.A_m(v), &v[self.ports.x]);
        let rates = A_m.row_iter().map(|row| dot(row.iter(), x));
        rates.zip(self.plant.C.row(channel).iter()).fold(S::from(0.0), |sum, (rate, &c)| sum + rate * c)
    }

    /// True if K may change while the controller runs.
    ///
    /// # Errors
    /// [`Invalid`] with the reason, if it may not.
    pub fn allows_scheduling(&self) -> Result<(), Invalid> {
        if self.unmatched.is_none() {
            return Ok(());
        }
        let allowed = "must be false: a varying feedback gain would make the control jump, because it acts on the \
            cancellation of unmatched uncertainty without delay. Use `l1` with its constant gain, or leave out \
            unmatched and B_um";
        Err(Invalid::new("unmatched", true, allowed))
    }

    /// True if the static feedback stands outside of what the predictor sees.
    pub fn has_baseline_outside(&self) -> bool {
        self.baseline == Baseline::Outside
    }

    /// A_m
    pub fn desired_dynamics<'a, S: Scalar>(&self, v: &Values<'a, S>) -> DMatrixView<'a, S> {
        self.design.A_m(v)
    }

    /// K_g
    pub fn reference_gain<'a, S: Scalar>(&self, v: &Values<'a, S>) -> DMatrixView<'a, S> {
        v.matrix(self.design.K_g)
    }

    /// True if a master of co-simulation steps the unit.
    pub fn is_stepped(&self) -> BooleanOf<Memory> {
        self.moves.is_stepped
    }

    /// True if the controller is in command.
    pub fn is_active<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        self.in_command.is_active(v)
    }

    /// The name of u_ad of a channel, for a text.
    pub(super) fn name_of_u_ad(&self, channel: usize, v: &Values<f64>) -> String {
        if self.u_ad_is_state { v.name(self.f.at(channel)) } else { v.name(self.u_ad.at(channel)) }
    }

    /// u = u_ad − K_m x within its limits; η̂ = ω̂ v + θ̂ φ(x) + σ̂ (+ K_m x), η̂_2 = θ̂_2 ‖x‖∞ + σ̂_2, and η̂ − K_g r;
    /// s = −(B B_um)ᵀ P x̃.
    pub fn outputs<S: Scalar>(&self, r: &[S], v: &Values<S>, y: &mut Signals<S>) {
        self.outputs_towards(Goal::Reference(r), v, y);
    }

    /// The same, with this goal; where a unit adds to the control, u and wanted hold it, and η̂ doesn't.
    pub fn outputs_towards<S: Scalar>(&self, goal: Goal<S>, v: &Values<S>, y: &mut Signals<S>) {
        let norm = infinity_norm(self.state(v));
        let unscaled = |j: usize| if self.regressor == Regressor::State { self.x(j, v) } else { norm };
        let scaled = |j: usize| self.regressor_gain(j).map_or(unscaled(j), |gain| unscaled(j) * gain);
        let phi = || (0..self.phi.len()).map(scaled);
        y[self.phi].iter_mut().zip(phi()).for_each(|(signal, phi)| *signal = phi);
        if let Some(unmatched) = &self.unmatched {
            unmatched.outputs(norm, v, y);
        }
        self.control(v, y);
        y.set(self.eta_hat, &v[self.sigma_hat]);
        if self.baseline == Baseline::Inside {
            for i in 0..self.eta_hat.len() {
                let known = y[self.feedback][i];
                y[self.eta_hat][i] += known;
            }
        }
        add_product(&mut y[self.eta_hat], v.matrix(self.theta_hat), phi());
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let term = v[self.omega_hat][k] * y[self.v][j];
            y[self.eta_hat][i] += term;
        }
        y[self.excess].fill(S::from(0.0));
        match goal {
            Goal::Reference(r) => add_product(&mut y[self.excess], v.matrix(self.design.K_g), self.references(r, v)),
            Goal::Command(command) => (0..self.excess.len()).for_each(|i| y[self.excess][i] = y[command][i]),
        }
        for i in 0..self.excess.len() {
            y[self.excess][i] = y[self.eta_hat][i] - y[self.excess][i];
        }
        for (i, column) in v.matrix(self.design.PB).column_iter().enumerate() {
            let x_tilde = v[self.x_hat].iter().zip(self.state(v)).map(|(&x_hat, x)| x_hat - x);
            y[self.s][i] = -x_tilde.zip(column.as_slice()).fold(S::from(0.0), |sum, (x, &p)| sum + x * p);
        }
        self.frequency(v, y);
    }

    /// ω_a of the signals as they stand.
    fn frequency<S: Scalar>(&self, v: &Values<S>, y: &mut Signals<S>) {
        let matched = squared(&y[self.v]) + squared(&y[self.phi]);
        let unmatched = self.unmatched.as_ref().map_or(S::from(0.0), |unmatched| y[unmatched.norm] * y[unmatched.norm]);
        y[self.adaptation_frequency] = self.frequency_for([matched, unmatched], v);
    }

    /// ω_a, of the faster of the matched and the unmatched estimates, for ‖v‖² + ‖φ‖² and ‖x‖∞².
    pub(super) fn frequency_for<S: Scalar>(&self, [matched, unmatched]: [S; 2], v: &Values<S>) -> S {
        let matched = v[self.design.lambda_max] * (matched + 1.0);
        let unmatched = v[self.design.lambda_max_unmatched] * (unmatched + 1.0);
        (v[self.design.adaptation_gain] * larger(matched, unmatched)).sqrt()
    }

    /// State predictor, adaptive laws with projection, and the control law u_ad = −K D(s) (η̂ + H_m⁻¹ H_um η̂_2 − K_g r).
    /// K may be another than the parameter where [`Law::allows_scheduling`]. While not enabled, the predictor follows the
    /// state, estimates are frozen, and the adaptive control follows the manual one.
    pub fn derivatives<S: Scalar>(&self, K: DMatrixView<S>, v: &Values<S>, dx: &mut Rates<S>) {
        self.predictor(v, dx);
        if let Some(unmatched) = &self.unmatched {
            unmatched.derivatives(v, dx);
        }
        self.freeze(dx);
        let active = self.in_command.is_active(v);
        dx.when(active, |dx| {
            self.control_law(K, v, dx);
            self.track_limits(K, v, dx);
            self.adaptive_laws(v, dx);
        });
        dx.when(!active, |dx| self.follow(v, dx));
    }

    /// x̂' = A_m x̂ + B η̂ + B_um η̂_2; while not enabled, x̂' = A_m (x̂ − x).
    fn predictor<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        let (x_hat, active) = (&v[self.x_hat], self.in_command.is_active(v));
        let followed = x_hat.iter().zip(self.state(v)).map(|(&x_hat, x)| S::branch(active, || x_hat, || x_hat - x));
        dx[self.x_hat].fill(S::from(0.0));
        add_product(&mut dx[self.x_hat], self.design.A_m(v), followed);
        dx.when(active, |dx| {
            let unmatched = self.unmatched.as_ref().map_or(&[][..], |unmatched| &v[unmatched.eta_hat]);
            for (direction, &eta) in self.directions.column_iter().zip(v[self.eta_hat].iter().chain(unmatched)) {
                // What isn't moved stays clear of an η̂ that is no number.
                let moved = dx[self.x_hat].iter_mut().zip(direction.iter()).filter(|(_, b)| **b != 0.0);
                moved.for_each(|(rate, &b)| *rate += eta * b);
            }
            let added = self.added.map_or(&[][..], |added| &v[added.now]);
            for (direction, &added) in self.plant.B.column_iter().zip(added) {
                let moved = dx[self.x_hat].iter_mut().zip(direction.iter()).filter(|(_, b)| **b != 0.0);
                moved.for_each(|(rate, &b)| *rate += added * b);
            }
        });
    }

    /// Estimates and the filter's states rest, unless something drives them.
    fn freeze<S: Scalar>(&self, dx: &mut Rates<S>) {
        let unmatched = self.unmatched.iter().flat_map(|unmatched| [unmatched.theta_hat, unmatched.sigma_hat]);
        let matched = [self.omega_hat, self.theta_hat.elements(), self.sigma_hat, self.f];
        matched.into_iter().chain(unmatched).for_each(|states| dx[states].fill(S::from(0.0)));
    }

    /// Γ Proj(·, ·) of each estimate.
    fn adaptive_laws<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        let (phi, s, m) = (&v[self.phi], &v[self.s], self.sigma_hat.len());
        let (gamma, epsilon) = (v[self.design.adaptation_gain], v[self.design.projection_tolerance]);
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            dx[self.omega_hat][k] = gamma * projection(v[self.omega_hat][k], s[i] * v[self.v][j], lo, hi, epsilon);
        }
        let within = |estimate: S, rate: S, bound: S| gamma * projection(estimate, rate, -bound, bound, epsilon);
        let theta_hat = v[self.theta_hat.elements()].chunks_exact(m);
        let columns = dx.slice(self.theta_hat).chunks_exact_mut(m).zip(theta_hat);
        for (column, ((rates, theta_hat), &phi)) in columns.zip(phi).enumerate() {
            let entries = rates.iter_mut().zip(theta_hat).zip(s.iter().zip(self.design.theta_bounds(column, v)));
            entries.for_each(|((rate, &theta), (&s, &bound))| *rate = within(theta, s * phi, bound));
        }
        for i in 0..m {
            dx[self.sigma_hat][i] = within(v[self.sigma_hat][i], s[i], v[self.design.sigma_bound][i]);
        }
        let Some(unmatched) = &self.unmatched else { return };
        for (i, &s) in s[m..].iter().enumerate() {
            let (theta, sigma) = (v[unmatched.theta_hat][i], v[unmatched.sigma_hat][i]);
            dx[unmatched.theta_hat][i] = within(theta, s * v[unmatched.norm], v[unmatched.theta_bound][i]);
            dx[unmatched.sigma_hat][i] = within(sigma, s, v[unmatched.sigma_bound][i]);
        }
    }

    /// f' = A_f f − B_f K (η̂ − K_g r) in each channel. K is before the filter, so that tuning it makes the control
    /// jump at most by the feedthrough of η̂_2.
    fn control_law<S: Scalar>(&self, K: DMatrixView<S>, v: &Values<S>, dx: &mut Rates<S>) {
        let (Filter { A_f, B_f, .. }, order) = (&self.filter, self.filter.order());
        for (i, states) in v[self.f].chunks_exact(order).enumerate() {
            let driven = -dot(K.row(i).iter(), &v[self.excess]);
            for k in 0..order {
                let own = A_f.row(k).iter().zip(states).fold(driven * B_f[k], |sum, (&a, &f)| sum + f * a);
                dx[self.f][i * order + k] = own;
            }
        }
        if let Some(unmatched) = &self.unmatched {
            unmatched.drive(&self.filter, self.f, v, dx);
        }
    }

    /// While not enabled: the adaptive control follows the manual one.
    fn follow<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        for (k, rate) in dx[self.f].iter_mut().enumerate() {
            let (i, rest) = (k / self.filter.order(), self.filter_at_rest[k % self.filter.order()]);
            let at_once = self.at_once(i, v, |unmatched, k| v[unmatched.eta_hat][k]);
            let u_ad = v[self.ports.u][i] / self.design.inertia(i, v) + v[self.feedback][i];
            *rate = -v[self.design.follow_rate] * (v[self.f][k] - (u_ad - at_once) * rest);
        }
    }
}
