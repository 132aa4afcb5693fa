//! The functions of the header.

use std::fmt::Write;

use super::Fallback;
use super::driver::{Driver, Writes};
use super::functions::{Structs, access, limits_of_control};
use super::header::limits;
use super::law::{ENABLED, Law, U_MANUAL};
use super::members::Member;
use crate::fmi2::source::expression::number;

/// All of them.
pub(super) fn write(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let mut text = String::new();
    if !structs.parameters.is_empty() {
        text += &defaults(law, structs);
        text += &calibrate(law, structs, driver);
    }
    let enabled = law.variables().find(ENABLED).filter(|of| law.is_manual(of.variable));
    let starts_enabled = enabled.is_none_or(|of| law.start.integers[law.variables().index(of)] != 0);
    let mut init = "    (void)memset(self, 0, sizeof *self);\n    self->ready = §_READY;\n".to_owned();
    if !structs.manual.is_empty() {
        init += &format!("    self->enabled = {starts_enabled};\n");
        for (to, place) in structs.manual.reals() {
            init += &format!("    self->manual.{to} = {};\n", number(law.start.reals[place]));
        }
    }
    if !structs.parameters.is_empty() {
        init += "    (void)§_calibrate(self, &§_defaults);\n";
    }
    let _ = write!(text, "void §_init(§ *self)\n{{\n{init}}}\n\n");
    text += &reset(structs, driver);
    if !structs.manual.is_empty() {
        text += "bool §_enable(§ *self, bool enabled, const §_manual *manual)\n{\n    const bool sound = \
                 §_manual_are_numbers(manual);\n    if (sound) {\n        self->enabled = enabled;\n        self->manual = \
                 *manual;\n    }\n    return sound;\n}\n\n";
    }
    text + &step(law, structs, driver)
}

fn reset(structs: &Structs, driver: &Driver) -> String {
    let mut lines = String::new();
    let mut line = |is: bool, text: &str| {
        if is {
            let _ = writeln!(lines, "    {text}");
        }
    };
    line(!structs.states.is_empty(), "(void)memset(&self->x, 0, sizeof self->x);");
    line(driver.has_discrete, "(void)memset(&self->d, 0, sizeof self->d);");
    line(driver.holds, "(void)memset(&self->last, 0, sizeof self->last);");
    line(driver.counts_steps, "self->steps = 0;");
    line(true, "self->refused = 0;");
    line(true, "self->started = false;");
    line(driver.has_changes, "self->calibrated = false;");
    format!("void §_reset(§ *self)\n{{\n{lines}}}\n\n")
}

/// The parameters of the export.
fn defaults(law: &Law, structs: &Structs) -> String {
    let mut text = "const §_parameters §_defaults = {\n".to_owned();
    for member in &structs.parameters.list {
        let values: Vec<String> = member
            .elements
            .iter()
            .filter_map(|name| law.variables().find(name))
            .map(|element| {
                let place = law.variables().index(element);
                if member.is_real { number(law.start.reals[place]) } else { law.start.integers[place].to_string() }
            })
            .collect();
        let values = if values.len() > 1 { format!("{{ {} }}", values.join(", ")) } else { values.join("") };
        let _ = writeln!(text, "    {values}, /* {} */", member.name);
    }
    text + "};\n\n"
}

/// Functions that check real parameters, by their names, and how they compare with the lower limit.
const CHECKS: [(&str, &str, &str); 2] = [
    ("are_from", ">=", "True if these are numbers from the least to the most."),
    ("are_above", ">", "True if these are numbers above a limit, up to the most."),
];

/// The functions that checks call.
fn checking(checks: &str) -> String {
    let called = CHECKS.iter().filter(|(name, ..)| checks.contains(&format!("§_{name}(")));
    let written = |(name, compares, what): &(&str, &str, &str)| {
        format!(
            "/* {what} */\nONCE static bool §_{name}(const real *numbers, int count, real least, real most)\n{{\n    for (int i = 0; i < \
             count; i++) {{\n        if (!(numbers[i] {compares} least && numbers[i] <= most)) {{\n            return \
             false;\n        }}\n    }}\n    return true;\n}}\n\n"
        )
    };
    called.map(written).collect()
}

/// A line that refuses values of a parameter beyond its limits.
fn check(law: &Law, member: &Member) -> Option<String> {
    let (min, above, max) = limits(law, member)?;
    let bad = format!("{{ return §_BAD_{}; }}", member.capitals);
    if member.is_real {
        let (name, ..) = CHECKS[usize::from(above && min.is_some())];
        let [least, most] = [min.map_or("-LARGEST".to_owned(), number), max.map_or("LARGEST".to_owned(), number)];
        let numbers = if member.is_array() { "p->" } else { "&p->" };
        let count = member.elements.len();
        return Some(format!("    if (!§_{name}({numbers}{}, {count}, {least}, {most})) {bad}\n", member.name));
    }
    let min = min.map(|min| format!("p->@ >= {}", min as i64));
    let parts: Vec<String> = min.into_iter().chain(max.map(|max| format!("p->@ <= {}", max as i64))).collect();
    Some(member.each(&format!("if (!({})) {bad}", parts.join(" && "))))
}

fn calibrate(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let checks: String = structs.parameters.list.iter().filter_map(|member| check(law, member)).collect();
    let (declared, called, taken) = if structs.prepared.is_empty() {
        ("", "§_prepare(p)", "")
    } else {
        // Compilers don't see that it is written wherever it is taken.
        ("    §_prepared r;\n    r = self->r;\n", "§_prepare(p, &r)", "    self->r = r;\n")
    };
    let relations = if law.refusals(&law.recorded.relate).is_empty() {
        format!("    (void){called};\n")
    } else {
        format!(
            "    const int relation = {called};\n    if (relation != 0) {{\n        return (§_calibration)((int)§_BAD_RELATION_1 + \
             relation - 1);\n    }}\n"
        )
    };
    let changed = if driver.has_changes { "    self->calibrated = true;\n" } else { "" };
    let functions = checking(&checks);
    format!(
        "{functions}§_calibration §_calibrate(§ *self, const §_parameters *p)\n{{\n{declared}{checks}{relations}    self->p = \
         *p;\n{taken}{changed}    return §_CALIBRATED;\n}}\n\n"
    )
}

fn step(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let mut locals = String::new();
    let mut taken = String::new();
    let mut both = |is: bool, kind: &str, name: &str| {
        if is {
            let _ = writeln!(locals, "    §_{kind} {name} = self->{name};");
            let _ = writeln!(taken, "        self->{name} = {name};");
        }
    };
    both(driver.has_states, "states", "x");
    both(driver.has_discrete, "discrete", "d");
    if driver.has_signals {
        locals += "    §_signals y;\n";
    }
    let called = driver.called(law, Writes::State, "&x", "");
    let called = called.replace(", d", ", &d").replace(", y", ", &y");
    let called = called.strip_suffix(", ").unwrap_or(&called).to_owned();
    let advance = format!("§_advance({called}, &given)");
    let status = if structs.inputs.is_empty() {
        format!("    status = {advance};\n")
    } else {
        format!(
            "    if (§_inputs_are_numbers(in)) {{\n        status = {advance};\n    }} else {{\n        status = §_REFUSED | §_BAD_INPUT;\n    }}\n"
        )
    };
    if driver.holds {
        taken += "        self->last = given;\n";
    }
    if driver.counts_steps {
        taken += "        self->steps++;\n";
    }
    if driver.has_changes {
        taken += "        self->calibrated = false;\n";
    }
    taken += "        self->started = true;\n        *out = given;\n";
    let fallback = match law.fallback {
        Fallback::Hold => "        *out = self->last;\n".to_owned(),
        Fallback::Zero => "        (void)memset(out, 0, sizeof *out);\n".to_owned(),
        Fallback::Manual => by_hand(law, structs),
    };
    let inputs = if structs.inputs.is_empty() { "" } else { "const §_inputs *in, " };
    format!(
        "§_status §_step(§ *self, {inputs}§_outputs *out)\n{{\n    if (self->ready != §_READY) {{\n        (void)memset(out, 0, \
         sizeof *out);\n        return §_REFUSED | §_NOT_INITIALISED;\n    }}\n    §_status status;\n    §_outputs \
         given;\n{locals}    (void)memset(&given, 0, sizeof given);\n{status}    if ((status & §_REFUSED) == 0) \
         {{\n{taken}    }} else {{\n{fallback}        self->refused += self->refused < UINT32_MAX ? UINT32_C(1) : UINT32_C(0);\n    }}\n    \
         return status;\n}}\n\n"
    )
}

/// The manual control within the limits of the control; other outputs are 0.
fn by_hand(law: &Law, structs: &Structs) -> String {
    let of_control = |place: usize| {
        let k = law.control(place)?;
        let manual = law.variables().iter().find(|v| v.name == U_MANUAL)?;
        let manual = access(structs, law.variables().index(manual.element(k)), true, "")?;
        let [min, max] = limits_of_control(law, structs, k);
        let from_below = min.map_or(manual.clone(), |min| format!("{manual} < {min} ? {min} : {manual}"));
        Some(max.map_or(from_below.clone(), |max| format!("{manual} > {max} ? {max} : {from_below}")))
    };
    let line = |(to, place): (&String, usize)| {
        format!("        out->{to} = {};\n", of_control(place).unwrap_or_else(|| number(0.0)))
    };
    structs.outputs.reals().map(line).collect()
}
