//! Several steps in one call, outside the standard, for this program's own loops.

use adaptive_fmu_library::fmi2_functions::*;
use common::loops::whole;
use common::{OK, Unit};

fn do_steps(unit: &Unit, times: &[f64], references: &[u32], rows: &mut [f64]) -> usize {
    assert_eq!(rows.len(), (times.len() - 1) * references.len());
    // SAFETY: the instance is alive, and the arrays have the lengths that are given.
    unsafe {
        let (count, width) = (times.len(), references.len());
        adaptive_fmu_do_steps(unit.component, times.as_ptr(), count, references.as_ptr(), width, rows.as_mut_ptr())
    }
}

#[test]
fn rows_have_the_values_of_all_types_that_single_steps_have() {
    let text = whole("3.2.1-cosine");
    let (singly, at_once) = (Unit::from_text(&text), Unit::from_text(&text));
    let names =
        ["plant.y[1]", "controller.u[1]", "controller.projection_active", "controller.step_too_long", "plant.omega"];
    let references: Vec<u32> = names.iter().map(|name| singly.reference(name)).collect();
    for unit in [&singly, &at_once] {
        unit.start(0.0);
        assert_eq!(unit.step(0.0, 1e-3), OK);
    }
    let times: Vec<f64> = (1..=201).map(|k| f64::from(k) * 1e-3).collect();
    let mut rows = vec![f64::NAN; 200 * names.len()];
    assert_eq!(do_steps(&at_once, &times, &references, &mut rows), 200);
    for (k, row) in rows.chunks(names.len()).enumerate() {
        assert_eq!(singly.step(times[k], times[k + 1] - times[k]), OK);
        let [y, u] = [0, 1].map(|i| singly.get(names[i]));
        let (active, too_long) = (singly.get_integer(names[2]), singly.get_boolean(names[3]));
        assert!((row[0] - y).abs() < 1e-6 && (row[1] - u).abs() < 1e-4 * u.abs().max(1.0), "{k}: {row:?}, {y}, {u}");
        assert_eq!(row[2..], [f64::from(active), f64::from(u8::from(too_long)), singly.get(names[4])], "{k}");
    }
    // Both go on as usual.
    assert_eq!([&singly, &at_once].map(|unit| unit.step(times[200], 1e-3)), [OK, OK]);
}

#[test]
fn what_is_no_way_ahead_is_left_alone() {
    let unit = Unit::from_text(&whole("3.2.1-cosine"));
    let y = [unit.reference("plant.y[1]")];
    assert_eq!(unit.setup(0.0, Some(0.01)), OK);
    // SAFETY: the instance is alive.
    assert_eq!(unsafe { fmi2EnterInitializationMode(unit.component) }, OK);
    assert_eq!(unit.exit(), OK);
    assert_eq!(do_steps(&unit, &[0.0, 1e-3, 2e-3], &y, &mut [0.0; 2]), 0, "the first step");
    assert_eq!(unit.step(0.0, 1e-3), OK);
    let before = unit.values();
    for times in
        [[1e-3, 1e-3, 2e-3], [1e-3, 2e-3, 1.5e-3], [2e-3, 3e-3, 4e-3], [1e-3, f64::NAN, 3e-3], [1e-3, 5e-3, 0.02]]
    {
        assert_eq!(do_steps(&unit, &times, &y, &mut [0.0; 2]), 0, "{times:?}");
    }
    assert_eq!(do_steps(&unit, &[1e-3], &y, &mut []), 0);
    assert_eq!(unit.values(), before);
    let mut row = [0.0];
    assert_eq!(do_steps(&unit, &[1e-3, 2e-3], &[u32::MAX], &mut row), 1);
    assert!(row[0].is_nan(), "no variable has this reference");
    assert_eq!(do_steps(&unit, &[2e-3, 0.01], &y, &mut row), 1, "to the stop time");
}
