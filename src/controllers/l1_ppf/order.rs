//! Error within the funnel, by the relative degree: the state against a reference model, or the outputs against the
//! reference.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::controllers::angles::Angles;
use crate::controllers::funnel::Inside;
use crate::controllers::l1::{Goal, Law, PlantMatrices, Symbols, add_product};
use crate::controllers::origins::Angle;
use crate::mathematics::matrices;
use crate::system::{
    Declaration, Input, Invalid, MatrixOf, Parameter, Point, Prepared, Rates, Scalar, Signal, Signals, State, Unit,
    Values, VectorOf, matrix, vector,
};

/// The least singular value of (C, C A), in parts of the largest one.
const LEAST: f64 = 1e-12;

/// Definition of the errors, and the goal of the L1 law.
#[derive(Debug)]
pub(super) enum Order {
    /// e = x − x_m with the reference model x_m' = A_m x_m + B K_g r.
    First { B: DMatrix<f64>, x_m0: VectorOf<Parameter>, x_m: VectorOf<State>, angles: Angles },
    /// e = C x − r, e' = C A x − r'.
    Second {
        C: DMatrix<f64>,
        /// C A
        CA: DMatrix<f64>,
        dr: VectorOf<Input>,
        ddr: VectorOf<Input>,
        lambda: VectorOf<Parameter>,
        /// From r and r' to the control that keeps the desired dynamics on them.
        feedforward: MatrixOf<Prepared>,
        command: VectorOf<Signal>,
        angles: Angles,
    },
}

impl Order {
    /// # Errors
    /// An output matrix that doesn't show the whole state together with its rate.
    pub fn declare(
        d: &mut Declaration,
        plant: PlantMatrices,
        units: &Symbols,
        angles: Angles,
    ) -> Result<Self, Invalid> {
        let m = plant.B.ncols();
        let A = match plant.A.as_ref() {
            Some(A) if plant.B.nrows() > m => A,
            _ => {
                let about = "{} of the reference model, which the plant is to follow";
                let text = "state of the reference model, which the plant is to follow";
                let (of_x, x) = (&units.of_x, &units.x);
                return Ok(Order::First {
                    B: plant.B,
                    x_m0: d.parameter(vector("x_m0", m, "initial state of the reference model").units(x).fixed()),
                    x_m: d.state(vector("x_m", m, text).about(of_x, about).units(x)),
                    angles,
                });
            }
        };
        let CA = &plant.C * A;
        let rates: Vec<_> = units.r.iter().map(|unit| Unit::per_second(unit)).collect();
        let second_rates: Vec<_> = rates.iter().map(|unit| Unit::per_second(unit)).collect();
        let derivative = |name: &str, order: &str| {
            let text = format!("{order} of the reference");
            vector(name, m, &text).about(&units.of_r, &format!("{text} of {{}}"))
        };
        let weight = vector("error_weight", m, "weight of the transformed error relative to its rate").unit("1/s");
        let order = Order::Second {
            dr: d.input(derivative("dr", "time derivative").units(&rates)),
            ddr: d.input(derivative("ddr", "second time derivative").units(&second_rates)),
            lambda: d.parameter(weight.start(30.0).positive()),
            feedforward: d.prepared(matrix("#feedforward", m, 2 * m, "").hidden()),
            command: d.local(vector("#command", m, "").hidden()),
            C: plant.C,
            CA,
            angles,
        };
        order.shown()?;
        Ok(order)
    }

    /// The inverse of (C, C A), by which the state follows from the outputs and their rates.
    fn shown(&self) -> Result<DMatrix<f64>, Invalid> {
        let Order::Second { C, CA, .. } = self else { return Ok(DMatrix::zeros(0, 0)) };
        let (m, n) = CA.shape();
        let mut all = C.clone().resize_vertically(2 * m, 0.0);
        all.view_mut((m, 0), (m, n)).copy_from(CA);
        matrices::inverse(&all, LEAST).map_err(|least| {
            let name = "(C, C A): least singular value in parts of the largest";
            let allowed = format!("must be above {LEAST:e}: outputs and their rates must show the whole state");
            Invalid::new(name, format!("{least:.3e}"), allowed)
        })
    }

    /// The control that keeps the desired dynamics on a reference: y'' = r'' where y = r and y' = r'.
    ///
    /// # Errors
    /// As [`Order::declare`].
    pub fn prepare(&self, law: &Law, inverse: &DMatrix<f64>, v: &mut Point) -> Result<(), Invalid> {
        let Order::Second { C, feedforward, .. } = self else { return Ok(()) };
        let A_m = law.desired_dynamics(&v.values()).into_owned();
        let at_rest = -(inverse * C * &A_m * &A_m * self.shown()?);
        v.matrix_mut(*feedforward).copy_from(&at_rest);
        Ok(())
    }

    /// Starts a reference model at its start value.
    pub fn initialise<S: Scalar>(&self, law: &Law, v: &mut Point<S>) {
        let Order::First { x_m0, x_m, .. } = *self else { return };
        for k in 0..x_m.len() {
            let start = law.counted(k, v[x_m0][k], &v.values());
            v[x_m][k] = start;
        }
    }

    /// Sets a reference model to the measured state.
    pub fn follow<S: Scalar>(&self, law: &Law, v: &mut Point<S>) {
        let Order::First { x_m, .. } = *self else { return };
        for k in 0..x_m.len() {
            let x = law.x(k, &v.values());
            v[x_m][k] = x;
        }
    }

    /// A reference model moves with the origin of an angle.
    pub fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        if let Order::First { x_m, .. } = *self {
            v[x_m][angle.state] -= by;
        }
    }

    /// The error of a channel: of an angle, within half a turn.
    pub fn error<S: Scalar>(&self, i: usize, law: &Law, [r, x]: [VectorOf<Input>; 2], v: &Values<S>) -> S {
        match self {
            Order::First { x_m, angles, .. } => angles.difference(i, law.x(i, v) - v[*x_m][i]),
            Order::Second { C, angles, .. } => angles.difference(i, row_times(C, i, v[x].iter().copied()) - v[r][i]),
        }
    }

    /// E of a channel: ε, or R w + λ ε with w = e' − z ρ'.
    pub fn driven<S: Scalar>(&self, i: usize, inside: &Inside<S>, law: &Law, v: &Values<S>) -> S {
        let Inside { performance, z, epsilon, R, .. } = *inside;
        match self {
            Order::First { .. } => epsilon,
            Order::Second { CA, dr, lambda, .. } => {
                let w = row_times(CA, i, law.state(v)) - v[*dr][i] - z * performance.rate;
                R * w + v[*lambda][i] * epsilon
            }
        }
    }

    /// Factor of the barrier's gain in the rate at which it brings an error, or its rate, back: d(R ε)/de, R².
    pub fn slope<S: Scalar>(&self, inside: &Inside<S>) -> S {
        let Inside { performance, bounds, z, epsilon, R, .. } = *inside;
        match self {
            Order::First { .. } => R * R + epsilon * bounds.second_slope(z) / (performance.rho * performance.rho),
            Order::Second { .. } => R * R,
        }
    }

    /// Goal of the L1 law.
    pub fn goal<'a, S: Scalar>(
        &self,
        law: &Law,
        r: VectorOf<Input>,
        inverse: &DMatrix<f64>,
        v: &'a Values<S>,
        y: &mut Signals<S>,
    ) -> Goal<'a, S> {
        let Order::Second { dr, ddr, feedforward, command, .. } = self else { return Goal::Reference(&v[r]) };
        y[*command].fill(S::from(0.0));
        add_product(&mut y[*command], v.matrix(*feedforward), law.references(&v[r], v).chain(v[*dr].iter().copied()));
        for i in 0..command.len() {
            let accelerated = row_times(inverse, i, v[*ddr].iter().copied());
            y[*command][i] += accelerated;
        }
        Goal::Command(*command)
    }

    /// x_m' = A_m x_m + B K_g r; while a person is in command, x_m' = A_m (x_m − x).
    pub fn derivatives<S: Scalar>(&self, law: &Law, r: VectorOf<Input>, v: &Values<S>, dx: &mut Rates<S>) {
        let Order::First { B, x_m, .. } = self else { return };
        let active = law.is_active(v);
        let followed = v[*x_m].iter().zip(law.state(v)).map(|(&x_m, x)| S::branch(active, || x_m, || x_m - x));
        dx[*x_m].fill(S::from(0.0));
        add_product(&mut dx[*x_m], law.desired_dynamics(v), followed);
        let K_g = law.reference_gain(v);
        dx.when(active, |dx| {
            for (j, direction) in B.column_iter().enumerate() {
                let row = K_g.row(j);
                let terms = row.iter().zip(law.references(&v[r], v));
                let asked = terms.fold(S::from(0.0), |sum, (&k, r)| sum + k * r);
                let moved = dx[*x_m].iter_mut().zip(direction.iter()).filter(|(_, b)| **b != 0.0);
                moved.for_each(|(rate, &b)| *rate += asked * b);
            }
        });
    }
}

/// A row of a constant matrix times a vector.
fn row_times<S: Scalar>(matrix: &DMatrix<f64>, row: usize, x: impl Iterator<Item = S>) -> S {
    let terms = matrix.row(row);
    let terms = terms.iter().zip(x).filter(|(entry, _)| **entry != 0.0);
    terms.fold(S::from(0.0), |sum, (&entry, x)| sum + x * entry)
}
