//! Functions that may be called in each phase: the state machines of model exchange and of co-simulation (FMI 2.0.4,
//! sections 3.2.3 and 4.2.4; FMI 3.0.2, sections 3.2 and 4.2) as one table.

/// Reason why a call is refused, for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused(pub String);

impl<T: Into<String>> From<T> for Refused {
    fn from(text: T) -> Self {
        Refused(text.into())
    }
}

/// The answer to a call.
pub type Answer<T = ()> = Result<T, Refused>;

pub use crate::model::Standard;

/// Interface of the standard that an instance uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interface {
    /// The master integrates.
    ModelExchange,
    /// The unit integrates.
    CoSimulation,
}

impl Interface {
    /// Name for messages.
    pub fn describe(self) -> &'static str {
        match self {
            Interface::ModelExchange => "model exchange",
            Interface::CoSimulation => "co-simulation",
        }
    }

    fn other(self) -> Interface {
        match self {
            Interface::ModelExchange => Interface::CoSimulation,
            Interface::CoSimulation => Interface::ModelExchange,
        }
    }
}

/// The state of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// State after instantiation or a reset.
    Instantiated = 0,
    /// Initialization Mode.
    Initialization = 1,
    /// Event Mode: at an event, or right after initialisation; in FMI 2.0 in model exchange only.
    Event = 2,
    /// Model exchange: being integrated by the master.
    ContinuousTime = 3,
    /// Co-simulation: initialised; the last step, if any, is complete. Step Mode in FMI 3.0.
    StepComplete = 4,
    /// Co-simulation: the last step was discarded.
    StepFailed = 5,
    /// State after the end.
    Terminated = 6,
    /// A step or an event failed. Values are those before it.
    Error = 7,
    /// A fault of the library itself: nothing can be relied on.
    Poisoned = 8,
    /// Configuration Mode of FMI 3.0, in which sizes are set.
    Configuration = 9,
}

impl Phase {
    /// All phases, by number.
    pub const ALL: [Phase; 10] = [
        Phase::Instantiated,
        Phase::Initialization,
        Phase::Event,
        Phase::ContinuousTime,
        Phase::StepComplete,
        Phase::StepFailed,
        Phase::Terminated,
        Phase::Error,
        Phase::Poisoned,
        Phase::Configuration,
    ];

    /// True if an instance of this interface may be saved in it.
    pub fn is_of(self, (standard, interface): (Standard, Interface)) -> bool {
        match self {
            Phase::Event => standard == Standard::Fmi3 || interface == Interface::ModelExchange,
            Phase::ContinuousTime => interface == Interface::ModelExchange,
            Phase::StepComplete | Phase::StepFailed => interface == Interface::CoSimulation,
            Phase::Poisoned | Phase::Configuration => false,
            _ => true,
        }
    }

    fn is_in(self, standard: Standard) -> bool {
        self != Phase::Configuration || standard == Standard::Fmi3
    }

    const fn bit(self) -> u16 {
        1 << self as u8
    }

    /// Name for messages.
    pub fn describe(self) -> &'static str {
        match self {
            Phase::Instantiated => "instantiated (not yet initialised)",
            Phase::Initialization => "in Initialization Mode",
            Phase::Event => "in Event Mode",
            Phase::ContinuousTime => "in Continuous-Time Mode",
            Phase::StepComplete => "initialised, its last step complete",
            Phase::StepFailed => "after a discarded step",
            Phase::Terminated => "terminated",
            Phase::Error => "in error after a failed step or event; restore a state or reset it, or terminate it",
            Phase::Poisoned => "unusable after an internal fault; free it",
            Phase::Configuration => "in Configuration Mode",
        }
    }
}

const I: u16 = Phase::Instantiated.bit();
const M: u16 = Phase::Initialization.bit();
const V: u16 = Phase::Event.bit();
const C: u16 = Phase::ContinuousTime.bit();
const S: u16 = Phase::StepComplete.bit();
const F: u16 = Phase::StepFailed.bit();
const T: u16 = Phase::Terminated.bit();
const E: u16 = Phase::Error.bit();
const K: u16 = Phase::Configuration.bit();
/// Every phase but the poisoned one.
const ANY: u16 = I | M | V | C | S | F | T | E | K;
/// Every one in which an instance has the sizes that it is to have.
const SET: u16 = ANY & !K;

macro_rules! name_in_3 {
    ($function:ident) => {
        concat!("fmi3", stringify!($function))
    };
    ($function:ident $name:literal) => {
        concat!("fmi3", $name)
    };
}

macro_rules! call_table {
    ($($function:ident $(($in_3:literal))?: $me_2:expr, $cs_2:expr, $me_3:expr, $cs_3:expr;)*) => {
        /// The functions that take an instance, but for those that free it, which are always allowed. Named as in FMI 2.0, where
        /// they are there.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        #[allow(missing_docs)] // named as in the standard
        pub enum Function {
            $($function,)*
        }

        impl Function {
            /// All functions.
            pub const ALL: &'static [Function] = &[$(Function::$function,)*];

            /// Its name in a standard.
            pub fn name_in(self, standard: Standard) -> &'static str {
                match (self, standard) {
                    $((Function::$function, Standard::Fmi2) => concat!("fmi2", stringify!($function)),)*
                    $((Function::$function, Standard::Fmi3) => name_in_3!($function $($in_3)?),)*
                }
            }
        }

        /// Phases in which each function is allowed: in FMI 2.0 and FMI 3.0, there in model exchange and in co-simulation.
        const ALLOWED: &[[[u16; 2]; 2]] = &[$([[$me_2, $cs_2], [$me_3, $cs_3]],)*];
    };
}

call_table! {
    // Function                                          FMI 2.0: model exchange, co-simulation; FMI 3.0: the same
    SetDebugLogging:                                  ANY,               ANY,               ANY,                   ANY;
    SetupExperiment("EnterInitializationMode"):       I,                 I,                 0,                     0;
    EnterInitializationMode:                          I,                 I,                 I,                     I;
    ExitInitializationMode:                           M,                 M,                 M,                     M;
    // In error too: masters that are refused there free an instance twice.
    Terminate:                                        V | C | E,         S | F | E,         V | C | E,             V | S | F | E;
    Reset:                                            ANY,               ANY,               ANY,                   ANY;
    GetReal("GetFloat64"):                            M | V | C | T | E, M | S | F | T | E, I | M | V | C | T | E, I | M | V | S | F | T | E;
    GetInteger("GetInt32"):                           M | V | C | T | E, M | S | F | T | E, I | M | V | C | T | E, I | M | V | S | F | T | E;
    GetBoolean:                                       M | V | C | T | E, M | S | F | T | E, I | M | V | C | T | E, I | M | V | S | F | T | E;
    GetString:                                        M | V | C | T | E, M | S | F | T | E, I | M | V | C | T | E, I | M | V | S | F | T | E;
    SetReal("SetFloat64"):                            I | M | V | C,     I | M | S,         I | M | V | C,         I | M | V | S;
    // Inputs in Continuous-Time Mode too, where masters set all of them; a change waits for the next event.
    SetInteger("SetInt32"):                           I | M | V | C,     I | M | S,         I | M | V | C,         I | M | V | S;
    SetBoolean:                                       I | M | V | C,     I | M | S,         I | M | V | C,         I | M | V | S;
    SetString:                                        I | M | V,         I | M | S,         I | M | V,             I | M | V | S;
    GetFMUstate("GetFMUState"):                       ANY,               ANY,               SET,                   SET;
    SetFMUstate("SetFMUState"):                       ANY,               ANY,               SET,                   SET;
    FreeFMUstate("FreeFMUState"):                     ANY,               ANY,               ANY,                   ANY;
    SerializedFMUstateSize("SerializedFMUStateSize"): ANY,               ANY,               ANY,                   ANY;
    SerializeFMUstate("SerializeFMUState"):           ANY,               ANY,               ANY,                   ANY;
    DeSerializeFMUstate("DeserializeFMUState"):       ANY,               ANY,               ANY,                   ANY;
    GetDirectionalDerivative:                         M | V | C | T | E, M | S | F | T | E, M | V | C | T | E,     M | V | S | F | T | E;
    SetRealInputDerivatives:                          0,                 I | M | S,         0,                     0;
    GetRealOutputDerivatives("GetOutputDerivatives"): 0,                 S | F | T | E,     0,                     S | F | T | E;
    DoStep:                                           0,                 S,                 0,                     S;
    CancelStep:                                       0,                 0,                 0,                     0;
    GetStatus:                                        0,                 S | F | T | E,     0,                     0;
    GetRealStatus:                                    0,                 S | F | T | E,     0,                     0;
    GetIntegerStatus:                                 0,                 S | F | T | E,     0,                     0;
    GetBooleanStatus:                                 0,                 S | F | T | E,     0,                     0;
    GetStringStatus:                                  0,                 S | F | T | E,     0,                     0;
    EnterEventMode:                                   V | C,             0,                 V | C,                 V | S;
    NewDiscreteStates("UpdateDiscreteStates"):        V,                 0,                 V,                     V;
    EnterContinuousTimeMode:                          V,                 0,                 V,                     0;
    CompletedIntegratorStep:                          C,                 0,                 C,                     0;
    SetTime:                                          V | C,             0,                 V | C,                 0;
    SetContinuousStates:                              C,                 0,                 C,                     0;
    GetDerivatives("GetContinuousStateDerivatives"):  V | C | T | E,     0,                 M | V | C | T | E,     0;
    GetEventIndicators:                               M | V | C | T | E, 0,                 M | V | C | T | E,     0;
    GetContinuousStates:                              M | V | C | T | E, 0,                 M | V | C | T | E,     0;
    GetNominalsOfContinuousStates:                    I | V | C | T | E, 0,                 I | M | V | C | T | E, 0;
    // Not in FMI 2.0.
    GetEnumeration("GetInt64"):                       0,                 0,                 I | M | V | C | T | E, I | M | V | S | F | T | E;
    SetEnumeration("SetInt64"):                       0,                 0,                 I | M | V | C,         I | M | V | S;
    EnterConfigurationMode:                           0,                 0,                 I,                     I;
    ExitConfigurationMode:                            0,                 0,                 K,                     K;
    GetUInt64:                                        0,                 0,                 ANY,                   ANY;
    SetUInt64:                                        0,                 0,                 K,                     K;
    EnterStepMode:                                    0,                 0,                 0,                     V;
    EvaluateDiscreteStates:                           0,                 0,                 V,                     V;
    GetAdjointDerivative:                             0,                 0,                 M | V | C | T | E,     M | V | S | F | T | E;
    GetNumberOfVariableDependencies:                  0,                 0,                 SET,                   SET;
    GetVariableDependencies:                          0,                 0,                 SET,                   SET;
    GetNumberOfEventIndicators:                       0,                 0,                 SET,                   0;
    GetNumberOfContinuousStates:                      0,                 0,                 SET,                   0;
}

impl Function {
    /// Its name in FMI 2.0.
    pub fn name(self) -> &'static str {
        self.name_in(Standard::Fmi2)
    }

    fn phases(self, (standard, interface): (Standard, Interface)) -> u16 {
        ALLOWED[self as usize][standard as usize][interface as usize]
    }

    /// True if an instance may call it in a phase.
    pub fn allowed_in(self, of: (Standard, Interface), phase: Phase) -> bool {
        self.phases(of) & phase.bit() != 0
    }

    /// Reason why an instance may not call it in a phase.
    pub fn refusal(self, of: (Standard, Interface), phase: Phase) -> String {
        let (name, interface) = (self.name_in(of.0), of.1);
        if self == Function::CancelStep && interface == Interface::CoSimulation {
            return format!("{name}: steps are never asynchronous, so there is none to cancel");
        }
        if self.phases(of) == 0 {
            let (own, other) = (interface.describe(), interface.other().describe());
            return format!("{name} belongs to {other}; this is a {own} instance");
        }
        let allowed = Phase::ALL.into_iter().filter(|&phase| self.allowed_in(of, phase) && phase.is_in(of.0));
        let allowed: Vec<_> = allowed.map(Phase::describe).collect();
        format!(
            "{name} is not allowed while the instance is {}; it is allowed when {}",
            phase.describe(),
            allowed.join(", or ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_no_mode_that_the_standard_lacks() {
        let mut named = 0;
        for function in Function::ALL {
            for interface in [Interface::CoSimulation, Interface::ModelExchange] {
                let text = |standard| function.refusal((standard, interface), Phase::Poisoned);
                assert!(!text(Standard::Fmi2).contains("Configuration Mode"), "{}", text(Standard::Fmi2));
                named += usize::from(text(Standard::Fmi3).contains("Configuration Mode"));
            }
        }
        assert!(named > 0);
    }
}
