//! NAME.c: the equations of a law, its driver, and the functions of the header.

use super::driver::{self, Driver};
use super::functions::Structs;
use super::law::Law;
use super::{equations, interface};

/// The whole file.
pub(super) fn write(law: &Law, structs: &Structs, name: &str) -> String {
    let driver = Driver::of(law, structs);
    let functions = [
        equations::write(law, structs, &driver),
        driver::write(law, structs, &driver),
        interface::write(law, structs, &driver),
    ]
    .concat();
    let text = format!(
        "/* {name}: see {name}.h. Generated from the recorded equations of the FMU of that name. */\n\n#include \"{name}.h\"\n\n\
         #include <float.h>\n#include <math.h>\n#include <string.h>\n\n{MACROS}{}{}{functions}{END}",
        structs.signals.declaration(&[], "real"),
        helpers(&functions)
    );
    text.replace('§', name).replace("READY", &format!("UINT32_C(0x{:08x})", ready(law)))
}

const MACROS: &str = "\
#if defined(__FAST_MATH__)
#error \"-ffast-math takes away the checks of inputs and outputs for NaN and infinity\"
#endif
#if defined(__STDC_VERSION__) && !defined(__GNUC__) || defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

/* Numbers of this file: R(x) is a constant, F(name) a function of <math.h>. */
#define real §_real
#ifdef §_FLOAT
#define R(x) x##f
#define F(name) name##f
#define LARGE(x) FLT_MAX
#define SMALL(x) FLT_MIN
#else
#define R(x) x
#define F(name) name
#define LARGE(x) x
#define SMALL(x) x
#endif

";

const END: &str = "\
#undef real
#undef R
#undef F
#undef LARGE
#undef SMALL
";

/// Functions that equations call: names, and what they do.
const HELPERS: [(&str, &str); 4] = [
    (
        "sign",
        "/* 1 with the sign of the number. */\nstatic real §_sign(real number)\n{\n    return F(copysign)(R(1.0), number);\n}\n\n",
    ),
    (
        "wrapped",
        "/* The angle within (-pi, pi] that differs from one by whole turns. */\nstatic real §_wrapped(real angle)\n{\n    const \
         real half = R(3.141592653589793);\n    const real turn = R(6.283185307179586);\n    const real rest = \
         F(fmod)(angle, turn);\n    if (rest > half) {\n        return rest - turn;\n    }\n    return rest <= -half ? rest + \
         turn : rest;\n}\n\n",
    ),
    (
        "whole",
        "/* The integer that a number is, within what int32_t holds. */\nstatic int32_t §_whole(real number)\n{\n    if (number \
         <= R(-2147483648.0)) {\n        return INT32_MIN;\n    }\n    return number >= R(2147483647.0) ? INT32_MAX : \
         (int32_t)number;\n}\n\n",
    ),
    (
        "power",
        "/* A power with a whole exponent, by squares. */\nstatic real §_power(real base, int exponent)\n{\n    real product = \
         R(1.0);\n    const bool inverse = exponent < 0;\n    for (;;) {\n        if (exponent % 2 != 0) {\n            product \
         *= base;\n        }\n        exponent /= 2;\n        if (exponent == 0) {\n            return inverse ? R(1.0) / \
         product : product;\n        }\n        base *= base;\n    }\n}\n\n",
    ),
];

/// Those that a text calls.
fn helpers(text: &str) -> String {
    let calls = |name: &str| {
        let call = format!("{name}(");
        text.match_indices(&call).any(|(at, _)| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
    };
    HELPERS
        .iter()
        .filter(|(name, _)| calls(name))
        .map(|(name, text)| format!("{text}#define {name} §_{name}\n\n"))
        .collect()
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
