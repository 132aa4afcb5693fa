//! The integration of a controller's states in C: a period by Runge-Kutta steps of order 4.

use super::driver::{Driver, Writes, declared_with_signals, indented};
use super::functions::Structs;
use super::law::Law;
use super::members::each;

/// The functions of the integration.
pub(super) fn write(law: &Law, structs: &Structs, driver: &Driver) -> String {
    if driver.has_states { loops(structs) + &integrate(law, driver) } else { String::new() }
}

/// Operations on all states: each number is read once for all that is done with it.
fn loops(structs: &Structs) -> String {
    let states = |lines: &[&str]| each(&structs.states.list, lines);
    format!(
        "/* The states h further along these rates. */\nstatic void §_along(const §_states *from, real h, const §_states *rates, \
         §_states *to)\n{{\n{}}}\n\n/* The same, with the rates of the middle of a step, which count twice in their sum. */\nstatic void \
         §_along_middle(const §_states *from, real h, const §_states *rates, §_states *to, §_states *sum)\n{{\n{}}}\n\n/* The \
         end of a step: a sixth of it along the sum and the last rates. */\nstatic void §_finish(§_states *x, real sixth, const \
         §_states *sum, const §_states *rates)\n{{\n{}}}\n\n",
        states(&["to->@ = from->@ + h * rates->@;"]),
        states(&["to->@ = from->@ + h * rates->@;", "sum->@ += R(2.0) * rates->@;"]),
        states(&["x->@ += sixth * (sum->@ + rates->@);"]),
    )
}

/// Events at the end of a Runge-Kutta step, where they are looked for there.
fn events(law: &Law, driver: &Driver, find: &str) -> String {
    if !(driver.has_events && law.events_within) {
        return String::new();
    }
    let called = driver.called(law, Writes::State, "x", "begin + h");
    let again = if find.is_empty() {
        String::new()
    } else {
        format!("        if (events > 0) {{\n{}        }}\n", indented(&indented(find)))
    };
    format!(
        "        const int events = §_settle({called});\n        if (events < 0) {{\n            return \
         1;\n        }}\n{again}"
    )
}

/// A period by Runge-Kutta steps of order 4.
fn integrate(law: &Law, driver: &Driver) -> String {
    let begins = if law.reads_time { "const real begin = t + (real)k * h;\n        " } else { "" };
    let rates = |x: &str, to: &str, later: &str| {
        let t = format!("begin{later}");
        let called = driver.called(law, Writes::Rates, x, &t);
        format!("§_rates({});", called.strip_suffix("dx").unwrap_or(&called).to_owned() + to)
    };
    let find = match law.constants[..] {
        [] => String::new(),
        _ => format!("    §_find_constants({});\n", driver.called(law, Writes::Constants, "x", "t")),
    };
    let events = events(law, driver, &find);
    let y = if driver.has_signals { declared_with_signals(driver, law) } else { driver.declared(law, Writes::State) };
    let unused = if driver.has_signals && events.is_empty() { "    (void)y;\n" } else { "" };
    let constants = if find.is_empty() { "" } else { ", §_constants *c" };
    format!(
        "/* One period by Runge-Kutta steps of order 4, inputs constant; not 0 where events don't end. */\nstatic int \
         §_integrate({y}{constants})\n{{\n    const real h = R({:?}) / (real)§_SUBSTEPS;\n{unused}{find}    for (int k = 0; k < §_SUBSTEPS; k++) {{\n        \
         {begins}§_states rates;\n        §_states sum;\n        §_states to;\n        {}\n        §_along(x, R(0.5) * h, &sum, &to);\n        {}\n        \
         §_along_middle(x, R(0.5) * h, &rates, &to, &sum);\n        {}\n        §_along_middle(x, h, &rates, &to, &sum);\n        \
         {}\n        §_finish(x, h / R(6.0), &sum, &rates);\n{events}    }}\n    return 0;\n}}\n\n",
        law.period,
        rates("x", "&sum", ""),
        rates("&to", "&rates", " + R(0.5) * h"),
        rates("&to", "&rates", " + R(0.5) * h"),
        rates("&to", "&rates", " + h"),
    )
}
