//! Loops as SSP files: what is read, what start values hold, and what is refused, with its line.

use std::fs;
use std::path::Path;

use adaptive_fmu::fmu::Value;
use adaptive_fmu::model_description::ModelDescription;
use adaptive_fmu::simulation::LoadedLoop;
use adaptive_fmu::structure::{AlgebraicLoops, check};

use crate::structures::{
    Folder, UNIT, assert_mentions, binding, connection, connection_with, gain, set, start, wiring,
};

#[test]
fn an_algebraic_loop_is_named_signal_by_signal() {
    let folder = Folder::new(&(connection("one.y", "two.u") + &connection("two.y", "one.u")));
    assert_mentions(&folder.refusal(), &["line ", "algebraic loop", "one.y → two.u → two.y → one.u → one.y"]);
}

#[test]
fn no_algebraic_loop_goes_through_a_delay() {
    let folder = Folder::new(&(connection("one.y", "two.u") + &connection("two.z", "one.u")));
    assert_eq!(folder.wiring().unwrap().links.len(), 2);
}

#[test]
fn a_declared_algebraic_loop_is_refused_with_the_option_that_accepts_it() {
    let algebraic_loop = connection("one.y", "two.u") + &connection("two.y", "one.u");
    assert_mentions(&Folder::new(&algebraic_loop).refusal(), &["--accept-algebraic-loops"]);
    let accepted =
        |text: &str| Folder::new(&algebraic_loop).replaced("order=\"jacobi\"", &format!("order='jacobi' {text}"));
    let wiring = accepted("algebraic-loops='accept'").wiring().unwrap();
    let notes = wiring.notes.join("\n");
    assert!(wiring.circular && notes.contains("accepted: one.y → two.u → two.y → one.u → one.y"), "{notes}");
    assert_mentions(&accepted("algebraic-loops='refuse'").refusal(), &["--accept-algebraic-loops"]);
    assert_mentions(&accepted("algebraic-loops='never'").refusal(), &["algebraic-loops = never", "line "]);
}

#[test]
fn an_output_of_unknown_dependencies_closes_no_algebraic_loop_but_is_reported() {
    let folder = Folder::new(&connection("one.alarm", "one.enabled"));
    let wiring = folder.wiring().unwrap();
    let notes: Vec<_> = wiring.notes.iter().filter(|note| note.contains("algebraic loop")).collect();
    assert_eq!(notes.len(), 1, "{:?}", wiring.notes);
    assert_mentions(notes[0], &["`one` does not declare", "one.alarm → one.enabled → one.alarm", "previous exchange"]);
    assert!(wiring.circular);
    // A single FMU exchanges nothing.
    let (structure, unit) = (folder.structure().unwrap(), ModelDescription::read(UNIT).unwrap());
    let refusal = check(&structure, &[&unit, &unit], AlgebraicLoops::Refused).unwrap_err().to_string();
    assert_mentions(&refusal, &["algebraic loop", "one.alarm → one.enabled → one.alarm"]);
    assert!(!refusal.contains("--accept"), "{refusal}");
    assert!(!Folder::new(&connection("one.alarm", "two.enabled")).wiring().unwrap().circular);
}

#[test]
fn a_connection_that_fits_nothing_is_refused_by_name_and_line() {
    let cases = [
        (connection("three.y", "two.u"), vec!["three"]),
        (connection("one.y", "two.v"), vec!["`v`", "two"]),
        (connection("one.gain", "two.u"), vec!["`gain`", "connectors of `one`"]),
        (connection("one.y", "two.z"), vec!["two.z", "output"]),
        (connection("one.u", "two.u"), vec!["one.u", "input"]),
        (connection("one.y", "two.enabled"), vec!["one.y", "Real", "two.enabled", "Boolean"]),
        (connection("one.count", "two.enabled"), vec!["one.count", "Integer", "Boolean"]),
        (connection("one.y", "two.number"), vec!["one.y", "Real", "Integer"]),
        (connection("one.z", "two.u") + &connection("one.y", "two.u"), vec!["two.u", "already connected in line"]),
        (connection("one.length", "two.heat"), vec!["one.length", " m ", "two.heat", " K", "suppressUnitConversion"]),
        (connection_with("one.z", "two.u", "", "<ssc:BooleanMappingTransformation/>"), vec!["BooleanMapping"]),
        (connection_with("one.z", "two.u", "", "<ssc:LinearTransformation factor='a'/>"), vec!["factor = a"]),
        (connection_with("one.count", "two.number", "", "<ssc:LinearTransformation factor='2'/>"), vec!["one.count"]),
        ("<ssd:Connection startConnector='y' endElement='two' endConnector='u'/>".into(), vec!["startElement"]),
    ];
    for (connections, mut words) in cases {
        words.extend(["SystemStructure.ssd", "line "]);
        assert_mentions(&Folder::new(&connections).refusal(), &words);
    }
}

#[test]
fn a_connector_must_agree_with_the_fmu() {
    let cases = [
        (r#""u" kind="input"><ssc:Real/>"#, r#""w" kind="input"><ssc:Real/>"#, ["one.w", "no such variable"]),
        (
            r#""u" kind="input"><ssc:Real/>"#,
            r#""u" kind="output"><ssc:Real/>"#,
            ["one.u", "the variable of the FMU is input"],
        ),
        (r#""u" kind="input"><ssc:Real/>"#, r#""u" kind="inward"><ssc:Real/>"#, ["kind = inward", "must be one of"]),
        (r#""u" kind="input"><ssc:Real/>"#, r#""u" kind="input"><ssc:Boolean/>"#, ["one.u", "Boolean"]),
        (r#""u" kind="input"><ssc:Real/>"#, r#""y" kind="output"><ssc:Real/>"#, ["two connectors", "`y`"]),
        (
            r#""heat" kind="input"/>"#,
            r#""heat" kind="input"><ssc:Real unit="ft"/></ssd:Connector>"#,
            ["one.heat", "ft"],
        ),
        (
            r#""heat" kind="input"/>"#,
            r#""heat" kind="input"><ssc:Real unit="bar"/></ssd:Connector>"#,
            ["one.heat", "bar"],
        ),
    ];
    for (old, new, words) in cases {
        let error = Folder::new("").replaced(old, new).refusal();
        assert_mentions(&error, &words);
        assert_mentions(&error, &["line "]);
    }
}

#[test]
fn values_of_one_dimension_are_converted_on_the_way() {
    let conversion = |attributes: &str, inner: &str| {
        let folder = Folder::new(&connection_with("one.length", "two.width", attributes, inner));
        folder.wiring().unwrap().links[0].conversion
    };
    // 3 m are 3000 mm; the transformation counts in the target's unit.
    assert!((conversion("", "").of(3.0) - 3000.0).abs() < 1e-9);
    let linear = "<ssc:LinearTransformation factor='2' offset='5'/>";
    assert!((conversion("", linear).of(3.0) - 6005.0).abs() < 1e-9);
    assert_eq!(conversion("suppressUnitConversion='true'", linear).of(3.0), 11.0);
    assert_eq!(conversion("suppressUnitConversion='true'", "").of(0.1), 0.1);
    // Connectors in feet: 1 m = 1000 mm = 3.28 ft, +1 ft = 304.8 mm.
    let connectors = connection_with("one.length", "two.width", "", "<ssc:LinearTransformation offset='1'/>");
    let text = r#""width" kind="input"/>"#;
    let folder = Folder::new(&connectors)
        .replaced(text, r#""width" kind="input"><ssc:Real/></ssd:Connector>"#)
        .replaced(text, r#""width" kind="input"><ssc:Real unit="ft"/></ssd:Connector>"#);
    assert!((folder.wiring().unwrap().links[0].conversion.of(1.0) - 1304.8).abs() < 1e-9);
}

#[test]
fn whole_numbers_and_truth_values_can_be_connected() {
    let connections = [("one.count", "two.number"), ("one.count", "two.u"), ("two.alarm", "one.enabled")];
    let folder = Folder::new(&connections.map(|(from, to)| connection(from, to)).concat());
    assert_eq!(folder.wiring().unwrap().links.len(), 3);
}

#[test]
fn an_input_that_may_have_been_forgotten_is_noted() {
    let notes = Folder::new(&connection("one.z", "two.u")).wiring().unwrap().notes;
    assert!(notes.iter().any(|note| note.contains("line ") && note.contains("`one.u`")), "{notes:?}");
    assert!(!notes.iter().any(|note| note.contains("two.u")), "{notes:?}");
}

#[test]
fn the_system_prevails_over_its_components_a_case_over_both_and_a_single_value_over_all() {
    let folder = Folder::with(&binding(&set(&gain("gain", "2"))), "", "");
    assert_eq!(start(&folder.wiring().unwrap(), "gain"), Value::Real(2.0));
    let folder = Folder::with(&binding(&set(&gain("gain", "2"))), &binding(&set(&gain("one.gain", "3"))), "");
    assert_eq!(start(&folder.wiring().unwrap(), "gain"), Value::Real(3.0));
    folder.write("high.ssv", &set(&gain("one.gain", "4")));
    let mut structure = folder.structure().unwrap();
    structure.apply_case("high.ssv".as_ref(), &folder.files()).unwrap();
    assert_eq!(start(&wiring(&structure).unwrap(), "gain"), Value::Real(4.0));
    structure.set("one.gain = 5").unwrap();
    assert_eq!(start(&wiring(&structure).unwrap(), "gain"), Value::Real(5.0));
    assert_eq!(structure.components[0].values.len(), 1);
}

#[test]
fn parameter_files_and_prefixes_are_followed() {
    let folder = Folder::with("", "", "").replaced(
        "<ssd:Elements>",
        "<ssd:ParameterBindings><ssd:ParameterBinding prefix=\"one.\" source=\"a.ssv\"/></ssd:ParameterBindings><ssd:Elements>",
    );
    folder.write("a.ssv", &set(&gain("gain", "7")));
    assert_eq!(start(&folder.wiring().unwrap(), "gain"), Value::Real(7.0));
    assert_eq!(folder.structure().unwrap().parameter_files, ["a.ssv"]);
}

#[test]
fn values_of_every_type_are_taken() {
    let values = "<ssv:Parameter name='mode'><ssv:Enumeration value='fast'/></ssv:Parameter>
        <ssv:Parameter name='steps'><ssv:Integer value='-3'/></ssv:Parameter>
        <ssv:Parameter name='enabled'><ssv:Boolean value='0'/></ssv:Parameter>
        <ssv:Parameter name='file'><ssv:String value='a b'/></ssv:Parameter>
        <ssv:Parameter name='gain'><ssv:Real value='10' unit='ft'/></ssv:Parameter>";
    let wiring = Folder::with(&binding(&set(values)), "", "").wiring().unwrap();
    assert_eq!(start(&wiring, "mode"), Value::Integer(2));
    assert_eq!(start(&wiring, "steps"), Value::Integer(-3));
    assert_eq!(start(&wiring, "enabled"), Value::Boolean(false));
    assert_eq!(start(&wiring, "file"), Value::String("a b".into()));
    let Value::Real(gain) = start(&wiring, "gain") else { panic!("not a Real") };
    assert!((gain - 3.048).abs() < 1e-12);
}

#[test]
fn a_start_value_that_fits_nothing_is_refused_with_its_line() {
    let one = |name: &str, value: &str| format!("\n<ssv:Parameter name='{name}'>{value}</ssv:Parameter>");
    let cases = [
        (one("gian", "<ssv:Real value='1'/>"), vec!["one.gian"]),
        (one("gain", "<ssv:Real value='one'/>"), vec!["one.gain", "finite number"]),
        (one("gain", "<ssv:Real value='INF'/>"), vec!["one.gain", "finite number"]),
        (one("gain", "<ssv:String value='1'/>"), vec!["one.gain", "String", "Real"]),
        (one("gain", "<ssv:Real value='1' unit='kPa'/>"), vec!["one.gain", "kPa", " m,"]),
        (one("steps", "<ssv:Real value='1'/>"), vec!["one.steps", "Integer"]),
        (one("steps", "<ssv:Integer value='1.5'/>"), vec!["one.steps", "whole"]),
        (one("steps", "<ssv:Integer value='3000000000'/>"), vec!["one.steps"]),
        (one("mode", "<ssv:Enumeration value='medium'/>"), vec!["one.mode", "slow (1), fast (2)"]),
        (one("mode", "<ssv:Integer value='3'/>"), vec!["one.mode", "slow (1), fast (2)"]),
        (one("enabled", "<ssv:Boolean value='yes'/>"), vec!["one.enabled", "true or false"]),
        (one("file", "<ssv:Binary value='00'/>"), vec!["file", "Binary"]),
        (one("y", "<ssv:Real value='1'/>"), vec!["one.y", "output"]),
        (one("pi", "<ssv:Real value='3'/>"), vec!["one.pi", "constant"]),
        (one("u", "<ssv:Real value='1'/>"), vec!["one.u", "connected"]),
        (one("gain", ""), vec!["gain", "no value"]),
        (gain("gain", "1") + &one("gain", "<ssv:Real value='2'/>"), vec!["gain", "twice"]),
    ];
    for (values, mut words) in cases {
        words.push("line ");
        assert_mentions(&Folder::with(&binding(&set(&values)), "", &connection("two.z", "one.u")).refusal(), &words);
    }
    let astray = Folder::with("", &binding(&set(&gain("three.gain", "1"))), "");
    assert_mentions(&astray.refusal(), &["three.gain", "one, two", "line "]);
}

#[test]
fn a_single_value_names_a_unit_that_is_there_and_means_one() {
    let mut structure = Folder::new("").structure().unwrap();
    let mut refusal = |assignment: &str| structure.set(assignment).unwrap_err().to_string();
    assert_mentions(&refusal("one.gain"), &["UNIT.variable=value"]);
    assert_mentions(&refusal("three.gain=1"), &["three.gain", "one, two"]);
    assert_mentions(&refusal("A.gain=1"), &["`A`", "one, two"]);
    structure.components[1].fmu = "B".to_owned();
    structure.set("B.gain=8").unwrap();
    assert_eq!(structure.components[1].values[0].text, "8");
    // A name without a component belongs to the composite, not to separate FMUs.
    structure.set("gain=1").unwrap();
    let refusal =
        LoadedLoop::new(&structure, Path::new(""), &adaptive_fmu::fmu::Hosting::InProcess).unwrap_err().to_string();
    assert_mentions(&refusal, &["--set gain=1", "UNIT.variable", "one, two", "--composite"]);
}

#[test]
fn a_source_that_leads_out_of_the_folder_is_refused() {
    for source in
        ["../a.ssv", "/etc/passwd", "https://example.org/a.ssv", "file:///a.ssv", "a/../../a.ssv", "%2e%2e/a.ssv"]
    {
        let binding = format!(
            "<ssd:ParameterBindings><ssd:ParameterBinding source=\"{source}\"/></ssd:ParameterBindings><ssd:Elements>"
        );
        assert_mentions(&Folder::new("").replaced("<ssd:Elements>", &binding).refusal(), &["line ", source]);
        let fmu = Folder::new("").replaced("resources/A.fmu", source);
        assert_mentions(&fmu.refusal(), &["line ", source, "resources/NAME.fmu"]);
    }
    let gone = Folder::new("").replaced("resources/A.fmu", "resources/../../Gone.fmu");
    assert_mentions(&gone.refusal(), &["line ", "there is no file", "resources/NAME.fmu"]);
}

#[test]
fn what_this_reader_does_not_know_is_refused_not_skipped() {
    let file = |old: &str, new: &str| Folder::new("").replaced(old, new).refusal();
    let bindings = |inner: &str| {
        file("<ssd:Elements>", &format!("<ssd:ParameterBindings>{inner}</ssd:ParameterBindings><ssd:Elements>"))
    };
    let mapping = "<ssd:ParameterBinding prefix='one.' source='SystemStructure.ssd'><ssd:ParameterMapping/></ssd:ParameterBinding>";
    assert_mentions(&bindings(mapping), &["line "]);
    assert_mentions(&bindings("<ssd:ParameterBinding type='text/csv' source='a.csv'/>"), &["line ", "text/csv"]);
    assert_mentions(
        &bindings("<ssd:ParameterBinding sourceBase='component' source='a.ssv'/>"),
        &["line ", "sourceBase"],
    );
    assert_mentions(&bindings("<ssd:ParameterBinding source='gone.ssv'/>"), &["line ", "gone.ssv"]);
    let reference = "<ssd:SignalDictionaryReference name='signals'/><ssd:Component ";
    assert_mentions(&file("<ssd:Component ", reference), &["line ", "SignalDictionaryReference"]);
    assert_mentions(
        &file("source=\"resources/A.fmu\"", "type='application/x-ssp-package' source='a.ssp'"),
        &["line ", "x-ssp"],
    );
    assert_mentions(
        &file("<ssd:Component ", "<ssd:Component implementation='ModelExchange' "),
        &["line ", "ModelExchange"],
    );
    assert_mentions(&file("version=\"1.0\"", "version=\"2.0\""), &["line ", "2.0"]);
    assert_mentions(&file("name=\"two\"", "name=\"one\""), &["line ", "`one`"]);
    assert_mentions(&file("name=\"pair\"", "name=\"../pair\""), &["line ", "../pair"]);
    assert_mentions(&file("step=\"0.1\"", "step=\"0\""), &["line ", "step = 0"]);
    let plot = |more: &str| file("<Master", &format!("<Plot title='p' signals='one.y' {more}/><Master"));
    assert_mentions(&plot("scale='logarithmic'"), &["line ", "scale = logarithmic", "linear, log or auto"]);
    assert_mentions(&plot("references='two.y'"), &["line ", "references = two.y"]);
}

#[test]
fn a_file_that_is_no_xml_is_refused() {
    let text = |text: &[u8]| {
        let folder = Folder(tempfile::tempdir().unwrap());
        fs::write(folder.0.path().join("SystemStructure.ssd"), text).unwrap();
        folder.refusal()
    };
    assert_mentions(&text(b"<a>"), &["SystemStructure.ssd"]);
    assert_mentions(&text(b"<a/>"), &["SystemStructureDescription"]);
    assert_mentions(&text(b"\xff\xfe<\0a\0/\0>\0"), &["SystemStructure.ssd", "UTF-8"]);
    assert_mentions(&text(b"<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"), &["SystemStructure.ssd"]);
    assert_mentions(&text("<a>".repeat(1_000_000).as_bytes()), &["SystemStructure.ssd"]);
    let nothing = Folder(tempfile::tempdir().unwrap());
    assert_mentions(&nothing.refusal(), &["SystemStructure.ssd"]);
}

#[test]
fn a_loop_may_be_there_to_show_a_failure_in_a_span_of_time() {
    let with = |failure: &str| Folder::new("").replaced("</ClosedLoop>", &format!("\n{failure}</ClosedLoop>"));
    assert_eq!(with("").structure().unwrap().expected_failure, None);
    let expected = with("<ExpectedFailure from='0.1' until='0.2'/>").structure().unwrap().expected_failure.unwrap();
    assert_eq!((expected.from, expected.until, expected.separate_only), (0.1, 0.2, false));
    let separate = with("<ExpectedFailure from='0.1' until='0.2' of='separate'/>").structure().unwrap();
    assert!(separate.expected_failure.unwrap().separate_only);
    let wrong = [
        ("from='0.2' until='0.1'", "until = 0.1"),
        ("from='0.2'", "no until"),
        ("from='0.1' until='0.2' of='units'", "of = units"),
    ];
    for (failure, word) in wrong {
        let error = with(&format!("<ExpectedFailure {failure}/>")).refusal();
        assert_mentions(&error, &["SystemStructure.ssd", "line ", word]);
    }
}
