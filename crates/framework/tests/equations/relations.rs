//! Relations of parameters and their consequences: in the design, in parts, in a recording.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::recording::{Given, Method, Note, Recording};
use adaptive_fmu::system::*;
use common::models::Run;

/// x' = −(1/T) x, with T between two bounds; a design asks for a gain below 10.
struct Bounded {
    least: ScalarOf<Parameter>,
    most: ScalarOf<Parameter>,
    time: ScalarOf<Parameter>,
    gain: ScalarOf<Parameter>,
    designed: ScalarOf<Prepared>,
    /// 1/T, times what was designed.
    rate: ScalarOf<Prepared>,
    x: ScalarOf<State>,
}

impl System for Bounded {
    type Structure = NoStructure;
    const NAME: &'static str = "bounded";
    const DOCUMENTATION: &'static str = "A lag.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Bounded {
            least: d.parameter(scalar("least", "").start(1.0)),
            most: d.parameter(scalar("most", "").start(3.0)),
            time: d.parameter(scalar("time_constant", "").start(2.0)),
            gain: d.parameter(scalar("gain", "").start(1.0)),
            designed: d.prepared(scalar("designed", "")),
            rate: d.prepared(scalar("rate", "")),
            x: d.state(scalar("x", "").output()),
        })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        v[self.designed] = 2.0 * v[self.gain];
        if v[self.gain] < 10.0 {
            Ok(())
        } else {
            Err(Invalid::new(v.name(self.gain), v[self.gain], "must be below 10"))
        }
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        v.require_below(self.least, self.time);
        v.require_at_most(self.time, self.most);
        v[self.rate] = v[self.designed] / v[self.time];
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(1.0);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx.set(self.x, [-v[self.rate] * v[self.x]]);
    }
}

static SYSTEMS: Registry = &[Kind::of::<Bounded>(), Kind::COMPOSITE];

fn model(start: &str) -> Result<Model, Invalid> {
    Model::new::<Bounded>("Bounded", &start.parse().unwrap())
}

#[test]
fn what_follows_is_computed_after_what_was_designed() {
    let run = Run::of::<Bounded>("gain = 3.0", 0.0);
    assert_eq!((run.get("designed"), run.get("rate")), (6.0, 3.0));
}

#[test]
fn relations_that_are_broken_are_reported_with_what_the_design_refuses() {
    let error = model("gain = 11.0\ntime_constant = 5.0\nleast = 5.0").unwrap_err();
    let expected = [
        "least = 5: must be below time_constant = 5",
        "time_constant = 5: must not be above most = 3",
        "gain = 11: must be below 10",
    ];
    assert_eq!(error.reasons(), expected);
    assert!(model("time_constant = 3.0").is_ok(), "a bound that is met is kept");
}

#[test]
fn a_tunable_that_breaks_a_relation_leaves_the_last_valid_ones_in_force() {
    let mut run = Run::of::<Bounded>("", 0.0);
    run.set("time_constant", 3.5);
    let error = run.0.step(0.0, 0.1).unwrap_err().to_string();
    assert!(error.contains("time_constant = 3.5: must not be above most = 3"), "{error}");
    run.set("time_constant", 2.5);
    assert!(run.0.step(0.0, 0.1).unwrap(), "parameters are taken over");
    assert_eq!(run.get("rate"), 0.8);
}

#[test]
fn parts_relate_their_own_parameters_and_are_named() {
    let whole = |start: &str| {
        let part = |name: &str| format!("{{ name = \"{name}\", model = \"bounded\", start = {{ {start} }} }}");
        let parts = format!("parts = [{}, {}]", part("a"), part("b"));
        let text = format!("name = \"Whole\"\nmodel = \"composite\"\ndescription = \"\"\n[structure]\n{parts}");
        Model::from_description(Description::read(&text).unwrap(), SYSTEMS)
    };
    let mut run = Run(Execution::new(whole("gain = 4.0").unwrap()));
    run.0.initialise().unwrap();
    assert_eq!((run.get("a.rate"), run.get("b.rate")), (4.0, 4.0));
    let error = whole("most = 1.5").unwrap_err().to_string();
    for part in ["a", "b"] {
        assert!(error.contains(&format!("{part}.time_constant = 2: must not be above {part}.most = 1.5")), "{error}");
    }
}

#[test]
fn a_recording_holds_what_follows_and_what_is_refused() {
    let model = model("").unwrap();
    let recording = Recording::of(model.system(), Method::Relate, &model.variables().layout());
    let place = |name: &str| model.variables().index(model.variables().find(name).unwrap());
    let mut reals = model.start().reals.clone();
    (reals[place("designed")], reals[place("time_constant")]) = (8.0, 4.0);
    let given = Given { time: 0.0, step: 0.0, reals: &reals, integers: &model.start().integers, crossed: &[] };
    assert_eq!(recording.carry_out(&given).0[place("rate")], 2.0);
    let values = recording.tape.values(&given);
    let refused = recording.tape.notes().iter().filter_map(|note| match note {
        Note::Refusal { condition, .. } => Some(values[condition.index()] != 0.0),
        Note::Message { .. } => None,
    });
    assert_eq!(refused.collect::<Vec<_>>(), [false, true], "4 is above 1, and above 3");
}
