//! The functions that a library exports, for every platform: they are read from the file, nothing is loaded.

use std::collections::HashSet;

use object::Object;
use object::read::NameOrOrdinal;

use super::archive::Archive;
use super::findings::{At, Findings};
use super::{Interface, Interfaces};
use crate::error::Error;

const COMMON: [&str; 25] = [
    "fmi2GetTypesPlatform",
    "fmi2GetVersion",
    "fmi2SetDebugLogging",
    "fmi2Instantiate",
    "fmi2FreeInstance",
    "fmi2SetupExperiment",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2Terminate",
    "fmi2Reset",
    "fmi2GetReal",
    "fmi2GetInteger",
    "fmi2GetBoolean",
    "fmi2GetString",
    "fmi2SetReal",
    "fmi2SetInteger",
    "fmi2SetBoolean",
    "fmi2SetString",
    "fmi2GetFMUstate",
    "fmi2SetFMUstate",
    "fmi2FreeFMUstate",
    "fmi2SerializedFMUstateSize",
    "fmi2SerializeFMUstate",
    "fmi2DeSerializeFMUstate",
    "fmi2GetDirectionalDerivative",
];
const EXCHANGE: [&str; 10] = [
    "fmi2EnterEventMode",
    "fmi2NewDiscreteStates",
    "fmi2EnterContinuousTimeMode",
    "fmi2CompletedIntegratorStep",
    "fmi2SetTime",
    "fmi2SetContinuousStates",
    "fmi2GetDerivatives",
    "fmi2GetEventIndicators",
    "fmi2GetContinuousStates",
    "fmi2GetNominalsOfContinuousStates",
];
const CO_SIMULATION: [&str; 9] = [
    "fmi2SetRealInputDerivatives",
    "fmi2GetRealOutputDerivatives",
    "fmi2DoStep",
    "fmi2CancelStep",
    "fmi2GetStatus",
    "fmi2GetRealStatus",
    "fmi2GetIntegerStatus",
    "fmi2GetBooleanStatus",
    "fmi2GetStringStatus",
];

/// The flag that promises what a function does.
fn flag_of(function: &str) -> Option<&'static str> {
    match function {
        "fmi2GetFMUstate" | "fmi2SetFMUstate" | "fmi2FreeFMUstate" => Some("canGetAndSetFMUstate"),
        "fmi2SerializedFMUstateSize" | "fmi2SerializeFMUstate" | "fmi2DeSerializeFMUstate" => {
            Some("canSerializeFMUstate")
        }
        "fmi2GetDirectionalDerivative" => Some("providesDirectionalDerivative"),
        _ => None,
    }
}

/// Checks every library of the archive.
///
/// # Errors
/// When one can't be read.
pub(super) fn check(archive: &Archive, interfaces: &Interfaces, findings: &mut Findings) -> Result<(), Error> {
    let identifiers: HashSet<&str> = interfaces.named().map(|(_, interface)| interface.identifier.as_str()).collect();
    for identifier in identifiers {
        for name in archive.libraries(identifier) {
            match exported(&archive.bytes(name)?) {
                Ok(functions) => {
                    for (kind, interface) in interfaces.named().filter(|(_, of)| of.identifier == identifier) {
                        check_library(name, (kind, interface), &functions, findings);
                    }
                }
                Err(reason) => {
                    let what = format!("{name} is no library: {reason}");
                    findings.error(At::nowhere(), what, "2.3", "pack a shared library for that platform");
                }
            }
        }
    }
    Ok(())
}

/// The names of the functions that a library exports.
fn exported(bytes: &[u8]) -> Result<HashSet<String>, String> {
    let library = object::File::parse(bytes).map_err(|error| error.to_string())?;
    let mut names = HashSet::new();
    for export in library.exports().map_err(|error| error.to_string())? {
        if let NameOrOrdinal::Name(name) = export.map_err(|error| error.to_string())?.name() {
            // On some systems a C function has an underscore before its name.
            let plain = name.strip_prefix(b"_").unwrap_or(name);
            names.insert(String::from_utf8_lossy(plain).into_owned());
        }
    }
    Ok(names)
}

fn check_library(
    file: &str,
    (kind, interface): (&str, &Interface),
    functions: &HashSet<String>,
    findings: &mut Findings,
) {
    let own: &[&str] = if kind == "ModelExchange" { &EXCHANGE } else { &CO_SIMULATION };
    let section = if kind == "ModelExchange" { "3.2" } else { "4.2" };
    let lacking = |names: &[&'static str]| -> Vec<&'static str> {
        names.iter().copied().filter(|name| !functions.contains(*name)).collect()
    };
    for (names, section) in [(lacking(&COMMON), "2.1"), (lacking(own), section)] {
        let (promised, other): (Vec<_>, Vec<_>) =
            names.into_iter().partition(|name| flag_of(name).is_some_and(|flag| interface.is(flag)));
        for name in promised {
            let what = format!("{file} has no {name}, and {} of {kind} says that it does", flag_of(name).unwrap_or(""));
            findings.error(At::line(interface.line), what, section, "export the function, or set the flag to false");
        }
        if !other.is_empty() {
            let what = format!("{file} has no {}, which {kind} asks for", other.join(", "));
            let advice = "export every function of the interface; what isn't supported answers fmi2Error";
            findings.error(At::line(interface.line), what, section, advice);
        }
    }
}
