//! NAME_replay.c: a program that takes the steps of the test vectors, on the host or on the target.

use std::fmt::Write;

use super::functions::Structs;
use super::law::Law;
use super::members::Members;
use super::vectors::Vectors;

/// Differences that are allowed, in parts of the largest value of each output and state: in double, and in float.
const ALLOWED: [&str; 2] = ["1e-11", "1e-2"];

/// The whole file.
pub(super) fn write(law: &Law, structs: &Structs, vectors: &Vectors, name: &str) -> String {
    let has = |what: &Members| what.reals().next().is_some();
    let (has_inputs, has_states) = (has(&structs.inputs), has(&structs.states));
    let mut text = format!(
        "/* {name}_replay.c: takes {} steps of {name}, and compares outputs and states with those that the FMU gives with the same\n \
         * Runge-Kutta steps. A program of its own, compiled with -D§_REPLAY: exit code 0 where they agree. On a target, printf is\n \
         * what the board makes of it: semihosting, or a serial line. */\n\n#include \"{name}.h\"\n\n#ifdef §_REPLAY\n\n\
         #include <math.h>\n#include <stdio.h>\n#include <string.h>\n\n#if §_SUBSTEPS != {}\n#error \"the vectors are those of {} Runge-Kutta steps in a call\"\n#endif\n\n#define §_REPLAY_STEPS {}\n\n\
         /* Differences that are allowed, in parts of the largest. */\n#ifdef §_FLOAT\n#define §_REPLAY_ALLOWED {}\n#else\n#define §_REPLAY_ALLOWED \
         {}\n#endif\n\n",
        vectors.inputs.len(),
        law.substeps,
        law.substeps,
        vectors.inputs.len(),
        ALLOWED[1],
        ALLOWED[0],
    );
    if has_inputs {
        text += &table("inputs", &vectors.inputs);
    }
    text += &table("outputs", &vectors.outputs);
    text += &table("largest_outputs", std::slice::from_ref(&vectors.largest[0]));
    if has_states {
        text += &table("states", std::slice::from_ref(&vectors.states));
        text += &table("largest_states", std::slice::from_ref(&vectors.largest[1]));
    }
    text += COMPARED;
    text += &compared("outputs", &structs.outputs);
    if has_states {
        text += &compared("states", &structs.states);
    }
    text += &main(law, structs, (has_inputs, has_states));
    (text + "\n#endif\n").replace('§', name)
}

/// Rows of numbers, all digits of each.
fn table(name: &str, rows: &[Vec<f64>]) -> String {
    let row = |row: &Vec<f64>| {
        let mut text = String::from("    {");
        let mut width = 5;
        for (k, value) in row.iter().enumerate() {
            let number = format!("{value:?}{}", if k + 1 < row.len() { ", " } else { "" });
            if width + number.len() > 116 {
                (text, width) = (text.trim_end().to_owned() + "\n     ", 5);
            }
            width += number.len();
            text += &number;
        }
        text + "},\n"
    };
    let width = rows.first().map_or(0, Vec::len);
    let body: String = rows.iter().map(row).collect();
    format!("static const double replayed_{name}[{}][{width}] = {{\n{body}}};\n\n", rows.len())
}

const COMPARED: &str = "\
/* The largest difference so far, and where it is. */
static double apart;
static const char *worst = \"\";

static void compare(const char *name, double found, double expected, double largest)
{
    const double difference = fabs(found - expected) / (largest > 0.0 ? largest : 1.0);
    /* One that is no number stays the largest. */
    if (apart == apart && !(difference <= apart)) {
        apart = difference;
        worst = name;
    }
}

";

/// A function that compares a struct with a row.
fn compared(what: &str, members: &Members) -> String {
    let mut lines = String::new();
    for member in members.list.iter().filter(|member| member.is_real) {
        let line = format!("compare(\"{}\", (double)found->@, *expected++, *largest++);", member.name);
        lines += &member.each(&line);
    }
    format!(
        "static void compare_{what}(const §_{what} *found, const double *expected, const double *largest)\n{{\n{lines}}}\n\n"
    )
}

fn main(law: &Law, structs: &Structs, (has_inputs, has_states): (bool, bool)) -> String {
    let mut text = String::from("int main(void)\n{\n    static § law;\n");
    if !structs.inputs.is_empty() {
        text += "    §_inputs in;\n    memset(&in, 0, sizeof in);\n";
        for (name, value) in structs.inputs.integers_at(&law.start.integers) {
            let _ = writeln!(text, "    in.{name} = {value};");
        }
    }
    text += "    §_outputs out;\n    §_init(&law);\n    for (int step = 0; step < §_REPLAY_STEPS; step++) {\n";
    let step = if structs.inputs.is_empty() { "§_step(&law, &out)" } else { "§_step(&law, &in, &out)" };
    if has_inputs {
        text += "        const double *row = replayed_inputs[step];\n";
        let real = |member: &&super::members::Member| member.is_real;
        for line in structs.inputs.list.iter().filter(real).map(|member| member.each("in.@ = (§_real)*row++;")) {
            line.lines().for_each(|line| _ = writeln!(text, "    {line}"));
        }
    }
    let _ = write!(
        text,
        "        const §_status status = {step};\n        if ((status & §_REFUSED) != 0) {{\n            printf(\"§: step %d is \
         refused, status 0x%lx\\n\", step, (unsigned long)status);\n            return 1;\n        }}\n        \
         compare_outputs(&out, replayed_outputs[step], replayed_largest_outputs[0]);\n    }}\n"
    );
    if has_states {
        text += "    compare_states(&law.x, replayed_states[0], replayed_largest_states[0]);\n";
    }
    if let Some((first, _)) = structs.inputs.reals().next() {
        let _ = write!(
            text,
            "    in.{first} = (§_real)NAN;\n    if (({step} & §_BAD_INPUT) == 0) {{\n        printf(\"§: an input that is no number is \
             taken\\n\");\n        return 1;\n    }}\n"
        );
    }
    text + "    const int passed = apart <= §_REPLAY_ALLOWED;\n    printf(\"§: %s, %d steps are apart by %.1e (%s), %.0e is allowed; %u bytes a \
            controller\\n\",\n        passed ? \"passed\" : \"failed\", §_REPLAY_STEPS, apart, worst, §_REPLAY_ALLOWED, (unsigned)sizeof law);\n    return passed ? 0 : 1;\n}\n"
}
