//! Allowed calls: the tables of FMI 2.0.4, sections 3.2.3 and 4.2.4, with the changes of this project. Booleans and
//! integers may be set in Continuous-Time Mode, since masters do so, and an instance in error may be terminated. After
//! a failed step, only reading, rolling back, resetting, terminating and freeing are allowed.

use adaptive_fmu::fmi2::types::CO_SIMULATION;

/// Function, and the phases in which it is allowed in model exchange (Instantiated, initialization Mode, eVent mode,
/// Continuous-time mode, Terminated, Error) and in co-simulation (Instantiated, initialization Mode, Step complete,
/// step Failed, Terminated, Error).
pub const FUNCTIONS: [(&str, &str, &str); 40] = [
    ("fmi2SetDebugLogging", "IMVCTE", "IMSFTE"),
    ("fmi2SetupExperiment", "I", "I"),
    ("fmi2EnterInitializationMode", "I", "I"),
    ("fmi2ExitInitializationMode", "M", "M"),
    ("fmi2Terminate", "VCE", "SFE"),
    ("fmi2Reset", "IMVCTE", "IMSFTE"),
    ("fmi2GetReal", "MVCTE", "MSFTE"),
    ("fmi2GetInteger", "MVCTE", "MSFTE"),
    ("fmi2GetBoolean", "MVCTE", "MSFTE"),
    ("fmi2GetString", "MVCTE", "MSFTE"),
    ("fmi2SetReal", "IMVC", "IMS"),
    ("fmi2SetInteger", "IMVC", "IMS"),
    ("fmi2SetBoolean", "IMVC", "IMS"),
    ("fmi2SetString", "IMV", "IMS"),
    ("fmi2GetFMUstate", "IMVCTE", "IMSFTE"),
    ("fmi2SetFMUstate", "IMVCTE", "IMSFTE"),
    ("fmi2FreeFMUstate", "IMVCTE", "IMSFTE"),
    ("fmi2SerializedFMUstateSize", "IMVCTE", "IMSFTE"),
    ("fmi2SerializeFMUstate", "IMVCTE", "IMSFTE"),
    ("fmi2DeSerializeFMUstate", "IMVCTE", "IMSFTE"),
    ("fmi2GetDirectionalDerivative", "MVCTE", "MSFTE"),
    ("fmi2SetRealInputDerivatives", "", "IMS"),
    ("fmi2GetRealOutputDerivatives", "", "SFTE"),
    ("fmi2DoStep", "", "S"),
    ("fmi2CancelStep", "", ""),
    ("fmi2GetStatus", "", "SFTE"),
    ("fmi2GetRealStatus", "", "SFTE"),
    ("fmi2GetIntegerStatus", "", "SFTE"),
    ("fmi2GetBooleanStatus", "", "SFTE"),
    ("fmi2GetStringStatus", "", "SFTE"),
    ("fmi2EnterEventMode", "VC", ""),
    ("fmi2NewDiscreteStates", "V", ""),
    ("fmi2EnterContinuousTimeMode", "V", ""),
    ("fmi2CompletedIntegratorStep", "C", ""),
    ("fmi2SetTime", "VC", ""),
    ("fmi2SetContinuousStates", "C", ""),
    ("fmi2GetDerivatives", "VCTE", ""),
    ("fmi2GetEventIndicators", "MVCTE", ""),
    ("fmi2GetContinuousStates", "MVCTE", ""),
    ("fmi2GetNominalsOfContinuousStates", "IVCTE", ""),
];

/// The phases in which a function is allowed in one of the two interfaces.
pub fn phases(function: &str, kind: i32) -> &'static str {
    let row = FUNCTIONS.iter().find(|(name, ..)| *name == function);
    let (_, in_model_exchange, in_co_simulation) = row.unwrap_or_else(|| panic!("{function} is in no table"));
    if kind == CO_SIMULATION { in_co_simulation } else { in_model_exchange }
}
