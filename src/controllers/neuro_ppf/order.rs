//! Known motion of the errors, by the channels' relative degree.

use crate::controllers::angles::Angles;
use crate::controllers::funnel::Inside;
use crate::system::{
    Declaration, Input, MatrixOf, Parameter, Point, Rates, Scalar, State, Unit, Values, VectorOf, matrix, vector,
};

/// Definition of the errors, and their known motion.
#[derive(Debug)]
pub(super) enum Order {
    /// e = x − x_m with the reference model x_m' = A_m (x_m − r).
    First { A_m: MatrixOf<Parameter>, x_m0: VectorOf<Parameter>, x_m: VectorOf<State>, angles: Angles },
    /// e = q − r of x = (q, q').
    Second { dr: VectorOf<Input>, ddr: VectorOf<Input>, lambda: VectorOf<Parameter>, angles: Angles },
}

/// Known motion of a channel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion<S> {
    /// The error that is adapted to: ε, or ε' + λ ε.
    pub E: S,
    /// Part of E' that doesn't come from the plant.
    pub V: S,
}

impl Order {
    pub fn first(d: &mut Declaration, (units, of_r): (&[&'static str], &[String]), angles: &Angles) -> Self {
        let m = units.len();
        let start: Vec<f64> = (0..m * m).map(|k| if k % m == k / m { -1.0 } else { 0.0 }).collect();
        Order::First {
            A_m: d.parameter(matrix("A_m", m, m, "state matrix of the reference model").unit("1/s").starts(&start)),
            x_m0: d.parameter(vector("x_m0", m, "initial state of the reference model").units(units).fixed()),
            x_m: d.state(
                vector("x_m", m, "state of the reference model, which the plant is to follow")
                    .about(of_r, "{} of the reference model, which the plant is to follow")
                    .units(units),
            ),
            angles: angles.clone(),
        }
    }

    pub fn second(d: &mut Declaration, (units, of_r): (&[&'static str], &[String]), angles: &Angles) -> Self {
        let m = units.len();
        let rates: Vec<_> = units.iter().map(|unit| Unit::per_second(unit)).collect();
        let second_rates: Vec<_> = rates.iter().map(|unit| Unit::per_second(unit)).collect();
        let derivative = |name: &str, order: &str| {
            let text = format!("{order} of the reference");
            vector(name, m, &text).about(of_r, &format!("{text} of {{}}"))
        };
        Order::Second {
            dr: d.input(derivative("dr", "time derivative").units(&rates)),
            ddr: d.input(derivative("ddr", "second time derivative").units(&second_rates)),
            lambda: d.parameter(
                vector("lambda", m, "weight of the transformed error relative to its rate")
                    .unit("1/s")
                    .start(0.75)
                    .positive(),
            ),
            angles: angles.clone(),
        }
    }

    /// The error of a channel: of an angle, within half a turn.
    pub fn error<S: Scalar>(&self, i: usize, [r, x]: [VectorOf<Input>; 2], v: &Values<S>) -> S {
        match self {
            Order::First { x_m, angles, .. } => angles.difference(i, v[x][i] - v[*x_m][i]),
            Order::Second { angles, .. } => angles.difference(i, v[x][i] - v[r][i]),
        }
    }

    /// E and V of a channel, from w = e' − z ρ', z' = w/ρ.
    pub fn motion<S: Scalar>(
        &self,
        i: usize,
        inside: &Inside<S>,
        [r, x]: [VectorOf<Input>; 2],
        v: &Values<S>,
    ) -> Motion<S> {
        let Inside { performance, bounds, z, epsilon, R, .. } = *inside;
        match *self {
            Order::First { .. } => Motion { E: epsilon, V: R * (-self.model_rate(i, r, v) - z * performance.rate) },
            Order::Second { dr, ddr, lambda, .. } => {
                let (rho, rate) = (performance.rho, performance.rate);
                let w = v[x][r.len() + i] - v[dr][i] - z * rate;
                let dz = w / rho;
                let dR = (bounds.second_slope(z) * dz - R * rate) / rho;
                let known = dz * rate + z * performance.second_rate + v[ddr][i];
                Motion { E: R * w + v[lambda][i] * epsilon, V: dR * w - R * known + v[lambda][i] * R * w }
            }
        }
    }

    /// x_m' = A_m (x_m − r) of a channel; zero without a model.
    fn model_rate<S: Scalar>(&self, i: usize, r: VectorOf<Input>, v: &Values<S>) -> S {
        let Order::First { A_m, x_m, angles, .. } = self else { return S::from(0.0) };
        let away = v[*x_m].iter().zip(&v[r]).enumerate();
        let away = away.map(|(j, (&x_m, &r))| x_m - angles.nearest(j, r, x_m));
        v.matrix(*A_m).row(i).iter().zip(away).fold(S::from(0.0), |sum, (&a, away)| sum + a * away)
    }

    pub fn initialise<S: Scalar>(&self, v: &mut Point<S>) {
        if let Order::First { x_m0, x_m, .. } = *self {
            v.copy(x_m0, x_m);
        }
    }

    pub fn derivatives<S: Scalar>(&self, r: VectorOf<Input>, v: &Values<S>, dx: &mut Rates<S>) {
        if let Order::First { x_m, .. } = *self {
            (0..x_m.len()).for_each(|i| dx[x_m][i] = self.model_rate(i, r, v));
        }
    }
}
