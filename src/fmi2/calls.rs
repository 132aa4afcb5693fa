//! Which function may be called when: the state machine of co-simulation (FMI 2.0.4, section 4.2.4) as a table.

/// The state of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// After fmi2Instantiate or fmi2Reset.
    Instantiated = 0,
    /// Between fmi2EnterInitializationMode and fmi2ExitInitializationMode.
    Initialization = 1,
    /// Initialised; the last step, if any, is complete.
    StepComplete = 2,
    /// The last step was discarded.
    StepFailed = 3,
    /// After fmi2Terminate.
    Terminated = 4,
    /// A step failed. Values are those before it.
    Error = 5,
    /// A fault of the library itself: nothing can be relied on.
    Poisoned = 6,
}

impl Phase {
    /// All phases, by number.
    pub const ALL: [Phase; 7] = [
        Phase::Instantiated,
        Phase::Initialization,
        Phase::StepComplete,
        Phase::StepFailed,
        Phase::Terminated,
        Phase::Error,
        Phase::Poisoned,
    ];

    const fn bit(self) -> u16 {
        1 << self as u8
    }

    /// As a message names it.
    pub fn describe(self) -> &'static str {
        match self {
            Phase::Instantiated => "instantiated (not yet initialised)",
            Phase::Initialization => "in Initialization Mode",
            Phase::StepComplete => "initialised, its last step complete",
            Phase::StepFailed => "after a discarded step",
            Phase::Terminated => "terminated",
            Phase::Error => "in error after a failed step; restore a state or reset it",
            Phase::Poisoned => "unusable after an internal fault; free it",
        }
    }
}

const I: u16 = Phase::Instantiated.bit();
const M: u16 = Phase::Initialization.bit();
const S: u16 = Phase::StepComplete.bit();
const F: u16 = Phase::StepFailed.bit();
const T: u16 = Phase::Terminated.bit();
const E: u16 = Phase::Error.bit();
/// Every phase but the poisoned one.
const ANY: u16 = I | M | S | F | T | E;

macro_rules! call_table {
    ($($function:ident: $phases:expr;)*) => {
        /// The functions that take an instance, but for fmi2FreeInstance, which is always allowed.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[allow(missing_docs)] // named as in the standard
        pub enum Function {
            $($function,)*
        }

        impl Function {
            /// All functions.
            pub const ALL: &'static [Function] = &[$(Function::$function,)*];

            /// Its name in the standard.
            pub fn name(self) -> &'static str {
                match self {
                    $(Function::$function => concat!("fmi2", stringify!($function)),)*
                }
            }
        }

        const ALLOWED: &[u16] = &[$($phases,)*];
    };
}

call_table! {
    SetDebugLogging:           ANY;
    SetupExperiment:           I;
    EnterInitializationMode:   I;
    ExitInitializationMode:    M;
    Terminate:                 S | F;
    Reset:                     ANY;
    GetReal:                   M | S | F | T | E;
    GetInteger:                M | S | F | T | E;
    GetBoolean:                M | S | F | T | E;
    GetString:                 M | S | F | T | E;
    SetReal:                   I | M | S;
    SetInteger:                I | M | S;
    SetBoolean:                I | M | S;
    SetString:                 I | M | S;
    GetFMUstate:               ANY;
    SetFMUstate:               ANY;
    FreeFMUstate:              ANY;
    SerializedFMUstateSize:    ANY;
    SerializeFMUstate:         ANY;
    DeSerializeFMUstate:       ANY;
    // Not in Initialization Mode: there, states follow from inputs and parameters, which this doesn't differentiate.
    GetDirectionalDerivative:  S | F | T | E;
    SetRealInputDerivatives:   I | M | S;
    GetRealOutputDerivatives:  S | F | T | E;
    DoStep:                    S;
    CancelStep:                0;
    GetStatus:                 S | F | T | E;
    GetRealStatus:             S | F | T | E;
    GetIntegerStatus:          S | F | T | E;
    GetBooleanStatus:          S | F | T | E;
    GetStringStatus:           S | F | T | E;
    EnterEventMode:            0;
    NewDiscreteStates:         0;
    EnterContinuousTimeMode:   0;
    CompletedIntegratorStep:   0;
    SetTime:                   0;
    SetContinuousStates:       0;
    GetDerivatives:            0;
    GetEventIndicators:        0;
    GetContinuousStates:       0;
    GetNominalsOfContinuousStates: 0;
}

impl Function {
    /// Whether it may be called in a phase.
    pub fn allowed_in(self, phase: Phase) -> bool {
        ALLOWED[self as usize] & phase.bit() != 0
    }

    /// Whether it belongs to model exchange alone.
    pub fn is_model_exchange(self) -> bool {
        self as usize >= Function::EnterEventMode as usize
    }

    /// Why it may not be called in a phase.
    pub fn refusal(self, phase: Phase) -> String {
        let name = self.name();
        if self.is_model_exchange() {
            return format!("{name} belongs to model exchange; this is a co-simulation instance");
        }
        if self == Function::CancelStep {
            return format!("{name}: steps are never asynchronous, so there is none to cancel");
        }
        let allowed: Vec<_> =
            Phase::ALL.into_iter().filter(|&phase| self.allowed_in(phase)).map(Phase::describe).collect();
        format!(
            "{name} is not allowed while the instance is {}; it is when {}",
            phase.describe(),
            allowed.join(", or ")
        )
    }
}
