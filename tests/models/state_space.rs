//! The linear plant of given matrices, within limits, about an operating point.

use common::described::refused;
use common::{OK, Unit};

const HEAD: &str = "name = \"Mine\"\nmodel = \"state-space\"\ndescription = \"\"\n[structure]\n";

fn plant(structure: &str, start: &str) -> Unit {
    Unit::from_text(&format!("{HEAD}{structure}\n[start]\nrelative_tolerance = 1e-9\n{start}\n"))
}

#[test]
fn it_moves_by_its_matrices() {
    // x1' = x2, x2' = −2 x1 − 3 x2 + u from rest, u = 1: y1 = (1 − 2 e^(−t) + e^(−2t))/2, y2 = x2 + 4 u.
    let structure =
        "A = [[0.0, 1.0], [-2.0, -3.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0], [0.0, 1.0]]\nD = [[0.0], [4.0]]";
    let unit = plant(structure, "");
    unit.start(0.0);
    unit.put("u[1]", 1.0);
    for k in 1..=40 {
        let t = f64::from(k) * 0.1;
        unit.run(t - 0.1, 1, 0.1);
        let (y1, y2) = (0.5 - (-t).exp() + 0.5 * (-2.0 * t).exp(), (-t).exp() - (-2.0 * t).exp());
        assert!((unit.get("y[1]") - y1).abs() < 1e-7, "t = {t}");
        assert!((unit.get("y[2]") - (y2 + 4.0)).abs() < 1e-7, "t = {t}");
    }
}

#[test]
fn without_d_nothing_is_fed_through_and_a_master_is_informed() {
    use adaptive_fmu::fmi2::model_description;
    let xml = |structure: &str| {
        let text = format!("{HEAD}{structure}");
        model_description::xml(&common::described::model(&text).unwrap())
    };
    let plain = "A = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]";
    assert!(!xml(plain).contains("name=\"D["));
    let outputs = |xml: &str| xml.split("<Outputs>").nth(1).unwrap().split("</Outputs>").next().unwrap().to_owned();
    let inputs = |xml: &str| outputs(xml).lines().map(|line| line.matches(' ').count()).max();
    assert!(inputs(&xml(&format!("{plain}\nD = [[0.0]]"))) > inputs(&xml(plain)));
}

#[test]
fn the_input_acts_within_its_limits_and_a_disturbance_beyond_them() {
    let unit = plant("A = [[0.0]]\nB = [[2.0]]\nC = [[1.0]]", "u_min = [-1.0]\nu_max = [3.0]");
    unit.start(0.0);
    for (u, d, rate) in [(2.0, 0.0, 4.0), (9.0, 0.0, 6.0), (-9.0, 0.0, -2.0), (9.0, 1.0, 8.0), (0.0, -5.0, -10.0)] {
        let before = unit.get("x[1]");
        unit.put("u[1]", u);
        unit.put("d[1]", d);
        assert_eq!(unit.step(unit.last_successful_time(), 0.5), OK);
        assert!((unit.get("x[1]") - before - 0.5 * rate).abs() < 1e-9, "u = {u}, d = {d}");
    }
}

#[test]
fn it_rests_at_its_operating_point_and_deviates_from_there() {
    let structure = "A = [[-2.0]]\nB = [[4.0]]\nC = [[3.0]]";
    let unit = plant(structure, "x0 = [5.0]\nx_op = [5.0]\nu_op = [7.0]\ny_op = [100.0]");
    unit.start(0.0);
    unit.put("u[1]", 7.0);
    unit.run(0.0, 10, 0.1);
    assert_eq!((unit.get("x[1]"), unit.get("y[1]")), (5.0, 100.0));
    unit.put("u[1]", 8.0);
    unit.run(1.0, 200, 0.1);
    assert!((unit.get("x[1]") - 7.0).abs() < 1e-6 && (unit.get("y[1]") - 106.0).abs() < 1e-6);
}

#[test]
fn another_plant_than_the_described_one_is_set_while_it_runs() {
    let unit = plant("A = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]", "");
    unit.start(0.0);
    unit.put("u[1]", 1.0);
    unit.run(0.0, 200, 0.1);
    assert!((unit.get("y[1]") - 1.0).abs() < 1e-6);
    unit.put("B[1,1]", 0.5);
    unit.put("C[1,1]", 10.0);
    unit.run(20.0, 200, 0.1);
    assert!((unit.get("y[1]") - 5.0).abs() < 1e-6);
}

#[test]
fn matrices_that_do_not_fit_are_refused_with_their_sizes() {
    let large = format!("A = [{}]", vec![format!("[{}]", vec!["0.0"; 201].join(", ")); 201].join(", "));
    for (structure, named) in [
        ("A = [[0.0, 1.0]]\nB = [[1.0]]\nC = [[1.0]]".to_owned(), &["A = 1 x 2"][..]),
        ("A = [[0.0]]\nB = [[1.0], [2.0]]\nC = [[1.0]]".to_owned(), &["B = 2 x 1", "1 x 1"]),
        ("A = [[0.0]]\nB = [[1.0]]\nC = [[1.0, 2.0]]".to_owned(), &["C = 1 x 2"]),
        ("A = [[0.0]]\nB = [[1.0]]\nC = [[1.0]]\nD = [[1.0, 2.0]]".to_owned(), &["D = 1 x 2"]),
        ("A = []\nB = [[1.0]]\nC = [[1.0]]".to_owned(), &["A"]),
        (format!("{large}\nB = [[1.0]]\nC = [[1.0]]"), &["rows of A = 201", "200"]),
    ] {
        refused(&format!("{HEAD}{structure}"), named);
    }
    refused(
        &format!("{HEAD}A = [[0.0]]\nB = [[1.0]]\nC = [[1.0]]\n[start]\nu_min = [2.0]\nu_max = [1.0]"),
        &["u_min[1]"],
    );
}
