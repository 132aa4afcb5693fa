//! Units of a user's own, begun with `new`: what is written is exported as it stands, and what can't be is refused in
//! words that help.

#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu::execution::Execution;
use adaptive_fmu::fmi2::model_description;
use adaptive_fmu::library::{begin, begun};
use adaptive_fmu::model::Description;
use adaptive_fmu::nominal::Uncertainty;
use adaptive_fmu::template::{MOST, Plant, Request, Sizes};
use common::described::model;

fn request(kind: &str, states: Option<usize>, inputs: Option<usize>) -> Request<'_> {
    let sizes = Sizes { states, inputs, outputs: None };
    Request {
        kind,
        name: "Mine",
        sizes,
        plant: None,
        bandwidth: None,
        reference: &[1.0],
        uncertainty: None,
        experiment: None,
    }
}

fn begun_for(kind: &str, json: &str) -> Result<String, String> {
    let plant = Some(Plant::parse(json).map_err(|invalid| invalid.to_string())?);
    begin(&Request { plant, ..request(kind, None, None) })
        .map(|begun| begun.text)
        .map_err(|invalid| invalid.to_string())
}

#[test]
fn every_kind_of_every_size_makes_a_unit_as_it_is_written() {
    for entry in begun() {
        let kind = entry.kind.name;
        let tried = entry.template.unwrap().tried;
        assert!(!tried.is_empty(), "{kind}: sizes to try");
        for &sizes in [Sizes::NONE].iter().chain(tried) {
            let text = begin(&Request { sizes, ..request(kind, None, None) })
                .unwrap_or_else(|reason| panic!("{kind} of {sizes:?}: {reason}"));
            let model = model(&text.text).unwrap_or_else(|reason| panic!("{kind} {sizes:?}: {reason}"));
            Execution::new(model).initialise().unwrap_or_else(|reason| panic!("{kind}: {reason}"));
        }
    }
}

/// Only the number of states, up to the largest: as many inputs follow as a design in double precision needs.
#[test]
fn as_many_states_make_a_unit_as_a_user_may_ask_for() {
    for kind in ["l1", "observer", "state-space"] {
        for states in [9, 16, 32, MOST as usize] {
            let text = begin(&request(kind, Some(states), None)).unwrap_or_else(|e| panic!("{kind}, {states}: {e}"));
            let model = model(&text.text).unwrap_or_else(|reason| panic!("{kind}, {states}: {reason}"));
            Execution::new(model).initialise().unwrap_or_else(|reason| panic!("{kind}, {states}: {reason}"));
        }
    }
    for kind in ["l1", "fuzzy-l1", "observer", "mrac-ppf"] {
        for states in [20, 32, MOST as usize] {
            // One chain of so many integrators: what can't be designed is refused, with what helps.
            if let Err(refused) = begin(&request(kind, Some(states), Some(1))) {
                assert!(!refused.to_string().is_empty(), "{kind}");
            }
        }
    }
    let refused = begin(&request("l1", Some(MOST as usize), Some(1))).unwrap_err().to_string();
    assert!(!refused.is_empty(), "{refused}");
}

#[test]
fn a_new_description_can_be_read_at_a_glance() {
    for kind in begun().map(|entry| entry.kind.name) {
        let text = begin(&request(kind, None, None)).unwrap().text;
        assert!(text.lines().count() <= 45, "{kind}: {} lines", text.lines().count());
        assert!(text.lines().all(|line| line.chars().count() <= 120), "{kind}: {text}");
        let bare = |line: &&str| line.contains(" = ") && !line.contains('#');
        let silent: Vec<_> = text.lines().filter(bare).collect();
        // The model was just chosen; the matrices have a comment above.
        let known = |line: &&str| ["model", "A =", "B =", "C ="].iter().any(|key| line.starts_with(key));
        assert!(silent.iter().all(known), "{kind}: no comment at {silent:?}");
    }
}

const MOTOR: &str = r#"{"A": [[-0.5, 250.0], [-25.0, -500.0]], "B": [[0.0], [500.0]], "C": [[1.0, 0.0]], "D": 0,
    "states": ["speed", "current"], "inputs": ["voltage"], "outputs": ["speed"],
    "units": {"x": ["rad/s", "A"], "u": ["V"], "y": "rad/s"}, "u_min": -12, "u_max": 12}"#;

#[test]
fn a_plant_of_another_tool_comes_with_its_names_units_and_limits() {
    for (kind, names) in [
        ("l1", &["speed_reference", "speed", "current", "voltage"][..]),
        ("fuzzy-l1", &["speed_reference", "voltage"]),
        ("observer", &["speed", "voltage", "speed_estimate", "current_estimate"]),
        ("reference", &["speed_reference"]),
        ("sensor", &["speed", "speed_measured", "current_measured"]),
        ("actuator", &["voltage_command", "voltage"]),
        ("state-space", &["speed", "current", "voltage", "speed_output"]),
    ] {
        let text = begun_for(kind, MOTOR).unwrap_or_else(|reason| panic!("{kind}: {reason}"));
        let unit = model(&text).unwrap();
        let missing: Vec<_> = names.iter().filter(|name| unit.variables().find(name).is_none()).collect();
        assert!(missing.is_empty(), "{kind}: no {missing:?} in {text}");
    }
    let xml = model_description::xml(&model(&begun_for("l1", MOTOR).unwrap()).unwrap());
    for shown in ["name=\"current\"", "unit=\"A\"", "start=\"-12.0\""] {
        assert!(xml.contains(shown), "{shown}");
    }
}

#[test]
fn a_design_for_a_plant_has_that_plant_in_its_description() {
    let plant = || Plant::parse(&MOTOR.replace("{\"A\"", "{\"delay\": 0.002, \"A\"")).unwrap();
    let nominal = |request: &Request| {
        let begun = begin(request).map_err(|invalid| invalid.to_string())?;
        Ok::<_, String>(Description::read(&begun.text).unwrap().nominal)
    };
    for kind in ["pid", "ladrc"] {
        let asked =
            Request { plant: Some(plant()), bandwidth: Some(20.0), reference: &[100.0], ..request(kind, None, None) };
        let found = nominal(&asked).unwrap().unwrap();
        let Plant { A, B, C, delay, .. } = plant();
        assert_eq!((found.A, found.B, found.C, found.delay), (A, B, C, delay), "{kind}");
        assert_eq!((found.bandwidth, found.reference), (Some(20.0), Some(vec![100.0])), "{kind}");
        assert_eq!(found.uncertainty, Uncertainty::Unknown, "{kind}");
        let found = nominal(&Request { uncertainty: Some(0.15), ..asked }).unwrap().unwrap();
        assert_eq!(found.uncertainty, Uncertainty::Part(0.15), "{kind}");
    }
    let undelayed = Request { plant: Some(Plant::parse(MOTOR).unwrap()), ..request("funnel", None, None) };
    let found = nominal(&undelayed).unwrap().unwrap();
    assert!(found.delay == [0.0] && found.bandwidth.is_some_and(|bandwidth| bandwidth > 0.0));
    for kind in ["pid", "ladrc", "funnel"] {
        assert_eq!(nominal(&request(kind, None, None)), Ok(None), "{kind}");
        let refused = nominal(&Request { uncertainty: Some(0.2), ..request(kind, None, None) }).unwrap_err();
        assert_eq!(refused, "--uncertainty = 0.2: needs a nominal plant: give --plant");
    }
    // Controllers for uncertain plants assume 20 % by default.
    for kind in ["l1", "l1-limit", "l1-sampled", "fuzzy-l1"] {
        let asked = Request { plant: Some(Plant::parse(MOTOR).unwrap()), ..request(kind, None, None) };
        assert_eq!(nominal(&asked).unwrap().unwrap().uncertainty, Uncertainty::Part(0.2), "{kind}");
        let found = nominal(&Request { uncertainty: Some(0.1), ..asked }).unwrap().unwrap();
        assert_eq!(found.uncertainty, Uncertainty::Part(0.1), "{kind}");
    }
    let plant_of = Request { plant: Some(Plant::parse(MOTOR).unwrap()), ..request("observer", None, None) };
    assert_eq!(nominal(&plant_of).unwrap().unwrap().uncertainty, Uncertainty::Unknown);
    let refused =
        nominal(&Request { uncertainty: Some(0.0), plant: Some(plant()), ..request("state-space", None, None) });
    let allowed = "the kinds that do are l1, fuzzy-l1, l1-ppf, l1-limit, l1-sampled";
    assert!(
        refused.unwrap_err().starts_with(&format!("--uncertainty = 0: state-space doesn't use it; {}", &allowed[..20]))
    );
}

/// Output of MATLAB's jsonencode: a row or a column is a plain list, a number has no brackets.
#[test]
fn the_shapes_of_other_tools_are_read_without_doubt() {
    let matrices = |json: &str| {
        let Plant { A, B, C, D, .. } = Plant::parse(json).unwrap_or_else(|reason| panic!("{json}: {reason}"));
        (A.shape(), B.shape(), C.shape(), D.map(|D| D.shape()))
    };
    for (json, shapes) in [
        (r#"{"A":-2,"B":3,"C":1,"D":0}"#, ((1, 1), (1, 1), (1, 1), None)),
        (r#"{"A":-2,"B":[1,2],"C":[1,2,3]}"#, ((1, 1), (1, 2), (3, 1), None)),
        (r#"{"A":[[0,1],[-2,-3]],"B":[0,1],"C":[1,0],"D":0.5}"#, ((2, 2), (2, 1), (1, 2), Some((1, 1)))),
        (r#"{"A":[[0,1],[-2,-3]],"B":[[0,1],[1,0]],"C":[1,0],"D":[0.5,0]}"#, ((2, 2), (2, 2), (1, 2), Some((1, 2)))),
        (r#"{"A":[[0,1],[-2,-3]],"B":[0,1],"C":[[1,0],[0,1]],"D":[0,1]}"#, ((2, 2), (2, 1), (2, 2), Some((2, 1)))),
        (r#"{"A":[[0,1],[-2,-3]],"B":[[0],[1]],"C":[[1,0]],"D":[[0]]}"#, ((2, 2), (2, 1), (1, 2), None)),
    ] {
        assert_eq!(matrices(json), shapes, "{json}");
    }
    let B = Plant::parse(r#"{"A":[[0,1],[-2,-3]],"B":[3,4],"C":[1,0]}"#).unwrap().B;
    assert_eq!((B[(0, 0)], B[(1, 0)]), (3.0, 4.0));
}

#[test]
fn a_plant_that_is_none_is_refused_with_what_is_wrong() {
    for (json, named) in [
        ("", "not valid JSON"),
        ("{", "not valid JSON"),
        ("[1, 2]", "object"),
        (r#"{"B": 1, "C": 1}"#, "A is missing"),
        (r#"{"A": [], "B": 1, "C": 1}"#, "rows of A = 0"),
        (r#"{"A": [[1, 2], [3]], "B": [1, 0], "C": [1, 0]}"#, "A"),
        (r#"{"A": [[1, 2, 3], [3, 4, 5]], "B": [1, 0], "C": [1, 0]}"#, "A = 2 x 3"),
        (r#"{"A": [[1, "x"], [3, 4]], "B": [1, 0], "C": [1, 0]}"#, "A: must be rows of numbers"),
        (r#"{"A": [1, 2], "B": [1, 0], "C": [1, 0]}"#, "A = a list of 2 numbers"),
        (r#"{"A": [[0, 1], [2, 3]], "B": [1, 0, 0], "C": [1, 0]}"#, "B = a list of 3 numbers"),
        (r#"{"A": [[0, 1], [2, 3]], "B": [[1, 0]], "C": [1, 0]}"#, "B = 1 x 2"),
        (r#"{"A": [[0, 1], [2, 3]], "B": [0, 1], "C": [[1]]}"#, "C = 1 x 1"),
        (r#"{"A": -1, "B": 1, "C": 1, "D": [1, 2]}"#, "D"),
        (r#"{"A": -1, "B": 1, "C": 1, "E": 1}"#, "unknown key `E`"),
        (r#"{"A": -1, "B": 1, "C": 1, "states": ["a", "b"]}"#, "states: must be a list of 1 strings"),
        (r#"{"A": -1, "B": 1, "C": 1, "units": "V"}"#, "units"),
        (r#"{"A": -1, "B": 1, "C": 1, "u_max": 3}"#, "together"),
        (r#"{"A": -1e999, "B": 1, "C": 1}"#, "not valid JSON"),
    ] {
        let error = Plant::parse(json).unwrap_err().to_string();
        assert!(error.contains(named) && !error.contains('\n') && error.len() < 300, "{json}: {error}");
    }
    let row = format!("[{}]", vec!["0"; 51].join(","));
    let large = format!(r#"{{"A": [{}], "B": 1, "C": 1}}"#, vec![row; 51].join(","));
    assert!(Plant::parse(&large).unwrap_err().to_string().contains("within 1 … 50"));
}

#[test]
fn what_no_controller_can_be_made_for_is_refused_before_anything_is_written() {
    let uncontrollable = r#"{"A": [[-1, 0], [0, -2]], "B": [1, 0], "C": [1, 0]}"#;
    let no_static_gain = r#"{"A": [[0, 1], [-2, -3]], "B": [0, 1], "C": [0, 1]}"#;
    let two_outputs = r#"{"A": [[0, 1], [-2, -3]], "B": [0, 1], "C": [[1, 0], [0, 1]]}"#;
    let fed_through = r#"{"A": -1, "B": 1, "C": 1, "D": 1}"#;
    let no_unit = r#"{"A": -1, "B": 1, "C": 1, "units": {"u": [" V"]}}"#;
    let no_name = r#"{"A": -1, "B": 1, "C": 1, "inputs": ["my voltage"]}"#;
    for (kind, json, named) in [
        ("l1", uncontrollable, "A, B"),
        ("l1", no_static_gain, "zero at 0"),
        ("l1", two_outputs, "outputs = 2"),
        ("l1", fed_through, "D: must be zero"),
        ("l1", no_unit, "` V`"),
        ("state-space", no_name, "my voltage"),
        ("observer", r#"{"A": [[-1, 0], [0, -2]], "B": [1, 0], "C": [1, 0]}"#, "observable"),
        ("mrac-ppf", no_static_gain, "an input for each state: the plant has 2 states and 1 input"),
        ("neuro-ppf", MOTOR, "state 2 isn't the rate of state 1"),
        ("l1-ppf", MOTOR, "the rate of state 1 is no state"),
    ] {
        let error = begun_for(kind, json).unwrap_err();
        assert!(error.contains(named), "{kind} for {json}: {error}");
    }
    for (kind, states, inputs, named) in [
        ("l1", Some(1), Some(2), "inputs = 2"),
        ("l1", Some(0), Some(0), "size = 0"),
        ("neuro-ppf", Some(2), Some(0), "size = 0"),
        ("state-space", Some(1_000_000_000), None, "within 1 … 50"),
        ("neuro-ppf", Some(3), Some(1), "there are 3 states and 1 input"),
        ("mrac-ppf", Some(2), Some(1), "each state needs its own control"),
        ("sensor", Some(2), None, "--outputs"),
        ("actuator", Some(2), None, "--inputs"),
    ] {
        let error = begin(&request(kind, states, inputs)).unwrap_err().to_string();
        assert!(error.contains(named), "{kind}: {error}");
    }
}
