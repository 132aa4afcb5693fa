//! Loops of two units in folders, as text: what is read of them.

use std::fs;

use adaptive_fmu::fmu::Value;
use adaptive_fmu::model_description::ModelDescription;
use adaptive_fmu::structure::{AlgebraicLoops, LoopFiles, Structure, Wiring, check};
use tempfile::TempDir;

/// A unit with inputs and outputs of all types: y follows u without delay, z and `length` do not.
pub const UNIT: &str = r#"<fmiModelDescription fmiVersion="2.0" modelName="A" guid="g">
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

pub const CONNECTORS: &str = r#"<ssd:Connectors>
  <ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector><ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
  <ssd:Connector name="z" kind="output"/><ssd:Connector name="length" kind="output"/>
  <ssd:Connector name="width" kind="input"/><ssd:Connector name="heat" kind="input"/>
  <ssd:Connector name="count" kind="output"/><ssd:Connector name="number" kind="input"/>
  <ssd:Connector name="alarm" kind="output"/><ssd:Connector name="enabled" kind="input"/>
</ssd:Connectors>"#;

/// A folder with a loop of two such units, `one` and `two`.
pub struct Folder(pub TempDir);

impl Folder {
    pub fn new(connections: &str) -> Self {
        Folder::with("", "", connections)
    }

    /// Bindings of the first unit, then of the system.
    pub fn with(of_one: &str, of_system: &str, connections: &str) -> Self {
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

    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    /// The loop's file with some text in place of another.
    pub fn replaced(self, old: &str, new: &str) -> Self {
        let text = fs::read_to_string(self.0.path().join("SystemStructure.ssd")).unwrap();
        assert!(text.contains(old), "{old}");
        self.write("SystemStructure.ssd", &text.replacen(old, new, 1));
        self
    }

    pub fn files(&self) -> LoopFiles {
        LoopFiles::find(self.0.path().to_str().unwrap()).unwrap()
    }

    pub fn structure(&self) -> Result<Structure, String> {
        self.files().structure().map_err(|error| error.to_string())
    }

    pub fn wiring(&self) -> Result<Wiring, String> {
        self.structure().and_then(|structure| wiring(&structure))
    }

    /// Reason why the loop is refused.
    pub fn refusal(&self) -> String {
        self.wiring().expect_err("the loop was taken")
    }
}

pub fn wiring(structure: &Structure) -> Result<Wiring, String> {
    let description = ModelDescription::read(UNIT).unwrap();
    check(structure, &[&description, &description], AlgebraicLoops::Exchanged).map_err(|error| error.to_string())
}

pub fn connection(from: &str, to: &str) -> String {
    connection_with(from, to, "", "")
}

pub fn connection_with(from: &str, to: &str, attributes: &str, inner: &str) -> String {
    let ((unit, output), (other, input)) = (from.split_once('.').unwrap(), to.split_once('.').unwrap());
    format!(
        "\n<ssd:Connection startElement=\"{unit}\" startConnector=\"{output}\" endElement=\"{other}\" \
         endConnector=\"{input}\" {attributes}>{inner}</ssd:Connection>"
    )
}

pub fn set(parameters: &str) -> String {
    format!(
        "<ssv:ParameterSet name=\"p\" version=\"1.0\"><ssv:Parameters>{parameters}</ssv:Parameters></ssv:ParameterSet>"
    )
    .replace("<ssv:ParameterSet ", "<ssv:ParameterSet xmlns:ssv=\"v\" ")
}

pub fn binding(set: &str) -> String {
    format!(
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>{set}</ssd:ParameterValues>\
         </ssd:ParameterBinding></ssd:ParameterBindings>"
    )
}

pub fn gain(name: &str, value: &str) -> String {
    format!("<ssv:Parameter name=\"{name}\"><ssv:Real value=\"{value}\"/></ssv:Parameter>")
}

pub fn assert_mentions(text: &str, words: &[&str]) {
    words.iter().for_each(|word| assert!(text.contains(word), "`{word}` is not in: {text}"));
    assert!(!text.contains('\n'), "{text}");
}

/// The start value of a variable of the first unit.
pub fn start(wiring: &Wiring, name: &str) -> Value {
    let place = ModelDescription::read(UNIT).unwrap().place(name).unwrap();
    wiring.values[0].iter().find(|(known, _)| *known == place).map(|(_, value)| value.clone()).unwrap()
}
