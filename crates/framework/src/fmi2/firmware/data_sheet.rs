//! NAME_data_sheet.md: what a controller needs of its target, and what its design leaves it.

use std::fmt::Write;

use super::driver::Driver;
use super::functions::Structs;
use super::header::bytes;
use super::law::Law;
use super::substeps::Fastest;
use super::vectors::Vectors;
use super::work::{self, Work};
use crate::report::{Finding, Value, number};

/// Findings of a design report that a data sheet has.
const DELAY_MARGIN: &str = "delay margin";

/// The whole file.
pub(super) fn write(
    law: &Law,
    structs: &Structs,
    fastest: Option<&Fastest>,
    vectors: Option<&Vectors>,
    name: &str,
) -> String {
    let description = law.model.description();
    let intro = format!(
        "# {name}\n\n{}. C made by adaptive-fmu {} from the recorded equations of the FMU of this name.\n",
        description.description,
        env!("CARGO_PKG_VERSION")
    );
    [
        intro,
        timing(law, structs, fastest),
        delay(law),
        operations(law, structs),
        memory(law, structs),
        proof(vectors, name),
    ]
    .join("\n")
}

fn timing(law: &Law, structs: &Structs, fastest: Option<&Fastest>) -> String {
    let mut rows = vec![("time from call to call", format!("{} s", number(law.period)))];
    if law.every > 0 {
        rows.push(("time from sample to sample", format!("{} s", number(law.period * f64::from(law.every)))));
    }
    if !structs.states.is_empty() {
        let least = fastest.map_or(String::new(), |fastest| format!(", at least {}", fastest.least));
        rows.push(("Runge-Kutta steps of order 4 in a call", format!("{}{least}", law.substeps)));
    }
    if let Some(fastest) = fastest {
        rows.push(("fastest mode that decays", fastest.told()));
        rows.push(("longest period with so many steps", format!("{} s", number(fastest.longest(law.substeps)))));
    }
    let rows: String = rows.into_iter().map(|(what, value)| format!("| {what} | {value} |\n")).collect();
    let note = if fastest.is_some() {
        "\nModes are those with the parameters of the export, along the signals of its loop; larger gains may make them faster. Beyond the \
         longest period the fastest one grows, with any plant. Whether the loop tolerates a longer period is another question: \
         export with `--period`, and simulate the loop with that communication step.\n"
    } else {
        ""
    };
    format!("## Time\n\n| | |\n| --- | --- |\n{rows}{note}")
}

/// Delay margins of the design report.
fn delay(law: &Law) -> String {
    let report = law.model.report();
    let margins = report.findings.iter().filter(|finding| finding.name == DELAY_MARGIN);
    let line = |finding: &Finding| {
        let note = if finding.note.is_empty() { String::new() } else { format!(": {}", finding.note) };
        let unit = if matches!(finding.value, Value::Text(_)) { "" } else { finding.unit.as_str() };
        format!("- {}{note}\n", format!("{} {unit}", finding.value.lines().join(", ")).trim_end())
    };
    let mut lines: String = margins.map(line).collect();
    if lines.is_empty() {
        lines =
            "The design report has no delay margin for this controller: simulate the loop with a delay.\n".to_owned();
    }
    // The design of a sampled law has the constant control between samples in it.
    let hold = if law.every > 0 { "" } else { " and half a period, for which the control is constant," };
    format!(
        "## Delay margin\n\nOf the nominal design (`adaptive-fmu check` has the whole report). The time from a measurement to the control \
         that follows from it{hold} must stay below it.\n\n{lines}"
    )
}

fn operations(law: &Law, structs: &Structs) -> String {
    let (rows, whole) = work::rows(law, structs);
    let cells = |work: &Work| format!("{} | {} | {}", work.simple, work.divisions, work.functions);
    let mut text = "## Work\n\nOperations on numbers at most, whichever branch is taken; copies, loops and calls come in addition. A step without \
                    a start, an event or a calibration takes those of the last row. An event, as a hand-over, adds its own, and those of \
                    outputs and sides.\n\n| | calls in a step | additions, products, comparisons | \
                    divisions, roots | functions of `<math.h>` |\n| --- | --- | --- | --- | --- |\n"
        .to_owned();
    rows.iter().for_each(|row| _ = writeln!(text, "| {} | {} | {} |", row.what, row.calls, cells(&row.work)));
    let _ = writeln!(text, "| **a step** | | {} |", cells(&whole));
    text
}

fn memory(law: &Law, structs: &Structs) -> String {
    let driver = Driver::of(law, structs);
    let [double, float] = [8, 4].map(|real| bytes(structs, &driver, real));
    format!(
        "## Memory\n\nA controller takes {double} bytes in double and {float} in float, where each number is aligned to its size. There are no other \
         variables; nothing is allocated and nothing calls itself.\n"
    )
}

fn proof(vectors: Option<&Vectors>, name: &str) -> String {
    let replayed = match vectors.map(|vectors| vectors.inputs.len()) {
        Some(steps) => format!(
            "`{name}_replay.c` compares {steps} steps with the FMU: run it with your compiler, on the host and on the board. It prints the largest \
             difference.\n"
        ),
        None => "There are no test vectors: the first step is refused with the start values.\n".to_owned(),
    };
    format!(
        "## Proof\n\n{replayed}\nThis sheet was made without a compiler. `arm-none-eabi-size`, `-fstack-usage` and `cppcheck --addon=misra \
         {name}.c` measure what depends on yours.\n"
    )
}
