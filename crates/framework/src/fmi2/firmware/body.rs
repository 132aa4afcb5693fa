//! NAME.c: the equations of a law, its driver, and the functions of the header.

use super::driver::{self, Driver};
use super::functions::Structs;
use super::law::Law;
use super::{constants, equations, interface};
use crate::fmi2::source::RUNTIME;

/// The whole file.
pub(super) fn write(law: &Law, structs: &Structs, name: &str) -> String {
    let driver = Driver::of(law, structs);
    let functions = [
        equations::write(law, structs, &driver),
        driver::write(law, structs, &driver),
        interface::write(law, structs, &driver),
    ]
    .concat();
    let (helpers, undefined) = helpers(&functions);
    let (macros, ends) = macros(&(helpers.clone() + &functions));
    let text = format!(
        "/* {name}: see {name}.h. Generated from the recorded equations of the FMU of that name. */\n\n#include \"{name}.h\"\n\n\
         #include <float.h>\n#include <limits.h>\n#include <math.h>\n#include <string.h>\n\n{CHECKS}{macros}/* Memory \
         that was initialised. */\n#define §_READY UINT32_C(0x{:08x})\n\n{}{}{helpers}{functions}{undefined}{ends}",
        ready(law),
        structs.signals.declaration(&[], "real"),
        constants::declaration(&law.constants),
    );
    text.replace('§', name)
}

const CHECKS: &str = "\
#if defined(__FAST_MATH__) || defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0
#error \"-ffast-math takes away the checks of inputs and outputs for NaN and infinity\"
#endif
#if defined(__STDC_VERSION__) && !defined(__GNUC__) || defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

";

/// Compilers that copy functions into others keep these whole by it: flash memory counts.
const ONCE: &str = "\
#if defined(__GNUC__)
#define ONCE __attribute__((noinline))
#else
#define ONCE
#endif

";

/// Macros of numbers, and what they are in float and in double.
const MACROS: [(&str, &str, &str); 5] = [
    ("R(x)", "x##f", "x"),
    ("F(name)", "name##f", "name"),
    ("LARGE(x)", "FLT_MAX", "x"),
    ("SMALL(x)", "FLT_MIN", "x"),
    ("LARGEST", "FLT_MAX", "DBL_MAX"),
];

/// Macros of numbers that a text uses, and the lines that end them.
fn macros(text: &str) -> (String, String) {
    let (mut float, mut double, mut ends) = (String::new(), String::new(), String::from("#undef real\n"));
    for (call, in_float, in_double) in MACROS {
        let name = call.split('(').next().unwrap_or_default();
        if text.contains(&call[..call.len().min(name.len() + 1)]) {
            float += &format!("#define {call} {in_float}\n");
            double += &format!("#define {call} {in_double}\n");
            ends += &format!("#undef {name}\n");
        }
    }
    let about = "/* Numbers of this file: R(x) is a constant, F(name) a function of <math.h>. */";
    let once = if text.contains("ONCE ") { ONCE } else { "" };
    if !once.is_empty() {
        ends += "#undef ONCE\n";
    }
    let begins = format!("{once}{about}\n#define real §_real\n#ifdef §_FLOAT\n{float}#else\n{double}#endif\n\n");
    (begins, ends + "#undef §_READY\n")
}

/// Functions that equations call; sources of FMUs have them, too. A function comes before those that call it.
const HELPERS: [&str; 6] = ["sign", "wrapped_far", "wrapped", "turns", "whole", "power"];
/// Those that take many instructions in flash memory: they are there once.
const ONCE_EACH: [&str; 2] = ["wrapped_far", "turns"];

/// The functions that a text calls, with macros by which it does, and what ends these.
fn helpers(text: &str) -> (String, String) {
    let (mut written, mut ends) = (String::new(), String::new());
    for name in HELPERS.into_iter().rev() {
        let call = format!("{name}(");
        let is_called = |text: &str| {
            text.match_indices(&call).any(|(at, _)| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
        };
        if is_called(text) || is_called(&written) {
            let mut own = numbers(name).replace(&call, &format!("§_{call}"));
            if ONCE_EACH.contains(&name) {
                own = own.replace("static inline", "ONCE static");
            }
            written = format!("{own}\n#define {name} §_{name}\n\n{written}");
            ends = format!("#undef {name}\n{ends}");
        }
    }
    (written, ends)
}

/// A function of the runtime of FMUs, with its comment.
fn numbers(name: &str) -> &'static str {
    let text = RUNTIME.iter().find(|(file, _)| *file == "numbers.h").map_or("", |(_, text)| text);
    let at = text.find(&format!(" {name}(")).unwrap_or_default();
    let begin = text[..at].rfind("/*").unwrap_or_default();
    let end = text[at..].find("\n}\n").map_or(text.len(), |end| at + end + 3);
    &text[begin..end]
}

/// A number by which initialised memory is recognised, computed from name and parameters.
fn ready(law: &Law) -> u32 {
    let bytes = law.model.description().name.bytes().map(u64::from);
    let values = law.start.reals.iter().map(|value| value.to_bits());
    let mixed = bytes.chain(values).fold(0xcbf2_9ce4_8422_2325_u64, |hash, word| {
        (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23)
    });
    (mixed ^ mixed >> 32) as u32 | 1
}
