//! Which function may be called when: the state machines of model exchange and of co-simulation (FMI 2.0.4, sections
//! 3.2.3 and 4.2.4) as one table.

/// Why a call is refused, for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused(pub String);

impl<T: Into<String>> From<T> for Refused {
    fn from(text: T) -> Self {
        Refused(text.into())
    }
}

/// The answer to a call.
pub type Answer<T = ()> = Result<T, Refused>;

/// Which of the standard's two interfaces an instance was made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interface {
    /// The master integrates.
    ModelExchange,
    /// The unit integrates.
    CoSimulation,
}

impl Interface {
    /// As a message names it.
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
    /// After fmi2Instantiate or fmi2Reset.
    Instantiated = 0,
    /// Between fmi2EnterInitializationMode and fmi2ExitInitializationMode.
    Initialization = 1,
    /// Model exchange: at an event, or right after initialisation.
    Event = 2,
    /// Model exchange: being integrated by the master.
    ContinuousTime = 3,
    /// Co-simulation: initialised; the last step, if any, is complete.
    StepComplete = 4,
    /// Co-simulation: the last step was discarded.
    StepFailed = 5,
    /// After fmi2Terminate.
    Terminated = 6,
    /// A step or an event failed. Values are those before it.
    Error = 7,
    /// A fault of the library itself: nothing can be relied on.
    Poisoned = 8,
}

impl Phase {
    /// All phases, by number.
    pub const ALL: [Phase; 9] = [
        Phase::Instantiated,
        Phase::Initialization,
        Phase::Event,
        Phase::ContinuousTime,
        Phase::StepComplete,
        Phase::StepFailed,
        Phase::Terminated,
        Phase::Error,
        Phase::Poisoned,
    ];

    /// True if an instance of this interface may be saved in it.
    pub fn is_of(self, interface: Interface) -> bool {
        match self {
            Phase::Event | Phase::ContinuousTime => interface == Interface::ModelExchange,
            Phase::StepComplete | Phase::StepFailed => interface == Interface::CoSimulation,
            Phase::Poisoned => false,
            _ => true,
        }
    }

    const fn bit(self) -> u16 {
        1 << self as u8
    }

    /// As a message names it.
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
/// Every phase but the poisoned one.
const ANY: u16 = I | M | V | C | S | F | T | E;

macro_rules! call_table {
    ($($function:ident: $model_exchange:expr, $co_simulation:expr;)*) => {
        /// The functions that take an instance, but for fmi2FreeInstance, which is always allowed.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
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

        /// Where each function is allowed, in model exchange and in co-simulation.
        const ALLOWED: &[[u16; 2]] = &[$([$model_exchange, $co_simulation],)*];
    };
}

call_table! {
    // Function                     in model exchange   in co-simulation
    SetDebugLogging:               ANY,                ANY;
    SetupExperiment:               I,                  I;
    EnterInitializationMode:       I,                  I;
    ExitInitializationMode:        M,                  M;
    // In error too: masters that are refused there free an instance twice.
    Terminate:                     V | C | E,          S | F | E;
    Reset:                         ANY,                ANY;
    GetReal:                       M | V | C | T | E,  M | S | F | T | E;
    GetInteger:                    M | V | C | T | E,  M | S | F | T | E;
    GetBoolean:                    M | V | C | T | E,  M | S | F | T | E;
    GetString:                     M | V | C | T | E,  M | S | F | T | E;
    SetReal:                       I | M | V | C,      I | M | S;
    // Inputs in Continuous-Time Mode too, where masters set all of them; a change waits for the next event.
    SetInteger:                    I | M | V | C,      I | M | S;
    SetBoolean:                    I | M | V | C,      I | M | S;
    SetString:                     I | M | V,          I | M | S;
    GetFMUstate:                   ANY,                ANY;
    SetFMUstate:                   ANY,                ANY;
    FreeFMUstate:                  ANY,                ANY;
    SerializedFMUstateSize:        ANY,                ANY;
    SerializeFMUstate:             ANY,                ANY;
    DeSerializeFMUstate:           ANY,                ANY;
    GetDirectionalDerivative:      M | V | C | T | E,  M | S | F | T | E;
    SetRealInputDerivatives:       0,                  I | M | S;
    GetRealOutputDerivatives:      0,                  S | F | T | E;
    DoStep:                        0,                  S;
    CancelStep:                    0,                  0;
    GetStatus:                     0,                  S | F | T | E;
    GetRealStatus:                 0,                  S | F | T | E;
    GetIntegerStatus:              0,                  S | F | T | E;
    GetBooleanStatus:              0,                  S | F | T | E;
    GetStringStatus:               0,                  S | F | T | E;
    EnterEventMode:                V | C,              0;
    NewDiscreteStates:             V,                  0;
    EnterContinuousTimeMode:       V,                  0;
    CompletedIntegratorStep:       C,                  0;
    SetTime:                       V | C,              0;
    SetContinuousStates:           C,                  0;
    GetDerivatives:                V | C | T | E,      0;
    GetEventIndicators:            M | V | C | T | E,  0;
    GetContinuousStates:           M | V | C | T | E,  0;
    GetNominalsOfContinuousStates: I | V | C | T | E,  0;
}

impl Function {
    fn phases(self, interface: Interface) -> u16 {
        ALLOWED[self as usize][interface as usize]
    }

    /// True if an instance may call it in a phase.
    pub fn allowed_in(self, interface: Interface, phase: Phase) -> bool {
        self.phases(interface) & phase.bit() != 0
    }

    /// Why an instance may not call it in a phase.
    pub fn refusal(self, interface: Interface, phase: Phase) -> String {
        let name = self.name();
        if self == Function::CancelStep && interface == Interface::CoSimulation {
            return format!("{name}: steps are never asynchronous, so there is none to cancel");
        }
        if self.phases(interface) == 0 {
            let (own, other) = (interface.describe(), interface.other().describe());
            return format!("{name} belongs to {other}; this is a {own} instance");
        }
        let allowed: Vec<_> =
            Phase::ALL.into_iter().filter(|&phase| self.allowed_in(interface, phase)).map(Phase::describe).collect();
        format!(
            "{name} is not allowed while the instance is {}; it is when {}",
            phase.describe(),
            allowed.join(", or ")
        )
    }
}
