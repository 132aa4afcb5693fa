//! A reference experiment has the exact results of its stimuli, also behind events and samples.

use std::sync::Arc;

use adaptive_fmu::model::Model;
use adaptive_fmu::reference::{EXPORT_WORK, ReferenceExperiment, Table};
use adaptive_fmu::system::*;

/// x'' = −x + u, from rest; y = x, the time that x was above a level, and x as it was sampled last.
struct Watched {
    u: ScalarOf<Input>,
    x: ScalarOf<State>,
    v: ScalarOf<State>,
    above: ScalarOf<State>,
    is_above: BooleanOf<Discrete>,
    sampled: ScalarOf<Discrete>,
    next: ScalarOf<Discrete>,
    y: ScalarOf<Signal>,
    time_above: ScalarOf<Signal>,
    last: ScalarOf<Signal>,
}

const LEVEL: f64 = 5e-4;
const PERIOD: f64 = 0.004;

impl System for Watched {
    type Structure = NoStructure;
    const NAME: &'static str = "watched";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["level"]);
        Ok(Watched {
            u: d.input(scalar("u", "force")),
            x: d.state(scalar("x", "position")),
            v: d.state(scalar("v", "velocity")),
            above: d.state(scalar("above", "time")),
            is_above: d.discrete(boolean("is_above", "true above the level")),
            sampled: d.discrete(scalar("sampled", "position at the last sample")),
            next: d.discrete(scalar("next", "time of the next sample")),
            y: d.output(scalar("y", "position")),
            time_above: d.output(scalar("time_above", "time above the level")),
            last: d.output(scalar("last", "position at the last sample")),
        })
    }
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v[self.next] = t + PERIOD;
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = v[self.x];
        y[self.time_above] = v[self.above];
        y[self.last] = v[self.sampled];
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.v];
        dx[self.v] = v[self.u] - v[self.x];
        dx[self.above] = S::select(v.get(self.is_above), S::from(1.0), S::from(0.0));
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x] - LEVEL;
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        v[self.next]
    }
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        let above = S::from(LEVEL).below(v[self.x]);
        v.put(self.is_above, above);
        let due = v[self.next].at_most(t);
        v[self.sampled] = S::select(due, v[self.x], v[self.sampled]);
        v[self.next] = S::select(due, v[self.next] + PERIOD, v[self.next]);
    }
}

/// Position and velocity at a time, in closed form from one jump of the force to the next.
fn exact(stimuli: &Table, t: f64) -> (f64, f64) {
    let (mut x, mut v) = (0.0, 0.0);
    for rows in stimuli.rows.windows(2) {
        let ([from, u], [to, _]) = ([rows[0][0], rows[0][1]], [rows[1][0], rows[1][1]]);
        let (sin, cos) = (t.min(to) - from).max(0.0).sin_cos();
        (x, v) = (u + (x - u) * cos + v * sin, (u - x) * sin + v * cos);
    }
    (x, v)
}

/// The time up to another at which x was above the level, by bisection of its crossings.
fn time_above(stimuli: &Table, t: f64) -> f64 {
    let is_above = |t: f64| exact(stimuli, t).0 > LEVEL;
    let (grid, mut total, mut from) = (2e-3, 0.0, 0.0);
    let crossing = |mut low: f64, mut high: f64| {
        let before = is_above(low);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if is_above(middle) == before { low = middle } else { high = middle }
        }
        high
    };
    while from < t {
        let to = (from + grid).min(t);
        total += match (is_above(from), is_above(to)) {
            (true, true) => to - from,
            (true, false) => crossing(from, to) - from,
            (false, true) => to - crossing(from, to),
            (false, false) => 0.0,
        };
        from = to;
    }
    total
}

#[test]
fn references_are_exact_between_jumps_behind_events_and_at_samples() {
    let model = Arc::new(Model::new::<Watched>("Watched", &toml::Table::new()).unwrap());
    let found = ReferenceExperiment::of(&model, EXPORT_WORK).unwrap();
    assert_eq!((found.stop, found.step), (1.0, 1e-3));
    assert!((1e-4..1e-2).contains(&found.tolerance), "{}", found.tolerance);
    assert_eq!(found.references.names, ["y", "time_above", "last"]);
    let stimuli = found.stimuli.unwrap();
    assert!(found.references.rows.len() > 40, "{} rows", found.references.rows.len());
    let last = found.references.rows.last().unwrap();
    assert!(last[2] > 0.01, "it was above the level for {} s", last[2]);
    for row in &found.references.rows {
        let t = row[0];
        let (x, _) = exact(&stimuli, t);
        assert!((row[1] - x).abs() < 1e-12, "x = {} at {t} s, and is {x}", row[1]);
        assert!((row[2] - time_above(&stimuli, t)).abs() < 1e-9, "{} s above at {t} s", row[2]);
        let (sampled, _) = exact(&stimuli, (t / PERIOD + 1e-9).floor() * PERIOD);
        assert!((row[3] - sampled).abs() < 1e-11, "{} was sampled at {t} s, and is {sampled}", row[3]);
    }
}

#[test]
fn the_same_model_has_the_same_references_each_time() {
    let of = || {
        let model = Arc::new(Model::new::<Watched>("Watched", &toml::Table::new()).unwrap());
        ReferenceExperiment::of(&model, EXPORT_WORK).unwrap()
    };
    assert_eq!(of(), of());
}
