"""Models of one's own: a crate beside this one, built, packed and run; and what the macro and the exporter refuse."""

import shutil
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from fmpy.validation import validate_fmu
from master import Fmu, Unit
from scipy.integrate import solve_ivp
from test_command_line import fails
from test_platforms import EXPORTED, OLDEST_GLIBC, asked, glibc, output_of

pytestmark = pytest.mark.slow

CRATE = ROOT / "examples" / "my_plant"
# As docs/own_controller.md has it, so that it is built once for both.
TARGET = ROOT / "target" / "my_plant"
OUTSIDE, INITIAL, STEP = 268.15, [288.15, 291.15, 283.15], 60.0


@pytest.fixture(scope="module")
def library() -> Path:
    command = ["cargo", "build", "-q", "--release", "--manifest-path", CRATE / "Cargo.toml", "--target-dir", TARGET]
    subprocess.run(command, check=True, cwd=ROOT)
    return TARGET / "release" / "libmy_plant.so"


@pytest.fixture(scope="module")
def mine(library: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """The FMUs of the crate, by their names."""
    out = tmp_path_factory.mktemp("mine")
    descriptions = [CRATE / f"{name}.toml" for name in ("VanDerPol", "Rooms", "Ball")]
    answer = adaptive_fmu("export", *descriptions, "--library", library, "--out", out)
    assert (answer.returncode, answer.stderr) == (0, "")
    return {file.stem: Fmu(file, out / file.stem) for file in out.glob("*.fmu")}


def van_der_pol(_t: float, x: np.ndarray) -> list[float]:
    return [x[1], (1 - x[0] ** 2) * x[1] - x[0]]


def rooms(stop: float) -> tuple[np.ndarray, list[float]]:
    """Temperatures every minute and the times of all switchings, piece by piece between them."""
    low, high = 293.15 - 0.4, 293.15 + 0.4
    times = np.arange(0.0, stop + STEP / 2, STEP)
    temperatures, switched, heating = np.empty((len(times), 3)), [], np.ones(3)

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        walls = np.diff(x, prepend=x[0], append=x[-1])
        return (1500.0 * heating + 45.0 * (OUTSIDE - x) + 20.0 * (walls[1:] - walls[:-1])) / 3e5

    # Each room waits for the end of its band to which it is going.
    def end_of(room: int):
        def distance(_t: float, x: np.ndarray) -> float:
            return x[room] - (high if heating[room] else low)

        distance.terminal = True
        return distance

    time, x = 0.0, np.array(INITIAL)
    temperatures[0] = x
    while time < stop:
        ends = [end_of(k) for k in range(3)]
        piece = solve_ivp(rate, (time, stop), x, rtol=1e-10, atol=1e-10, events=ends, dense_output=True)
        inside = (times > time) & (times <= piece.t[-1])
        if inside.any():
            temperatures[inside] = piece.sol(times[inside]).T
        time, x = piece.t[-1], piece.y[:, -1]
        if piece.status == 1:
            (room,) = [k for k in range(3) if len(piece.t_events[k])]
            heating[room] = 1 - heating[room]
            switched.append(time)
    return temperatures, switched


@pytest.mark.parametrize("interface", ["CoSimulation", "ModelExchange"])
def test_an_own_oscillator_moves_as_scipy_computes(mine, interface: str) -> None:
    exact = solve_ivp(van_der_pol, (0.0, 10.0), [2.0, 0.0], t_eval=np.linspace(0, 10, 101), rtol=1e-11, atol=1e-11)
    options = {"solver": "CVode", "relative_tolerance": 1e-9} if interface == "ModelExchange" else {}
    path = str(mine["VanDerPol"].path)
    ran = fmpy.simulate_fmu(path, stop_time=10.0, output_interval=0.1, fmi_type=interface, **options)
    assert np.abs(ran["x[1]"] - exact.y[0]).max() < 1e-4


@pytest.mark.parametrize("interface", ["CoSimulation", "ModelExchange"])
def test_own_rooms_are_heated_and_switched_as_scipy_computes(mine, interface: str) -> None:
    temperatures, switched = rooms(14400.0)
    assert len(switched) > 10 and all(time % STEP > 1e-3 for time in switched), "events lie inside of steps"
    names = [f"temperature[{k}]" for k in (1, 2, 3)]
    options = {"solver": "CVode", "relative_tolerance": 1e-10} if interface == "ModelExchange" else {}
    ran = fmpy.simulate_fmu(
        str(mine["Rooms"].path),
        stop_time=14400.0,
        output_interval=STEP,
        fmi_type=interface,
        start_values={"outside": OUTSIDE},
        output=[*names, "switchings"],
        **options,
    )
    # At an event FMPy gives the values before it and behind it, in model exchange.
    times = np.arange(0.0, 14400.0 + STEP / 2, STEP)
    ran = ran[np.searchsorted(ran["time"], times + 1e-6, side="right") - 1]
    for room, name in enumerate(names):
        assert np.abs(ran[name] - temperatures[:, room]).max() < 5e-3, name
    # The counter steps on within the minute in which scipy finds an event.
    assert list(ran["switchings"]) == [sum(time <= t for time in switched) for t in times]


def test_an_event_lies_where_scipy_finds_it(mine) -> None:
    """A step that ends just before it leaves the heater on, one that ends just behind it doesn't."""
    _, switched = rooms(7200.0)
    for shift, count in [(-0.05, 0), (0.05, 1)]:
        with Unit(mine["Rooms"]) as unit:
            unit["outside"] = OUTSIDE
            unit.start()
            unit["outside"] = OUTSIDE
            unit.step(0.0, switched[0] + shift)
            assert unit["switchings"] == count
            assert sum(unit[f"heating[{k}]"] for k in (1, 2, 3)) == 3 - count


METHODS = [("explicit", 1e-3), ("stiff", 1e-6), ("automatic", 1e-9)]


@pytest.mark.parametrize("step", [0.001, 0.0137, 0.1, 1.0, 4.0])
@pytest.mark.parametrize(("method", "tolerance"), METHODS, ids=[method for method, _ in METHODS])
def test_an_own_ball_bounces_by_the_closed_form_and_comes_to_rest(mine, method: str, tolerance: float, step: float) -> None:
    """Its flights last v, .7 v, .49 v … (2/g): the bounce that leaves at most 1 mm/s is the last."""
    g, restitution = 9.81, 0.7
    speeds, bounces = [np.sqrt(2 * g)], [np.sqrt(2 / g)]
    while (speed := restitution * speeds[-1]) > 1e-3:
        speeds.append(speed)
        bounces.append(bounces[-1] + 2 * speed / g)
    end = np.sqrt(2 / g) * (1 + restitution) / (1 - restitution)
    assert len(bounces) == 24 and 0 < end - bounces[-1] < 1e-3

    def height(time: float, passed: int) -> float:
        if passed == len(bounces):
            return 0.0
        flown = time - bounces[passed - 1] if passed else time
        return speeds[passed] * flown - g / 2 * flown**2 if passed else 1.0 - g / 2 * flown**2

    speeds = [0.0, *(restitution * speed for speed in speeds)]
    with Unit(mine["Ball"]) as unit:
        unit["relative_tolerance"], unit["integration_method"] = tolerance, method
        unit.start()
        for k in range(round(4.0 / step)):
            unit.step(k * step, step)
            time = (k + 1) * step
            passed = sum(bounce <= time for bounce in bounces)
            assert (unit["bounces"], bool(unit["rests"])) == (passed, passed == len(bounces))
            assert abs(unit["height"] - height(time, passed)) < 1e-9
        if 4.0 - round(4.0 / step) * step < step:
            assert (unit["height"], unit["speed"]) == (0.0, 0.0)


def test_a_ball_of_ones_own_comes_to_rest_in_model_exchange_and_by_steps_of_fixed_length_too(mine) -> None:
    path = str(mine["Ball"].path)
    # The solver is the master's: at 1e-6, where it begins, its speeds are off by as much as the last four bounces have.
    output, solver = ["height", "speed", "bounces"], {"fmi_type": "ModelExchange", "solver": "CVode"}
    for tolerance, bounces in [(1e-6, 20), (1e-8, 24), (1e-10, 24)]:
        ran = fmpy.simulate_fmu(path, stop_time=4.0, output=output, relative_tolerance=tolerance, **solver)
        height, speed, counted = tuple(ran[-1])[1:]
        assert (height, speed) == (0.0, 0.0) and bounces <= counted <= 24
    with Unit(mine["Ball"]) as unit:
        unit["integration_method"], unit["fixed_steps"] = "fixed", 10
        unit.start()
        for k in range(300):
            unit.step(k * 0.01, 0.01)
        assert unit["height"] == 0.0 and unit["bounces"] > 3


def test_a_saved_state_goes_on_bit_for_bit(mine) -> None:
    for name, step in [("VanDerPol", 0.1), ("Rooms", 600.0), ("Ball", 0.15)]:
        with Unit(mine[name]) as unit, Unit(mine[name]) as other:
            unit.start()
            for k in range(7):
                unit.step(k * step, step)
            stored = unit.slave.serializeFMUstate(unit.slave.getFMUstate())
            other.slave.setFMUstate(other.slave.deSerializeFMUstate(stored))
            for k in range(7, 20):
                unit.step(k * step, step)
                other.step(k * step, step)
            assert unit.everything() == other.everything()


def test_fmpy_finds_nothing_to_complain_about_in_them(mine) -> None:
    assert sorted(mine) == ["Ball", "Rooms", "VanDerPol"]
    assert [validate_fmu(str(fmu.path)) for fmu in mine.values()] == [[], [], []]


def test_a_library_of_ones_own_asks_for_an_old_glibc_and_exports_only_what_it_should(mine, library: Path) -> None:
    assert glibc(library) <= OLDEST_GLIBC
    version = ".".join(map(str, glibc(library)))
    assert asked(mine["Ball"].path) == {"binaries/linux64/Ball.so": {"processor": "x86-64", "glibc": version}}
    symbols = {line.split()[-1] for line in output_of("nm", "-D", "--defined-only", library).splitlines()}
    # `export --library` asks a library for descriptions and sources; that of this package's FMUs leaves these out.
    assert symbols == EXPORTED | {f"adaptive_fmu_{name}" for name in ("describe", "firmware", "reference", "source")}


def test_a_set_point_out_of_reach_of_its_hysteresis_is_refused(mine, library, tmp_path) -> None:
    text = (CRATE / "Rooms.toml").read_text()
    for old, new, words in [
        ("hysteresis = 0.4", "hysteresis = 300.0", ["hysteresis = 300", "set_point = 293.15"]),
        ("rooms = 3", "rooms = 0", ["rooms = 0", "1 … 100"]),
        ("rooms = 3", "rooms = 2", ["temperature_0", "list of 2"]),
        ("rooms = 3", "room = 3", ["room", "rooms"]),
        ('model = "rooms"', 'model = "nonlinear-siso"', ["nonlinear-siso", "van-der-pol, rooms, ball, composite"]),
    ]:
        assert old in text
        (tmp_path / "mine.toml").write_text(text.replace(old, new))
        error = fails("export", tmp_path / "mine.toml", "--library", library, "--out", tmp_path / "out")
        assert "mine.toml" in error and all(word in error for word in words), error


def test_models_of_another_library_are_not_found_in_this_one(library, tmp_path) -> None:
    assert "rooms" in fails("export", CRATE / "Rooms.toml", "--out", tmp_path)
    assert "van-der-pol, rooms" in fails("export", "NonlinearSiso", "--library", library, "--out", tmp_path)


def crate(folder: Path, models: str, dependency: str = "") -> subprocess.CompletedProcess[str]:
    """Checks a copy of the crate with other models in the macro's line, and another dependency beside the framework."""
    shutil.copytree(CRATE, folder, ignore=shutil.ignore_patterns("target"))
    framework = f'adaptive-fmu = {{ package = "adaptive-fmu-framework", path = "{ROOT / "crates" / "framework"}" }}'
    manifest = (folder / "Cargo.toml").read_text()
    line = next(line for line in manifest.splitlines() if line.startswith("adaptive-fmu"))
    (folder / "Cargo.toml").write_text(manifest.replace(line, f"{framework}\n{dependency}"))
    source = folder / "src" / "lib.rs"
    source.write_text(source.read_text().replace("[VanDerPol, Rooms, Ball]", models))
    command = ["cargo", "check", "-q", "--offline", "--manifest-path", folder / "Cargo.toml", "--target-dir", TARGET]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("models", "message"),
    [("[VanDerPol, Rooms, VanDerPol]", "two models have the same NAME"), ("[]", "expected")],
    ids=["one model twice", "no model"],
)
def test_the_macro_refuses_what_would_make_a_wrong_library(tmp_path, models: str, message: str) -> None:
    answer = crate(tmp_path / "my_plant", models)
    assert answer.returncode != 0 and message in answer.stderr, answer.stderr


def test_a_library_may_contain_models_of_this_package_in_addition_to_its_own(tmp_path: Path) -> None:
    models = "[VanDerPol, adaptive_fmu_models::plants::two_link_robot::TwoLinkRobot]"
    answer = crate(tmp_path / "my_plant", models, f'adaptive-fmu-models = {{ path = "{ROOT}" }}')
    assert answer.returncode == 0, answer.stderr


def test_a_library_of_another_version_or_none_at_all_is_named(tmp_path: Path) -> None:
    source = tmp_path / "library.c"
    source.write_text(
        "typedef void (*reply)(void *, const char *);\n"
        "int adaptive_fmu_describe(const char *text, reply give, void *context) {\n"
        '    give(context, "{\\"described\\": {\\"build\\": {\\"version\\": \\"0.0.1\\"}}}");\n'
        "    return 1;\n}\n"
    )
    library = tmp_path / "libstale.so"
    subprocess.run(["cc", "-shared", "-fPIC", source, "-o", library], check=True)
    error = fails("export", "NonlinearSiso", "--library", library, "--out", tmp_path / "out")
    assert "libstale.so" in error and "another version" in error and "Build it again" in error
    assert "libgone.so" in fails("export", "NonlinearSiso", "--library", tmp_path / "libgone.so", "--out", tmp_path)
    assert "regular" in fails("export", "NonlinearSiso", "--library", tmp_path, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
