//! Steps that are taken in one go: a single component without connections, as a loop that is one system, depends on nothing
//! that happens at its communication points.

use crate::error::Error;
use crate::fmu::Instance;

/// The fewest and the most steps in one go. Compiled equations, and the end of a run, are looked for in between.
const FEWEST: usize = 8;
const MOST: usize = 1024;

/// Values of a component at the communication points ahead.
#[derive(Debug, Default)]
pub(super) struct Ahead {
    references: Vec<u32>,
    times: Vec<f64>,
    rows: Vec<f64>,
    /// Number of steps that were taken, and of those whose values were used.
    taken: usize,
    used: usize,
    /// Steps in the next go.
    steps: usize,
    /// Steps that are left to be taken one by one.
    singly: usize,
}

impl Ahead {
    /// For a component, by the references of what is recorded of it.
    pub fn of(references: Vec<u32>) -> Self {
        Ahead { references, steps: FEWEST, ..Ahead::default() }
    }

    /// Writes the values behind the next step into the row. Returns false if the step is to be taken by itself. `times` are those
    /// of the points to which nothing changes, from the present one on.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn step(
        &mut self,
        instance: &mut Instance,
        times: impl Iterator<Item = f64>,
        row: &mut [f64],
    ) -> Result<bool, Error> {
        if self.used == self.taken && !self.take(instance, times) {
            return Ok(false);
        }
        let width = self.references.len();
        row.copy_from_slice(&self.rows[self.used * width..][..width]);
        instance.stepped(self.times[self.used], &self.references, row)?;
        self.used += 1;
        Ok(true)
    }

    /// Takes the next steps. Returns false if none was taken.
    fn take(&mut self, instance: &mut Instance, times: impl Iterator<Item = f64>) -> bool {
        (self.taken, self.used) = (0, 0);
        if self.singly > 0 {
            self.singly -= 1;
            return false;
        }
        self.times.clear();
        self.times.extend(times.take(self.steps + 1));
        let steps = self.times.len() - 1;
        self.rows.resize(steps * self.references.len(), 0.0);
        self.taken = instance.do_steps(&self.times, &self.references, &mut self.rows);
        if self.taken == 0 {
            (self.steps, self.singly) = (FEWEST, FEWEST - 1);
            return false;
        }
        self.steps = (2 * self.steps).min(MOST);
        true
    }
}
