"""What the L1 controllers are designed to, and their loops, against scipy."""

import numpy as np
import pytest
from conftest import adaptive_fmu
from independent_l1 import DESIGNS, L1, continuous_loop
from master import Fmu, Unit
from scipy.signal import place_poles

ROBOT, ACTUATED = "L1TwoLinkRobot", "L1ActuatedSiso"


def poles(design: L1) -> dict[str, float]:
    """A design's poles as parameters: each with its conjugate."""
    pairs = [pole for p in design.poles for pole in (p, p.conjugate())]
    parts = {f"pole_real[{i + 1}]": pole.real for i, pole in enumerate(pairs)}
    return parts | {f"pole_imag[{i + 1}]": pole.imag for i, pole in enumerate(pairs)}


def shown(unit: Unit, name: str, rows: int, columns: int) -> np.ndarray:
    return np.array([[unit[f"{name}[{i + 1},{j + 1}]"] for j in range(columns)] for i in range(rows)])


def check(unit: Unit, design: L1, Q: np.ndarray | None = None) -> None:
    """The matrices that a controller shows are scipy's."""
    m, n = design.m, 2 * design.m
    expected = {"K_m": design.K_m, "A_m": design.A_m, "P": design.P(Q), "K_g": design.K_g}
    for name, matrix in expected.items():
        # Entries that are zero are so to the last digits of the largest.
        within = {"rtol": 1e-9, "atol": 1e-14 * np.abs(matrix).max()}
        np.testing.assert_allclose(shown(unit, name, *matrix.shape), matrix, **within, err_msg=name)
    K_m, chains = shown(unit, "K_m", m, n), np.eye(n, k=m)
    wanted = np.sort_complex([pole for p in design.poles for pole in (p, p.conjugate())])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(chains - design.B @ K_m)), wanted, rtol=1e-9)
    if m == 1:
        # With one input no other gain places them.
        np.testing.assert_allclose(K_m, place_poles(chains, design.B, wanted).gain_matrix, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "case"), [(ROBOT, "3.3.1-case1"), (ROBOT, "3.3.1-case2"), (ACTUATED, "4-case1"), (ACTUATED, "4-case3")]
)
def test_a_controller_shows_the_design_that_scipy_finds(unit, name: str, case: str) -> None:
    check(unit(name, **poles(DESIGNS[case])).start(), DESIGNS[case])


@pytest.mark.parametrize(
    ("name", "begun", "then"), [(ROBOT, "3.3.1-case1", "3.3.1-case2"), (ACTUATED, "4-case1", "4-case3")]
)
def test_poles_and_weights_tuned_while_running_give_the_design_that_scipy_finds(unit, name, begun, then) -> None:
    controller = unit(name, **poles(DESIGNS[begun])).start()
    controller.step(0.0, 1e-3)
    check(controller, DESIGNS[begun])
    for variable, value in poles(DESIGNS[then]).items():
        controller[variable] = value
    n = 2 * DESIGNS[then].m
    Q = np.diag(np.arange(1.0, n + 1))
    for i in range(n):
        controller[f"Q[{i + 1},{i + 1}]"] = Q[i, i]
    controller.step(1e-3, 1e-3)
    check(controller, DESIGNS[then], Q)


# Beyond the peaks of the control, and no further: scipy needs thousands of steps for a tenth of a second. With a fuzzy
# gain only as far as scipy, which doesn't see its kinks, is accurate enough itself.
@pytest.mark.parametrize(("loop", "stop"), [("3.3.1-case2", 0.2), ("4-case1", 0.12), ("4-case1-fuzzy", 0.06)])
def test_a_loop_as_a_composite_is_the_continuous_loop_that_scipy_solves(loop: str, stop: float, tmp_path) -> None:
    exported = adaptive_fmu("export", "--composite", loop, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    (file,) = tmp_path.glob("*.fmu")
    times = np.linspace(0.0, stop, round(stop / 0.01) + 1)
    x, u = continuous_loop(loop, times, 1e-8)
    fmu = Fmu(file, tmp_path / "unpacked")
    # Of the control, which holds K_m x and estimates that oscillate, a millionth of its peak.
    peak = np.abs(u).max()
    for tolerance, of_x, of_u in ((1e-6, 1e-6, 1e-6 * peak), (1e-9, 2e-8, 1e-7 * peak)):
        with Unit(fmu) as whole:
            whole["relative_tolerance"] = tolerance
            # Such that much of the inference's range is gone through in this time.
            for name, value in zip(("k_p", "k_d", "k_e"), DESIGNS[loop].fuzzy or (), strict=False):
                whole[f"controller.{name}"] = value
            whole.start(stop=stop)
            for k, (t, following) in enumerate(zip(times[:-1], times[1:], strict=True), start=1):
                whole.step(t, following - t)
                for name, expected, bound in (("plant.x", x[k], of_x), ("controller.u", u[k], of_u)):
                    values = [whole[f"{name}[{i + 1}]"] for i in range(len(expected))]
                    assert np.abs(values - expected).max() < bound, (tolerance, name, following)
