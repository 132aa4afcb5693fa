//! Loops of other tools: only texts of FMUs, systems within systems, mappings of parameters.

use adaptive_fmu::fmu::Value;
use adaptive_fmu::model_description::ModelDescription;
use adaptive_fmu::structure::{AlgebraicLoops, Wiring, check};

use crate::structures::{CONNECTORS, Folder, UNIT, assert_mentions, binding, connection, gain, set, start};

/// A unit with an output `y` and an input `u`; both ends of a connection are of this kind.
fn measured(output: &str, input: &str, definitions: &str) -> ModelDescription {
    ModelDescription::read(&format!(
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
    check(&folder.structure()?, &[&unit, &unit], AlgebraicLoops::Exchanged).map_err(|error| error.to_string())
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
fn units_that_are_not_known_connect_and_are_reported_where_their_texts_differ() {
    let notes = |from: &str, to: &str| {
        let wiring = wired(from, to, "").unwrap();
        assert_eq!(wiring.links[0].conversion.of(0.1), 0.1, "{from} {to}");
        wiring.notes.into_iter().filter(|note| note.contains("units of measurement of connections")).collect::<Vec<_>>()
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
    for (from, to) in [("unit='widget'", "unit='gadget'"), ("unit='widget'", "unit='m'")] {
        let texts = notes(from, to).concat();
        assert_mentions(&texts, &["one.y", "two.u", "passed on unchanged"]);
    }
}

#[test]
fn other_dimensions_are_refused_by_name_in_whatever_text_they_come() {
    for (from, to) in [("rpm", "Hz"), ("bar", "K"), ("%", "m"), ("rad", "m"), ("N.m", "N"), ("degC", "%"), ("1", "m")] {
        let error = wired(&format!("unit='{from}'"), &format!("unit='{to}'"), "").unwrap_err();
        assert_mentions(&error, &["one.y", "two.u", from, to, "another dimension", "suppressUnitConversion"]);
    }
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
    assert_mentions(&with(&entry("").replace("'K'", "'L'")).refusal(), &["source = L", "line "]);
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
    let unit = ModelDescription::read(UNIT).unwrap();
    let wiring = check(&structure, &[&unit, &unit, &unit], AlgebraicLoops::Exchanged).unwrap();
    let place = |name: &str| unit.place(name).unwrap();
    let mut found: Vec<_> = wiring.links.iter().map(|link| (link.from, link.to, link.conversion.of(1.0))).collect();
    found.sort_by_key(|(from, ..)| *from);
    // (1 · 2 + 1) · 3 on its way in.
    assert_eq!(found, [((0, place("z")), (2, place("u")), 9.0), ((2, place("z")), (1, place("u")), 1.0)]);
    // What another unit gives counts; a connector that nothing leads to hands its start value on.
    assert_eq!(wiring.values[2], [(place("gain"), Value::Real(4.0)), (place("width"), Value::Real(5.0))]);
    let notes =
        folder("<ssd:Connection startElement='in' startConnector='way' endElement='two' endConnector='u'/>").refusal();
    assert_mentions(&notes, &["startConnector = way", "system `in`", "line "]);
}
