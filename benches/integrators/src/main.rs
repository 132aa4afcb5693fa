//! What does a restart of a published ODE integrator cost per communication step?
//!
//! Van der Pol, `x1' = x2`, `x2' = mu (1 - x1^2) x2 - x1`, from (2, 0) over 20 s. The input `mu`
//! is held during a communication step and may jump between two, so every candidate starts anew
//! at each, from `x` alone, and first tries the whole communication step as one step (not `bdf`).

mod own;

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;
use std::hint::black_box;
use std::ops::{IndexMut, Range};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use differential_equations::methods::{DormandPrince, ExplicitRungeKutta, Ordinary};
use differential_equations::ode::{ODE, OrdinaryNumericalMethod};
use differential_equations::{status::Status, traits::State};
use diffsol::{NalgebraLU, NalgebraMat, NonLinearOp, OdeBuilder, OdeEquations, OdeSolverMethod};
use diffsol::{OdeSolverProblem, OdeSolverState, OdeSolverStopReason, Vector};
use ode_solvers::{DVector, Dopri5, OutputType, SVector, System};

const TOLERANCE: f64 = 1e-6; // relative and absolute
const X0: [f64; 2] = [2.0, 0.0];
const REPEATS: usize = 11; // timed runs per candidate and case
const HALF: usize = 1000; // communication steps before and after the save point

/// One way to integrate over a communication step.
trait Candidate {
    fn name(&self) -> &str;
    /// Integrates `x` from `t` to `t + h` with the input held at `mu`.
    fn communication_step(&mut self, t: f64, h: f64, mu: f64, x: &mut [f64; 2]);
}

/// What a candidate remembers between communication steps, beyond `t`, `x` and the input.
trait Memory: Candidate + Clone {
    /// The numbers the public API gives out (they could go into a byte blob).
    fn save(&mut self) -> Vec<f64> {
        Vec::new()
    }
    fn restore(&mut self, _saved: &[f64]) {}
}

/// The right-hand side, the same code for every candidate.
struct VanDerPol(f64);
impl VanDerPol {
    fn rhs(&self, x: [f64; 2]) -> [f64; 2] {
        [x[1], self.0 * (1.0 - x[0] * x[0]) * x[1] - x[0]]
    }
    /// Product of the Jacobian with `v`.
    fn jacobian_times(&self, x: &[f64], v: &[f64]) -> [f64; 2] {
        let row1 = [-2.0 * self.0 * x[0] * x[1] - 1.0, self.0 * (1.0 - x[0] * x[0])];
        [v[1], row1[0] * v[0] + row1[1] * v[1]]
    }
}

/// Classic RK4 without error control: the reference (many substeps) and the floor (one).
#[derive(Clone)]
struct FixedRk4(usize);
impl Candidate for FixedRk4 {
    fn name(&self) -> &str {
        "(floor) one RK4 step, no error control"
    }
    fn communication_step(&mut self, _t: f64, h: f64, mu: f64, x: &mut [f64; 2]) {
        let (f, h) = (VanDerPol(mu), h / self.0 as f64);
        for _ in 0..self.0 {
            let stage = |s: f64, k: [f64; 2]| f.rhs([x[0] + s * k[0], x[1] + s * k[1]]);
            let k1 = f.rhs(*x);
            let k2 = stage(0.5 * h, k1);
            let k3 = stage(0.5 * h, k2);
            let k4 = stage(h, k3);
            *x = [0, 1].map(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
    }
}
impl Memory for FixedRk4 {}

impl<V: IndexMut<usize, Output = f64>> System<f64, V> for VanDerPol {
    fn system(&self, _t: f64, x: &V, dx: &mut V) {
        [dx[0], dx[1]] = self.rhs([x[0], x[1]]);
    }
}

/// `ode_solvers`: end time and state are private, so each communication step builds an object.
#[rustfmt::skip]
macro_rules! ode_solvers_candidate {
    ($candidate:ident, $name:literal, $vector:ty) => {
        #[derive(Clone)]
        struct $candidate;
        impl Candidate for $candidate {
            fn name(&self) -> &str {
                $name
            }
            fn communication_step(&mut self, t: f64, h: f64, mu: f64, x: &mut [f64; 2]) {
                let (f, x0, tol) = (VanDerPol(mu), <$vector>::from_row_slice(x), TOLERANCE);
                // The library's defaults, but the first step given, no stiffness test, sparse.
                let mut solver = Dopri5::from_param(
                    f, t, t + h, h, x0, tol, tol, 0.9, 0.04, 0.2, 10.0, h, h, 100_000, u32::MAX,
                    OutputType::Sparse,
                );
                solver.integrate().expect("ode_solvers step");
                x.copy_from_slice(solver.y_out().last().expect("an end").as_slice());
            }
        }
        impl Memory for $candidate {}
    };
}
ode_solvers_candidate!(OdeSolversFixed, "ode_solvers Dopri5, SVector", SVector<f64, 2>);
ode_solvers_candidate!(OdeSolversDynamic, "ode_solvers Dopri5, DVector", DVector<f64>);

impl<Y: State<f64> + AsRef<[f64]> + AsMut<[f64]>> ODE<f64, Y> for VanDerPol {
    fn diff(&self, _t: f64, x: &Y, dx: &mut Y) {
        dx.as_mut().copy_from_slice(&self.rhs([x.as_ref()[0], x.as_ref()[1]]));
    }
}

/// `differential-equations`: one solver object; `h0`, `init` and the low-level `step` at every
/// communication step, so that no `Solution` is built.
#[derive(Clone)]
struct DifferentialEquations<Y: State<f64>> {
    name: &'static str,
    solver: ExplicitRungeKutta<Ordinary, DormandPrince, f64, Y, 5, 7, 7>,
    x: Y,
}
impl<Y: State<f64>> DifferentialEquations<Y> {
    /// The step counter survives `init`: the default limit would end a long simulation.
    fn new(name: &'static str, x: Y) -> Self {
        let solver = ExplicitRungeKutta::dopri5().rtol(TOLERANCE).atol(TOLERANCE);
        Self { name, solver: solver.max_steps(usize::MAX), x }
    }
}

impl<Y: State<f64> + AsRef<[f64]> + AsMut<[f64]>> Candidate for DifferentialEquations<Y> {
    fn name(&self) -> &str {
        self.name
    }
    fn communication_step(&mut self, t: f64, h: f64, mu: f64, x: &mut [f64; 2]) {
        let (f, end, solver) = (VanDerPol(mu), t + h, &mut self.solver);
        self.x.as_mut().copy_from_slice(x);
        solver.h0 = end - t;
        solver.init(&f, t, end, &self.x).expect("init");
        let mut left = end - t;
        while left > 0.0 {
            solver.set_h(solver.h().min(left));
            let rest = left - solver.h();
            solver.step(&f).expect("differential-equations step");
            left = if matches!(solver.status(), Status::RejectedStep) { left } else { rest };
        }
        x.copy_from_slice(solver.y().as_ref());
    }
}
impl<Y: State<f64> + AsRef<[f64]> + AsMut<[f64]>> Memory for DifferentialEquations<Y> {}

/// `diffsol`: one solver object, its state overwritten through `state_mut` at every restart. It
/// borrows the problem (so no `eqn_mut().set_params`): the input goes through a `Cell`.
struct Diffsol<'a, Eqn: OdeEquations, S> {
    name: &'static str,
    problem: &'a OdeSolverProblem<Eqn>,
    mu: &'a Cell<f64>,
    solver: S,
    /// A multistep method restarts at first order with the library's own guess of a step size.
    multistep: bool,
}
impl<Eqn: OdeEquations, S: Clone> Clone for Diffsol<'_, Eqn, S> {
    fn clone(&self) -> Self {
        Self { solver: self.solver.clone(), ..*self }
    }
}

impl<'a, E: OdeEquations<T = f64>, S: OdeSolverMethod<'a, E>> Candidate for Diffsol<'a, E, S> {
    fn name(&self) -> &str {
        self.name
    }
    fn communication_step(&mut self, t: f64, h: f64, mu: f64, x: &mut [f64; 2]) {
        let OdeSolverProblem { eqn, atol, rtol, .. } = self.problem;
        self.mu.set(mu);
        let mut state = self.solver.state_mut();
        (0..2).for_each(|i| state.y.set_index(i, x[i]));
        (*state.t, *state.h) = (t, h);
        eqn.rhs().call_inplace(state.y, t, state.dy);
        if self.multistep {
            state.set_step_size(h, atol, *rtol, eqn, 1);
        }
        self.solver.set_stop_time(t + h).expect("stop time");
        while self.solver.step().expect("diffsol step") != OdeSolverStopReason::TstopReached {}
        *x = [0, 1].map(|i| self.solver.state().y.get_index(i));
    }
}

impl<'a, E: OdeEquations<T = f64>, S: OdeSolverMethod<'a, E>> Memory for Diffsol<'a, E, S> {
    /// All of the state that is public, and the input. `checkpoint` also makes an implicit method
    /// evaluate its Jacobian anew, since it cannot be saved: the run that goes on changes, too.
    fn save(&mut self) -> Vec<f64> {
        self.solver.checkpoint();
        let s = self.solver.state();
        let [y, dy] = [s.y, s.dy].map(|v| [v.get_index(0), v.get_index(1)]);
        vec![self.mu.get(), s.t, s.h, y[0], y[1], dy[0], dy[1]]
    }
    /// `set_state` evaluates the Jacobian of an implicit method anew as well.
    fn restore(&mut self, saved: &[f64]) {
        self.mu.set(saved[0]);
        let mut state = self.solver.state_clone();
        let s = state.as_mut();
        (*s.t, *s.h) = (saved[1], saved[2]);
        (0..2).for_each(|i| s.y.set_index(i, saved[3 + i]));
        (0..2).for_each(|i| s.dy.set_index(i, saved[5 + i]));
        self.solver.set_state(state);
    }
}

/// Communication step size, number of steps and the input of each step.
struct Case {
    label: &'static str,
    h: f64,
    steps: usize,
    mu: fn(usize) -> f64,
}
/// The third needs several internal steps per communication step, and its input jumps. In the last one the explicit
/// methods need some fifty steps for their stability.
const CASES: [Case; 4] = [
    Case { label: "10 ms", h: 0.01, steps: 2000, mu: |_| 1.0 },
    Case { label: "1 ms", h: 0.001, steps: 20_000, mu: |_| 1.0 },
    Case { label: "250 ms*", h: 0.25, steps: 80, mu: |i| [5.0, 0.5][i / 8 % 2] },
    Case { label: "stiff", h: 0.01, steps: 2000, mu: |i| [5000.0, 4000.0][i / 8 % 2] },
];

type Points = Vec<[f64; 2]>;
impl Case {
    /// Runs the communication steps `range` from `x` and puts each end point into `out`.
    fn run(&self, c: &mut impl Candidate, range: Range<usize>, mut x: [f64; 2], out: &mut Points) {
        out.clear();
        for i in range {
            c.communication_step(i as f64 * self.h, self.h, black_box((self.mu)(i)), &mut x);
            out.push(black_box(x));
        }
    }
    fn reference(&self, substep: f64) -> Points {
        let (substeps, mut points) = ((self.h / substep).round() as usize, Points::new());
        self.run(&mut FixedRk4(substeps), 0..self.steps, X0, &mut points);
        points
    }
}
fn max_difference(a: &Points, b: &Points) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).fold(0.0, |max, (a, b)| max.max((a - b).abs()))
}

/// Counts every allocation and reallocation of the process, and their bytes.
struct Counting;
static COUNTS: [AtomicU64; 2] = [AtomicU64::new(0), AtomicU64::new(0)];
#[global_allocator]
static HEAP: Counting = Counting;
// SAFETY: every call goes to the system allocator unchanged, under the caller's promises.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNTS[0].fetch_add(1, Relaxed);
        COUNTS[1].fetch_add(layout.size() as u64, Relaxed);
        unsafe { Heap.alloc(layout) }
    }
    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        unsafe { Heap.dealloc(block, layout) }
    }
}

/// Prints the rows of time, heap use and error.
fn measure<C: Memory>(make: impl Fn() -> C) {
    for case in &CASES {
        let (mut c, mut points) = (make(), Points::new());
        case.run(&mut c, 0..case.steps, X0, &mut points);
        let error = max_difference(&points, &case.reference(5e-5));
        let per_step = |total: u64| total as f64 / case.steps as f64;
        let before = COUNTS.each_ref().map(|count| count.load(Relaxed));
        case.run(&mut c, 0..case.steps, X0, &mut points);
        let [count, bytes] = [0, 1].map(|i| per_step(COUNTS[i].load(Relaxed) - before[i]));
        let mut times = [(); REPEATS].map(|()| {
            let start = Instant::now();
            case.run(&mut c, 0..case.steps, X0, &mut points);
            per_step(start.elapsed().as_nanos() as u64)
        });
        times.sort_by(f64::total_cmp);
        let [min, median, max] = [0, REPEATS / 2, REPEATS - 1].map(|i| times[i]);
        print!("| {:39} | {:7} | {min:6.0} | {median:6.0} | {max:6.0} ", c.name(), case.label);
        println!("| {count:6.1} | {bytes:6.0} | {error:9.1e} |");
    }
}

/// Prints whether the second half of a run is bit-equal to the one that follows a save.
fn restore<C: Memory>(make: impl Fn() -> C) {
    for case in [&CASES[0], &CASES[2]] {
        let ([mut original, mut unsaved, mut fresh], mut out) = ([(); 3].map(|()| make()), vec![]);
        case.run(&mut unsaved, 0..HALF, X0, &mut out);
        case.run(&mut original, 0..HALF, X0, &mut out);
        let start = out[HALF - 1];
        let mut go_on = |c: &mut C| {
            case.run(c, HALF..2 * HALF, start, &mut out);
            out.iter().flatten().map(|v| v.to_bits()).collect::<Vec<u64>>()
        };
        let saved = original.save();
        let mut copy = original.clone();
        let expected = go_on(&mut original);
        let mut verdict = |c: &mut C| if go_on(c) == expected { "yes" } else { "NO" };
        original.restore(&saved);
        let same = verdict(&mut original);
        fresh.restore(&saved);
        let [new, copy, resumed] = [&mut fresh, &mut copy, &mut unsaved].map(verdict);
        print!("| {:39} | {:7} | {:7} ", original.name(), case.label, saved.len());
        println!("| {same:8} | {new:7} | {copy:5} | {resumed:12} |");
    }
}

fn main() {
    let mu = &Cell::new(1.0);
    let f = || VanDerPol(mu.get());
    let mut problem = OdeBuilder::<NalgebraMat<f64>>::new()
        .rtol(TOLERANCE)
        .atol([TOLERANCE])
        .rhs_implicit(
            |x, _p, _t, dx| dx.copy_from_slice(&f().rhs([x[0], x[1]])),
            |x, _p, _t, v, jv| jv.copy_from_slice(&f().jacobian_times(x, v)),
        )
        .init(|_p, _t, x| x.copy_from_slice(&X0), 2)
        .build()
        .expect("problem");
    // Failures are counted over the life of a solver: the default limit would end a simulation.
    problem.ode_options.max_nonlinear_solver_failures = usize::MAX;
    let problem = &problem;
    macro_rules! diffsol {
        ($name:literal, $solver:expr, $multistep:literal) => {
            Diffsol { name: $name, problem, mu, solver: $solver.unwrap(), multistep: $multistep }
        };
    }
    type Lu = NalgebraLU<f64>;
    let change = |case: &Case| max_difference(&case.reference(5e-5), &case.reference(1e-4));
    println!("Halving the step of the reference changes it by {:?}.", CASES.each_ref().map(change));
    macro_rules! tables {
        ($($candidate:expr;)*) => {
            println!("| candidate | H | ns min | median | max | allocs | bytes | max error |");
            $(measure(|| $candidate);)*
            println!("| candidate | H | numbers | same obj | new obj | clone | kept by save |");
            $(restore(|| $candidate);)*
        };
    }
    tables! {
        FixedRk4(1);
        own::Own::new("explicit"); own::Own::new("automatic"); own::Own::new("stiff");
        OdeSolversFixed; OdeSolversDynamic;
        DifferentialEquations::new("differential-equations dopri5, [f64; 2]", X0);
        DifferentialEquations::new("differential-equations dopri5, Vec", X0.to_vec());
        diffsol!("diffsol tsit45", problem.tsit45(), false);
        diffsol!("diffsol tr_bdf2", problem.tr_bdf2::<Lu>(), false);
        diffsol!("diffsol esdirk34", problem.esdirk34::<Lu>(), false);
        diffsol!("diffsol bdf", problem.bdf::<Lu>(), true);
    }
}
