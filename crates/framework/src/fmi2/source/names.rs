//! Names in generated C: those of variables, as C can have them, each for one thing.

use std::collections::HashSet;

/// Words that C, its library and the functions around have for themselves, and those of C++, by which firmware is compiled, too.
const TAKEN: &str = "auto break case char const continue default do double else enum extern float for goto if inline int long \
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while real \
    t dt v n d z R F log messages step crossed slopes jacobian by_time i \
    acos acosh asin asinh atan atan2 atanh cabs carg cbrt ceil conj copysign cos cosh cpow creal erf erfc exp exp2 expm1 fabs \
    fdim floor fma fmax fmin fmod frexp gamma hypot ilogb index isinf isnan j0 j1 jn ldexp lgamma llrint llround log10 log1p \
    log2 logb lrint lround memchr memcmp memcpy memmove memset modf nan nearbyint nextafter pow power powl remainder \
    remquo rint round scalbln scalbn signbit significand sin sinh sqrt strcat strchr strcmp strcpy strlen strncat strncmp \
    strncpy tan tanh tgamma trunc y0 y1 yn abs labs div exit abort atexit free malloc calloc realloc printf puts time sign whole \
    wrapped wrapped_far turns noise uniform_number log_text refuse finite drem pow10 exp10 sincos ceill signals \
    alignas alignof and asm bitand bitor bool catch class compl concept constexpr const_cast decltype delete dynamic_cast explicit \
    export false friend mutable namespace new noexcept not nullptr operator or private protected public reinterpret_cast requires \
    static_assert static_cast template this thread_local throw true try typeid typename using virtual wchar_t xor \
    NAN INFINITY HUGE_VAL EOF NULL stdin stdout stderr errno M_E M_PI DBL_MAX DBL_MIN DBL_EPSILON FLT_MAX FLT_MIN FLT_EPSILON \
    INT_MAX INT_MIN LARGE LARGEST ONCE SMALL";

/// Names that were given in a function.
#[derive(Debug, Default)]
pub struct Names {
    taken: HashSet<String>,
}

impl Names {
    /// Names that differ from these words.
    pub fn other_than(words: &[&str]) -> Self {
        Names { taken: words.iter().map(|word| (*word).to_owned()).collect() }
    }

    /// A name for a variable of the unit, as near to its own as C allows.
    pub fn of(&mut self, variable: &str) -> String {
        let mut name: String = variable.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        while name.contains("__") {
            name = name.replace("__", "_");
        }
        let name = name.trim_matches('_');
        let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
        self.free(if begins { name.to_owned() } else { format!("x_{name}") })
    }

    /// A name that begins so, with a number behind it.
    pub fn numbered(&mut self, beginning: &str, number: usize) -> String {
        self.free(format!("{beginning}{number}"))
    }

    /// The name itself where it is free, else with a number behind it.
    fn free(&mut self, name: String) -> String {
        let is_free =
            |name: &str| !self.taken.contains(name) && !TAKEN.split_ascii_whitespace().any(|word| word == name);
        let numbered = (2..).map(|number| format!("{name}_{number}"));
        let found = std::iter::once(name.clone()).chain(numbered).find(|name| is_free(name)).unwrap_or(name);
        self.taken.insert(found.clone());
        found
    }
}
