//! Equations that a compiler made of their C: what evaluates an instance in place of the generic ones, with the same bits.
//!
//! A kernel belongs to a model: it knows the places of its block, and takes parameters as they stand there. Who hands it
//! over sees to it that its code stays in memory as long as the instance.
#![allow(unsafe_code)]

use crate::system::{Section, Variables};

/// The version of what a kernel is; another is refused.
pub const VERSION: u32 = 2;

/// Writes signals, or signals and rates, of a block: time, reals, integers.
type Evaluate = unsafe extern "C" fn(f64, *mut f64, *const i32);
/// Writes the Jacobian by its pattern, column by column, and the rates' change by time: time, reals, integers, slopes of
/// the inputs or null, and where the two go.
type Differentiate = unsafe extern "C" fn(f64, *const f64, *const i32, *const f64, *mut f64, *mut f64);

/// Decomposes a multiple of the identity less the Jacobian whose entries are given, and writes the factors; 0 where that would
/// be inaccurate.
type Decompose = unsafe extern "C" fn(f64, *const f64, *mut f64) -> i32;
/// Replaces a right-hand side by the solution, by such factors.
type Solve = unsafe extern "C" fn(*const f64, *mut f64);

/// Compiled equations, and the sizes of the block that they are for.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    version: u32,
    reals: u32,
    integers: u32,
    inputs: u32,
    states: u32,
    /// Entries of the Jacobian's pattern.
    entries: u32,
    /// Numbers of a decomposition.
    factors: u32,
    outputs: Evaluate,
    evaluate: Evaluate,
    /// None where the Jacobian has too many operations to be written out.
    jacobian: Option<Differentiate>,
    /// None where the elimination has too many, or isn't worth it.
    decompose: Option<Decompose>,
    solve: Option<Solve>,
}

impl Kernel {
    /// Whether it is one of a system with these variables and so many entries in its Jacobian's pattern.
    pub fn fits(&self, variables: &Variables, entries: usize) -> bool {
        let sizes = [
            variables.reals(Section::Memory).end,
            variables.integers(Section::Memory).end,
            variables.reals(Section::Input).len(),
            variables.states(),
            entries,
        ];
        let own = [self.reals, self.integers, self.inputs, self.states, self.entries];
        self.version == VERSION && own.iter().zip(sizes).all(|(own, size)| *own as usize == size)
    }

    fn check(&self, reals: &[f64], integers: &[i32]) {
        assert!(reals.len() >= self.reals as usize && integers.len() >= self.integers as usize, "a block of its model");
    }

    /// Writes the signals of a block.
    #[inline]
    pub fn outputs(&self, t: f64, reals: &mut [f64], integers: &[i32]) {
        self.check(reals, integers);
        // SAFETY: the block has the sizes that it was compiled for, and it writes within them.
        unsafe { (self.outputs)(t, reals.as_mut_ptr(), integers.as_ptr()) }
    }

    /// Writes the signals and the rates of a block.
    #[inline]
    pub fn evaluate(&self, t: f64, reals: &mut [f64], integers: &[i32]) {
        self.check(reals, integers);
        // SAFETY: as above.
        unsafe { (self.evaluate)(t, reals.as_mut_ptr(), integers.as_ptr()) }
    }

    /// Writes the entries of the Jacobian, column by column, and the rates' change by time, with inputs that move where
    /// slopes are given; whether it can.
    pub fn jacobian(
        &self,
        t: f64,
        (reals, integers): (&[f64], &[i32]),
        slopes: Option<&[f64]>,
        entries: &mut [f64],
        by_time: &mut [f64],
    ) -> bool {
        let Some(jacobian) = self.jacobian else { return false };
        self.check(reals, integers);
        assert!(entries.len() >= self.entries as usize && by_time.len() >= self.states as usize);
        assert!(slopes.is_none_or(|slopes| slopes.len() >= self.inputs as usize));
        let slopes = slopes.map_or(std::ptr::null(), <[f64]>::as_ptr);
        let (values, places) = (reals.as_ptr(), integers.as_ptr());
        // SAFETY: as above, and so have the places where results go.
        unsafe { jacobian(t, values, places, slopes, entries.as_mut_ptr(), by_time.as_mut_ptr()) }
        true
    }

    /// How many numbers a decomposition has; none where it has none.
    pub fn factors(&self) -> Option<usize> {
        self.decompose.and(self.solve).map(|_| self.factors as usize)
    }

    /// Decomposes `diagonal` I less the Jacobian of these entries; whether that is accurate.
    pub fn decompose(&self, diagonal: f64, entries: &[f64], factors: &mut [f64]) -> bool {
        assert!(entries.len() >= self.entries as usize && factors.len() >= self.factors as usize);
        // SAFETY: both have the sizes that it was compiled for.
        self.decompose
            .is_some_and(|decompose| unsafe { decompose(diagonal, entries.as_ptr(), factors.as_mut_ptr()) != 0 })
    }

    /// Replaces b by the solution, by the factors of a decomposition.
    #[inline]
    pub fn solve(&self, factors: &[f64], b: &mut [f64]) {
        assert!(factors.len() >= self.factors as usize && b.len() >= self.states as usize);
        if let Some(solve) = self.solve {
            // SAFETY: as above.
            unsafe { solve(factors.as_ptr(), b.as_mut_ptr()) }
        }
    }
}
