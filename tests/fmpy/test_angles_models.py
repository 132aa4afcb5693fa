"""Angles that wrap in laws with a reference model or a funnel, against laws that are typed and integrated without any FMU."""

import json
import subprocess
from collections.abc import Callable
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest
import sample
from conftest import PROGRAM, adaptive_fmu
from independent_angles import Funnel, L1Ppf, Mrac, Neuro, RobustMrac, Unmatched, wrapped
from master import Fmu, Unit
from test_compiled_equations import refuse_memory_for_code, refuses

H, SUBSTEPS = 2e-3, 5
Plant = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
Law = Mrac | Unmatched | RobustMrac | Neuro | L1Ppf
DOUBLE = "A = [[0.0, 1.0], [0.0, 0.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n"
UNITS = 'units = { x = ["rad", "rad/s"], r = ["rad"] }\n'


def double_integrator(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """psi'' = 1.2 u + 0.3 sin t"""
    return np.array([x[1], 1.2 * u[0] + 0.3 * sin(t)])


def driven(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Rows (0, 1), (0, -1) about, and a control in the second."""
    return np.array([x[1] + 0.1 * sin(2 * t), 1.1 * u[0] - 1.2 * x[1]])


def two_controls(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Rows (0, 0.5), (0, -1) about, and a control each."""
    return np.array([0.55 * x[1] + 1.1 * u[0] + 0.2 * sin(t), u[1] - 0.9 * x[1] + 0.2 * sin(x[0])])


def integrated(rate: Callable, t: float, y: np.ndarray, h: float, substeps: int) -> np.ndarray:
    """By Runge and Kutta's method."""
    for k in range(substeps):
        s, w = t + k * h / substeps, h / substeps
        k1 = rate(s, y)
        k2 = rate(s + w / 2, y + w / 2 * k1)
        k3 = rate(s + w / 2, y + w / 2 * k2)
        y = y + w / 6 * (k1 + 2 * k2 + 2 * k3 + rate(s + w, y + w * k3))
    return y


def start_lines(numbers: dict[str, float], each: int = 1) -> str:
    """Lines of `[start]`: a number for each channel, or for all."""
    return "".join(f"{name} = {[value] * each if each else value}\n" for name, value in numbers.items())


def a_mrac(random: np.random.Generator) -> tuple[Law, str, Plant]:
    gain, pole, bounds = random.uniform(20, 80), -random.uniform(3, 5) + 0.5j, (0.5, random.uniform(2, 3), 2.0, 8.0)
    text = (
        f'model = "mrac"\n[structure]\nangles = [1]\nbaseline = "outside"\n{DOUBLE}{UNITS}[start]\nlaw = "continuous"\n'
        f"adaptation_gain = {gain}\npole_real = {[pole.real] * 2}\npole_imag = [0.5, -0.5]\nomega_min = [{bounds[0]}]\n"
        f"omega_max = [{bounds[1]}]\ntheta_bound = [[2.0, 2.0]]\nsigma_bound = [8.0]\n"
    )
    return Mrac(gain, pole, bounds), text, double_integrator


def an_unmatched(random: np.random.Generator) -> tuple[Law, str, Plant]:
    poles, gamma = np.array([random.uniform(3, 5), 4.0]), [random.uniform(0.02, 0.08), random.uniform(0.3, 0.8)]
    K, funnels = [random.uniform(0.3, 0.5), random.uniform(6, 9)], [Funnel(1.0, 0.5, 1.0), Funnel(3.0, 2.0, 1.0)]
    text = (
        'model = "mrac-ppf-unmatched"\n[structure]\nangles = [1]\nunmatched = [{ row = 1, driven_by = 2 }]\n'
        f"A = [[0.0, 1.0], [0.0, -1.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n{UNITS}[start]\nA_m = [[0.0, 1.0], {(-poles).tolist()}]\n"
        f"rho_0 = [1.0, 3.0]\nrho_inf = [0.5, 2.0]\ndecay_rate = [1.0, 1.0]\ngamma = {gamma}\nK_epsilon = {K}\n"
        "theta_bound = [3.0, 3.0]\n"
    )
    return Unmatched(poles, funnels, gamma, K), text, driven


def a_robust_mrac(random: np.random.Generator) -> tuple[Law, str, Plant]:
    A_m = np.array([[-random.uniform(2, 4), 0.2], [0.0, -3.0]])
    numbers = {"gamma_1": 3.0, "gamma_2": 2.0, "beta": 0.2, "alpha_bar": 0.5, "K_epsilon": 3.0}
    numbers = {name: value * random.uniform(0.7, 1.3) for name, value in numbers.items()}
    text = (
        'model = "mrac-ppf"\n[structure]\nangles = [1]\nA = [[0.0, 0.5], [0.0, -1.0]]\nB = [[1.0, 0.0], [0.0, 1.0]]\n'
        f'units = {{ x = ["rad", "1"] }}\n[start]\nlaw = "continuous"\nA_m = {A_m.tolist()}\nswitching_width = 0.5\n'
        f"rho_0 = [1.0, 1.0]\nrho_inf = [0.4, 0.4]\ndecay_rate = [1.0, 1.0]\ntheta_bound = [0.5, 0.5]\n{start_lines(numbers, 2)}"
    )
    return RobustMrac(A_m, Funnel(1.0, 0.4, 1.0), numbers), text, two_controls


def a_neuro(random: np.random.Generator) -> tuple[Law, str, Plant]:
    weights, biases = random.uniform(-1, 1, (8, 3)), random.uniform(-1, 1, 8)
    numbers = {"k": 1.0, "n_f": 0.2, "eta_Gb": 0.5, "sigma": 2.0, "network_gain": 0.3}
    numbers = {name: value * random.uniform(0.8, 1.2) for name, value in numbers.items()}
    text = (
        'model = "neuro-ppf"\n[structure]\nrelative_degree = 2\nchannels = 1\ninput_gain_network = false\nangles = [1]\n'
        f'units = {{ r = ["rad"] }}\nnetwork = {{ rule = "given", weights = {weights.tolist()}, biases = {biases.tolist()} }}\n[start]\n'
        f'rho_0 = [1.2]\nrho_inf = [0.6]\ndecay_rate = [1.0]\nfunnel = "symmetric"\nlambda = [2.0]\n{start_lines(numbers, 0)}'
    )
    return Neuro(weights, biases, Funnel(1.2, 0.6, 1.0), {**numbers, "lambda": 2.0}), text, double_integrator


def an_l1_ppf(random: np.random.Generator) -> tuple[Law, str, Plant]:
    pole = -random.uniform(3, 5) + 0.5j
    numbers = {"adaptation_gain": 2e3, "barrier_gain": random.uniform(0.05, 0.15), "error_weight": random.uniform(3, 5)}
    text = (
        f'model = "l1-ppf"\n[structure]\nangles = [1]\nbaseline = "outside"\nregressor = "infinity_norm"\ninput_gain = "diagonal"\n'
        f"{DOUBLE}{UNITS}[start]\nadaptation_gain = 2e3\npole_real = {[pole.real] * 2}\npole_imag = [0.5, -0.5]\nfeedback_gain = [[15.0]]\n"
        f"omega_min = [0.5]\nomega_max = [2.0]\ntheta_bound = [10.0]\nsigma_bound = [10.0]\nrho_0 = [1.0]\nrho_inf = [0.5]\n"
        f"decay_rate = [1.0]\nbarrier_gain = [{numbers['barrier_gain']}]\nerror_weight = [{numbers['error_weight']}]\n"
    )
    return L1Ppf(pole, Funnel(1.0, 0.5, 1.0), numbers), text, double_integrator


LAWS = [a_mrac, an_unmatched, a_robust_mrac, a_neuro, an_l1_ppf]
SPEED = 0.4


class Counted:
    """A law about its origin, which follows the reference, over angles that never wrap."""

    def __init__(self, law: Law, psi: float, r: float) -> None:
        self.law, self.range, self.moves = law, pi / 4, 0
        self.origin = r if max(abs(psi), abs(r)) > self.range and not isinstance(law, Neuro) else 0.0
        law.start(np.array([psi - self.origin, 0.0]))

    def step(self, t: float, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """A communication step; the control at its end."""
        law = self.law
        if abs(r[0] - self.origin) > self.range and not isinstance(law, Neuro):
            by = r[0] - self.origin
            law.moved(by)
            self.origin, self.moves = self.origin + by, self.moves + 1
        x, r = x - np.array([self.origin, 0]), r - np.array([self.origin, 0, 0])
        law.states = integrated(lambda s, y: law.rates(s, y, x, r), t, law.states, H, SUBSTEPS)
        return law.control(t + H, law.states, x, r)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("made", LAWS)
def test_a_law_turns_as_an_independent_one_does(tmp_path, made: Callable, seed: int) -> None:
    random = np.random.default_rng(seed)
    law, text, plant = made(random)
    start, speed = random.uniform(-3, 3), random.choice([-1, 1]) * random.uniform(2.5, 3.2)
    if isinstance(law, RobustMrac):
        text += f"x_m0 = {[start, 0.0]}\n"
    (tmp_path / "turn.toml").write_text(f'name = "Turn"\ndescription = "An angle"\n{text}relative_tolerance = 1e-9\n')
    exported = adaptive_fmu("export", tmp_path / "turn.toml", "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr

    def reference(t: float) -> np.ndarray:
        soft = np.array([t - sin(t), 1 - cos(t), sin(t)]) if t < pi else np.array([2 * t - pi, 2.0, 0.0])
        return np.array([start, 0, 0]) + speed / 2 * soft

    x = np.array([start, 0.0])
    own, counted, most = x, Counted(law, start, start), 0.0
    with Unit(Fmu(tmp_path / "Turn.fmu", tmp_path / "unpacked")) as unit:
        for k in range(2400):
            t, (r, dr, ddr) = k * H, reference(k * H)
            inputs = {"x[1]": wrapped(x[0]), "x[2]": x[1], "r[1]": wrapped(r)}
            if isinstance(law, Neuro | L1Ppf):
                inputs |= {"dr[1]": dr, "ddr[1]": ddr}
            if k == 0:
                unit.start(**inputs)
            for name, value in inputs.items():
                unit[name] = value
            unit.step(t, H)
            wanted = counted.step(t, own, reference(t))
            u = np.array([unit[f"u[{i + 1}]"] for i in range(len(wanted))])
            x = integrated(lambda s, y, u=u: plant(s, y, u), t, x, H, 2)
            own = integrated(lambda s, y, u=wanted: plant(s, y, u), t, own, H, 2)
            most = max(most, float(np.abs(u - wanted).max() / (1 + np.abs(wanted).max())))
            assert most < 1e-5, t
            assert abs(x[0] - own[0]) < 1e-6, t
        if counted.moves:
            assert abs(wrapped(unit["origin[1]"] - counted.origin)) < 1e-6
    assert abs(x[0] - start) > 5
    assert isinstance(law, Neuro) or counted.moves > 2


def slow_turn(t: float) -> dict[str, float]:
    """State and reference over the seam, by time: an error that stays in every funnel."""
    psi = 2.9 + SPEED * t
    return {
        "x[1]": wrapped(psi),
        "x[2]": SPEED,
        "r[1]": wrapped(psi + 0.1 * sin(t)),
        "dr[1]": SPEED + 0.1 * cos(t),
        "ddr[1]": -0.1 * sin(t),
    }


def described(made: Callable, folder: Path) -> Path:
    """The description of a law with which both forms meet the same events."""
    law, text, _ = made(np.random.default_rng(3))
    text += "x_m0 = [2.9, 0.0]\n" if isinstance(law, RobustMrac) else ""
    text += "" if isinstance(law, Mrac) else 'on_funnel_exit = "reopen"\n'
    file = folder / "turn.toml"
    file.write_text(f'name = "Turn"\ndescription = "An angle"\n{text}')
    return file


def stepped(archive: Fmu) -> list[tuple[float, ...]]:
    """All outputs and the origin, at each communication point of a slow turn."""
    has_origin, rows = "origin[1]" in archive.variables, []
    names = [*archive.named(causality="output"), *(["origin[1]"] if has_origin else [])]
    with Unit(archive) as unit:
        inputs = archive.named(causality="input")
        for k in range(1500):
            given = {name: value for name, value in slow_turn(k * H).items() if name in inputs}
            if k == 0:
                unit.start(**given)
            for name, value in given.items():
                unit[name] = value
            unit.step(k * H, H)
            rows.append(tuple(unit[name] for name in names))
    assert not has_origin or len({row[-1] for row in rows}) > 1, "the origin has moved"
    return rows


# The C compiler takes seconds for each: a commit compiles one of them.
@pytest.mark.parametrize("made", LAWS if sample.ALL else [LAWS[sample.NUMBER % len(LAWS)]])
def test_a_law_that_turns_is_to_the_bit_the_same_from_its_c_sources(tmp_path, made: Callable) -> None:
    file = described(made, tmp_path)
    forms = []
    for form in ([], ["--compile"]):
        exported = adaptive_fmu("export", file, *form, "--out", tmp_path / f"form{len(forms)}")
        assert exported.returncode == 0, exported.stderr
        forms.append(stepped(Fmu(tmp_path / f"form{len(forms)}" / "Turn.fmu", tmp_path / f"unpacked{len(forms)}")))
    assert forms[0] == forms[1]


@pytest.mark.parametrize("made", LAWS)
def test_a_law_that_turns_is_to_the_bit_the_same_with_equations_compiled_during_the_run(tmp_path, made: Callable) -> None:
    try:
        refuse = refuses()
    except subprocess.SubprocessError:
        pytest.skip("this system can't be asked to refuse memory for code")
    assert refuse
    file = described(made, tmp_path)
    law, _, _ = made(np.random.default_rng(3))
    names = ["x[1]", "x[2]", "r[1]", *(["dr[1]", "ddr[1]"] if isinstance(law, Neuro | L1Ppf) else [])]
    rows = [[k * H, *(slow_turn(k * H)[name] for name in names)] for k in range(1501)]
    lines = [",".join(["time", *names]), *(",".join(repr(float(value)) for value in row) for row in rows)]
    (tmp_path / "inputs.csv").write_text("\n".join(lines) + "\n")
    tables, ways = [], []
    for refused in (False, True):
        words = [
            PROGRAM,
            "simulate",
            file,
            "--input",
            tmp_path / "inputs.csv",
            "--until",
            3,
            "--step",
            H,
            "--json",
            "--verbose",
            "--out",
            tmp_path,
        ]
        answer = subprocess.run(
            [str(word) for word in words],
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=refuse_memory_for_code if refused else None,
        )
        assert answer.returncode == 0, answer.stderr
        results = Path(json.loads(answer.stdout)["results"])
        tables.append((results / "result.csv").read_text())
        ways.append(answer.stderr)
    assert tables[0] == tables[1]
    assert "compiled during the run" in ways[0] and "refuses memory for code" in ways[1]
