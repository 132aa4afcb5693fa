//! The equations of a model as C that a compiler makes a kernel of: evaluation and Jacobian, over any parameters.

use super::equations::{Head, SIGNALS, SIGNALS_AND_RATES, function};
use super::{Unit, derivatives};
use crate::error::Invalid;
use crate::kernel::VERSION;
use crate::model::Model;
use crate::recording::Method;
use crate::system::Section;

/// What equations need of the runtime.
const NEEDED: [&str; 2] = [include_str!("runtime/real.h"), include_str!("runtime/numbers.h")];

/// The function of a kernel's library that returns its table.
pub const ENTRY: &str = "adaptive_fmu_kernel";

/// The text of a model's kernel.
///
/// # Errors
/// When its equations can't be recorded.
pub fn text(model: &Model) -> Result<String, Invalid> {
    model.check_recorded()?;
    let unit = Unit::tunable(model);
    let evaluate = unit.record(Method::Evaluate);
    let mut body = String::new();
    for (declaration, sections) in [
        ("static void unit_outputs(real t, real *v, const int *n)", &SIGNALS[..]),
        ("static void unit_evaluate(real t, real *v, const int *n)", &SIGNALS_AND_RATES[..]),
    ] {
        let head = Head { what: "Signals, and rates of the states.", declaration };
        body += &function(&unit, &head, &evaluate.tape, &unit.changed(&evaluate, sections), &[]);
    }
    let jacobian = derivatives::written_out(&unit);
    body += jacobian.as_deref().unwrap_or_default();
    let own = if jacobian.is_some() { "unit_jacobian" } else { "NULL" };
    let variables = model.variables();
    let sizes = [
        VERSION as usize,
        variables.reals(Section::Memory).end,
        variables.integers(Section::Memory).end,
        variables.reals(Section::Input).len(),
        variables.states(),
        model.sparsity().entries(),
    ];
    let sizes = sizes.map(|size| size.to_string()).join(", ");
    Ok(format!(
        "#include <limits.h>
#include <stdint.h>
{}
{body}
struct kernel {{
    unsigned version, reals, integers, inputs, states, entries;
    void (*outputs)(real, real *, const int *);
    void (*evaluate)(real, real *, const int *);
    void (*jacobian)(real, const real *, const int *, const real *, real *, real *);
}};

const struct kernel *{ENTRY}(void)
{{
    static const struct kernel kernel = {{ {sizes}, unit_outputs, unit_evaluate, {own} }};
    return &kernel;
}}
",
        NEEDED.concat()
    ))
}
