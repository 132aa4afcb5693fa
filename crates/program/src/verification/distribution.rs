//! Varied quantities of a loop, and the distributions of their values.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::report::number;

const FORM: &str = "must be NAME=±30%, NAME=LOW..HIGH, NAME=LOW..HIGH/log or NAME=normal(MEAN,DEVIATION), all but ±30% in absolute values";
/// Least part of a normal distribution that the limits of a variable must allow.
const LEAST_PART: f64 = 1e-6;

/// A distribution as written by a user.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distribution {
    /// Uniform within a part of the present value, up and down.
    Around(f64),
    /// Uniform between two values.
    Uniform(f64, f64),
    /// Uniform between the logarithms of two values.
    Logarithmic(f64, f64),
    /// Normal, with a mean and a standard deviation.
    Normal(f64, f64),
}

/// A quantity that is varied.
#[derive(Debug, Clone, PartialEq)]
pub struct Vary {
    /// Its name.
    pub name: String,
    /// Its distribution.
    pub distribution: Distribution,
}

impl FromStr for Vary {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, distribution) = text.split_once('=').ok_or(FORM)?;
        let name = name.trim();
        if name.is_empty() {
            return Err(FORM.to_owned());
        }
        Ok(Vary { name: name.to_owned(), distribution: distribution.parse()? })
    }
}

impl FromStr for Distribution {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if let Some(part) = text.strip_prefix('±').or_else(|| text.strip_prefix("+-")) {
            let part = part.trim().strip_suffix('%').ok_or_else(|| format!("`{text}`: must end with %, as in ±30%"))?;
            let part = read(part)? / 100.0;
            return if part > 0.0 { Ok(Self::Around(part)) } else { Err(format!("`{text}`: must be above 0 %")) };
        }
        if let Some(inside) = text.strip_prefix("normal") {
            let inside = inside.trim().strip_prefix('(').and_then(|inside| inside.strip_suffix(')')).ok_or(FORM)?;
            let (mean, deviation) = inside.split_once(',').ok_or(FORM)?;
            let (mean, deviation) = (read(mean)?, read(deviation)?);
            return if deviation > 0.0 {
                Ok(Self::Normal(mean, deviation))
            } else {
                Err(format!("`{text}`: the standard deviation must be above 0"))
            };
        }
        let (range, is_logarithmic) = text.strip_suffix("/log").map_or((text, false), |range| (range, true));
        let (low, high) = range.split_once("..").ok_or(FORM)?;
        let (low, high) = (read(low)?, read(high)?);
        if low >= high {
            return Err(format!("`{text}`: the lower end must be below the upper one"));
        }
        if is_logarithmic && low <= 0.0 {
            return Err(format!("`{text}`: both ends must be above 0"));
        }
        Ok(if is_logarithmic { Self::Logarithmic(low, high) } else { Self::Uniform(low, high) })
    }
}

fn read(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("`{}` must be a finite number: {FORM}", text.trim()))
}

impl fmt::Display for Distribution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Around(part) => write!(f, "±{}%", number(100.0 * part)),
            Self::Uniform(low, high) => write!(f, "{low}..{high}"),
            Self::Logarithmic(low, high) => write!(f, "{low}..{high}/log"),
            Self::Normal(mean, deviation) => write!(f, "normal({mean},{deviation})"),
        }
    }
}

impl Serialize for Distribution {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A distribution of a variable, truncated to the allowed values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    distribution: Distribution,
    low: f64,
    high: f64,
    /// Parts of a normal distribution below both ends.
    parts: (f64, f64),
}

impl Distribution {
    /// The distribution of a variable with a present value, truncated to its least and largest allowed value.
    ///
    /// # Errors
    /// When no value of it is allowed, or it is relative to no value or 0.
    pub fn cut(self, present: Option<f64>, (least, most): (f64, f64)) -> Result<Cut, String> {
        let (low, high) = match self {
            Self::Around(part) => {
                let present = present.filter(|value| *value != 0.0).ok_or_else(|| {
                    let value = present.map_or("no value".to_owned(), |value| value.to_string());
                    format!("{self} of {value} is an empty range: give LOW..HIGH or normal(MEAN,DEVIATION)")
                })?;
                let ends = [present * (1.0 - part), present * (1.0 + part)];
                (ends[0].min(ends[1]), ends[0].max(ends[1]))
            }
            Self::Uniform(low, high) | Self::Logarithmic(low, high) => (low, high),
            Self::Normal(..) => (f64::NEG_INFINITY, f64::INFINITY),
        };
        let (low, high) = (low.max(least), high.min(most));
        let parts = self.normal().map_or((0.0, 1.0), |normal| (normal.cdf(low), normal.cdf(high)));
        if low >= high || parts.1 - parts.0 < LEAST_PART {
            return Err(format!("{self} has no values within the allowed range, {} … {}", number(least), number(most)));
        }
        Ok(Cut { distribution: self, low, high, parts })
    }

    fn normal(self) -> Option<Normal> {
        let Self::Normal(mean, deviation) = self else { return None };
        Normal::new(mean, deviation).ok()
    }
}

impl Cut {
    /// The quantile of a part of all values.
    pub fn quantile(&self, part: f64) -> f64 {
        let Cut { distribution, low, high, parts } = *self;
        let value = match (distribution, distribution.normal()) {
            (_, Some(normal)) => normal.inverse_cdf(parts.0 + part * (parts.1 - parts.0)),
            (Distribution::Logarithmic(..), _) => low * (high / low).powf(part),
            _ => low + part * (high - low),
        };
        value.clamp(low, high)
    }

    /// True if its logarithm is uniformly distributed.
    pub fn is_logarithmic(&self) -> bool {
        matches!(self.distribution, Distribution::Logarithmic(..))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FREE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

    fn vary(text: &str) -> Vary {
        text.parse().unwrap()
    }

    #[test]
    fn distributions_are_read_as_they_are_written() {
        let cases = [
            ("plant.m1=±30%", Distribution::Around(0.3)),
            ("plant.m1 = +-5 %", Distribution::Around(0.05)),
            ("plant.k1=-0.5..2", Distribution::Uniform(-0.5, 2.0)),
            ("plant.k1=0.5..2/log", Distribution::Logarithmic(0.5, 2.0)),
            ("plant.x0[1]=normal(0, 0.1)", Distribution::Normal(0.0, 0.1)),
        ];
        for (text, distribution) in cases {
            assert_eq!(vary(text).distribution, distribution, "{text}");
            assert_eq!(distribution.to_string().parse(), Ok(distribution));
        }
        assert_eq!(vary("plant.x0[1]=normal(0,0.1)").name, "plant.x0[1]");
    }

    #[test]
    fn what_is_no_distribution_is_refused_with_the_reason() {
        let refused = |text: &str| text.parse::<Vary>().unwrap_err();
        for text in ["m", "=1..2", "m=3", "m=1..2/lin", "m=normal(1)", "m=normal 1,2", "m=a..b", "m=0..inf"] {
            assert!(refused(text).contains("NAME=±30%"), "{text}: {}", refused(text));
        }
        assert!(refused("m=±0.3").contains("must end with %"));
        assert!(refused("m=±0%").contains("above 0 %"));
        assert!(refused("m=2..1").contains("below the upper"));
        assert!(refused("m=0..1/log").contains("above 0"));
        assert!(refused("m=normal(0,0)").contains("above 0"));
    }

    #[test]
    fn values_have_the_distribution_and_stay_within_what_is_allowed() {
        let around = vary("m=±30%").distribution;
        let (low, high) = (around.cut(Some(-2.0), FREE).unwrap(), around.cut(Some(2.0), (1.9, 9.0)).unwrap());
        assert!((low.quantile(0.0) + 2.6).abs() < 1e-12 && (low.quantile(1.0) + 1.4).abs() < 1e-12);
        assert!((high.quantile(0.0) - 1.9).abs() < 1e-12 && (high.quantile(0.5) - 2.25).abs() < 1e-12);
        let log = vary("k=0.1..10/log").distribution.cut(None, FREE).unwrap();
        assert!((log.quantile(0.5) - 1.0).abs() < 1e-12 && log.is_logarithmic());
        let normal = vary("x=normal(1,2)").distribution.cut(None, FREE).unwrap();
        assert!((normal.quantile(0.975) - (1.0 + 2.0 * 1.959_963_984_540_054)).abs() < 1e-9);
        // It is truncated to its upper half, whose median is the third quartile.
        let half = vary("x=normal(0,1)").distribution.cut(None, (0.0, f64::INFINITY)).unwrap();
        assert!((half.quantile(0.5) - 0.674_489_750_196_082).abs() < 1e-9 && half.quantile(0.0) >= 0.0);
    }

    #[test]
    fn a_distribution_without_allowed_values_is_refused() {
        let refused = |text: &str, present, allowed| vary(text).distribution.cut(present, allowed).unwrap_err();
        assert!(refused("m=±30%", Some(0.0), FREE).contains("±30% of 0"));
        assert!(refused("m=±30%", None, FREE).contains("no value"));
        assert!(refused("m=1..2", None, (3.0, 4.0)).contains("3 … 4"));
        assert!(refused("m=normal(0,1)", None, (10.0, 20.0)).contains("10 … 20"));
    }
}
