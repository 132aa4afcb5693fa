"""`explore` as a design tool: what comes first, names of signals at elements of matrices, the curve before, a narrow screen."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from conftest import ROOT, adaptive_fmu
from test_explore import AMPLITUDE, GAIN, Explored, curves, ran, slider
from test_explore import browser as browser  # noqa: PLC0414 (fixtures)
from test_explore import explored as explored  # noqa: PLC0414
from test_explore import page as page  # noqa: PLC0414

MOTOR = ROOT / "examples" / "own" / "dc_motor"


def test_gains_and_desired_dynamics_come_first_and_limits_last(page: Callable[..., Any]) -> None:
    shown = page()
    shown.locator("#all").check()
    names = shown.evaluate("[...document.querySelectorAll('.slider')].map(it => it.dataset.name)")
    own = [name for name in names if name.startswith("controller.")]
    place = {name: place for place, name in enumerate(own)}
    gains = [GAIN, "controller.feedback_gain[1,1]", "controller.A_m[2,1]"]
    limits = ["controller.u_max[1]", "controller.omega_min[1,1]", "controller.sigma_bound[1]"]
    about_numbers = ["controller.relative_tolerance", "controller.input_handling"]
    groups = [[place.pop(name) for name in group if name in place] for group in (gains, limits, about_numbers)]
    assert len(groups[0]) == len(groups[1]) == 3
    assert max(groups[0]) < min(place.values()) + len(place) and max(groups[0]) < min(groups[1])
    assert all(groups[1][0] > place[name] for name in ["controller.Q[1,1]", "controller.u_ad_start[1]"] if name in place)
    assert not groups[2] or min(groups[2]) > max(groups[1])


def test_elements_of_matrices_show_which_signal_acts_on_which(page: Callable[..., Any], tmp_path: Path) -> None:
    made = adaptive_fmu("export", *MOTOR.glob("*.toml"), "--out", tmp_path)
    assert made.returncode == 0, made.stderr
    served = Explored(tmp_path, MOTOR, "--until", "0.5")
    try:
        answer = json.loads(served.ask("GET", "/loop")[1])["parameters"]
        acts = {it["name"]: it["acts"] for it in answer if it["acts"]}
        assert acts["motor.A[1,2]"] == "speed ← current" and acts["motor.A[2,2]"] == "current ← current"
        assert acts["motor.B[2,1]"] == "current ← voltage" and acts["motor.C[1,1]"] == "speed_output ← speed"
        shown = page(served=served)
        shown.locator("#find").fill("current ← voltage")
        assert shown.locator(".slider:visible").evaluate_all("all => all.map(it => it.dataset.name)") == ["motor.B[2,1]"]
        assert "current ← voltage" in slider(shown, "motor.B[2,1]").locator("label").text_content()
    finally:
        served.process.kill()


def test_without_names_an_element_has_its_indices_only(explored: Explored) -> None:
    assert not any(it["acts"] for it in json.loads(explored.ask("GET", "/loop")[1])["parameters"])


def ghosts(page: Any) -> list[str]:
    return [path.get_attribute("d") for path in page.locator(".plot path.ghost").all()]


def test_the_curve_before_stays_as_a_pale_one_until_the_next_change(page: Callable[..., Any]) -> None:
    shown = page()
    before, number = curves(shown), ran(shown)
    assert not ghosts(shown) and shown.locator("#ghost").is_hidden()
    amplitude = slider(shown, AMPLITUDE).locator("input[type=range]")
    # However many runs a move of the slider makes, the pale curve is that before it.
    for _ in range(4):
        amplitude.press("ArrowLeft")
    number = ran(shown, number)
    assert len(ghosts(shown)) == len(before) and shown.locator("#ghost").is_visible()
    pale = shown.evaluate("drawn.map(it => it.ghosts.map(curve => curve.y))")
    slider(shown, AMPLITUDE).locator("button").click()
    number = ran(shown, number)
    assert shown.evaluate("drawn.map(it => it.curves.map(curve => curve.y))") == pale
    # A curve that is hidden hides its pale one.
    shown.locator(".legend button").first.click()
    assert len(ghosts(shown)) == len(before) - 1


def test_on_a_narrow_screen_the_plot_stays_next_to_the_sliders(page: Callable[..., Any]) -> None:
    shown = page(width=400)
    shown.locator("#all").check()
    last = shown.locator(".slider:visible").nth(25)
    last.scroll_into_view_if_needed()
    shown.mouse.wheel(0, 300)
    plot = shown.locator(".plot svg").first.bounding_box()
    assert 0 <= plot["y"] and plot["y"] + plot["height"] <= 450 and plot["width"] <= 400
    assert shown.evaluate("document.documentElement.scrollWidth") <= 400
    # The slider that is moved isn't beneath the plot.
    assert (
        shown.evaluate("[...document.querySelectorAll('.slider')].filter(it => it.getBoundingClientRect().top > 450).length") > 2
    )
