//! A feedback gain by fuzzy inference from the tracking error and its rate (thesis, chapter 4).
#![allow(non_snake_case)] // sets and matrices have the names of the thesis

use nalgebra::DMatrix;

use crate::mathematics::fuzzy::{SETS, Triangle, infer};
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, Discrete, Invalid, MatrixOf, Parameter, Point, Scalar, ScalarOf, Signal,
    Signals, Values, VectorOf, boolean, choice, matrix, scalar, smaller, vector,
};

/// Intervals of the grid of errors and rates on which the range of the gain is looked for.
const GRID: usize = 32;

/// What the inference gives.
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

/// k of each channel: of k_f where |e| > k_e, else the constant one.
#[derive(Debug)]
pub(super) struct FuzzyGain {
    k_p: ScalarOf<Parameter>,
    k_d: ScalarOf<Parameter>,
    k_e: ScalarOf<Parameter>,
    fuzzy_output: ChoiceOf<Parameter, FuzzyOutput>,
    constant_gain: ScalarOf<Parameter>,
    input_centre: VectorOf<Parameter>,
    sets: Sets,
    /// One a channel.
    pub k_f: Vec<ScalarOf<Signal>>,
    /// Whether |e| > k_e, for each channel: between events.
    is_fuzzy: Vec<BooleanOf<Discrete>>,
    /// The place of the first event indicator.
    indicators: usize,
    /// K with the gains in force.
    pub K: MatrixOf<Signal>,
}

/// The corners of the output sets, of which neighbours share some.
#[derive(Debug)]
struct Sets {
    VL_c: ScalarOf<Parameter>,
    VL_l: ScalarOf<Parameter>,
    L_l: ScalarOf<Parameter>,
    L_c: ScalarOf<Parameter>,
    L_h: ScalarOf<Parameter>,
    S_l: ScalarOf<Parameter>,
    S_c: ScalarOf<Parameter>,
    VS_l: ScalarOf<Parameter>,
    VS_c: ScalarOf<Parameter>,
}

impl Sets {
    /// Each starts in the middle of its bounds.
    fn declare(d: &mut Declaration) -> Self {
        let mut corner = |name: &str, text: &str, min: f64, max: f64| {
            d.parameter(scalar(name, &format!("output set {text}")).start(0.5 * (min + max)).min(min).max(max))
        };
        Sets {
            VL_c: corner("VL_c", "`very large`: centre and upper end", 8.0, 12.0),
            VL_l: corner("VL_l", "`very large`: lower end, and upper end of `small`", 4.0, 8.0),
            L_l: corner("L_l", "`large`: lower end, and upper end of `very small`", 1.5, 3.0),
            L_c: corner("L_c", "`large`: centre", 3.0, 6.0),
            L_h: corner("L_h", "`large`: upper end", 6.0, 10.0),
            S_l: corner("S_l", "`small`: lower end, and upper end of `zero`", 0.3, 1.5),
            S_c: corner("S_c", "`small`: centre", 1.5, 4.0),
            VS_l: corner("VS_l", "`very small`: lower end, and lower end and centre of `zero`", 0.0, 0.5),
            VS_c: corner("VS_c", "`very small`: centre", 0.5, 1.5),
        }
    }

    /// Each set has a width; by the bounds of single corners the others are in order.
    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        v.require_below(self.VS_l, self.S_l);
        v.require_below(self.VL_l, self.VL_c);
    }

    /// Zero, very small, small, large, very large.
    fn triangles<S: Scalar>(&self, v: &Values<S>) -> [Triangle<S>; SETS] {
        let Sets { VL_c, VL_l, L_l, L_c, L_h, S_l, S_c, VS_l, VS_c } = self;
        [(VS_l, VS_l, S_l), (VS_l, VS_c, L_l), (S_l, S_c, VL_l), (L_l, L_c, L_h), (VL_l, VL_c, VL_c)]
            .map(|(&low, &centre, &high)| Triangle { low: v[low], centre: v[centre], high: v[high] })
    }
}

impl FuzzyGain {
    /// For m channels.
    pub fn declare(d: &mut Declaration, m: usize) -> Self {
        let gain = "fuzzy gain, from the error and its rate";
        let centres_of = ["zero", "very small", "small", "large", "very large"]
            .map(|set| format!("centre of the input set `{set}`, for k_p |e| and k_d |e'|"));
        FuzzyGain {
            k_p: d.parameter(scalar("k_p", "factor of |e| in the inference").start(0.1).min(0.0)),
            k_d: d.parameter(scalar("k_d", "factor of |e'| in the inference").unit("s").start(0.05).min(0.0)),
            k_e: d.parameter(scalar("k_e", "magnitude of e above which the gain is fuzzy").start(0.1).min(0.0)),
            fuzzy_output: d.parameter(choice::<FuzzyOutput>("fuzzy_output", "what the inference gives")),
            constant_gain: d.parameter(
                scalar("constant_gain", "k_f without inference, where fuzzy_output = constant")
                    .unit("1/s")
                    .start(0.6)
                    .positive(),
            ),
            input_centre: d.parameter(
                vector("input_centre", SETS, "")
                    .each(&centres_of.each_ref().map(String::as_str))
                    .starts(&[0.08, 0.31, 0.54, 0.77, 1.0]),
            ),
            sets: Sets::declare(d),
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

    /// Refuses sets without a width or out of order, and a K that is no diagonal.
    pub fn relate<S: Scalar>(&self, feedback_gain: MatrixOf<Parameter>, v: &mut Point<S>) {
        self.sets.relate(v);
        for k in 1..SETS {
            v.require_below(self.input_centre.at(k - 1), self.input_centre.at(k));
        }
        let m = self.k_f.len();
        for (i, j) in (0..m * m).map(|k| (k / m, k % m)).filter(|&(i, j)| i != j) {
            let K_ij = v[feedback_gain.at(i, j)];
            v.refuse(!K_ij.equals(S::from(0.0)), |v| {
                let allowed = "must be 0: each channel has a fuzzy gain of its own";
                Invalid::new(v.name(feedback_gain.at(i, j)), K_ij.told(), allowed)
            });
        }
    }

    /// K with the constant gain, and with the least and the largest fuzzy one on a grid of errors and rates.
    pub fn range(&self, feedback_gain: MatrixOf<Parameter>, v: &Values<f64>) -> Vec<(&'static str, DMatrix<f64>)> {
        let (centres, sets) = (v.array(self.input_centre), self.sets.triangles(v));
        let (least, largest) = (centres[0], centres[SETS - 1]);
        let part = |k: usize| least + (largest - least) * k as f64 / GRID as f64;
        let inferred = (0..=GRID).flat_map(|i| (0..=GRID).map(move |j| (i, j)));
        let inferred = inferred.map(|(i, j)| match v.get(self.fuzzy_output).item() {
            FuzzyOutput::Constant => v[self.constant_gain],
            FuzzyOutput::Gain => infer([part(i), part(j)], &centres, &sets),
            FuzzyOutput::InverseGain => infer([part(i), part(j)], &centres, &sets).recip(),
        });
        let (low, high) = inferred.fold((f64::INFINITY, 0.0_f64), |(low, high), k| (low.min(k), high.max(k)));
        let uniform = |k: f64| DMatrix::from_diagonal_element(self.k_f.len(), self.k_f.len(), k);
        let mut gains = vec![("constant K", v.matrix(feedback_gain).into_owned()), ("least fuzzy K", uniform(low))];
        if high > low {
            gains.push(("largest fuzzy K", uniform(high)));
        }
        gains
    }

    /// k_f and the gain in force, from e and e' of each channel.
    pub fn outputs<S: Scalar>(
        &self,
        feedback_gain: MatrixOf<Parameter>,
        errors: impl Fn(usize) -> [S; 2],
        v: &Values<S>,
        y: &mut Signals<S>,
    ) {
        let (centres, sets, chosen) = (v.array(self.input_centre), self.sets.triangles(v), v.get(self.fuzzy_output));
        let (is_constant, is_inverse) = (chosen.is(FuzzyOutput::Constant), chosen.is(FuzzyOutput::InverseGain));
        y.slice(self.K).copy_from_slice(&v[feedback_gain.elements()]);
        for (i, (&k_f, &is_fuzzy)) in self.k_f.iter().zip(&self.is_fuzzy).enumerate() {
            let [e, rate] = errors(i);
            let inferred = || infer([v[self.k_p] * e.abs(), v[self.k_d] * rate.abs()], &centres, &sets);
            let k = S::branch(is_constant, || v[self.constant_gain], inferred);
            y[k_f] = k;
            let (in_force, constant) = (self.K.at(i, i), y[self.K.at(i, i)]);
            let fuzzy = || S::branch(is_inverse, || k.recip(), || k);
            y[in_force] = S::branch(v.get(is_fuzzy), fuzzy, || constant);
        }
    }

    /// By how much e of each channel is above k_e, and by how much below −k_e: an error that sweeps over both between two
    /// points of the integration changes both signs, where |e| would have the same at either point. Never zero, so that
    /// the signs alone tell which gain is in force.
    pub fn event_indicators<S: Scalar>(&self, e: impl Fn(usize) -> S, v: &Values<S>, z: &mut [S]) {
        for i in 0..self.is_fuzzy.len() {
            for (side, e) in [e(i), -e(i)].into_iter().enumerate() {
                let above = e - v[self.k_e];
                let at_most = || smaller(S::from(-f64::MIN_POSITIVE), above);
                z[self.indicators + 2 * i + side] = S::branch(above.above(S::from(0.0)), || above, at_most);
            }
        }
    }

    /// Chooses the gain of a channel by its error.
    pub fn choose<S: Scalar>(&self, channel: usize, e: S, v: &mut Point<S>) {
        let is_fuzzy = (e.abs() - v[self.k_e]).above(S::from(0.0));
        v.put(self.is_fuzzy[channel], is_fuzzy);
    }
}
