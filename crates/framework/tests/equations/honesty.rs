//! Reliable numbers: from any state and with any inputs, a communication step of any length follows the equations
//! within its tolerance, or it is refused. A saved state goes on bit for bit.
//!
//! Tolerance. Error control bounds the error of each integration step, by `relative_tolerance` of a variable's
//! magnitude, or of its nominal value if that is larger. A communication step consists of many of them, and the
//! equations carry the error of each to the end. So an error of 1 is that tolerance, or the largest change of a
//! variable's exact solution when all states change by their tolerances, at the beginning, in the middle or at the end
//! of the step. An error of 10 passes.
//!
//! An error estimate evaluates the equations at a few points of a step. The effects of a kink in a rate (an absolute
//! value, a projection, a limit) may cancel there. So one step in two hundred may have an error above 10.

use adaptive_fmu::model::Block;
use adaptive_fmu::system::{Element, Section};
use common::described::open_description;
use common::exact::{Exact, Task};
use common::random::Random;
use common::sample::sampled_names;
use common::*;

/// The numbers of the items of `integration_method`.
const METHODS: [i32; 3] = [1, 2, 3];
const AUTOMATIC: i32 = 1;
/// The exact solution's tolerance, in parts of the unit's: at first, and where in doubt.
const TIGHTER: [f64; 2] = [1e-4, 1e-6];
/// An error that passes, and how rare one is that doesn't.
const PASSES: f64 = 10.0;
const ONE_IN: usize = 200;

/// A communication step.
struct Taken<'a> {
    unit: &'a Unit,
    task: Task<'a>,
    after: Block,
}

/// Results of the steps of an FMU.
#[derive(Default)]
struct Tally {
    steps: usize,
    refused: usize,
    /// Steps whose exact solution is beyond reach.
    unknown: usize,
    /// Steps with an error above 1 if nothing carried it further.
    carried: usize,
    worst: f64,
    /// Steps with an error that doesn't pass.
    beyond: usize,
}

impl Taken<'_> {
    fn states(&self) -> Vec<Element<'_>> {
        let variables = self.unit.model.variables();
        (0..variables.states()).map(|k| variables.real_at(Section::State, k).unwrap()).collect()
    }

    /// Judged values: all reals that the FMU calculates.
    fn judged(&self) -> Vec<Element<'_>> {
        let visible = self.unit.model.variables().visible();
        let given = [Section::Parameter, Section::Prepared, Section::Input];
        visible.filter(|e| e.variable.is_real() && !given.contains(&e.variable.section)).collect()
    }

    /// Magnitude of an element, to which its tolerance is relative.
    fn magnitude(&self, element: Element, end: &Block) -> f64 {
        let place = self.unit.model.variables().index(element);
        element.nominal().max(self.task.block.reals[place].abs()).max(end.reals[place].abs())
    }

    /// Tolerance of each state.
    fn tolerated(&self, end: &Block, tolerance: f64) -> Vec<f64> {
        self.states().into_iter().map(|state| tolerance * self.magnitude(state, end)).collect()
    }

    /// Change of each real of the exact solution when all states change by their tolerances, up or down.
    fn carried(&self, exact: &mut Exact, task: &Task, end: &Block, tolerance: f64, random: &mut Random) -> Vec<f64> {
        let tolerated = self.tolerated(end, tolerance);
        let mut furthest = vec![0.0_f64; end.reals.len()];
        for part in [0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 1.0, 1.0, 1.0] {
            let moved: Vec<_> = tolerated.iter().map(|size| size * random.next().signum()).collect();
            let Ok(other) = exact.solve(&Task { moved: Some((part, &moved)), ..*task }) else { continue };
            for (furthest, (a, b)) in furthest.iter_mut().zip(other.reals.iter().zip(&end.reals)) {
                *furthest = furthest.max((a - b).abs());
            }
        }
        furthest
    }

    /// The same in the worst case: each state changes separately, up and down, and the effects add up. For many states
    /// that takes long.
    fn carried_at_worst(&self, exact: &mut Exact, task: &Task, end: &Block, tolerance: f64) -> Vec<f64> {
        let tolerated = self.tolerated(end, tolerance);
        let mut furthest = vec![0.0_f64; end.reals.len()];
        for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let mut sums = vec![0.0; end.reals.len()];
            for (k, &size) in tolerated.iter().enumerate() {
                let mut further = vec![0.0_f64; end.reals.len()];
                for size in [size, -size] {
                    let mut moved = vec![0.0; tolerated.len()];
                    moved[k] = size;
                    let Ok(other) = exact.solve(&Task { moved: Some((part, &moved)), ..*task }) else { continue };
                    let differences = other.reals.iter().zip(&end.reals).map(|(a, b)| (a - b).abs());
                    further.iter_mut().zip(differences).for_each(|(further, apart)| *further = further.max(apart));
                }
                sums.iter_mut().zip(further).for_each(|(sum, further)| *sum += further);
            }
            furthest.iter_mut().zip(&sums).for_each(|(furthest, sum)| *furthest = furthest.max(*sum));
        }
        furthest
    }

    /// The errors of what is judged, in parts of what is tolerated, and whether more was tolerated for what the equations
    /// carry on.
    fn errors(&self, exact: &mut Exact, task: &Task, end: &Block, random: &mut Random) -> (Vec<(String, f64)>, bool) {
        let (tolerance, judged) = (self.task.tolerance, self.judged());
        let errors = |carried: Option<&[f64]>| -> Vec<(String, f64)> {
            let error = |&element: &Element| {
                let place = self.unit.model.variables().index(element);
                let difference = (self.after.reals[place] - end.reals[place]).abs();
                let tolerated = tolerance * self.magnitude(element, end);
                (element.name(), difference / carried.map_or(tolerated, |carried| tolerated.max(carried[place])))
            };
            judged.iter().map(error).collect()
        };
        let found = errors(None);
        if passes(&found) {
            return (found, false);
        }
        let found = errors(Some(&self.carried(exact, task, end, tolerance, random)));
        if passes(&found) {
            return (found, true);
        }
        (errors(Some(&self.carried_at_worst(exact, task, end, tolerance))), true)
    }

    /// Compares with the exact solution, and prints errors that don't pass. Those are compared with a more exact
    /// solution first: rows of an extrapolation may agree by chance.
    fn judge(&self, exact: &mut Exact, random: &mut Random, tally: &mut Tally) {
        let mut judged = None;
        for tighter in TIGHTER {
            let task = Task { tolerance: self.task.tolerance * tighter, ..self.task };
            let Ok(solution) = exact.solve(&task) else { continue };
            let found = self.errors(exact, &task, &solution, random);
            let done = passes(&found.0);
            judged = Some(found);
            if done {
                break;
            }
        }
        let Some((errors, carried)) = judged else {
            tally.unknown += 1;
            return;
        };
        tally.carried += usize::from(carried);
        let Some((name, worst)) = errors.iter().max_by(|(_, a), (_, b)| a.total_cmp(b)) else { return };
        tally.worst = tally.worst.max(*worst);
        if !passes(&errors) {
            tally.beyond += 1;
            let Task { time, step, .. } = self.task;
            println!("    {name} from t = {time} s over {step:.3e} s: {worst:.1}");
        }
    }
}

fn passes(errors: &[(String, f64)]) -> bool {
    errors.iter().all(|(_, error)| *error <= PASSES)
}

/// Takes random steps from random states by one method, and compares each with the exact solution.
fn survey(name: &str, method: i32, count: usize) -> Tally {
    let text = open_description(name);
    let (unit, mut exact, mut tally) = (Unit::from_text(&text), Exact::new(&text), Tally::default());
    let mut random = Random::new(name.bytes().map(u64::from).sum::<u64>() + method as u64);
    // A unit without continuous states has none; nothing but rounding is tolerated in it.
    let tolerance = unit.model.variables().find("relative_tolerance").map_or(1e-12, |tolerance| tolerance.start());
    for _ in 0..count {
        let time = unit.draw_state(&mut random, method);
        let step = random.log_uniform(unit.lengths());
        let slopes = unit.draw_inputs(&mut random, step);
        let before = unit.block();
        if unit.step(time, step) != OK {
            tally.refused += 1;
            continue;
        }
        tally.steps += 1;
        let task = Task { block: &before, time, step, slopes: &slopes, tolerance, moved: None };
        Taken { unit: &unit, task, after: unit.block() }.judge(&mut exact, &mut random, &mut tally);
    }
    tally
}

/// The methods that a unit can choose from.
fn methods(name: &str) -> &'static [i32] {
    let chooses = Unit::new(name).model.variables().find("integration_method").is_some();
    if chooses { &METHODS } else { &METHODS[..1] }
}

/// Surveys `count` steps of every FMU by every method.
fn survey_all(count: usize) {
    let (mut steps, mut refused, mut unknown, mut beyond, mut worst) = (0, 0, 0, 0, 0.0_f64);
    println!("    unit and method, steps, refused, unknown, carried, worst error");
    for name in sampled_names() {
        for &method in methods(&name) {
            let tally = survey(&name, method, count);
            let Tally { steps: taken, refused: not, unknown: no, carried, .. } = tally;
            println!("{name:24} {method} {taken:5} {not:4} {no:4} {carried:4} {:8.1e}", tally.worst);
            assert!(2 * taken > count, "{name} by method {method} refuses {not} steps of {count}");
            (steps, refused, unknown) = (steps + taken, refused + not, unknown + no);
            (beyond, worst) = (beyond + tally.beyond, worst.max(tally.worst));
        }
    }
    println!(
        "{steps} steps, {refused} refused, {unknown} unknown, {beyond} with an error above {PASSES}, worst {worst:.1}"
    );
    assert!(ONE_IN * unknown <= steps, "{unknown} of {steps} steps can't be judged");
    assert!(ONE_IN * beyond <= steps, "{beyond} of {steps} steps have an error above {PASSES}");
}

#[test]
fn a_step_arrives_where_the_equations_lead_or_is_refused() {
    survey_all(4);
}

/// The same with `HONESTY_STEPS` steps:
/// `TEST_ALL=1 cargo test --release --test equations honesty:: -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes"]
fn any_number_of_steps_arrives_where_the_equations_lead_or_is_refused() {
    survey_all(std::env::var("HONESTY_STEPS").map_or(100, |count| count.parse().unwrap()));
}

/// Three random steps, however they are answered; all values after each.
fn three_steps(unit: &Unit, seed: u64, mut t: f64) -> Vec<Vec<u8>> {
    let mut random = Random::new(seed);
    let mut after = Vec::new();
    for _ in 0..3 {
        let step = random.log_uniform(unit.lengths());
        unit.draw_inputs(&mut random, step);
        if unit.step(t, step) != OK {
            // An instance that failed takes nothing but another state.
            return after;
        }
        t += step;
        after.push(unit.fingerprint());
    }
    after
}

#[test]
fn what_was_saved_at_any_point_goes_on_bit_for_bit() {
    let (mut random, mut steps, mut cases) = (Random::new(5), 0, 0);
    for name in description_names() {
        let text = open_description(&name);
        let [unit, other] = [(); 2].map(|()| Unit::from_text(&text));
        other.draw_state(&mut random, AUTOMATIC);
        for (case, &method) in methods(&name).iter().cycle().take(6).enumerate() {
            let t = unit.draw_state(&mut random, method);
            let (state, seed) = (unit.save(), case as u64);
            let bytes = unit.bytes(state);
            let first = three_steps(&unit, seed, t);
            (steps, cases) = (steps + first.len(), cases + 1);
            assert_eq!(unit.restore(state), OK, "{:?}", unit.messages());
            assert!(unit.fingerprint() == bytes, "{name}: restored as it was saved at t = {t} s");
            assert!(three_steps(&unit, seed, t) == first, "{name}: restored at t = {t} s");
            // In an instance that has been elsewhere, too.
            let (status, restored) = other.deserialise(&bytes);
            assert_eq!((status, other.restore(restored)), (OK, OK), "{:?}", other.messages());
            assert!(three_steps(&other, seed, t) == first, "{name}: restored from bytes at t = {t} s");
            assert_eq!((unit.free(state), other.free(restored)), (OK, OK));
        }
    }
    assert!(steps > 2 * cases, "most steps are taken: {steps} of {}", 3 * cases);
}
