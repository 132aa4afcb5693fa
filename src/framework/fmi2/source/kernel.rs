//! The equations of a model as C that a compiler makes a kernel of, over any parameters: evaluation, the Jacobian, and the
//! linear equations of the stiff method.

use super::equations::{Head, SIGNALS, SIGNALS_AND_RATES, function};
use super::{Unit, derivatives, elimination};
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
    let solver = jacobian.as_ref().and_then(|_| elimination::write(model.sparsity()));
    let factors = solver.as_ref().map_or(0, |solver| solver.size);
    body += solver.as_ref().map_or("", |solver| &solver.text);
    let own = |there: bool, name| if there { name } else { "NULL" };
    let (of_jacobian, of_solver) = (jacobian.is_some(), solver.is_some());
    let functions = [
        "unit_outputs",
        "unit_evaluate",
        own(of_jacobian, "unit_jacobian"),
        own(of_solver, "unit_decompose"),
        own(of_solver, "unit_solve"),
    ];
    let functions = functions.join(", ");
    let variables = model.variables();
    let sizes = [
        VERSION as usize,
        variables.reals(Section::Memory).end,
        variables.integers(Section::Memory).end,
        variables.reals(Section::Input).len(),
        variables.states(),
        model.sparsity().entries(),
        factors,
    ];
    let sizes = sizes.map(|size| size.to_string()).join(", ");
    Ok(format!(
        "#include <limits.h>
#include <stdint.h>
{}
{body}
struct kernel {{
    unsigned version, reals, integers, inputs, states, entries, factors;
    void (*outputs)(real, real *, const int *);
    void (*evaluate)(real, real *, const int *);
    void (*jacobian)(real, const real *, const int *, const real *, real *, real *);
    int (*decompose)(real, const real *, real *);
    void (*solve)(const real *, real *);
}};

const struct kernel *{ENTRY}(void)
{{
    static const struct kernel kernel = {{ {sizes}, {functions} }};
    return &kernel;
}}
",
        NEEDED.concat()
    ))
}
