//! The nominal plant of a description: what a controller was designed for, and how far the real plant may be from it. It makes no
//! variables; reports on a design may read it.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use crate::error::{Invalid, Number};

/// The plant that a controller was designed for: x' = A x + B u(t − delay), y = C x.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(with = "Written"))]
#[serde(try_from = "Written")]
pub struct NominalPlant {
    /// State matrix, n × n.
    pub A: DMatrix<f64>,
    /// Input matrix, n × m.
    pub B: DMatrix<f64>,
    /// Output matrix, p × n.
    pub C: DMatrix<f64>,
    /// Dead time of each input, s; 0 where there is none.
    pub delay: Vec<f64>,
    /// Bandwidth that the design was asked for, rad/s.
    pub bandwidth: Option<f64>,
    /// Usual magnitude of the reference of each output.
    pub reference: Option<Vec<f64>>,
    /// Assumed distance of the real plant from this one.
    pub uncertainty: Uncertainty,
    /// Number of plants within the uncertainty that a design report tries.
    pub plants: usize,
    /// Seed of the random ones among them.
    pub seed: u64,
}

/// Number of plants that a description may ask for.
pub const PLANTS: std::ops::RangeInclusive<usize> = 1..=100_000;
/// Number of plants and seed where a description gives none.
pub const USUAL: (usize, u64) = (200, 1);

/// Confidence level of the region of an identified model where a description gives none.
pub const USUAL_LEVEL: f64 = 0.99;
/// Factor of that region: above 1, since plants wear and run with other loads than when they were recorded.
pub const USUAL_MARGIN: f64 = 3.0;

/// Eigenvalues of a correlation that are nearer to 0 are rounding.
const LEAST_EIGENVALUE: f64 = 1e-6;

/// A plant within the uncertainty of a nominal one, of which a loop is the worst in some respect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstPlant {
    /// Properties in which it is worst: "settling time", "overshoot", "range of" a control.
    pub respects: Vec<String>,
    /// State matrix, n rows of n numbers.
    pub A: Vec<Vec<f64>>,
    /// Input matrix, n rows of m numbers.
    pub B: Vec<Vec<f64>>,
}

/// Assumed distance of a real plant from the nominal one.
#[derive(Debug, Clone, PartialEq)]
pub enum Uncertainty {
    /// Nothing is assumed.
    Unknown,
    /// Part of each entry of A and B: 0.2 is 20 %.
    Part(f64),
    /// Largest deviation of each entry.
    Elements {
        /// Deviations of A.
        A: DMatrix<f64>,
        /// Deviations of B.
        B: DMatrix<f64>,
    },
    /// Confidence region of a model that was identified from records.
    Model(Identified),
}

/// Reference to a model that was identified from records.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// Name of its file.
    pub file: String,
    /// SHA-256 of the file, 64 hexadecimal digits.
    pub sha256: Option<String>,
    /// Confidence level, above 0 and below 1.
    pub level: Option<f64>,
    /// Factor by which the confidence region is enlarged.
    pub margin: Option<f64>,
    /// Covariance of the entries that were estimated, from the records.
    pub region: Option<Covariance>,
}

/// Covariance of some entries of A and B.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// Places of the entries: those of A by columns, then those of B.
    pub entries: Vec<usize>,
    /// Symmetric, in the order of the entries and in the units of the plant.
    pub matrix: DMatrix<f64>,
}

/// The plant that the controller was designed for. It makes no variables; the design report and the page read it.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct Written {
    /// State matrix, n rows of n numbers.
    A: Vec<Vec<f64>>,
    /// Input matrix, n rows of m numbers.
    B: Vec<Vec<f64>>,
    /// Output matrix, p rows of n numbers.
    C: Vec<Vec<f64>>,
    /// Dead time of the inputs, s: one number, or one for each input; none where it isn't given.
    delay: Option<OneOrEach>,
    /// Bandwidth that the design was asked for, rad/s.
    bandwidth: Option<f64>,
    /// Usual magnitude of the reference: one number, or one for each output.
    reference: Option<OneOrEach>,
    /// Uncertainty of each entry of A and B as a part of it: 0.2 is 20 %.
    uncertainty: Option<f64>,
    /// Largest deviation of each entry of A, n rows of n numbers; 0 where only `uncertainty_B` is given.
    uncertainty_A: Option<Vec<Vec<f64>>>,
    /// Largest deviation of each entry of B, n rows of m numbers; 0 where only `uncertainty_A` is given.
    uncertainty_B: Option<Vec<Vec<f64>>>,
    /// File of the identified model that A, B and C are from.
    model: Option<String>,
    /// SHA-256 of that file.
    sha256: Option<String>,
    /// Confidence level of its uncertainty.
    level: Option<f64>,
    /// Factor by which its confidence region is enlarged.
    margin: Option<f64>,
    /// Entries that were estimated, as ["A", 1, 2]: matrix, row and column.
    free: Option<Vec<(String, usize, usize)>>,
    /// Their covariance, by rows up to the diagonal.
    covariance: Option<Vec<Vec<f64>>>,
    /// Number of plants within the uncertainty that a design report tries; 200 where it isn't given.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 100_000)))]
    plants: Option<usize>,
    /// Seed of the random ones among them; 1 where it isn't given.
    seed: Option<u32>,
}

/// A number for all, or a list of one each.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "must be a number or a list of numbers")]
enum OneOrEach {
    /// One value for all.
    One(f64),
    /// One each.
    Each(Vec<f64>),
}

impl NominalPlant {
    /// True if an input has a dead time.
    pub fn is_delayed(&self) -> bool {
        self.delay.iter().any(|&delay| delay > 0.0)
    }
}

impl TryFrom<Written> for NominalPlant {
    type Error = Invalid;

    fn try_from(written: Written) -> Result<Self, Invalid> {
        let n = written.A.len();
        let A = matrix("A", &written.A, (Some(n), Some(n)), FINITE)?;
        let B = matrix("B", &written.B, (Some(n), None), FINITE)?;
        let C = matrix("C", &written.C, (None, Some(n)), FINITE)?;
        let (m, p) = (B.ncols(), C.nrows());
        let delay = written.delay.as_ref().map(|given| each("delay", given, (m, "input"), NOT_NEGATIVE)).transpose()?;
        let reference = written.reference.as_ref().map(|given| each("reference", given, (p, "output"), POSITIVE));
        let bandwidth = number("bandwidth", written.bandwidth, POSITIVE)?;
        let (delay, reference) = (delay.unwrap_or_else(|| vec![0.0; m]), reference.transpose()?);
        let (plants, seed) = (written.plants.unwrap_or(USUAL.0), written.seed.map_or(USUAL.1, u64::from));
        if !PLANTS.contains(&plants) {
            let allowed = format!("must be within {} … {}", PLANTS.start(), PLANTS.end());
            return Err(Invalid::new("nominal.plants", plants, allowed));
        }
        let uncertainty = Uncertainty::read(written, (n, m))?;
        Ok(NominalPlant { A, B, C, delay, bandwidth, reference, uncertainty, plants, seed })
    }
}

impl Uncertainty {
    fn read(written: Written, (n, m): (usize, usize)) -> Result<Self, Invalid> {
        let Written {
            uncertainty, uncertainty_A, uncertainty_B, model, sha256, level, margin, free, covariance, ..
        } = written;
        let by_element = uncertainty_A.is_some() || uncertainty_B.is_some();
        if [uncertainty.is_some(), by_element, model.is_some()].into_iter().filter(|&given| given).count() > 1 {
            let allowed = "give only one of uncertainty, uncertainty_A with uncertainty_B, and model";
            return Err(Invalid::because(format!("nominal: {allowed}")));
        }
        let of_model = [
            ("sha256", sha256.is_some()),
            ("level", level.is_some()),
            ("margin", margin.is_some()),
            ("free", free.is_some()),
            ("covariance", covariance.is_some()),
        ];
        if let (None, Some((key, _))) = (&model, of_model.iter().find(|(_, given)| *given)) {
            return Err(Invalid::because(format!("nominal.{key}: belongs to nominal.model, which isn't given")));
        }
        let deviation = |key: &str, given: Option<Vec<Vec<f64>>>, columns: usize| match given {
            Some(rows) => matrix(key, &rows, (Some(n), Some(columns)), NOT_NEGATIVE),
            None => Ok(DMatrix::zeros(n, columns)),
        };
        if by_element {
            let (A, B) = (deviation("uncertainty_A", uncertainty_A, n)?, deviation("uncertainty_B", uncertainty_B, m)?);
            return Ok(Uncertainty::Elements { A, B });
        }
        let Some(file) = model else {
            let part = number("uncertainty", uncertainty, PART)?;
            return Ok(part.map_or(Uncertainty::Unknown, Uncertainty::Part));
        };
        if let Some(sum) = sha256.as_ref().filter(|sum| sum.len() != 64 || !sum.bytes().all(|b| b.is_ascii_hexdigit()))
        {
            return Err(Invalid::new("nominal.sha256", sum.escape_debug(), "must be 64 hexadecimal digits"));
        }
        let (level, margin) = (number("level", level, LEVEL)?, number("margin", margin, POSITIVE)?);
        let region = match (free, covariance) {
            (None, None) => None,
            (free, covariance) => {
                Some(Covariance::read("nominal.", &free.unwrap_or_default(), &covariance.unwrap_or_default(), (n, m))?)
            }
        };
        Ok(Uncertainty::Model(Identified { file, sha256, level, margin, region }))
    }
}

impl Covariance {
    /// Reads entries, as ("A", 1, 2), and rows of their covariance up to the diagonal; `table` is the prefix of keys in
    /// errors.
    ///
    /// # Errors
    /// An entry that a plant of n states and m inputs lacks, other sizes, or numbers that are no covariance.
    pub fn read(
        table: &str,
        free: &[(String, usize, usize)],
        rows: &[Vec<f64>],
        (n, m): (usize, usize),
    ) -> Result<Self, Invalid> {
        let place = |(k, (matrix, i, j)): (usize, &(String, usize, usize))| {
            let (before, columns) = if matrix == "A" { (0, n) } else { (n * n, m) };
            if ["A", "B"].contains(&matrix.as_str()) && (1..=n).contains(i) && (1..=columns).contains(j) {
                return Ok(before + (j - 1) * n + i - 1);
            }
            let given = format!("[\"{}\", {i}, {j}]", matrix.escape_debug());
            let allowed = format!("must be [\"A\" or \"B\", row, column] of A, {n} x {n}, or of B, {n} x {m}");
            Err(Invalid::new(format!("{table}free[{}]", k + 1), given, allowed))
        };
        let entries = free.iter().enumerate().map(place).collect::<Result<Vec<_>, _>>()?;
        if let Some(k) = (1..entries.len()).find(|&k| entries[..k].contains(&entries[k])) {
            let (matrix, i, j) = &free[k];
            let given = format!("[\"{matrix}\", {i}, {j}]");
            return Err(Invalid::new(format!("{table}free[{}]", k + 1), given, "stands there twice"));
        }
        let p = entries.len();
        if rows.len() != p {
            let must = format!("must be {p} rows, one for each entry of free");
            return Err(Invalid::new(format!("{table}covariance"), format!("{} rows", rows.len()), must));
        }
        if let Some((i, row)) = rows.iter().enumerate().find(|(i, row)| row.len() != i + 1) {
            let (key, given) = (format!("{table}covariance, row {}", i + 1), format!("{} numbers", row.len()));
            return Err(Invalid::new(key, given, format!("must be {} numbers, up to the diagonal", i + 1)));
        }
        for (i, row) in rows.iter().enumerate() {
            for (j, &value) in row.iter().enumerate() {
                let most = (rows[i][i] * rows[j][j]).sqrt() * (1.0 + 1e-6);
                // Not true of NaN either.
                if !(value.is_finite() && rows[i][i] > 0.0 && value.abs() <= most) {
                    let allowed = "must be finite, above 0 on the diagonal, and elsewhere no larger than two standard errors allow";
                    let key = format!("{table}covariance[{},{}]", i + 1, j + 1);
                    return Err(Invalid::new(key, Number(value), allowed));
                }
            }
        }
        let matrix = DMatrix::from_fn(p, p, |i: usize, j: usize| rows[i.max(j)][i.min(j)]);
        let unit = DMatrix::from_fn(p, p, |i, j| matrix[(i, j)] / (rows[i][i] * rows[j][j]).sqrt());
        let least = unit.symmetric_eigenvalues().iter().copied().fold(0.0, f64::min);
        if least < -LEAST_EIGENVALUE {
            let allowed = "must be a covariance: no combination of the entries may have a variance below 0";
            return Err(Invalid::new(format!("{table}covariance"), format!("{p} x {p} numbers"), allowed));
        }
        Ok(Covariance { entries, matrix })
    }
}

/// Test of a number, and what it allows in words.
type Allowed = (fn(f64) -> bool, &'static str);

const FINITE: Allowed = (f64::is_finite, "must be a finite number");
const POSITIVE: Allowed = (|value| value > 0.0 && value.is_finite(), "must be a finite number above 0");
const NOT_NEGATIVE: Allowed = (|value| value >= 0.0 && value.is_finite(), "must be a finite number, at least 0");
const PART: Allowed = (|value| (0.0..1.0).contains(&value), "must be at least 0 and below 1; 0.2 means 20 %");
const LEVEL: Allowed = (|value| value > 0.0 && value < 1.0, "must be above 0 and below 1");

fn check(key: impl std::fmt::Display, value: f64, (allows, allowed): Allowed) -> Result<f64, Invalid> {
    if allows(value) { Ok(value) } else { Err(Invalid::new(format!("nominal.{key}"), Number(value), allowed)) }
}

fn number(key: &str, given: Option<f64>, allowed: Allowed) -> Result<Option<f64>, Invalid> {
    given.map(|value| check(key, value, allowed)).transpose()
}

/// Numbers of inputs or outputs, one each.
fn each(key: &str, given: &OneOrEach, (count, what): (usize, &str), allowed: Allowed) -> Result<Vec<f64>, Invalid> {
    let values = match given {
        OneOrEach::One(value) => vec![*value; count],
        OneOrEach::Each(values) if values.len() == count => values.clone(),
        OneOrEach::Each(values) => {
            let must = format!("must be one number, or a list of {count}: one for each {what}");
            return Err(Invalid::new(format!("nominal.{key}"), format!("{} numbers", values.len()), must));
        }
    };
    values.into_iter().map(|value| check(key, value, allowed)).collect()
}

/// A matrix of as many rows and columns as are known.
fn matrix(
    key: &str,
    rows: &[Vec<f64>],
    (height, width): (Option<usize>, Option<usize>),
    allowed: Allowed,
) -> Result<DMatrix<f64>, Invalid> {
    let first = rows.first().map_or(0, Vec::len);
    let (height, width) = (height.unwrap_or(rows.len()), width.unwrap_or(first));
    let refuse = |value: String, must: String| Err(Invalid::new(format!("nominal.{key}"), value, must));
    if rows.len() != height || first == 0 {
        return refuse(format!("{} x {first}", rows.len()), format!("must be {} x {}", height.max(1), width.max(1)));
    }
    if let Some((i, row)) = rows.iter().enumerate().find(|(_, row)| row.len() != width) {
        let must = format!("must be {width} numbers, as the sizes of A, B and C ask for");
        return Err(Invalid::new(format!("nominal.{key}, row {}", i + 1), format!("{} numbers", row.len()), must));
    }
    for (i, j) in (0..height).flat_map(|i| (0..width).map(move |j| (i, j))) {
        check(format_args!("{key}[{},{}]", i + 1, j + 1), rows[i][j], allowed)?;
    }
    Ok(DMatrix::from_fn(height, width, |i, j| rows[i][j]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Description;

    const PLANT: &str = "A = [[0, 1], [-2, -3.5]]\nB = [[0], [1]]\nC = [[1, 0], [0, 1]]\n";

    fn read(more: &str) -> Result<NominalPlant, String> {
        read_table(&format!("{PLANT}{more}"))
    }

    fn read_table(table: &str) -> Result<NominalPlant, String> {
        let text = format!("name = \"a\"\nmodel = \"pid\"\ndescription = \"\"\n[nominal]\n{table}");
        let description = Description::read(&text).map_err(|invalid| invalid.to_string())?;
        Ok(description.nominal.unwrap())
    }

    #[test]
    fn a_nominal_plant_is_read() {
        let plant = read("").unwrap();
        assert_eq!(plant.A, DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -2.0, -3.5]));
        assert_eq!((plant.B.shape(), plant.C.shape(), plant.delay.as_slice()), ((2, 1), (2, 2), &[0.0][..]));
        assert_eq!((plant.bandwidth, plant.reference, plant.uncertainty), (None, None, Uncertainty::Unknown));
        assert_eq!((plant.plants, plant.seed), (200, 1));
        let plant = read("plants = 5000\nseed = 2").unwrap();
        assert_eq!((plant.plants, plant.seed), (5000, 2));
        let plant = read("delay = 0.1\nbandwidth = 5\nreference = 10\nuncertainty = 0").unwrap();
        assert_eq!((plant.delay, plant.bandwidth), (vec![0.1], Some(5.0)));
        assert_eq!((plant.reference, plant.uncertainty), (Some(vec![10.0; 2]), Uncertainty::Part(0.0)));
        let plant = read("delay = [0]\nreference = [1, 2.5]\nuncertainty_B = [[0], [0.5]]").unwrap();
        assert_eq!((plant.delay, plant.reference), (vec![0.0], Some(vec![1.0, 2.5])));
        let (A, B) = (DMatrix::zeros(2, 2), DMatrix::from_row_slice(2, 1, &[0.0, 0.5]));
        assert_eq!(plant.uncertainty, Uncertainty::Elements { A, B });
        let (file, sum) = ("model.json".to_owned(), "0f".repeat(32));
        let plant = read(&format!("model = \"{file}\"\nsha256 = \"{sum}\"\nlevel = 0.95\nmargin = 1.5")).unwrap();
        let expected = Identified { file, sha256: Some(sum), level: Some(0.95), margin: Some(1.5), region: None };
        assert_eq!(plant.uncertainty, Uncertainty::Model(expected));
        let free = "model = \"m\"\nfree = [[\"B\", 2, 1], [\"A\", 2, 1]]\ncovariance = [[4.0], [-0.5, 0.25]]";
        let Uncertainty::Model(Identified { region: Some(region), .. }) = read(free).unwrap().uncertainty else {
            panic!("no region")
        };
        assert_eq!(region.entries, [5, 1]);
        assert_eq!(region.matrix, DMatrix::from_row_slice(2, 2, &[4.0, -0.5, -0.5, 0.25]));
    }

    #[test]
    fn what_is_wrong_is_refused_with_key_value_and_what_is_allowed() {
        for (more, expected) in [
            ("delay = -1", "nominal.delay = -1: must be a finite number, at least 0"),
            ("delay = [0, 1]", "nominal.delay = 2 numbers: must be one number, or a list of 1: one for each input"),
            ("delay = \"1\"", "must be a number or a list of numbers"),
            ("bandwidth = 0", "nominal.bandwidth = 0: must be a finite number above 0"),
            ("bandwidth = nan", "nominal.bandwidth = NaN: must be a finite number above 0"),
            ("reference = [1, 0]", "nominal.reference = 0: must be a finite number above 0"),
            ("uncertainty = 20", "nominal.uncertainty = 20: must be at least 0 and below 1; 0.2 means 20 %"),
            ("uncertainty = 1", "nominal.uncertainty = 1: must be"),
            (
                "uncertainty_A = [[1, 1], [1, -1]]",
                "nominal.uncertainty_A[2,2] = -1: must be a finite number, at least 0",
            ),
            ("uncertainty_B = [[1, 2], [1, 2]]", "nominal.uncertainty_B, row 1 = 2 numbers: must be 1 numbers"),
            ("uncertainty = 0.1\nmodel = \"m\"", "nominal: give only one of uncertainty"),
            ("level = 0.9", "nominal.level: belongs to nominal.model, which isn't given"),
            ("model = \"m\"\nlevel = 1", "nominal.level = 1: must be above 0 and below 1"),
            ("model = \"m\"\nsha256 = \"0f\"", "nominal.sha256 = 0f: must be 64 hexadecimal digits"),
            ("free = [[\"A\", 1, 1]]", "nominal.free: belongs to nominal.model, which isn't given"),
            ("model = \"m\"\nfree = [[\"C\", 1, 1]]", "nominal.free[1] = [\"C\", 1, 1]: must be [\"A\" or \"B\""),
            ("model = \"m\"\nfree = [[\"B\", 1, 2]]\ncovariance = [[1]]", "nominal.free[1] = [\"B\", 1, 2]: must be"),
            ("model = \"m\"\nfree = [[\"A\", 1, 1], [\"A\", 1, 1]]", "nominal.free[2] = [\"A\", 1, 1]: stands there"),
            ("model = \"m\"\nfree = [[\"A\", 1, 1]]", "nominal.covariance = 0 rows: must be 1 rows"),
            (
                "model = \"m\"\nfree = [[\"A\", 1, 1]]\ncovariance = [[1, 2]]",
                "covariance, row 1 = 2 numbers: must be 1",
            ),
            (
                "model = \"m\"\nfree = [[\"A\", 1, 1]]\ncovariance = [[0]]",
                "nominal.covariance[1,1] = 0: must be finite",
            ),
            (
                "model = \"m\"\nfree = [[\"A\", 1, 1], [\"A\", 2, 1]]\ncovariance = [[1], [3, 4]]",
                "nominal.covariance[2,1] = 3: must be finite",
            ),
            (
                "model = \"m\"\nfree = [[\"A\", 1, 1], [\"A\", 2, 1], [\"A\", 1, 2]]\ncovariance = [[1], [0.9, 1], [0.9, -0.9, 1]]",
                "nominal.covariance = 3 x 3 numbers: must be a covariance",
            ),
            ("plants = 0", "nominal.plants = 0: must be within 1 … 100000"),
            ("plants = 1.5", "plants"),
            ("seed = -1", "seed"),
            ("bandwith = 1", "there is no key `bandwith`; did you mean `bandwidth`?"),
        ] {
            let refused = read(more).unwrap_err();
            assert!(refused.contains(expected), "{more}: {refused}");
        }
        for (table, expected) in [
            ("A = [[0, 1]]\nB = [[0]]\nC = [[1]]", "nominal.A, row 1 = 2 numbers: must be 1 numbers"),
            ("A = []\nB = [[0]]\nC = [[1]]", "nominal.A = 0 x 0: must be 1 x 1"),
            ("A = [[1]]\nB = [[0], [1]]\nC = [[1]]", "nominal.B = 2 x 1: must be 1 x 1"),
            ("A = [[1]]\nB = [[0]]\nC = [[1, 2]]", "nominal.C, row 1 = 2 numbers: must be 1 numbers"),
            ("A = [[inf]]\nB = [[0]]\nC = [[1]]", "nominal.A[1,1] = inf: must be a finite number"),
            ("A = [[1]]\nB = [[0]]", "missing field `C`"),
        ] {
            let refused = read_table(table).unwrap_err();
            assert!(refused.contains(expected), "{table}: {refused}");
        }
    }
}
