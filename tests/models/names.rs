//! Names of the user: all texts about a variable use them.

use adaptive_fmu::fmi2::model_description;
use common::described::{model, refused};
use common::{ERROR, OK, Unit, description};

/// The controller of example 3.2.1 with names.
fn controller(names: &str) -> String {
    description("L1NonlinearSiso").replace("[start]", &format!("[names]\n{names}\n\n[start]"))
}

const NAMES: &str = r#"r = ["speed_reference"]
x = ["speed", { name = "shaft.rate[1]", description = "rate of the speed" }]
"u[1]" = "voltage"
omega_max = ["largest_gain"]
adaptation_gain = "Gamma""#;

#[test]
fn a_unit_has_its_users_names_in_place_of_its_own() {
    let text = controller(NAMES);
    let (own, named) = (model(&description("L1NonlinearSiso")).unwrap(), model(&text).unwrap());
    let names = |model: &adaptive_fmu::model::Model| {
        model.variables().visible().map(|element| element.name()).collect::<Vec<_>>()
    };
    let renamed: Vec<_> =
        names(&own).into_iter().zip(names(&named)).filter(|(before, after)| before != after).collect();
    let expected = [
        ("adaptation_gain", "Gamma"),
        ("omega_max[1,1]", "largest_gain"),
        ("r[1]", "speed_reference"),
        ("u[1]", "voltage"),
        ("x[1]", "speed"),
        ("x[2]", "shaft.rate[1]"),
    ];
    let mut renamed: Vec<_> = renamed.iter().map(|(before, after)| (before.as_str(), after.as_str())).collect();
    renamed.sort_unstable();
    assert_eq!(renamed, expected);
    let element = named.variables().find("shaft.rate[1]").unwrap();
    assert_eq!((element.description().as_ref(), element.unit()), ("rate of the speed", "1/s"));
}

/// Keys are the names that a model gives, whatever the other keys of the table are.
#[test]
fn names_can_be_exchanged() {
    let own = model(&description("L1NonlinearSiso")).unwrap();
    for [one, other] in [["x[1]", "x[2]"], ["r[1]", "x[1]"], ["u[1]", "r[1]"]] {
        let named = model(&controller(&format!("\"{one}\" = \"{other}\"\n\"{other}\" = \"{one}\""))).unwrap();
        for (name, before) in [(one, other), (other, one)] {
            let (now, then) = (named.variables().find(name).unwrap(), own.variables().find(before).unwrap());
            assert_eq!((now.variable.causality, now.offset), (then.variable.causality, then.offset), "{name}");
            assert_eq!(now.variable.name, then.variable.name, "{name}");
        }
    }
}

#[test]
fn value_references_and_dependencies_stay_as_they_are() {
    let attributes = |text: &str, name: &str| {
        let xml = model_description::xml(&model(text).unwrap());
        let before = format!(" {name}=\"");
        let all = xml.split(&before).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned());
        all.collect::<Vec<_>>()
    };
    for name in ["valueReference", "dependencies", "derivative"] {
        assert_eq!(attributes(&controller(NAMES), name), attributes(&description("L1NonlinearSiso"), name), "{name}");
    }
}

#[test]
fn a_state_and_its_derivative_share_a_name() {
    let text = description("StateSpace") + "\n[names]\nx = [\"position\", \"speed\"]\n";
    let unit = Unit::from_text(&text);
    unit.put("x0[2]", 3.0);
    unit.start(0.0);
    unit.put("u[1]", 2.0);
    unit.run(0.0, 10, 0.1);
    assert!((unit.get("speed") - 5.0).abs() < 1e-6 && (unit.get("der(position)") - 5.0).abs() < 1e-6);
    assert!((unit.get("der(speed)") - 2.0).abs() < 1e-6);
}

#[test]
fn start_values_go_by_either_name() {
    let start = |assignment: &str| {
        let unit = model(&controller(NAMES).replace("omega_max = [3.0]", assignment)).unwrap();
        unit.variables().find("largest_gain").unwrap().start()
    };
    assert_eq!((start("omega_max = [4.0]"), start("largest_gain = 4.0")), (4.0, 4.0));
    let gain = controller(NAMES).replace("adaptation_gain = 1e5", "Gamma = 3.0");
    assert_eq!(model(&gain).unwrap().variables().find("Gamma").unwrap().start(), 3.0);
    refused(
        &controller(NAMES).replace("adaptation_gain = 1e5", "Gama = 1.0"),
        &["[start] Gama", "Gamma", "largest_gain"],
    );
}

#[test]
fn what_an_fmu_refuses_and_warns_of_is_reported_by_its_users_names() {
    let text = controller(NAMES);
    // Limits of single values find it, and the controller itself.
    refused(&text.replace("adaptation_gain = 1e5", "Gamma = -1.0"), &["Gamma = -1"]);
    refused(&text.replace("omega_min = [0.5]", "omega_min = [4.0]"), &["omega_min[1,1] = 4", "largest_gain = 3"]);
    let unit = Unit::from_text(&text);
    unit.start(0.0);
    unit.put("omega_min[1,1]", 4.0);
    assert_eq!(unit.step(0.0, 1e-3), ERROR);
    assert!(unit.last_message().contains("largest_gain = 3"), "{}", unit.last_message());
    unit.put("omega_min[1,1]", 1.0);
    assert_eq!(unit.step(0.0, 1e-3), OK);
}

#[test]
fn names_that_are_none_or_taken_are_refused_with_the_reason() {
    for (names, named) in [
        ("x = [\"speed\"]", &["[names] x", "a list of 2 names"][..]),
        ("x = \"speed\"", &["[names] x", "a list of 2 names"]),
        ("speed = \"x\"", &["[names] speed", "no such variable", "omega_min"]),
        ("x = [\"speed\", \"speed\"]", &["speed", "name of another variable"]),
        ("x = [\"u\", \"speed\"]", &["`u`", "name of another variable"]),
        ("x = [\"u[1]\", \"speed\"]", &["`u[1]`", "name of another variable"]),
        ("x = [\"relative_tolerance\", \"speed\"]", &["relative_tolerance"]),
        ("x = [\"the speed\", \"rate\"]", &["[names] x", "`the speed`", "letters, digits"]),
        ("x = [\"9x\", \"rate\"]", &["`9x`"]),
        ("x = [\"x[\", \"rate\"]", &["`x[`"]),
        ("x = [\"a..b\", \"rate\"]", &["`a..b`"]),
        ("x = [\"\", \"rate\"]", &["``"]),
        ("x = [[\"speed\", \"rate\"], \"y\"]", &["line", "name"]),
        ("x = [\"speed\", 3]", &["line", "name"]),
        ("x = [\"speed\", { nam = \"y\" }]", &["line", "name"]),
        ("x = [\"speed\", { description = \"\\u0001\" }]", &["control character"]),
        ("\"der(u_ad[1])\" = \"rate\"", &["no such variable"]),
        ("adaptation_gain = [\"Gamma\"]", &["[names] adaptation_gain", "one name"]),
        ("x = [\"speed\", \"rate\"]\n\"x[2]\" = \"slope\"", &["[names] x[2]", "`x` gives this variable a name, too"]),
    ] {
        refused(&controller(names), named);
    }
    let long = format!("x = [\"{}\", \"rate\"]", "x".repeat(101));
    refused(&controller(&long), &["at most 100"]);
}

#[test]
fn the_parts_of_a_composite_keep_their_users_names() {
    let text = r#"
name = "Whole"
model = "composite"
description = ""

[structure]
connections = [["lag.speed", "behind.command"]]

[[structure.parts]]
name = "lag"
model = "state-space"
structure = { A = [[-1.0]], B = [[1.0]], C = [[1.0]] }
names = { y = ["speed"], u = ["torque"], u_max = ["most"] }
start = { most = 2.0 }

[[structure.parts]]
name = "behind"
model = "state-space"
structure = { A = [[-1.0]], B = [[1.0]], C = [[1.0]] }
names = { u = ["command"], x = ["state"] }

[names]
"lag.torque" = "drive"
"#;
    let unit = Unit::from_text(text);
    unit.start(0.0);
    unit.put("drive", 5.0);
    unit.run(0.0, 300, 0.1);
    assert!((unit.get("behind.state") - 2.0).abs() < 1e-6, "{}", unit.get("behind.state"));
    refused(&text.replace("most = 2.0", "most = -1e15"), &["lag.u_min[1]", "most = "]);
    refused(&text.replace("\"speed\"", "\"spe ed\""), &["lag", "spe ed"]);
    refused(&text.replace("u = [\"command\"]", "u = [\"x\"]"), &["behind", "`x`"]);
}
