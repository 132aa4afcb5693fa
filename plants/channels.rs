//! Channels that sensors and actuators share, with a clock that samples them, a delay and a lag.

use serde::Deserialize;

use crate::system::{
    Declaration, Discrete, Invalid, MatrixOf, Parameter, Point, Prepared, Scalar, ScalarOf, State, Unit, Values,
    VectorOf, any, larger, matrix, quantities, scalar, vector,
};

/// Numbers that all delay lines of a unit may hold together.
const LARGEST_LINES: usize = 1_000_000;

/// Number of channels, their units (1 where none are given), and how many samples the longest delay may have.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Channels {
    /// Number of channels, 1 … 1000.
    channels: usize,
    /// Units of the channels, one each; 1 where none are given.
    #[serde(default)]
    units: Vec<String>,
    /// Quantities of the channels in words, one each, as "yaw rate"; descriptions count channels where none are given.
    #[serde(default)]
    quantities: Vec<String>,
    /// Most samples that the longest delay may have.
    #[serde(default = "usual_delay_samples")]
    delay_samples: usize,
}

fn usual_delay_samples() -> usize {
    100
}

impl Channels {
    /// The unit of each channel.
    ///
    /// # Errors
    /// Sizes outside the allowed range, and unknown units.
    pub(super) fn units(&self) -> Result<Vec<&'static str>, Invalid> {
        let Channels { channels, units, delay_samples, .. } = self;
        if !(1..=1000).contains(channels) {
            return Err(Invalid::new("channels", channels, "must be within 1 … 1000"));
        }
        let most = LARGEST_LINES / channels - 1;
        if *delay_samples > most {
            return Err(Invalid::new(
                "delay_samples",
                delay_samples,
                format!("must be within 0 … {most}, with {channels} channels"),
            ));
        }
        Unit::symbols("u", units, *channels)
    }

    /// The quantity of each channel, if given.
    ///
    /// # Errors
    /// As [`quantities`].
    pub(super) fn quantities(&self) -> Result<Vec<String>, Invalid> {
        quantities("u", &self.quantities, self.channels)
    }
}

/// Sample instants k h, counted from t = 0 whenever the simulation starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    pub sample_time: ScalarOf<Parameter>,
    /// Number k of the latest sample; constant without sampling.
    pub sample: ScalarOf<Discrete>,
}

impl Clock {
    pub fn declare(d: &mut Declaration, sampled: &str) -> Self {
        let text = format!("time from sample to sample of {sampled}");
        Clock {
            sample_time: d.parameter(scalar("sample_time", &text).unit("s").start(1e-3).min(1e-9).fixed()),
            sample: d.discrete(scalar("#sample", "").hidden()),
        }
    }

    fn sample_at<S: Scalar>(&self, t: S, v: &Point<S>) -> S {
        // An instant that t meets up to rounding counts as passed.
        (t / v[self.sample_time] + 1e-9).floor()
    }

    /// The sample that is the latest at the start.
    pub fn start<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v[self.sample] = self.sample_at(t, v);
    }

    /// Skips samples that passed while nothing was sampled.
    pub fn catch_up<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        // A sample may have been taken a little before its instant, by a rounding of the communication points.
        v[self.sample] = larger(v[self.sample], self.sample_at(t, v));
    }

    /// The next sample is taken.
    pub fn tick<S: Scalar>(&self, v: &mut Point<S>) {
        v[self.sample] += 1.0;
    }

    /// Time of the next sample, s.
    pub fn next<S: Scalar>(&self, v: &Values<S>) -> S {
        (v[self.sample] + 1.0) * v[self.sample_time]
    }
}

/// A delay in each channel: the values at the latest sample instants, and straight lines between them.
#[derive(Debug)]
pub(super) struct DelayLine {
    clock: Clock,
    delay: VectorOf<Parameter>,
    /// The delays in samples.
    samples: VectorOf<Prepared>,
    /// A ring in each column, one a channel: sample k is in row k modulo their number.
    line: MatrixOf<Discrete>,
}

impl DelayLine {
    pub fn declare(d: &mut Declaration, clock: Clock, structure: &Channels) -> Self {
        let Channels { channels: m, delay_samples, .. } = *structure;
        let delay = vector("delay", m, "transport delay, a multiple of sample_time; 0: none");
        DelayLine {
            clock,
            delay: d.parameter(delay.unit("s").min(0.0).fixed()),
            samples: d.prepared(vector("#delay in samples", m, "").hidden()),
            line: d.discrete(matrix("#delay line", delay_samples + 1, m, "").hidden()),
        }
    }

    /// Counts the delays in samples, and refuses those that aren't so many whole samples as the line holds.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        let (sample_time, most) = (v[self.clock.sample_time], (self.line.shape().0 - 1) as f64);
        for i in 0..self.delay.len() {
            let delay = v[self.delay][i];
            let samples = (delay / sample_time).round();
            let is_multiple = (delay / sample_time - samples).abs().at_most(S::from(1e-6));
            v.refuse(!(samples.at_most(S::from(most)) & is_multiple), |v| {
                let allowed = format!(
                    "must be a multiple of {} = {} within 0 … {} (delay_samples = {most})",
                    v.name(self.clock.sample_time),
                    sample_time.to_text(),
                    (sample_time * most).rounded_at_most()
                );
                Invalid::new(v.name(self.delay.at(i)), delay.to_text(), allowed)
            });
            v[self.samples][i] = samples;
        }
    }

    /// True if any channel is delayed, now and from the start on: delays are fixed.
    pub fn is_used<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        any::<S>(v[self.samples].iter().map(|samples| samples.above(S::from(0.0))))
    }

    /// At the start the line is at rest.
    pub fn fill<S: Scalar>(&self, i: usize, value: S, v: &mut Point<S>) {
        v[self.ring(i)].fill(value);
    }

    /// Stores an input at a sample instant.
    pub fn push<S: Scalar>(&self, i: usize, value: S, v: &mut Point<S>) {
        let place = self.place(v[self.clock.sample]);
        S::put_element(&mut v[self.ring(i)], place, value);
    }

    /// Output at t for this input.
    pub fn delayed<S: Scalar>(&self, t: S, i: usize, present: S, v: &Values<S>) -> S {
        let samples = v[self.samples][i];
        let delayed = || {
            let (sample, sample_time) = (v[self.clock.sample], v[self.clock.sample_time]);
            let [before, after] = [0.0, 1.0].map(|k| S::element(&v[self.ring(i)], self.place(sample - samples + k)));
            before + (after - before) * ((t - sample_time * sample) / sample_time)
        };
        S::branch(samples.equals(S::from(0.0)), || present, delayed)
    }

    /// A channel's ring.
    fn ring(&self, i: usize) -> VectorOf<Discrete> {
        let (places, _) = self.line.shape();
        self.line.elements().part(i * places..(i + 1) * places)
    }

    /// Place of a sample in a ring: its number k modulo that of the places, n.
    fn place<S: Scalar>(&self, sample: S) -> S {
        // Exact for whole numbers below 2^53: k/n is then further below the next whole number than a rounding, so that
        // its floor is the right one, and all numbers here are whole ones that a float holds.
        let places = self.line.shape().0 as f64;
        sample - (sample / places).floor() * places
    }
}

/// A lag of first order in each channel, where there is one.
#[derive(Debug)]
pub(super) struct Lag {
    pub x: VectorOf<State>,
    /// 1 where there is one.
    acts: VectorOf<Discrete>,
}

impl Lag {
    pub fn declare(d: &mut Declaration, units: &[&'static str]) -> Self {
        let (m, text) = (units.len(), "state of the lag; constant without a lag");
        Lag { x: d.state(vector("x", m, text).units(units)), acts: d.discrete(vector("#lag acts", m, "").hidden()) }
    }

    /// At the start the lag is at rest.
    pub fn start<S: Scalar>(&self, i: usize, acts: S::Flag, input: S, v: &mut Point<S>) {
        v[self.acts][i] = S::from(0.0);
        self.change(i, acts, input, v);
    }

    /// A lag that comes in begins where the channel is, so that nothing jumps.
    pub fn change<S: Scalar>(&self, i: usize, acts: S::Flag, input: S, v: &mut Point<S>) {
        let comes_in = acts & !self.acts(i, &v.values());
        v[self.x][i] = S::select(comes_in, input, v[self.x][i]);
        v[self.acts][i] = S::from_flag(acts);
    }

    pub fn acts<S: Scalar>(&self, i: usize, v: &Values<S>) -> S::Flag {
        !v[self.acts][i].equals(S::from(0.0))
    }

    /// Output for this input.
    pub fn lagged<S: Scalar>(&self, i: usize, input: S, v: &Values<S>) -> S {
        S::select(self.acts(i, v), v[self.x][i], input)
    }
}
