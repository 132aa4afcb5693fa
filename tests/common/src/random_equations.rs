//! A system of random equations: what is right for any of them doesn't hang on what the models of this package happen to have.

use adaptive_fmu::recording::Opaque;
use adaptive_fmu::system::*;

/// Equations of random operations, drawn by the number: outputs, rates, events and what the end of a step does.
pub struct RandomEquations<const NUMBER: u64> {
    parameters: VectorOf<Parameter>,
    inputs: VectorOf<Input>,
    states: VectorOf<State>,
    discrete: VectorOf<Discrete>,
    outputs: VectorOf<Signal>,
}

const STATES: usize = 4;

/// A small generator of whole numbers.
struct Whole(u64);

impl Whole {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end
    }
}

/// The last of 40 expressions, each a random operation on random earlier ones. Constants that simplify are frequent; no operation is
/// so steep that differences can't follow it.
fn expressions<S: Scalar, const N: usize>(given: Vec<S>, number: u64) -> [S; N] {
    let (mut random, mut of) = (Whole(number), given);
    for _ in 0..40 {
        // Those that were made last are likelier, so that expressions get deep.
        let near = of.len() - of.len().min(8);
        let mut one = || {
            let from = if random.below(3) == 0 { 0 } else { near };
            of[from + random.below(of.len() - from)]
        };
        let operands = [one(), one(), one(), one()];
        let constant = [0.0, 1.0, -1.0, 0.5, 2.0, -0.7][random.below(6)];
        let next = operation(&mut random, operands, constant);
        of.push(next);
    }
    let behind = of.len() - N;
    std::array::from_fn(|k| of[behind + k])
}

fn operation<S: Scalar>(random: &mut Whole, [a, b, c, d]: [S; 4], number: f64) -> S {
    let constant = S::from(number);
    let ordered = a.below(c);
    let flag = [ordered, !ordered, ordered & b.at_most(d), ordered | !b.at_most(d), !(a.equals(b) & d.at_most(c))];
    let flag = flag[random.below(flag.len())];
    match random.below(22) {
        0 => a + b,
        1 | 2 => a - b,
        3 => (a * b).tanh(),
        4 => a / (b * b + 1.0),
        5 => a + constant,
        6 => constant - a,
        7 => (a * constant).sin(),
        8 => a / S::from(if number == 0.0 { 3.0 } else { number }),
        9 => -a,
        10 => (a + a) * 0.5 - b,
        11 => (a + b) * 0.5,
        12 => S::select(flag, a, b),
        13 => S::branch(flag, || (a.abs() + 0.5).sqrt() * b.cos() + a, || a * 0.3 - b.atan()),
        14 => a * constant,
        15 => a - -b,
        16 => S::select(a.below(c), S::select(!a.below(c), d, b), S::select(a.below(c), b, constant)),
        17 => newton(a, b),
        // Their arguments are whole numbers; derivatives of them are zero.
        18 => S::opaque(Opaque::Noise, &[S::from(3.0), S::from(1.0), (a * 4.0).floor()]) * 0.1 + b,
        19 => S::opaque(Opaque::Uniform, &[S::from(-5.0), S::from(7.0), (a * 2.0).floor()]) - b,
        20 => a.tanh() * b.tanh() * c.tanh() - d,
        _ => constant * a + b,
    }
}

/// The root of y³ + y = a by Newton's method, and what a second state sums on the way.
fn newton<S: Scalar>(a: S, b: S) -> S {
    let mut state = [a * 0.3, b * 0.1, S::from(0.0)];
    let goes_on = |state: &[S]| state[2].below(S::from(6.0));
    S::iterate(&mut state, 30, goes_on, |state| {
        state[0] -= (state[0] * state[0] * state[0] + state[0] - a) / (state[0] * state[0] * 3.0 + 1.0);
        state[1] = state[1] * 0.5 + state[0] * 0.1;
        state[2] += 1.0;
    });
    state[0] + state[1]
}

impl<const NUMBER: u64> RandomEquations<NUMBER> {
    fn given<S: Scalar>(&self, t: Option<S>, v: &Values<S>) -> Vec<S> {
        let vectors = [&v[self.states], &v[self.inputs], &v[self.parameters], &v[self.discrete]];
        vectors.into_iter().flatten().copied().chain(t).collect()
    }

    const fn seed(part: u64) -> u64 {
        NUMBER.wrapping_mul(977).wrapping_add(part * 1_000_003)
    }
}

impl<const NUMBER: u64> System for RandomEquations<NUMBER> {
    type Structure = NoStructure;
    const NAME: &'static str = "random-equations";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["first", "second"]);
        Ok(RandomEquations {
            parameters: d.parameter(vector("p", 3, "parameters").start(0.4)),
            inputs: d.input(vector("u", 2, "inputs").start(0.7)),
            states: d.state(vector("x", STATES, "states").start(-0.6)),
            discrete: d.discrete(vector("d", 2, "discrete values").start(0.2)),
            outputs: d.output(vector("y", 5, "outputs")),
        })
    }
    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        y.set(self.outputs, expressions::<S, 5>(self.given(Some(t), v), Self::seed(1)));
    }
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx.set(self.states, expressions::<S, STATES>(self.given(Some(t), v), Self::seed(2)));
    }
    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        z.copy_from_slice(&expressions::<S, 2>(self.given(Some(t), v), Self::seed(3)));
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        let [time, other] = expressions::<S, 2>(self.given(None, v), Self::seed(4));
        S::select(other.below(time), time, S::from(f64::INFINITY))
    }
    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        let [d, x, both] = expressions::<S, 3>(self.given(Some(t), &v.values()), Self::seed(5));
        v.when(crossed[0], |v| v[self.discrete.at(0)] = d);
        v.when(crossed[1] & !crossed[0], |v| v[self.states.at(1)] = x);
        v.when(crossed[0] | crossed[1], |v| v[self.discrete.at(1)] = both);
    }
    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let [d] = expressions::<S, 1>(self.given(Some(t), &v.values()), Self::seed(6));
        v[self.discrete.at(0)] = d * step;
    }
}
