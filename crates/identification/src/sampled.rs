//! A continuous model sampled behind a hold, with its derivatives, for each distinct step.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use crate::layout::{Continuous, Layout, Place};
use crate::linear::exponential;

/// Course of the inputs between two rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hold {
    /// Value of the row before (zero-order hold), as a digital controller writes it.
    #[default]
    ZeroOrder,
    /// Linear: inputs that were measured.
    FirstOrder,
}

/// A model x' = A x + B u behind a zero-order hold, x⁺ = F x + G u, with its derivatives by the entries of A, row by row: for programs
/// that compare them with their own.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledModel {
    /// exp(A h).
    pub f: DMatrix<f64>,
    /// ∫ exp(A s) ds B over the step.
    pub g: DMatrix<f64>,
    /// Derivatives of F and G by each entry of A.
    pub derivatives: Vec<[DMatrix<f64>; 2]>,
}

/// Samples a model with a step, s. `None` where the result isn't finite.
pub fn sampled(a: &DMatrix<f64>, b: &DMatrix<f64>, step: f64) -> Option<SampledModel> {
    let n = a.nrows();
    // Time in samples, as estimation has it.
    let model = Continuous { a: a * step, b: b * step, d: DMatrix::zeros(n, 1) };
    let entries: Vec<(usize, usize)> = (0..n * n).map(|k| (k / n, k % n)).collect();
    let all = Sampled::with(&model, &entries, &[1.0], 0, Hold::ZeroOrder)?;
    let rows = |of: &DMatrix<f64>, k: usize| of.rows(k * n, n) * step;
    let derivatives = (0..n * n).map(|k| [rows(&all.tangents[0].f, k), rows(&all.tangents[0].g, k)]).collect();
    Some(SampledModel { f: all.steps[0].f.clone(), g: all.steps[0].g.clone(), derivatives })
}

/// x⁺ = F x + Φ (B u + d) + Φ₂ B s, s the slope of the input in samples.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub f: DMatrix<f64>,
    /// ∫ exp(A s) ds over the step.
    pub phi: DMatrix<f64>,
    /// ∫ Φ ds over the step; empty for a zero-order hold.
    pub phi2: DMatrix<f64>,
    pub g: DMatrix<f64>,
    /// Gain of the slope of the input; empty for a zero-order hold.
    pub g2: DMatrix<f64>,
    /// Φ d, a column a record.
    pub o: DMatrix<f64>,
    /// F(δ) F(h)⁻¹: a predictor's gain for one sample becomes that of this step. `None` of one sample itself.
    pub carried: Option<DMatrix<f64>>,
}

/// Derivatives by the entries of A: those of entry i are rows i n … (i + 1) n.
#[derive(Debug, Clone)]
pub(crate) struct Tangents {
    pub f: DMatrix<f64>,
    pub g: DMatrix<f64>,
    pub g2: DMatrix<f64>,
    pub o: DMatrix<f64>,
    pub carried: Option<DMatrix<f64>>,
}

/// The steps of a model, and their derivatives where these were asked for.
pub(crate) struct Sampled {
    pub steps: Vec<Step>,
    pub tangents: Vec<Tangents>,
}

/// Matrices of the sampled model and of its derivatives in the entries of A.
struct Exponentials {
    f: DMatrix<f64>,
    phi: DMatrix<f64>,
    phi2: DMatrix<f64>,
}

/// The matrix whose exponential has F, Φ and Φ₂ in its first rows.
fn generator(a: &DMatrix<f64>, length: f64, hold: Hold) -> DMatrix<f64> {
    let n = a.nrows();
    let blocks = if hold == Hold::ZeroOrder { 2 } else { 3 };
    let mut m = DMatrix::zeros(blocks * n, blocks * n);
    m.view_mut((0, 0), (n, n)).copy_from(&(a * length));
    for block in 1..blocks {
        (0..n).for_each(|i| m[((block - 1) * n + i, block * n + i)] = length);
    }
    m
}

fn parts(whole: &DMatrix<f64>, n: usize) -> Exponentials {
    let block = |k: usize| {
        if (k + 1) * n <= whole.ncols() { whole.view((0, k * n), (n, n)).into_owned() } else { DMatrix::zeros(n, 0) }
    };
    Exponentials { f: block(0), phi: block(1), phi2: block(2) }
}

impl Sampled {
    /// The model at these steps in samples, of which `common` is one; `None` where it isn't finite.
    pub fn new(model: &Continuous, lengths: &[f64], common: usize, hold: Hold) -> Option<Self> {
        Self::with(model, &[], lengths, common, hold)
    }

    /// The same with derivatives in a layout's entries of A.
    pub fn with_tangents(
        model: &Continuous,
        layout: &Layout,
        lengths: &[f64],
        common: usize,
        hold: Hold,
    ) -> Option<Self> {
        let of_a = |place| if let Place::A(i, j) = place { Some((i, j)) } else { None };
        let entries: Vec<_> = layout.unknowns.iter().filter_map(|unknown| of_a(unknown.place)).collect();
        Self::with(model, &entries, lengths, common, hold)
    }

    fn with(
        model: &Continuous,
        entries: &[(usize, usize)],
        lengths: &[f64],
        common: usize,
        hold: Hold,
    ) -> Option<Self> {
        let n = model.a.nrows();
        let mut all = Vec::with_capacity(lengths.len());
        for &length in lengths {
            let m = generator(&model.a, length, hold);
            let direction = |&(i, j): &(usize, usize)| {
                let mut e = DMatrix::zeros(m.nrows(), m.ncols());
                e[(i, j)] = length;
                e
            };
            let directions: Vec<_> = entries.iter().map(direction).collect();
            let (value, derivatives) = exponential(&m, &directions)?;
            all.push((parts(&value, n), derivatives.iter().map(|d| parts(d, n)).collect::<Vec<_>>()));
        }
        let inverse = if lengths.len() > 1 { all[common].0.f.clone().try_inverse()? } else { DMatrix::zeros(0, 0) };
        let mut sampled = Sampled { steps: Vec::new(), tangents: Vec::new() };
        for (place, (value, derivatives)) in all.iter().enumerate() {
            let carried = (place != common).then(|| &value.f * &inverse);
            if !entries.is_empty() {
                let of_common = &all[common].1;
                sampled.tangents.push(Tangents::new(model, derivatives, of_common, carried.as_ref(), &inverse));
            }
            sampled.steps.push(Step {
                g: &value.phi * &model.b,
                g2: slope_gain(&value.phi2, &model.b),
                o: &value.phi * &model.d,
                f: value.f.clone(),
                phi: value.phi.clone(),
                phi2: value.phi2.clone(),
                carried,
            });
        }
        Some(sampled)
    }
}

fn slope_gain(phi2: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    if phi2.is_empty() { DMatrix::zeros(phi2.nrows(), 0) } else { phi2 * b }
}

impl Tangents {
    fn new(
        model: &Continuous,
        derivatives: &[Exponentials],
        of_common: &[Exponentials],
        carried: Option<&DMatrix<f64>>,
        inverse: &DMatrix<f64>,
    ) -> Self {
        let n = model.a.nrows();
        let stack = |of: &dyn Fn(usize) -> DMatrix<f64>| {
            let columns = of(0).ncols();
            let mut all = DMatrix::zeros(n * derivatives.len(), columns);
            for i in 0..derivatives.len() {
                all.view_mut((i * n, 0), (n, columns)).copy_from(&of(i));
            }
            all
        };
        Tangents {
            f: stack(&|i| derivatives[i].f.clone()),
            g: stack(&|i| &derivatives[i].phi * &model.b),
            g2: stack(&|i| slope_gain(&derivatives[i].phi2, &model.b)),
            o: stack(&|i| &derivatives[i].phi * &model.d),
            carried: carried.map(|carried| stack(&|i| (&derivatives[i].f - carried * &of_common[i].f) * inverse)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Scaling;
    use crate::record::Signals;
    use crate::structure::Structure;

    fn layout(n: usize, m: usize) -> Layout {
        let names = |letter: &str, count: usize| (0..count).map(|k| format!("{letter}{k}")).collect();
        let signals = Signals { inputs: names("u", m), measured: names("x", n) };
        let entries = Structure::default().entries(&signals, true).unwrap();
        Layout::new(&entries, &Scaling { x: vec![1.0; n], u: vec![1.0; m], h: 1.0 }, 1)
    }

    /// Every derivative by central differences, of all parts.
    #[test]
    fn tangents_are_the_derivatives_of_the_steps() {
        let (n, m) = (3, 2);
        let layout = layout(n, m);
        let p: Vec<f64> = (0..layout.count()).map(|k| 0.4 * (1.7 * k as f64).sin()).collect();
        let lengths = [0.5, 1.0, 2.5];
        let at = |p: &[f64]| Sampled::new(&layout.matrices(p), &lengths, 1, Hold::FirstOrder).unwrap().steps;
        let exact = Sampled::with_tangents(&layout.matrices(&p), &layout, &lengths, 1, Hold::FirstOrder).unwrap();
        for k in 0..n * n {
            let moved = |delta: f64| {
                let mut p = p.clone();
                p[k] += delta;
                at(&p)
            };
            let (above, below) = (moved(1e-5), moved(-1e-5));
            for (step, tangents) in exact.tangents.iter().enumerate() {
                let check = |part: &dyn Fn(&Step) -> DMatrix<f64>, tangent: &DMatrix<f64>| {
                    let difference = (part(&above[step]) - part(&below[step])) / 2e-5;
                    let tangent = tangent.rows(k * n, n);
                    assert!((difference - tangent).amax() < 1e-8, "entry {k}, step {step}");
                };
                check(&|step| step.f.clone(), &tangents.f);
                check(&|step| step.g.clone(), &tangents.g);
                check(&|step| step.g2.clone(), &tangents.g2);
                check(&|step| step.o.clone(), &tangents.o);
                if let Some(carried) = &tangents.carried {
                    check(&|step| step.carried.clone().unwrap(), carried);
                }
            }
        }
    }

    #[test]
    fn a_first_order_hold_follows_a_ramp_exactly() {
        // x' = −x + u, u = t: x(t) = t − 1 + e⁻ᵗ from 0.
        let model = Continuous {
            a: DMatrix::from_element(1, 1, -1.0),
            b: DMatrix::from_element(1, 1, 1.0),
            d: DMatrix::zeros(1, 1),
        };
        let step = &Sampled::new(&model, &[0.7], 0, Hold::FirstOrder).unwrap().steps[0];
        assert!((step.g2[0] - (0.7 - 1.0 + (-0.7_f64).exp())).abs() < 1e-14);
        assert!(step.g[0] - (1.0 - (-0.7_f64).exp()) < 1e-14);
    }
}
