//! Many instances in many threads: each behaves as if it were the only one.

use std::sync::{Barrier, Mutex};

use adaptive_fmu::system::Causality;
use common::described::open_description;
use common::{OK, Unit, description_names};

const INSTANCES: usize = 64;
const THREADS: usize = 8;
const ROUNDS: usize = 24;

/// An instance that is handed from thread to thread.
struct Handed(Unit);

// SAFETY: a unit is a component, which the standard lets any thread use while no other does, and its log, which is used
// by whoever uses the component.
unsafe impl Send for Handed {}

/// Units of all kinds, softened, initialised with inputs that differ from instance to instance.
fn units() -> Vec<Handed> {
    let names = description_names();
    let made = (0..INSTANCES).map(|k| {
        let unit = Unit::from_text(&open_description(&names[k % names.len()]));
        unit.soften();
        unit.enter(0.0);
        let inputs = unit.model.variables().visible();
        let inputs = inputs.filter(|e| e.variable.causality == Causality::Input && e.variable.is_real());
        inputs.enumerate().for_each(|(i, input)| unit.put(&input.name(), 0.01 * (1.0 + k as f64 + i as f64).sin()));
        assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
        Handed(unit)
    });
    made.collect()
}

/// Makes one step; every eighth time the state is restored, and the step repeated.
fn advance(unit: &Unit, round: usize) {
    let step = unit.model.description().experiment.step;
    let saved = (round % 8 == 7).then(|| unit.save());
    let go = || assert_eq!(unit.step(round as f64 * step, step), OK, "{:?}", unit.messages());
    go();
    if let Some(saved) = saved {
        assert_eq!((unit.restore(saved), unit.free(saved)), (OK, OK));
        go();
    }
}

#[test]
fn instances_stepped_from_many_threads_compute_the_bits_that_they_compute_alone() {
    let alone = units();
    alone.iter().for_each(|Handed(unit)| (0..ROUNDS).for_each(|round| advance(unit, round)));

    let handed: Vec<_> = units().into_iter().map(Mutex::new).collect();
    let together = Barrier::new(THREADS);
    std::thread::scope(|scope| {
        for thread in 0..THREADS {
            let (handed, together) = (&handed, &together);
            scope.spawn(move || {
                for round in 0..ROUNDS {
                    together.wait();
                    // Another thread each round, so that nothing can be left behind in one.
                    let mine = handed.iter().enumerate().filter(|(k, _)| (k + round) % THREADS == thread);
                    mine.for_each(|(_, unit)| advance(&unit.lock().unwrap().0, round));
                }
            });
        }
    });
    for (Handed(alone), handed) in alone.iter().zip(&handed) {
        let unit = &handed.lock().unwrap().0;
        let name = &unit.model.description().name;
        assert_eq!(alone.values(), unit.values(), "{name}");
        assert!(alone.fingerprint() == unit.fingerprint(), "{name}: everything that a continuation depends on");
    }
}
