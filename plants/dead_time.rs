//! Dead times at the inputs of a plant.

use crate::system::{
    Declaration, Discrete, Invalid, MatrixOf, Parameter, Point, Prepared, Scalar, ScalarOf, Values, VectorOf, larger,
    matrix, scalar, smaller, vector,
};

/// Samples of an input that are stored over the longest dead time.
const SAMPLES: usize = 100;

/// A dead time at each input: its values at sample instants, which part the longest one, and straight lines between them.
#[derive(Debug)]
pub(super) struct DeadTime {
    delay: VectorOf<Parameter>,
    sample_time: ScalarOf<Prepared>,
    /// Number of the latest sample.
    sample: ScalarOf<Discrete>,
    /// A ring in each column, one an input: sample k is in row k modulo their number.
    line: MatrixOf<Discrete>,
}

impl DeadTime {
    /// Declares the parameter and the line of each input.
    ///
    /// # Errors
    /// Another number of dead times than inputs.
    pub fn declare(
        d: &mut Declaration,
        given: &[f64],
        of_u: &[String],
        units: &[&'static str],
    ) -> Result<Self, Invalid> {
        let m = units.len();
        if given.len() != m {
            return Err(Invalid::new("number of delays", given.len(), format!("must be {m}, one an input")));
        }
        let delay = vector("delay", m, "dead time of the input; 0: none").about(of_u, "dead time of the {}; 0: none");
        Ok(DeadTime {
            delay: d.parameter(delay.unit("s").starts(given).min(0.0).fixed()),
            sample_time: d.prepared(scalar("#sample time", "").hidden()),
            sample: d.discrete(scalar("#sample", "").hidden()),
            line: d.discrete(matrix("#dead time", SAMPLES + 1, m, "").hidden()),
        })
    }

    /// Divides the longest dead time into samples, and refuses dead times shorter than one.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        let longest = v[self.delay].iter().copied().fold(S::from(0.0), larger);
        let sample_time = longest / SAMPLES as f64;
        v[self.sample_time] = sample_time;
        for i in 0..self.delay.len() {
            let delay = v[self.delay][i];
            v.refuse(delay.above(S::from(0.0)) & delay.below(sample_time), |v| {
                let allowed = format!("must be 0, or at least 1/{SAMPLES} of the longest, {} s", longest.to_text());
                Invalid::new(v.name(self.delay.at(i)), delay.to_text(), allowed)
            });
        }
    }

    /// True if any input has a dead time: they are fixed.
    fn is_used<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v[self.sample_time].above(S::from(0.0))
    }

    /// At the start the lines are at rest.
    pub fn start<S: Scalar>(&self, t: S, u: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        // An instant that t meets up to rounding counts as passed.
        let sample = || (t / v[self.sample_time] + 1e-9).floor();
        v[self.sample] = S::branch(self.is_used(&v.values()), sample, || S::from(0.0));
        for i in 0..self.delay.len() {
            let present = u(i, &v.values());
            v[self.ring(i)].fill(present);
        }
    }

    /// Time of the next sample, s.
    pub fn next<S: Scalar>(&self, v: &Values<S>) -> S {
        let next = || (v[self.sample] + 1.0) * v[self.sample_time];
        S::branch(self.is_used(v), next, || S::from(f64::INFINITY))
    }

    /// Takes a sample where one is due.
    pub fn event<S: Scalar>(&self, t: S, u: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        v.when(self.next(&v.values()).at_most(t), |v| {
            v[self.sample] += 1.0;
            for i in 0..self.delay.len() {
                let (present, place) = (u(i, &v.values()), place(v[self.sample]));
                S::put_element(&mut v[self.ring(i)], place, present);
            }
        });
    }

    /// The delayed value at t; `present` is the input now.
    pub fn delayed<S: Scalar>(&self, t: S, i: usize, present: S, v: &Values<S>) -> S {
        let delay = v[self.delay][i];
        let delayed = || {
            let when = (t - delay) / v[self.sample_time];
            // At the instant of the next sample, before it is taken, the line ends where it ended before.
            let before = smaller(when.floor(), v[self.sample] - 1.0);
            let [from, to] = [0.0, 1.0].map(|k| S::element(&v[self.ring(i)], place(before + k)));
            from + (to - from) * (when - before)
        };
        S::branch(delay.equals(S::from(0.0)), || present, delayed)
    }

    /// An input's ring.
    fn ring(&self, i: usize) -> VectorOf<Discrete> {
        self.line.elements().part(i * (SAMPLES + 1)..(i + 1) * (SAMPLES + 1))
    }
}

/// Place of a sample in a ring: its number modulo the number of places.
fn place<S: Scalar>(sample: S) -> S {
    let places = (SAMPLES + 1) as f64;
    sample - (sample / places).floor() * places
}
