//! Equations that a host compiled from their recording. They evaluate an instance in place of the generic ones, with
//! the same bits.
//!
//! A kernel belongs to a model and knows the places of its block. It reads all parameters, or is for some values of them
//! only. Whoever provides it must make sure that its code stays in memory as long as the instance.
#![allow(unsafe_code)]

use serde::{Deserialize, Serialize};

use crate::system::{Section, Variables};

/// Version of the kernel and of the functions that it is compiled from; any other is refused.
pub const VERSION: u32 = 5;

/// Writes signals, or signals and rates, of a block: time, reals, integers.
pub type Evaluate = unsafe extern "C" fn(f64, *mut f64, *const i32);
/// Writes the Jacobian by its pattern, column by column, and the rates' change by time: time, reals, integers, slopes of
/// the inputs or null, and where the two go.
pub type Differentiate = unsafe extern "C" fn(f64, *const f64, *const i32, *const f64, *mut f64, *mut f64);
/// Decomposes a multiple of the identity less the Jacobian whose entries are given, and writes the factors; 0 where that would
/// be inaccurate.
pub type Decompose = unsafe extern "C" fn(f64, *const f64, *mut f64) -> i32;
/// Replaces a right-hand side by the solution, by such factors.
pub type Solve = unsafe extern "C" fn(*const f64, *mut f64);
/// Compares a block with the values that code was compiled for: reals, integers. Returns 0 if one differs.
pub type Holds = unsafe extern "C" fn(*const f64, *const i32) -> i32;

/// Sizes of the model that a kernel is for.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sizes {
    /// Real values of the block.
    pub reals: u32,
    /// Integers of the block.
    pub integers: u32,
    /// Real inputs.
    pub inputs: u32,
    /// States.
    pub states: u32,
    /// Entries of the Jacobian's pattern.
    pub entries: u32,
    /// Numbers of a decomposition.
    pub factors: u32,
}

impl Sizes {
    /// Sizes of a system with this number of entries in its Jacobian's pattern, without a decomposition.
    pub fn of(variables: &Variables, entries: usize) -> Self {
        Sizes {
            reals: variables.reals(Section::Memory).end as u32,
            integers: variables.integers(Section::Memory).end as u32,
            inputs: variables.reals(Section::Input).len() as u32,
            states: variables.states() as u32,
            entries: entries as u32,
            factors: 0,
        }
    }
}

/// Functions of a kernel.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Code {
    /// Writes signals.
    pub outputs: Evaluate,
    /// Writes signals and rates.
    pub evaluate: Evaluate,
    /// None where the Jacobian has too many operations to be written out.
    pub jacobian: Option<Differentiate>,
    /// None where the elimination has too many, or isn't worth it.
    pub decompose: Option<Decompose>,
    /// There where that is.
    pub solve: Option<Solve>,
    /// None where the code is for any parameters.
    pub holds: Option<Holds>,
}

/// Compiled equations, and the sizes of the block that they are for.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    version: u32,
    sizes: Sizes,
    code: Code,
}

impl Kernel {
    /// Wraps code that was compiled for these sizes.
    ///
    /// # Safety
    /// The code reads and writes within these sizes only, and stays in memory as long as the kernel is used.
    pub unsafe fn new(sizes: Sizes, code: Code) -> Self {
        Kernel { version: VERSION, sizes, code }
    }

    /// True if it is one of a system with these variables and this number of entries in its Jacobian's pattern.
    pub fn fits(&self, variables: &Variables, entries: usize) -> bool {
        let needed = Sizes { factors: self.sizes.factors, ..Sizes::of(variables, entries) };
        self.version == VERSION && self.sizes == needed
    }

    fn check(&self, reals: &[f64], integers: &[i32]) {
        assert!(
            reals.len() >= self.sizes.reals as usize && integers.len() >= self.sizes.integers as usize,
            "a block of its model"
        );
    }

    /// True if a block has the values that it was compiled for.
    #[inline]
    pub fn holds(&self, reals: &[f64], integers: &[i32]) -> bool {
        self.check(reals, integers);
        // SAFETY: the block has the sizes that it was compiled for, and it reads within them.
        self.code.holds.is_none_or(|holds| unsafe { holds(reals.as_ptr(), integers.as_ptr()) != 0 })
    }

    /// Writes the signals of a block.
    #[inline]
    pub fn outputs(&self, t: f64, reals: &mut [f64], integers: &[i32]) {
        self.check(reals, integers);
        // SAFETY: the block has the sizes that it was compiled for, and it writes within them.
        unsafe { (self.code.outputs)(t, reals.as_mut_ptr(), integers.as_ptr()) }
    }

    /// Writes the signals and the rates of a block.
    #[inline]
    pub fn evaluate(&self, t: f64, reals: &mut [f64], integers: &[i32]) {
        self.check(reals, integers);
        // SAFETY: as above.
        unsafe { (self.code.evaluate)(t, reals.as_mut_ptr(), integers.as_ptr()) }
    }

    /// Writes the entries of the Jacobian, column by column, and the rates' change by time, with inputs that move if
    /// slopes are given. Returns true if it can.
    pub fn jacobian(
        &self,
        t: f64,
        (reals, integers): (&[f64], &[i32]),
        slopes: Option<&[f64]>,
        entries: &mut [f64],
        by_time: &mut [f64],
    ) -> bool {
        let Some(jacobian) = self.code.jacobian else { return false };
        self.check(reals, integers);
        assert!(entries.len() >= self.sizes.entries as usize && by_time.len() >= self.sizes.states as usize);
        assert!(slopes.is_none_or(|slopes| slopes.len() >= self.sizes.inputs as usize));
        let slopes = slopes.map_or(std::ptr::null(), <[f64]>::as_ptr);
        let (values, places) = (reals.as_ptr(), integers.as_ptr());
        // SAFETY: as above, and so have the places where results go.
        unsafe { jacobian(t, values, places, slopes, entries.as_mut_ptr(), by_time.as_mut_ptr()) }
        true
    }

    /// Number of the decomposition's factors; none without a decomposition.
    pub fn factors(&self) -> Option<usize> {
        self.code.decompose.and(self.code.solve).map(|_| self.sizes.factors as usize)
    }

    /// Decomposes `diagonal` I less the Jacobian of these entries. Returns true if the result is accurate.
    pub fn decompose(&self, diagonal: f64, entries: &[f64], factors: &mut [f64]) -> bool {
        assert!(entries.len() >= self.sizes.entries as usize && factors.len() >= self.sizes.factors as usize);
        // SAFETY: both have the sizes that it was compiled for.
        self.code
            .decompose
            .is_some_and(|decompose| unsafe { decompose(diagonal, entries.as_ptr(), factors.as_mut_ptr()) != 0 })
    }

    /// Replaces b by the solution, by the factors of a decomposition.
    #[inline]
    pub fn solve(&self, factors: &[f64], b: &mut [f64]) {
        assert!(factors.len() >= self.sizes.factors as usize && b.len() >= self.sizes.states as usize);
        if let Some(solve) = self.code.solve {
            // SAFETY: as above.
            unsafe { solve(factors.as_ptr(), b.as_mut_ptr()) }
        }
    }
}
