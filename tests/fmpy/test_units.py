"""Units of measurement: what descriptions export, beside the definitions that the package pint has."""

import math
import zipfile
from pathlib import Path

import fmpy
import pint
import pytest
from conftest import adaptive_fmu
from lxml import etree

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"
BASE = {"kg": "kg", "m": "m", "s": "s", "A": "A", "K": "K", "mol": "mol", "cd": "cd", "rad": "rad"}
PREFIXES = "y z a f p n u m c d da h k M G T P E Z Y".split()
# A text, and its name in pint where that is another. What is per a temperature is per a difference there.
NAMES = {
    "ohm": "ohm", "Ohm": "ohm", "Ω": "ohm", "VA": "V*A", "var": "W", "l": "liter", "L": "liter", "Wh": "W*hour",
    "Ah": "A*hour", "P": "poise", "St": "stokes", "%": "1/100", "‰": "1/1000", "ppm": "1/1e6", "ppb": "1/1e9",
    "deg": "degree", "°": "degree", "gon": "gradian", "grad": "gradian", "arcmin": "arcminute", "arcsec": "arcsecond",
    "rev": "turn", "r": "turn", "rps": "turn/s", "rpm": "turn/minute", "min": "minute", "h": "hour", "d": "day", "kph": "km/hour",
    "mph": "mile/hour", "kn": "knot", "in": "inch", "ft": "foot", "yd": "yard", "mi": "mile", "nmi": "nautical_mile",
    "ha": "hectare", "t": "metric_ton", "lb": "pound", "lbm": "pound", "oz": "ounce", "kgf": "kilogram_force",
    "kp": "kilogram_force", "lbf": "pound_force", "dyn": "dyne", "Torr": "torr", "mmHg": "133.322387415*Pa",
    "hp": "horsepower", "PS": "75*kilogram_force*m/s", "bar": "bar", "eV": "electron_volt", "cal": "calorie", "Gy": "gray", "Sv": "sievert",
}  # fmt: skip
SAME = "m s A K mol cd rad g Hz N Pa J W C V F S Wb T H lm lx Bq kat turn slug erg atm psi".split()
METRIC = (
    "m s A K mol cd rad g Hz N Pa J W VA var C V F Ohm ohm Ω S Wb T H lm lx Bq Gy Sv kat l L bar eV cal Wh Ah P St".split()
)
COMPOUND = {
    "km/h": "km/hour", "kg.m2/s2": "kg*m**2/s**2", "N.m/rad": "N*m/rad", "J/(kg.K)": "J/kg/K", "1/min": "1/minute",
    "W/(m2.degC)": "W/m**2/kelvin", "m³/h": "m**3/hour", "l/min": "liter/minute", "kWh/d": "kW*hour/day",
    "lbf.ft": "pound_force*foot", "N*m*s^2": "N*m*s**2", "mV/us": "mV/us", "deg/s": "degree/s", "cm2": "cm**2", "rad.s-2": "rad/s**2",
}  # fmt: skip
# Where a prefix makes a unit of its own: candela, not centiday; minute; hectare; pascal, not petayear.
TAKEN = {"cd", "min", "ha", "Pa", "ft", "kat", "mol"}


def texts() -> dict[str, str]:
    """All texts, with what pint calls them."""
    plain = {name: name for name in SAME} | NAMES
    prefixed = {
        prefix + name: f"{10.0 ** exponent:e}*({plain[name]})"
        for name in METRIC
        for prefix, exponent in zip(PREFIXES, [-24, -21, -18, -15, -12, -9, -6, -3, -2, -1, 1, 2, 3, 6, 9, 12, 15, 18, 21, 24], strict=True)
        if prefix + name not in plain and prefix + name not in TAKEN
    }
    return plain | prefixed | COMPOUND


@pytest.fixture(scope="module")
def definitions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, etree._Element]:
    """The units of an exported sensor that has a channel of each."""
    folder = tmp_path_factory.mktemp("units")
    units = [*texts(), "degC", "degF", "degR", "°C", "°F", "furlong", "J/kg.K"]
    listed = ", ".join(f'"{unit}"' for unit in units)
    (folder / "Units.toml").write_text(
        f'name = "Units"\nmodel = "sensor"\ndescription = "a channel of each unit"\n'
        f"[structure]\nchannels = {len(units)}\ndelay_samples = 1\nunits = [{listed}]\n"
    )
    answer = adaptive_fmu("export", folder / "Units.toml", "--out", folder)
    assert answer.returncode == 0, answer.stderr
    with zipfile.ZipFile(folder / "Units.fmu") as archive:
        root = etree.fromstring(archive.read("modelDescription.xml"))
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    assert schema.validate(root), schema.error_log
    return {unit.get("name"): unit for unit in root.iterfind("UnitDefinitions/Unit")}


def test_every_unit_has_the_base_units_of_pint(definitions) -> None:
    known = pint.UnitRegistry()
    for text, name in texts().items():
        base = definitions[text].find("BaseUnit")
        assert base is not None, text
        here = known.Quantity(float(base.get("factor", "1")), "dimensionless")
        for attribute, unit in BASE.items():
            here = here * known.Quantity(1.0, unit) ** int(base.get(attribute, "0"))
        assert float(base.get("offset", "0")) == 0.0
        there = known.Quantity(1.0, "dimensionless") * known.parse_expression(name)
        # To pint an angle has no dimension; an angle here is one, and a cycle a second none.
        ratio = (here / there).to_base_units()
        assert ratio.dimensionless and math.isclose(ratio.magnitude, 1.0, rel_tol=1e-12), (text, ratio)


def test_angles_are_counted_as_pint_knows_them(definitions) -> None:
    angles = {"deg": 1, "rpm": 1, "rev": 1, "deg/s": 1, "rad.s-2": 1, "N.m/rad": -1, "Hz": 0, "1/min": 0, "lm": 2}
    for text, exponent in angles.items():
        assert int(definitions[text].find("BaseUnit").get("rad", "0")) == exponent, text


def test_temperatures_have_the_offset_of_pint(definitions) -> None:
    known = pint.UnitRegistry()
    for text, name in {"degC": "degC", "°C": "degC", "degF": "degF", "°F": "degF", "degR": "degR"}.items():
        base = definitions[text].find("BaseUnit")
        assert base.get("K") == "1"
        for value in [-40.0, 0.0, 212.0]:
            here = float(base.get("factor", "1")) * value + float(base.get("offset", "0"))
            there = known.Quantity(value, name).to("kelvin").magnitude
            assert here == pytest.approx(there, rel=1e-14), text


def test_what_is_not_known_or_has_two_meanings_is_a_unit_without_base_units(definitions) -> None:
    assert definitions["furlong"].find("BaseUnit") is None and definitions["J/kg.K"].find("BaseUnit") is None
