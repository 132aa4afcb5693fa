//! The choice between processor and graphics card.

use std::fmt;
use std::str::FromStr;

/// Place where runs are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Backend {
    /// The graphics card, where there is one that is faster.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// The graphics card.
    Gpu,
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Backend::Auto => "auto",
            Backend::Cpu => "cpu",
            Backend::Gpu => "gpu",
        })
    }
}

impl FromStr for Backend {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = [Backend::Auto, Backend::Cpu, Backend::Gpu];
        all.into_iter().find(|it| it.to_string() == text).ok_or_else(|| "must be auto, cpu or gpu".to_owned())
    }
}
