//! The closed-form step of an L1 controller.
//!
//! The estimates may oscillate so fast that a general integrator needs many steps in a communication step. But with
//! the regressor φ, the control v_0 and the gain ω̂ of the stride's beginning, what couples them is linear: x̃ = x̂ − x,
//! a = ω̂ v_0 + θ̂ φ + σ̂ (one number a channel, in which the estimates act together; θ̂_2 ‖x‖∞ + σ̂_2 for an unmatched
//! direction), the states f of the filter and z of H_m⁻¹ H_um, time and a constant. One matrix exponential solves it, and
//! the increment of a is shared out to the estimates in proportion to what each of them multiplies. Projection isn't
//! linear: where it may act, a general method takes the step.

mod limits;

use nalgebra::DMatrixView;

use super::estimates::Estimate;
use super::law::Law;
use super::unmatched::Zeros;
use super::{Baseline, Regressor, largest};
use crate::mathematics::{exponential, projection};
use crate::system::{Class, ErrorEstimate, Handle, MatrixOf, Point, Section, State, Stride, Values, VectorOf};

/// The relative tolerance for which `closed_form_phase` is given, and the order of the general method: its steps grow
/// with this root of the tolerance.
const USUAL_TOLERANCE: f64 = 1e-6;
const GENERAL_ORDER: f64 = 5.0;

/// Places where the parts of the linear system's state (x̃, a, f, z, t, 1) begin.
#[derive(Debug, Clone, Copy)]
struct Places {
    a: usize,
    f: usize,
    z: usize,
    time: usize,
    one: usize,
    order: usize,
}

/// The linear system, and what is needed to fill it.
struct Linear<'a> {
    l1: &'a Law,
    /// The reference, and its rates where it moves within a stride.
    r: &'a [f64],
    r_rates: &'a [f64],
    K: DMatrixView<'a, f64>,
    v: Values<'a, f64>,
    slopes: &'a [f64],
    at: Places,
    /// The matrix, by columns.
    matrix: &'a mut [f64],
    /// η̂ as rows over the state, one a channel.
    eta: &'a mut [f64],
}

/// The workspace, divided.
struct Space<'a> {
    matrix: &'a mut [f64],
    eta: &'a mut [f64],
    exponential: &'a mut [f64],
    /// The linear system's state at the stride's beginning, its end, and after twice its length.
    solution: [&'a mut [f64]; 3],
    states: &'a mut [f64],
}

impl Law {
    fn places(&self) -> Places {
        let (n, channels) = self.directions.shape();
        let z = n + channels + self.f.len();
        let time = z + self.z().map_or(0, VectorOf::len);
        Places { a: n, f: n + channels, z, time, one: time + 1, order: time + 2 }
    }

    /// The state of H_m⁻¹ H_um, where it has one.
    fn z(&self) -> Option<VectorOf<State>> {
        self.unmatched.as_ref().and_then(|unmatched| unmatched.z)
    }

    /// All states, a handle a kind.
    fn all_states(&self) -> impl Iterator<Item = VectorOf<State>> {
        let unmatched = self.unmatched.iter().flat_map(|unmatched| [unmatched.theta_hat, unmatched.sigma_hat]);
        let matched = [self.x_hat, self.omega_hat, self.theta_hat.elements(), self.sigma_hat, self.f];
        matched.into_iter().chain(unmatched).chain(self.z())
    }

    /// Number of continuous states.
    fn states(&self) -> usize {
        self.all_states().map(VectorOf::len).sum()
    }

    fn space_sizes(&self) -> [usize; 7] {
        let (order, channels) = (self.places().order, self.channels());
        [order * order, channels * order, exponential::workspace(order), order, order, order, self.states()]
    }

    /// Size of the workspace.
    pub(in crate::controllers) fn closed_form_workspace(&self) -> usize {
        self.space_sizes().iter().sum()
    }

    fn divide<'a>(&self, workspace: &'a mut [f64]) -> Space<'a> {
        let mut rest = workspace;
        let [matrix, eta, exponential, start, end, whole, states] = self.space_sizes().map(|size| {
            let (part, others) = std::mem::take(&mut rest).split_at_mut(size);
            rest = others;
            part
        });
        Space { matrix, eta, exponential, solution: [start, end, whole], states }
    }

    /// Advances the states by one stride, and computes the end of a stride of twice its length. False if an estimate
    /// may reach the layer at its bounds on the way, because the linear system has no projection.
    ///
    /// A reference that is no input is constant over the stride, and so is K.
    pub(in crate::controllers) fn closed_form<R: Class, G: Class>(
        &self,
        r: VectorOf<R>,
        K: MatrixOf<G>,
        stride: Stride,
        v: &mut Point,
    ) -> bool {
        let Space { matrix, eta, exponential, solution: [start, end, whole], states } = self.divide(stride.workspace);
        let at = self.places();
        let values = v.values();
        let r_rates = if R::SECTION == Section::Input { &stride.slopes[r.span().range()] } else { &[] };
        let (r, K) = (&values[r], values.matrix(K));
        Linear { l1: self, r, r_rates, K, v: values, slopes: stride.slopes, at, matrix, eta: &mut *eta }.fill();
        self.linear_state(&values, at, start);
        apply(matrix, start, end);
        apply(matrix, end, whole);
        let (rates, second_rates) = (&end[at.a..at.f], &whole[at.a..at.f]);
        // What η̂ was written down in has done its part.
        let (amplitudes, rest) = eta.split_at_mut(self.channels());
        let excitations = &mut rest[..amplitudes.len()];
        excitations.iter_mut().enumerate().for_each(|(i, excitation)| *excitation = self.excitation(&values, i));
        self.amplitudes(&values, excitations, [rates, second_rates], amplitudes);
        matrix.iter_mut().for_each(|entry| *entry *= stride.length);
        exponential::exponential(at.order, matrix, exponential);
        apply(matrix, start, end);
        apply(matrix, end, whole);
        let of_a = at.a..at.f;
        if self.may_be_projected(
            &values,
            excitations,
            amplitudes,
            [&start[of_a.clone()], &end[of_a.clone()], &whole[of_a]],
        ) {
            return false;
        }
        self.arrive(&values, excitations, [start, whole], stride.slopes, 2.0 * stride.length, stride.whole);
        self.arrive(&values, excitations, [start, end], stride.slopes, stride.length, states);
        for handle in self.all_states() {
            v.set(handle, &states[handle.span().range()]);
        }
        true
    }

    /// Bound on the swing of a about its present value, from its rates of first and second order.
    fn amplitudes(&self, v: &Values<f64>, excitations: &[f64], rates: [&[f64]; 2], amplitudes: &mut [f64]) {
        let [rates, second_rates] = rates;
        let PB = v.matrix(self.design.PB);
        for (i, amplitude) in amplitudes.iter_mut().enumerate() {
            let stiffness: f64 = PB.column(i).iter().zip(self.directions.column(i).iter()).map(|(p, b)| p * b).sum();
            let square = v[self.design.adaptation_gain] * excitations[i] * stiffness;
            // Frozen estimates leave nothing that swings.
            let swings = |rate: f64, second: f64| 2.0 * (rate / square.sqrt()).hypot(second / square);
            *amplitude = if square > 0.0 { swings(rates[i], second_rates[i]) } else { 0.0 };
        }
    }

    /// True if an estimate may reach the layer in which projection acts, if a goes through these values.
    fn may_be_projected(
        &self,
        v: &Values<f64>,
        excitations: &[f64],
        amplitudes: &[f64],
        [start, end, whole]: [&[f64]; 3],
    ) -> bool {
        let epsilon = v[self.design.projection_tolerance];
        (0..self.estimates()).any(|k| {
            let estimate = self.estimate(k, v);
            let Estimate { place, bounds: (lo, hi), channel: i, factor } = estimate;
            let (gone, further) = (end[i] - start[i], whole[i] - start[i]);
            let [down, up] = [gone.min(further).min(0.0) - amplitudes[i], gone.max(further).max(0.0) + amplitudes[i]];
            let in_layer = |by: f64| projection::is_in_layer(v[place] + factor / excitations[i] * by, lo, hi, epsilon);
            !estimate.is_frozen() && (in_layer(down) || in_layer(up))
        })
    }

    /// (x̃, a, f, z, t, 1) at the stride's beginning.
    fn linear_state(&self, v: &Values<f64>, at: Places, state: &mut [f64]) {
        for (x_tilde, (x_hat, x)) in state.iter_mut().zip(v[self.x_hat].iter().zip(self.state(v))) {
            *x_tilde = x_hat - x;
        }
        for (i, a) in state[at.a..at.f].iter_mut().enumerate() {
            let known = self.baseline == Baseline::Inside && i < self.feedback.len();
            *a = self.uncertainty_of(i, v) - if known { v[self.feedback][i] } else { 0.0 };
        }
        state[at.f..at.z].copy_from_slice(&v[self.f]);
        if let Some(z) = self.z() {
            state[at.z..at.time].copy_from_slice(&v[z]);
        }
        (state[at.time], state[at.one]) = (0.0, 1.0);
    }

    /// The controller's states where the linear system has gone from one state to another in time h.
    fn arrive(
        &self,
        v: &Values<f64>,
        excitations: &[f64],
        [start, end]: [&[f64]; 2],
        slopes: &[f64],
        h: f64,
        states: &mut [f64],
    ) {
        let (at, slope) = (self.places(), &slopes[self.ports.x.span().range()]);
        for (k, x_hat) in states[self.x_hat.span().range()].iter_mut().enumerate() {
            *x_hat = self.x(k, v) + slope[k] * h + end[k];
        }
        states[self.f.span().range()].copy_from_slice(&end[at.f..at.z]);
        if let Some(z) = self.z() {
            states[z.span().range()].copy_from_slice(&end[at.z..at.time]);
        }
        for k in 0..self.estimates() {
            let estimate = self.estimate(k, v);
            let Estimate { place, channel, factor, .. } = estimate;
            let moved = || factor * (end[at.a + channel] - start[at.a + channel]) / excitations[channel];
            states[place.span().start] = v[place] + if estimate.is_frozen() { 0.0 } else { moved() };
        }
    }

    /// N: the sum of squares of what the estimates of a channel are multiplied by, of those that may move.
    fn excitation(&self, v: &Values<f64>, channel: usize) -> f64 {
        let estimates = (0..self.estimates()).map(|k| self.estimate(k, v));
        estimates.filter(|e| e.channel == channel && !e.is_frozen()).map(|e| e.factor * e.factor).sum()
    }

    /// True if the closed form is worth its while: not while an estimate is at a bound, nor where a general method needs
    /// few steps. That takes the more of them the tighter the tolerance is.
    pub(in crate::controllers) fn closed_form_pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        let Some(closed_form) = self.design.closed_form else { return false };
        let phase = v[self.adaptation_frequency] * h;
        let least = v[closed_form.phase] * (relative_tolerance / USUAL_TOLERANCE).powf(1.0 / GENERAL_ORDER);
        self.in_command.is_active(v) && phase >= least && self.projections(v) == 0.0
    }

    /// Compares all states, as a general method does, and η̂ and u_ad, within the tighter of the two tolerances. The states
    /// are extrapolated to strides of no length.
    pub(in crate::controllers) fn conclude(
        &self,
        whole: &Values<f64>,
        (nominals, relative_tolerance): (&[f64], f64),
        v: &mut Point,
    ) -> ErrorEstimate {
        let halves = &v.values();
        let u_ad = nominals[self.f.span().start];
        let mut worst = 0.0;
        let mut compare = |whole: f64, halves: f64, magnitude: f64| {
            let differs = (whole - halves).abs();
            let error = if differs == 0.0 { 0.0 } else { differs / magnitude.max(whole.abs()).max(halves.abs()) };
            // Not a number, once it is.
            worst = if error > worst || error.is_nan() { error } else { worst };
        };
        for handle in self.all_states() {
            let pairs = whole[handle].iter().zip(&halves[handle]).zip(&nominals[handle.span().range()]);
            pairs.for_each(|((&whole, &halves), &nominal)| compare(whole, halves, nominal));
        }
        for i in 0..self.u_ad.len() {
            compare(whole[self.u_ad][i], halves[self.u_ad][i], u_ad);
        }
        for i in 0..self.channels() {
            // η̂ passes through zero although its terms don't.
            let magnitude = u_ad.max(self.magnitude(i, halves));
            compare(self.uncertainty_of(i, whole), self.uncertainty_of(i, halves), magnitude);
        }
        let closed_form = self.design.closed_form;
        let own = closed_form.map_or(relative_tolerance, |closed_form| halves[closed_form.tolerance]);
        let scaled = worst / own.min(relative_tolerance);
        self.extrapolate(whole, v);
        ErrorEstimate { scaled, order: 2 }
    }

    /// Extrapolates to strides of length zero: the error of a stride is proportional to its length.
    fn extrapolate(&self, whole: &Values<f64>, v: &mut Point) {
        for handle in self.all_states() {
            v[handle].iter_mut().zip(&whole[handle]).for_each(|(halves, whole)| *halves += *halves - whole);
        }
        self.bring_within_bounds(v);
    }
}

/// y = M x
fn apply(matrix: &[f64], x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (column, &x) in matrix.chunks_exact(y.len()).zip(x) {
        y.iter_mut().zip(column).for_each(|(y, entry)| *y += entry * x);
    }
}

impl Linear<'_> {
    fn entry(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.matrix[row + column * self.at.order]
    }

    /// Rate of K_m x in a channel.
    fn feedback_rate(&self, channel: usize) -> f64 {
        let rates = &self.slopes[self.l1.ports.x.span().range()];
        let K_m = self.l1.design.K_m(&self.v);
        K_m.map_or(0.0, |K_m| K_m.row(channel).iter().zip(rates).map(|(k, rate)| k * rate).sum())
    }

    fn fill(mut self) {
        self.matrix.fill(0.0);
        self.eta.fill(0.0);
        *self.entry(self.at.time, self.at.one) = 1.0;
        self.prediction_error();
        self.unmatched_uncertainty();
        self.uncertainty();
        self.predictor();
        self.adaptation();
        self.control_law();
        self.tracking();
        self.unmatched_control();
    }

    /// The row of a channel's η̂ over the state.
    fn row(&mut self, channel: usize) -> &mut [f64] {
        &mut self.eta[channel * self.at.order..][..self.at.order]
    }

    /// η̂_2 = a_2 + θ̂_2 (‖x‖∞ − ‖x_0‖∞).
    fn unmatched_uncertainty(&mut self) {
        let Some(unmatched) = &self.l1.unmatched else { return };
        let (m, at) = (self.l1.eta_hat.len(), self.at);
        let norm_rate = norm_rate(self.l1, &self.v, self.slopes);
        for i in 0..unmatched.eta_hat.len() {
            let theta = self.v[unmatched.theta_hat][i];
            let row = self.row(m + i);
            (row[at.a + m + i], row[at.time]) = (1.0, theta * norm_rate);
        }
    }

    /// x̃' = A_m x̃ + (A_m x − x') …
    fn prediction_error(&mut self) {
        let (l1, v) = (self.l1, self.v);
        let (A_m, n) = (l1.design.A_m(&v), l1.x_hat.len());
        let rates = &self.slopes[l1.ports.x.span().range()];
        for i in 0..n {
            for j in 0..n {
                *self.entry(i, j) = A_m[(i, j)];
            }
            let along_state = A_m.row(i).iter().zip(l1.state(&v)).map(|(a, x)| a * x).sum::<f64>();
            let along_rates = A_m.row(i).iter().zip(rates).map(|(a, x)| a * x).sum::<f64>();
            *self.entry(i, self.at.one) = along_state - rates[i];
            *self.entry(i, self.at.time) = along_rates;
        }
    }

    /// η̂ = a + ω̂ (v − v_0) + θ̂ (φ − φ_0) + K_m x, the last for a baseline inside.
    fn uncertainty(&mut self) {
        let (l1, at) = (self.l1, self.at);
        for i in 0..l1.eta_hat.len() {
            let feedback_rate = self.feedback_rate(i);
            let feedback = self.v[l1.feedback][i];
            let rate = regressor_rate(l1, &self.v, self.slopes, i);
            let eta = self.row(i);
            (eta[at.a + i], eta[at.time]) = (1.0, rate);
            if l1.baseline == Baseline::Inside {
                eta[at.one] = feedback;
                eta[at.time] += feedback_rate;
            }
        }
        for (k, &(i, j)) in l1.omega_entries.iter().enumerate() {
            self.add_control_change(self.v[l1.omega_hat][k], i, j);
        }
    }

    /// Feedthrough of η̂_2 to u_ad of channel j, times ω̂, in η̂ of channel i.
    fn add_at_once(&mut self, omega: f64, i: usize, j: usize) {
        let Some(direct) = self.l1.unmatched.as_ref().and_then(|unmatched| unmatched.cancellation.direct) else {
            return;
        };
        let (gains, m, order) = (self.v.matrix(direct), self.l1.eta_hat.len(), self.at.order);
        for (k, gain) in gains.row(j).iter().enumerate() {
            let (matched, unmatched) = self.eta.split_at_mut(m * order);
            let of_direction = &unmatched[k * order..][..order];
            matched[i * order..][..order].iter_mut().zip(of_direction).for_each(|(eta, e)| *eta -= omega * gain * e);
        }
    }

    /// x̃' = … + B η̂
    fn predictor(&mut self) {
        let B = &self.l1.directions;
        for column in 0..self.at.order {
            for j in 0..B.ncols() {
                let eta = self.eta[j * self.at.order + column];
                if eta != 0.0 {
                    (0..B.nrows()).for_each(|i| *self.entry(i, column) += B[(i, j)] * eta);
                }
            }
        }
    }

    /// a' = −Γ N Bᵀ P x̃
    fn adaptation(&mut self) {
        let l1 = self.l1;
        let (PB, gamma) = (self.v.matrix(l1.design.PB), self.v[l1.design.adaptation_gain]);
        for i in 0..l1.channels() {
            let gain = gamma * l1.excitation(&self.v, i);
            for k in 0..l1.x_hat.len() {
                *self.entry(self.at.a + i, k) = -gain * PB[(k, i)];
            }
        }
    }

    /// f' = A_f f − B_f K (η̂ − K_g r)
    fn control_law(&mut self) {
        let (l1, v) = (self.l1, self.v);
        let (K, K_g, r) = (self.K, v.matrix(l1.design.K_g), self.r);
        let (rates, order) = (self.r_rates, l1.filter.order());
        for i in 0..l1.u_ad.len() {
            for k in 0..order {
                let row = self.at.f + i * order + k;
                let input = l1.filter.B_f[k];
                for l in 0..order {
                    *self.entry(row, self.at.f + i * order + l) += l1.filter.A_f[(k, l)];
                }
                for j in (0..l1.u_ad.len()).filter(|_| input != 0.0) {
                    let gain = input * K[(i, j)];
                    for column in 0..self.at.order {
                        let eta = self.eta[j * self.at.order + column];
                        *self.entry(row, column) -= gain * eta;
                    }
                    let along_r = K_g.row(j).iter().zip(l1.references(r, &v)).map(|(k, r)| k * r).sum::<f64>();
                    let along_rates = K_g.row(j).iter().zip(rates).map(|(k, r)| k * r).sum::<f64>();
                    *self.entry(row, self.at.one) += gain * along_r;
                    *self.entry(row, self.at.time) += gain * along_rates;
                }
            }
        }
    }

    /// f' = … − K D(s) H_m⁻¹ H_um η̂_2; z' = A_z z + B_z η̂_2.
    fn unmatched_control(&mut self) {
        let Some(unmatched) = &self.l1.unmatched else { return };
        let (v, at, m) = (self.v, self.at, self.l1.eta_hat.len());
        self.add_rows(at.f, &v.matrix(unmatched.cancellation.input), -1.0, m);
        let Some(Zeros { A_z, B_z, KC_z, .. }) = &unmatched.cancellation.zeros else { return };
        let (A_z, B_z, KC_z) = (v.matrix(*A_z), v.matrix(*B_z), v.matrix(*KC_z));
        self.add_rows(at.z, &B_z, 1.0, m);
        for j in 0..A_z.ncols() {
            for i in 0..A_z.nrows() {
                *self.entry(at.z + i, at.z + j) += A_z[(i, j)];
            }
            let filter = &self.l1.filter;
            for k in 0..at.z - at.f {
                *self.entry(at.f + k, at.z + j) -= filter.B_f[k % filter.order()] * KC_z[(k / filter.order(), j)];
            }
        }
    }

    /// Adds `sign` · gains · η̂ of the channels from `first` on to the rates from a place on.
    fn add_rows(&mut self, place: usize, gains: &DMatrixView<f64>, sign: f64, first: usize) {
        for (k, column) in gains.column_iter().enumerate() {
            for of in 0..self.at.order {
                let eta = sign * self.eta[(first + k) * self.at.order + of];
                for (i, gain) in column.iter().enumerate().filter(|_| eta != 0.0) {
                    *self.entry(place + i, of) += gain * eta;
                }
            }
        }
    }
}

/// Rate of θ̂ φ(x) in a channel, as x moves.
fn regressor_rate(l1: &Law, v: &Values<f64>, slopes: &[f64], channel: usize) -> f64 {
    let (theta_hat, rates) = (v.matrix(l1.theta_hat), &slopes[l1.ports.x.span().range()]);
    match l1.regressor {
        Regressor::State => {
            let row = theta_hat.row(channel);
            let scaled =
                rates.iter().enumerate().map(|(j, &rate)| l1.regressor_gain(j).map_or(rate, |gain| rate * gain));
            row.iter().zip(scaled).map(|(theta, rate)| theta * rate).sum()
        }
        Regressor::InfinityNorm => theta_hat[(channel, 0)] * norm_rate(l1, v, slopes),
    }
}

/// Rate of ‖x‖∞, as x moves.
fn norm_rate(l1: &Law, v: &Values<f64>, slopes: &[f64]) -> f64 {
    let (k, x) = largest(l1.state(v));
    slopes[l1.ports.x.span().range()][k] * x.signum()
}
