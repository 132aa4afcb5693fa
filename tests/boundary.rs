//! The boundary as a master sees it.

mod common;

use common::*;

#[test]
fn the_loop_of_example_3_2_1_follows_its_ideal_model() {
    let (reference, plant, controller) =
        (Unit::started("ReferenceNonlinearSiso"), Unit::started("NonlinearSiso"), Unit::started("L1NonlinearSiso"));
    let step = 1e-3;
    for k in 0..5000 {
        let t = f64::from(k) * step;
        assert_eq!(reference.step(t, step), OK);
        plant.set("u[1]", controller.get("u[1]"));
        assert_eq!(plant.step(t, step), OK);
        controller.set("r[1]", reference.get("r[1]"));
        controller.set("x[1]", plant.get("x[1]"));
        controller.set("x[2]", plant.get("x[2]"));
        assert_eq!(controller.step(t, step), OK, "{:?}", controller.messages());
    }
    // The continuous loop, integrated independently at a tolerance of 1e-8, has x1 = 1.5876 and u = -1.2999 here.
    assert!((plant.get("y[1]") - 1.5876).abs() < 2e-3, "{}", plant.get("y[1]"));
    assert!((controller.get("u[1]") + 1.2999).abs() < 2e-2, "{}", controller.get("u[1]"));
}
