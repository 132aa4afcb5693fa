//! The extension of an L1 law to unmatched uncertainty (thesis, section 3.4).
//!
//! x' = A_m x + B (ω v + …) + B_um (θ_2 ‖x‖∞ + σ_2). What enters along B_um is estimated in the same way; where it shows in
//! y, the control cancels it through H_m⁻¹(s) H_um(s), which the filter makes proper.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{DMatrix, DVector};

use super::dot;
use super::structure::PlantMatrices;
use crate::mathematics::filter::Filter;
use crate::mathematics::matched_equivalent::MatchedEquivalent;
use crate::system::{
    Declaration, Invalid, MatrixOf, Parameter, Point, Prepared, Rates, Scalar, ScalarOf, Signal, Signals, State,
    Values, VectorOf, matrix, scalar, vector,
};

/// Estimates along B_um, and how the control law answers to them.
#[derive(Debug)]
pub(super) struct Unmatched {
    pub theta_bound: VectorOf<Parameter>,
    pub sigma_bound: VectorOf<Parameter>,
    pub theta_hat: VectorOf<State>,
    pub sigma_hat: VectorOf<State>,
    pub eta_hat: VectorOf<Signal>,
    /// ‖x‖∞
    pub norm: ScalarOf<Signal>,
    pub cancellation: Cancellation,
    /// z' = A_z z + B_z η̂_2, where H_m has transmission zeros.
    pub z: Option<VectorOf<State>>,
}

/// D(s) K H_m⁻¹(s) H_um(s), as it shares the states of D(s).
#[derive(Debug)]
pub(in crate::controllers) struct Cancellation {
    /// Gain from K η_2 to the rates of the filter's states, in their order.
    pub input: MatrixOf<Prepared>,
    /// Feedthrough to u_ad, if the product with D(s) isn't strictly proper.
    pub direct: Option<MatrixOf<Prepared>>,
    /// The coefficients h_j of H_m⁻¹ H_um, as many as D(s) makes proper, and A_f^j B_f.
    polynomial: Vec<MatrixOf<Prepared>>,
    filter_inputs: Vec<DVector<f64>>,
    /// Feedthrough of the last of them to the output of D(s).
    filter_direct: f64,
    form: Form,
    pub zeros: Option<Zeros>,
}

/// Properties of H_m⁻¹ H_um that state feedback doesn't change: it moves no zero and raises no degree.
#[derive(Debug, Clone, Copy)]
pub(in crate::controllers) struct Form {
    /// The number of transmission zeros of H_m.
    pub zeros: usize,
    /// True if its product with D(s) isn't strictly proper; feedthrough of the highest power of s behind D(s).
    pub is_direct: bool,
    filter_direct: f64,
}

impl Form {
    /// The form of the nominal dynamics.
    ///
    /// # Errors
    /// [`Invalid`] when these aren't given, H_m can't be inverted, its inverse is unstable, or its product with D(s) improper.
    pub fn of_nominal(plant: &PlantMatrices, filter: &Filter) -> Result<Self, Invalid> {
        let Some(A) = &plant.A else {
            let reason =
                "A is missing: with unmatched uncertainty the number of states depends on the nominal dynamics";
            return Err(Invalid::because(reason));
        };
        let equivalent = MatchedEquivalent::new(("A", A), &plant.B, &plant.C, &plant.B_um)?;
        let filter_direct = equivalent.behind(filter)?.direct;
        Ok(Form { zeros: equivalent.A_z.nrows(), is_direct: filter_direct != 0.0, filter_direct })
    }

    /// H_m⁻¹(s) H_um(s) for dynamics that messages call by a name.
    ///
    /// # Errors
    /// [`Invalid`] when it isn't of this form.
    pub fn equivalent(
        &self,
        (name, A_m): (&str, &DMatrix<f64>),
        plant: &PlantMatrices,
        filter: &Filter,
    ) -> Result<MatchedEquivalent, Invalid> {
        let equivalent = MatchedEquivalent::new((name, A_m), &plant.B, &plant.C, &plant.B_um)?;
        let direct = equivalent.behind(filter)?.direct;
        let (order, declared) = (equivalent.A_z.nrows(), self.zeros);
        if order != declared || (direct != 0.0 && !self.is_direct) {
            let text = format!(
                "{name}: C (sI - {name})^-1 B has other zeros ({order}) than with the A of [structure] ({declared}), \
                 or a different relative degree: give {name} in [structure]"
            );
            return Err(Invalid::because(text));
        }
        Ok(equivalent)
    }
}

/// The part of H_m⁻¹ H_um whose poles are the transmission zeros of H_m: z' = A_z z + B_z η_2.
#[derive(Debug)]
pub(in crate::controllers) struct Zeros {
    pub A_z: MatrixOf<Prepared>,
    pub B_z: MatrixOf<Prepared>,
    C_z: MatrixOf<Prepared>,
    /// K C_z: what the filter takes in.
    pub KC_z: MatrixOf<Prepared>,
}

impl Unmatched {
    /// Declares the estimates of unmatched directions, if there are any.
    ///
    /// # Errors
    /// [`Invalid`] when H_m can't be inverted, its inverse is unstable, or its product with D(s) improper.
    pub fn declare(d: &mut Declaration, plant: &PlantMatrices, filter: &Filter) -> Result<Option<Self>, Invalid> {
        let k = plant.B_um.ncols();
        if k == 0 {
            return Ok(None);
        }
        let bound = "bound on the magnitude of";
        let theta_hat = "estimate of theta_2, the unmatched uncertainty's dependence on the state's norm";
        let theta_bound = d.parameter(vector("theta_bound_unmatched", k, &format!("{bound} theta_2")).min(0.0));
        let sigma_bound = d.parameter(vector("sigma_bound_unmatched", k, &format!("{bound} sigma_2")).min(0.0));
        let theta_hat = d.state(vector("theta_hat_unmatched", k, theta_hat).source("Hashim (3.61)"));
        let sigma_hat = d.state(
            vector("sigma_hat_unmatched", k, "estimate of the unmatched disturbance sigma_2").source("Hashim (3.61)"),
        );
        let eta_hat =
            d.local(vector("eta_hat_unmatched", k, "estimate of the unmatched uncertainty").source("Hashim (3.60)"));
        let norm = d.local(scalar("#norm of x", "").hidden());
        let cancellation = Cancellation::declare(d, plant, filter)?;
        let z = cancellation.order().map(|order| {
            d.state(
                vector("inverse_state", order, "state of H_m^-1 H_um, at the zeros of H_m")
                    .source("Hashim, section 3.4"),
            )
        });
        Ok(Some(Unmatched { theta_bound, sigma_bound, theta_hat, sigma_hat, eta_hat, norm, cancellation, z }))
    }

    /// η̂_2 = θ̂_2 ‖x‖∞ + σ̂_2.
    pub fn outputs<S: Scalar>(&self, norm: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.norm] = norm;
        for i in 0..self.eta_hat.len() {
            y[self.eta_hat][i] = self.estimate(i, norm, v);
        }
    }

    /// η̂_2 in a direction.
    pub fn estimate<S: Scalar>(&self, direction: usize, norm: S, v: &Values<S>) -> S {
        v[self.theta_hat][direction] * norm + v[self.sigma_hat][direction]
    }

    /// Feedthrough of η̂_2 to u_ad of a channel.
    pub fn at_once<S: Scalar>(&self, channel: usize, v: &Values<S>, eta_hat: impl Fn(usize) -> S) -> S {
        self.cancellation.direct.map_or(S::from(0.0), |direct| {
            let row = v.matrix(direct);
            (0..row.ncols()).fold(S::from(0.0), |sum, k| sum - row[(channel, k)] * eta_hat(k))
        })
    }

    /// Adds it to u_ad of all channels.
    pub fn add_at_once<S: Scalar>(&self, u_ad: VectorOf<Signal>, v: &Values<S>, y: &mut Signals<S>) {
        let Some(direct) = self.cancellation.direct else { return };
        for (i, row) in v.matrix(direct).row_iter().enumerate() {
            let at_once = row.iter().zip(&y[self.eta_hat]).fold(S::from(0.0), |sum, (&gain, &eta)| sum - gain * eta);
            y[u_ad][i] += at_once;
        }
    }

    /// Adds the effect of η̂_2 to the rates of the filter's states f.
    pub fn drive<S: Scalar>(&self, filter: &Filter, f: VectorOf<State>, v: &Values<S>, dx: &mut Rates<S>) {
        let (eta_hat, input) = (&v[self.eta_hat], v.matrix(self.cancellation.input));
        for (k, rate) in dx[f].iter_mut().enumerate() {
            *rate -= dot(input.row(k).iter(), eta_hat);
            if let (Some(z), Some(Zeros { KC_z, .. })) = (self.z, &self.cancellation.zeros) {
                let (channel, place) = (k / filter.order(), k % filter.order());
                *rate -= dot(v.matrix(*KC_z).row(channel).iter(), &v[z]) * filter.B_f[place];
            }
        }
    }

    /// z' = A_z z + B_z η̂_2.
    pub fn derivatives<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        let (Some(z), Some(Zeros { A_z, B_z, .. })) = (self.z, &self.cancellation.zeros) else { return };
        let (A_z, B_z) = (v.matrix(*A_z), v.matrix(*B_z));
        for i in 0..z.len() {
            dx[z][i] = dot(A_z.row(i).iter(), &v[z]) + dot(B_z.row(i).iter(), &v[self.eta_hat]);
        }
    }
}

impl Cancellation {
    /// Declares the cancellation for a plant with an unmatched direction.
    ///
    /// # Errors
    /// [`Invalid`] when H_m can't be inverted, its inverse is unstable, or its product with D(s) improper.
    pub fn declare(d: &mut Declaration, plant: &PlantMatrices, filter: &Filter) -> Result<Self, Invalid> {
        let (m, k) = (plant.B.ncols(), plant.B_um.ncols());
        let form = Form::of_nominal(plant, filter)?;
        let order = form.zeros;
        let relative_degree = filter.relative_degree();
        let hidden = |name: &str, rows, columns| matrix(name, rows, columns, "").hidden();
        Ok(Cancellation {
            input: d.prepared(hidden("#D H_m^-1 H_um: input", m * filter.order(), k)),
            direct: form.is_direct.then(|| d.prepared(hidden("#D H_m^-1 H_um: direct", m, k))),
            polynomial: (0..=relative_degree)
                .map(|power| d.prepared(hidden(&format!("#H_m^-1 H_um: s^{power}"), m, k)))
                .collect(),
            filter_inputs: filter.inputs(relative_degree),
            filter_direct: form.filter_direct,
            form,
            zeros: (order > 0).then(|| Zeros {
                A_z: d.prepared(hidden("#A_z", order, order)),
                B_z: d.prepared(hidden("#B_z", order, k)),
                C_z: d.prepared(hidden("#C_z", m, order)),
                KC_z: d.prepared(hidden("#K C_z", m, order)),
            }),
        })
    }

    /// The number of transmission zeros of H_m, where it has any.
    pub fn order(&self) -> Option<usize> {
        self.zeros.as_ref().map(|zeros| zeros.A_z.shape().0)
    }

    /// H_m⁻¹(s) H_um(s) for the desired dynamics, which messages call by a name.
    ///
    /// # Errors
    /// [`Invalid`] when it isn't of the form that was declared.
    pub fn prepare(
        &self,
        A_m: (&str, &DMatrix<f64>),
        plant: &PlantMatrices,
        filter: &Filter,
        v: &mut Point,
    ) -> Result<(), Invalid> {
        let equivalent = self.form.equivalent(A_m, plant, filter)?;
        for (power, &coefficient) in self.polynomial.iter().enumerate() {
            match equivalent.polynomial.get(power) {
                Some(known) => v.matrix_mut(coefficient).copy_from(known),
                None => v[coefficient.elements()].fill(0.0),
            }
        }
        if let Some(Zeros { A_z, B_z, C_z, .. }) = &self.zeros {
            v.matrix_mut(*A_z).copy_from(&equivalent.A_z);
            v.matrix_mut(*B_z).copy_from(&equivalent.B_z);
            v.matrix_mut(*C_z).copy_from(&equivalent.C_z);
        }
        Ok(())
    }

    /// D(s) K H_m⁻¹(s) H_um(s).
    pub fn relate<S: Scalar>(&self, K: MatrixOf<Parameter>, v: &mut Point<S>) {
        let (rows, columns) = self.input.shape();
        let order = self.filter_inputs[0].len();
        for (row, k) in (0..rows).flat_map(|row| (0..columns).map(move |k| (row, k))) {
            let parts = self.polynomial.iter().zip(&self.filter_inputs);
            v[self.input.at(row, k)] = parts.fold(S::from(0.0), |sum, (&coefficient, input)| {
                sum + product(K, coefficient, (row / order, k), v) * input[row % order]
            });
        }
        if let (Some(direct), Some(&highest)) = (self.direct, self.polynomial.last()) {
            set_product(direct, K, highest, self.filter_direct, v);
        }
        if let Some(Zeros { C_z, KC_z, .. }) = &self.zeros {
            set_product(*KC_z, K, *C_z, 1.0, v);
        }
    }
}

/// An element of K M.
fn product<S: Scalar>(K: MatrixOf<Parameter>, M: MatrixOf<Prepared>, (row, column): (usize, usize), v: &Point<S>) -> S {
    (0..M.shape().0).fold(S::from(0.0), |sum, j| sum + v[K.at(row, j)] * v[M.at(j, column)])
}

/// Writes K M, times a factor.
fn set_product<S: Scalar>(
    to: MatrixOf<Prepared>,
    K: MatrixOf<Parameter>,
    M: MatrixOf<Prepared>,
    factor: f64,
    v: &mut Point<S>,
) {
    let (rows, columns) = to.shape();
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        v[to.at(i, j)] = product(K, M, (i, j), v) * factor;
    }
}
