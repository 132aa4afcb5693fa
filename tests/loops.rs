//! Loops as SSP files: what is read, what start values hold, and what is refused, with its line.

use std::fs;
use std::path::Path;

use adaptive_fmu::simulation::{Circles, Description, LoadedLoop, LoopFiles, Structure, Value, Wiring, check};
use tempfile::TempDir;

/// A unit with inputs and outputs of all types: y follows u without delay, z and `length` do not.
const UNIT: &str = r#"<fmiModelDescription fmiVersion="2.0" modelName="A" guid="g">
  <CoSimulation modelIdentifier="A"/>
  <UnitDefinitions>
    <Unit name="m"><BaseUnit m="1"/></Unit><Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
    <Unit name="K"><BaseUnit K="1"/></Unit><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="slow" value="1"/><Item name="fast" value="2"/>
  </Enumeration></SimpleType></TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="z" valueReference="2" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="length" valueReference="3" causality="output"><Real unit="m"/></ScalarVariable>
    <ScalarVariable name="width" valueReference="4" causality="input"><Real unit="mm" start="0"/></ScalarVariable>
    <ScalarVariable name="heat" valueReference="5" causality="input"><Real unit="K" start="0"/></ScalarVariable>
    <ScalarVariable name="count" valueReference="6" causality="output"><Integer/></ScalarVariable>
    <ScalarVariable name="number" valueReference="7" causality="input"><Integer start="0"/></ScalarVariable>
    <ScalarVariable name="alarm" valueReference="8" causality="output"><Boolean/></ScalarVariable>
    <ScalarVariable name="enabled" valueReference="9" causality="input"><Boolean start="true"/></ScalarVariable>
    <ScalarVariable name="mode" valueReference="10" causality="parameter"><Enumeration declaredType="Mode" start="1"/></ScalarVariable>
    <ScalarVariable name="gain" valueReference="11" causality="parameter"><Real start="1" unit="m"/></ScalarVariable>
    <ScalarVariable name="steps" valueReference="12" causality="parameter"><Integer start="1"/></ScalarVariable>
    <ScalarVariable name="file" valueReference="13" causality="parameter"><String start=""/></ScalarVariable>
    <ScalarVariable name="pi" valueReference="14" variability="constant"><Real start="3.14"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs>
    <Unknown index="1" dependencies="2"/><Unknown index="3" dependencies=""/><Unknown index="4" dependencies=""/>
    <Unknown index="7" dependencies=""/><Unknown index="9"/>
  </Outputs></ModelStructure>
</fmiModelDescription>"#;

const CONNECTORS: &str = r#"<ssd:Connectors>
  <ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector><ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
  <ssd:Connector name="z" kind="output"/><ssd:Connector name="length" kind="output"/>
  <ssd:Connector name="width" kind="input"/><ssd:Connector name="heat" kind="input"/>
  <ssd:Connector name="count" kind="output"/><ssd:Connector name="number" kind="input"/>
  <ssd:Connector name="alarm" kind="output"/><ssd:Connector name="enabled" kind="input"/>
</ssd:Connectors>"#;

/// A folder with a loop of two such units, `one` and `two`.
struct Folder(TempDir);

impl Folder {
    fn new(connections: &str) -> Self {
        Folder::with("", "", connections)
    }

    /// Bindings of the first unit, then of the system.
    fn with(of_one: &str, of_system: &str, connections: &str) -> Self {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.write(
            "SystemStructure.ssd",
            &format!(
                r#"<ssd:SystemStructureDescription xmlns:ssd="d" xmlns:ssc="c" xmlns:ssv="v" name="pair" version="1.0">
<ssd:System name="s">{of_system}<ssd:Elements>
<ssd:Component name="one" source="resources/A.fmu">{CONNECTORS}{of_one}</ssd:Component>
<ssd:Component name="two" source="resources/A.fmu">{CONNECTORS}</ssd:Component>
</ssd:Elements><ssd:Connections>{connections}</ssd:Connections></ssd:System>
<ssd:Units><ssc:Unit name="ft"><ssc:BaseUnit m="1" factor="0.3048"/></ssc:Unit></ssd:Units>
<ssd:DefaultExperiment stopTime="1"/><ssd:Annotations><ssc:Annotation type="adaptive-fmu.closed-loop">
<ClosedLoop><Master step="0.1" order="jacobi"/></ClosedLoop></ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>"#
            ),
        );
        folder
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    /// The loop's file with some text in place of another.
    fn replaced(self, old: &str, new: &str) -> Self {
        let text = fs::read_to_string(self.0.path().join("SystemStructure.ssd")).unwrap();
        assert!(text.contains(old), "{old}");
        self.write("SystemStructure.ssd", &text.replacen(old, new, 1));
        self
    }

    fn files(&self) -> LoopFiles {
        LoopFiles::find(self.0.path().to_str().unwrap()).unwrap()
    }

    fn structure(&self) -> Result<Structure, String> {
        self.files().structure().map_err(|error| error.to_string())
    }

    fn wiring(&self) -> Result<Wiring, String> {
        self.structure().and_then(|structure| wiring(&structure))
    }

    /// Why the loop is refused.
    fn refusal(&self) -> String {
        self.wiring().expect_err("the loop was taken")
    }
}

fn wiring(structure: &Structure) -> Result<Wiring, String> {
    let description = Description::read(UNIT).unwrap();
    check(structure, &[&description, &description], Circles::Exchanged).map_err(|error| error.to_string())
}

fn connection(from: &str, to: &str) -> String {
    connection_with(from, to, "", "")
}

fn connection_with(from: &str, to: &str, attributes: &str, inner: &str) -> String {
    let ((unit, output), (other, input)) = (from.split_once('.').unwrap(), to.split_once('.').unwrap());
    format!(
        "\n<ssd:Connection startElement=\"{unit}\" startConnector=\"{output}\" endElement=\"{other}\" \
         endConnector=\"{input}\" {attributes}>{inner}</ssd:Connection>"
    )
}

fn set(parameters: &str) -> String {
    format!(
        "<ssv:ParameterSet name=\"p\" version=\"1.0\"><ssv:Parameters>{parameters}</ssv:Parameters></ssv:ParameterSet>"
    )
    .replace("<ssv:ParameterSet ", "<ssv:ParameterSet xmlns:ssv=\"v\" ")
}

fn binding(set: &str) -> String {
    format!(
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>{set}</ssd:ParameterValues>\
         </ssd:ParameterBinding></ssd:ParameterBindings>"
    )
}

fn gain(name: &str, value: &str) -> String {
    format!("<ssv:Parameter name=\"{name}\"><ssv:Real value=\"{value}\"/></ssv:Parameter>")
}

fn assert_tells(told: &str, words: &[&str]) {
    words.iter().for_each(|word| assert!(told.contains(word), "`{word}` is not in: {told}"));
    assert!(!told.contains('\n'), "{told}");
}

/// The start value of a variable of the first unit.
fn start(wiring: &Wiring, name: &str) -> Value {
    let place = Description::read(UNIT).unwrap().place(name).unwrap();
    wiring.values[0].iter().find(|(known, _)| *known == place).map(|(_, value)| value.clone()).unwrap()
}

#[test]
fn an_algebraic_loop_is_named_signal_by_signal() {
    let folder = Folder::new(&(connection("one.y", "two.u") + &connection("two.y", "one.u")));
    assert_tells(&folder.refusal(), &["line ", "algebraic loop", "one.y → two.u → two.y → one.u → one.y"]);
}

#[test]
fn a_circle_through_a_delay_is_none() {
    let folder = Folder::new(&(connection("one.y", "two.u") + &connection("two.z", "one.u")));
    assert_eq!(folder.wiring().unwrap().links.len(), 2);
}

#[test]
fn a_declared_algebraic_loop_is_refused_with_the_option_that_accepts_it() {
    let circle = connection("one.y", "two.u") + &connection("two.y", "one.u");
    assert_tells(&Folder::new(&circle).refusal(), &["--accept-algebraic-loops"]);
    let accepted = |text: &str| Folder::new(&circle).replaced("order=\"jacobi\"", &format!("order='jacobi' {text}"));
    let wiring = accepted("algebraic-loops='accept'").wiring().unwrap();
    let notes = wiring.notes.join("\n");
    assert!(wiring.circular && notes.contains("accepted: one.y → two.u → two.y → one.u → one.y"), "{notes}");
    assert_tells(&accepted("algebraic-loops='refuse'").refusal(), &["--accept-algebraic-loops"]);
    assert_tells(&accepted("algebraic-loops='never'").refusal(), &["algebraic-loops = never", "line "]);
}

#[test]
fn an_output_of_unknown_dependencies_closes_no_algebraic_loop_but_is_told() {
    let folder = Folder::new(&connection("one.alarm", "one.enabled"));
    let wiring = folder.wiring().unwrap();
    let told: Vec<_> = wiring.notes.iter().filter(|note| note.contains("algebraic loop")).collect();
    assert_eq!(told.len(), 1, "{:?}", wiring.notes);
    assert_tells(told[0], &["`one` does not tell", "one.alarm → one.enabled → one.alarm", "last exchange"]);
    assert!(wiring.circular);
    // What is integrated as one unit exchanges nothing.
    let (structure, unit) = (folder.structure().unwrap(), Description::read(UNIT).unwrap());
    let refusal = check(&structure, &[&unit, &unit], Circles::Refused).unwrap_err().to_string();
    assert_tells(&refusal, &["algebraic loop", "one.alarm → one.enabled → one.alarm"]);
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
        (connection("one.z", "two.u") + &connection("one.y", "two.u"), vec!["two.u", "already, in line"]),
        (connection("one.length", "two.heat"), vec!["one.length", " m ", "two.heat", " K", "suppressUnitConversion"]),
        (connection_with("one.z", "two.u", "", "<ssc:BooleanMappingTransformation/>"), vec!["BooleanMapping"]),
        (connection_with("one.z", "two.u", "", "<ssc:LinearTransformation factor='a'/>"), vec!["factor = a"]),
        (connection_with("one.count", "two.number", "", "<ssc:LinearTransformation factor='2'/>"), vec!["one.count"]),
        ("<ssd:Connection startConnector='y' endElement='two' endConnector='u'/>".into(), vec!["startElement"]),
    ];
    for (connections, mut words) in cases {
        words.extend(["SystemStructure.ssd", "line "]);
        assert_tells(&Folder::new(&connections).refusal(), &words);
    }
}

#[test]
fn a_connector_must_be_what_the_fmu_says() {
    let cases = [
        (r#""u" kind="input"><ssc:Real/>"#, r#""w" kind="input"><ssc:Real/>"#, ["one.w", "no such variable"]),
        (r#""u" kind="input"><ssc:Real/>"#, r#""u" kind="output"><ssc:Real/>"#, ["one.u", "in the FMU it is input"]),
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
        let told = Folder::new("").replaced(old, new).refusal();
        assert_tells(&told, &words);
        assert_tells(&told, &["line "]);
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

/// A unit with an output `y` and an input `u`; both ends of a connection are of this kind.
fn measured(output: &str, input: &str, definitions: &str) -> Description {
    Description::read(&format!(
        "<fmiModelDescription fmiVersion='2.0' modelName='A' guid='g'><CoSimulation modelIdentifier='A'/>\
         <UnitDefinitions>{definitions}</UnitDefinitions><TypeDefinitions><SimpleType name='Difference'>\
         <Real unit='degC' relativeQuantity='true'/></SimpleType></TypeDefinitions><ModelVariables>\
         <ScalarVariable name='y' valueReference='0' causality='output'><Real {output}/></ScalarVariable>\
         <ScalarVariable name='u' valueReference='1' causality='input'><Real {input} start='0'/></ScalarVariable>\
         </ModelVariables><ModelStructure><Outputs><Unknown index='1' dependencies=''/></Outputs></ModelStructure>\
         </fmiModelDescription>"
    ))
    .unwrap()
}

/// Wires `one.y` in a unit to `two.u` in another, as these attributes give them.
fn wired(output: &str, input: &str, definitions: &str) -> Result<Wiring, String> {
    let text = connection("one.y", "two.u");
    let connectors = "<ssd:Connectors><ssd:Connector name='y' kind='output'/><ssd:Connector name='u' kind='input'/></ssd:Connectors>";
    let folder = Folder::new(&text).replaced(CONNECTORS, connectors).replaced(CONNECTORS, connectors);
    let unit = measured(output, input, definitions);
    check(&folder.structure()?, &[&unit, &unit], Circles::Exchanged).map_err(|error| error.to_string())
}

#[test]
fn texts_of_units_convert_where_the_fmu_defines_none_or_only_their_names() {
    use std::f64::consts::PI;
    let conversions = [
        ("rpm", "rad/s", 30.0, PI),
        ("deg", "rad", 180.0, PI),
        ("degC", "K", 20.0, 293.15),
        ("degF", "degC", 212.0, 100.0),
        ("bar", "kPa", 2.0, 200.0),
        ("%", "1", 50.0, 0.5),
        ("km/h", "m/s", 36.0, 10.0),
        ("mm", "m", 1.0, 1e-3),
        ("mH", "H", 5.0, 5e-3),
        ("kOhm", "V/A", 2.0, 2e3),
        ("N.m", "J", 3.0, 3.0),
    ];
    for (from, to, value, expected) in conversions {
        let names = format!("<Unit name='{from}'/><Unit name='{to}'/>");
        for definitions in ["", &names] {
            let wiring = wired(&format!("unit='{from}'"), &format!("unit='{to}'"), definitions).unwrap();
            let found = wiring.links[0].conversion.of(value);
            assert!(
                (found - expected).abs() <= 4e-16 * expected.abs().max(300.0 * f64::from(u8::from(to == "degC"))),
                "{from}: {found}"
            );
        }
    }
    // What the file defines counts, whatever the name; a difference of temperatures has no offset.
    let own = "<Unit name='rpm'><BaseUnit s='-1' rad='1' factor='2'/></Unit>";
    assert_eq!(wired("unit='rpm'", "unit='rad/s'", own).unwrap().links[0].conversion.of(3.0), 6.0);
    let difference = wired("unit='K'", "declaredType='Difference'", "").unwrap();
    assert_eq!(difference.links[0].conversion.of(5.0), 5.0);
    assert_eq!(wired("unit='K'", "unit='degC'", "").unwrap().links[0].conversion.of(273.15), 0.0);
}

#[test]
fn units_that_are_not_known_connect_and_are_told_where_their_texts_differ() {
    let notes = |from: &str, to: &str| {
        let wiring = wired(from, to, "").unwrap();
        assert_eq!(wiring.links[0].conversion.of(0.1), 0.1, "{from} {to}");
        wiring.notes.into_iter().filter(|note| note.contains("units of connections")).collect::<Vec<_>>()
    };
    for (from, to) in [
        ("unit='widget'", "unit='widget'"),
        ("", "unit='m'"),
        ("unit='rad'", ""),
        ("", ""),
        ("unit=''", "unit='widget'"),
        ("unit='1'", "unit='rad'"),
        ("unit='-'", "unit='1'"),
    ] {
        assert_eq!(notes(from, to), Vec::<String>::new(), "{from} {to}");
    }
    for (from, to) in [("unit='widget'", "unit='gadget'"), ("unit='widget'", "unit='m'"), ("unit='1'", "unit='m'")] {
        let told = notes(from, to).concat();
        assert_tells(&told, &["one.y", "two.u", "as it is"]);
    }
}

#[test]
fn other_dimensions_are_refused_by_name_in_whatever_text_they_come() {
    for (from, to) in [("rpm", "Hz"), ("bar", "K"), ("%", "m"), ("rad", "m"), ("N.m", "N"), ("degC", "%")] {
        let told = wired(&format!("unit='{from}'"), &format!("unit='{to}'"), "").unwrap_err();
        assert_tells(&told, &["one.y", "two.u", from, to, "another dimension", "suppressUnitConversion"]);
    }
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
        (one("mode", "<ssv:Enumeration value='medium'/>"), vec!["one.mode", "slow, fast"]),
        (one("mode", "<ssv:Integer value='3'/>"), vec!["one.mode", "slow, fast"]),
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
        assert_tells(&Folder::with(&binding(&set(&values)), "", &connection("two.z", "one.u")).refusal(), &words);
    }
    let astray = Folder::with("", &binding(&set(&gain("three.gain", "1"))), "");
    assert_tells(&astray.refusal(), &["three.gain", "one, two", "line "]);
}

#[test]
fn a_single_value_names_a_unit_that_is_there_and_means_one() {
    let mut structure = Folder::new("").structure().unwrap();
    let mut refusal = |assignment: &str| structure.set(assignment).unwrap_err().to_string();
    assert_tells(&refusal("one.gain"), &["UNIT.variable=value"]);
    assert_tells(&refusal("three.gain=1"), &["three.gain", "one, two"]);
    assert_tells(&refusal("A.gain=1"), &["`A`", "one, two"]);
    structure.components[1].fmu = "B".to_owned();
    structure.set("B.gain=8").unwrap();
    assert_eq!(structure.components[1].values[0].text, "8");
    // Without a unit it is of the loop as one unit, which separate ones have not.
    structure.set("gain=1").unwrap();
    let refusal = LoadedLoop::new(&structure, Path::new(""), &adaptive_fmu::simulation::Hosting::InProcess)
        .unwrap_err()
        .to_string();
    assert_tells(&refusal, &["--set gain=1", "UNIT.variable", "one, two", "--composite"]);
}

#[test]
fn a_source_that_leads_out_of_the_folder_is_refused() {
    for source in
        ["../a.ssv", "/etc/passwd", "https://example.org/a.ssv", "file:///a.ssv", "a/../../a.ssv", "%2e%2e/a.ssv"]
    {
        let binding = format!(
            "<ssd:ParameterBindings><ssd:ParameterBinding source=\"{source}\"/></ssd:ParameterBindings><ssd:Elements>"
        );
        assert_tells(&Folder::new("").replaced("<ssd:Elements>", &binding).refusal(), &["line ", source]);
        let fmu = Folder::new("").replaced("resources/A.fmu", source);
        assert_tells(&fmu.refusal(), &["line ", source, "resources/NAME.fmu"]);
    }
    let gone = Folder::new("").replaced("resources/A.fmu", "resources/../../Gone.fmu");
    assert_tells(&gone.refusal(), &["line ", "there is no file", "resources/NAME.fmu"]);
}

#[test]
fn what_this_reader_does_not_know_is_refused_not_skipped() {
    let file = |old: &str, new: &str| Folder::new("").replaced(old, new).refusal();
    let bindings = |inner: &str| {
        file("<ssd:Elements>", &format!("<ssd:ParameterBindings>{inner}</ssd:ParameterBindings><ssd:Elements>"))
    };
    let mapping = "<ssd:ParameterBinding prefix='one.' source='SystemStructure.ssd'><ssd:ParameterMapping/></ssd:ParameterBinding>";
    assert_tells(&bindings(mapping), &["line "]);
    assert_tells(&bindings("<ssd:ParameterBinding type='text/csv' source='a.csv'/>"), &["line ", "text/csv"]);
    assert_tells(&bindings("<ssd:ParameterBinding sourceBase='component' source='a.ssv'/>"), &["line ", "sourceBase"]);
    assert_tells(&bindings("<ssd:ParameterBinding source='gone.ssv'/>"), &["line ", "gone.ssv"]);
    let reference = "<ssd:SignalDictionaryReference name='signals'/><ssd:Component ";
    assert_tells(&file("<ssd:Component ", reference), &["line ", "SignalDictionaryReference"]);
    assert_tells(
        &file("source=\"resources/A.fmu\"", "type='application/x-ssp-package' source='a.ssp'"),
        &["line ", "x-ssp"],
    );
    assert_tells(
        &file("<ssd:Component ", "<ssd:Component implementation='ModelExchange' "),
        &["line ", "ModelExchange"],
    );
    assert_tells(&file("version=\"1.0\"", "version=\"2.0\""), &["line ", "2.0"]);
    assert_tells(&file("name=\"two\"", "name=\"one\""), &["line ", "`one`"]);
    assert_tells(&file("name=\"pair\"", "name=\"../pair\""), &["line ", "../pair"]);
    assert_tells(&file("step=\"0.1\"", "step=\"0\""), &["line ", "step = 0"]);
}

#[test]
fn a_mapping_gives_values_other_names() {
    let values = gain("K", "2") + &gain("unused", "3");
    let entry = |inner: &str| format!("<ssm:MappingEntry source='K' target='gain'>{inner}</ssm:MappingEntry>");
    let inline = |entries: &str| {
        let mapping = format!(
            "<ssd:ParameterMapping><ssm:ParameterMapping xmlns:ssm='m' version='1.0'>{entries}</ssm:ParameterMapping></ssd:ParameterMapping>"
        );
        binding(&set(&values)).replace("</ssd:ParameterValues>", &format!("</ssd:ParameterValues>{mapping}"))
    };
    let with = |entries: &str| Folder::with(&inline(entries), "", "");
    assert_eq!(start(&with(&entry("")).wiring().unwrap(), "gain"), Value::Real(2.0));
    let linear = with(&entry("<ssc:LinearTransformation factor='10' offset='1'/>"));
    assert_eq!(start(&linear.wiring().unwrap(), "gain"), Value::Real(21.0));
    assert_tells(&with(&entry("").replace("'K'", "'L'")).refusal(), &["source = L", "line "]);
    let folder =
        Folder::with(&inline("").replace("<ssd:ParameterMapping>", "<ssd:ParameterMapping source='a.ssm'>"), "", "");
    folder.write(
        "a.ssm",
        &format!(
            "<ssm:ParameterMapping xmlns:ssm='m' xmlns:ssc='c' version='1.0'>{}</ssm:ParameterMapping>",
            entry("")
        ),
    );
    assert_eq!(start(&folder.wiring().unwrap(), "gain"), Value::Real(2.0));
}

#[test]
fn systems_within_hand_values_on_and_give_them_to_their_units() {
    let inner = format!(
        "<ssd:System name='in'><ssd:Connectors><ssd:Connector name='entry' kind='input'><ssc:Real/></ssd:Connector>\
         <ssd:Connector name='exit' kind='output'/><ssd:Connector name='free' kind='input'/></ssd:Connectors><ssd:Elements>\
         <ssd:Component name='three' source='resources/A.fmu'>{CONNECTORS}</ssd:Component></ssd:Elements><ssd:Connections>\
         <ssd:Connection startElement='' startConnector='entry' endElement='three' endConnector='u'>\
         <ssc:LinearTransformation factor='3'/></ssd:Connection>\
         <ssd:Connection startElement='three' startConnector='z' endConnector='exit'/>\
         <ssd:Connection startConnector='free' endElement='three' endConnector='width'/></ssd:Connections></ssd:System>"
    );
    let joined = "<ssd:Connection startElement='one' startConnector='z' endElement='in' endConnector='entry'>\
        <ssc:LinearTransformation factor='2' offset='1'/></ssd:Connection>\
        <ssd:Connection startElement='in' startConnector='exit' endElement='two' endConnector='u'/>";
    let of_system = binding(&set(&(gain("in.three.gain", "4") + &gain("in.free", "5") + &gain("in.entry", "9"))));
    let folder = |joined: &str| {
        Folder::with("", &of_system, joined).replaced("</ssd:Elements>", &format!("{inner}</ssd:Elements>"))
    };
    let structure = folder(joined).structure().unwrap();
    let names: Vec<_> = structure.components.iter().map(|component| component.name.as_str()).collect();
    assert_eq!(names, ["one", "two", "in.three"]);
    let unit = Description::read(UNIT).unwrap();
    let wiring = check(&structure, &[&unit, &unit, &unit], Circles::Exchanged).unwrap();
    let place = |name: &str| unit.place(name).unwrap();
    let mut found: Vec<_> = wiring.links.iter().map(|link| (link.from, link.to, link.conversion.of(1.0))).collect();
    found.sort_by_key(|(from, ..)| *from);
    // (1 · 2 + 1) · 3 on its way in.
    assert_eq!(found, [((0, place("z")), (2, place("u")), 9.0), ((2, place("z")), (1, place("u")), 1.0)]);
    // What another unit gives counts; a connector that nothing leads to hands its start value on.
    assert_eq!(wiring.values[2], [(place("gain"), Value::Real(4.0)), (place("width"), Value::Real(5.0))]);
    let told =
        folder("<ssd:Connection startElement='in' startConnector='way' endElement='two' endConnector='u'/>").refusal();
    assert_tells(&told, &["startConnector = way", "system `in`", "line "]);
}

#[test]
fn a_file_that_is_no_xml_is_refused() {
    let text = |text: &[u8]| {
        let folder = Folder(tempfile::tempdir().unwrap());
        fs::write(folder.0.path().join("SystemStructure.ssd"), text).unwrap();
        folder.refusal()
    };
    assert_tells(&text(b"<a>"), &["SystemStructure.ssd"]);
    assert_tells(&text(b"<a/>"), &["SystemStructureDescription"]);
    assert_tells(&text(b"\xff\xfe<\0a\0/\0>\0"), &["SystemStructure.ssd", "UTF-8"]);
    assert_tells(&text(b"<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"), &["SystemStructure.ssd"]);
    assert_tells(&text("<a>".repeat(1_000_000).as_bytes()), &["SystemStructure.ssd"]);
    let nothing = Folder(tempfile::tempdir().unwrap());
    assert_tells(&nothing.refusal(), &["SystemStructure.ssd"]);
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
        let told = with(&format!("<ExpectedFailure {failure}/>")).refusal();
        assert_tells(&told, &["SystemStructure.ssd", "line ", word]);
    }
}
