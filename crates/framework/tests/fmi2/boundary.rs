//! A closed loop as a master sees it.

use adaptive_fmu_library::fmi2_functions::*;
use common::loops::Loop;
use common::*;

#[test]
fn the_loop_of_example_3_2_1_follows_its_ideal_model() {
    let units = Loop::started();
    units.run(0..5000);
    // The continuous loop, integrated independently at a tolerance of 1e-8, has x1 = 1.5876 and u = -1.2999 here.
    let (y, u) = (units.plant.get("y[1]"), units.controller.get("u[1]"));
    assert!((y - 1.5876).abs() < 2e-3, "{y}");
    assert!((u + 1.2999).abs() < 2e-2, "{u}");
}

#[test]
fn a_reset_unit_runs_as_a_new_one() {
    let (used, new) = (Loop::started(), Loop::started());
    used.controller.put("adaptation_gain", 3e4);
    used.run(0..50);
    for unit in used.units() {
        assert_eq!(unit.reset(), OK);
        unit.start(0.0);
    }
    used.run(0..50);
    new.run(0..50);
    assert_eq!(used.fingerprint(), new.fingerprint());
}

#[test]
fn instances_in_several_threads_do_not_disturb_each_other() {
    let run = || {
        let units = Loop::started();
        units.run(0..200);
        units.fingerprint()
    };
    let alone = run();
    let threads: Vec<_> = (0..4).map(|_| std::thread::spawn(run)).collect();
    for thread in threads {
        assert_eq!(thread.join().unwrap(), alone);
    }
}

#[test]
fn the_fmu_has_the_version_of_its_standard() {
    let text = |pointer| unsafe { std::ffi::CStr::from_ptr(pointer) }.to_str().unwrap();
    assert_eq!(text(unsafe { fmi2GetVersion() }), "2.0");
    assert_eq!(text(unsafe { fmi2GetTypesPlatform() }), "default");
}
