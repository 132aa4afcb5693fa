//! Many runs of a loop at a time, on a graphics card: the loop as a single FMU, whose equations are recorded as OpenCL C. Runs take
//! fixed steps, and their parameters and start values are prepared on the processor.

#[cfg(not(target_family = "wasm"))]
#[allow(unsafe_code)]
mod device;
#[cfg(target_family = "wasm")]
mod nowhere;
mod prepared;

use std::panic::resume_unwind;
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

#[cfg(not(target_family = "wasm"))]
use device::Compiled;
#[cfg(not(target_family = "wasm"))]
pub use device::Device;
#[cfg(target_family = "wasm")]
use nowhere::Compiled;
#[cfg(target_family = "wasm")]
pub use nowhere::Device;
use prepared::Prepared;
pub use prepared::Start;

use crate::fmi2::source::ensemble::{Ensemble, KERNEL, Request};
use crate::fmu::Value;
use crate::simulation::{Change, LoadedLoop, Place, Recording};
use crate::structure::Settings;

/// Memory for recorded values of all runs, bytes.
const RECORDED: usize = 64 << 20;
/// A launch takes about so long: a display that the card serves stays usable.
const LAUNCH: Duration = Duration::from_millis(250);
/// A change that isn't due.
const NEVER: u32 = u32::MAX;

/// Start values of a run, and changes during it.
pub type Given = (Vec<(Place, Value)>, Vec<Change>);

/// Communication steps, and the fixed steps in each.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Number of communication steps.
    pub steps: usize,
    /// Start time, s.
    pub start_time: f64,
    /// Communication step, s.
    pub step: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Fixed steps in a communication step.
    pub substeps: usize,
}

/// Values of all runs: a column of each value, with an entry for each run.
#[derive(Debug, Clone, Default)]
struct Columns {
    reals: Vec<f64>,
    integers: Vec<i32>,
}

/// A loop that is compiled for a device.
#[derive(Debug)]
pub struct Runner {
    device: Device,
    compiled: Mutex<Compiled>,
    prepared: Prepared,
    ensemble: Ensemble,
    settings: Settings,
    /// Number of recorded signals.
    width: usize,
    bytes_of_start: usize,
}

/// Recorded values of all runs at consecutive points.
#[derive(Debug)]
pub struct Rows<'a> {
    width: usize,
    times: &'a [f64],
    runs: usize,
    values: &'a [f64],
}

impl Rows<'_> {
    /// Adds the points of a run to its recording, in which further columns may come behind those of the signals.
    pub fn add_to(&self, points: &mut Recording, run: usize) {
        let (width, rows) = (self.width, self.times.len());
        points.times.extend_from_slice(self.times);
        for (k, column) in points.columns.iter_mut().take(width).enumerate() {
            column.extend((0..rows).map(|row| self.values[(row * width + k) * self.runs + run]));
        }
    }
}

impl Runner {
    /// Compiles a loop for a device. `recorded` are the names of its signals that are recorded; the samples show which
    /// parameters are the same in all runs.
    ///
    /// # Errors
    /// Why runs of this loop must be made one by one.
    pub fn new(
        device: Device,
        loaded: &LoadedLoop,
        recorded: &[String],
        samples: &[Given],
        settings: Settings,
    ) -> Result<Self, String> {
        let mut prepared = Prepared::new(loaded, settings)?;
        samples.first().map_or(Ok(()), |(_, changes)| prepared.check(loaded, changes))?;
        let starts: Vec<Start> = samples.iter().filter_map(|(start, changes)| prepared.start(start, changes)).collect();
        let first = starts.first().ok_or("components refuse the first samples")?;
        prepared.settle(&starts);
        let slots = recorded.iter().map(|name| prepared.slot(loaded, name)).collect::<Result<Vec<_>, _>>()?;
        let request = Request {
            block: &first.block,
            settled: prepared.settled(),
            recorded: &slots,
            changes: first.changes.len(),
        };
        let ensemble = Ensemble::of(prepared.model(), &request).map_err(|error| error.to_string())?;
        let compiled = Mutex::new(Compiled::new(&device, &ensemble.text, KERNEL)?);
        let bytes_of_start = (8 * first.block.reals.len() + 4 * first.block.integers.len()) * (1 + first.changes.len());
        Ok(Runner { device, compiled, prepared, ensemble, settings, width: recorded.len(), bytes_of_start })
    }

    /// Memory for the values that a run starts with, bytes.
    pub fn bytes_of_start(&self) -> usize {
        self.bytes_of_start
    }

    /// Its device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The start of a run: none if a component refuses it, or it has other parameters than the program was compiled for.
    pub fn start(&self, values: &[(Place, Value)], changes: &[Change]) -> Option<Start> {
        self.prepared.start(values, changes).filter(|start| self.prepared.holds(start))
    }

    /// Runs from these starts. `take` gets all points in their order, and may end the runs by returning false.
    /// Returns true for each run that is complete; none if `take` ended them.
    ///
    /// # Errors
    /// When the device fails.
    pub fn run(
        &self,
        starts: &[Start],
        substeps: usize,
        mut take: impl FnMut(&Rows) -> bool + Send,
    ) -> Result<Option<Vec<bool>>, String> {
        let Settings { start_time, stop_time, step } = self.settings;
        let grid = Grid { steps: self.settings.steps(), start_time, step, stop_time, substeps };
        let (runs, width) = (starts.len(), self.width);
        let most = (RECORDED / (8 * runs * width.max(1))).clamp(1, grid.steps.max(1));
        let (start, change_at, changed) = self.columns(starts);
        let compiled = self.compiled.lock().unwrap_or_else(PoisonError::into_inner);
        let batch = compiled.batch(runs, &start, (&change_at, &changed), most * runs * width)?;
        let points: Vec<f64> = self.settings.points().map(|(_, next)| next).collect();
        let mut hand_out = |times: &[f64], values: &[f64]| take(&Rows { width, times, runs, values });
        let [mut values, mut further] = [(); 2].map(|()| vec![0.0; most * runs * width]);
        batch.advance(0, 0, &grid, &mut values[..runs * width])?;
        let (mut times, mut first, mut rows) = (&[start_time][..], 0, 1);
        while first < grid.steps {
            let (begun, steps) = (Instant::now(), rows.min(grid.steps - first));
            // The last points are taken while the device computes the next.
            let goes_on = thread::scope(|scope| {
                let known = &values[..times.len() * runs * width];
                let taken = scope.spawn(|| hand_out(times, known));
                let advanced = batch.advance(first, steps, &grid, &mut further[..steps * runs * width]);
                let goes_on = taken.join().unwrap_or_else(|panic| resume_unwind(panic));
                advanced.map(|()| goes_on)
            })?;
            if !goes_on {
                return Ok(None);
            }
            std::mem::swap(&mut values, &mut further);
            times = &points[first..first + steps];
            first += steps;
            let pace = LAUNCH.as_secs_f64() / begun.elapsed().as_secs_f64().max(1e-6);
            rows = ((steps as f64 * pace.clamp(0.25, 4.0)) as usize).clamp(1, most);
        }
        if !hand_out(times, &values[..times.len() * runs * width]) {
            return Ok(None);
        }
        Ok(Some(batch.status()?.into_iter().map(|status| status == 0).collect()))
    }

    /// Columns of runs: their starts, the numbers of the steps at which changes are due, and the values then.
    fn columns(&self, starts: &[Start]) -> (Columns, Vec<u32>, Columns) {
        let Ensemble { reals, integers, indicators, changed, .. } = &self.ensemble;
        let mut start = Columns::default();
        reals.iter().for_each(|&place| start.reals.extend(starts.iter().map(|of| of.block.reals[place])));
        integers.iter().for_each(|&place| start.integers.extend(starts.iter().map(|of| of.block.integers[place])));
        start.integers.resize(start.integers.len() + indicators * starts.len(), 0);
        let (mut change_at, mut values) = (Vec::new(), Columns::default());
        for number in 0..starts.first().map_or(0, |of| of.changes.len()) {
            let change = |of: &'_ Start| of.changes[number].clone();
            change_at.extend(starts.iter().map(|of| change(of).0.unwrap_or(NEVER)));
            let blocks: Vec<_> = starts.iter().map(|of| &of.changes[number].1).collect();
            changed.0.iter().for_each(|&place| values.reals.extend(blocks.iter().map(|block| block.reals[place])));
            changed
                .1
                .iter()
                .for_each(|&place| values.integers.extend(blocks.iter().map(|block| block.integers[place])));
        }
        (start, change_at, values)
    }
}
