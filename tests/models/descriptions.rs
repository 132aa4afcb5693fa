//! Descriptions as people write them: each mistake is answered by one line with the key, its value and what is allowed.

use std::collections::BTreeMap;

use adaptive_fmu::fmi2::model_description;
use adaptive_fmu::model::Model;
use adaptive_fmu::system::Causality;
use common::described::{model, refused};
use common::loops::{loop_names, whole};
use common::{description, description_names};

/// The controller of example 3.2.1 with one text in it replaced.
fn controller(old: &str, new: &str) -> String {
    let text = description("L1NonlinearSiso");
    assert!(text.contains(old), "`{old}` is in the description");
    text.replace(old, new)
}

fn reference(structure: &str, start: &str) -> String {
    format!("name = \"R\"\nmodel = \"reference\"\ndescription = \"\"\n[structure]\n{structure}\n[start]\n{start}\n")
}

#[test]
fn the_default_experiment_has_the_tolerance_of_the_unit() {
    let tolerance = |text: &str| {
        let xml = model_description::xml(&model(text).unwrap());
        let (_, experiment) = xml.split_once("<DefaultExperiment ").expect("an experiment");
        let (_, number) = experiment.split_once("tolerance=\"").expect("a tolerance");
        number.split_once('"').unwrap().0.parse::<f64>().unwrap()
    };
    assert_eq!(tolerance(&description("L1NonlinearSiso")), 1e-6);
    assert_eq!(tolerance(&controller("[start]", "[start]\nrelative_tolerance = 1e-4")), 1e-4);
    assert_eq!(tolerance(&description("Reference")), 1e-6, "without states, too");
}

#[test]
fn every_description_is_named_as_its_file() {
    for name in description_names() {
        assert_eq!(model(&description(&name)).unwrap().description().name, name);
    }
}

#[test]
fn a_description_gives_the_same_text_and_guid_each_time() {
    let text = description("L1NonlinearSiso");
    let [first, second] = [model(&text).unwrap(), model(&text).unwrap()];
    assert_eq!(model_description::xml(&first), model_description::xml(&second));
    assert_eq!(model_description::guid(&first), model_description::guid(&second));
}

#[test]
fn a_controller_for_another_plant_has_another_guid() {
    // Input matrix and regressor, though no variable shows B: state and library of one don't fit the other.
    let guid = |text: &str| model_description::guid(&model(text).unwrap());
    assert_ne!(guid(&description("L1NonlinearSiso")), guid(&controller("[[0.0], [1.0]]", "[[0.0], [2.0]]")));
}

/// FMI 2.0.4, section 2.2.9: `name`, `name[i]`, `name[i,j]`, and derivatives `der(name[i])`.
fn is_structured(name: &str) -> bool {
    let inner = name.strip_prefix("der(").and_then(|rest| rest.strip_suffix(')')).unwrap_or(name);
    let (base, indices) = match inner.split_once('[') {
        Some((base, rest)) => (base, rest.strip_suffix(']')),
        None => (inner, Some("1")),
    };
    let identifier = base.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && base.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    identifier && indices.is_some_and(|indices| indices.split(',').all(|index| index.parse::<u32>().is_ok()))
}

#[test]
fn variable_names_follow_the_structured_naming_convention() {
    for name in description_names() {
        let model = model(&description(&name)).unwrap();
        let wrong: Vec<_> = model.variables().visible().map(|e| e.name()).filter(|name| !is_structured(name)).collect();
        assert!(wrong.is_empty(), "{name}: {wrong:?}");
    }
}

#[test]
fn names_and_descriptions_of_variables_are_unique_and_given() {
    for name in description_names() {
        let model = model(&description(&name)).unwrap();
        let mut names: Vec<_> = model.variables().visible().map(|element| element.name()).collect();
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count, "{name}: names are unique");
        let silent: Vec<_> =
            model.variables().visible().filter(|e| e.description().is_empty()).map(|e| e.name()).collect();
        assert!(silent.is_empty(), "{name}: no description of {silent:?}");
    }
}

/// Inputs or outputs that share a description.
fn alike(model: &Model) -> Vec<String> {
    let ports = model
        .variables()
        .visible()
        .filter(|element| matches!(element.variable.causality, Causality::Input | Causality::Output));
    let mut described = BTreeMap::<_, Vec<String>>::new();
    ports.for_each(|port| described.entry(port.description().into_owned()).or_default().push(port.name()));
    described
        .into_iter()
        .filter(|(_, names)| names.len() > 1)
        .map(|(text, names)| format!("{names:?}: {text}"))
        .collect()
}

#[test]
fn no_two_inputs_or_outputs_of_an_fmu_have_the_same_description() {
    for name in description_names() {
        let alike = alike(&model(&description(&name)).unwrap());
        assert!(alike.is_empty(), "{name}: {}", alike.join("\n"));
    }
    // Those of composites don't, either.
    for whole in loop_names().iter().map(|name| model(&whole(name)).unwrap()) {
        let alike = alike(&whole);
        assert!(alike.is_empty(), "{}: {}", whole.description().name, alike.join("\n"));
    }
}

#[test]
fn a_controller_names_the_plant_of_its_description() {
    let described = |model: &Model, name: &str| model.variables().find(name).unwrap().description().into_owned();
    let vehicle = model(&description("L1MaresAuv")).unwrap();
    assert_eq!(described(&vehicle, "r[3]"), "reference of depth");
    assert_eq!(described(&vehicle, "x[12]"), "measured rate of yaw psi");
    assert_eq!(described(&vehicle, "u[6]"), "commanded moment of psi");
    assert_eq!(
        described(&vehicle, "u_max[1]"),
        "largest force north that the actuator can give; the predictor knows of it (1e15: no limit)"
    );
    assert_eq!(described(&vehicle, "der(x_hat[3])"), "time derivative of: predicted depth");
    // Without it elements are counted.
    let text = description("L1MaresAuv");
    let (before, rest) = text.split_once("[structure.quantities]").unwrap();
    let unnamed =
        model(&format!("{before}[structure.units]{}", rest.split_once("[structure.units]").unwrap().1)).unwrap();
    assert_eq!(described(&unnamed, "r[3]"), "reference, 3 of 6");
    assert_eq!(described(&unnamed, "x[12]"), "measured state of the plant, 12 of 12");
    assert_eq!(described(&unnamed, "feedback_gain[1,2]"), "feedback gain K of the filter K D(s), row 1, column 2");
    assert!(alike(&unnamed).is_empty());
}

#[test]
fn quantities_of_another_number_or_given_twice_are_refused() {
    let with =
        |x: &str| controller("[structure.units]", &format!("[structure.quantities]\nx = {x}\n[structure.units]"));
    let with = |x: &str| with(x).replace("[structure.quantities]\nx = [\"x1\", \"x2\"]\n\n", "");
    refused(&with("[\"speed\"]"), &["quantities of x", "1", "must be 2"]);
    refused(&with("[\"speed\", \"speed\"]"), &["quantity of x", "`speed`", "given once"]);
    refused(&with("[\"speed\", \" \"]"), &["quantity of x", "one line"]);
    refused(&with("[\"speed\", 3.0]"), &["[structure]"]);
}

#[test]
fn the_author_of_an_fmu_is_in_its_xml_and_in_its_guid() {
    let own = |more: &str| {
        let text =
            format!("name = \"R\"\nmodel = \"reference\"\ndescription = \"\"\n{more}\n[structure]\nchannels = 1\n");
        model(&text).unwrap()
    };
    let (plain, described) =
        (own(""), own("author = \"A & B\"\nversion = \"2.1\"\nlicense = \"MIT\"\ncopyright = \"(c) A\""));
    let xml = model_description::xml(&described);
    assert!(
        xml.contains("author=\"A &amp; B\" version=\"2.1\" license=\"MIT\" copyright=\"(c) A\" generationTool="),
        "{xml}"
    );
    // Unknown attributes are absent.
    let xml = model_description::xml(&plain);
    assert!(!xml.contains("author=") && !xml.contains("license=") && !xml.contains("copyright="), "{xml}");
    assert_ne!(model_description::guid(&plain), model_description::guid(&described));
    for wrong in ["author = \"\"", "version = \" 1\"", "license = \"two\\nlines\""] {
        refused(
            &controller("model = ", &format!("{wrong}\nmodel = ")).replace(
                &format!(
                    "\nauthor = \"The adaptive-fmu authors\"\nversion = \"{}\"\nlicense = \"MIT OR Apache-2.0\"",
                    env!("CARGO_PKG_VERSION")
                ),
                "",
            ),
            &["must be one line of 1 … 200"],
        );
    }
    // FMUs of this package have them.
    for name in description_names() {
        let model = model(&description(&name)).unwrap();
        assert!(model.description().about().all(|(_, text)| text.is_some()), "{name}");
        let version = model.description().version.as_deref();
        assert_eq!(version, Some(env!("CARGO_PKG_VERSION")), "{name}");
    }
}

#[test]
fn angles_are_shown_in_degrees_but_no_phase_and_no_length_in_millimetres() {
    let mut shown = BTreeMap::new();
    for name in description_names() {
        let xml = model_description::xml(&model(&description(&name)).unwrap());
        let variables = xml.split("<ScalarVariable name=\"").skip(1);
        for variable in variables {
            let display = variable.split_once("displayUnit=\"").map(|(_, rest)| rest.split('"').next().unwrap());
            shown.insert(format!("{name}.{}", variable.split('"').next().unwrap()), display.map(str::to_owned));
        }
    }
    assert!(shown.values().flatten().all(|display| ["deg", "deg/s", "deg/s2"].contains(&display.as_str())));
    assert_eq!(shown["MaresAuv.x[4]"].as_deref(), Some("deg"));
    assert_eq!(shown["L1MaresAuv.x[10]"].as_deref(), Some("deg/s"));
    for plain in [
        "MaresAuv.x[3]",
        "ReferenceMaresAuv.sine_phase[4]",
        "ReferenceMaresAuv.sine_frequency[4]",
        "L1MaresAuv.pole_imag[1]",
        "L1MaresAuv.step_phase_limit",
    ] {
        assert_eq!(shown[plain], None, "{plain}");
    }
}

#[test]
fn an_unknown_key_is_refused_with_the_known_ones() {
    refused(&controller("model = ", "modell = \"x\"\nmodel = "), &["modell", "line 3", "did you mean `model`?"]);
    refused(&controller("stop_time", "stoptime"), &["stoptime", "stop_time"]);
    refused(&controller("regressor", "regresor"), &["[structure]", "regresor", "regressor"]);
    refused(&controller("adaptation_gain", "adaption_gain"), &["[start]", "adaption_gain", "adaptation_gain"]);
}

#[test]
fn a_missing_key_is_named() {
    refused("", &["name"]);
    refused("name = \"X\"\nmodel = \"l1\"\n", &["description"]);
    refused(&controller("input_gain = \"diagonal\"", ""), &["[structure]", "input_gain"]);
    refused(&reference("", ""), &["[structure]", "channels"]);
}

#[test]
fn what_is_no_toml_is_refused_with_its_line() {
    refused(&controller("model = \"l1\"", "model = l1\""), &["line 3"]);
    refused(&controller("step = 0.001", "step = 0.0.1"), &["line 13"]);
    refused("name = \"A\"\nname = \"B\"\n", &["line 2", "name"]);
    refused("\u{0}\u{1}", &["line 1"]);
}

#[test]
fn an_unknown_model_is_refused_with_the_known_ones() {
    refused(&controller("\"l1\"", "\"l2\""), &["model", "l2", "did you mean `l1`?", "list"]);
    refused(&controller("\"l1\"", "\"\""), &["model", "l1"]);
}

#[test]
fn a_name_that_is_no_c_identifier_is_refused() {
    let long = "x".repeat(101);
    for name in ["", "9lives", "a b", "a/b", "../x", "a-b", "ä", "a.b", "a\\nb", &long] {
        let text = controller("\"L1NonlinearSiso\"", &format!("\"{name}\""));
        refused(&text, &["name = ", "C identifier"]);
    }
    assert!(model(&controller("\"L1NonlinearSiso\"", "\"_my_Controller_2\"")).is_ok());
}

#[test]
fn an_experiment_of_no_length_is_refused() {
    for value in ["0.0", "-1.0", "nan", "inf"] {
        let (stop, step) = (format!("stop_time = {value}"), format!("step = {value}"));
        refused(&controller("stop_time = 20.0", &stop), &["experiment.stop_time", "above 0"]);
        refused(&controller("\nstep = 0.001", &format!("\n{step}")), &["experiment.step", "above 0"]);
    }
}

#[test]
fn a_value_of_another_size_or_type_is_refused_with_the_size_or_type_wanted() {
    let a_m = "A_m = [[0.0, 1.0], [-1.0, -1.4]]";
    refused(&controller(a_m, "A_m = [[0.0, 1.0]]"), &["[start] A_m", "2 rows of 2 numbers"]);
    refused(&controller(a_m, "A_m = [[0.0, 1.0], [-1.0]]"), &["[start] A_m", "2 numbers"]);
    refused(&controller(a_m, "A_m = -1.0"), &["[start] A_m", "2 rows of 2 numbers"]);
    refused(&controller("omega_min = [0.5]", "omega_min = 0.5"), &["[start] omega_min", "0.5", "list of 1 numbers"]);
    refused(&controller("[0.5]", "[0.5, 0.5]"), &["[start] omega_min", "list of 1 numbers"]);
    refused(&controller("= 1e5", "= \"high\""), &["[start] adaptation_gain", "high", "number"]);
    refused(&controller("= 1e5", "= true"), &["[start] adaptation_gain", "true", "number"]);
    refused(&controller("= 1e5", "= [1e5]"), &["[start] adaptation_gain", "number"]);
    refused(&reference("channels = 1", "on_step_failure = 2"), &["[start] on_step_failure", "error", "discard"]);
    refused(&reference("channels = 1", "on_step_failure = \"ignore\""), &["ignore", "error", "discard"]);
}

#[test]
fn a_whole_number_is_taken_for_a_real_one() {
    let text = controller("= 1e5", "= 100000").replace("[10.0]", "[10]");
    let xml = |text: &str| model_description::xml(&model(text).unwrap());
    assert_eq!(xml(&text), xml(&description("L1NonlinearSiso")));
}

#[test]
fn a_number_that_is_not_finite_is_refused() {
    for value in ["nan", "inf", "-inf", "+nan"] {
        refused(&controller("= 1e5", &format!("= {value}")), &["[start] adaptation_gain", "finite"]);
        refused(&controller("[0.5]", &format!("[{value}]")), &["[start] omega_min", "finite"]);
        refused(&controller("-1.4]", &format!("{value}]")), &["[start] A_m", "finite"]);
        refused(&controller("[[0.0], [1.0]]", &format!("[[0.0], [{value}]]")), &["B", "finite"]);
    }
}

#[test]
fn a_value_outside_its_limits_is_refused_with_them() {
    refused(&controller("= 1e5", "= 0.0"), &["adaptation_gain = 0", "above 0"]);
    refused(&controller("= 1e5", "= -3.0"), &["adaptation_gain = -3", "above 0"]);
    refused(&controller("theta_bound = [10.0]", "theta_bound = [-1.0]"), &["theta_bound[1] = -1", "at least 0"]);
    let tolerance = "adaptation_gain = 1e5\nrelative_tolerance = 0.5";
    refused(&controller("adaptation_gain = 1e5", tolerance), &["relative_tolerance = 0.5", "0.01"]);
}

#[test]
fn bounds_that_are_upside_down_are_refused() {
    refused(&controller("omega_min = [0.5]", "omega_min = [4.0]"), &["omega_min[1,1]", "4", "3"]);
}

#[test]
fn a_desired_dynamics_that_is_not_stable_is_refused_with_its_eigenvalues() {
    // s² − 1.4 s + 1 has the roots 0.7 ± √(1 − 0.49) j = 0.7 ± 0.714143 j.
    refused(&controller("[-1.0, -1.4]", "[-1.0, 1.4]"), &["A_m", "Hurwitz", "0.7000", "0.7141"]);
    // An integrator isn't asymptotically stable either.
    refused(&controller("[-1.0, -1.4]", "[0.0, -1.4]"), &["A_m", "Hurwitz"]);
}

#[test]
fn a_plant_whose_output_has_no_static_gain_is_refused() {
    // C A_m⁻¹ B = 0 for C = [0 1]: the rate of a position is zero at rest.
    refused(&controller("[[1.0, 0.0]]", "[[0.0, 1.0]]"), &["C A_m^-1 B", "singular"]);
}

#[test]
fn a_q_that_is_not_positive_definite_is_refused() {
    for q in ["[[1.0, 2.0], [2.0, 1.0]]", "[[1.0, 0.5], [0.0, 1.0]]", "[[0.0, 0.0], [0.0, 0.0]]"] {
        let with_q = format!("Q = {q}\nadaptation_gain");
        refused(&controller("adaptation_gain", &with_q), &["Q", "symmetric and positive definite"]);
    }
}

#[test]
fn matrices_of_the_structure_must_fit_each_other() {
    refused(&controller("[[0.0], [1.0]]", "[]"), &["B", "rows"]);
    refused(&controller("[[0.0], [1.0]]", "[[], []]"), &["B", "rows"]);
    refused(&controller("[[0.0], [1.0]]", "[[0.0], [1.0, 2.0]]"), &["B", "rows"]);
    refused(&controller("[[1.0, 0.0]]", "[[1.0, 0.0, 0.0]]"), &["C", "1 x 3", "1 x 2"]);
    refused(&controller("[[1.0, 0.0]]", "[[1.0, 0.0], [0.0, 1.0]]"), &["C", "2 x 2", "1 x 2"]);
}

#[test]
fn a_structure_value_of_another_type_is_refused_with_its_key() {
    refused(&controller("[[0.0], [1.0]]", "\"tall\""), &["[structure]", "B"]);
    refused(&controller("regressor = \"state\"", "regressor = \"norm\""), &["regressor", "norm", "infinity_norm"]);
    refused(&controller("\"diagonal\"", "3"), &["[structure]", "input_gain"]);
    refused(&reference("channels = -1", ""), &["[structure]", "channels", "-1"]);
    refused(&reference("channels = 1.5", ""), &["[structure]", "channels", "1.5"]);
}

#[test]
fn zero_and_huge_sizes_are_refused_before_anything_is_allocated() {
    for channels in ["0", "1001", "1000000000", "9223372036854775807"] {
        refused(&reference(&format!("channels = {channels}"), ""), &["channels", channels, "1000"]);
    }
    assert!(model(&reference("channels = 1000", "")).is_ok(), "the largest size is made");
}

#[test]
fn a_start_value_with_newlines_stays_on_one_line() {
    let text = reference("channels = 1", "on_step_failure = \"\"\"\na\nb\"\"\"");
    refused(&text, &["[start] on_step_failure", "discard"]);
    refused(&reference("channels = 1", "\"a\\nb\" = 1.0"), &["[start]"]);
    refused(&reference("channels = 1\n\"a\\nb\" = 1.0", ""), &["[structure]"]);
}

#[test]
fn what_is_calculated_or_hidden_has_no_start_value() {
    for name in ["u", "x_hat", "P", "eta_hat", "\"#given slopes\"", "\"der(u_ad)\""] {
        let text = controller("adaptation_gain", &format!("{name} = [1.0]\nadaptation_gain"));
        refused(&text, &[&format!("[start] {}", name.trim_matches('"')), "no such parameter"]);
    }
}

#[test]
fn any_text_is_a_unit_and_those_that_are_known_have_base_units() {
    let structure = "channels = 6\nunits = [\"rpm\", \"degC\", \"furlong\", \"\", \"kg/mol\", \"m/s\"]";
    let text = format!("name = \"S\"\nmodel = \"sensor\"\ndescription = \"\"\n[structure]\n{structure}\n");
    let xml = model_description::xml(&model(&text).unwrap());
    let unit = |name: &str| {
        let begin = xml.find(&format!("<Unit name=\"{name}\"")).unwrap_or_else(|| panic!("{name} in {xml}"));
        let end = xml[begin..].find("</Unit>").unwrap();
        xml[begin..begin + end].split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let rpm = std::f64::consts::PI / 30.0;
    assert_eq!(unit("rpm"), format!("<Unit name=\"rpm\"> <BaseUnit s=\"-1\" rad=\"1\" factor=\"{rpm:?}\"/>"));
    assert_eq!(unit("degC"), "<Unit name=\"degC\"> <BaseUnit K=\"1\" offset=\"273.15\"/>");
    assert_eq!(unit("kg/mol"), "<Unit name=\"kg/mol\"> <BaseUnit kg=\"1\" mol=\"-1\"/>");
    assert_eq!(unit("m/s"), "<Unit name=\"m/s\"> <BaseUnit m=\"1\" s=\"-1\"/>");
    assert_eq!(unit("furlong"), "<Unit name=\"furlong\">");
    assert!(!xml.contains("unit=\"\"") && xml.contains("unit=\"furlong\""), "{xml}");
}
