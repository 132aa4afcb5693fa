//! Reference signals with exact first and second derivatives.

use serde::Deserialize;

use crate::system::{
    Declaration, Discrete, IntegerOf, Invalid, MatrixOf, Parameter, Point, Scalar, Signal, Signals, System, Unit,
    Values, VectorOf, matrix, selection, vector,
};

/// Steps that each channel can have.
const STEPS: usize = 4;

/// The parts of a reference that can be chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
enum Part {
    Cosine,
    Sine,
    Square,
    Steps,
}

/// A named choice of parts.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct NamedSignal {
    /// Item of the parameter `signal`.
    name: String,
    /// What it is, in a line.
    description: String,
    /// The parts that it consists of, beside offset and ramp.
    parts: Vec<Part>,
}

/// Number of channels, their units (1 where none are given), and names for choices of parts (a parameter `signal`), where
/// there are several.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ReferenceStructure {
    /// Number of channels.
    channels: usize,
    /// Units of the reference, one a channel; 1 where none are given.
    #[serde(default)]
    units: Vec<String>,
    /// Named choices of parts, the items of a parameter `signal`.
    #[serde(default)]
    signals: Vec<NamedSignal>,
}

/// Each channel: r = s(t) (offset + slope t + cosine + sine + square) + steps, with a smooth start s(t).
#[derive(Debug)]
pub struct Reference {
    signals: Vec<NamedSignal>,
    signal: Option<IntegerOf<Parameter>>,
    offset: VectorOf<Parameter>,
    slope: VectorOf<Parameter>,
    /// Amplitude, angular frequency and phase.
    cosine: [VectorOf<Parameter>; 3],
    sine: [VectorOf<Parameter>; 3],
    /// Amplitude, frequency in Hz and phase.
    square: [VectorOf<Parameter>; 3],
    step_time: MatrixOf<Parameter>,
    step_height: MatrixOf<Parameter>,
    /// Rate, and weight of the term that makes the second derivative start at zero too.
    smooth_start: [VectorOf<Parameter>; 2],
    /// Half periods of the square wave that have passed.
    half_periods: VectorOf<Discrete>,
    /// 1 for a step that has been taken.
    taken: MatrixOf<Discrete>,
    r: VectorOf<Signal>,
    dr: VectorOf<Signal>,
    ddr: VectorOf<Signal>,
}

/// A value with its first and second time derivatives.
type Jet<S> = [S; 3];

impl System for Reference {
    type Structure = ReferenceStructure;
    const NAME: &'static str = "reference";
    const DOCUMENTATION: &'static str = include_str!("../docs/plants/reference.md");

    fn declare(structure: ReferenceStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let ReferenceStructure { channels: m, units, signals } = structure;
        if m == 0 || m > 1000 {
            return Err(Invalid::new("channels", m, "must be within 1 … 1000"));
        }
        let units = Unit::symbols("r", &units, m)?;
        let rates: Vec<_> = units.iter().map(|unit| Unit::per_second(unit)).collect();
        let second_rates: Vec<_> = rates.iter().map(|unit| Unit::per_second(unit)).collect();
        let items = signals.iter().map(|signal| (signal.name.clone(), signal.description.clone())).collect::<Vec<_>>();
        let signal = (!items.is_empty())
            .then(|| d.parameter(selection("signal", "which parts the reference consists of", "Signal", items)));
        let mut parameter = |name: &str, text: &str, unit| {
            let spec = vector(name, m, text);
            d.parameter(match unit {
                "r" => spec.units(&units),
                "r/s" => spec.units(&rates),
                other => spec.unit(other),
            })
        };
        let reference = Reference {
            signals,
            signal,
            offset: parameter("offset", "constant part", "r"),
            slope: parameter("slope", "ramp", "r/s"),
            cosine: [
                parameter("cosine_amplitude", "amplitude of the cosine", "r"),
                parameter("cosine_frequency", "angular frequency of the cosine", "rad/s"),
                parameter("cosine_phase", "phase of the cosine", "rad"),
            ],
            sine: [
                parameter("sine_amplitude", "amplitude of the sine", "r"),
                parameter("sine_frequency", "angular frequency of the sine", "rad/s"),
                parameter("sine_phase", "phase of the sine", "rad"),
            ],
            square: [
                parameter("square_amplitude", "amplitude of the square wave, which begins with +1", "r"),
                d.parameter(vector("square_frequency", m, "frequency of the square wave").unit("Hz").min(0.0)),
                d.parameter(vector("square_phase", m, "phase of the square wave").unit("rad")),
            ],
            step_time: d.parameter(matrix("step_time", m, STEPS, "when the step is taken").unit("s")),
            step_height: d.parameter(matrix("step_height", m, STEPS, "height of the step").units(&units.repeat(STEPS))),
            smooth_start: [
                d.parameter(vector("smooth_start_rate", m, "rate a of the smooth start; 0: none").unit("1/s").min(0.0)),
                d.parameter(
                    vector(
                        "smooth_start_curvature",
                        m,
                        "1: the second derivative too starts at zero; 0: the first alone",
                    )
                    .start(1.0)
                    .min(0.0)
                    .max(1.0),
                ),
            ],
            half_periods: d.discrete(vector("half_periods", m, "half periods of the square wave that have passed")),
            taken: d.discrete(matrix("step_taken", m, STEPS, "1 once the step was taken")),
            r: d.output(vector("r", m, "reference").units(&units)),
            dr: d.output(vector("dr", m, "first time derivative of the reference").units(&rates)),
            ddr: d.output(vector("ddr", m, "second time derivative of the reference").units(&second_rates)),
        };
        for signal in [reference.r, reference.dr, reference.ddr] {
            d.depends(signal, &[]);
        }
        Ok(reference)
    }

    fn initialise(&self, t: f64, v: &mut Point) -> Result<(), Invalid> {
        self.parameters_changed(t, v);
        Ok(())
    }

    fn parameters_changed(&self, t: f64, v: &mut Point) {
        for i in 0..self.r.len() {
            v[self.half_periods.at(i)] = self.half_periods_until(t, i, &v.values());
            for j in 0..STEPS {
                v[self.taken.at(i, j)] = f64::from(u8::from(v[self.step_time.at(i, j)] <= t));
            }
        }
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.r.len() {
            let s = self.smooth_start(t, v, i);
            let g = self.shape(t, v, i);
            let steps = if self.has(Part::Steps, v) { self.steps(v, i) } else { S::from(0.0) };
            y[self.r.at(i)] = s[0] * g[0] + steps;
            y[self.dr.at(i)] = s[1] * g[0] + s[0] * g[1];
            y[self.ddr.at(i)] = s[2] * g[0] + s[1] * g[1] * 2.0 + s[0] * g[2];
        }
    }

    fn next_time_event(&self, v: &Values<f64>) -> Option<f64> {
        let edges = (0..self.r.len()).map(|i| self.next_edge(i, v));
        let steps = self.pending_steps(v).map(|(i, j)| v[self.step_time.at(i, j)]);
        edges.chain(steps).reduce(f64::min).filter(|time| time.is_finite())
    }

    fn event(&self, _t: f64, _crossed: &[bool], v: &mut Point) {
        let Some(now) = self.next_time_event(&v.values()) else { return };
        for i in 0..self.r.len() {
            if self.next_edge(i, &v.values()) <= now {
                v[self.half_periods.at(i)] += 1.0;
            }
            for j in 0..STEPS {
                if v[self.step_time.at(i, j)] <= now {
                    v[self.taken.at(i, j)] = 1.0;
                }
            }
        }
    }
}

impl Reference {
    fn has<S: Scalar>(&self, part: Part, v: &Values<S>) -> bool {
        self.signal.is_none_or(|signal| {
            let chosen = v.get(signal).clamp(1, self.signals.len() as i32) - 1;
            self.signals[chosen as usize].parts.contains(&part)
        })
    }

    /// s = 1 − e^(−τ) (1 + τ + κ τ²/2), τ = a t.
    fn smooth_start<S: Scalar>(&self, t: S, v: &Values<S>, i: usize) -> Jet<S> {
        let [a, curvature] = self.smooth_start.map(|parameter| v[parameter][i]);
        if a.re() == 0.0 {
            return [S::from(1.0), S::from(0.0), S::from(0.0)];
        }
        let tau = a * t;
        let decay = (-tau).exp();
        let curved = curvature * tau * tau * 0.5;
        let straight = (-curvature + 1.0) * tau;
        [
            -decay * (tau + curved + 1.0) + 1.0,
            a * decay * (straight + curved),
            a * a * decay * (-curvature + 1.0 + curvature * tau - straight - curved),
        ]
    }

    /// offset + slope t + cosine + sine + square.
    fn shape<S: Scalar>(&self, t: S, v: &Values<S>, i: usize) -> Jet<S> {
        let slope = v[self.slope][i];
        let mut g = [v[self.offset][i] + slope * t, slope, S::from(0.0)];
        let waves = [(Part::Cosine, self.cosine, std::f64::consts::FRAC_PI_2), (Part::Sine, self.sine, 0.0)];
        for (part, wave, lead) in waves {
            let [amplitude, omega, phase] = wave.map(|parameter| v[parameter][i]);
            if amplitude.re() != 0.0 && self.has(part, v) {
                let (sin, cos) = (omega * t + phase + lead).sin_cos();
                g[0] += amplitude * sin;
                g[1] += amplitude * omega * cos;
                g[2] -= amplitude * omega * omega * sin;
            }
        }
        if self.has(Part::Square, v) {
            let even = v[self.half_periods][i].re().rem_euclid(2.0) == 0.0;
            g[0] += v[self.square[0]][i] * if even { 1.0 } else { -1.0 };
        }
        g
    }

    fn steps<S: Scalar>(&self, v: &Values<S>, i: usize) -> S {
        (0..STEPS).map(|j| v[self.step_height.at(i, j)] * v[self.taken.at(i, j)]).fold(S::from(0.0), |sum, h| sum + h)
    }

    /// The square wave's phase, in periods.
    fn square_phase(&self, i: usize, v: &Values<f64>) -> f64 {
        v[self.square[2]][i] / std::f64::consts::TAU
    }

    fn half_periods_until(&self, t: f64, i: usize, v: &Values<f64>) -> f64 {
        // An edge that t meets up to rounding counts as passed.
        (2.0 * (v[self.square[1]][i] * t + self.square_phase(i, v)) + 1e-9).floor()
    }

    fn next_edge(&self, i: usize, v: &Values<f64>) -> f64 {
        let frequency = v[self.square[1]][i];
        if frequency == 0.0 || v[self.square[0]][i] == 0.0 || !self.has(Part::Square, v) {
            return f64::INFINITY;
        }
        ((v[self.half_periods][i] + 1.0) / 2.0 - self.square_phase(i, v)) / frequency
    }

    fn pending_steps<'a>(&'a self, v: &'a Values<f64>) -> impl Iterator<Item = (usize, usize)> + 'a {
        let all = (0..self.r.len()).flat_map(|i| (0..STEPS).map(move |j| (i, j)));
        all.filter(|&(i, j)| v[self.taken.at(i, j)] == 0.0 && self.has(Part::Steps, v))
    }
}
