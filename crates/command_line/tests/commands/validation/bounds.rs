//! Long names and many variables cost no more than they must.

use std::time::{Duration, Instant};

use super::allowed::own;
use super::*;

const LONG: usize = 1_000_000;

#[test]
fn a_long_name_is_shown_in_part() {
    let name = format!("x{}z", "y".repeat(LONG));
    let variable = |name: &str| {
        let attributes = format!("name=\"{name}\" valueReference=\"1\" causality=\"output\" variability=\"constant\"");
        format!("<ScalarVariable {attributes}><Real start=\"{}\"/></ScalarVariable>\n", name.len())
    };
    // Each of these shares its value reference with the first one.
    let others: String = (0..500).map(|place| variable(&format!("v{place}"))).collect();
    let unknowns = "<Unknown index=\"1\"/>\n".repeat(3000);
    let whole = own(&(variable(&name) + &others), &format!("<Outputs>{unknowns}</Outputs>"));
    let findings = findings_of(&whole);
    assert_eq!(findings.len(), 1000);
    let shown: Vec<String> = findings.iter().map(ToString::to_string).collect();
    assert!(shown.iter().all(|line| line.len() < 2000));
    for message in ["`: it is listed twice in Outputs", "`, a constant with a different value"] {
        let line = shown.iter().find(|line| line.contains(message)).unwrap();
        assert!(line.contains("`xyyy") && line.contains("yyy…yyy") && line.contains("yyyz`"), "{line}");
    }
}

#[test]
fn a_long_value_is_shown_in_part() {
    let start = "1".repeat(LONG) + "m";
    let local = "name=\"x\" valueReference=\"1\" initial=\"exact\"";
    let findings =
        findings_of(&own(&format!("<ScalarVariable {local}><Real start=\"{start}\"/></ScalarVariable>"), ""));
    let line = findings.iter().map(ToString::to_string).find(|line| line.contains("start = \"111")).unwrap();
    assert!(line.len() < 2000 && line.contains("111…111") && line.contains("1m\" in Real"), "{line}");
}

#[test]
fn the_time_grows_with_the_variables_and_not_with_their_square() {
    const VARIABLES: usize = 60_000;
    let variable = |place| {
        let attributes = format!("name=\"x{place}\" valueReference=\"{place}\"");
        format!("<ScalarVariable {attributes}><Real reinit=\"true\"/></ScalarVariable>\n")
    };
    let whole = own(&(0..VARIABLES).map(variable).collect::<String>(), "");
    let begin = Instant::now();
    assert_eq!(findings_of(&whole).len(), 1000);
    // It takes seconds; with a look at every variable for each, minutes.
    assert!(begin.elapsed() < Duration::from_secs(30), "{:?}", begin.elapsed());
}
