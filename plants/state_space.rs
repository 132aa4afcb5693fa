//! A linear plant by its matrices.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;
use serde::Deserialize;

use crate::control::limits::{self, UNLIMITED, within};
use crate::control::matrices::rows;
use crate::system::{
    Declaration, Input, Invalid, MatrixOf, Parameter, Point, Rates, Scalar, Signal, Signals, State, System, Unit,
    Values, VectorOf, matrix, vector,
};

/// Largest number of states, of inputs and of outputs.
const MOST: usize = 200;

/// The matrices of a plant.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StateSpaceStructure {
    /// State matrix, n rows of n numbers.
    A: Vec<Vec<f64>>,
    /// Input matrix, n rows of m numbers.
    B: Vec<Vec<f64>>,
    /// Output matrix, p rows of n numbers.
    C: Vec<Vec<f64>>,
    /// What the input shows in the output at once, p rows of m numbers; nothing where it isn't given.
    D: Option<Vec<Vec<f64>>>,
    /// Units of the signals.
    #[serde(default)]
    units: StateSpaceUnits,
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
struct StateSpaceUnits {
    /// Of the states.
    x: Vec<String>,
    /// Of the inputs.
    u: Vec<String>,
    /// Of the outputs.
    y: Vec<String>,
}

/// x' = A (x − x_op) + B w, y = y_op + C (x − x_op) + D w with w = u within its limits + d − u_op.
#[derive(Debug)]
pub struct StateSpace {
    A: MatrixOf<Parameter>,
    B: MatrixOf<Parameter>,
    C: MatrixOf<Parameter>,
    D: Option<MatrixOf<Parameter>>,
    x0: VectorOf<Parameter>,
    x_op: VectorOf<Parameter>,
    u_op: VectorOf<Parameter>,
    y_op: VectorOf<Parameter>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    u: VectorOf<Input>,
    d: VectorOf<Input>,
    x: VectorOf<State>,
    y: VectorOf<Signal>,
    u_acting: VectorOf<Signal>,
    /// w
    w: VectorOf<Signal>,
}

impl System for StateSpace {
    type Structure = StateSpaceStructure;
    const NAME: &'static str = "state-space";
    const DOCUMENTATION: &'static str = include_str!("../docs/plants/state_space.md");

    /// Two an input: at its limits.
    fn indicators(&self) -> usize {
        2 * self.u.len()
    }

    fn declare(structure: StateSpaceStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let [A, B, C] = structure.matrices()?;
        let ((n, m), p) = (B.shape(), C.nrows());
        let D = structure.D.as_ref().map(|D| sized("D", D, (p, m))).transpose()?;
        let x = Unit::symbols("x", &structure.units.x, n)?;
        let u = Unit::symbols("u", &structure.units.u, m)?;
        let y = Unit::symbols("y", &structure.units.y, p)?;
        let given = |name: &str, given: &DMatrix<f64>, text: &str| {
            matrix(name, given.nrows(), given.ncols(), text).starts(given.as_slice())
        };
        let limit = "input that acts; 1e15 is no limit";
        let plant = StateSpace {
            A: d.parameter(given("A", &A, "state matrix")),
            B: d.parameter(given("B", &B, "input matrix")),
            C: d.parameter(given("C", &C, "output matrix")),
            D: D.map(|D| d.parameter(given("D", &D, "what the input shows in the output at once"))),
            x0: d.parameter(vector("x0", n, "state at the start").units(&x).fixed()),
            x_op: d.parameter(vector("x_op", n, "state at the operating point").units(&x)),
            u_op: d.parameter(vector("u_op", m, "input at the operating point").units(&u)),
            y_op: d.parameter(vector("y_op", p, "output at the operating point").units(&y)),
            u_min: d.parameter(vector("u_min", m, &format!("smallest {limit}")).start(-UNLIMITED).units(&u)),
            u_max: d.parameter(vector("u_max", m, &format!("largest {limit}")).start(UNLIMITED).units(&u)),
            u: d.input(vector("u", m, "input").units(&u)),
            d: d.input(vector("d", m, "disturbance that enters where the input does").units(&u)),
            x: d.state(vector("x", n, "state").units(&x).output()),
            y: d.output(vector("y", p, "output").units(&y)),
            u_acting: d.local(vector("u_acting", m, "input within its limits").units(&u)),
            w: d.local(vector("#w", m, "").hidden()),
        };
        d.depends(plant.u_acting, &[&plant.u]);
        d.depends(plant.w, &[&plant.u, &plant.d]);
        d.depends(plant.x.rate(), &[&plant.x, &plant.u, &plant.d]);
        match plant.D {
            Some(_) => d.depends(plant.y, &[&plant.x, &plant.u, &plant.d]),
            None => d.depends(plant.y, &[&plant.x]),
        }
        Ok(plant)
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        limits::check(&v[self.u_min], &v[self.u_max]).into_result()
    }

    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        v.copy(self.x0, self.x);
        Ok(())
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for j in 0..self.u.len() {
            y[self.u_acting.at(j)] = within(v[self.u][j], v[self.u_min][j], v[self.u_max][j]);
            y[self.w.at(j)] = y[self.u_acting.at(j)] + v[self.d][j] - v[self.u_op][j];
        }
        for i in 0..self.y.len() {
            let mut output = v[self.y_op][i] + self.of_state(self.C, i, v);
            for (j, D) in self.D.iter().flat_map(|&D| (0..self.u.len()).map(move |j| (j, D.at(i, j)))) {
                output += v[D] * y[self.w.at(j)];
            }
            y[self.y.at(i)] = output;
        }
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        for i in 0..self.x.len() {
            let inputs = (0..self.u.len()).map(|j| v[self.B.at(i, j)] * v[self.w.at(j)]);
            dx[self.x.at(i)] = inputs.fold(self.of_state(self.A, i, v), |sum, part| sum + part);
        }
    }

    /// Kinks of the equations: no step leads across one.
    fn event_indicators(&self, _t: f64, v: &Values<f64>, z: &mut [f64]) {
        for (j, z) in z.chunks_exact_mut(2).enumerate() {
            let u = v[self.u][j];
            z.copy_from_slice(&[u - v[self.u_min][j], u - v[self.u_max][j]]);
        }
    }
}

impl StateSpace {
    /// Row i of a matrix times x − x_op.
    fn of_state<S: Scalar>(&self, matrix: MatrixOf<Parameter>, i: usize, v: &Values<S>) -> S {
        let (x, x_op) = (&v[self.x], &v[self.x_op]);
        (0..x.len()).fold(S::from(0.0), |sum, j| sum + v[matrix.at(i, j)] * (x[j] - x_op[j]))
    }
}

impl StateSpaceStructure {
    /// A, B and C.
    ///
    /// # Errors
    /// What doesn't fit.
    fn matrices(&self) -> Result<[DMatrix<f64>; 3], Invalid> {
        let (A, B, C) = (rows("A", &self.A)?, rows("B", &self.B)?, rows("C", &self.C)?);
        let n = A.nrows();
        for (name, size) in [("rows of A", n), ("columns of B", B.ncols()), ("rows of C", C.nrows())] {
            if size > MOST {
                return Err(Invalid::new(name, size, format!("must be within 1 … {MOST}")));
            }
        }
        fit("A", &A, (n, n))?;
        fit("B", &B, (n, B.ncols()))?;
        fit("C", &C, (C.nrows(), n))?;
        Ok([A, B, C])
    }
}

fn sized(name: &str, given: &[Vec<f64>], size: (usize, usize)) -> Result<DMatrix<f64>, Invalid> {
    let matrix = rows(name, given)?;
    fit(name, &matrix, size)?;
    Ok(matrix)
}

fn fit(name: &str, matrix: &DMatrix<f64>, size: (usize, usize)) -> Result<(), Invalid> {
    if matrix.shape() == size {
        return Ok(());
    }
    let given = format!("{} x {}", matrix.nrows(), matrix.ncols());
    Err(Invalid::new(name, given, format!("must be {} x {}, as the other matrices have it", size.0, size.1)))
}
