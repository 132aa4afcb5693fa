//! NAME.h: what a user of a law calls, and what it takes and gives.

use std::fmt::Write;

use super::Fallback;
use super::driver::Driver;
use super::functions::Structs;
use super::law::Law;
use super::members::{Members, aligned, ascii};
use super::substeps::Fastest;
use crate::error::Number;
use crate::fmi2::source::names::Names;

/// Status bits that every law has: names, bits, meanings.
pub(super) const STATUS: [(&str, u32, &str); 6] = [
    ("REFUSED", 0, "the step was not taken: nothing has changed, and the outputs are those of the fallback"),
    ("NOT_INITIALISED", 1, "§_init was not called (refused)"),
    ("BAD_INPUT", 2, "an input is NaN or infinite (refused)"),
    ("INVALID", 3, "the equations have no solution here, or too many events (refused)"),
    ("DIVERGED", 4, "a state or an output would be NaN, infinite or beyond 1e12 (refused)"),
    ("LIMITED", 5, "a control is at one of its limits"),
];
/// The first bit of those that are outputs of the FMU.
const FIRST_FLAG: usize = 8;

/// The names of bits that are outputs: in C, and their meanings.
pub(super) fn flags(law: &Law) -> Vec<(String, usize, String)> {
    // Macros of the header begin with the name, too.
    let own = STATUS.iter().map(|(name, ..)| name.to_ascii_lowercase());
    let own: Vec<String> = own.chain(["period", "substeps", "least_substeps"].map(str::to_owned)).collect();
    let mut names = Names::other_than(&own.iter().map(String::as_str).collect::<Vec<_>>());
    let named = |(k, flag): (usize, crate::system::Element<'_>)| {
        let name = names.of(&flag.name().to_ascii_lowercase()).to_ascii_uppercase();
        (name, FIRST_FLAG + k, format!("{}: {}", flag.name(), flag.description()))
    };
    law.flags().into_iter().enumerate().map(named).collect()
}

/// The whole file.
pub(super) fn write(law: &Law, structs: &Structs, fastest: Option<&Fastest>, name: &str) -> String {
    let description = law.model.description();
    let driver = Driver::of(law, structs);
    let mut text = format!("/* {name}: {}.\n *\n{}\n", ascii(&description.description), usage(law, structs));
    text += &(preamble(name) + &timing(law, fastest));
    for members in [&structs.inputs, &structs.outputs, &structs.manual, &structs.parameters, &structs.prepared] {
        text += &members.declaration(&[], &format!("{name}_real"));
    }
    text += &structs.states.declaration(&[], &format!("{name}_real"));
    text += &structs.discrete.declaration(&driver.counters, &format!("{name}_real"));
    text += &state(structs, &driver);
    text += &status(law);
    if !structs.parameters.is_empty() {
        text += &calibration(law, structs);
    }
    text += &calls(structs);
    text += "#ifdef __cplusplus\n}\n#endif\n\n#endif\n";
    // In all texts § is the controller's name.
    text.replace('§', name)
}

/// Usage, in the comment at the top.
fn usage(law: &Law, structs: &Structs) -> String {
    let mut lines = vec![
        "    static § law;".to_owned(),
        "    §_init(&law);".to_owned(),
        format!("    status = §_step(&law, &in, &out);    every {} s, from one context at a time", law.period),
        String::new(),
        "A controller has no memory outside its struct. Compile without -ffast-math, with -ffp-contract=off for the FMU's bits;".to_owned(),
        "-D§_FLOAT computes in float.".to_owned(),
    ];
    if !structs.manual.is_empty() {
        lines.push(
            "§_enable hands over to a manual control, and lets the controller take over from it without a jump."
                .to_owned(),
        );
    }
    let fallback = match law.fallback {
        Fallback::Hold => "those of the last step that was taken (zeros before)",
        Fallback::Zero => "zeros",
        Fallback::Manual => "the manual control",
    };
    lines.push(format!("Where a step is refused, the outputs are {fallback}."));
    if law.every > 1 {
        lines.push(format!("It takes a sample in every {}th call; its control is constant between.", law.every));
    }
    lines.iter().map(|line| format!(" * {line}").trim_end().to_owned() + "\n").collect::<String>() + " */\n"
}

fn preamble(name: &str) -> String {
    let guard = format!("{}_H", name.to_ascii_uppercase());
    format!(
        "#ifndef {guard}\n#define {guard}\n\n#include <stdbool.h>\n#include <stdint.h>\n\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n\
         #ifdef §_FLOAT\ntypedef float §_real;\n#else\ntypedef double §_real;\n#endif\n\n"
    )
}

/// Period and Runge-Kutta steps; with too few of them nothing is compiled.
fn timing(law: &Law, fastest: Option<&Fastest>) -> String {
    let Law { period, substeps, .. } = law;
    let period = format!("/* From call to call, s. */\n#define §_PERIOD {}\n\n", plain(*period));
    let Some(fastest) = fastest else {
        return period
            + &format!("/* Runge-Kutta steps of order 4 in each call. */\n#define §_SUBSTEPS {substeps}\n\n");
    };
    let (least, mode) = (fastest.least, fastest.to_text());
    period
        + &format!(
            "/* Runge-Kutta steps of order 4 in each call. With fewer than the least number the fastest mode with the parameters of the export\n \
             * grows in place of decaying: {mode}. Larger gains may need more. */\n#ifndef §_SUBSTEPS\n#define §_SUBSTEPS {substeps}\n#endif\n#define §_LEAST_SUBSTEPS {least}\n#if \
             §_SUBSTEPS < §_LEAST_SUBSTEPS\n#error \"§_SUBSTEPS is too small: the fastest mode of the controller grows\"\n#endif\n\n"
        )
}

fn plain(value: f64) -> String {
    format!("{value:?}")
}

/// The struct of a controller.
fn state(structs: &Structs, driver: &Driver) -> String {
    let lines = members(structs, driver, 8).into_iter().map(|(line, _)| format!("    {line}\n"));
    let what = "/* A controller: all that it continues with. A copy of it continues as it does. */";
    format!("{what}\ntypedef struct {{\n{}}} §;\n\n", lines.collect::<String>())
}

/// Bytes of a controller with real numbers of `real` bytes, where each number is aligned to its size.
pub(super) fn bytes(structs: &Structs, driver: &Driver, real: usize) -> usize {
    aligned(members(structs, driver, real).into_iter().map(|(_, size)| size)).0
}

/// Its members, with the bytes and the alignment of each.
fn members(structs: &Structs, driver: &Driver, real: usize) -> Vec<(&'static str, (usize, usize))> {
    let of = |members: &Members| members.bytes(&[], real);
    let all = [
        (!structs.states.is_empty(), "§_states x;", of(&structs.states)),
        (driver.has_discrete, "§_discrete d;", structs.discrete.bytes(&driver.counters, real)),
        (!structs.parameters.is_empty(), "§_parameters p;", of(&structs.parameters)),
        (!structs.prepared.is_empty(), "§_prepared r;", of(&structs.prepared)),
        (!structs.manual.is_empty(), "§_manual manual;", of(&structs.manual)),
        (driver.holds, "§_outputs last;", of(&structs.outputs)),
        (driver.counts_steps, "uint64_t steps; /* that were taken */", (8, 8)),
        (true, "uint32_t refused; /* steps since §_init; it stays at its largest value */", (4, 4)),
        (true, "uint32_t ready;", (4, 4)),
        (!structs.manual.is_empty(), "bool enabled;", (1, 1)),
        (true, "bool started;", (1, 1)),
        (driver.has_changes, "bool calibrated;", (1, 1)),
    ];
    all.into_iter().filter(|(is, ..)| *is).map(|(_, line, size)| (line, size)).collect()
}

fn status(law: &Law) -> String {
    let mut text = "/* What came of a step: 0, or bits. */\ntypedef uint32_t §_status;\n".to_owned();
    let mut bit = |name: &str, bit: usize, about: &str| {
        let _ = writeln!(text, "#define §_{name} (UINT32_C(1) << {bit}) /* {about} */");
    };
    STATUS.iter().for_each(|(name, place, about)| bit(name, *place as usize, about));
    flags(law).iter().for_each(|(name, place, about)| bit(name, *place, &ascii(about)));
    text + "\n"
}

/// Answers of a calibration.
fn calibration(law: &Law, structs: &Structs) -> String {
    let mut text =
        "/* What came of a calibration: the parameters are in force, or which one is refused. */\ntypedef enum {\n    \
                    §_CALIBRATED = 0,\n"
            .to_owned();
    for (member, range) in structs.parameters.list.iter().zip(ranges(law, structs)) {
        let name = &member.capitals;
        let _ = writeln!(text, "    §_BAD_{name}, /* {}: must be {range} */", ascii(&member.name));
    }
    for (k, (_, reason)) in law.refusals(&law.recorded.relate).iter().enumerate() {
        let _ = writeln!(text, "    §_BAD_RELATION_{}, /* {} */", k + 1, ascii(reason));
    }
    text + "} §_calibration;\n\n/* The parameters of the export. */\nextern const §_parameters §_defaults;\n\n"
}

/// The ranges of parameters, in words.
fn ranges(law: &Law, structs: &Structs) -> Vec<String> {
    let of = |member: &super::members::Member| {
        let Some((min, above, max)) = limits(law, member) else { return "0 or 1".to_owned() };
        let lower = min.map(Number).map(|min| if above { format!("above {min}") } else { format!("{min} or more") });
        let upper = max.map(|max| format!("{} or less", Number(max)));
        match (lower, upper) {
            (None, None) => "a finite number".to_owned(),
            (lower, upper) => lower.into_iter().chain(upper).collect::<Vec<_>>().join(", "),
        }
    };
    structs.parameters.list.iter().map(of).collect()
}

/// Limits of a parameter: smallest value, whether that is excluded, largest value; nothing for Booleans.
pub(super) fn limits(law: &Law, member: &super::members::Member) -> Option<(Option<f64>, bool, Option<f64>)> {
    let element = law.variables().find(&member.elements[0])?;
    match &element.variable.data {
        crate::system::Data::Real { min, above_min, max, .. } => Some((*min, *above_min, *max)),
        crate::system::Data::Boolean { .. } => None,
        whole => {
            let (least, most) = whole.integers();
            Some((Some(f64::from(least)), false, Some(f64::from(most))))
        }
    }
}

fn calls(structs: &Structs) -> String {
    let mut text = String::new();
    let mut call = |is: bool, what: &str, declaration: &str| {
        if is {
            let _ = write!(text, "/* {what} */\n{declaration};\n\n");
        }
    };
    call(true, "Initialises a controller, with the parameters of the export.", "void §_init(§ *self)");
    call(true, "Puts it back to its start: states and counters, not parameters.", "void §_reset(§ *self)");
    call(
        !structs.manual.is_empty(),
        "Who is in command from the next step on: the controller, or a manual control. It takes over without a jump. \
         False where the manual control isn't a number: then nothing changes.",
        "bool §_enable(§ *self, bool enabled, const §_manual *manual)",
    );
    call(
        !structs.parameters.is_empty(),
        "Takes over parameters, all or none; they act from the next step on.",
        "§_calibration §_calibrate(§ *self, const §_parameters *p)",
    );
    call(true, "Takes one step of §_PERIOD.", "§_status §_step(§ *self, const §_inputs *in, §_outputs *out)");
    if structs.inputs.is_empty() {
        text = text.replace("const §_inputs *in, ", "");
    }
    text
}
