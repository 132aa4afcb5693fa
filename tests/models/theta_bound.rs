//! Bounds of single elements of theta: a matrix in the place of a list, one number a row.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::fmi2::model_description;
use adaptive_fmu::model::Model;
use adaptive_fmu::report::Value;
use adaptive_fmu::system::{Causality, Verdict};
use common::described::{model, open_description, refused};
use common::description;
use common::models::Run;

/// A controller of three states with three inputs.
const COUPLED: &str = "L1CoupledMimo";

/// Bounds of it that are all different, but for two that are zero.
const BOUNDS: [[f64; 3]; 3] = [[0.5, 1.0, 2.0], [0.0, 3.0, 0.1], [4.0, 0.2, 0.0]];

/// A description of this package with a regressor and further start values.
fn law(name: &str, regressor: &str, start: &str) -> String {
    let mut text: toml::Table = open_description(name).parse().unwrap();
    text["structure"].as_table_mut().unwrap().insert("regressor".to_owned(), regressor.into());
    let own = text["start"].as_table_mut().unwrap();
    own.remove("theta_bound");
    own.extend(start.parse::<toml::Table>().unwrap());
    text.to_string()
}

fn bounded(start: &str) -> String {
    law(COUPLED, "state", start)
}

fn names(model: &Model, array: &str) -> Vec<String> {
    let visible = model.variables().visible().filter(|element| element.variable.name == array);
    // A derivative has the name of its state, as der(…).
    visible.map(|element| element.name()).filter(|name| name.starts_with(array)).collect()
}

/// A controller whose state moves as no plant's does.
fn driven(text: &str, steps: usize, mut look: impl FnMut(&Run)) {
    let model = model(text).unwrap();
    let step = model.description().experiment.step;
    let inputs: Vec<_> = ["x", "r"].into_iter().flat_map(|array| names(&model, array)).collect();
    let mut run = Run(Execution::new(model));
    run.0.initialise().unwrap();
    for k in 0..steps {
        for (i, name) in inputs.iter().enumerate() {
            run.set(name, 0.5 * ((3.0 + i as f64) * k as f64 * step + i as f64).sin());
        }
        run.step(step);
        look(&run);
    }
}

/// The bits of every variable but the bounds, after each step.
fn bits(text: &str) -> Vec<u64> {
    let mut bits = Vec::new();
    driven(text, 60, |run| {
        let visible = run.0.model().variables().visible();
        let compared = visible.filter(|it| it.variable.is_real() && it.variable.name != "theta_bound");
        bits.extend(compared.map(|element| run.get(&element.name()).to_bits()));
    });
    bits
}

#[test]
fn a_matrix_of_equal_columns_is_the_same_law_as_a_list() {
    for name in [COUPLED, "L1NonlinearSiso", "L1UnmatchedMimo", "L1PpfCoupledMimo", "FuzzyL1CoupledMimo", "L1Quadrotor"]
    {
        for method in ["automatic", "explicit"] {
            let with = |bound: toml::Value| {
                law(name, "state", &format!("theta_bound = {bound}\nintegration_method = '{method}'"))
            };
            let shape = model(&law(name, "state", "")).unwrap();
            let (m, all) = (names(&shape, "theta_bound").len(), names(&shape, "theta_hat").len());
            // Some that the estimates reach, and some that they don't.
            let bounds: Vec<_> = (0..m).map(|i| 0.05 * 20_f64.powi(i as i32)).collect();
            let rows: Vec<_> = bounds.iter().map(|&bound| vec![bound; all / m]).collect();
            assert!(bits(&with(bounds.into())) == bits(&with(rows.into())), "{name}, {method}");
        }
    }
}

#[test]
fn each_estimate_keeps_to_its_own_bound() {
    let bound = toml::Value::from(BOUNDS.map(|row| row.to_vec()).to_vec());
    for method in ["automatic", "explicit"] {
        let mut largest = [[0.0_f64; 3]; 3];
        driven(&bounded(&format!("theta_bound = {bound}\nintegration_method = '{method}'")), 2000, |run| {
            for (i, j) in (0..9).map(|k| (k / 3, k % 3)) {
                largest[i][j] = largest[i][j].max(run.get(&format!("theta_hat[{},{}]", i + 1, j + 1)).abs());
            }
        });
        let parts = largest.as_flattened().iter().zip(BOUNDS.as_flattened());
        for (largest, bound) in parts {
            assert!((0.9 * bound..=bound * (1.0 + 1e-3)).contains(largest), "{method}: {largest} of {bound}");
        }
    }
}

#[test]
fn its_variables_have_two_indices_in_the_order_of_the_estimates() {
    let bound = toml::Value::from(BOUNDS.map(|row| row.to_vec()).to_vec());
    let unit = model(&bounded(&format!("theta_bound = {bound}"))).unwrap();
    let (bounds, estimates) = (names(&unit, "theta_bound"), names(&unit, "theta_hat"));
    assert_eq!((bounds.len(), bounds[1].as_str()), (9, "theta_bound[1,2]"));
    assert!(bounds.iter().zip(&estimates).all(|(bound, estimate)| bound.replace("bound", "hat") == *estimate));
    let xml = model_description::xml(&unit);
    let started = |name: &str| {
        let variable =
            xml.split(&format!("name=\"{name}\"")).nth(1).unwrap().split("</ScalarVariable>").next().unwrap();
        variable.split("start=\"").nth(1).unwrap().split('"').next().unwrap().parse::<f64>().unwrap()
    };
    assert_eq!([started("theta_bound[1,3]"), started("theta_bound[3,1]")], [2.0, 4.0]);
    let list = model(&bounded("theta_bound = [5.0, 6.0, 7.0]")).unwrap();
    assert_eq!(names(&list, "theta_bound"), ["theta_bound[1]", "theta_bound[2]", "theta_bound[3]"]);
    // Of one input with two states, too.
    let row = |bound: &str| model(&law("L1NonlinearSiso", "state", &format!("theta_bound = {bound}"))).unwrap();
    assert_eq!(names(&row("[10.0]"), "theta_bound"), ["theta_bound[1]"]);
    assert_eq!(names(&row("[[10.0, 5.0]]"), "theta_bound"), ["theta_bound[1,1]", "theta_bound[1,2]"]);
}

#[test]
fn elements_can_be_given_one_by_one() {
    let start = |text: &str, name: &str| {
        let unit = model(text).unwrap();
        unit.start().reals[unit.variables().index(unit.variables().find(name).unwrap())]
    };
    let rows = "theta_bound = [[1, 1, 1], [2, 2, 2], [3, 3, 3]]\n'theta_bound[2,3]' = 7";
    assert_eq!(["theta_bound[2,3]", "theta_bound[2,2]"].map(|name| start(&bounded(rows), name)), [7.0, 2.0]);
    let alone = bounded("'theta_bound[2,3]' = 7");
    assert_eq!(["theta_bound[2,3]", "theta_bound[3,2]"].map(|name| start(&alone, name)), [7.0, 0.0]);
    refused(
        &bounded("theta_bound = [1, 2, 3]\n'theta_bound[2,3]' = 7"),
        &["[start] theta_bound = [1, 2, 3]", "3 rows of 3"],
    );
    refused(
        &bounded("theta_bound = [1, 2, 3]\n'theta_bound[4]' = 7"),
        &["[start] theta_bound[4]", "no such parameter"],
    );
}

#[test]
fn what_does_not_fit_is_refused() {
    let named = ["theta_bound = a matrix", "list of 3 numbers", "infinity_norm", "regressor = \"state\""];
    refused(&law(COUPLED, "infinity_norm", "theta_bound = [[1], [2], [3]]"), &named);
    refused(&law(COUPLED, "infinity_norm", "'theta_bound[1,1]' = 1"), &named);
    for wrong in ["[[1, 2, 3]]", "[[1], [2], [3]]", "[[1, 2, 3], [1, 2, 3], 4]"] {
        refused(&bounded(&format!("theta_bound = {wrong}")), &["[start] theta_bound", "3 rows of 3 numbers"]);
    }
    let negative = bounded("theta_bound = [[1, 2, 3], [1, -2, 3], [1, 2, 3]]");
    refused(&negative, &["theta_bound[2,2] = -2"]);
    // Another law, whose bound is of rows.
    let mrac = description("MracPpfUnmatchedMimo").replace("[40.0, 40.0, 40.0]", "[[40.0], [40.0], [40.0]]");
    refused(&mrac, &["[start] theta_bound", "must be a finite number"]);
}

#[test]
fn laws_without_estimates_take_it_too() {
    for name in ["L1LimitNonlinearSiso", "L1SampledNonlinearSiso"] {
        let unit = model(&law(name, "state", "theta_bound = [[10.0, 5.0]]")).unwrap();
        assert!(names(&unit, "theta_bound").is_empty());
    }
}

#[test]
fn a_part_of_a_composite_has_its_own() {
    let whole = |of_part: &str, start: &str| {
        let law: toml::Table = bounded(of_part).parse().unwrap();
        let part = |name: &str, start: toml::Value| {
            let mut part = toml::Table::new();
            part.extend([("name", name.into()), ("model", "l1".into()), ("start", start)].map(|(k, v)| (k.into(), v)));
            part.insert("structure".to_owned(), law["structure"].clone());
            toml::Value::from(part)
        };
        let mut listed = law["start"].clone();
        listed.as_table_mut().unwrap().retain(|name, _| !name.starts_with("theta_bound"));
        let mut text: toml::Table = "name = 'Whole'\nmodel = 'composite'\ndescription = ''".parse().unwrap();
        let parts = vec![part("one", law["start"].clone()), part("other", listed)];
        let parts = toml::Table::from_iter([("parts".to_owned(), toml::Value::from(parts))]);
        text.insert("structure".to_owned(), parts.into());
        text.insert("start".to_owned(), start.parse::<toml::Table>().unwrap().into());
        text.to_string()
    };
    let rows = "[[1, 2, 3], [4, 5, 6], [7, 8, 9]]";
    let own = model(&whole(&format!("theta_bound = {rows}"), "")).unwrap();
    let outer = model(&whole("", &format!("'one.theta_bound' = {rows}\n'other.theta_bound' = [1, 2, 3]"))).unwrap();
    for unit in [own, outer] {
        let element = unit.variables().find("one.theta_bound[2,3]").unwrap();
        assert_eq!(unit.start().reals[unit.variables().index(element)], 6.0);
        assert_eq!(element.variable.causality, Causality::Parameter);
        assert_eq!(names(&unit, "other.theta_bound").len(), 3);
    }
    refused(&whole("theta_bound = [1, 2, 3]", &format!("'one.theta_bound' = {rows}")), &["one.theta_bound", "3 rows"]);
}

#[test]
fn the_report_is_about_each_element() {
    let bound = toml::Value::from(BOUNDS.map(|row| row.to_vec()).to_vec());
    let found = |start: &str, name: &str| {
        let report = model(&bounded(start)).unwrap().report();
        let finding = report.findings.iter().find(|finding| finding.name == name);
        finding.unwrap_or_else(|| panic!("`{name}` among {:?}", report.findings)).clone()
    };
    // The largest sum of a row; of a list, three times the largest.
    assert_eq!(found(&format!("theta_bound = {bound}"), "L").value, Value::Number(4.2));
    assert_eq!(found("theta_bound = [1, 2, 3]", "L").value, Value::Number(9.0));
    // K_m = A − A_m = [34 36 0; 0 80 −1; 0 1 57], nine times.
    let left = |of_2_3: f64| {
        let start = format!("theta_bound = [[307, 325, 0.1], [0.1, 721, {of_2_3}], [0.1, 9.1, 514]]");
        found(&start, "(omega - I) K_m")
    };
    let (enough, less) = (left(9.1), left(8.9));
    assert!(matches!(&enough.value, Value::Matrix(rows) if rows.len() == 3), "{:?}", enough.value);
    assert_eq!((enough.verdict, less.verdict), (Verdict::Ok, Verdict::Warning));
    assert!(enough.note.contains("one element of theta"), "{}", enough.note);
}

/// COUPLED with these magnitudes of its states.
fn scaled(scale: &str, regressor: &str) -> String {
    let bounds = if regressor == "state" {
        "theta_bound = [[9, 9, 9], [9, 9, 9], [9, 9, 9]]"
    } else {
        "theta_bound = [9, 9, 9]"
    };
    let mut text: toml::Table = law(COUPLED, regressor, bounds).parse().unwrap();
    let scale = format!("state_scale = {scale}").parse::<toml::Table>().unwrap();
    text["structure"].as_table_mut().unwrap().extend(scale);
    text.to_string()
}

/// The first motion of an estimate, and its part of the control's estimate, depend on x/state_scale.
#[test]
fn theta_multiplies_states_in_parts_of_their_magnitudes() {
    let moved = |text: &str| {
        let mut run = Run(Execution::new(model(text).unwrap()));
        run.0.initialise().unwrap();
        let x = names(run.0.model(), "x");
        x.iter().enumerate().for_each(|(i, name)| run.set(name, 0.3 + 0.1 * i as f64));
        run.step(1e-7);
        names(run.0.model(), "theta_hat").iter().map(|name| run.get(name)).collect::<Vec<_>>()
    };
    let (plain, scaled) = (moved(&scaled("[1.0, 1.0, 1.0]", "state")), moved(&scaled("[2.0, 0.5, 1e5]", "state")));
    // In rows, an element of each state.
    for (k, (plain, scaled)) in plain.iter().zip(&scaled).enumerate() {
        let expected = plain / [2.0, 0.5, 1e5][k % 3];
        assert!(*plain != 0.0 && (scaled - expected).abs() <= 1e-3 * expected.abs(), "{k}: {scaled} for {expected}");
    }
}

#[test]
fn magnitudes_that_are_none_are_refused() {
    for (scale, named) in
        [("[1.0, 2.0]", "2 numbers"), ("[1.0, 0.0, 1.0]", "= 0"), ("[1.0, inf, 1.0]", "finite numbers above 0")]
    {
        refused(&scaled(scale, "state"), &["state_scale", named]);
    }
    refused(&scaled("[1.0, 1.0, 1.0]", "infinity_norm"), &["state_scale", "regressor = \"state\""]);
}
