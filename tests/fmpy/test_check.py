"""What `check` tells of a design, against numpy and scipy, and how it ends."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import sample
from conftest import ROOT, adaptive_fmu
from scipy.linalg import block_diag, expm, solve_continuous_lyapunov
from scipy.signal import tf2ss

# Designs whose loop is stable for each input gain, with what is replaced in their description for that, and what
# H_m^-1 H_um is in each channel (numerator, denominator) where unmatched uncertainty is cancelled.
STABLE = {
    "L1NonlinearSiso": [],
    "L1CoupledMimo": [],
    "L1Quadrotor": [],
    "L1MaresAuv": [],
    "L1TwinRotor": [],
    "L1UnmatchedMimo": [("[[8.0, 0.0], [0.0, 8.0]]", "[[3.0, 0.0], [0.0, 3.0]]")],
    # A baseline inside; those of the others are outside, or there is none.
    "L1TwoLinkRobot": [
        ("[[0.5, -2.0], [-2.0, 0.5]]", "[[0.8, -0.1], [-0.1, 0.8]]"),
        ("[[10.0, 2.0], [2.0, 10.0]]", "[[2.0, 0.1], [0.1, 2.0]]"),
    ],
}


class Checked:
    """A description as it was checked."""

    def __init__(self, text: str, folder: Path) -> None:
        file = folder / "Design.toml"
        file.write_text(text)
        self.answer = adaptive_fmu("check", file, "--json")
        assert self.answer.returncode in (0, 3) and self.answer.stderr == "", self.answer
        self.output = json.loads(self.answer.stdout)
        self.description = tomllib.loads(text)
        self.structure, self.start = self.description["structure"], self.description["start"]

    def __getitem__(self, name: str):
        return next(finding["value"] for finding in self.output["findings"] if finding["name"] == name)

    def matrix(self, name: str) -> np.ndarray:
        """A parameter, diagonal where one number a channel is given."""
        given = np.array(self.start[name], dtype=float)
        return np.diag(given) if given.ndim == 1 else given

    def model(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A_m, B, K_m; K_m is zero without a baseline."""
        B = np.array(self.structure["B"])
        if "baseline" in self.structure:
            K_m = np.array(self["K_m"])
            return np.array(self.structure["A"]) - B @ K_m, B, K_m
        A_m = np.array(self.start.get("A_m", self.structure.get("A")))
        return A_m, B, np.zeros((B.shape[1], len(B)))

    def D(self) -> tuple[np.ndarray, np.ndarray]:
        factors = self.structure.get("filter", {}).get("denominator", [[1.0, 0.0]])
        product = np.array([1.0])
        for factor in factors:
            product = np.polymul(product, factor)
        return np.array([1.0]), product

    def unmatched(self, A_m: np.ndarray) -> tuple[np.ndarray, list]:
        """B_um, and H_m^-1 H_um as (direction, channel, numerator)."""
        if self.description["name"] == "L1UnmatchedMimo":
            return np.array([[0.0], [1.0], [0.0]]), [(0, 1, np.array([1.0, 1.8]))]
        if self.description["name"] == "L1TwinRotor":
            A, B = np.array(self.structure["A"]), np.array(self.structure["B"])
            ways = []
            for i, (rate, rotor) in enumerate([(1, 4), (3, 5)]):
                ways.append((i, i, np.array([1.0, -A_m[rotor, rotor]]) / (A[rate, rotor] * B[rotor, i])))
            return np.array(self.structure["B_um"]), ways
        return np.zeros((len(A_m), 0)), []


def realised(ways: list[tuple], D: tuple, m: int, k: int) -> tuple[np.ndarray, ...]:
    """D(s) times polynomials from k inputs to m outputs, a way each, with states of its own."""
    blocks = [tf2ss(np.polymul(D[0], numerator), D[1]) for _, _, numerator in ways]
    A = block_diag(*[block[0] for block in blocks]) if blocks else np.zeros((0, 0))
    B, C, direct = np.zeros((len(A), k)), np.zeros((m, len(A))), np.zeros((m, k))
    first = 0
    for (direction, channel, _), block in zip(ways, blocks, strict=True):
        order = len(block[0])
        B[first : first + order, direction] = block[1][:, 0]
        C[channel, first : first + order] = block[2][0]
        direct[channel, direction] = block[3][0, 0]
        first += order
    return A, B, C, direct


def uncertainty_to_state(design: Checked, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """x' = A_m x + B eta + B_um w2, eta = omega u_ad + (I - omega) K_m x + w (the middle term where there is a baseline),
    u_ad = -K D (eta + H_m^-1 H_um w2): A and B from (w, w2), and how many of these are matched."""
    A_m, B, K_m = design.model()
    n, m = B.shape
    K = design.matrix("feedback_gain")
    left = (np.eye(m) - omega) @ K_m
    B_um, ways = design.unmatched(A_m)
    k = B_um.shape[1]
    A_d, B_d, C_d, _ = realised([(i, i, np.array([1.0])) for i in range(m)], design.D(), m, m)
    A_t, B_t, C_t, D_t = realised(ways, design.D(), m, k)
    # u_ad = -K (C_d d + C_t t + D_t w2)
    A = np.block(
        [
            [A_m + B @ left, -B @ omega @ K @ C_d, -B @ omega @ K @ C_t],
            [B_d @ left, A_d - B_d @ omega @ K @ C_d, -B_d @ omega @ K @ C_t],
            [np.zeros((len(A_t), n + len(A_d))), A_t],
        ]
    )
    at_once = -omega @ K @ D_t
    inputs = np.block([[B, B_um + B @ at_once], [B_d, B_d @ at_once], [np.zeros((len(A_t), m)), B_t]])
    return A, inputs, m


def l1_norm(A: np.ndarray, B: np.ndarray, n: int) -> float:
    """The integral of |impulse response| of the first n states, by the trapezoidal rule."""
    rates = np.linalg.eigvals(A)
    # An integrator that nothing reaches decays in no time, and neither shows.
    slowest = min(-rate.real for rate in rates if rate.real < -1e-9)
    step = 0.02 / np.abs(rates).max()
    x, across = B.copy(), expm(A * step)
    total, before = np.zeros((n, B.shape[1])), np.abs(B[:n])
    for _ in range(int(25 / slowest / step)):
        x = across @ x
        now = np.abs(x[:n])
        total += 0.5 * step * (before + now)
        before = now
    return total.sum(axis=1).max(initial=0.0)


@pytest.fixture(scope="module", params=STABLE)
def design(request, tmp_path_factory) -> Checked:
    text = (ROOT / "modelDescription" / f"{request.param}.toml").read_text()
    for old, new in STABLE[request.param]:
        assert old in text
        text = text.replace(old, new)
    return Checked(text, tmp_path_factory.mktemp(request.param))


def test_the_desired_dynamics_are_those_that_numpy_finds(design: Checked) -> None:
    A_m, B, K_m = design.model()
    for name, matrix in [("eigenvalues of A_m", A_m), ("eigenvalues of A - B K_m", A_m)]:
        if name == "eigenvalues of A_m" or K_m.any():
            found = [complex(value["real"], value["imaginary"]) for value in design[name]]
            np.testing.assert_allclose(np.poly(found), np.poly(matrix), rtol=1e-6)
            for value, pole in zip(design[name], found, strict=True):
                assert value["frequency"] == pytest.approx(abs(pole), rel=1e-12)
                assert value["damping"] == pytest.approx(-pole.real / abs(pole), rel=1e-12)
    P = solve_continuous_lyapunov(A_m.T, -np.eye(len(A_m)))
    eigenvalues = np.linalg.eigvalsh(P)
    assert design["least eigenvalue of P"] == pytest.approx(eigenvalues[0], rel=1e-6)
    assert design["largest eigenvalue of P"] == pytest.approx(eigenvalues[-1], rel=1e-9)
    indices = np.array(design[next(f["name"] for f in design.output["findings"] if "controllability" in f["name"])])
    assert indices.sum() == len(A_m) and indices.shape == (1, B.shape[1])
    gamma = design.start["adaptation_gain"]
    frequency = np.sqrt(gamma * np.linalg.eigvalsh(B.T @ P @ B)[-1])
    if "L_2" not in [finding["name"] for finding in design.output["findings"]]:
        assert design["omega_a at rest"] == pytest.approx(frequency, rel=1e-6)


def test_the_norms_are_the_integrals_of_impulse_responses(design: Checked) -> None:
    omega = np.array(design["worst omega"])
    A, B, m = uncertainty_to_state(design, omega)
    n = len(design.structure["B"])
    matched = l1_norm(A, B[:, :m], n)
    assert design["‖G‖"]["upper"] == pytest.approx(matched, rel=1e-3)
    assert design["‖G‖"]["lower"] <= design["‖G‖"]["upper"] <= design["‖G‖"]["lower"] * (1 + 1e-6)
    entries = n if design.structure["regressor"] == "state" else 1
    lipschitz = entries * max(design.start["theta_bound"])
    assert design["L"] == lipschitz
    expected = matched * lipschitz
    if B.shape[1] > m:
        unmatched = l1_norm(A, B[:, m:], n)
        assert design["‖G_um‖"]["upper"] == pytest.approx(unmatched, rel=1e-3)
        expected += unmatched * max(design.start["theta_bound_unmatched"])
    assert design["lambda"]["upper"] == pytest.approx(expected, rel=1e-3)
    # Sufficient, not necessary: a larger one is a warning.
    verdicts = {finding["name"]: finding["verdict"] for finding in design.output["findings"]}
    assert (verdicts["lambda"] == "ok") == (expected < 1.0) and design.answer.returncode == 0
    # No corner of the bounds is worse.
    for corner in [design.matrix("omega_min"), design.matrix("omega_max")]:
        A, B, m = uncertainty_to_state(design, corner)
        if np.linalg.eigvals(A).real.max() < 0:
            assert l1_norm(A, B[:, :m], n) <= matched * 1.001 or B.shape[1] > m


def test_the_delay_margin_is_that_of_a_frequency_sweep(design: Checked) -> None:
    A_m, B, K_m = design.model()
    n, m = B.shape
    K = design.matrix("feedback_gain")
    A = A_m + B @ K_m
    A_d, B_d, C_d, _ = realised([(i, i, np.array([1.0])) for i in range(m)], design.D(), m, m)
    # From what arrives at the plant to what is sent: eta = u + K_m x, u = -K D eta - K_m x.
    a = np.block([[A, np.zeros((n, len(A_d)))], [B_d @ K_m, A_d]])
    b, c = np.vstack([B, B_d]), np.hstack([-K_m, -K @ C_d])
    frequencies = np.geomspace(1e-2, 1e5, 60_001)
    loop = -c @ np.linalg.solve(1j * frequencies[:, None, None] * np.eye(len(a)) - a, b[None])
    values = np.linalg.eigvals(loop)
    order = np.argsort(-np.abs(values), axis=1)
    values = np.take_along_axis(values, order, axis=1)
    crossing = (np.abs(values[:-1]) > 1) != (np.abs(values[1:]) > 1)
    k, i = np.nonzero(crossing)
    assert len(k) > 0
    delays = (np.angle(values[k, i]) + np.pi) % (2 * np.pi) / frequencies[k]
    assert design["delay margin"] == pytest.approx(delays.min(), rel=2e-3)
    # Two channels that are alike cross at one frequency.
    assert design["frequency there"] == pytest.approx(frequencies[k][delays.argmin()], rel=2e-3)


def test_the_bandwidth_is_where_the_low_pass_has_fallen(design: Checked) -> None:
    frequencies = np.geomspace(1e-2, 1e4, 20_001)
    numerator, denominator = design.D()
    D = np.polyval(numerator, 1j * frequencies) / np.polyval(denominator, 1j * frequencies)
    K = design.matrix("feedback_gain")
    gain = D[:, None, None] * K
    low_pass = gain @ np.linalg.inv(np.eye(len(K)) + gain)
    smallest = np.linalg.svd(low_pass, compute_uv=False)[:, -1]
    assert design["bandwidth"] == pytest.approx(frequencies[np.argmax(smallest < 0.5**0.5)], rel=2e-3)


@pytest.mark.parametrize("name", sample.FMUS)
def test_every_fmu_is_checked_and_the_exit_code_is_its_verdict(name: str) -> None:
    answer = adaptive_fmu("check", name, "--json")
    output = json.loads(answer.stdout)
    assert answer.stderr == "" and output["name"] == name
    unsound = any(finding["verdict"] == "not_sound" for finding in output["findings"])
    assert (answer.returncode, output["sound"]) == ((3, False) if unsound else (0, True))
    # Whatever isn't right comes with advice.
    assert all(finding["note"] for finding in output["findings"] if finding["verdict"] != "ok")


def test_people_see_the_same_verdict_and_the_advice() -> None:
    answer = adaptive_fmu("check", "L1NonlinearSiso")
    assert answer.returncode == 0 and answer.stdout.startswith("L1NonlinearSiso: warning")
    assert "not proved for all of theta_bound" in answer.stdout
    assert "delay margin" in answer.stdout and "feedback_gain times" in answer.stdout
    answer = adaptive_fmu("check", "NonlinearSiso")
    assert answer.returncode == 0 and "nothing else to check" in answer.stdout


def test_a_refused_description_is_reported_by_line_and_key(tmp_path: Path) -> None:
    text = (ROOT / "modelDescription" / "L1NonlinearSiso.toml").read_text()
    for old, new, named in [
        ("description = ", "descritpion = ", ["line 4", "descritpion"]),
        ("omega_min = [0.5]", "omega_min = [5.0]", ["omega_min[1,1] = 5", "omega_max[1,1]"]),
    ]:
        (tmp_path / "Broken.toml").write_text(text.replace(old, new))
        answer = adaptive_fmu("check", tmp_path / "Broken.toml")
        assert (answer.returncode, answer.stdout) == (1, "")
        assert "Broken.toml" in answer.stderr and all(word in answer.stderr for word in named), answer.stderr


def test_the_page_of_an_fmu_holds_its_report(fmu) -> None:
    page = (Path(fmu("L1NonlinearSiso").folder) / "documentation" / "index.html").read_text()
    assert '<h2 id="report">Design report</h2>' in page and "feedback_gain times" in page
    assert "<h2>Design report</h2>" not in (Path(fmu("NonlinearSiso").folder) / "documentation" / "index.html").read_text()
