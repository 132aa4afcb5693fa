//! The exported functions of a library, for every platform. They are read from the file, nothing is loaded.

use std::collections::HashSet;

use object::read::NameOrOrdinal;
use object::read::macho::{FatArch, MachOFatFile32, MachOFatFile64};
use object::{FileKind, Object};

use super::archive::Archive;
use super::findings::{At, Findings};
use super::{Interface, Interfaces};
use crate::error::Error;
use crate::fmi2::calls::Standard;

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

/// All functions of FMI 3.0. Every FMU exports all of them, whatever interfaces it has (FMI 3.0.1).
const ALL_3: [&str; 75] = [
    "fmi3GetVersion",
    "fmi3SetDebugLogging",
    "fmi3FreeInstance",
    "fmi3EnterInitializationMode",
    "fmi3ExitInitializationMode",
    "fmi3EnterEventMode",
    "fmi3Terminate",
    "fmi3Reset",
    "fmi3GetFloat32",
    "fmi3GetFloat64",
    "fmi3GetInt8",
    "fmi3GetUInt8",
    "fmi3GetInt16",
    "fmi3GetUInt16",
    "fmi3GetInt32",
    "fmi3GetUInt32",
    "fmi3GetInt64",
    "fmi3GetUInt64",
    "fmi3GetBoolean",
    "fmi3GetString",
    "fmi3GetBinary",
    "fmi3GetClock",
    "fmi3SetFloat32",
    "fmi3SetFloat64",
    "fmi3SetInt8",
    "fmi3SetUInt8",
    "fmi3SetInt16",
    "fmi3SetUInt16",
    "fmi3SetInt32",
    "fmi3SetUInt32",
    "fmi3SetInt64",
    "fmi3SetUInt64",
    "fmi3SetBoolean",
    "fmi3SetString",
    "fmi3SetBinary",
    "fmi3SetClock",
    "fmi3GetNumberOfVariableDependencies",
    "fmi3GetVariableDependencies",
    "fmi3GetFMUState",
    "fmi3SetFMUState",
    "fmi3FreeFMUState",
    "fmi3SerializedFMUStateSize",
    "fmi3SerializeFMUState",
    "fmi3DeserializeFMUState",
    "fmi3GetDirectionalDerivative",
    "fmi3GetAdjointDerivative",
    "fmi3EnterConfigurationMode",
    "fmi3ExitConfigurationMode",
    "fmi3GetIntervalDecimal",
    "fmi3GetIntervalFraction",
    "fmi3GetShiftDecimal",
    "fmi3GetShiftFraction",
    "fmi3SetIntervalDecimal",
    "fmi3SetIntervalFraction",
    "fmi3SetShiftDecimal",
    "fmi3SetShiftFraction",
    "fmi3EvaluateDiscreteStates",
    "fmi3UpdateDiscreteStates",
    "fmi3InstantiateModelExchange",
    "fmi3InstantiateCoSimulation",
    "fmi3InstantiateScheduledExecution",
    "fmi3ActivateModelPartition",
    "fmi3EnterStepMode",
    "fmi3GetOutputDerivatives",
    "fmi3DoStep",
    "fmi3EnterContinuousTimeMode",
    "fmi3CompletedIntegratorStep",
    "fmi3SetTime",
    "fmi3SetContinuousStates",
    "fmi3GetContinuousStateDerivatives",
    "fmi3GetEventIndicators",
    "fmi3GetContinuousStates",
    "fmi3GetNominalsOfContinuousStates",
    "fmi3GetNumberOfEventIndicators",
    "fmi3GetNumberOfContinuousStates",
];

/// The flag that promises the support of a function.
fn flag_of(function: &str) -> Option<&'static str> {
    match function {
        "fmi3GetFMUState" | "fmi3SetFMUState" | "fmi3FreeFMUState" => Some("canGetAndSetFMUState"),
        "fmi3SerializedFMUStateSize" | "fmi3SerializeFMUState" | "fmi3DeserializeFMUState" => {
            Some("canSerializeFMUState")
        }
        "fmi3GetDirectionalDerivative" => Some("providesDirectionalDerivatives"),
        "fmi3GetAdjointDerivative" => Some("providesAdjointDerivatives"),
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
                    let what = format!("{name} is not a shared library: {reason}");
                    findings.error(At::nowhere(), what, "2.3", "pack a shared library for that platform");
                }
            }
        }
    }
    Ok(())
}

/// The most processors of a universal library of macOS: each may take the size of the whole file.
const MOST_PROCESSORS: usize = 16;

/// The names of the exported functions of a library, for every processor it supports.
fn exported(bytes: &[u8]) -> Result<HashSet<String>, String> {
    let text = |error: object::Error| error.to_string();
    match FileKind::parse(bytes).map_err(text)? {
        FileKind::MachOFat32 => exported_by_all(MachOFatFile32::parse(bytes).map_err(text)?.arches(), bytes),
        FileKind::MachOFat64 => exported_by_all(MachOFatFile64::parse(bytes).map_err(text)?.arches(), bytes),
        _ => exported_by_one(bytes),
    }
}

fn exported_by_all(slices: &[impl FatArch], bytes: &[u8]) -> Result<HashSet<String>, String> {
    if slices.len() > MOST_PROCESSORS {
        return Err(format!("it contains code for {} processors; at most {MOST_PROCESSORS} are read", slices.len()));
    }
    let mut common: Option<HashSet<String>> = None;
    for slice in slices {
        let names = exported_by_one(slice.data(bytes).map_err(|error| error.to_string())?)?;
        match &mut common {
            Some(common) => common.retain(|name| names.contains(name)),
            None => common = Some(names),
        }
    }
    common.ok_or_else(|| "it contains code for no processor".to_owned())
}

fn exported_by_one(bytes: &[u8]) -> Result<HashSet<String>, String> {
    let library = object::File::parse(bytes).map_err(|error| error.to_string())?;
    let mut names = HashSet::new();
    for export in library.exports().map_err(|error| error.to_string())? {
        if let NameOrOrdinal::Name(name) = export.map_err(|error| error.to_string())?.name() {
            // Some systems put an underscore before the name of a C function.
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
    let (common, own): (&[&'static str], &[&'static str]) = match (findings.standard, kind) {
        (Standard::Fmi2, "ModelExchange") => (&COMMON, &EXCHANGE),
        (Standard::Fmi2, _) => (&COMMON, &CO_SIMULATION),
        (Standard::Fmi3, _) => (&ALL_3, &[]),
    };
    let section = if kind == "ModelExchange" { "3.2" } else { "4.2" };
    let lacking = |names: &[&'static str]| -> Vec<&'static str> {
        names.iter().copied().filter(|name| !functions.contains(*name)).collect()
    };
    for (names, section) in [(lacking(common), "2.1"), (lacking(own), section)] {
        let (promised, other): (Vec<_>, Vec<_>) =
            names.into_iter().partition(|name| flag_of(name).is_some_and(|flag| interface.is(flag)));
        for name in promised {
            let what =
                format!("{file} does not export {name}, although {} is true in {kind}", flag_of(name).unwrap_or(""));
            findings.error(At::line(interface.line), what, section, "export the function, or set the flag to false");
        }
        if !other.is_empty() {
            let what = format!("{file} does not export {}, which {kind} requires", other.join(", "));
            let fmi = findings.standard.prefix();
            let advice = format!("export every function of the interface; unsupported ones return {fmi}Error");
            findings.error(At::line(interface.line), what, section, advice);
        }
    }
}
