//! terminalsAndIcons/terminalsAndIcons.xml: pins in groups that tools connect in one step (from FMI 3.0, also allowed
//! in FMI 2.0.4).

use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};

use super::pins::Pin;
use crate::catalogue::Role;

/// The version of the standard that the file belongs to.
const VERSION: &str = "3.0";
/// Size of the icon, mm.
const SIZE: &str = "100";

/// The file of an FMU with some pins, each with the role of its FMU or part.
pub fn xml(pins: &[(Pin, Option<Role>)]) -> String {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    let written = write(&mut xml, pins);
    // Writing to memory can't fail.
    debug_assert!(written.is_ok());
    let mut text = String::from_utf8(xml.into_inner()).unwrap_or_default();
    text.push('\n');
    text
}

fn write(xml: &mut Writer<Vec<u8>>, pins: &[(Pin, Option<Role>)]) -> io::Result<()> {
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let place = [("x1", "0"), ("y1", "0"), ("x2", SIZE), ("y2", SIZE)];
    let terminals = terminals(pins);
    let root = xml.create_element("fmiTerminalsAndIcons").with_attribute(("fmiVersion", VERSION));
    root.write_inner_content(|xml| {
        xml.create_element("GraphicalRepresentation").write_inner_content(|xml| {
            let scaled = [("suggestedScalingFactorTo_mm", "0.2")];
            let system = xml.create_element("CoordinateSystem").with_attributes(place);
            system.with_attributes(scaled).write_empty()?;
            xml.create_element("Icon").with_attributes(place).write_empty()?;
            Ok(())
        })?;
        if terminals.is_empty() {
            return Ok(());
        }
        xml.create_element("Terminals")
            .write_inner_content(|xml| terminals.iter().try_for_each(|terminal| terminal.write(xml)))?;
        Ok(())
    })?;
    Ok(())
}

/// A group of pins.
struct Terminal<'a> {
    name: String,
    description: &'static str,
    /// Names of signals, and of their variables here.
    members: Vec<(String, &'a str)>,
}

/// The pins by their purpose, and by the parts of a composite that they belong to.
fn terminals<'a>(pins: &[(Pin<'a>, Option<Role>)]) -> Vec<Terminal<'a>> {
    let mut terminals: Vec<Terminal> = Vec::new();
    for (pin, role) in pins {
        let Some((name, description)) = pin.group.terminal() else { continue };
        let name = pin.part.map_or_else(|| name.to_owned(), |part| format!("{part}.{name}"));
        let member = (pin.member(*role), pin.variable.name.as_str());
        match terminals.iter_mut().find(|terminal| terminal.name == name) {
            Some(terminal) => terminal.members.push(member),
            None => terminals.push(Terminal { name, description, members: vec![member] }),
        }
    }
    terminals
}

impl Terminal<'_> {
    /// Writes it as a bus, not a plug: not every controller takes a reference's derivatives, or all outputs of a plant.
    fn write(&self, xml: &mut Writer<Vec<u8>>) -> io::Result<()> {
        let attributes = [("name", self.name.as_str()), ("matchingRule", "bus"), ("description", self.description)];
        xml.create_element("Terminal").with_attributes(attributes).write_inner_content(|xml| {
            self.members.iter().try_for_each(|(member, variable)| {
                let attributes =
                    [("variableName", *variable), ("memberName", member.as_str()), ("variableKind", "signal")];
                xml.create_element("TerminalMemberVariable").with_attributes(attributes).write_empty()?;
                Ok(())
            })
        })?;
        Ok(())
    }
}
