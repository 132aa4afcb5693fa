//! Saving, restoring and serialising: a continuation is the same, bit for bit.

use std::ptr::null_mut;

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu_library::fmi2_functions::*;
use common::loops::{Loop, STEP};
use common::*;

/// Saves all units of a loop, runs it on with `go_on`, restores, runs again, and compares bit for bit.
fn continues_alike(units: &Loop, go_on: impl Fn(&Loop)) {
    let saved = units.units().map(|unit| (unit, unit.save(), unit.fingerprint()));
    go_on(units);
    let first = units.fingerprint();
    for (unit, state, fingerprint) in &saved {
        assert_eq!(unit.restore(*state), OK);
        assert_eq!(&unit.fingerprint(), fingerprint, "as when it was saved");
    }
    go_on(units);
    assert_eq!(units.fingerprint(), first);
    // Once more, from bytes, in units that never ran.
    let others = Loop::started();
    for (other, (_, _, fingerprint)) in others.units().into_iter().zip(&saved) {
        let (status, state) = other.deserialise(fingerprint);
        assert_eq!(status, OK, "{:?}", other.messages());
        assert_eq!(other.restore(state), OK);
    }
    go_on(&others);
    assert_eq!(others.fingerprint(), first);
}

#[test]
fn a_restored_loop_continues_bit_for_bit() {
    for start in [0, 1, 2, 777] {
        let units = Loop::started();
        units.run(0..start);
        continues_alike(&units, |units| units.run(start..start + 200));
    }
}

#[test]
fn parameters_that_are_set_but_not_yet_in_force_are_part_of_a_state() {
    let units = Loop::started();
    units.run(0..100);
    units.controller.put("adaptation_gain", 3e4);
    units.controller.put("omega_max[1,1]", 2.0);
    continues_alike(&units, |units| {
        units.run(100..200);
        assert_eq!(units.controller.get("adaptation_gain"), 3e4);
    });
}

#[test]
fn an_invalid_set_that_waits_for_its_step_is_refused_after_restoring_too() {
    let units = Loop::started();
    units.run(0..100);
    units.controller.put("adaptation_gain", -1.0);
    continues_alike(&units, |units| {
        assert_eq!(units.controller.step(100.0 * STEP, STEP), ERROR);
        assert_eq!(units.controller.get("adaptation_gain"), 1e5);
        units.run(100..150);
    });
}

#[test]
fn input_derivatives_that_wait_for_their_step_are_part_of_a_state() {
    let units = Loop::started();
    units.run(0..100);
    assert_eq!(units.controller.set_slope("x[2]", -20.0), OK);
    let without = Loop::started();
    without.run(0..100);
    continues_alike(&units, |units| units.run(100..150));
    without.run(100..150);
    assert_ne!(units.controller.values(), without.controller.values(), "the derivative mattered");
}

#[test]
fn the_memory_of_extrapolated_inputs_is_part_of_a_state() {
    for handling in [2, 3] {
        let units = Loop::new();
        for unit in [&units.plant, &units.controller] {
            assert_eq!(unit.set_integer("input_handling", handling), OK);
        }
        units.units().iter().for_each(|unit| unit.start(0.0));
        units.run(0..150);
        continues_alike(&units, |units| units.run(150..250));
    }
}

#[test]
fn a_state_saved_in_initialization_mode_initialises_alike() {
    let unit = Unit::new("L1NonlinearSiso");
    unit.enter(0.0);
    unit.put("x[1]", 0.6);
    let state = unit.save();
    let finish = || {
        assert_eq!(unit.exit(), OK);
        unit.run(0.0, 20, STEP);
        unit.fingerprint()
    };
    let first = finish();
    assert_eq!(unit.restore(state), OK);
    assert_eq!(unit.get("x_hat[1]"), 0.6);
    assert_eq!(finish(), first);
}

#[test]
fn restoring_a_state_takes_an_instance_out_of_its_error() {
    let plant = Unit::started("NonlinearSiso");
    plant.put("u[1]", 0.1);
    plant.run(0.0, 10, 0.01);
    let good = plant.save();
    plant.put("u[1]", 1e9);
    let before = plant.values();
    assert_eq!(plant.step(0.1, 10.0), ERROR);
    assert_eq!(plant.values(), before, "values are as before the failed step");
    let failed = plant.save();
    assert_eq!(plant.restore(good), OK);
    assert_eq!(plant.step(0.1, 0.01), OK, "{:?}", plant.messages());
    let twin = Unit::started("NonlinearSiso");
    twin.put("u[1]", 0.1);
    twin.run(0.0, 11, 0.01);
    assert_eq!(plant.values(), twin.values());
    assert_eq!(plant.restore(failed), OK);
    plant.refuses(&["fmi2DoStep"], |plant| plant.step(0.1, 0.01));
}

#[test]
fn a_state_may_be_restored_after_terminate_and_after_reset() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    unit.run(0.0, 3, 0.5);
    let state = unit.save();
    unit.run(1.5, 3, 0.5);
    let expected = unit.fingerprint();
    for end in [Unit::terminate, Unit::reset] {
        assert_eq!(end(&unit), OK);
        assert_eq!(unit.restore(state), OK);
        unit.run(1.5, 3, 0.5);
        assert_eq!(unit.fingerprint(), expected);
    }
}

#[test]
fn the_stop_time_is_part_of_a_state() {
    let unit = Unit::new("ReferenceNonlinearSiso");
    assert_eq!(unit.setup(0.0, Some(1.0)), OK);
    assert_eq!(unsafe { fmi2EnterInitializationMode(unit.component) }, OK);
    assert_eq!(unit.exit(), OK);
    let bytes = unit.fingerprint();
    let other = Unit::started("ReferenceNonlinearSiso");
    let (_, state) = other.deserialise(&bytes);
    assert_eq!(other.restore(state), OK);
    other.refuses(&["stopTime = 1"], |other| other.step(0.0, 2.0));
}

#[test]
fn a_state_is_saved_again_into_the_place_of_an_old_one() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    let old = unit.save();
    unit.run(0.0, 2, 0.5);
    let mut place = old;
    assert_eq!(unsafe { fmi2GetFMUstate(unit.component, &mut place) }, OK);
    assert_eq!(place, old, "the master's own pointer stays as it is");
    let later = unit.fingerprint();
    unit.run(1.0, 2, 0.5);
    assert_eq!(unit.restore(place), OK);
    assert_eq!(unit.fingerprint(), later);
}

#[test]
fn truncated_and_lengthened_bytes_are_refused() {
    let units = Loop::started();
    units.run(0..50);
    let unit = &units.controller;
    let whole = unit.fingerprint();
    for length in 0..whole.len() {
        unit.refuses(&["fmi2DeSerializeFMUstate"], |unit| unit.deserialise(&whole[..length]).0);
    }
    for more in [1, 8, 4096] {
        let longer = [&whole[..], &vec![0; more]].concat();
        unit.refuses(&["fmi2DeSerializeFMUstate"], |unit| unit.deserialise(&longer).0);
    }
}

#[test]
fn a_flipped_bit_at_any_place_is_noticed() {
    let units = Loop::started();
    units.run(0..50);
    let unit = &units.controller;
    let whole = unit.fingerprint();
    for place in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[place] ^= 1 << (place % 8);
        unit.refuses(&["fmi2DeSerializeFMUstate"], |unit| unit.deserialise(&flipped).0);
    }
    assert_eq!(unit.deserialise(&whole).0, OK, "and the bytes themselves are good");
}

#[test]
fn a_state_of_another_unit_is_refused() {
    let units = Loop::started();
    let other_start = description("L1NonlinearSiso").replace("1e5", "2e5");
    // The same variables, and as many: only the plant that the controller was made for is another.
    let other_plant = description("L1NonlinearSiso").replace("[[0.0], [1.0]]", "[[0.0], [2.0]]");
    let foreign = [
        units.plant.fingerprint(),
        units.reference.fingerprint(),
        Unit::from_text(&other_start).fingerprint(),
        Unit::from_text(&other_plant).fingerprint(),
    ];
    for (index, bytes) in foreign.iter().enumerate() {
        assert_eq!(units.controller.deserialise(bytes).0, ERROR, "foreign state {index}");
        units.controller.refuses(&["fmi2DeSerializeFMUstate"], |unit| unit.deserialise(bytes).0);
    }
}

#[test]
fn a_pointer_that_is_no_saved_state_is_refused_and_never_followed() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    let state = unit.save();
    for address in [1, 2, 0xffff, 0x1_0000, 0x1_0002, 0x2_0001, usize::MAX, usize::MAX / 2, &raw const unit as usize] {
        let never_given = address as FmuState;
        assert_ne!(never_given, state);
        let refused = |name: &str, call: &dyn Fn() -> Status| unit.refuses(&[name, "saved state"], |_| call());
        refused("fmi2SetFMUstate", &|| unit.restore(never_given));
        refused("fmi2FreeFMUstate", &|| unit.free(never_given));
        refused("fmi2GetFMUstate", &|| unsafe { fmi2GetFMUstate(unit.component, &mut never_given.clone()) });
        refused("fmi2SerializedFMUstateSize", &|| unsafe {
            fmi2SerializedFMUstateSize(unit.component, never_given, &mut 0)
        });
        refused("fmi2SerializeFMUstate", &|| unsafe {
            fmi2SerializeFMUstate(unit.component, never_given, vec![0_u8; 9999].as_mut_ptr().cast(), 9999)
        });
    }
}

#[test]
fn a_saved_state_of_another_instance_is_refused_also_where_both_are_the_first() {
    let (unit, other) = (Unit::started("ReferenceNonlinearSiso"), Unit::started("ReferenceNonlinearSiso"));
    unit.run(0.0, 1, 0.5);
    let (own, foreign) = (unit.save(), other.save());
    unit.refuses(&["fmi2SetFMUstate", "saved state"], |unit| unit.restore(foreign));
    unit.refuses(&["fmi2FreeFMUstate", "saved state"], |unit| unit.free(foreign));
    assert_eq!((unit.restore(own), other.restore(foreign)), (OK, OK));
}

#[test]
fn a_freed_state_is_refused_also_when_a_new_one_took_its_place() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    let freed = unit.save();
    let mut pointer = freed;
    assert_eq!(unsafe { fmi2FreeFMUstate(unit.component, &mut pointer) }, OK);
    assert_eq!(pointer, null_mut(), "the standard: the pointer is set to NULL");
    unit.refuses(&["fmi2SetFMUstate"], |unit| unit.restore(freed));
    let new = unit.save();
    assert_ne!(new, freed);
    unit.refuses(&["fmi2SetFMUstate"], |unit| unit.restore(freed));
    unit.refuses(&["fmi2FreeFMUstate"], |unit| unit.free(freed));
    assert_eq!(unit.restore(new), OK);
}

#[test]
fn a_freed_state_stays_refused_however_many_are_saved_after_it() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    let freed = unit.save();
    assert_eq!(unit.free(freed), OK);
    // A master that saves and frees at every step of a minute at 1 ms does it this often.
    for count in 0..60_000 {
        let state = unit.save();
        assert_ne!(state, freed, "after {count} others");
        assert_eq!(unit.free(state), OK);
    }
}

#[test]
fn many_saved_states_are_independent() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    let mut saved = Vec::new();
    for k in 0..300 {
        saved.push((unit.save(), unit.get("r[1]")));
        unit.run(f64::from(k) * 0.1, 1, 0.1);
    }
    for (state, r) in saved.iter().rev() {
        assert_eq!(unit.restore(*state), OK);
        assert_eq!(unit.get("r[1]"), *r);
    }
}
