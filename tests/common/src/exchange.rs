//! A master of model exchange.

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::system::{Kind, NoStructure, Registry, System};
use adaptive_fmu_library::fmi2_functions::*;

use super::{OK, Unit, description};

/// Results of fmi2NewDiscreteStates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    pub again: bool,
    pub states_changed: bool,
    pub next: Option<f64>,
}

impl Unit {
    /// Instantiated for model exchange.
    pub fn exchange(name: &str) -> Self {
        Unit::exchange_from_text(&description(name))
    }

    /// Instantiated for model exchange from a description's text.
    pub fn exchange_from_text(text: &str) -> Self {
        Unit::made(REGISTRY, text, MODEL_EXCHANGE)
    }

    /// A system of a test's own, instantiated for model exchange, with these lines in its `[start]`.
    pub fn exchange_of<M: System<Structure = NoStructure>>(start: &str) -> Self {
        Unit::system::<M>(start, MODEL_EXCHANGE)
    }

    /// A system of a test's own, instantiated for one of the two interfaces.
    pub fn system<M: System<Structure = NoStructure>>(start: &str, kind: i32) -> Self {
        let registry: Registry = Box::leak(Box::new([Kind::of::<M>()]));
        let text = format!("name = \"Test\"\nmodel = \"{}\"\ndescription = \"\"\n[start]\n{start}\n", M::NAME);
        Unit::made(registry, &text, kind)
    }

    /// Initialised at 0 and in Continuous-Time Mode; the next time event.
    pub fn begin(&self) -> Option<f64> {
        self.start(0.0);
        self.settle()
    }

    pub fn try_new_discrete_states(&self) -> Result<Event, Status> {
        let mut info = EventInfo {
            new_discrete_states_needed: -1,
            terminate_simulation: -1,
            nominals_changed: -1,
            values_changed: -1,
            next_event_time_defined: -1,
            next_event_time: f64::NAN,
        };
        match unsafe { fmi2NewDiscreteStates(self.component, &mut info) } {
            OK => {
                assert_eq!((info.terminate_simulation, info.nominals_changed), (FALSE, FALSE));
                let next = (info.next_event_time_defined == TRUE).then_some(info.next_event_time);
                let [again, states_changed] =
                    [info.new_discrete_states_needed, info.values_changed].map(|flag| flag == TRUE);
                Ok(Event { again, states_changed, next })
            }
            status => Err(status),
        }
    }

    pub fn new_discrete_states(&self) -> Event {
        self.try_new_discrete_states().unwrap_or_else(|_| panic!("{:?}", self.messages()))
    }

    /// Updates until nothing changes any more, and goes on to Continuous-Time Mode; the next time event.
    pub fn settle(&self) -> Option<f64> {
        let mut event = self.new_discrete_states();
        while event.again {
            event = self.new_discrete_states();
        }
        assert_eq!(self.enter_continuous_time_mode(), OK, "{:?}", self.messages());
        event.next
    }

    pub fn enter_event_mode(&self) -> Status {
        unsafe { fmi2EnterEventMode(self.component) }
    }

    pub fn enter_continuous_time_mode(&self) -> Status {
        unsafe { fmi2EnterContinuousTimeMode(self.component) }
    }

    pub fn set_time(&self, time: f64) -> Status {
        unsafe { fmi2SetTime(self.component, time) }
    }

    pub fn states(&self) -> Vec<f64> {
        let mut x = vec![f64::NAN; self.model.variables().states()];
        let status = unsafe { fmi2GetContinuousStates(self.component, x.as_mut_ptr(), x.len()) };
        assert_eq!(status, OK, "{:?}", self.messages());
        x
    }

    pub fn set_states(&self, x: &[f64]) -> Status {
        unsafe { fmi2SetContinuousStates(self.component, x.as_ptr(), x.len()) }
    }

    pub fn try_derivatives(&self, dx: &mut [f64]) -> Status {
        unsafe { fmi2GetDerivatives(self.component, dx.as_mut_ptr(), dx.len()) }
    }

    pub fn derivatives(&self) -> Vec<f64> {
        let mut dx = vec![f64::NAN; self.model.variables().states()];
        assert_eq!(self.try_derivatives(&mut dx), OK, "{:?}", self.messages());
        dx
    }

    pub fn indicators(&self) -> Vec<f64> {
        let mut z = vec![f64::NAN; self.model.variables().indicators().len()];
        let status = unsafe { fmi2GetEventIndicators(self.component, z.as_mut_ptr(), z.len()) };
        assert_eq!(status, OK, "{:?}", self.messages());
        z
    }

    pub fn try_completed_step(&self, enter_event_mode: &mut Boolean) -> Status {
        unsafe { fmi2CompletedIntegratorStep(self.component, TRUE, enter_event_mode, &mut -1) }
    }

    /// Completes a step of the integrator; whether Event Mode is wanted.
    pub fn completed_step(&self) -> bool {
        let mut enter = -1;
        assert_eq!(self.try_completed_step(&mut enter), OK, "{:?}", self.messages());
        enter == TRUE
    }

    /// The states' derivatives at a time and states.
    fn slope(&self, t: f64, x: &[f64]) -> Vec<f64> {
        assert_eq!((self.set_time(t), self.set_states(x)), (OK, OK), "{:?}", self.messages());
        self.derivatives()
    }

    /// Makes one step of the classical Runge-Kutta method of order 4, without completing it.
    pub fn runge_kutta(&self, t: f64, h: f64) {
        let x = self.states();
        let moved = |k: &[f64], h: f64| x.iter().zip(k).map(|(x, k)| x + h * k).collect::<Vec<_>>();
        let k1 = self.slope(t, &x);
        let k2 = self.slope(t + 0.5 * h, &moved(&k1, 0.5 * h));
        let k3 = self.slope(t + 0.5 * h, &moved(&k2, 0.5 * h));
        let k4 = self.slope(t + h, &moved(&k3, h));
        let mean: Vec<_> = (0..x.len()).map(|i| (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0).collect();
        assert_eq!((self.set_time(t + h), self.set_states(&moved(&mean, h))), (OK, OK), "{:?}", self.messages());
    }

    /// Integrates from t to the end as a solver with root finding does, in steps of at most h: to each time event, and
    /// to just behind each change of an event indicator's sign. `next` is the time event that is known.
    pub fn integrate(&self, mut t: f64, end: f64, h: f64, mut next: Option<f64>) -> Option<f64> {
        while t < end {
            let target = next.map_or(end, |next| next.min(end));
            let whole = h.min(target - t);
            let (start, before) = (self.states(), self.indicators());
            let arrive = |part: f64| {
                assert_eq!(self.set_states(&start), OK);
                self.runge_kutta(t, part);
                self.indicators().iter().zip(&before).any(|(after, before)| after * before < 0.0)
            };
            let mut length = whole;
            if arrive(whole) {
                let mut low = 0.0;
                while length - low > 1e-13 {
                    let middle = 0.5 * (low + length);
                    if arrive(middle) { length = middle } else { low = middle }
                }
                arrive(length);
            }
            t = if length == target - t { target } else { t + length };
            assert_eq!(self.set_time(t), OK);
            if self.completed_step() || length < whole || next == Some(t) {
                assert_eq!(self.enter_event_mode(), OK);
                next = self.settle();
            }
        }
        next
    }
}
