//! The explicit Runge–Kutta method of order 8, for long ways.
//!
//! It is DOP853: the method of Prince and Dormand with the error estimates of order 5 and 3 of Hairer, Nørsett and Wanner,
//! Solving Ordinary Differential Equations I, 2nd ed. (Springer 1993), II.5 and II.10.
//!
//! If a rate has a kink, the difference from the solution of order 5 is zero for some places of the kink in a substep.
//! So another estimate counts as well, which sees these: the fifth divided difference of the derivatives at six of the
//! stages, zero for rates of degree 4 either. With both, no place of a kink hides an error of more than six times the
//! estimate (a test counts; with the first only, 6 of 100 hid more than ten times).
//!
//! A substep takes nearly twice the evaluations of one of order 5. It is stable for six times the magnitude on the imaginary
//! axis (λh up to 5.96 against 0.99), and for twice that of real modes. So it pays where several substeps lie between
//! communication points, and most where modes are hardly damped, as the adaptation of L1 controllers is. How much is in
//! docs/speed.md; kinks, as those of a projection at its bound, leave no order an advantage.

use nalgebra::Complex;

use super::dense::hermite;
use super::dormand_prince::sum;
use super::{Coefficients, OneStepMethod, Problem, Start, Tolerance};
use crate::system::ErrorEstimate;

/// Number of stored derivatives: those of stages 1 and 4 to 12. Those of stages 2 and 3 are soon needed no more.
const STORED: usize = 10;

/// Nodes of stages 2 to 12, in parts of the step.
const NODES: [f64; 11] = [
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    1.0 / 3.0,
    1.0 / 4.0,
    4.0 / 13.0,
    127.0 / 195.0,
    3.0 / 5.0,
    6.0 / 7.0,
    1.0,
];

/// Weights of stage 1 in stage 2.
const A2: [f64; 1] = [0.05260015195876773];
/// Weights of stages 1 and 2 in stage 3.
const A3: [f64; 2] = [0.0197250569845379, 0.0591751709536137];
/// Weights of stages 1 and 3 in stage 4.
const A4: [f64; 2] = [0.02958758547680685, 0.08876275643042054];
/// Weights of stages 1, 3 and 4 in stage 5.
const A5: [f64; 3] = [0.2413651341592667, -0.8845494793282861, 0.924834003261792];
/// Weights of stages 1, 4 and 5 in stage 6.
const A6: [f64; 3] = [1.0 / 27.0, 0.17082860872947386, 0.12546768756682242];
/// Weights of stage 1 and those from 4 on in stage 7.
const A7: [f64; 4] = [0.037109375, 0.17025221101954405, 0.06021653898045596, -0.017578125];
/// Weights in stage 8.
const A8: [f64; 5] =
    [0.03709200011850479, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023];
/// Weights in stage 9.
const A9: [f64; 6] = [
    0.6241109587160757,
    -3.3608926294469414,
    -0.868219346841726,
    27.59209969944671,
    20.154067550477894,
    -43.48988418106996,
];
/// Weights in stage 10.
const A10: [f64; 7] = [
    0.47766253643826434,
    -2.4881146199716677,
    -0.590290826836843,
    21.230051448181193,
    15.279233632882423,
    -33.28821096898486,
    -0.020331201708508627,
];
/// Weights in stage 11.
const A11: [f64; 8] = [
    -0.9371424300859873,
    5.186372428844064,
    1.0914373489967295,
    -8.149787010746927,
    -18.52006565999696,
    22.739487099350505,
    2.4936055526796523,
    -3.0467644718982196,
];
/// Weights in stage 12.
const A12: [f64; 9] = [
    2.273310147516538,
    -10.53449546673725,
    -2.0008720582248625,
    -17.9589318631188,
    27.94888452941996,
    -2.8589982771350235,
    -8.87285693353063,
    12.360567175794303,
    0.6433927460157636,
];
/// Weights in the solution.
const B: [f64; STORED] = [
    0.054293734116568765,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    0.3111643669578199,
    -0.1521609496625161,
    0.20136540080403034,
    0.04471061572777259,
];
/// Weights in the difference from the solution of order 5.
const E5: [f64; STORED] = [
    0.01312004499419488,
    0.0,
    0.0,
    -1.2251564463762044,
    -0.4957589496572502,
    1.6643771824549864,
    -0.35032884874997366,
    0.3341791187130175,
    0.08192320648511571,
    -0.022355307863886294,
];
/// Weights in the difference from the solution of order 3.
const E3: [f64; STORED] = [
    -0.18980075407240762,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    -0.4226823213237919,
    -0.1521609496625161,
    0.20136540080403034,
    0.02265179219836082,
];
/// The divided difference, in units in which it sees a kink about as well as the difference from order 5.
const DIVIDED: [f64; STORED] = [
    UNIT * -455.0 / 18.0,
    0.0,
    0.0,
    0.0,
    UNIT * 66560.0 / 153.0,
    UNIT * -2599051.0 / 5130.0,
    0.0,
    UNIT * 81250.0 / 513.0,
    UNIT * -218491.0 / 2295.0,
    UNIT * 910.0 / 27.0,
];
const UNIT: f64 = 7e-4;
/// Nodes of stages 14 to 16, which only values between the ends need. Stage 13 is the next substep's first.
const FURTHER_NODES: [f64; 3] = [0.1, 0.2, 7.0 / 9.0];
/// Weights of the stored stages, and of those from 13 on, in stage 14.
const A14: ([f64; STORED], [f64; 1]) = (
    [
        0.056167502283047954,
        0.0,
        0.0,
        0.0,
        0.25350021021662483,
        -0.2462390374708025,
        -0.12419142326381637,
        0.15329179827876568,
        0.00820105229563469,
        0.007567897660545699,
    ],
    [-0.008298],
);
/// Weights of the stored stages, and of those from 13 on, in stage 15.
const A15: ([f64; STORED], [f64; 2]) = (
    [
        0.03183464816350214,
        0.0,
        0.0,
        0.028300909672366776,
        0.053541988307438566,
        -0.05492374857139099,
        0.0,
        0.0,
        -0.00010834732869724932,
        0.0003825710908356584,
    ],
    [-0.00034046500868740456, 0.1413124436746325],
);
/// Weights of the stored stages, and of those from 13 on, in stage 16.
const A16: ([f64; STORED], [f64; 3]) = (
    [
        -0.42889630158379194,
        0.0,
        0.0,
        -4.697621415361164,
        7.683421196062599,
        4.06898981839711,
        0.3567271874552811,
        0.0,
        0.0,
        0.0,
    ],
    [-0.0013990241651590145, 2.9475147891527724, -9.15095847217987],
);
/// The same in c₄ to c₇ of the polynomial of order 7 between the ends.
const BETWEEN: [([f64; STORED], [f64; FURTHER]); 4] = [
    (
        [
            -8.428938276109013,
            0.0,
            0.0,
            0.5667149535193777,
            -3.0689499459498917,
            2.38466765651207,
            2.117034582445028,
            -0.871391583777973,
            2.2404374302607883,
            0.6315787787694688,
        ],
        [-0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894],
    ),
    (
        [
            10.427508642579134,
            0.0,
            0.0,
            242.28349177525817,
            165.20045171727028,
            -374.5467547226902,
            -22.113666853125306,
            7.733432668472264,
            -30.674084731089398,
            -9.332130526430229,
        ],
        [15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408],
    ),
    (
        [
            19.985053242002433,
            0.0,
            0.0,
            -387.0373087493518,
            -189.17813819516758,
            527.8081592054236,
            -11.57390253995963,
            6.8812326946963,
            -1.0006050966910838,
            0.7777137798053443,
        ],
        [-2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279],
    ),
    (
        [
            -25.69393346270375,
            0.0,
            0.0,
            -154.18974869023643,
            -231.5293791760455,
            357.6391179106141,
            93.40532418362432,
            -37.45832313645163,
            104.0996495089623,
            29.8402934266605,
        ],
        [-43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564],
    ),
];
/// Number of stages from 13 on.
const FURTHER: usize = 4;
/// Factor on the difference from order 3, compared with that from order 5.
const PART_OF_3: f64 = 0.1;

/// The error of order 8 for one that is seen by order 5 and another by order 3.
fn combined(of_5: f64, of_3: f64) -> f64 {
    // Squares the quotient only: squares of errors may be too small for numbers.
    let quotient = PART_OF_3 * of_3 / of_5;
    if of_5 == 0.0 { 0.0 } else { of_5 / (1.0 + quotient * quotient).sqrt() }
}

/// Factor by which one substep multiplies the solution of x' = λ x, for z = λh: up to order 8 the terms of the
/// exponential function, beyond them those that follow from the weights.
pub fn stability(z: Complex<f64>) -> Complex<f64> {
    let coefficients = [
        3.613324578128244e-10,
        1.4947364854591547e-8,
        2.3413451082097797e-7,
        2.691692200169089e-6,
        1.0 / 40320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    coefficients.iter().fold(Complex::new(0.0, 0.0), |sum, &coefficient| sum * z + coefficient)
}

/// The method's workspace.
#[derive(Debug)]
pub struct Dop853 {
    /// Derivatives at the stages, one row a state: what is summed lies together.
    k: Vec<[f64; STORED]>,
    /// Those of stages from 13 on, where they are needed.
    further: Vec<[f64; FURTHER]>,
    errors: Vec<f64>,
}

impl Dop853 {
    /// A workspace for this number of states.
    pub fn new(states: usize) -> Self {
        Dop853 { k: vec![[0.0; STORED]; states], further: Vec::new(), errors: vec![0.0; states] }
    }

    /// Evaluates the next stage at node c, and keeps the derivatives of the one before, which the problem holds, at
    /// `PLACE`. (N is known when compiling, so that the sums are unrolled.)
    fn stage<const PLACE: usize, const N: usize>(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        c: f64,
        weights: &[f64; N],
    ) {
        let (states, rates) = problem.states_and_rates();
        for (((x, x0), k), &rate) in states.iter_mut().zip(&start.states).zip(&mut self.k).zip(rates) {
            *x = x0 + h * sum(weights, k, rate);
            k[PLACE] = rate;
        }
        problem.evaluate(start.time + c * h);
    }

    /// Evaluates a stage behind the 13th, and keeps the derivatives of the one before, which the problem holds.
    fn further_stage<const N: usize>(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        (stored, further): &([f64; STORED], [f64; N]),
    ) {
        let (states, rates) = problem.states_and_rates();
        let stages = self.k.iter().zip(&mut self.further);
        for (((x, x0), (k, known)), &rate) in states.iter_mut().zip(&start.states).zip(stages).zip(rates) {
            known[N - 1] = rate;
            *x = x0 + h * (sum(stored, k, k[STORED - 1]) + sum(further, known, rate));
        }
        problem.evaluate(start.time + FURTHER_NODES[N - 1] * h);
    }
}

impl OneStepMethod for Dop853 {
    fn attempt(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        tolerance: Tolerance,
    ) -> (ErrorEstimate, usize) {
        problem.rates_mut().copy_from_slice(&start.rates);
        self.stage::<0, 1>(problem, start, h, NODES[0], &A2);
        self.stage::<1, 2>(problem, start, h, NODES[1], &A3);
        self.stage::<1, 2>(problem, start, h, NODES[2], &A4);
        self.stage::<1, 3>(problem, start, h, NODES[3], &A5);
        self.stage::<2, 3>(problem, start, h, NODES[4], &A6);
        self.stage::<3, 4>(problem, start, h, NODES[5], &A7);
        self.stage::<4, 5>(problem, start, h, NODES[6], &A8);
        self.stage::<5, 6>(problem, start, h, NODES[7], &A9);
        self.stage::<6, 7>(problem, start, h, NODES[8], &A10);
        self.stage::<7, 8>(problem, start, h, NODES[9], &A11);
        self.stage::<8, 9>(problem, start, h, NODES[10], &A12);
        self.stage::<9, STORED>(problem, start, h, 1.0, &B);
        for (error, k) in self.errors.iter_mut().zip(&self.k) {
            let of = |weights| h * sum(weights, k, k[STORED - 1]);
            let (seen, divided, of_3) = (of(&E5), of(&DIVIDED), of(&E3));
            *error = combined(if divided.abs() > seen.abs() { divided } else { seen }, of_3);
        }
        let (scaled, state) = tolerance.scaled(self.errors.iter().copied(), &start.states, problem.states());
        (ErrorEstimate { scaled, order: 8 }, state)
    }

    fn errors(&self) -> &[f64] {
        &self.errors
    }

    fn between(&mut self, problem: &mut Problem, start: &Start, h: f64, rows: &mut [Coefficients]) {
        hermite(problem, start, h, rows);
        self.further.resize(self.k.len(), [0.0; FURTHER]);
        self.further_stage(problem, start, h, &A14);
        self.further_stage(problem, start, h, &A15);
        self.further_stage(problem, start, h, &A16);
        let stages = self.k.iter().zip(&self.further);
        for ((row, (k, further)), &rate) in rows.iter_mut().zip(stages).zip(problem.rates()) {
            for (c, (stored, weights)) in row[3..].iter_mut().zip(&BETWEEN) {
                *c = h * (sum(stored, k, k[STORED - 1]) + sum(weights, further, rate));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes of the stages whose derivatives are stored.
    fn nodes() -> [f64; STORED] {
        let mut nodes = [0.0; STORED];
        nodes[1..].copy_from_slice(&NODES[2..]);
        nodes
    }

    fn weighted(weights: &[f64; STORED], rates: impl Fn(f64) -> f64) -> f64 {
        nodes().iter().zip(weights).map(|(&c, weight)| weight * rates(c)).sum()
    }

    #[test]
    fn weights_integrate_polynomials_of_their_orders() {
        for power in 0..8 {
            let (exact, rate) = (1.0 / f64::from(power + 1), |t: f64| t.powi(power));
            assert!((weighted(&B, rate) - exact).abs() < 1e-14, "{power}");
            for (weights, order) in [(&E5, 5), (&DIVIDED, 5), (&E3, 3)] {
                assert_eq!(weighted(weights, rate).abs() < 1e-14, power < order, "{power} in {weights:?}");
            }
        }
    }

    #[test]
    fn stages_are_where_their_weights_put_them() {
        let rows: [&[f64]; 11] = [&A2, &A3, &A4, &A5, &A6, &A7, &A8, &A9, &A10, &A11, &A12];
        for (row, node) in rows.into_iter().zip(NODES) {
            assert!((row.iter().sum::<f64>() - node).abs() < 1e-13, "{row:?}");
        }
    }

    #[test]
    fn no_place_of_a_kink_hides_its_error() {
        const PLACES: i32 = 4000;
        for place in (0..PLACES).map(|k| (f64::from(k) + 0.5) / f64::from(PLACES)) {
            let rate = |t: f64| (t - place).abs();
            let error = weighted(&B, rate) - 0.5 * (place.powi(2) + (1.0 - place).powi(2));
            let [of_5, divided, of_3] = [&E5, &DIVIDED, &E3].map(|weights| weighted(weights, rate).abs());
            let estimated = combined(of_5.max(divided), of_3);
            assert!(error.abs() < 6.0 * estimated, "{place}: {error:e} for {estimated:e}");
        }
    }

    #[test]
    fn it_is_stable_to_six_times_the_unit_on_the_imaginary_axis() {
        for k in 1..=59 {
            assert!(stability(Complex::new(0.0, 0.1 * f64::from(k))).norm() <= 1.0 + 1e-9, "{k}");
        }
        let z = Complex::new(0.2, 0.3);
        assert!((stability(z) - z.exp()).norm() < 1e-2 * z.norm().powi(9));
    }
}
