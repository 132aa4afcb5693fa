//! A linear plant by its matrices.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;
use serde::Deserialize;

use super::dead_time::DeadTime;
use super::template::write_sizes;
use crate::catalogue::{Catalogued, Demonstration, Scale, Stimulus};
use crate::mathematics::limits::{self, UNLIMITED, within};
use crate::mathematics::matrices::{resized, rows};
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Input, Invalid, MatrixOf, Parameter, Point, Prepared, Rates, Scalar, Signal, Signals, Size, State,
    System, Unit, Values, VectorOf, matrix, of_outputs, quantities, vector,
};
use crate::template::{
    self, Begun, Request, Sizes, Template, all, named, write_limits, write_names, write_quantities, write_units,
};

/// Largest number of states, of inputs and of outputs.
const MOST: usize = 200;

/// Derivatives of the outputs, by their names.
const NAMES: [(&str, &str); 2] = [("dy", "rate"), ("ddy", "second derivative")];
/// C Aᵏ B below this part of its terms counts as 0.
const NEGLIGIBLE: f64 = 1e-9;

/// The matrices of a plant.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StateSpaceStructure {
    /// State matrix, n rows of n numbers; n at most 200.
    A: Vec<Vec<f64>>,
    /// Input matrix, n rows of m numbers.
    B: Vec<Vec<f64>>,
    /// Output matrix, p rows of n numbers.
    C: Vec<Vec<f64>>,
    /// Feedthrough matrix, p rows of m numbers; none where it isn't given.
    D: Option<Vec<Vec<f64>>>,
    /// Dead time of each input, s; none where it isn't given.
    delay: Option<Vec<f64>>,
    /// Derivatives of the outputs that are outputs too, 0 … 2: as far as they have no feedthrough.
    #[serde(default)]
    #[schemars(range(max = 2))]
    output_derivatives: usize,
    /// Units of the signals.
    #[serde(default)]
    units: StateSpaceUnits,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: StateSpaceQuantities,
}

/// Quantities of the signals, an element each; descriptions count elements where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct StateSpaceQuantities {
    /// Quantities of the states.
    x: Vec<String>,
    /// Quantities of the inputs.
    u: Vec<String>,
    /// Quantities of the outputs; if none are given, those of the states that C selects.
    y: Vec<String>,
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct StateSpaceUnits {
    /// Units of the states.
    x: Vec<String>,
    /// Units of the inputs.
    u: Vec<String>,
    /// Units of the outputs.
    y: Vec<String>,
}

/// A derivative of the outputs, C Aᵏ (x − x_op), where C A^(k−1) B = 0.
#[derive(Debug)]
struct OutputRate {
    CA: MatrixOf<Prepared>,
    dy: VectorOf<Signal>,
}

/// x' = A (x − x_op) + B w, y = y_op + C (x − x_op) + D w with w = u within its limits, after its dead time, + d − u_op.
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
    rates: Vec<OutputRate>,
    u_acting: VectorOf<Signal>,
    dead_time: Option<DeadTime>,
    /// w
    w: VectorOf<Signal>,
}

impl System for StateSpace {
    type Structure = StateSpaceStructure;
    const NAME: &'static str = "state-space";
    const DOCUMENTATION: &'static str = pages::STATE_SPACE.text;

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
        let of_x = quantities("x", &structure.quantities.x, n)?;
        let of_u = quantities("u", &structure.quantities.u, m)?;
        let of_y = match &structure.quantities.y[..] {
            [] => of_outputs(&C, &of_x),
            given => quantities("y", given, p)?,
        };
        let state = |name: &str, behind: &str| {
            vector(name, n, &format!("state{behind}")).about(&of_x, &format!("{{}}{behind}")).units(&x)
        };
        let input = |name: &str, text: &str, about: &str| vector(name, m, text).about(&of_u, about).units(&u);
        let output = |name: &str, behind: &str| {
            vector(name, p, &format!("output{behind}")).about(&of_y, &format!("output, {{}}{behind}")).units(&y)
        };
        let derivatives = structure.output_derivatives;
        if derivatives > NAMES.len() {
            return Err(Invalid::new("output_derivatives", derivatives, format!("must be within 0 … {}", NAMES.len())));
        }
        let mut units_of_rates = y.clone();
        let rates = NAMES.iter().take(derivatives).map(|&(name, order)| {
            units_of_rates = units_of_rates.iter().map(|unit| Unit::per_second(unit)).collect();
            let spec = vector(name, p, &format!("{order} of the output"));
            let spec = spec.about(&of_y, &format!("{order} of the output, {{}}")).units(&units_of_rates);
            (matrix(&format!("#{name} of x"), p, n, "").hidden(), spec)
        });
        let rates: Vec<_> = rates.map(|(CA, dy)| OutputRate { CA: d.prepared(CA), dy: d.output(dy) }).collect();
        let dead_time = structure.delay.as_deref().map(|delay| DeadTime::declare(d, delay, &of_u, &u)).transpose()?;
        // Two an input: at its limits.
        d.indicators(std::iter::repeat_n("", 2 * m));
        Ok(StateSpace {
            A: d.parameter(given("A", &A, "state matrix")),
            B: d.parameter(given("B", &B, "input matrix")),
            C: d.parameter(given("C", &C, "output matrix")),
            D: D.map(|D| d.parameter(given("D", &D, "feedthrough from the input to the output"))),
            x0: d.parameter(state("x0", " at the start").fixed()),
            x_op: d.parameter(state("x_op", " at the operating point")),
            u_op: d.parameter(input("u_op", "input at the operating point", "{} at the operating point")),
            y_op: d.parameter(output("y_op", " at the operating point")),
            u_min: d.parameter(input("u_min", "smallest input that acts", "smallest {} that acts").no_lower_limit()),
            u_max: d.parameter(input("u_max", "largest input that acts", "largest {} that acts").no_upper_limit()),
            u: d.input(input("u", "input", "input, {}")),
            d: d.input(input(
                "d",
                "disturbance that enters where the input does",
                "disturbance that enters where the {} does",
            )),
            x: d.state(state("x", "").output()),
            y: d.output(output("y", "")),
            u_acting: d.local(input("u_acting", "input within its limits", "{} within its limits")),
            w: d.local(vector("#w", m, "").hidden()),
            dead_time,
            rates,
        })
    }

    fn sizes(structure: &StateSpaceStructure) -> Vec<Size> {
        let columns_of_B = structure.B.first().map_or(0, Vec::len);
        let size = |name, description, value| Size { name, description, value, most: MOST };
        vec![
            size("n", "number of states", structure.A.len()),
            size("m", "number of inputs", columns_of_B),
            size("p", "number of outputs", structure.C.len()),
        ]
    }

    fn resize(structure: &mut StateSpaceStructure, sizes: &[usize]) -> toml::Table {
        let &[n, m, p] = sizes else { return toml::Table::new() };
        structure.A = resized(&structure.A, (n, n));
        structure.B = resized(&structure.B, (n, m));
        structure.C = resized(&structure.C, (p, n));
        structure.D = structure.D.take().map(|D| resized(&D, (p, m)));
        toml::Table::new()
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        if let Some(dead_time) = &self.dead_time {
            dead_time.relate(v);
        }
        self.relate_rates(v);
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
        if let Some(dead_time) = &self.dead_time {
            dead_time.start(t, |j, v| self.acting(j, v), v);
        }
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        for j in 0..self.u.len() {
            let acting = self.acting(j, v);
            let late = self.dead_time.as_ref().map_or(acting, |dead_time| dead_time.delayed(t, j, acting, v));
            y[self.u_acting.at(j)] = acting;
            y[self.w.at(j)] = late + v[self.d][j] - v[self.u_op][j];
        }
        for i in 0..self.y.len() {
            let mut output = v[self.y_op][i] + self.of_state(|j| v[self.C.at(i, j)], v);
            for (j, D) in self.D.iter().flat_map(|&D| (0..self.u.len()).map(move |j| (j, D.at(i, j)))) {
                output += v[D] * y[self.w.at(j)];
            }
            y[self.y.at(i)] = output;
            for OutputRate { CA, dy } in &self.rates {
                y[dy.at(i)] = self.of_state(|j| v[CA.at(i, j)], v);
            }
        }
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        for i in 0..self.x.len() {
            let inputs = (0..self.u.len()).map(|j| v[self.B.at(i, j)] * v[self.w.at(j)]);
            dx[self.x.at(i)] = inputs.fold(self.of_state(|j| v[self.A.at(i, j)], v), |sum, part| sum + part);
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        self.dead_time.as_ref().map_or(S::from(f64::INFINITY), |dead_time| dead_time.next(v))
    }

    /// A sample of the dead times is taken where one is due; a limit changes nothing.
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        if let Some(dead_time) = &self.dead_time {
            dead_time.event(t, |j, v| self.acting(j, v), v);
        }
    }

    /// Kinks of the equations: no step leads across one.
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        for (j, z) in z.chunks_exact_mut(2).enumerate() {
            let u = v[self.u][j];
            z.copy_from_slice(&[u - v[self.u_min][j], u - v[self.u_max][j]]);
        }
    }
}

impl StateSpace {
    /// An input within its limits.
    fn acting<S: Scalar>(&self, j: usize, v: &Values<S>) -> S {
        within(v[self.u][j], v[self.u_min][j], v[self.u_max][j])
    }

    /// A row of a matrix times x − x_op.
    fn of_state<S: Scalar>(&self, row: impl Fn(usize) -> S, v: &Values<S>) -> S {
        let (x, x_op) = (&v[self.x], &v[self.x_op]);
        (0..x.len()).fold(S::from(0.0), |sum, j| sum + row(j) * (x[j] - x_op[j]))
    }

    /// C A, C A² as far as they are asked for; refuses an input with feedthrough to such a derivative.
    fn relate_rates<S: Scalar>(&self, v: &mut Point<S>) {
        if self.rates.is_empty() {
            return;
        }
        let (n, p, m) = (self.x.len(), self.y.len(), self.u.len());
        let mut previous: Vec<Vec<S>> = (0..p).map(|i| (0..n).map(|j| v[self.C.at(i, j)]).collect()).collect();
        for (order, rate) in self.rates.iter().enumerate() {
            for (i, row) in previous.iter_mut().enumerate() {
                for j in 0..m {
                    let parts = || (0..n).map(|k| row[k] * v[self.B.at(k, j)]);
                    let shown = parts().fold(S::from(0.0), |sum, part| sum + part).abs();
                    let size = parts().fold(S::from(0.0), |sum, part| sum + part.abs());
                    v.refuse(shown.above(size * NEGLIGIBLE), |v| {
                        let name = format!("C A^{order} B of {}", v.name(rate.dy.at(i)));
                        Invalid::new(name, shown.to_text(), "must be 0: this derivative has feedthrough from an input")
                    });
                }
                *row = (0..n).map(|j| (0..n).fold(S::from(0.0), |sum, k| sum + row[k] * v[self.A.at(k, j)])).collect();
                (0..n).for_each(|j| v[rate.CA.at(i, j)] = row[j]);
            }
        }
    }
}

impl StateSpaceStructure {
    /// A, B and C.
    ///
    /// # Errors
    /// Matrices that don't fit.
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
    Err(Invalid::new(name, given, format!("must be {} x {} to fit the other matrices", size.0, size.1)))
}

impl Catalogued for StateSpace {
    const PAGE: Page = pages::STATE_SPACE;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template,
        is_uncertain: false,
        needs: None,
        tried: &[
            Sizes::plant(1, 1),
            Sizes::plant(2, 1),
            Sizes::plant(2, 2),
            Sizes::plant(3, 1),
            Sizes::plant(5, 2),
            Sizes::plant(6, 3),
            Sizes::plant(8, 1),
        ],
    });
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "u",
        stimulus: Stimulus::Step,
        constant_inputs: &["d"],
        output: "y",
        shows_all: true,
        scale: |of, stop_time| {
            let (about, most) = (of("u_op"), of("u_max"));
            let size = if most < UNLIMITED && most > about { 0.5 * (most - about) } else { 1.0 };
            Some(Scale { about, size, duration: stop_time })
        },
        example: "",
    });
}

/// A linear plant.
fn template(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(false)?;
    let (n, m, p) = plant.sizes();
    let (stop_time, step) = template::experiment(request);
    let mut text = request.begin(&StateSpace::PAGE, stop_time, step);
    text.table("structure");
    text.comment("x' = A x + B (u + d), y = C x + D u: rows of numbers. A model with other numbers is set at [start].");
    text.set("A", template::rows(&plant.A), "");
    text.set("B", template::rows(&plant.B), "");
    text.set("C", template::rows(&plant.C), "");
    match &plant.D {
        Some(D) => text.set("D", template::rows(D), ""),
        None => text.suggest("D", template::rows(&DMatrix::zeros(p, m)), "only with feedthrough from the input to y"),
    }
    match derivatives(&plant) {
        0 => {}
        known => text.set("output_derivatives", known, "dy, ddy are outputs too, for controllers that need them"),
    }
    if !plant.delay.is_empty() {
        text.set("delay", template::list(&plant.delay), "s, dead time of each input");
    }
    write_units(&mut text, &[("x", &plant.x, n), ("u", &plant.u, m), ("y", &plant.y, p)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let outputs = template::named_outputs(&plant);
    write_names(&mut text, &[("x", named(&plant.x, "")), ("u", named(&plant.u, "")), ("y", outputs)]);
    text.table("start");
    text.set("x0", all(0.0, n), "state at the start");
    write_limits(&mut text, Some(&plant), m);
    text.suggest("x_op", all(0.0, n), "operating point about which A, B, C, D hold; also u_op, y_op");
    let known = (1..).zip(&NAMES).take(derivatives(&plant));
    write_sizes(&mut text, request, |of, bandwidth| {
        let rates = |k: i32| template::Values::List(of.y.iter().map(|y| y * bandwidth.powi(k)).collect());
        let derivatives = known.map(|(k, &(name, _))| (name, rates(k)));
        [("x", (&of.x).into()), ("y", (&of.y).into())].into_iter().chain(derivatives).collect()
    })?;
    Ok(text.finish())
}

/// Number of derivatives of the outputs without feedthrough.
fn derivatives(plant: &template::Plant) -> usize {
    let shows = |row: &DMatrix<f64>| {
        let size = row.abs() * plant.B.abs();
        (row * &plant.B).iter().zip(&size).any(|(shown, size)| shown.abs() > NEGLIGIBLE * size)
    };
    let mut rows = plant.C.clone();
    let known = (0..NAMES.len()).take_while(|_| {
        let free = plant.D.is_none() && !shows(&rows) && rows.iter().any(|&entry| entry != 0.0);
        rows = &rows * &plant.A;
        free
    });
    known.count()
}
