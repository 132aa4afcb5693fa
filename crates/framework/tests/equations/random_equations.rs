//! Random equations are the same in every form: recorded, simplified, as instructions, in kernels, in C, and their derivatives.

use adaptive_fmu::model::Model;
use adaptive_fmu::recording::{Instructions, Method, Operation, Recording, Registers};
use adaptive_fmu::system::*;
use common::random::Random;
use common::random_equations::RandomEquations;

use crate::recording::{Draw, same};
use crate::{kernel, source};

/// Calls a function with a model of each of so many numbers.
fn each(check: &mut dyn FnMut(&Model)) {
    macro_rules! models {
        ($($number:literal)*) => {
            $(check(&Model::new::<RandomEquations<$number>>(concat!("Random", $number), &toml::Table::new()).unwrap());)*
        };
    }
    models!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30);
}

#[test]
fn their_source_gives_their_bits() {
    let (folder, mut random) = (source::folder(), Random::new(31));
    each(&mut |model| source::compare(model, (20, "-O0"), &mut random, folder.path()));
}

#[test]
fn their_kernels_give_their_bits() {
    let mut random = Random::new(34);
    each(&mut |model| {
        kernel::compare(model, 20, &mut random);
        kernel::compare_folded(model, &mut random);
    });
}

#[test]
fn their_recording_gives_their_bits_simplified_and_as_instructions_too() {
    let (mut random, mut registers, mut compared) = (Random::new(32), Registers::new(), 0);
    each(&mut |model| {
        let name = &model.description().name;
        for method in Method::ALL {
            let recording = Recording::of(model.system(), method, &model.variables().layout());
            let simplified = recording.simplified(&|_, _| None);
            let wanted = [&recording.reals[..], &recording.results].concat();
            let instructions = Instructions::of(&recording.tape, &wanted);
            for _ in 0..50 {
                let draw = Draw::new(model, &mut random);
                let given = draw.given();
                let (expected, expected_results) = draw.generic(model, method);
                let expected = [expected.reals, expected_results].concat();
                let all = |recording: &Recording| {
                    let (reals, _, results) = recording.carry_out(&given);
                    [reals, results].concat()
                };
                let (recorded, simpler) = (all(&recording), all(&simplified));
                let carried: Vec<f64> = instructions.carry_out(|leaf| given.leaf(leaf), &mut registers).collect();
                // Zero times infinity isn't simpler, and the sign of a zero may be another. An iteration itself has no value.
                let values = recording.tape.values(&given);
                let operations = recording.tape.operations().iter().zip(&values);
                let mut numbers = operations.filter(|(one, _)| !matches!(one, Operation::Iterate { .. }));
                let is_finite = numbers.all(|(_, value)| value.is_finite());
                compared += usize::from(is_finite);
                for (k, &expected) in expected.iter().enumerate() {
                    assert!(same(recorded[k], expected), "{name}, {method:?}, {k}: {} for {expected}", recorded[k]);
                    assert!(same(carried[k], expected), "{name}, {method:?}, {k}: {} for {expected}", carried[k]);
                    let is_same = simpler[k] == expected || !is_finite;
                    assert!(is_same, "{name}, {method:?}, {k}: {} for {expected}", simpler[k]);
                }
            }
        }
    });
    // All methods but that of the next event's time, infinity where there is none.
    assert!(compared > 30 * 50 * (Method::ALL.len() - 1) * 9 / 10, "{compared}");
}

#[test]
fn their_derivatives_are_those_of_differences() {
    let (mut random, mut registers, mut compared, mut kinks) = (Random::new(33), Registers::new(), 0, 0);
    each(&mut |model| {
        let variables = model.variables();
        let known = [variables.reals(Section::Input), variables.reals(Section::State)];
        for _ in 0..20 {
            let mut draw = Draw { block: model.start().clone(), ..Draw::new(model, &mut random) };
            let known: Vec<usize> = known.iter().cloned().flatten().collect();
            known.iter().for_each(|&place| draw.block.reals[place] = 2.0 * random.next());
            let direction: Vec<f64> = known.iter().map(|_| random.next()).collect();
            let shifted = |h: f64| {
                let mut draw = draw.clone();
                known.iter().zip(&direction).for_each(|(&place, by)| draw.block.reals[place] += h * by);
                draw.generic(model, Method::Evaluate).0.reals
            };
            let (h, mut found) = (1e-5, vec![0.0; draw.block.reals.len()]);
            known.iter().zip(&direction).for_each(|(&place, by)| found[place] = *by);
            model.direction().carry_out(&draw.given(), 0.0, &mut found, &mut registers);
            let (ahead, back) = (shifted(h), shifted(-h));
            for place in variables.reals(Section::Signal).chain(variables.reals(Section::Derivative)) {
                let expected = (ahead[place] - back[place]) / (2.0 * h);
                compared += 1;
                // A kink within the difference is neither side's derivative.
                let is_near = (found[place] - expected).abs() <= 1e-6 * (1.0 + expected.abs());
                kinks += usize::from(!is_near);
            }
        }
    });
    assert!(kinks * 1000 < compared, "{kinks} of {compared}");
}
