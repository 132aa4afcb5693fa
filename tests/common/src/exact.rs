//! The solution of a unit's equations over one communication step, as accurately as it can be had.
//!
//! It shares the equations with the integration under test, and nothing else: an instance in model exchange, Gragg's
//! method with extrapolation (no Runge-Kutta coefficients, no Jacobian, no closed form, another control of order and
//! step), and events found by bisection.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::model::{Block, Model};
use adaptive_fmu::system::Section;

use super::described::model;

/// Rows of the extrapolation table, of 2, 4, 6 … substeps.
const ROWS: usize = 8;
/// Row of the table from which on a step was long enough.
const LATE: usize = ROWS - 2;
/// The least number of steps: none strides over what happens within.
const LEAST_STEPS: f64 = 16.0;
/// Beyond this number of steps a solution isn't worth its time.
const MOST_STEPS: usize = 400_000;
/// Width of the bracket in which an event is found, as a part of a step.
const BRACKET: f64 = 1e-12;

/// Problem to solve.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// All values, with the inputs set.
    pub block: &'a Block,
    pub time: f64,
    pub step: f64,
    /// Rates of the real inputs.
    pub slopes: &'a [f64],
    /// Relative to a state's magnitude, or its nominal value where that is larger.
    pub tolerance: f64,
    /// Changes of the states, and the part of the way at which they occur.
    pub moved: Option<(f64, &'a [f64])>,
}

/// Solves the equations of one unit.
pub struct Exact {
    model: Model,
    execution: Execution,
    nominals: Vec<f64>,
}

impl Exact {
    pub fn new(text: &str) -> Self {
        let execution = Execution::new(model(text).unwrap());
        let nominals = execution.nominals().to_vec();
        Exact { model: model(text).unwrap(), execution, nominals }
    }

    /// Returns the end, or the reason why there is none.
    pub fn solve(&mut self, task: &Task) -> Result<Block, String> {
        let (t0, t1) = (task.time, task.time + task.step);
        self.execution.block_mut().copy_from(task.block);
        let mut next = self.settle(task, t0)?;
        if let Some((part, moved)) = task.moved {
            let middle = t0 + part * task.step;
            self.integrate(task, (t0, middle), next)?;
            let states: Vec<_> = self.execution.states().iter().zip(moved).map(|(x, moved)| x + moved).collect();
            self.place(task, middle, &states);
            next = self.settle(task, middle)?;
            self.integrate(task, (middle, t1), next)?;
        } else {
            self.integrate(task, (t0, t1), next)?;
        }
        self.execution.evaluate();
        // A system detects a step when its inputs read back the values that were set.
        let inputs = self.model.variables().reals(Section::Input);
        self.execution.block_mut().reals[inputs.clone()].copy_from_slice(&task.block.reals[inputs]);
        let mut point = self.execution.point();
        self.model.equations().step_completed(t1, task.step, &mut point);
        Ok(self.execution.block().clone())
    }

    fn place(&mut self, task: &Task, t: f64, states: &[f64]) {
        let inputs = self.model.variables().reals(Section::Input);
        let set = task.block.reals[inputs.clone()].iter().zip(task.slopes);
        for (input, (value, slope)) in self.execution.block_mut().reals[inputs].iter_mut().zip(set) {
            *input = value + slope * (t - task.time);
        }
        self.execution.set_time(t);
        self.execution.set_states(states);
    }

    /// Handles the events at t until nothing changes any more; the next time event.
    fn settle(&mut self, task: &Task, t: f64) -> Result<f64, String> {
        let states = self.execution.states().to_vec();
        self.place(task, t, &states);
        loop {
            let update = self.execution.update_discrete().map_err(|error| error.to_string())?;
            if !update.changed {
                self.execution.end_event();
                return Ok(update.next_time_event.unwrap_or(f64::INFINITY));
            }
        }
    }

    fn indicators(&mut self) -> Vec<f64> {
        self.execution.event_indicators().to_vec()
    }

    fn integrate(&mut self, task: &Task, (mut t, end): (f64, f64), mut next: f64) -> Result<(), String> {
        let longest = (end - t) / LEAST_STEPS;
        let mut suggested = longest;
        for _ in 0..MOST_STEPS {
            if t >= end {
                return Ok(());
            }
            let (start, before, target) = (self.execution.states().to_vec(), self.indicators(), next.min(end));
            let first = if suggested < 0.999 * (target - t) { suggested } else { target - t };
            let (states, mut h, row) = self.step(task, t, &start, first)?;
            suggested = longest.min(if row < LATE { 2.0 * h } else { h });
            let mut arrived = if h == target - t { target } else { t + h };
            self.place(task, arrived, &states);
            let crossed = crossed(&before, &self.indicators());
            if crossed {
                h = self.locate(task, t, (&start, &before), h)?;
                arrived = t + h;
            }
            t = arrived;
            if crossed || t >= next {
                next = self.settle(task, t)?;
            }
        }
        Err(format!("{MOST_STEPS} steps lead to t = {t} only"))
    }

    /// The states after a step of this length or less, its length, and the row in which they converged.
    fn step(&mut self, task: &Task, t: f64, start: &[f64], mut h: f64) -> Result<(Vec<f64>, f64, usize), String> {
        while t + h > t {
            if let Some((states, row)) = self.extrapolated(task, t, start, h) {
                return Ok((states, h, row));
            }
            h *= 0.4;
        }
        Err(format!("no step is short enough at t = {t}"))
    }

    /// Moves to just behind the first event within h; how far that is.
    fn locate(&mut self, task: &Task, t: f64, (start, before): (&[f64], &[f64]), mut high: f64) -> Result<f64, String> {
        let (mut low, width) = (0.0, BRACKET * high);
        loop {
            let done = high - low <= width || t + 0.5 * (low + high) <= t + low;
            let h = if done { high } else { 0.5 * (low + high) };
            let (states, _) = self.extrapolated(task, t, start, h).ok_or("an event that no step reaches")?;
            self.place(task, t + h, &states);
            if done {
                return Ok(h);
            }
            if crossed(before, &self.indicators()) { high = h } else { low = h }
        }
    }

    /// The states after h, and the row in which they converged; none where they don't.
    fn extrapolated(&mut self, task: &Task, t: f64, start: &[f64], h: f64) -> Option<(Vec<f64>, usize)> {
        self.place(task, t, start);
        let rates = self.execution.derivatives().to_vec();
        let mut above: Vec<Vec<f64>> = Vec::new();
        for k in 0..ROWS {
            let mut row = vec![self.midpoint(task, t, (start, &rates), h, 2 * (k + 1))];
            for j in 0..k {
                let ratio = ((k + 1) as f64 / (k - j) as f64).powi(2) - 1.0;
                let better = row[j].iter().zip(&above[j]).map(|(fine, coarse)| fine + (fine - coarse) / ratio);
                row.push(better.collect());
            }
            // Two rows may agree by chance.
            if k > 1 && self.agree(task.tolerance, start, &row[k], &row[k - 1]) {
                return Some((row.swap_remove(k), k));
            }
            above = row;
        }
        None
    }

    fn agree(&self, tolerance: f64, start: &[f64], a: &[f64], b: &[f64]) -> bool {
        let magnitudes = start.iter().zip(&self.nominals).map(|(x, nominal)| nominal.max(x.abs()));
        a.iter().zip(b).zip(magnitudes).all(|((a, b), magnitude)| (a - b).abs() <= tolerance * magnitude.max(a.abs()))
    }

    /// Gragg's method: so many substeps by the midpoint rule.
    fn midpoint(&mut self, task: &Task, t: f64, (start, rates): (&[f64], &[f64]), h: f64, substeps: usize) -> Vec<f64> {
        let h = h / substeps as f64;
        let advance = |x: &[f64], k: &[f64], h: f64| x.iter().zip(k).map(|(x, k)| x + h * k).collect::<Vec<_>>();
        let (mut before, mut x) = (start.to_vec(), advance(start, rates, h));
        for k in 1..substeps {
            self.place(task, t + k as f64 * h, &x);
            let after = advance(&before, self.execution.derivatives(), 2.0 * h);
            (before, x) = (x, after);
        }
        x
    }
}

/// True if an indicator changed its sign, or became zero.
fn crossed(before: &[f64], after: &[f64]) -> bool {
    before.iter().zip(after).any(|(before, after)| before * after < 0.0 || (*before != 0.0 && *after == 0.0))
}
