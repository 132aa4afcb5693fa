//! Sizes of an L1 controller, from its description.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::controllers::angles::UNIT as OF_ANGLES;
use crate::mathematics::filter::{Filter, FilterDescription};
use crate::mathematics::matrices::rows;
use crate::system::{Invalid, Number, Scalar, Unit, of_outputs, quantities};

/// Largest number of states: beyond it, solving the Lyapunov equation takes minutes.
pub(super) const MOST_STATES: usize = 200;

/// Regressor of the estimates θ̂.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Regressor {
    /// φ(x) = x: θ̂ is m × n.
    State,
    /// φ(x) = ‖x‖∞: θ̂ is m × 1.
    InfinityNorm,
}

/// Estimated entries of the input gain ω.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputGain {
    /// All.
    Full,
    /// Those of the diagonal; the others are zero.
    Diagonal,
}

/// Place of the static state feedback −K_m x that gives the nominal plant its desired dynamics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Baseline {
    /// There is none: the plant is written in the desired dynamics already.
    #[default]
    None,
    /// Outside the adaptive control, whose estimates see u_ad only.
    Outside,
    /// Inside what the estimates see: the whole control, with K_m x as a known term.
    Inside,
}

/// Form of the desired dynamics, if a baseline brings them about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesiredDynamics {
    /// Given by their poles.
    #[default]
    Poles,
    /// Given as the matrix A_m.
    Matrix,
}

/// Quantity that the controller commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Commands {
    /// The control itself.
    #[default]
    Control,
    /// Accelerations, which the nominal inertia turns into forces or torques: the control.
    Acceleration,
}

/// The description of an L1 controller's structure.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // matrices have the names of the thesis
pub struct L1Structure {
    /// Nominal dynamics A of the plant, n rows of n numbers, where there is a baseline. Without one, these are the desired
    /// dynamics: where A_m starts.
    pub(super) A: Option<Vec<Vec<f64>>>,
    /// Input matrix B, n rows of m numbers.
    pub(super) B: Vec<Vec<f64>>,
    /// Output matrix C, m rows of n numbers: as many outputs as inputs.
    pub(super) C: Vec<Vec<f64>>,
    /// Regressor of the estimates of theta.
    pub(in crate::controllers) regressor: Regressor,
    /// Usual magnitudes of the states, n numbers: with `regressor = "state"`, theta multiplies x/state_scale. 1 where they aren't
    /// given.
    pub(super) state_scale: Option<Vec<f64>>,
    /// Estimated entries of the input gain omega.
    pub(in crate::controllers) input_gain: InputGain,
    /// Place of the static state feedback that gives the plant its desired dynamics.
    #[serde(default)]
    pub(in crate::controllers) baseline: Baseline,
    /// Form of the desired dynamics, if a baseline brings them about.
    #[serde(default)]
    pub(in crate::controllers) desired_dynamics: DesiredDynamics,
    /// Quantity that the controller commands.
    #[serde(default)]
    pub(in crate::controllers) commands: Commands,
    /// The filter D(s); 1/s where none is given.
    #[serde(default)]
    filter: FilterDescription,
    /// True if unmatched uncertainty is estimated too, along B_um.
    pub(super) unmatched: Option<bool>,
    /// Directions of unmatched uncertainty, n rows of k numbers, orthogonal to B; all that B leaves, if not given.
    pub(super) B_um: Option<Vec<Vec<f64>>>,
    /// States that are angles, counted from 1: values that differ by whole turns are the same. Their unit is rad, and each is an output.
    #[serde(default)]
    angles: Vec<usize>,
    /// Units of the signals.
    #[serde(default)]
    units: Units,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::controllers) struct Units {
    /// Units of the reference.
    r: Vec<String>,
    /// Units of the plant's state.
    x: Vec<String>,
    /// Units of the control.
    u: Vec<String>,
}

/// Quantities of the signals, an element each; descriptions count elements where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::controllers) struct Quantities {
    /// Quantities of the outputs that follow the reference; if not given, those of the states that C selects.
    r: Vec<String>,
    /// Quantities of the plant's state.
    x: Vec<String>,
    /// Quantities of the control.
    u: Vec<String>,
}

impl Units {
    /// Those of r, x and u, for n states and m inputs.
    ///
    /// # Errors
    /// A text that isn't a unit, or a wrong number of them.
    pub fn symbols(&self, (n, m): (usize, usize)) -> Result<[Vec<&'static str>; 3], Invalid> {
        let Units { r, x, u } = self;
        Ok([Unit::symbols("r", r, m)?, Unit::symbols("x", x, n)?, Unit::symbols("u", u, m)?])
    }
}

impl Quantities {
    /// Those of r, x and u, for n states and m inputs; those of r by the states that C takes, where none are given.
    ///
    /// # Errors
    /// A text that can't be a quantity, or a wrong number of them.
    #[allow(non_snake_case)]
    pub fn of_signals(&self, (n, m): (usize, usize), C: &DMatrix<f64>) -> Result<[Vec<String>; 3], Invalid> {
        let (of_x, of_u) = (quantities("x", &self.x, n)?, quantities("u", &self.u, m)?);
        let of_r = match &self.r[..] {
            [] => of_outputs(C, &of_x),
            given => quantities("r", given, m)?,
        };
        Ok([of_r, of_x, of_u])
    }
}

/// Known units and quantities of the signals.
#[derive(Debug)]
pub(in crate::controllers) struct Symbols {
    pub r: Vec<&'static str>,
    pub x: Vec<&'static str>,
    pub u: Vec<&'static str>,
    /// Units of the command: the control, or accelerations.
    pub command: Vec<&'static str>,
    /// Units of the inertia that turns accelerations into the control.
    pub inertia: Vec<&'static str>,
    /// Quantities of r, x and u, if given.
    pub of_r: Vec<String>,
    pub of_x: Vec<String>,
    pub of_u: Vec<String>,
}

/// The matrices of a structure, whose sizes fit each other.
#[derive(Debug)]
#[allow(non_snake_case)]
pub(in crate::controllers) struct PlantMatrices {
    /// Nominal dynamics, n × n, where they are given.
    pub A: Option<DMatrix<f64>>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// m × n.
    pub C: DMatrix<f64>,
    /// n × k; no columns where unmatched uncertainty isn't estimated.
    pub B_um: DMatrix<f64>,
}

impl PlantMatrices {
    /// y = C x of a channel.
    pub fn output<S: Scalar>(&self, channel: usize, x: &[S]) -> S {
        x.iter().zip(self.C.row(channel).iter()).fold(S::from(0.0), |sum, (&x, &c)| sum + x * c)
    }

    /// (B B_um): how each uncertainty moves the state.
    #[allow(non_snake_case)]
    pub fn all_directions(&self) -> DMatrix<f64> {
        let (m, k) = (self.B.ncols(), self.B_um.ncols());
        let mut all = self.B.clone().resize_horizontally(m + k, 0.0);
        all.columns_mut(m, k).copy_from(&self.B_um);
        all
    }
}

/// Keys that only an L1 controller's estimates need, with defaults for a controller without estimates. They may be
/// given there.
const OF_ESTIMATES: [(&str, &str); 2] = [("regressor", "infinity_norm"), ("input_gain", "diagonal")];

impl L1Structure {
    /// The structure of a controller without adaptation, from the same description.
    ///
    /// # Errors
    /// Descriptions that are no such structure.
    pub(in crate::controllers) fn without_estimates(mut table: toml::Table) -> Result<Self, toml::de::Error> {
        for (key, value) in OF_ESTIMATES {
            table.entry(key).or_insert_with(|| value.into());
        }
        toml::Value::Table(table).try_into()
    }

    /// The schema of that.
    pub(in crate::controllers) fn schema_without_estimates(
        generator: &mut schemars::SchemaGenerator,
    ) -> schemars::Schema {
        let mut schema = <Self as schemars::JsonSchema>::json_schema(generator);
        if let Some(required) = schema.get_mut("required").and_then(serde_json::Value::as_array_mut) {
            required.retain(|key| OF_ESTIMATES.iter().all(|(known, _)| key.as_str() != Some(known)));
        }
        schema
    }

    /// The key `angles`.
    pub(super) fn named_angles(&self) -> &[usize] {
        &self.angles
    }

    /// The same with angles that a kind knows by itself, and no others. Unless the description names them, those of another unit
    /// than an angle's aren't taken for any.
    ///
    /// # Errors
    /// Other angles in the description.
    pub(in crate::controllers) fn with_angles(mut self, known: &[usize]) -> Result<Self, Invalid> {
        if let Some(other) = self.angles.iter().find(|angle| !known.contains(angle)) {
            return Err(Invalid::new("angles", other, format!("must be {known:?}, or left out")));
        }
        if self.angles.is_empty() {
            let [_, units, _] = self.units.symbols(self.size()?)?;
            let is_angle = |&&angle: &&usize| units.get(angle - 1).is_some_and(|unit| *unit == OF_ANGLES);
            self.angles = known.iter().filter(is_angle).copied().collect();
        }
        Ok(self)
    }

    /// True if all entries of ω are estimated.
    pub(super) fn is_full(&self) -> bool {
        self.input_gain == InputGain::Full
    }

    /// 1/state_scale; empty where theta multiplies x itself.
    ///
    /// # Errors
    /// Magnitudes that are none, or another regressor.
    pub(in crate::controllers) fn regressor_gains(&self, n: usize) -> Result<Vec<f64>, Invalid> {
        let Some(scale) = &self.state_scale else { return Ok(Vec::new()) };
        if self.regressor != Regressor::State {
            let allowed = "belongs to regressor = \"state\"; leave it out with the largest element of x";
            return Err(Invalid::new("state_scale", "given", allowed));
        }
        let wrong = scale.iter().find(|&&size| !(size > 0.0 && size.is_finite() && size.recip().is_finite()));
        match wrong {
            _ if scale.len() != n => Err(Invalid::new(
                "state_scale",
                format!("{} numbers", scale.len()),
                format!("must be {n}, one a state"),
            )),
            Some(wrong) => Err(Invalid::new("state_scale", Number(*wrong), "must be finite numbers above 0")),
            None => Ok(scale.iter().map(|size| size.recip()).collect()),
        }
    }

    /// Numbers of states and of inputs.
    ///
    /// # Errors
    /// Errors in B.
    pub(in crate::controllers) fn size(&self) -> Result<(usize, usize), Invalid> {
        rows("B", &self.B).map(|B| B.shape())
    }

    /// # Errors
    /// Matrices that don't fit.
    #[allow(non_snake_case)]
    pub(in crate::controllers) fn plant(&self) -> Result<PlantMatrices, Invalid> {
        let (B, C) = input_and_output(&self.B, &self.C)?;
        let A = self.A.as_ref().map(|A| nominal_dynamics(A, &B)).transpose()?;
        if A.is_none() && self.baseline != Baseline::None {
            return Err(Invalid::because("A is missing: the baseline is designed from the nominal dynamics"));
        }
        if self.baseline == Baseline::None && self.desired_dynamics == DesiredDynamics::Matrix {
            let allowed = "requires a baseline (\"outside\" or \"inside\"); without one, A_m is always a parameter";
            return Err(Invalid::new("desired_dynamics", "\"matrix\"", allowed));
        }
        Ok(PlantMatrices { A, B_um: self.unmatched_directions(&B)?, B, C })
    }

    /// B_um: as given, or the orthogonal complement of B.
    #[allow(non_snake_case)]
    fn unmatched_directions(&self, B: &DMatrix<f64>) -> Result<DMatrix<f64>, Invalid> {
        let (n, m) = B.shape();
        let B_um = match (&self.B_um, self.unmatched) {
            (Some(_), Some(false)) => {
                return Err(Invalid::new("B_um", "given", "requires unmatched = true, but it is false"));
            }
            (None, None | Some(false)) => return Ok(DMatrix::zeros(n, 0)),
            _ if m == n => {
                let allowed = "must be false: the inputs reach every state, so nothing is unmatched";
                return Err(Invalid::new("unmatched", true, allowed));
            }
            (Some(given), _) => rows("B_um", given)?,
            (None, Some(true)) => orthogonal_complement(B),
        };
        let (rows, k) = B_um.shape();
        if rows != n || k == 0 || k > n - m {
            let allowed = format!("must have {n} rows and 1 … {} columns, because B is {n} x {m}", n - m);
            return Err(Invalid::new("B_um", format!("{rows} x {k}"), allowed));
        }
        let overlap = (B.transpose() * &B_um).amax();
        if overlap > 1e-9 * B.amax() * B_um.amax() {
            let allowed = "must be 0: uncertainty in directions that the control reaches is matched";
            return Err(Invalid::new("B' B_um: largest entry", format!("{overlap:.3e}"), allowed));
        }
        if B_um.rank(1e-9 * B_um.amax()) < k {
            return Err(Invalid::because("B_um: its columns must be linearly independent"));
        }
        Ok(B_um)
    }

    /// # Errors
    /// An unknown unit, or a wrong number of them.
    pub(in crate::controllers) fn units(&self, (n, m): (usize, usize)) -> Result<Symbols, Invalid> {
        let [r, x, u] = self.units.symbols((n, m))?;
        let commanded = |unit: &&'static str| match self.commands {
            Commands::Acceleration => of_motion(unit),
            Commands::Control => (*unit, "1"),
        };
        let (command, inertia) = u.iter().map(commanded).unzip();
        let [of_r, of_x, of_u] = self.quantities.of_signals((n, m), &rows("C", &self.C)?)?;
        Ok(Symbols { r, x, u, command, inertia, of_r, of_x, of_u })
    }

    /// # Errors
    /// Reason why it is no filter of this controller.
    pub(in crate::controllers) fn filter(&self) -> Result<Filter, Invalid> {
        Filter::new(&self.filter)
    }
}

/// B and C, n × m and m × n.
///
/// # Errors
/// Matrices that don't fit.
#[allow(non_snake_case)]
pub(in crate::controllers) fn input_and_output(
    B: &[Vec<f64>],
    C: &[Vec<f64>],
) -> Result<(DMatrix<f64>, DMatrix<f64>), Invalid> {
    let (B, C) = (rows("B", B)?, rows("C", C)?);
    let (n, m) = B.shape();
    if n > MOST_STATES || m > n {
        let allowed = format!("must have 1 … {MOST_STATES} rows, and no more columns than rows");
        return Err(Invalid::new("B", format!("{n} x {m}"), allowed));
    }
    require_size("C", &C, (m, n), &B)?;
    Ok((B, C))
}

/// True for each output if the control has feedthrough to its rate: if C B isn't 0.
#[allow(non_snake_case)]
pub(in crate::controllers) fn enters_rates(B: &DMatrix<f64>, C: &DMatrix<f64>) -> Vec<bool> {
    let least = 1e-9 * C.amax() * B.amax();
    (C * B).row_iter().map(|row| row.amax() > least).collect()
}

/// A, n × n.
///
/// # Errors
/// A matrix that doesn't fit.
#[allow(non_snake_case)]
pub(in crate::controllers) fn nominal_dynamics(A: &[Vec<f64>], B: &DMatrix<f64>) -> Result<DMatrix<f64>, Invalid> {
    let A = rows("A", A)?;
    require_size("A", &A, (B.nrows(), B.nrows()), B)?;
    Ok(A)
}

#[allow(non_snake_case)]
fn require_size(name: &str, matrix: &DMatrix<f64>, size: (usize, usize), B: &DMatrix<f64>) -> Result<(), Invalid> {
    let (rows, columns) = matrix.shape();
    if (rows, columns) == size {
        return Ok(());
    }
    let allowed = format!("must be {} x {}, because B is {} x {}", size.0, size.1, B.nrows(), B.ncols());
    Err(Invalid::new(name, format!("{rows} x {columns}"), allowed))
}

/// Units of an acceleration and of the inertia that turns it into a control of this unit.
pub(in crate::controllers) fn of_motion(control: &'static str) -> (&'static str, &'static str) {
    match control {
        "N" => ("m/s2", "kg"),
        "N.m" => ("rad/s2", "kg.m2"),
        other => (other, "1"),
    }
}

/// An orthonormal basis orthogonal to the columns of B. Unit vectors come first, in their order, so that directions of
/// a single state are preserved.
#[allow(non_snake_case)]
pub(in crate::controllers) fn orthogonal_complement(B: &DMatrix<f64>) -> DMatrix<f64> {
    let n = B.nrows();
    let mut spanned: Vec<DVector<f64>> = Vec::new();
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let orthogonal = |vector: DVector<f64>, to: &[DVector<f64>]| {
        let length = vector.norm();
        // Twice: once leaves rounding.
        let left = (0..2).fold(vector, |v, _| to.iter().fold(v, |v, other| &v - other * other.dot(&v)));
        (left.norm() > 1e-9 * length).then(|| left.normalize())
    };
    for column in B.column_iter() {
        spanned.extend(orthogonal(column.into_owned(), &spanned));
    }
    for i in 0..n {
        let unit = DVector::from_fn(n, |row, _| f64::from(u8::from(row == i)));
        if let Some(direction) = orthogonal(unit, &spanned) {
            spanned.push(direction.clone());
            basis.push(direction);
        }
    }
    DMatrix::from_columns(&basis)
}
