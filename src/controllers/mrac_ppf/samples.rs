//! Clock of the sampled controller, and its values between samples.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::MracPpf;
use crate::controllers::angles::Angles;
use crate::controllers::sampling::Sampling;
use crate::mathematics::exponential::{exponential, workspace};
use crate::system::{
    Declaration, Discrete, Input, MatrixOf, Parameter, Point, Scalar, State, Values, VectorOf, larger, vector,
};

/// The clock of the sampled controller, and values that are constant between samples.
#[derive(Debug)]
pub(super) struct Samples {
    pub sampling: Sampling,
    /// The control until the next sample.
    pub control: VectorOf<Discrete>,
    /// x_m at the latest sample.
    pub x_m_before: VectorOf<Discrete>,
    /// e^(A_m T) by columns, then the workspace for it.
    transition: VectorOf<Discrete>,
}

impl Samples {
    /// Declares the samples of n states and m controls.
    pub fn declare(d: &mut Declaration, n: usize, m: usize) -> Self {
        let hidden = |name: &str, size: usize| vector(name, size, "").hidden();
        Samples {
            sampling: Sampling::declare(d),
            control: d.discrete(hidden("#held", m)),
            x_m_before: d.discrete(hidden("#x_m_before", n)),
            transition: d.discrete(hidden("#transition", n * n + workspace(n))),
        }
    }

    /// e^(A_m T), where T is known.
    pub fn discretise<S: Scalar>(&self, A_m: MatrixOf<Parameter>, v: &mut Point<S>) {
        let (period, n) = (v[self.sampling.clock.period], self.x_m_before.len());
        v.when(self.sampling.clock.is_known(&v.values()), |v| {
            v.copy(A_m.elements(), self.transition.part(0..n * n));
            let (matrix, workspace) = v[self.transition].split_at_mut(n * n);
            matrix.iter_mut().for_each(|a| *a *= period);
            exponential(n, matrix, workspace);
        });
    }

    /// x_m one sample time after the latest sample, for a constant reference: r + e^(A_m T) (x_m − r).
    pub fn advance_model<S: Scalar>(
        &self,
        (r, angles): (VectorOf<Input>, &Angles),
        x_m: VectorOf<State>,
        v: &mut Point<S>,
    ) {
        let n = x_m.len();
        for i in 0..n {
            let reference = |j: usize| angles.nearest(j, v[r][j], v[self.x_m_before][j]);
            let away = |j: usize| v[self.x_m_before][j] - reference(j);
            v[x_m][i] = (0..n).fold(reference(i), |sum, j| sum + v[self.transition][i + j * n] * away(j));
        }
    }
}

impl MracPpf {
    /// Starts the clock at t, where its sample time is known.
    pub(super) fn begin_sampling<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let samples = &self.samples;
        let is_sampled = self.is_sampled(&v.values());
        samples.sampling.begin(t, is_sampled, v);
        v.copy(self.x_m0, samples.x_m_before);
        v.when(is_sampled, |v| samples.discretise(self.A_m, v));
    }

    /// Takes the first step's length at a communication point if it is to be the sample time, and warns of steps that
    /// are longer than that.
    pub(super) fn keep_to_communication_points<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let samples = &self.samples;
        let first = |v: &mut Point<S>| {
            samples.discretise(self.A_m, v);
            self.sample(v);
        };
        let remnant = |v: &mut Point<S>| v.copy(self.x_m, samples.x_m_before);
        samples.sampling.keep_to_communication_points((t, step), first, remnant, v);
        self.warn_of_long_sample(step, v);
    }

    /// Warns of a step that is longer than the sample time, and of a control that moves far from sample to sample.
    fn warn_of_long_sample<S: Scalar>(&self, step: S, v: &mut Point<S>) {
        let Sampling { sample_time, clock } = &self.samples.sampling;
        let period = v[clock.period];
        let too_long = clock.is_overrun(step, &v.values());
        let moved = self.moves.look(self.u, step, v);
        v.put(self.step_too_long, too_long | moved.flag);
        v.when(too_long, |v| {
            v.warn(self.long_step, |v| clock.overrun_warning(step, v, &v.name(*sample_time)));
        });
        // The control moves once a sample.
        let warning = |_: &Values<S>| moved.warning(larger(step, period), ", or a single FMU");
        v.when(moved.flag & !too_long, |v| v.warn(self.long_step, warning));
    }
}
