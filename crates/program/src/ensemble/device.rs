//! Devices of OpenCL, and the kernel on one of them.

use std::ptr;

use opencl3::command_queue::CommandQueue;
use opencl3::context::Context;
use opencl3::device::{CL_DEVICE_TYPE_ALL, CL_DEVICE_TYPE_GPU, Device as Handle};
use opencl3::error_codes::ClError;
use opencl3::kernel::{ExecuteKernel, Kernel};
use opencl3::memory::{Buffer, CL_MEM_READ_WRITE};
use opencl3::platform::{Platform, get_platforms};
use opencl3::program::Program;
use opencl3::types::CL_BLOCKING;

use super::{Columns, Grid};

/// Name of the environment variable that names a device.
const CHOSEN: &str = "ADAPTIVE_FMU_OPENCL";
/// Runs at a time for each compute unit of a graphics card, and of another device.
const RUNS_PER_UNIT: [usize; 2] = [256, 32];
/// Runs are a multiple of this, which groups of all devices fit into; the kernel skips those that aren't there.
const GROUP: usize = 64;
/// Options of the compiler: what all versions know, without its warnings.
const OPTIONS: &str = "-cl-std=CL1.2 -w";

/// A device with double precision.
#[derive(Debug)]
pub struct Device {
    handle: Handle,
    /// Its name.
    pub name: String,
    platform: String,
    /// True for a graphics card.
    pub is_gpu: bool,
    /// Number of runs that it takes at a time.
    pub runs: usize,
}

impl Device {
    /// The first graphics card with double precision, or the device that the environment names.
    ///
    /// # Errors
    /// When there is none, with what to do.
    pub fn find() -> Result<Self, String> {
        let chosen = std::env::var(CHOSEN).ok().filter(|name| !name.is_empty());
        Self::chosen(chosen.as_deref())
    }

    /// The first graphics card with double precision, or the first device of which name or platform contain a text.
    ///
    /// # Errors
    /// When there is none, with what to do.
    pub fn chosen(chosen: Option<&str>) -> Result<Self, String> {
        let kind = if chosen.is_some() { CL_DEVICE_TYPE_ALL } else { CL_DEVICE_TYPE_GPU };
        // Without a driver there is no library, or it knows no platform.
        let platforms = get_platforms().unwrap_or_default();
        let all = platforms.iter().flat_map(|platform| platform.get_devices(kind).unwrap_or_default());
        let all: Vec<_> = all.map(Handle::new).filter_map(Device::of).collect();
        let names = || all.iter().map(|device| device.name.as_str()).collect::<Vec<_>>().join(", ");
        let missing = match chosen {
            Some(name) if all.is_empty() => {
                format!("{CHOSEN}={name}: no driver has a device of OpenCL with double precision. Install the driver of the device")
            }
            Some(name) => {
                format!("{CHOSEN}={name}: no device of OpenCL with double precision is called so. There is {}", names())
            }
            None => {
                "there is no graphics card with OpenCL and double precision. Install the driver of your card, or use --backend cpu"
                    .to_owned()
            }
        };
        let wanted = chosen.unwrap_or_default().to_lowercase();
        let is_chosen =
            |device: &Device| [&device.name, &device.platform].iter().any(|it| it.to_lowercase().contains(&wanted));
        all.into_iter().find(is_chosen).ok_or(missing)
    }

    fn of(handle: Handle) -> Option<Self> {
        if handle.double_fp_config().unwrap_or_default() == 0 || !handle.available().unwrap_or_default() {
            return None;
        }
        let (name, is_gpu) = (handle.name().ok()?, handle.dev_type().ok()? & CL_DEVICE_TYPE_GPU != 0);
        let platform = handle.platform().and_then(|id| Platform::new(id).name()).unwrap_or_default();
        let units = handle.max_compute_units().ok()?.max(1) as usize;
        let runs = units * RUNS_PER_UNIT[usize::from(!is_gpu)];
        Some(Device { handle, name: name.trim().to_owned(), platform, is_gpu, runs })
    }
}

/// A compiled program on its device.
#[derive(Debug)]
pub struct Compiled {
    context: Context,
    queue: CommandQueue,
    kernel: Kernel,
    _program: Program,
}

/// Runs on a device.
#[derive(Debug)]
pub struct Batch<'a> {
    on: &'a Compiled,
    runs: usize,
    reals: Buffer<f64>,
    integers: Buffer<i32>,
    status: Buffer<i32>,
    change_at: Buffer<u32>,
    changed_reals: Buffer<f64>,
    changed_integers: Buffer<i32>,
    recorded: Buffer<f64>,
}

fn failed(error: ClError) -> String {
    format!("OpenCL: {error}")
}

impl Compiled {
    /// Compiles a program with one kernel.
    ///
    /// # Errors
    /// When the device or its compiler fails.
    pub fn new(device: &Device, text: &str, kernel: &str) -> Result<Self, String> {
        let context = Context::from_device(&device.handle).map_err(failed)?;
        // SAFETY: the context is alive, and no properties are given.
        let queue = CommandQueue::create_default(&context, 0).map_err(failed)?;
        let program = Program::create_and_build_from_source(&context, text, OPTIONS)
            .map_err(|log| format!("OpenCL: the program isn't compiled: {}", log.trim()))?;
        let kernel = Kernel::create(&program, kernel).map_err(failed)?;
        Ok(Compiled { context, queue, kernel, _program: program })
    }

    /// A buffer with these values; one value where there is none.
    fn buffer<T: Copy + Default>(&self, values: &[T]) -> Result<Buffer<T>, String> {
        let mut buffer = self.room(values.len())?;
        if !values.is_empty() {
            // SAFETY: the buffer has room for the values, and the call returns when they are written.
            unsafe { self.queue.enqueue_write_buffer(&mut buffer, CL_BLOCKING, 0, values, &[]) }.map_err(failed)?;
        }
        Ok(buffer)
    }

    fn room<T>(&self, count: usize) -> Result<Buffer<T>, String> {
        // SAFETY: the device allocates its own memory.
        unsafe { Buffer::create(&self.context, CL_MEM_READ_WRITE, count.max(1), ptr::null_mut()) }.map_err(failed)
    }

    /// Values of runs on the device, with room for so many recorded values.
    ///
    /// # Errors
    /// When it has too little memory.
    pub fn batch(
        &self,
        runs: usize,
        start: &Columns,
        (change_at, changed): (&[u32], &Columns),
        recorded: usize,
    ) -> Result<Batch<'_>, String> {
        Ok(Batch {
            on: self,
            runs,
            reals: self.buffer(&start.reals)?,
            integers: self.buffer(&start.integers)?,
            status: self.buffer(&vec![0; runs])?,
            change_at: self.buffer(change_at)?,
            changed_reals: self.buffer(&changed.reals)?,
            changed_integers: self.buffer(&changed.integers)?,
            recorded: self.room(recorded)?,
        })
    }
}

impl Batch<'_> {
    /// Takes so many communication steps of all runs from the first on, and reads what was recorded.
    ///
    /// # Errors
    /// When the device fails.
    pub fn advance(&self, first: usize, steps: usize, grid: &Grid, recorded: &mut [f64]) -> Result<(), String> {
        let [runs, first, steps, all, substeps] =
            [self.runs, first, steps, grid.steps, grid.substeps].map(|number| number as u32);
        let queue = &self.on.queue;
        let mut call = ExecuteKernel::new(&self.on.kernel);
        // SAFETY: these are the kernel's arguments in their order and of their types, and each buffer has a place for what
        // the kernel reads and writes of each run.
        unsafe {
            call.set_arg(&runs).set_arg(&first).set_arg(&steps).set_arg(&all);
            call.set_arg(&grid.start_time).set_arg(&grid.step).set_arg(&grid.stop_time).set_arg(&substeps);
            call.set_arg(&self.reals).set_arg(&self.integers).set_arg(&self.status).set_arg(&self.change_at);
            call.set_arg(&self.changed_reals).set_arg(&self.changed_integers).set_arg(&self.recorded);
            call.set_global_work_size(self.runs.next_multiple_of(GROUP)).enqueue_nd_range(queue).map_err(failed)?;
        }
        self.read(&self.recorded, recorded)
    }

    /// Why runs ended early, by the numbers of the kernel; 0 for the others.
    ///
    /// # Errors
    /// When the device fails.
    pub fn status(&self) -> Result<Vec<i32>, String> {
        let mut status = vec![0; self.runs];
        self.read(&self.status, &mut status).map(|()| status)
    }

    fn read<T>(&self, buffer: &Buffer<T>, values: &mut [T]) -> Result<(), String> {
        // SAFETY: the buffer has at least as many values, and the call returns when they are read.
        unsafe { self.on.queue.enqueue_read_buffer(buffer, CL_BLOCKING, 0, values, &[]) }.map(drop).map_err(failed)
    }
}
