//! The filter of a sampled L1 law: D(s) K in a closed loop with the nominal input gain, and behind it, if unmatched
//! uncertainty is cancelled, D(s) K H_m⁻¹(s) H_um(s); discretised with a zero-order hold.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{DMatrix, DVector};

use super::L1Sampled;
use super::design::hold;
use super::sample::product;
use crate::controllers::l1::{Form, L1Structure, PlantMatrices};
use crate::mathematics::balanced::least_norm;
use crate::mathematics::filter::Filter;
use crate::mathematics::matched_equivalent::MatchedEquivalent;
use crate::report::at_most;
use crate::system::{
    Declaration, Discrete, Invalid, MatrixOf, Number, Parameter, Point, Prepared, Scalar, Values, VectorOf, diagonal,
    matrix, vector,
};

/// Most motion of the filter in a sample time, as the norm of its matrix times T.
const MOST_MOTION: f64 = 1e5;

/// Realisation of the filter.
#[derive(Debug)]
pub(super) enum SampledFilter {
    /// D(s) = 1/s; ζ is its state.
    Integrator {
        /// A feedback gain a channel.
        K: VectorOf<Parameter>,
        /// e^(−k T) of each: what a sample leaves of ζ.
        left: VectorOf<Prepared>,
    },
    /// Any other, or with what cancels unmatched uncertainty.
    General(Box<General>),
}

/// q⁺ = F q + G (K_g r − W_0 σ̂_1, σ̂_2), ζ = C q − D_2 σ̂_2.
#[derive(Debug)]
pub(super) struct General {
    pub K: MatrixOf<Parameter>,
    filter: Filter,
    /// The filter's state at rest, for an output of 1.
    at_rest: DVector<f64>,
    form: Option<Form>,
    F: MatrixOf<Prepared>,
    G: MatrixOf<Prepared>,
    /// D_2, if σ̂_2 has feedthrough to ζ.
    direct: Option<MatrixOf<Prepared>>,
    /// States of D(s), channel by channel; then those of H_m⁻¹ H_um.
    q: VectorOf<Discrete>,
    next: VectorOf<Discrete>,
}

/// q' = A q + B (K_g r − W_0 σ̂_1, σ̂_2), ζ = C q − D_2 σ̂_2, the loop through ζ closed.
#[derive(Debug)]
pub(super) struct Continuous {
    pub A: DMatrix<f64>,
    pub B: DMatrix<f64>,
    pub direct: DMatrix<f64>,
    /// Number of states of D(s) of all channels.
    channels: usize,
}

impl SampledFilter {
    /// # Errors
    /// Why there is no such filter.
    pub fn declare(d: &mut Declaration, structure: &L1Structure, plant: &PlantMatrices) -> Result<Self, Invalid> {
        let (filter, m) = (structure.filter()?, plant.B.ncols());
        let text = "feedback gain of the filter: the bandwidth with which uncertainty is cancelled";
        if filter.is_integrator() && plant.B_um.ncols() == 0 {
            let K = d.parameter(diagonal("feedback_gain", m, text).unit("1/s").start(1.0).positive());
            let left = d.prepared(vector("#left of zeta", m, "").hidden());
            return Ok(SampledFilter::Integrator { K, left });
        }
        General::declare(d, filter, plant).map(|general| SampledFilter::General(Box::new(general)))
    }

    /// e^(−k T), which changes with the feedback gains.
    pub fn relate<S: Scalar>(&self, law: &L1Sampled, v: &mut Point<S>) {
        let SampledFilter::Integrator { K, left } = self else { return };
        for i in 0..K.len() {
            v[*left][i] = (-v[*K][i] * v[law.sample_time]).exp();
        }
    }

    /// Number of its states.
    pub fn order(&self) -> usize {
        match self {
            SampledFilter::Integrator { K, .. } => K.len(),
            SampledFilter::General(general) => general.q.len(),
        }
    }
}

impl Continuous {
    /// The states of D(s) of all channels only, or those of H_m⁻¹ H_um, which nothing of these drives.
    fn part(&self, first: usize, len: usize) -> DMatrix<f64> {
        self.A.view((first, first), (len, len)).into_owned()
    }

    pub fn of_channels(&self) -> DMatrix<f64> {
        self.part(0, self.channels)
    }

    pub fn of_zeros(&self) -> DMatrix<f64> {
        self.part(self.channels, self.A.nrows() - self.channels)
    }
}

impl General {
    fn declare(d: &mut Declaration, filter: Filter, plant: &PlantMatrices) -> Result<Self, Invalid> {
        let (m, k) = (plant.B.ncols(), plant.B_um.ncols());
        let form = if k > 0 { Some(Form::of_nominal(plant, &filter)?) } else { None };
        let order = m * filter.order() + form.map_or(0, |form| form.zeros);
        let text = "feedback gain K of the filter K D(s), for what the nominal input gain makes of the control";
        Ok(General {
            K: d.parameter(matrix("feedback_gain", m, m, text).unit("1/s").identity()),
            F: d.prepared(matrix("#F", order, order, "").hidden()),
            G: d.prepared(matrix("#G", order, m + k, "").hidden()),
            direct: form
                .is_some_and(|form| form.is_direct)
                .then(|| d.prepared(matrix("#D H_m^-1 H_um: direct", m, k, "").hidden())),
            q: d.discrete(vector("#q", order, "").hidden()),
            next: d.discrete(vector("#next q", order, "").hidden()),
            at_rest: filter.at_rest(),
            filter,
            form,
        })
    }

    /// Number of states of D(s) of all channels.
    fn of_channels(&self) -> usize {
        self.K.shape().0 * self.filter.order()
    }

    /// The filter in continuous time, where the state moves by these dynamics, which messages call by a name.
    ///
    /// # Errors
    /// [`Invalid`] where H_m⁻¹ H_um isn't of the form that was declared.
    pub fn continuous(
        &self,
        dynamics: (&str, &DMatrix<f64>),
        plant: &PlantMatrices,
        v: &Values<f64>,
    ) -> Result<Continuous, Invalid> {
        let (m, k, order) = (plant.B.ncols(), plant.B_um.ncols(), self.filter.order());
        let K = v.matrix(self.K).into_owned();
        let equivalent = self.form.map(|form| form.equivalent(dynamics, plant, &self.filter)).transpose()?;
        let (channels, all) = (self.of_channels(), self.q.len());
        let (mut A, mut B) = (DMatrix::zeros(all, all), DMatrix::zeros(all, m + k));
        let mut direct = DMatrix::zeros(m, k);
        let by_channel = |gain: &DMatrix<f64>, input: &DVector<f64>| gain.kronecker(input);
        for i in 0..m {
            A.view_mut((i * order, i * order), (order, order)).copy_from(&self.filter.A_f);
        }
        // f' = A_D f − B_D K (ζ + …) with ζ = C_D f − D_2 σ_2
        let into = by_channel(&K, &self.filter.B_f);
        let output = DMatrix::<f64>::identity(m, m).kronecker(&self.filter.C_f);
        let closed = A.view((0, 0), (channels, channels)) - &into * output;
        A.view_mut((0, 0), (channels, channels)).copy_from(&closed);
        B.view_mut((0, 0), (channels, m)).copy_from(&into);
        if let Some(MatchedEquivalent { polynomial, A_z, B_z, C_z }) = &equivalent {
            let inputs = self.filter.inputs(polynomial.len());
            let mut cancelled = DMatrix::zeros(channels, k);
            for (coefficient, input) in polynomial.iter().zip(&inputs) {
                cancelled += by_channel(&(&K * coefficient), input);
            }
            if let (Some(_), Some(highest)) = (self.direct, polynomial.get(self.filter.relative_degree())) {
                direct = &K * highest * (&self.filter.C_f * &inputs[polynomial.len() - 2])[0];
            }
            B.view_mut((0, m), (channels, k)).copy_from(&(&into * &direct - cancelled));
            if !A_z.is_empty() {
                let zeros = A_z.nrows();
                A.view_mut((0, channels), (channels, zeros)).copy_from(&(-&into * C_z));
                A.view_mut((channels, channels), (zeros, zeros)).copy_from(A_z);
                B.view_mut((channels, m), (zeros, k)).copy_from(B_z);
            }
        }
        Ok(Continuous { A, B, direct, channels })
    }

    /// Over the sample time.
    ///
    /// # Errors
    /// [`Invalid`] where it can't be sampled.
    pub fn prepare(&self, law: &L1Sampled, dynamics: (&str, &DMatrix<f64>), v: &mut Point) -> Result<(), Invalid> {
        let T = v[law.sample_time];
        let Continuous { A, B, direct, .. } = self.continuous(dynamics, &law.plant, &v.values())?;
        let motion = least_norm(&A) * T;
        if motion.is_nan() || motion > MOST_MOTION {
            let allowed = format!(
                "must be at most {}: the filter D(s) with {} moves too far within it",
                at_most(MOST_MOTION / (motion / T)),
                v.name(self.K)
            );
            return Err(Invalid::new(v.name(law.sample_time), Number(T), allowed));
        }
        let (F, G) = hold(&A, &B, T);
        if !(F.norm_squared() + G.norm_squared()).is_finite() {
            let (row, column) = v.matrix(self.K).iamax_full();
            let largest = self.K.at(row, column);
            let text = format!(
                "must be smaller in magnitude: the loop of the filter D(s) with it is unstable, and grows beyond all numbers \
                 within {} s",
                Number(T)
            );
            return Err(Invalid::new(v.name(largest), Number(v[largest]), text));
        }
        v.matrix_mut(self.F).copy_from(&F);
        v.matrix_mut(self.G).copy_from(&G);
        if let Some(handle) = self.direct {
            v.matrix_mut(handle).copy_from(&direct);
        }
        Ok(())
    }

    /// Matrices of a sample: F, G and C, D_2.
    pub fn matrices(&self, v: &Values<f64>) -> [DMatrix<f64>; 4] {
        let (m, columns) = (self.K.shape().0, self.G.shape().1);
        let mut C = DMatrix::zeros(m, self.q.len());
        let output = DMatrix::<f64>::identity(m, m).kronecker(&self.filter.C_f);
        C.columns_mut(0, self.of_channels()).copy_from(&output);
        let direct = self.direct(v).unwrap_or_else(|| DMatrix::zeros(m, columns - m));
        [v.matrix(self.F).into_owned(), v.matrix(self.G).into_owned(), C, direct]
    }

    /// D_2, if σ̂_2 has feedthrough to ζ.
    pub fn direct(&self, v: &Values<f64>) -> Option<DMatrix<f64>> {
        self.direct.map(|direct| v.matrix(direct).into_owned())
    }

    /// Puts it at its start.
    pub fn begin<S: Scalar>(&self, v: &mut Point<S>) {
        v[self.q].fill(S::from(0.0));
    }

    /// q⁺ = F q + G (K_g r − W_0 σ̂_1, σ̂_2), of what is wanted of each channel and of σ̂_2.
    pub fn advance<S: Scalar>(&self, law: &L1Sampled, wanted: VectorOf<Discrete>, v: &mut Point<S>) {
        self.move_states(law, 0..self.q.len(), |j, v| v[wanted][j], v);
    }

    fn move_states<S: Scalar>(
        &self,
        law: &L1Sampled,
        states: std::ops::Range<usize>,
        wanted: impl Fn(usize, &Values<S>) -> S,
        v: &mut Point<S>,
    ) {
        let m = self.K.shape().0;
        for k in states.clone() {
            let values = &v.values();
            let driven = |j: usize| if j < m { wanted(j, values) } else { law.sigma(j, values) };
            let next = product(self.F, k, |j| values[self.q][j], values) + product(self.G, k, driven, values);
            v[self.next][k] = next;
        }
        for k in states {
            v[self.q][k] = v[self.next][k];
        }
    }

    /// ζ of a channel.
    pub fn output<S: Scalar>(&self, law: &L1Sampled, channel: usize, v: &Values<S>) -> S {
        let of_channel = &v[self.q][channel * self.filter.order()..][..self.filter.order()];
        let filtered = of_channel.iter().zip(self.filter.C_f.iter()).fold(S::from(0.0), |sum, (&q, &c)| sum + q * c);
        filtered - self.at_once(law, channel, v)
    }

    /// Adds to ζ of a channel, along the state in which its filter rests.
    pub fn add<S: Scalar>(&self, channel: usize, added: S, v: &mut Point<S>) {
        for (place, &rest) in self.at_rest.iter().enumerate() {
            v[self.q][channel * self.filter.order() + place] += added * rest;
        }
    }

    /// Feedthrough of σ̂_2 to ζ.
    fn at_once<S: Scalar>(&self, law: &L1Sampled, channel: usize, v: &Values<S>) -> S {
        let m = self.K.shape().0;
        self.direct.map_or(S::from(0.0), |direct| product(direct, channel, |j| law.sigma(m + j, v), v))
    }

    /// Rests with this ζ: D(s) of each channel; states that depend on σ̂_2 only continue.
    pub fn follow<S: Scalar>(&self, law: &L1Sampled, zeta: VectorOf<Discrete>, v: &mut Point<S>) {
        self.move_states(law, self.of_channels()..self.q.len(), |_, _| S::from(0.0), v);
        let order = self.filter.order();
        for i in 0..zeta.len() {
            let output = v[zeta][i] + self.at_once(law, i, &v.values());
            for place in 0..order {
                v[self.q][i * order + place] = output * self.at_rest[place];
            }
        }
    }
}
