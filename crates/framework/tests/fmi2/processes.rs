//! Saved states move between processes: serialised in one, restored in another, which goes on with the same bits.

use std::path::Path;
use std::process::Command;

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::REGISTRY;
use common::described::open_description;
use common::*;

const STEPS: usize = 10;
/// Variable with the folder that both processes share.
const FOLDER: &str = "ADAPTIVE_FMU_STATES";

fn unit(name: &str, kind: i32) -> Unit {
    Unit::made(REGISTRY, &open_description(name), kind)
}

/// Inputs that move, and parameters of a law that holds with them.
fn advance(unit: &Unit, kind: i32, from: usize) -> Vec<u64> {
    let inputs: Vec<String> = {
        let visible = unit.model.variables().visible();
        let inputs =
            visible.filter(|e| e.variable.causality == adaptive_fmu::system::Causality::Input && e.variable.is_real());
        inputs.map(|input| input.name()).collect()
    };
    let step = unit.model.description().experiment.step;
    let mut seen = Vec::new();
    for k in from..from + STEPS {
        for (i, input) in inputs.iter().enumerate() {
            unit.put(input, 0.01 * (k as f64 + i as f64).sin());
        }
        let t = k as f64 * step;
        if kind == CO_SIMULATION {
            seen.push(unit.step(t, step) as u64);
        } else {
            let h = 1e-3 * step;
            assert_eq!(unit.set_time(k as f64 * h), OK);
            let (mut x, dx) = (unit.states(), unit.derivatives());
            x.iter_mut().zip(dx).for_each(|(x, dx)| *x += h * dx);
            assert_eq!(unit.set_states(&x), OK);
            seen.push(u64::from(unit.completed_step()));
        }
        seen.extend(unit.values());
    }
    seen
}

fn as_bytes(seen: &[u64]) -> Vec<u8> {
    seen.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn every_unit(visit: impl Fn(&str, i32, &str)) {
    for name in description_names() {
        for (kind, interface) in [(CO_SIMULATION, "slave"), (MODEL_EXCHANGE, "exchange")] {
            visit(&name, kind, &format!("{name}.{interface}"));
        }
    }
}

/// Test for a process of its own; the next test starts it.
#[test]
#[ignore = "run by the next test"]
fn the_other_process() {
    let folder = std::env::var(FOLDER).unwrap();
    every_unit(|name, kind, file| {
        let unit = unit(name, kind);
        let bytes = std::fs::read(Path::new(&folder).join(file)).unwrap();
        let (status, state) = unit.deserialise(&bytes);
        assert_eq!((status, unit.restore(state)), (OK, OK), "{file}: {:?}", unit.messages());
        std::fs::write(Path::new(&folder).join(format!("{file}.seen")), as_bytes(&advance(&unit, kind, STEPS)))
            .unwrap();
    });
}

#[test]
fn a_state_that_was_saved_in_one_process_goes_on_with_the_same_bits_in_another() {
    let folder = tempfile::tempdir().unwrap();
    let mut expected = Vec::new();
    let units = std::cell::RefCell::new(&mut expected);
    every_unit(|name, kind, file| {
        let unit = unit(name, kind);
        unit.soften();
        if kind == CO_SIMULATION {
            unit.start(0.0);
        } else {
            unit.begin();
        }
        advance(&unit, kind, 0);
        std::fs::write(folder.path().join(file), unit.fingerprint()).unwrap();
        units.borrow_mut().push((file.to_owned(), as_bytes(&advance(&unit, kind, STEPS))));
    });
    let options = ["--exact", "processes::the_other_process", "--ignored", "--nocapture"];
    let mut other = Command::new(std::env::current_exe().unwrap());
    let done = other.args(options).env(FOLDER, folder.path()).output().unwrap();
    let [out, errors] = [done.stdout, done.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(done.status.success() && out.contains("1 passed"), "{out}{errors}");
    assert!(expected.len() > 70);
    for (file, seen) in expected {
        assert!(std::fs::read(folder.path().join(format!("{file}.seen"))).unwrap() == seen, "{file}");
    }
}
