//! Workspace of an instance within a call, and how instances of one model share it.
//!
//! The next call needs nothing of it. It takes many times the memory of an instance's values: storage for derivatives,
//! the matrices of the stiff method and of eigenvalues. So a single instance has its own, and further ones share one
//! for each thread that initialises them: a host with a thread for each instance finds every instance a workspace, and
//! one thread with many instances needs one for all of them. If a thread meets a workspace that is in use, by steps of
//! instances that another thread has initialised, it goes to another, which is created if there is none.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError, Weak};

use super::{Driver, Sparsity};
use crate::system::{DynSystem, Section, Variables};

/// Workspace of an instance within a call.
#[derive(Debug)]
pub struct Workspace {
    /// Integrator.
    pub driver: Driver,
    /// Real values as before the step that is being tried.
    pub reals: Vec<f64>,
    /// Integers likewise.
    pub integers: Vec<i32>,
    /// Real inputs at the begin of a step.
    pub ramp_values: Vec<f64>,
    /// Their rates.
    pub ramp_slopes: Vec<f64>,
}

impl Workspace {
    /// Workspace for a system whose Jacobian has this pattern.
    pub fn new(system: &dyn DynSystem, variables: &Variables, sparsity: &Arc<Sparsity>) -> Self {
        let inputs = variables.reals(Section::Input).len();
        Workspace {
            driver: Driver::new(system, variables, sparsity),
            reals: vec![0.0; variables.reals(Section::Memory).end],
            integers: vec![0; variables.integers(Section::Memory).end],
            ramp_values: vec![0.0; inputs],
            ramp_slopes: vec![0.0; inputs],
        }
    }

    /// Keeps values as they are before a step.
    pub fn keep(&mut self, reals: &[f64], integers: &[i32]) {
        self.reals.copy_from_slice(reals);
        self.integers.copy_from_slice(integers);
    }

    /// Restores the stored values.
    pub fn bring_back(&self, reals: &mut [f64], integers: &mut [i32]) {
        reals.copy_from_slice(&self.reals);
        integers.copy_from_slice(&self.integers);
    }
}

/// A workspace of several instances.
#[derive(Debug)]
pub struct Common {
    /// Thread that initialises them.
    thread: usize,
    workspace: Mutex<Workspace>,
}

impl Common {
    /// The workspace, unless it is in use. What a panic left in it is as good as anything: each call begins with what it
    /// needs.
    fn free(&self) -> Option<MutexGuard<'_, Workspace>> {
        match self.workspace.try_lock() {
            Ok(workspace) => Some(workspace),
            Err(TryLockError::Poisoned(workspace)) => Some(workspace.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

/// Place of an instance's workspace.
#[derive(Debug, Default)]
pub enum Place {
    /// A workspace of its own; it may be the first instance that has one.
    Own(Box<Workspace>, Option<Arc<()>>),
    /// A workspace shared with others.
    Common(Arc<Common>),
    /// It works just now.
    #[default]
    Away,
}

impl Place {
    /// A workspace that no other instance uses from now on.
    pub fn own(&mut self, make: impl FnOnce() -> Workspace) -> &mut Workspace {
        if !matches!(self, Place::Own(..)) {
            *self = Place::Own(Box::new(make()), None);
        }
        match self {
            Place::Own(workspace, _) => workspace,
            _ => unreachable!("it is its own"),
        }
    }
}

/// The workspaces of a model's instances.
#[derive(Debug, Default)]
pub struct Workspaces(Mutex<Known>);

#[derive(Debug, Default)]
struct Known {
    /// The instance that was the only one when it was created.
    first: Weak<()>,
    common: Vec<Weak<Common>>,
}

impl Workspaces {
    /// Place of the workspace of an instance that this thread creates.
    pub fn place(&self, make: impl FnOnce() -> Workspace) -> Place {
        let first = {
            let mut known = self.known();
            let alone = known.first.strong_count() == 0;
            alone.then(|| {
                let first = Arc::new(());
                known.first = Arc::downgrade(&first);
                first
            })
        };
        match first {
            Some(_) => Place::Own(Box::new(make()), first),
            None => Place::Common(self.common_of(thread(), make)),
        }
    }

    /// Has an instance that this thread initialises work where others of this thread do.
    pub fn initialised(&self, place: &mut Place, make: impl FnOnce() -> Workspace) {
        if let Place::Common(common) = place
            && common.thread != thread()
        {
            *common = self.common_of(thread(), make);
        }
    }

    /// Has an instance work at its place.
    pub fn work<T>(
        &self,
        place: &mut Place,
        make: impl FnOnce() -> Workspace,
        work: impl FnOnce(&mut Workspace) -> T,
    ) -> T {
        match place {
            Place::Own(workspace, _) => work(workspace),
            Place::Common(common) => {
                if let Some(mut workspace) = common.free() {
                    return work(&mut workspace);
                }
                *common = self.unused(make);
                // Another thread may have found it, too; then this one waits.
                work(&mut common.workspace.lock().unwrap_or_else(PoisonError::into_inner))
            }
            // What it had was lost in a panic.
            Place::Away => {
                let mut workspace = Box::new(make());
                let done = work(&mut workspace);
                *place = Place::Own(workspace, None);
                done
            }
        }
    }

    fn common_of(&self, thread: usize, make: impl FnOnce() -> Workspace) -> Arc<Common> {
        self.find_common(thread, |common| common.thread == thread, make)
    }

    fn unused(&self, make: impl FnOnce() -> Workspace) -> Arc<Common> {
        self.find_common(thread(), |common| common.free().is_some(), make)
    }

    fn find_common(
        &self,
        thread: usize,
        fits: impl Fn(&Common) -> bool,
        make: impl FnOnce() -> Workspace,
    ) -> Arc<Common> {
        let found = |known: &Known| known.common.iter().filter_map(Weak::upgrade).find(|common| fits(common));
        if let Some(common) = found(&self.known()) {
            return common;
        }
        // Made while others may look.
        let common = Arc::new(Common { thread, workspace: Mutex::new(make()) });
        let mut known = self.known();
        known.common.retain(|common| common.strong_count() > 0);
        known.common.push(Arc::downgrade(&common));
        common
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        // What a panic left is whole: entries are only added and removed.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A number unique among living threads: the address of a thread's variable. A thread's handle would have a destructor,
/// which keeps a library in its host until the thread ends.
fn thread() -> usize {
    thread_local! {
        static HERE: u8 = const { 0 };
    }
    HERE.with(|here| std::ptr::from_ref(here).addr())
}
