"""Values that change during the run, chosen on the page of `explore`: what `run --event` does, refusals at their rows, any tool's FMUs."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote_plus, urlsplit

import pytest
from conftest import ROOT, adaptive_fmu
from test_explore import LOOP, Explored, curves, metrics, ran
from test_explore import browser as browser  # noqa: PLC0414 (fixtures)
from test_explore import explored as explored  # noqa: PLC0414
from test_explore import page as page  # noqa: PLC0414

OMEGA = {"time": 5, "name": "plant.omega", "value": "2.5"}


def test_a_run_with_changes_is_that_of_the_program(explored: Explored, tmp_path: Path) -> None:
    changed = [OMEGA, {"time": 7.5, "name": "controller.u_max[1]", "value": "1.5"}]
    _, reply = explored.wanted("/run", events=changed, fine=True)
    words = [word for it in changed for word in ("--event", f"{it['time']}: {it['name']}={it['value']}")]
    answer = adaptive_fmu("run", LOOP, "--composite", "--until", "10", *words, "--json", "--out", tmp_path)
    assert [it["value"] for it in reply["metrics"]] == [it["value"] for it in json.loads(answer.stdout)["metrics"]]
    assert [mark["time"] for mark in reply["diagrams"][0]["marks"]] == [5, 7.5] and reply["events"] == []
    plain = explored.wanted("/run", fine=True)[1]
    assert plain["metrics"] != reply["metrics"] and plain["diagrams"][0]["marks"] == []


def test_what_may_change_is_offered_and_what_may_not_is_refused_at_its_place(explored: Explored) -> None:
    answer = json.loads(explored.ask("GET", "/loop")[1])
    offered = {it["name"]: it for it in answer["changeable"]}
    assert offered["plant.omega"]["value"] == "2" and "mean input gain" in offered["plant.omega"]["description"]
    assert "controller.enabled" in offered and not {"plant.u[1]", "plant.x0[1]", "controller.fixed_steps"} & set(offered)
    for wrong, reason in [
        ({"name": "plant.omga"}, "did you mean `plant.omega`"),
        ({"name": "plant.x0[1]"}, "can't change during a run: it is a fixed parameter, which is set before a run"),
        ({"value": "much"}, "`plant.omega` = much: must be a finite number"),
        ({"time": 10}, "time = 10 s: must be within the run, from 0 s to before 10 s"),
        ({"time": -1}, "must be within the run"),
        ({"name": "controller.adaptation_gain", "value": "-1"}, "must be at least 0"),
    ]:
        answer = explored.wanted("/run", events=[OMEGA, OMEGA | wrong])[1]
        assert reason in answer["refused"] and answer["events"] == [1] and "--" not in answer["refused"], answer
    # What only the FMU refuses ends the run there.
    answer = explored.wanted("/run", events=[OMEGA, {"time": 5, "name": "controller.omega_min[1,1]", "value": "50"}])[1]
    assert answer["end"] == 5 and answer["events"] == [1] and "must not be above controller.omega_max[1,1]" in answer["shortfall"], answer
    assert explored.ask("POST", "/run", {"case": None, "values": {}, "events": [OMEGA | {"further": 1}]})[0] == 400


def fill(shown: Any, row: Any, variable: str, time: str | None = None, value: str | None = None) -> None:
    for place, text in enumerate([variable, time, value]):
        if text is not None:
            row.locator("input").nth(place).fill(text)
            row.locator("input").nth(place).press("Tab")


def test_a_reader_adds_a_change_which_its_link_brings_back(page: Callable[..., Any]) -> None:
    shown = page()
    before, drawn, number = metrics(shown), curves(shown), ran(shown)
    shown.locator("#steps summary").click()
    shown.locator("#add").click()
    row = shown.locator(".step")
    # The middle of the run and the present value are proposed: nothing changes by them.
    fill(shown, row, "plant.omega")
    assert [field.input_value() for field in row.locator("input").all()] == ["plant.omega", "5", "2"]
    number = ran(shown, number)
    assert metrics(shown) == before and shown.locator(".plot .event").count() == 2
    fill(shown, row, "plant.omega", value="2.5")
    number = ran(shown, number)
    assert curves(shown) != drawn and metrics(shown) != before
    changed = metrics(shown)
    # A refusal stands in the row; the last curves stay.
    drawn = curves(shown)
    fill(shown, row, "plant.omega", time="11")
    row.locator(".wrong").wait_for()
    assert "must be within the run" in row.locator(".wrong").text_content()
    assert curves(shown) == drawn and shown.locator("#diagrams.stale").count() == 1
    number = ran(shown)
    fill(shown, row, "plant.omega", time="5")
    number = ran(shown, number)
    assert row.locator(".wrong").is_hidden() and metrics(shown) == changed
    shown.wait_for_function("() => location.hash.includes('event=')")
    link = urlsplit(shown.url).fragment
    assert unquote_plus(link) == "event=5: plant.omega=2.5"
    again = page(f"#{link}")
    assert metrics(again) == changed and again.locator(".step input").first.is_visible()
    shown.locator("#save").click()
    shown.get_by_text("--event '5: plant.omega=2.5'").wait_for()
    # The metrics of the loop as it is remain those without the change.
    assert shown.locator("#metrics tbody tr td:nth-child(2)").all_text_contents() == before
    number = ran(shown)
    row.get_by_label("Remove this change").click()
    ran(shown, number)
    assert metrics(shown) == before and not shown.locator(".step").count()


@pytest.mark.parametrize("changed", ["plant.omega", "controller.enabled"])
def test_any_tools_fmus_change_during_a_run(changed: str, tmp_path: Path, fmu_folder: Path) -> None:
    """A tunable parameter and an open input of FMUs that the loop names by their files, as those of other tools."""
    for name in ["SystemStructure.ssd", "reference.ssv"]:
        text = (ROOT / "examples" / LOOP / name).read_text()
        text = text.replace('stopTime="60.0"', 'stopTime="1.5"').replace('"resources/', '"elsewhere/')
        (tmp_path / name).write_text(text)
    (tmp_path / "elsewhere").mkdir()
    for name in ["NonlinearSiso", "ReferenceNonlinearSiso", "L1NonlinearSiso"]:
        shutil.copy(fmu_folder / f"{name}.fmu", tmp_path / "elsewhere")
    served = Explored(tmp_path, tmp_path)
    try:
        assert not json.loads(served.ask("GET", "/loop")[1])["whole"]
        event = {"time": 1, "name": changed, "value": {"plant.omega": "2.5"}.get(changed, "false")}
        plain, answer = served.wanted("/run")[1], served.wanted("/run", events=[event])[1]
        before, after = ([curve["y"] for curve in it["diagrams"][0]["curves"]] for it in (plain, answer))
        assert before != after and answer["shortfall"] is None
        words = ["run", tmp_path, "--event", f"1: {changed}={event['value']}", "--json", "--out", tmp_path / "out"]
        assert [it["value"] for it in answer["metrics"]] == [
            it["value"] for it in json.loads(adaptive_fmu(*words, folder=tmp_path).stdout)["metrics"]
        ]
    finally:
        served.process.kill()
