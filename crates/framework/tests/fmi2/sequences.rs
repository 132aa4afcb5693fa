//! Whatever a master calls, in any order and with any arguments: nothing breaks a unit or makes it lie.
//!
//! The calls are the same in each run. `CALLS` asks for another number of them, and the answers are then counted:
//! `CALLS=10000000 cargo test --release --test fmi2 sequences:: -- --nocapture`

use std::cell::RefCell;
use std::time::Instant;

use adaptive_fmu::fmi2::types::{CO_SIMULATION, MODEL_EXCHANGE};
use common::description;
use common::sample::sampled_names;
use common::sequences::{Subject, Tally};
use proptest::collection::vec;
use proptest::prelude::any;
use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// Calls for each FMU and interface where nothing else is asked for.
const FEW: u64 = 1000;
/// Calls in a sequence, at most.
const LONGEST: usize = 120;

#[test]
fn no_sequence_of_calls_breaks_a_unit_or_makes_it_lie() {
    let names = sampled_names();
    let asked = std::env::var("CALLS").ok().map(|text| text.parse::<u64>().expect("CALLS is a number"));
    let each = asked.map_or(FEW, |calls| calls / (2 * names.len()) as u64);
    let tally = RefCell::new(Tally::default());
    for (index, name) in names.iter().enumerate() {
        for kind in [MODEL_EXCHANGE, CO_SIMULATION] {
            let subject = Subject::new(&description(name), kind);
            let (begun, end) = (Instant::now(), tally.borrow().calls() + each);
            let seed = [index as u8, kind as u8].repeat(16);
            let config = Config { failure_persistence: None, max_shrink_iters: 4000, ..Config::default() };
            let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &seed));
            while tally.borrow().calls() < end {
                let sequence = vec(any::<u128>(), 1..LONGEST).new_tree(&mut runner).expect("a sequence");
                let answer = runner.run_one(sequence, |calls| {
                    subject.calls(&calls, &mut tally.borrow_mut());
                    Ok(())
                });
                answer.unwrap_or_else(|error| panic!("{error}"));
            }
            if asked.is_some() {
                println!("{name}, interface {kind}: {each} calls took {:?}", begun.elapsed());
            }
        }
    }
    println!("{}", tally.borrow());
}
