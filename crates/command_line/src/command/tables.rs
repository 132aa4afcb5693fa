//! Notes about a table that was read.

use std::path::Path;

/// Prints what was left out, and with `--verbose` what was assumed.
pub fn log_assumptions(file: &Path, assumed: &[String], left_out: &[String]) {
    let name = file.display();
    left_out.iter().for_each(|line| remark!("{name}: left out: {line}"));
    assumed.iter().for_each(|line| detail!("{name}: {line}"));
}
