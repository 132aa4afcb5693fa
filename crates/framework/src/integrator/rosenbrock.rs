//! The stiff method: Rosenbrock's, of order 5 with an embedded one of order 4, L-stable and stiffly accurate.
//!
//! Steinebach, Construction of Rosenbrock–Wanner method Rodas5P and numerical benchmarks within the Julia Differential
//! Equations package, BIT Numer. Math. 63 (2023) 27. In the form without products by the Jacobian J (Hairer and
//! Wanner, Solving Ordinary Differential Equations II, IV.7) its stages solve
//!
//! (I/(γh) − J) uᵢ = f(t + αᵢh, x + Σ aᵢⱼuⱼ) + Σ cᵢⱼuⱼ/h + γᵢh ∂f/∂t.
//!
//! The estimate of the error relies on J at all stages: where a rate's sign, or nearly, decides, what J damps may be no longer
//! damped within far less than what is tolerated. So the equation of the last stage is solved once more at the end, as one
//! more step of Newton's method with the same J: where that doesn't get on, the substep is too long.
//!
//! The states of the last stages add up: the result is that of stage 8 plus u₈, and u₈ itself is the error.

use nalgebra::Complex;

use std::sync::Arc;

use super::elimination::Elimination;
use super::jacobian::Jacobian;
use super::lu::Lu;
use super::{Coefficients, OneStepMethod, Problem, Sparsity, Start, Tolerance};
use crate::kernel::Kernel;
use crate::system::{ErrorEstimate, Variables};

const STAGES: usize = 8;

const GAMMA: f64 = 0.21193756319429014;
/// The nodes αᵢ.
const NODES: [f64; STAGES] =
    [0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0];
/// The weights γᵢ of ∂f/∂t.
const TIME_WEIGHTS: [f64; STAGES] =
    [GAMMA, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0];
/// The weights aᵢⱼ of stages 2 to 6. Stage 7 adds u₆ to the state of stage 6, stage 8 then u₇.
const A2: [f64; 1] = [3.0];
const A3: [f64; 2] = [2.849394379747939, 0.45842242204463923];
const A4: [f64; 3] = [-6.954028509809101, 2.489845061869568, -10.358996098473584];
const A5: [f64; 4] = [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641];
const A6: [f64; 5] =
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946];
/// The weights cᵢⱼ of stages 2 to 8.
const C2: [f64; 1] = [-14.155112264123755];
const C3: [f64; 2] = [-17.97296035885952, -2.859693295451294];
const C4: [f64; 3] = [147.12150275711716, -1.41221402718213, 71.68940251302358];
const C5: [f64; 4] = [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306];
const C6: [f64; 5] =
    [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471];
const C7: [f64; 6] = [
    30.91273214028599,
    -3.1208243349937974,
    77.79954646070892,
    34.28646028294783,
    -19.097331116725623,
    -28.087943162872662,
];
const C8: [f64; 7] = [
    37.80277123390563,
    -3.2571969029072276,
    112.26918849496327,
    66.9347231244047,
    -40.06618937091002,
    -54.66780262877968,
    -9.48861652309627,
];
/// Weights of the stages in the polynomial of order 4 between the ends, s(c₁ + r(K₁ + s(K₂ + s K₃))).
const BETWEEN: [[f64; STAGES]; 3] = [
    [
        25.948786856663858,
        -2.5579724845846235,
        10.433815404888879,
        -2.3679251022685204,
        0.524948541321073,
        1.1241088310450404,
        0.4272876194431874,
        -0.17202221070155493,
    ],
    [
        -9.91568850695171,
        -0.9689944594115154,
        3.0438037242978453,
        -24.495224566215796,
        20.176138334709044,
        15.98066361424651,
        -6.789040303419874,
        -6.710236069923372,
    ],
    [
        11.419903575922262,
        2.8879645146136994,
        72.92137995996029,
        80.12511834622643,
        -52.072871366152654,
        -59.78993625266729,
        -0.15582684282751913,
        4.883087185713722,
    ],
];

/// Largest ratio of one more correction to the last one; beyond it, the Jacobian isn't what it was at the start.
const LEFT_OVER: f64 = 0.5;
/// Part of a state's magnitude below which a correction may be rounding.
const ROUNDING: f64 = 1e-13;

/// Factor by which one substep multiplies the solution of x' = λ x, for z = λh: the stages on that equation.
pub fn stability(z: Complex<f64>) -> Complex<f64> {
    let a: [&[f64]; STAGES - 2] = [&[], &A2, &A3, &A4, &A5, &A6];
    let c: [&[f64]; STAGES] = [&[], &C2, &C3, &C4, &C5, &C6, &C7, &C8];
    let mut u = [Complex::new(0.0, 0.0); STAGES];
    let weighted = |weights: &[f64], u: &[Complex<f64>]| -> Complex<f64> {
        weights.iter().zip(u).map(|(&weight, u)| u * weight).sum()
    };
    let mut x = Complex::new(1.0, 0.0);
    for i in 0..STAGES {
        // The last stages add up.
        x = if i < STAGES - 2 { weighted(a[i], &u) + 1.0 } else { x + u[i - 1] };
        u[i] = (z * x + weighted(c[i], &u)) / (-z + 1.0 / GAMMA);
    }
    x + u[STAGES - 1]
}

/// Kind of the decomposition in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Decomposed {
    /// Over the pattern of the Jacobian.
    ByPattern,
    /// The same, compiled.
    ByKernel,
    /// Full, with pivoting.
    Pivoted,
}

/// The method's workspace.
#[derive(Debug)]
pub struct Rosenbrock {
    jacobian: Jacobian,
    /// Over the pattern of the Jacobian, where that is sparse; and with pivoting, where the other would lose digits.
    elimination: Option<Elimination>,
    lu: Lu,
    /// Factors of a kernel's decomposition.
    factors: Vec<f64>,
    /// Kind of the last decomposition.
    decomposed: Decomposed,
    /// The stages u, one row a state: what is summed lies together.
    u: Vec<[f64; STAGES]>,
    /// Right-hand side and solution of a stage's equations.
    rhs: Vec<f64>,
    /// The error without damping.
    undamped: Vec<f64>,
    errors: Vec<f64>,
}

impl Rosenbrock {
    /// A workspace for a system.
    pub fn new(variables: &Variables, sparsity: &Arc<Sparsity>) -> Self {
        let states = variables.states();
        Rosenbrock {
            jacobian: Jacobian::new(variables, sparsity),
            elimination: Elimination::new(sparsity),
            lu: Lu::new(states),
            factors: Vec::new(),
            decomposed: Decomposed::Pivoted,
            u: vec![[0.0; STAGES]; states],
            rhs: vec![0.0; states],
            undamped: vec![0.0; states],
            errors: vec![0.0; states],
        }
    }

    /// Takes what a substep of a problem needs.
    pub fn prepare(&mut self, problem: &Problem) {
        self.jacobian.prepare(problem);
    }

    /// The Jacobian of the last [`OneStepMethod::begin`].
    pub fn jacobian(&mut self) -> &mut Jacobian {
        &mut self.jacobian
    }

    /// Takes storage for what a kernel decomposes.
    pub fn take_kernel(&mut self, kernel: &Kernel) {
        self.factors.resize(kernel.factors().unwrap_or_default(), 0.0);
    }

    /// Decomposes I/(γh) − J. Returns true if it is regular.
    fn decompose(&mut self, h: f64, kernel: Option<&Kernel>) -> bool {
        let (diagonal, by_states) = (1.0 / (GAMMA * h), self.jacobian.by_states());
        let accurate = if let Some(kernel) = kernel.filter(|kernel| kernel.factors().is_some()) {
            self.decomposed = Decomposed::ByKernel;
            kernel.decompose(diagonal, self.jacobian.entries(), &mut self.factors)
        } else {
            self.decomposed = Decomposed::ByPattern;
            self.elimination.as_mut().is_some_and(|elimination| elimination.decompose(diagonal, by_states))
        };
        if accurate {
            return true;
        }
        self.decomposed = Decomposed::Pivoted;
        let (matrix, n) = (self.lu.matrix(), self.rhs.len());
        matrix.iter_mut().zip(self.jacobian.by_states()).for_each(|(w, j)| *w = -j);
        matrix.iter_mut().step_by(n + 1).for_each(|entry| *entry += diagonal);
        self.lu.decompose()
    }

    /// Puts the states of a stage to those of the start with the weighted sum of the stages before.
    fn place<const N: usize>(&self, problem: &mut Problem, start: &Start, weights: &[f64; N]) {
        for ((x, x0), u) in problem.states().iter_mut().zip(&start.states).zip(&self.u) {
            *x = x0 + sum(weights, u);
        }
    }

    /// Adds the stage before to the states.
    fn add(&self, problem: &mut Problem, stage: usize) {
        problem.states().iter_mut().zip(&self.u).for_each(|(x, u)| *x += u[stage]);
    }

    /// Evaluates the problem at a stage, with the stage's states set, and solves the stage's equations.
    fn stage<const N: usize>(&mut self, problem: &mut Problem, start: &Start, h: f64, weights: &[f64; N]) {
        problem.evaluate(start.time + NODES[N] * h);
        self.solve((problem.rates(), problem.kernel), h, weights);
    }

    fn solve<const N: usize>(&mut self, (rates, kernel): (&[f64], Option<&Kernel>), h: f64, weights: &[f64; N]) {
        let by_time = self.jacobian.by_time();
        for (((rhs, rate), u), change) in self.rhs.iter_mut().zip(rates).zip(&self.u).zip(by_time) {
            *rhs = rate + sum(weights, u) / h + TIME_WEIGHTS[N] * h * change;
        }
        self.solve_rhs(kernel);
        self.u.iter_mut().zip(&self.rhs).for_each(|(u, &solution)| u[N] = solution);
    }

    /// Replaces the right-hand side by the solution.
    fn solve_rhs(&mut self, kernel: Option<&Kernel>) {
        match (self.decomposed, &mut self.elimination, kernel) {
            (Decomposed::ByKernel, _, Some(kernel)) => kernel.solve(&self.factors, &mut self.rhs),
            (Decomposed::ByPattern, Some(elimination), _) => elimination.solve(&mut self.rhs),
            _ => self.lu.solve(&mut self.rhs),
        }
    }

    /// Error right after an attempt whose error is tolerated. If the Jacobian damps a larger error, it must be the same
    /// as at the start, which one more stage checks. Else the result is the error without damping.
    fn undamped(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        tolerance: Tolerance,
        damped: (f64, usize),
    ) -> (f64, usize) {
        let (diagonal, kernel) = (1.0 / (GAMMA * h), problem.kernel);
        let (states, rates) = problem.states_and_rates();
        for (((rhs, undamped), rate), u) in self.rhs.iter_mut().zip(&mut self.undamped).zip(rates).zip(&self.u) {
            *rhs = rate + sum(&C8, u) / h - diagonal * u[7];
            *undamped = *rhs / diagonal;
        }
        let most = tolerance.scaled(self.undamped.iter().copied(), &start.states, states);
        // Nor where that is no number.
        if most.0.is_nan() || most.0 <= 1.0 {
            return damped;
        }
        self.solve_rhs(kernel);
        let lasts = |i: usize| {
            let size = tolerance.nominals[i].max(start.states[i].abs()).max(states[i].abs());
            let small = self.rhs[i].abs() <= (LEFT_OVER * self.u[i][7].abs()).max(ROUNDING * size);
            small || self.undamped[i].abs() <= tolerance.relative * size
        };
        if (0..states.len()).all(lasts) { damped } else { most }
    }
}

/// Weighted sum of the first N stages.
#[inline]
fn sum<const N: usize>(weights: &[f64; N], u: &[f64; STAGES]) -> f64 {
    weights.iter().zip(u).map(|(weight, u)| weight * u).sum()
}

impl OneStepMethod for Rosenbrock {
    fn begin(&mut self, problem: &Problem, start: &Start) -> Result<(), usize> {
        self.jacobian.evaluate(problem, start.time)
    }

    fn attempt(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        tolerance: Tolerance,
    ) -> (ErrorEstimate, usize) {
        if !self.decompose(h, problem.kernel) {
            return (ErrorEstimate { scaled: f64::INFINITY, order: 5 }, 0);
        }
        self.solve((&start.rates, problem.kernel), h, &[]);
        self.place(problem, start, &A2);
        self.stage(problem, start, h, &C2);
        self.place(problem, start, &A3);
        self.stage(problem, start, h, &C3);
        self.place(problem, start, &A4);
        self.stage(problem, start, h, &C4);
        self.place(problem, start, &A5);
        self.stage(problem, start, h, &C5);
        self.place(problem, start, &A6);
        self.stage(problem, start, h, &C6);
        self.add(problem, 5);
        self.stage(problem, start, h, &C7);
        self.add(problem, 6);
        self.stage(problem, start, h, &C8);
        self.add(problem, 7);
        problem.evaluate(start.time + h);
        let (states, rates) = problem.states_and_rates();
        // Where the equations give no number, no other step could start.
        for ((error, u), rate) in self.errors.iter_mut().zip(&self.u).zip(rates) {
            *error = if rate.is_finite() { u[7] } else { f64::NAN };
        }
        let mut error = tolerance.scaled(self.errors.iter().copied(), &start.states, states);
        if error.0 <= 1.0 {
            error = self.undamped(problem, start, h, tolerance, error);
        }
        (ErrorEstimate { scaled: error.0, order: 5 }, error.1)
    }

    fn errors(&self) -> &[f64] {
        &self.errors
    }

    fn between(&mut self, problem: &mut Problem, start: &Start, _h: f64, rows: &mut [Coefficients]) {
        for ((row, u), (x0, x1)) in rows.iter_mut().zip(&self.u).zip(start.states.iter().zip(problem.states())) {
            let [k1, k2, k3] = BETWEEN.map(|weights| sum(&weights, u));
            // The same in the form for all methods: s = 1 − r.
            *row = [*x1 - x0, k1, k2 + k3, -k3, 0.0, 0.0, 0.0];
        }
    }
}
