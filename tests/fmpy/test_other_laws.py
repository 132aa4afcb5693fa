"""Laws that no loop of the thesis has, on its plants: loops as a user closes them by `new loop`."""

import json
import re
from pathlib import Path

import pytest
from conftest import adaptive_fmu

SPLIT = ("--order", "jacobi", "--step", "0.005")


def metrics(folder: Path, controller: str, *options: str) -> tuple[list[float], list[float]]:
    """The rms of each error, and the largest magnitude of each control, of the robot's loop."""
    units = ["ReferenceTwoLinkRobot", "TwoLinkRobot", controller]
    made = adaptive_fmu("new", "loop", "--units", *units, "--until", "10", "--out", "robot", folder=folder)
    assert made.returncode == 0, made.stderr
    run = adaptive_fmu("run", "robot", *options, folder=folder)
    assert run.returncode == 0, run.stderr
    (file,) = folder.glob("results/*/metrics.json")
    recorded = json.loads(file.read_text())["metrics"]
    of = lambda words: [metric["value"] for metric in recorded if re.match(words, metric["label"])]  # noqa: E731
    return of("rms"), of(r"max \|u")


@pytest.mark.parametrize(
    ("controller", "largest"),
    [("LadrcTwoLinkRobot", [51.9, 4.36]), ("L1LimitTwoLinkRobot", [113.4, 88.9]), ("L1SampledTwoLinkRobot", [149.2, 54.9])],
)
def test_a_law_controls_the_robot_as_a_composite(controller: str, largest: list[float], tmp_path: Path) -> None:
    errors, controls = metrics(tmp_path, controller, "--composite", "--step", "0.001")
    assert max(errors) < 0.1
    assert controls == pytest.approx(largest, rel=5e-3)


def test_the_sampled_law_holds_where_the_continuous_one_is_lost(tmp_path: Path) -> None:
    """At 5 ms, where a master steps all units at once: with the dead time that this is, and without knowing of it."""
    peaks = []
    for delay in (1, 0):
        folder = tmp_path / str(delay)
        folder.mkdir()
        errors, controls = metrics(folder, "L1SampledTwoLinkRobot", *SPLIT, "--set", f"controller.delay_steps={delay}")
        assert max(errors) < 0.06
        peaks.append(controls)
    assert peaks[0] == pytest.approx([151, 54], rel=0.01)
    assert all(1.2 * known < found < 2 * known for known, found in zip(*peaks, strict=True)), "larger peaks"
    lost = tmp_path / "lost"
    lost.mkdir()
    # Case 1 is that of its description; case 2 has the poles of the sampled law.
    poles = [f"controller.pole_real[{i + 1}]={pole}" for i, pole in enumerate((-30, -30, -40, -40))]
    poles += [f"controller.pole_imag[{i + 1}]={pole}" for i, pole in enumerate((0.5, -0.5, 0.5, -0.5))]
    with pytest.raises(AssertionError, match="failed at t = 0"):
        metrics(lost, "L1TwoLinkRobot", *SPLIT, *(word for pole in poles for word in ("--set", pole)))


def test_what_a_funnel_controller_measures_besides_is_left_to_decide(tmp_path: Path) -> None:
    units = ["ReferenceNonlinearSiso", "NonlinearSiso", "FunnelNonlinearSiso"]
    made = adaptive_fmu("new", "loop", "--units", *units, "--until", "5", "--out", "mine", folder=tmp_path)
    assert made.returncode == 0 and "controller.dy[1]" in made.stdout + made.stderr
    file = tmp_path / "mine" / "SystemStructure.ssd"
    text = file.read_text()
    rate = '<Connection startElement="plant" startConnector="x[2]" endElement="controller" endConnector="dy[1]"/>'
    prefix = re.search(r"<(\w+:)Connection ", text).group(1)
    file.write_text(text.replace(f"</{prefix}Connections>", f"{rate.replace('<', f'<{prefix}')}\n</{prefix}Connections>"))
    run = adaptive_fmu("run", "mine", "--composite", "--step", "0.001", folder=tmp_path)
    assert run.returncode == 0, run.stderr
    (written,) = tmp_path.glob("results/*/metrics.json")
    values = {metric["label"]: metric["value"] for metric in json.loads(written.read_text())["metrics"]}
    assert values["max |u[1]|"] == pytest.approx(36.0, rel=5e-3)
