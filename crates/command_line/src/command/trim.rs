//! Options for the operating point of an FMU that is linearised: free inputs, wanted values, states that don't change.

use adaptive_fmu::analysis::OperatingPoint;

use super::linearise::assignment;
use super::names::Names;
use super::number::finite;

#[derive(Debug, Clone, Default, clap::Args)]
pub struct TrimOptions {
    /// Inputs to adjust such that an operating point is reached (repeatable)
    ///
    /// With --free, --want or --hold, the operating point is sought from the start values by Newton's method: states, and
    /// the inputs that are free, at which all derivatives are zero or have the values of --want. Inputs stay within the
    /// min and max that the FMU declares. The FMU must support model exchange.
    #[arg(long, value_name = "INPUT,…")]
    free: Vec<Names>,
    /// Value at the operating point, of an output, a local variable or a derivative (repeatable)
    ///
    /// For example --want height=1 or --want "der(speed)=1.5". Derivatives without a wanted value are zero.
    #[arg(long, value_name = "NAME=VALUE", value_parser = wanted)]
    want: Vec<(String, f64)>,
    /// States that keep their start values at the operating point (repeatable)
    #[arg(long, value_name = "STATE,…")]
    hold: Vec<Names>,
}

/// A name and a number.
fn wanted(text: &str) -> Result<(String, f64), String> {
    let (name, value) = assignment(text)?;
    Ok((name.trim().to_owned(), finite(value.trim()).map_err(|allowed| format!("VALUE {allowed}"))?))
}

impl TrimOptions {
    /// True if none was given.
    pub fn is_empty(&self) -> bool {
        self.free.is_empty() && self.want.is_empty() && self.hold.is_empty()
    }

    /// An operating point with these options.
    pub fn apply(&self, point: OperatingPoint) -> OperatingPoint {
        let all = |names: &[Names]| names.iter().flat_map(|Names(names)| names.clone()).collect();
        OperatingPoint { free: all(&self.free), want: self.want.clone(), hold: all(&self.hold), ..point }
    }
}

#[cfg(test)]
mod tests {
    use super::wanted;

    #[test]
    fn a_wanted_value_is_a_name_and_a_finite_number() {
        assert_eq!(wanted("der(x[1]) = -1.5e0"), Ok(("der(x[1])".to_owned(), -1.5)));
        assert_eq!(wanted("a=b=2"), Ok(("a=b".to_owned(), 2.0)));
        assert_eq!(wanted("y[1]").unwrap_err(), "must be NAME=VALUE");
        for number in ["", "one", "nan", "inf"] {
            assert_eq!(wanted(&format!("y={number}")).unwrap_err(), "VALUE must be a finite number");
        }
    }
}
