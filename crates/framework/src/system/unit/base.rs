//! Texts of units, as `kg.m2/s2`, `rpm` or `degC`, in base units.
//!
//! Definitions: The International System of Units, 9th edition (BIPM, 2019); NIST Special Publication 811 for those outside
//! of it. The texts are those of FMI and Modelica, and what people write in their place: `m/s^2`, `N*m`, `m³/h`, `Ω`.

use super::Unit;

/// Base units, in the order of exponents.
pub const BASE_UNITS: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];

/// A unit in base units: a value there is factor · value + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Base {
    /// Exponents of kg, m, s, A, K, mol, cd and rad.
    pub exponents: [i32; 8],
    /// Factor.
    pub factor: f64,
    /// Offset.
    pub offset: f64,
}

/// A unit of a name of its own.
struct Named {
    symbol: &'static str,
    /// True if it takes prefixes.
    metric: bool,
    /// Its factor as a fraction, so that it is rounded once.
    fraction: (f64, f64),
    offset: f64,
    exponents: [i32; 8],
}

const fn si(symbol: &'static str, exponents: [i32; 8]) -> Named {
    Named { symbol, metric: true, fraction: (1.0, 1.0), offset: 0.0, exponents }
}

const fn metric(symbol: &'static str, fraction: (f64, f64), exponents: [i32; 8]) -> Named {
    Named { symbol, metric: true, fraction, offset: 0.0, exponents }
}

const fn other(symbol: &'static str, fraction: (f64, f64), exponents: [i32; 8]) -> Named {
    Named { symbol, metric: false, fraction, offset: 0.0, exponents }
}

const fn temperature(symbol: &'static str, fraction: (f64, f64), offset: f64) -> Named {
    Named { symbol, metric: false, fraction, offset, exponents: TEMPERATURE }
}

const NUMBER: [i32; 8] = [0; 8];
const MASS: [i32; 8] = [1, 0, 0, 0, 0, 0, 0, 0];
const LENGTH: [i32; 8] = [0, 1, 0, 0, 0, 0, 0, 0];
const AREA: [i32; 8] = [0, 2, 0, 0, 0, 0, 0, 0];
const VOLUME: [i32; 8] = [0, 3, 0, 0, 0, 0, 0, 0];
const TIME: [i32; 8] = [0, 0, 1, 0, 0, 0, 0, 0];
const FREQUENCY: [i32; 8] = [0, 0, -1, 0, 0, 0, 0, 0];
const VELOCITY: [i32; 8] = [0, 1, -1, 0, 0, 0, 0, 0];
const TEMPERATURE: [i32; 8] = [0, 0, 0, 0, 1, 0, 0, 0];
const ANGLE: [i32; 8] = [0, 0, 0, 0, 0, 0, 0, 1];
const ROTATION: [i32; 8] = [0, 0, -1, 0, 0, 0, 0, 1];
const FORCE: [i32; 8] = [1, 1, -2, 0, 0, 0, 0, 0];
const PRESSURE: [i32; 8] = [1, -1, -2, 0, 0, 0, 0, 0];
const ENERGY: [i32; 8] = [1, 2, -2, 0, 0, 0, 0, 0];
const POWER: [i32; 8] = [1, 2, -3, 0, 0, 0, 0, 0];
const CHARGE: [i32; 8] = [0, 0, 1, 1, 0, 0, 0, 0];
const DOSE: [i32; 8] = [0, 2, -2, 0, 0, 0, 0, 0];

const TURN: f64 = std::f64::consts::TAU;
/// Pound, kg, and standard gravity, m/s².
const POUND: f64 = 0.45359237;
const GRAVITY: f64 = 9.80665;

/// All names but those that a prefix makes.
const NAMED: &[Named] = &[
    metric("g", (1.0, 1e3), MASS),
    si("m", LENGTH),
    si("s", TIME),
    si("A", [0, 0, 0, 1, 0, 0, 0, 0]),
    si("K", TEMPERATURE),
    si("mol", [0, 0, 0, 0, 0, 1, 0, 0]),
    si("cd", [0, 0, 0, 0, 0, 0, 1, 0]),
    si("rad", ANGLE),
    si("sr", [0, 0, 0, 0, 0, 0, 0, 2]),
    si("Hz", FREQUENCY),
    si("N", FORCE),
    si("Pa", PRESSURE),
    si("J", ENERGY),
    si("W", POWER),
    si("VA", POWER),
    si("var", POWER),
    si("C", CHARGE),
    si("V", [1, 2, -3, -1, 0, 0, 0, 0]),
    si("F", [-1, -2, 4, 2, 0, 0, 0, 0]),
    si("Ohm", [1, 2, -3, -2, 0, 0, 0, 0]),
    si("ohm", [1, 2, -3, -2, 0, 0, 0, 0]),
    si("Ω", [1, 2, -3, -2, 0, 0, 0, 0]),
    si("S", [-1, -2, 3, 2, 0, 0, 0, 0]),
    si("Wb", [1, 2, -2, -1, 0, 0, 0, 0]),
    si("T", [1, 0, -2, -1, 0, 0, 0, 0]),
    si("H", [1, 2, -2, -2, 0, 0, 0, 0]),
    si("lm", [0, 0, 0, 0, 0, 0, 1, 2]),
    si("lx", [0, -2, 0, 0, 0, 0, 1, 2]),
    si("Bq", FREQUENCY),
    si("Gy", DOSE),
    si("Sv", DOSE),
    si("kat", [0, 0, -1, 0, 0, 1, 0, 0]),
    metric("l", (1.0, 1e3), VOLUME),
    metric("L", (1.0, 1e3), VOLUME),
    metric("bar", (1e5, 1.0), PRESSURE),
    metric("eV", (1.602176634e-19, 1.0), ENERGY),
    metric("cal", (4184.0, 1e3), ENERGY),
    metric("Wh", (3600.0, 1.0), ENERGY),
    metric("Ah", (3600.0, 1.0), CHARGE),
    metric("P", (1.0, 10.0), [1, -1, -1, 0, 0, 0, 0, 0]),
    metric("St", (1.0, 1e4), [0, 2, -1, 0, 0, 0, 0, 0]),
    other("%", (1.0, 100.0), NUMBER),
    other("‰", (1.0, 1e3), NUMBER),
    other("ppm", (1.0, 1e6), NUMBER),
    other("ppb", (1.0, 1e9), NUMBER),
    other("deg", (TURN, 360.0), ANGLE),
    other("°", (TURN, 360.0), ANGLE),
    other("arcmin", (TURN, 21_600.0), ANGLE),
    other("arcsec", (TURN, 1_296_000.0), ANGLE),
    other("gon", (TURN, 400.0), ANGLE),
    other("grad", (TURN, 400.0), ANGLE),
    other("rev", (TURN, 1.0), ANGLE),
    other("r", (TURN, 1.0), ANGLE),
    other("turn", (TURN, 1.0), ANGLE),
    other("rpm", (TURN, 60.0), ROTATION),
    other("rps", (TURN, 1.0), ROTATION),
    temperature("degC", (1.0, 1.0), 273.15),
    temperature("°C", (1.0, 1.0), 273.15),
    temperature("Cel", (1.0, 1.0), 273.15),
    temperature("degF", (5.0, 9.0), 229_835.0 / 900.0),
    temperature("°F", (5.0, 9.0), 229_835.0 / 900.0),
    temperature("degR", (5.0, 9.0), 0.0),
    other("min", (60.0, 1.0), TIME),
    other("h", (3600.0, 1.0), TIME),
    other("d", (86_400.0, 1.0), TIME),
    other("kph", (1e3, 3600.0), VELOCITY),
    other("mph", (1609.344, 3600.0), VELOCITY),
    other("kn", (1852.0, 3600.0), VELOCITY),
    other("in", (254.0, 1e4), LENGTH),
    other("ft", (3048.0, 1e4), LENGTH),
    other("yd", (9144.0, 1e4), LENGTH),
    other("mi", (1609.344, 1.0), LENGTH),
    other("nmi", (1852.0, 1.0), LENGTH),
    other("ha", (1e4, 1.0), AREA),
    other("t", (1e3, 1.0), MASS),
    other("lb", (POUND, 1.0), MASS),
    other("lbm", (POUND, 1.0), MASS),
    other("oz", (POUND, 16.0), MASS),
    other("slug", (POUND * GRAVITY, 0.3048), MASS),
    other("lbf", (POUND * GRAVITY, 1.0), FORCE),
    other("kgf", (GRAVITY, 1.0), FORCE),
    other("kp", (GRAVITY, 1.0), FORCE),
    other("dyn", (1.0, 1e5), FORCE),
    other("erg", (1.0, 1e7), ENERGY),
    other("atm", (101_325.0, 1.0), PRESSURE),
    other("Torr", (101_325.0, 760.0), PRESSURE),
    other("mmHg", (133.322387415, 1.0), PRESSURE),
    other("psi", (POUND * GRAVITY, 0.0254 * 0.0254), PRESSURE),
    other("hp", (550.0 * 0.3048 * POUND * GRAVITY, 1.0), POWER),
    other("PS", (75.0 * GRAVITY, 1.0), POWER),
];

/// Prefixes with their powers of ten.
const PREFIXES: &[(&str, i32)] = &[
    ("da", 1),
    ("y", -24),
    ("z", -21),
    ("a", -18),
    ("f", -15),
    ("p", -12),
    ("n", -9),
    ("u", -6),
    ("µ", -6),
    ("m", -3),
    ("c", -2),
    ("d", -1),
    ("h", 2),
    ("k", 3),
    ("M", 6),
    ("G", 9),
    ("T", 12),
    ("P", 15),
    ("E", 18),
    ("Z", 21),
    ("Y", 24),
];

/// The largest exponent of a unit.
const LARGEST_EXPONENT: i32 = 20;
/// Deepest nesting of parentheses.
const DEEPEST: usize = 8;

impl Base {
    /// A number without a unit.
    pub const ONE: Base = Base { exponents: NUMBER, factor: 1.0, offset: 0.0 };

    /// The unit of a text; none where it isn't known, or can be read in two ways, as `J/kg.K`.
    pub fn of(text: &str) -> Option<Base> {
        if text == "-" {
            return Some(Base::ONE);
        }
        if !Unit::is_text(text) || text.is_empty() {
            return None;
        }
        // Signs that look alike.
        let text = text.replace('\u{3bc}', "µ").replace('\u{2126}', "Ω").replace("**", "^");
        if let Some(Named { fraction: (over, under), offset, exponents, .. }) = named(&text) {
            return Some(Base { exponents: *exponents, factor: over / under, offset: *offset });
        }
        let mut reader = Reader { rest: &text, depth: 0 };
        let Product { exponents, fraction: (over, under) } = reader.quotient()?;
        let factor = over / under;
        let is_unit = reader.rest.is_empty() && factor.is_finite() && factor > 0.0;
        is_unit.then_some(Base { exponents, factor, offset: 0.0 })
    }

    /// True if it is a plain number.
    pub fn is_number(&self) -> bool {
        *self == Base::ONE
    }
}

/// The symbols of units of a name of their own.
pub(super) fn symbols() -> impl Iterator<Item = &'static str> {
    NAMED.iter().map(|named| named.symbol)
}

fn named(symbol: &str) -> Option<&'static Named> {
    NAMED.iter().find(|named| named.symbol == symbol)
}

/// A product of units; a temperature in it is a difference of temperatures.
#[derive(Clone, Copy)]
struct Product {
    exponents: [i32; 8],
    fraction: (f64, f64),
}

impl Product {
    fn times(self, next: Product) -> Product {
        // Beyond all sense, and within what a number holds: no unit of such a dimension converts to another.
        let exponents = std::array::from_fn(|k| self.exponents[k].saturating_add(next.exponents[k]));
        Product { exponents, fraction: (self.fraction.0 * next.fraction.0, self.fraction.1 * next.fraction.1) }
    }

    fn to_the(self, power: i32) -> Product {
        let (over, under) = if power < 0 { (self.fraction.1, self.fraction.0) } else { self.fraction };
        let fraction = (over.powi(power.abs()), under.powi(power.abs()));
        Product { exponents: self.exponents.map(|n| n.saturating_mul(power)), fraction }
    }

    /// The unit of a symbol with its prefix, if it has one.
    fn of(symbol: &str) -> Option<Product> {
        if let Some(Named { exponents, fraction, .. }) = named(symbol) {
            return Some(Product { exponents: *exponents, fraction: *fraction });
        }
        PREFIXES.iter().find_map(|&(prefix, power)| {
            let unit = named(symbol.strip_prefix(prefix)?).filter(|unit| unit.metric)?;
            let ten = Product { exponents: NUMBER, fraction: (10.0, 1.0) };
            Some(Product { exponents: unit.exponents, fraction: unit.fraction }.times(ten.to_the(power)))
        })
    }
}

/// Reads quotients of products of powers from left to right.
struct Reader<'a> {
    rest: &'a str,
    depth: usize,
}

impl Reader<'_> {
    fn eat(&mut self, signs: &[char]) -> bool {
        let rest = self.rest.strip_prefix(signs);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    /// A product over single powers. `a/b.c` stays unread: to some it is a.c/b, to others a/(b.c).
    fn quotient(&mut self) -> Option<Product> {
        let mut product = self.power()?;
        while self.eat(&['.', '*', '·', '⋅', ' ']) {
            product = product.times(self.power()?);
        }
        while self.eat(&['/']) {
            product = product.times(self.power()?.to_the(-1));
        }
        Some(product)
    }

    fn power(&mut self) -> Option<Product> {
        let unit = if self.eat(&['(']) {
            self.depth += 1;
            let inner = (self.depth <= DEEPEST).then(|| self.quotient())??;
            self.depth -= 1;
            self.eat(&[')']).then_some(inner)?
        } else if self.eat(&['1']) {
            let next = self.rest.chars().next();
            return next
                .is_none_or(|c| "./*·⋅ )".contains(c))
                .then_some(Product { exponents: NUMBER, fraction: (1.0, 1.0) });
        } else {
            let is_symbol = |c: char| c.is_alphabetic() || "%‰°_".contains(c);
            let end = self.rest.find(|c: char| !is_symbol(c)).unwrap_or(self.rest.len());
            let (symbol, rest) = self.rest.split_at(end);
            self.rest = rest;
            Product::of(symbol)?
        };
        Some(unit.to_the(self.exponent()?))
    }

    /// A whole number, as `2`, `-1`, `^2` or `³`; 1 where there is none.
    fn exponent(&mut self) -> Option<i32> {
        const RAISED: &str = "⁰¹²³⁴⁵⁶⁷⁸⁹";
        let marked = self.eat(&['^']);
        let parenthesis = marked && self.eat(&['(']);
        let negative = self.eat(&['-', '⁻']);
        let signed = negative || self.eat(&['+']);
        let mut digits = String::new();
        while let Some(c) = self.rest.chars().next() {
            let raised = RAISED.chars().position(|raised| raised == c).and_then(|n| char::from_digit(n as u32, 10));
            let Some(digit) = Some(c).filter(char::is_ascii_digit).or(raised) else { break };
            digits.push(digit);
            self.rest = &self.rest[c.len_utf8()..];
        }
        if parenthesis && !self.eat(&[')']) {
            return None;
        }
        if digits.is_empty() {
            return (!marked && !signed).then_some(1);
        }
        let exponent: i32 = digits.parse().ok().filter(|n| *n <= LARGEST_EXPONENT)?;
        Some(if negative { -exponent } else { exponent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factor(text: &str) -> f64 {
        Base::of(text).unwrap_or_else(|| panic!("{text}")).factor
    }

    fn exponents(text: &str) -> [i32; 8] {
        Base::of(text).unwrap_or_else(|| panic!("{text}")).exponents
    }

    #[test]
    fn factors_are_those_of_their_definitions_rounded_once() {
        use std::f64::consts::PI;
        let definitions = [
            ("rpm", PI / 30.0),
            ("deg", PI / 180.0),
            ("km/h", 1e3 / 3600.0),
            ("mm", 1e-3),
            ("um", 1e-6),
            ("kPa", 1e3),
            ("mbar", 100.0),
            ("%", 0.01),
            ("mH", 1e-3),
            ("kWh", 3.6e6),
            ("l/min", 1e-3 / 60.0),
            ("in", 0.0254),
            ("ft", 0.3048),
            ("mph", 0.44704),
            ("g", 1e-3),
            ("mg", 1e-6),
            ("cm2", 1e-4),
            ("1/min", 1.0 / 60.0),
            ("kOhm", 1e3),
            ("m", 1.0),
        ];
        for (text, factor) in definitions {
            assert_eq!(self::factor(text), factor, "{text}");
        }
        assert!((factor("psi") / 6894.757293168361 - 1.0).abs() < 1e-15);
        assert!((factor("hp") / 745.6998715822702 - 1.0).abs() < 1e-15);
    }

    #[test]
    fn texts_that_mean_the_same_are_the_same() {
        let same = [
            ["kg.m2/s2", "J", "N.m", "W.s", "kg.m2.s-2"],
            ["m/s2", "m/s^2", "m.s-2", "m/s/s", "m·s⁻²"],
            ["N.m/rad", "N*m/rad", "N m/rad", "N⋅m/rad", "N.m.rad-1"],
            ["m3/h", "m³/h", "m^3/h", "m**3/h", "m3.h-1"],
            ["J/(kg.K)", "J/kg/K", "J.kg-1.K-1", "J/(kg*K)", "J/(kg.degC)"],
            ["ohm", "Ohm", "Ω", "\u{2126}", "V/A"],
            ["us", "µs", "\u{3bc}s", "us1", "us^1"],
            ["rpm", "rev/min", "r/min", "turn/min", "rev.min-1"],
            ["1", "-", "1/1", "m/m", "(1)"],
        ];
        for texts in same {
            for text in texts {
                let (one, another) = (Base::of(texts[0]).unwrap(), Base::of(text).unwrap_or_else(|| panic!("{text}")));
                assert_eq!(one.exponents, another.exponents, "{text}");
                assert!((one.factor / another.factor - 1.0).abs() < 1e-15 && one.offset == another.offset, "{text}");
            }
        }
    }

    #[test]
    fn an_angle_is_a_dimension_and_a_cycle_is_none() {
        assert_eq!(exponents("rpm"), exponents("rad/s"));
        assert_ne!(exponents("Hz"), exponents("rad/s"));
        assert_eq!(exponents("Hz"), exponents("1/min"));
        assert!(Base::of("1").unwrap().is_number() && !Base::of("%").unwrap().is_number());
        assert!(!Base::of("rad").unwrap().is_number());
    }

    #[test]
    fn temperatures_have_an_offset_and_their_differences_none() {
        let celsius = Base::of("degC").unwrap();
        assert_eq!((celsius.factor, celsius.offset), (1.0, 273.15));
        let fahrenheit = Base::of("degF").unwrap();
        assert!((212.0 * fahrenheit.factor + fahrenheit.offset - 373.15).abs() < 1e-12);
        for difference in ["W/degC", "degC/s", "(degC)", "degC1"] {
            assert_eq!(Base::of(difference).unwrap().offset, 0.0, "{difference}");
        }
    }

    #[test]
    fn the_unit_comes_before_the_prefix() {
        let distinct = [("min", "s", 60.0), ("cd", "cd", 1.0), ("Pa", "Pa", 1.0), ("ha", "m2", 1e4), ("dm", "m", 0.1)];
        for (text, base, factor) in distinct {
            assert_eq!((exponents(text), self::factor(text)), (exponents(base), factor), "{text}");
        }
        assert_eq!(exponents("mT"), exponents("T"));
        assert_eq!(factor("dam"), 10.0);
    }

    #[test]
    fn what_is_not_known_or_has_two_meanings_is_none() {
        for text in [
            "",
            "furlong",
            "J/kg.K",
            "kmin",
            "mdeg",
            "m^",
            "m--1",
            "10",
            "1e3",
            "m^0.5",
            "m/",
            "/s",
            "(m",
            "m)",
            "m..s",
            " m",
            "dB",
            "m2x",
            "m99",
            "barg",
            "k",
            "m\n",
            "((((((((((m))))))))))",
            "2m",
            "^2",
            "m^(2",
        ] {
            assert_eq!(Base::of(text), None, "{text}");
        }
        assert_eq!(Base::of(&"m.".repeat(60)), None);
    }

    #[test]
    fn no_two_units_share_a_symbol() {
        for (k, one) in NAMED.iter().enumerate() {
            assert!(NAMED[..k].iter().all(|other| other.symbol != one.symbol), "{}", one.symbol);
        }
    }
}
