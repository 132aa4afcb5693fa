//! A feedback gain by fuzzy inference from the tracking error and its rate (thesis, chapter 4), and its extension to several
//! channels (its future work).
#![allow(non_snake_case)] // matrices have the names of the thesis

mod numbers;
mod sets;

use nalgebra::DMatrix;

use crate::mathematics::fuzzy::{SETS, infer};
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, Discrete, Invalid, MatrixOf, Parameter, Point, Scalar, ScalarOf, Signal,
    Signals, Values, VectorOf, boolean, choice, matrix, scalar, smaller, vector,
};
pub(super) use numbers::{Channels, Held, Sharing};
use numbers::{Limits, Number, NumberUnit};
use sets::Sets;

/// Intervals of the grid of errors and rates on which the range of the gain is looked for.
const GRID: usize = 32;

/// Output of the inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FuzzyOutput {
    Gain,
    InverseGain,
    Constant,
}

impl Choice for FuzzyOutput {
    const TYPE: &'static str = "FuzzyOutput";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Gain, "gain", "k_f is the feedback gain"),
        (Self::InverseGain, "inverse_gain", "k_f is the inverse of the feedback gain"),
        (Self::Constant, "constant", "no inference: k_f is constant_gain, and the feedback gain, to compare with"),
    ];
}

/// k of each channel: of k_f where |e| > k_e, else the constant one. What channels share, each of them has a copy of the
/// handle of.
#[derive(Debug)]
pub(super) struct FuzzyGain {
    k_p: Vec<ScalarOf<Parameter>>,
    /// None where no channel's rate is known.
    k_d: Option<Vec<ScalarOf<Parameter>>>,
    k_e: Vec<ScalarOf<Parameter>>,
    /// Factor from k_f to the gain; 1 if there is none.
    scale: Option<Vec<ScalarOf<Parameter>>>,
    has_rate: Vec<bool>,
    fuzzy_output: ChoiceOf<Parameter, FuzzyOutput>,
    constant_gain: Vec<ScalarOf<Parameter>>,
    input_centre: VectorOf<Parameter>,
    /// One a channel, or one for all.
    sets: Vec<Sets>,
    /// One a channel.
    pub k_f: Vec<ScalarOf<Signal>>,
    /// True if |e| > k_e, for each channel: between events.
    is_fuzzy: Vec<BooleanOf<Discrete>>,
    /// The place of the first event indicator.
    indicators: usize,
    /// K with the gains in force.
    pub K: MatrixOf<Signal>,
}

/// The weights of the inference.
#[derive(Debug)]
struct Weights {
    k_p: Vec<ScalarOf<Parameter>>,
    k_d: Option<Vec<ScalarOf<Parameter>>>,
    k_e: Vec<ScalarOf<Parameter>>,
    scale: Option<Vec<ScalarOf<Parameter>>>,
}

impl Weights {
    fn declare(held: Held, channels: Channels, d: &mut Declaration) -> Self {
        let number = |name, text, unit, start| Number { name, text, unit, start, limits: Limits::NotNegative };
        let one = NumberUnit::Is("1");
        let k_p = number("k_p", "factor of |e| in the inference", one, 0.1).declare(held, channels, d);
        let k_d = number("k_d", "factor of |e'| in the inference", NumberUnit::Is("s"), 0.05);
        let starts: Vec<_> = channels.has_rate.iter().map(|&known| if known { k_d.start } else { 0.0 }).collect();
        let starts = if held == Held::Own { &starts[..] } else { &[k_d.start] };
        let k_d = channels.has_rate.contains(&true).then(|| k_d.starting(starts, held, channels, d));
        let k_e = number("k_e", "magnitude of e above which the gain is fuzzy", NumberUnit::OfError, 0.1);
        let k_e = k_e.declare(held, channels, d);
        let scale = Number {
            limits: Limits::Positive,
            ..number("fuzzy_scale", "factor from the inference to the feedback gain", one, 1.0)
        };
        let scale = (held == Held::Own).then(|| scale.declare(held, channels, d));
        Weights { k_p, k_d, k_e, scale }
    }
}

impl FuzzyGain {
    /// Declares the gains of these channels.
    pub fn declare(d: &mut Declaration, sharing: Sharing, channels: Channels) -> Self {
        let m = channels.count();
        let gain = "fuzzy gain, from the error and its rate";
        let centres_of = ["zero", "very small", "small", "large", "very large"]
            .map(|set| format!("centre of the input set `{set}`, for k_p |e| and k_d |e'|"));
        let Weights { k_p, k_d, k_e, scale } = Weights::declare(sharing.weights, channels, d);
        FuzzyGain {
            k_p,
            k_d,
            k_e,
            scale,
            has_rate: channels.has_rate.to_vec(),
            fuzzy_output: d.parameter(choice::<FuzzyOutput>("fuzzy_output", "output of the inference")),
            constant_gain: Number {
                name: "constant_gain",
                text: "k_f without inference, where fuzzy_output = constant",
                unit: NumberUnit::Is("1/s"),
                start: 0.6,
                limits: Limits::Positive,
            }
            .declare(sharing.weights, channels, d),
            input_centre: d.parameter(
                vector("input_centre", SETS, "")
                    .each(&centres_of.each_ref().map(String::as_str))
                    .starts(&[0.08, 0.31, 0.54, 0.77, 1.0]),
            ),
            sets: Sets::declare(sharing, channels, d),
            k_f: if m == 1 {
                vec![d.output(scalar("k_f", gain).source("Hashim, section 4.3"))]
            } else {
                let all = d.output(vector("k_f", m, gain).source("Hashim, section 4.3"));
                (0..m).map(|i| all.at(i)).collect()
            },
            is_fuzzy: (0..m).map(|i| d.discrete(boolean(&format!("#is_fuzzy[{}]", i + 1), "").hidden())).collect(),
            indicators: {
                let sides = |i: usize| {
                    ["above", "below"].map(|side| format!("error of channel {i} {side} the fuzzy gain's bound"))
                };
                d.indicators((1..=m).flat_map(sides))
            },
            K: d.local(matrix("gain_in_force", m, m, "feedback gain K in force").unit("1/s")),
        }
    }

    /// Refuses sets without a width or out of order, a weight of a rate that isn't known, and a row of K that can't be
    /// scaled.
    pub fn relate<S: Scalar>(&self, feedback_gain: MatrixOf<Parameter>, v: &mut Point<S>) {
        self.sets.iter().for_each(|sets| sets.relate(v));
        for k in 1..SETS {
            v.require_below(self.input_centre.at(k - 1), self.input_centre.at(k));
        }
        for (&k_d, known) in self.k_d.iter().flatten().zip(&self.has_rate) {
            v.refuse(!v[k_d].equals(S::from(0.0)) & S::Flag::from(!known), |v| {
                let allowed = "must be 0: the control has feedthrough to the rate of this output (C B), so that the rate isn't \
                               known from the state";
                Invalid::new(v.name(k_d), v[k_d].to_text(), allowed)
            });
        }
        let m = self.k_f.len();
        for (i, j) in (0..m * m).map(|k| (k / m, k % m)).filter(|&(i, j)| i != j) {
            let [K_ij, K_ii] = [(i, j), (i, i)].map(|(i, j)| feedback_gain.at(i, j));
            v.refuse(!v[K_ij].equals(S::from(0.0)) & !v[K_ii].above(S::from(0.0)), |v| {
                let [K_ij, row] = [v.name(K_ij), format!("row {}", i + 1)];
                let allowed = format!(
                    "must be above 0 where {K_ij} isn't 0: the fuzzy gain takes its place, and scales {row} in proportion"
                );
                Invalid::new(v.name(K_ii), v[K_ii].to_text(), allowed)
            });
        }
    }

    fn sets(&self, channel: usize) -> &Sets {
        &self.sets[channel.min(self.sets.len() - 1)]
    }

    /// K with the constant gains, and with the least and the largest fuzzy ones on a grid of errors and rates.
    pub fn range(&self, feedback_gain: MatrixOf<Parameter>, v: &Values<f64>) -> Vec<(&'static str, DMatrix<f64>)> {
        let ranges: Vec<_> = (0..self.k_f.len()).map(|i| self.range_of(i, v)).collect();
        let constant = v.matrix(feedback_gain).into_owned();
        let with = |k: fn(&[f64; 2]) -> f64| {
            DMatrix::from_fn(constant.nrows(), constant.ncols(), |i, j| match (i == j, constant[(i, j)]) {
                (true, _) => k(&ranges[i]),
                (false, 0.0) => 0.0,
                (false, K_ij) => K_ij * (k(&ranges[i]) / constant[(i, i)]),
            })
        };
        let (least, largest) = (with(|range| range[0]), with(|range| range[1]));
        let mut gains = vec![("constant K", constant.clone()), ("least fuzzy K", least)];
        if ranges.iter().any(|[low, high]| high > low) {
            gains.push(("largest fuzzy K", largest));
        }
        gains
    }

    /// The least and the largest gain of a channel on that grid.
    fn range_of(&self, channel: usize, v: &Values<f64>) -> [f64; 2] {
        let (centres, sets) = (v.array(self.input_centre), self.sets(channel).triangles(v));
        let (least, largest) = (centres[0], centres[SETS - 1]);
        let part = |k: usize| least + (largest - least) * k as f64 / GRID as f64;
        // A rate that isn't known is none.
        let rates = if self.has_rate[channel] { (0..=GRID).map(part).collect() } else { vec![0.0] };
        let inferred = (0..=GRID).flat_map(|i| rates.iter().map(move |&rate| (i, rate)));
        let scale = self.scale.as_ref().map_or(1.0, |scale| v[scale[channel]]);
        let gains = inferred.map(|(i, rate)| match v.get(self.fuzzy_output).item() {
            FuzzyOutput::Constant => scale * v[self.constant_gain[channel]],
            FuzzyOutput::Gain => scale * infer([part(i), rate], &centres, &sets),
            FuzzyOutput::InverseGain => scale * infer([part(i), rate], &centres, &sets).recip(),
        });
        gains.fold([f64::INFINITY, 0.0], |[low, high], k| [low.min(k), high.max(k)])
    }

    /// k_f and the gain in force, from e and e' of each channel. Where a gain takes the place of K_ii, it scales its row.
    pub fn outputs<S: Scalar>(
        &self,
        feedback_gain: MatrixOf<Parameter>,
        errors: impl Fn(usize) -> [S; 2],
        v: &Values<S>,
        y: &mut Signals<S>,
    ) {
        let (centres, chosen) = (v.array(self.input_centre), v.get(self.fuzzy_output));
        let (is_constant, is_inverse) = (chosen.is(FuzzyOutput::Constant), chosen.is(FuzzyOutput::InverseGain));
        y.slice(self.K).copy_from_slice(&v[feedback_gain.elements()]);
        for (i, (&k_f, &is_fuzzy)) in self.k_f.iter().zip(&self.is_fuzzy).enumerate() {
            let ([e, rate], sets) = (errors(i), self.sets(i).triangles(v));
            let of_rate = || self.k_d.as_ref().map_or(S::from(0.0), |k_d| v[k_d[i]] * rate.abs());
            let inferred = || infer([v[self.k_p[i]] * e.abs(), of_rate()], &centres, &sets);
            let k = S::branch(is_constant, || v[self.constant_gain[i]], inferred);
            y[k_f] = k;
            let (in_force, constant) = (self.K.at(i, i), y[self.K.at(i, i)]);
            let scaled = |k: S| self.scale.as_ref().map_or(k, |scale| v[scale[i]] * k);
            let fuzzy = || scaled(S::branch(is_inverse, || k.recip(), || k));
            let is_fuzzy = v.get(is_fuzzy);
            y[in_force] = S::branch(is_fuzzy, fuzzy, || constant);
            for j in (0..self.k_f.len()).filter(|&j| j != i) {
                let K_ij = v[feedback_gain.at(i, j)];
                let is_scaled = is_fuzzy & !K_ij.equals(S::from(0.0));
                y[self.K.at(i, j)] = S::branch(is_scaled, || K_ij * (y[in_force] / constant), || K_ij);
            }
        }
    }

    /// Distances of e above k_e and below −k_e in each channel. An error that sweeps over both between two points of
    /// the integration changes both signs, although |e| may be equal at either point. Never zero, so that only the
    /// signs decide which gain is in force.
    pub fn event_indicators<S: Scalar>(&self, e: impl Fn(usize) -> S, v: &Values<S>, z: &mut [S]) {
        for i in 0..self.is_fuzzy.len() {
            for (side, e) in [e(i), -e(i)].into_iter().enumerate() {
                let above = e - v[self.k_e[i]];
                let at_most = || smaller(S::from(-f64::MIN_POSITIVE), above);
                z[self.indicators + 2 * i + side] = S::branch(above.above(S::from(0.0)), || above, at_most);
            }
        }
    }

    /// Chooses the gain of a channel by its error.
    pub fn choose<S: Scalar>(&self, channel: usize, e: S, v: &mut Point<S>) {
        let is_fuzzy = (e.abs() - v[self.k_e[channel]]).above(S::from(0.0));
        v.put(self.is_fuzzy[channel], is_fuzzy);
    }
}
