//! sources/buildDescription.xml of FMI 3.0 (FMI 3.0.2, section 2.5.1): how C sources are compiled.

use quick_xml::events::{BytesDecl, Event};

use crate::fmi2::model_description::{SOURCE, element, empty, text};

/// The whole file, for a unit of this name.
pub fn xml(name: &str) -> String {
    let attribute = |name, value: &str| (name, value.to_owned());
    // Importers may define a name whatever its use: one without a value changes nothing.
    let prefix = vec![
        attribute("name", "FMI3_FUNCTION_PREFIX"),
        attribute("optional", "true"),
        attribute("value", ""),
        attribute("description", "prefix of all functions, for several FMUs in one program; none in a shared library"),
    ];
    let configuration = vec![
        attribute("modelIdentifier", name),
        attribute("description", "C99. Link with the mathematical library where it isn't part of the C library."),
    ];
    text(|xml| {
        xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        element(xml, "fmiBuildDescription", vec![attribute("fmiVersion", "3.0")], |xml| {
            element(xml, "BuildConfiguration", configuration.clone(), |xml| {
                element(xml, "SourceFileSet", vec![attribute("language", "C99")], |xml| {
                    empty(xml, "SourceFile", vec![attribute("name", SOURCE)])?;
                    empty(xml, "PreprocessorDefinition", prefix.clone())?;
                    empty(xml, "IncludeDirectory", vec![attribute("name", ".")])
                })
            })
        })
    })
}
