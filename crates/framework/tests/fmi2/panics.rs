//! A fault in a model stays inside its instance: the master gets fmi2Error and a message, all other instances go on.

use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::system::{
    Declaration, Input, Invalid, Kind, NoStructure, Point, Rates, Registry, Scalar, ScalarOf, Signals, State, System,
    Values, scalar,
};
use adaptive_fmu_library::fmi2_functions::*;
use common::{ERROR, OK, Unit};

/// x' = 1; panics in its equations where the input is above 1, in `initialise` where it is below −1.
struct Panicking {
    u: ScalarOf<Input>,
    x: ScalarOf<State>,
}

impl System for Panicking {
    type Structure = NoStructure;
    const NAME: &'static str = "panicking";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Panicking { u: d.input(scalar("u", "input")), x: d.state(scalar("x", "state").output()) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        assert!(number(v[self.u]).is_none_or(|u| u >= -1.0), "a fault 100% in the start");
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        assert!(number(v[self.u]).is_none_or(|u| u <= 1.0), "a fault 100% in the equations");
        dx[self.x] = S::from(1.0);
    }
}

/// Access that equations should not have.
fn number<S: Scalar>(value: S) -> Option<f64> {
    (&value as &dyn std::any::Any).downcast_ref().copied()
}

/// Panics while its variables are declared.
struct Stillborn;

impl System for Stillborn {
    type Structure = NoStructure;
    const NAME: &'static str = "stillborn";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, _: &mut Declaration) -> Result<Self, Invalid> {
        panic!("a fault in the declaration")
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
}

static REGISTRY: Registry = &[Kind::of::<Panicking>(), Kind::of::<Stillborn>()];

fn unit() -> Unit {
    Unit::of(REGISTRY, "name = \"Test\"\nmodel = \"panicking\"\ndescription = \"\"\n")
}

fn poisoned() -> Unit {
    let unit = unit();
    unit.start(0.0);
    unit.put("u", 2.0);
    assert_eq!(unit.step(0.0, 0.1), ERROR);
    unit
}

#[test]
fn a_fault_in_a_step_is_an_error_with_a_message() {
    let unit = poisoned();
    let (status, category, message) = unit.messages().pop().expect("a message");
    assert_eq!((status, category.as_str()), (ERROR as i32, "logStatusError"));
    for part in ["fmi2DoStep", "a fault 100", "in the equations", "panics.rs", "Free"] {
        assert!(message.contains(part), "`{message}` names {part}");
    }
    assert!(common::is_plain_format(&message) && message.contains("100%%") && !message.contains('\n'), "{message}");
}

#[test]
fn a_fault_in_initialization_mode_is_an_error_with_a_message() {
    let unit = unit();
    unit.enter(0.0);
    unit.put("u", -2.0);
    assert_eq!(unit.exit(), ERROR);
    let message = unit.last_message();
    assert!(message.contains("fmi2ExitInitializationMode") && message.contains("in the start"), "{message}");
    assert_eq!(unit.reset(), ERROR, "nothing can be relied on any more");
}

#[test]
fn after_a_fault_an_instance_can_only_be_freed() {
    let unit = poisoned();
    let (c, x) = (unit.component, unit.reference("x"));
    unit.messages();
    let answers = unsafe {
        [
            fmi2GetReal(c, &x, 1, &mut 0.0),
            fmi2SetReal(c, &unit.reference("u"), 1, &0.0),
            fmi2DoStep(c, 0.0, 0.1, TRUE),
            fmi2Reset(c),
            fmi2Terminate(c),
            fmi2GetFMUstate(c, &mut null_mut()),
            fmi2SetFMUstate(c, null_mut()),
            fmi2SetDebugLogging(c, TRUE, 0, null()),
            fmi2SetupExperiment(c, FALSE, 0.0, 0.0, FALSE, 0.0),
            fmi2EnterInitializationMode(c),
            fmi2GetStatus(c, status_kind::DO_STEP, &mut 0),
            fmi2GetRealStatus(c, status_kind::LAST_SUCCESSFUL_TIME, &mut 0.0),
            fmi2GetRealOutputDerivatives(c, &x, 1, &1, &mut 0.0),
            fmi2SetRealInputDerivatives(c, &x, 1, &1, &0.0),
        ]
    };
    assert!(answers.iter().all(|answer| *answer == ERROR), "{answers:?}");
    let messages = unit.messages();
    assert_eq!(messages.len(), answers.len(), "each refusal says why");
    assert!(messages.iter().all(|(_, _, text)| text.contains("free it")), "{messages:?}");
}

#[test]
fn other_instances_go_on_after_a_fault() {
    let other = unit();
    other.start(0.0);
    other.run(0.0, 3, 0.1);
    let faulty = poisoned();
    other.run(0.3, 3, 0.1);
    drop(faulty);
    other.run(0.6, 3, 0.1);
    assert!((other.get("x") - 0.9).abs() < 1e-12);
    let new = unit();
    new.start(0.0);
    assert_eq!(new.step(0.0, 0.1), OK);
}

#[test]
fn a_fault_in_one_thread_does_not_reach_another() {
    let threads: Vec<_> = (0..8)
        .map(|k| {
            std::thread::spawn(move || {
                if k % 2 == 0 {
                    drop(poisoned());
                } else {
                    let unit = unit();
                    unit.start(0.0);
                    unit.run(0.0, 100, 0.01);
                    assert!((unit.get("x") - 1.0).abs() < 1e-12);
                }
            })
        })
        .collect();
    threads.into_iter().for_each(|thread| thread.join().unwrap());
}

/// Test for a process of its own; the next test starts it.
#[test]
#[ignore = "run by the next test"]
fn faults_of_all_sorts() {
    a_fault_in_a_step_is_an_error_with_a_message();
    a_fault_in_initialization_mode_is_an_error_with_a_message();
    a_fault_in_one_thread_does_not_reach_another();
    a_fault_in_a_declaration_gives_no_instance_and_a_message();
}

#[test]
fn a_fault_prints_nothing_into_the_streams_of_the_host() {
    let host = std::env::current_exe().unwrap();
    let options = ["--exact", "panics::faults_of_all_sorts", "--ignored", "--nocapture", "--quiet"];
    let done = std::process::Command::new(host).args(options).env("RUST_BACKTRACE", "full").output().unwrap();
    let [out, errors] = [done.stdout, done.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(done.status.success() && out.contains("1 passed"), "{out}{errors}");
    assert!(errors.is_empty() && !out.contains("fault in"), "{out}{errors}");
}

#[test]
fn a_fault_in_a_declaration_gives_no_instance_and_a_message() {
    let folder = tempfile::tempdir().unwrap();
    let text = "name = \"Test\"\nmodel = \"stillborn\"\ndescription = \"\"\n";
    std::fs::write(folder.path().join("description.toml"), text).unwrap();
    let log = std::cell::RefCell::new(Vec::new());
    let request = common::Request {
        registry: REGISTRY,
        name: Some("unit".to_owned()),
        kind: CO_SIMULATION,
        guid: Some("{0}".to_owned()),
        location: Some(folder.path().to_str().unwrap().to_owned()),
    };
    assert!(request.make(&common::callbacks(&log)).is_null());
    let (_, _, message) = log.take().pop().expect("a message");
    assert!(message.contains("fmi2Instantiate") && message.contains("a fault in the declaration"), "{message}");
}
