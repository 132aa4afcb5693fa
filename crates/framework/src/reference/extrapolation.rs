//! Extrapolation of the modified midpoint rule (Gragg; Bulirsch and Stoer), of variable order up to 16, as Hairer, Nørsett and Wanner,
//! *Solving Ordinary Differential Equations I*, section II.9, have it. No FMU integrates itself by it, so that it is a witness of its own.

/// Substeps of the columns: the harmonic sequence.
const SUBSTEPS: [usize; 8] = [2, 4, 6, 8, 10, 12, 14, 16];
/// Columns.
const COLUMNS: usize = SUBSTEPS.len();
/// Parts of the step that the error allows, and bounds of a change of its length.
const CAUTION: f64 = 0.9;
const SHRINK: f64 = 0.05;
const GROW: f64 = 4.0;

/// Rates of the states at a time: the equations.
pub(super) trait Rates {
    /// Puts the rates at a time and states into their place; false where the work is spent.
    fn rates(&mut self, t: f64, states: &[f64], rates: &mut [f64]) -> bool;
}

/// The reason why a step can't be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stuck {
    /// Its work is spent.
    Work,
    /// No step is short enough.
    Short,
}

/// The method: its tolerance, its memory, and the length that it would try next.
pub(super) struct Extrapolation {
    tolerance: f64,
    nominals: Vec<f64>,
    /// Length of the next step that is tried, s; 0 before the first.
    next: f64,
    /// The columns: the last row of the table, from the first to the highest order.
    row: Vec<Vec<f64>>,
    /// Two points of the midpoint rule, the rates there, and those at the start.
    points: [Vec<f64>; 2],
    rates: Vec<f64>,
    first: Vec<f64>,
}

impl Extrapolation {
    /// Creates it for states of these magnitudes, with a bound on the error of each step relative to state or magnitude.
    pub fn new(nominals: &[f64], tolerance: f64) -> Self {
        let zeros = vec![0.0; nominals.len()];
        Extrapolation {
            tolerance,
            nominals: nominals.to_vec(),
            next: 0.0,
            row: vec![zeros.clone(); COLUMNS],
            points: [zeros.clone(), zeros.clone()],
            rates: zeros.clone(),
            first: zeros,
        }
    }

    /// Forgets the length of the next step: behind an event the motion is another.
    pub fn restart(&mut self) {
        self.next = 0.0;
    }

    /// Takes a step from t of at most `most`, s, and returns its length. The states are then those at its end.
    ///
    /// # Errors
    /// When there is none.
    pub fn step(&mut self, problem: &mut dyn Rates, t: f64, most: f64, states: &mut [f64]) -> Result<f64, Stuck> {
        if !problem.rates(t, states, &mut self.first) {
            return Err(Stuck::Work);
        }
        if self.next <= 0.0 {
            self.next = self.begun(states).min(most);
        }
        loop {
            let length = self.next.min(most);
            if length <= 1e-14 * t.abs().max(most) {
                return Err(Stuck::Short);
            }
            let (accepted, factor) = self.tried(problem, t, length, states)?;
            let Some(column) = accepted else {
                self.next = length * factor;
                continue;
            };
            // A step that was cut short for its end is no measure of the next one.
            self.next = if length < self.next { self.next.max(length * factor) } else { length * factor };
            states.copy_from_slice(&self.row[column]);
            return Ok(length);
        }
    }

    /// A step of exactly this length by the same rule, as accurate as its columns make it: part of one that was accepted.
    ///
    /// # Errors
    /// As [`Extrapolation::step`].
    pub fn part(&mut self, problem: &mut dyn Rates, t: f64, length: f64, states: &mut [f64]) -> Result<(), Stuck> {
        if !problem.rates(t, states, &mut self.first) {
            return Err(Stuck::Work);
        }
        let (accepted, _) = self.tried(problem, t, length, states)?;
        states.copy_from_slice(&self.row[accepted.unwrap_or(COLUMNS - 1)]);
        Ok(())
    }

    /// The length that the first step is tried with: along the rates states change by a hundredth of their magnitudes.
    fn begun(&self, states: &[f64]) -> f64 {
        let speed = self.first.iter().zip(states).zip(&self.nominals);
        let speed = speed.map(|((rate, state), nominal)| rate.abs() / state.abs().max(*nominal)).fold(0.0, f64::max);
        if speed > 0.0 { 0.01 / speed } else { f64::INFINITY }
    }

    /// Fills the table until it is accurate enough; the column, where one is, and by how much the next step differs in length.
    fn tried(
        &mut self,
        problem: &mut dyn Rates,
        t: f64,
        length: f64,
        states: &[f64],
    ) -> Result<(Option<usize>, f64), Stuck> {
        let (mut work, mut best) = (1.0, (f64::INFINITY, SHRINK));
        for (column, substeps) in SUBSTEPS.into_iter().enumerate() {
            self.midpoint(problem, t, length, states, substeps)?;
            work += substeps as f64;
            let error = self.extrapolated(column, states);
            if column == 0 {
                continue;
            }
            let order = (2 * column + 1) as f64;
            let factor = (CAUTION * (0.5 / error.max(1e-30)).powf(1.0 / order)).clamp(SHRINK, GROW);
            let factor = if error.is_finite() { factor } else { SHRINK };
            // The column with the least work for the way that it makes.
            if work / factor < best.0 {
                best = (work / factor, factor);
            }
            if error <= 1.0 {
                return Ok((Some(column), best.1));
            }
        }
        Ok((None, best.1.min(CAUTION)))
    }

    /// Puts the midpoint rule's result, smoothed, into its first point.
    fn midpoint(
        &mut self,
        problem: &mut dyn Rates,
        t: f64,
        length: f64,
        states: &[f64],
        substeps: usize,
    ) -> Result<(), Stuck> {
        let h = length / substeps as f64;
        let [before, now] = &mut self.points;
        before.copy_from_slice(states);
        now.iter_mut().zip(states).zip(&self.first).for_each(|((now, state), rate)| *now = state + h * rate);
        for k in 1..=substeps {
            if !problem.rates(t + k as f64 * h, now, &mut self.rates) {
                return Err(Stuck::Work);
            }
            if k == substeps {
                break;
            }
            before.iter_mut().zip(&self.rates).for_each(|(before, rate)| *before += 2.0 * h * rate);
            std::mem::swap(before, now);
        }
        let ends = before.iter_mut().zip(now.iter().zip(&self.rates));
        ends.for_each(|(before, (now, rate))| *before = 0.5 * (*before + now + h * rate));
        Ok(())
    }

    /// Takes the midpoint rule's result into the table (Aitken and Neville); the error of its highest order, in parts of the tolerance.
    fn extrapolated(&mut self, column: usize, states: &[f64]) -> f64 {
        let Extrapolation { tolerance, nominals, row, points: [result, _], .. } = self;
        let mut worst = 0.0_f64;
        for i in 0..states.len() {
            // Of the row before: one order lower at each place.
            let (mut value, mut lower) = (result[i], row[0][i]);
            row[0][i] = value;
            let mut error = 0.0;
            for j in 1..=column {
                let ratio = SUBSTEPS[column] as f64 / SUBSTEPS[column - j] as f64;
                error = (value - lower) / (ratio * ratio - 1.0);
                value += error;
                lower = std::mem::replace(&mut row[j][i], value);
            }
            let scale = *tolerance * states[i].abs().max(value.abs()).max(nominals[i]);
            let part = (error / scale).abs();
            worst = if part.is_nan() { f64::INFINITY } else { worst.max(part) };
        }
        worst
    }
}
