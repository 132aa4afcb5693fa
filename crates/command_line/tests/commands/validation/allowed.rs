//! Files that the standard allows have no errors.

use super::*;

/// A description of its own, for model exchange, with the unit m and the type Length.
pub(super) fn own(variables: &str, structure: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<fmiModelDescription fmiVersion=\"2.0\" modelName=\"Unit\" guid=\"g\">\n\
         <ModelExchange modelIdentifier=\"unit\"/>\n\
         <UnitDefinitions><Unit name=\"m\"/><Unit name=\"s\"/></UnitDefinitions>\n\
         <TypeDefinitions><SimpleType name=\"Length\"><Real unit=\"m\"/></SimpleType></TypeDefinitions>\n\
         <ModelVariables>\n{variables}\n</ModelVariables>\n<ModelStructure>{structure}</ModelStructure>\n\
         </fmiModelDescription>\n"
    )
}

/// Two variables of one value reference.
fn shared(attributes: &str, first: &str, second: &str) -> String {
    let variable = |name: &str, value: &str| {
        format!("<ScalarVariable name=\"{name}\" valueReference=\"1\" {attributes}>{value}</ScalarVariable>\n")
    };
    own(&(variable("a", first) + &variable("b", second)), "")
}

#[test]
fn what_tools_stumble_over_is_a_warning() {
    let whole = xml();
    for (was, is, message) in [
        (
            "<Real unit=\"1\" start=\"0.0\"/>",
            "<Real unit=\"rad\" displayUnit=\"grad\" start=\"0\"/>",
            "the display unit `grad` of the unit `rad` is not defined",
        ),
        ("stopTime=\"20.0\"", "stopTime=\"0\"", "stopTime = 0 is not after startTime = 0"),
        ("tolerance=\"1e-6\"", "tolerance=\"0\"", "tolerance = 0"),
    ] {
        assert!(whole.contains(was), "{was}");
        let findings = findings_of(&whole.replacen(was, is, 1));
        assert!(findings.len() == 1 && findings[0].severity == Severity::Warning, "{is}: {findings:#?}");
        assert_eq!(findings[0].what, message);
    }
}

#[test]
fn constants_of_one_reference_are_compared_by_their_values() {
    let constant = "causality=\"local\" variability=\"constant\"";
    for (first, second, same) in [
        ("<Real start=\"1\"/>", "<Real start=\"1.0e0\"/>", true),
        ("<Real start=\"1\"/>", "<Real start=\"1.5\"/>", false),
        ("<Integer start=\"7\"/>", "<Integer start=\"+07\"/>", true),
        ("<Integer start=\"7\"/>", "<Integer start=\"8\"/>", false),
        ("<Boolean start=\"true\"/>", "<Boolean start=\"1\"/>", true),
        ("<Boolean start=\"true\"/>", "<Boolean start=\"0\"/>", false),
        ("<String start=\"1\"/>", "<String start=\"1.0\"/>", false),
    ] {
        let findings = findings_of(&shared(constant, first, second));
        let other = findings.iter().any(|finding| finding.what.contains("a constant with a different value"));
        assert!(other != same && findings.len() == usize::from(!same), "{first} {second}: {findings:#?}");
    }
}

#[test]
fn variables_of_one_reference_have_the_units_of_their_types() {
    let (typed, metres, seconds) = ("<Real declaredType=\"Length\"/>", "<Real unit=\"m\"/>", "<Real unit=\"s\"/>");
    for (first, second, same) in
        [(typed, metres, true), (metres, typed, true), (typed, seconds, false), (seconds, typed, false)]
    {
        let findings = findings_of(&shared("", first, second));
        let other = findings.iter().any(|finding| finding.what.contains("which has a different unit"));
        assert!(other != same && findings.len() == usize::from(!same), "{first} {second}: {findings:#?}");
    }
}

#[test]
fn an_input_may_be_the_derivative_of_an_input() {
    let input =
        "<ScalarVariable name=\"u\" valueReference=\"1\" causality=\"input\"><Real start=\"0\"/></ScalarVariable>";
    let derivative = |causality: &str, start: &str| {
        let attributes = format!("name=\"du\" valueReference=\"2\" causality=\"{causality}\"");
        let real = format!("<Real derivative=\"1\" {start}/>");
        findings_of(&own(&format!("{input}\n<ScalarVariable {attributes}>{real}</ScalarVariable>"), ""))
    };
    assert_eq!(derivative("input", "start=\"0\""), []);
    let findings = derivative("local", "");
    assert!(findings.iter().any(|finding| finding.what == "it is the derivative of `u`, an input"), "{findings:#?}");
}

#[test]
fn a_description_that_is_not_in_utf_8_is_a_finding() {
    let text = own("", "").replacen("?>", " encoding=\"ISO-8859-1\"?>", 1);
    let mut bytes = text.into_bytes();
    let place = bytes.windows(4).position(|window| window == b"Unit").unwrap();
    bytes[place] = 0xdc;
    let (_folder, file) = packed(&[("modelDescription.xml".to_owned(), bytes)]);
    let found = found_in(&file);
    assert!(
        found.len() == 1 && found[0].starts_with("error: line 2: modelDescription.xml is not in UTF-8"),
        "{found:?}"
    );
    assert_eq!(program(&["validate", file.to_str().unwrap()]).status.code(), Some(3));
}

#[test]
fn parameters_are_read_only_when_initialization_mode_is_left() {
    let (_folder, file) = built(&["STRICT"], "");
    assert_eq!(found_in(&file), Vec::<String>::new());
    let (_folder, file) = built(&["STRICT", "OTHER_START"], "");
    assert!(found_in(&file)[0].contains("it starts at 2, but modelDescription.xml has start = 1"));
}

#[test]
fn all_steps_are_as_long_unless_the_unit_can_make_others() {
    let trial = |file: &Path| validate(file, Some(&Hosting::InProcess)).unwrap().trial;
    let description = |flags: &str| description(flags).replacen("stepSize=\"0.1\"", "stepSize=\"0.3\"", 1);
    for flags in ["", "canHandleVariableCommunicationStepSize=\"false\""] {
        let (_folder, file) = built_as(&["FIXED_STEP"], &description(flags));
        assert_eq!((found_in(&file), trial(&file)), (vec![], Trial::Ran(3)), "{flags}");
    }
    let (_folder, file) = built_as(&[], &description("canHandleVariableCommunicationStepSize=\"true\""));
    assert_eq!((found_in(&file), trial(&file)), (vec![], Trial::Ran(4)));
    // Where the time does not advance by a step, there is none.
    let late = description("").replacen("\"0\" stopTime=\"1\"", "\"1e17\" stopTime=\"1.00000000000001e17\"", 1);
    let (_folder, file) = built_as(&[], &late);
    assert_eq!((found_in(&file), trial(&file)), (vec![], Trial::Ran(0)));
}

#[test]
fn a_local_variable_may_be_no_number_and_a_state_may_not() {
    const LOCAL: &str = "<ScalarVariable name=\"z\" valueReference=\"2\"><Real/></ScalarVariable>\n</ModelVariables>";
    let local = description("").replacen("</ModelVariables>", LOCAL, 1);
    let (_folder, file) = built_as(&["NAN_LOCAL"], &local);
    let found = found_in(&file);
    assert!(found.len() == 1 && found[0].starts_with("warning: `z`: its value is NaN at t = 0 s"), "{found:?}");
    let derivative = "<ScalarVariable name=\"der(z)\" valueReference=\"3\"><Real derivative=\"3\"/></ScalarVariable>\n";
    let state = local
        .replacen("</ModelVariables>", &format!("{derivative}</ModelVariables>"), 1)
        .replacen("</Outputs>", "</Outputs><Derivatives><Unknown index=\"4\"/></Derivatives>", 1)
        .replacen("</InitialUnknowns>", "<Unknown index=\"3\"/><Unknown index=\"4\"/></InitialUnknowns>", 1);
    let (_folder, file) = built_as(&["NAN_LOCAL"], &state);
    let found = found_in(&file);
    assert!(found.len() == 1 && found[0].starts_with("error: `z`: its value is NaN at t = 0 s"), "{found:?}");
}
