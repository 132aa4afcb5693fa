//! Records of simulated plants, by means other than those of the package: nalgebra's matrix exponential.
#![allow(dead_code)] // each test program uses some of it

use adaptive_fmu_identification::{
    Cause, Finding, Identified, Kind, Options, Record, Refusal, Signals, identify_outputs, identify_states,
};
use nalgebra::{DMatrix, DVector};

/// Random numbers from a seed (splitmix64).
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform between two numbers.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        let (u, v) = (self.uniform(1e-300, 1.0), self.uniform(0.0, 1.0));
        (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    }

    /// Piecewise constant levels for random times of at most `longest` rows.
    pub fn levels(&mut self, rows: usize, longest: usize) -> Vec<f64> {
        let mut all = Vec::new();
        while all.len() < rows {
            let level = self.uniform(-1.0, 1.0);
            let length = 2 + self.next() as usize % longest;
            all.extend(std::iter::repeat_n(level, length));
        }
        all.truncate(rows);
        all
    }
}

/// x' = A x + B u + d.
#[derive(Clone)]
pub struct Plant {
    pub a: DMatrix<f64>,
    pub b: DMatrix<f64>,
    pub d: DVector<f64>,
}

impl Plant {
    pub fn new(n: usize, m: usize, a: &[f64], b: &[f64], d: &[f64]) -> Self {
        let (a, b) = (DMatrix::from_row_slice(n, n, a), DMatrix::from_row_slice(n, m, b));
        Plant { a, b, d: DVector::from_column_slice(d) }
    }

    /// A random one with distinct poles between 0.3 and 3 rad/s, coupled, with units far apart.
    pub fn random(random: &mut Random, n: usize, m: usize) -> Self {
        let mut a = DMatrix::from_fn(n, n, |_, _| random.uniform(-0.3, 0.3));
        for i in 0..n {
            a[(i, i)] = -0.4 - 0.45 * i as f64;
            if i % 2 == 1 {
                a[(i, i - 1)] = 1.2;
                a[(i - 1, i)] = -1.2;
            }
        }
        let units = DVector::from_fn(n, |_, _| 10.0_f64.powf(random.uniform(-1.0, 1.0)));
        let a = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * units[i] / units[j]);
        let b = DMatrix::from_fn(n, m, |i, _| units[i] * random.uniform(0.5, 1.5));
        let d = DVector::from_fn(n, |i, _| units[i] * random.uniform(-0.2, 0.2));
        Plant { a, b, d }
    }

    /// An oscillator with position and speed: ω = 2 rad/s, damping ratio 0.25, and friction as a constant.
    pub fn oscillator() -> Self {
        Plant::new(2, 1, &[0.0, 1.0, -4.0, -1.0], &[0.0, 4.0], &[0.0, 0.3])
    }

    /// F and [G, Φ d] of a step.
    fn step(&self, h: f64) -> [DMatrix<f64>; 2] {
        let (n, m) = self.b.shape();
        let mut whole = DMatrix::zeros(n + m + 1, n + m + 1);
        whole.view_mut((0, 0), (n, n)).copy_from(&(&self.a * h));
        whole.view_mut((0, n), (n, m)).copy_from(&(&self.b * h));
        whole.view_mut((0, n + m), (n, 1)).copy_from(&(&self.d * h));
        let whole = whole.exp();
        [whole.view((0, 0), (n, n)).into_owned(), whole.view((0, n), (n, m + 1)).into_owned()]
    }

    /// States at these times from an initial state, with a zero-order hold of the inputs.
    pub fn simulate(&self, time: &[f64], u: &[Vec<f64>], start: &[f64]) -> Vec<Vec<f64>> {
        let mut x = DVector::from_column_slice(start);
        let mut all = vec![Vec::new(); start.len()];
        let mut steps: Vec<(f64, [DMatrix<f64>; 2])> = Vec::new();
        for k in 0..time.len() {
            all.iter_mut().zip(x.iter()).for_each(|(column, value)| column.push(*value));
            if k + 1 < time.len() {
                let h = time[k + 1] - time[k];
                if !steps.iter().any(|(known, _)| *known == h) {
                    steps.push((h, self.step(h)));
                }
                let [f, g] = &steps.iter().find(|(known, _)| *known == h).unwrap().1;
                let input = DVector::from_iterator(u.len() + 1, u.iter().map(|column| column[k]).chain([1.0]));
                x = f * x + g * input;
            }
        }
        all
    }
}

/// Times with one step.
pub fn times(rows: usize, h: f64) -> Vec<f64> {
    (0..rows).map(|k| k as f64 * h).collect()
}

/// Adds white noise in parts of each signal's standard deviation.
pub fn noisy(random: &mut Random, columns: &mut [Vec<f64>], part: f64) {
    for column in columns {
        let mean = column.iter().sum::<f64>() / column.len() as f64;
        let variance = column.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / column.len() as f64;
        column.iter_mut().for_each(|value| *value += part * variance.sqrt() * random.normal());
    }
}

/// Names `x1`, `x2`, ….
pub fn names(letter: &str, count: usize) -> Vec<String> {
    (1..=count).map(|k| format!("{letter}{k}")).collect()
}

/// A record of columns u1 … and x1 ….
pub fn record(time: Vec<f64>, u: &[Vec<f64>], x: &[Vec<f64>]) -> Record {
    let inputs = names("u", u.len()).into_iter().zip(u.iter().cloned());
    let states = names("x", x.len()).into_iter().zip(x.iter().cloned());
    Record::new("record", time, inputs.chain(states).collect())
}

/// The signals of such a record.
pub fn signals(m: usize, n: usize) -> Signals {
    Signals { inputs: names("u", m), measured: names("x", n) }
}

/// Kinds of the findings that are about faults: not proposals, and not how residuals look.
pub fn kinds(identified: &Identified) -> Vec<Kind> {
    let faults = |finding: &&Finding| !matches!(finding.kind, Kind::Kinematics | Kind::ColouredResiduals);
    let mut kinds: Vec<Kind> = identified.findings.iter().filter(faults).map(|finding| finding.kind).collect();
    kinds.dedup();
    kinds
}

/// The text of the first finding of a kind.
pub fn text(identified: &Identified, kind: Kind) -> &str {
    identified.findings.iter().find(|finding| finding.kind == kind).map_or("", |finding| &finding.text)
}

/// A result that must be one.
pub fn good(result: Result<Identified, Refusal>) -> Identified {
    result.unwrap_or_else(|refusal| panic!("{refusal}"))
}

/// Rows and step of records.
pub const ROWS: usize = 800;
/// Their step, s.
pub const STEP: f64 = 0.05;

/// A record without any fault, as columns.
pub struct Columns {
    pub time: Vec<f64>,
    pub u: Vec<Vec<f64>>,
    pub x: Vec<Vec<f64>>,
}

impl Columns {
    pub fn record(self) -> Record {
        record(self.time, &self.u, &self.x)
    }
}

/// A record of a plant with noise, from rest.
pub fn columns_of(plant: &Plant, seed: u64, u: Vec<Vec<f64>>) -> Columns {
    let time = times(u[0].len(), STEP);
    let mut x = plant.simulate(&time, &u, &vec![0.0; plant.a.nrows()]);
    noisy(&mut Random(seed + 100), &mut x, 0.02);
    Columns { time, u, x }
}

/// A record of an oscillator without any fault.
pub fn columns(seed: u64) -> Columns {
    let mut random = Random(seed);
    columns_of(&Plant::oscillator(), seed, vec![random.levels(ROWS, 40)])
}

/// Identifies with default options.
pub fn identify(record: Record) -> Result<Identified, Refusal> {
    identify_with(record, &Options::default())
}

/// Identifies the states of a record.
pub fn identify_with(record: Record, options: &Options) -> Result<Identified, Refusal> {
    let count = |letter: &str| record.columns.iter().filter(|column| column.name.starts_with(letter)).count();
    let signals = signals(count("u"), count("x"));
    identify_states(&[record], None, &signals, options)
}

/// Cause and text of a refusal.
pub fn refusal(result: Result<Identified, Refusal>) -> (Cause, String) {
    let refusal = result.expect_err("a refusal");
    (refusal.cause, refusal.text)
}

/// Identifies only the first signal, as an output.
pub fn of_output(records: &[Record], held_out: Option<&[Record]>, options: &Options) -> Result<Identified, Refusal> {
    identify_outputs(records, held_out, &signals(1, 1), options)
}
