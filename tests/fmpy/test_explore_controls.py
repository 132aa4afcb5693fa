"""Controls of the page of `explore` for what is no Real: enumerations, whole numbers and Booleans."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from xml.etree import ElementTree

import pytest
from fmpy import read_model_description
from test_explore import Explored, metrics, ran, slider
from test_explore import browser as browser  # noqa: PLC0414 (fixtures)
from test_explore import explored as explored  # noqa: PLC0414
from test_explore import page as page  # noqa: PLC0414


@pytest.fixture(scope="module")
def fuzzy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Explored]:
    """A loop with an enumeration; as separate units, which have whole numbers, too."""
    served = Explored(tmp_path_factory.mktemp("fuzzy"), "4-case1-fuzzy", "--until", "1", "--separate")
    yield served
    served.process.kill()


OUTPUT, HANDLING, STEPS = "controller.fuzzy_output", "controller.input_handling", "controller.fixed_steps"
BOX = "plant.inertia_variation"


def test_each_type_of_parameter_has_a_control_of_its_own(fuzzy: Explored) -> None:
    answer = json.loads(fuzzy.ask("GET", "/loop")[1])
    controls = {it["name"]: it for it in answer["parameters"]}
    start = answer["cases"][0]["values"]
    assert controls[OUTPUT]["control"] == "choice" and len(controls[OUTPUT]["items"]) == 3 and controls[OUTPUT]["first"]
    assert start[OUTPUT] in controls[OUTPUT]["items"]
    assert controls[STEPS]["control"] == "whole" and controls[STEPS]["limits"] == [1, 10000] and start[STEPS] == 1
    assert not controls[STEPS]["first"] and not controls[HANDLING]["first"]
    assert controls["controller.constant_gain"]["control"] == "slider"
    # What was chosen stands in a set, by its type, and a run with it is another.
    values = {OUTPUT: "constant", STEPS: 3, "controller.constant_gain": 0.5}
    text = fuzzy.wanted("/set", name="a", values=values)[1]["set"]
    parameters = ElementTree.fromstring(text).findall(".//{*}Parameter")
    assert {it.get("name"): (it[0].tag.split("}")[1], it[0].get("value")) for it in parameters} == {
        OUTPUT: ("Enumeration", "constant"),
        STEPS: ("Integer", "3"),
        "controller.constant_gain": ("Real", "0.5"),
    }
    assert fuzzy.wanted("/run")[1]["metrics"] != fuzzy.wanted("/run", values=values)[1]["metrics"]


def test_a_value_of_another_type_is_refused_with_what_it_must_be(fuzzy: Explored) -> None:
    for name, value, reason in [
        (OUTPUT, "cubic", "must be one of "),
        (OUTPUT, 3, "must be one of "),
        (STEPS, 1.5, "must be a whole number"),
        (STEPS, "3", "must be a whole number"),
        ("controller.constant_gain", True, "must be a finite number"),
    ]:
        assert reason in fuzzy.wanted("/run", values={name: value})[1]["error"], (name, value)
    # What is of the type and not allowed is the unit's to refuse.
    answer = fuzzy.wanted("/run", values={STEPS: 0})[1]
    assert answer["at"] == [STEPS] and "fixed_steps" in answer["refused"]


def test_what_is_no_real_is_chosen_and_goes_into_link_set_and_fmus(page: Callable[..., Any], tmp_path: Path) -> None:
    served = Explored(tmp_path, "4-case1-fuzzy", "--until", "2")
    try:
        shown = page(served=served)
        before, number = metrics(shown), ran(shown)
        control = slider(shown, OUTPUT)
        items = control.locator("option").all_text_contents()
        begin = control.locator("select").input_value()
        assert "constant" in items and len(items) == 3 and begin != "constant"
        control.locator("select").select_option("constant")
        ran(shown, number)
        assert metrics(shown) != before and "moved" in control.get_attribute("class")
        shown.wait_for_function("() => location.hash.includes('fuzzy_output=constant')")
        # The link brings it to another page; an item that is none is left out.
        link = urlsplit(shown.url).fragment
        again = page(f"#{link}&{OUTPUT}=cubic", served)
        assert slider(again, OUTPUT).locator("select").input_value() == "constant" and metrics(again) == metrics(shown)
        # The case that chooses the same brings it, too.
        number = ran(again)
        again.locator("#reset").click()
        ran(again, number)
        number = ran(again)
        again.locator("#case").select_option("two-level.ssv")
        ran(again, number)
        assert slider(again, OUTPUT).locator("select").input_value() == "constant"
        assert not again.locator(".slider.moved").count()
        shown.locator("#name").fill("chosen")
        shown.locator("#save").click()
        shown.get_by_text("Saved:").wait_for()
        saved = ElementTree.parse(tmp_path / "4-case1-fuzzy-explored" / "chosen.ssv")
        assert [(it.get("name"), it[0].get("value")) for it in saved.getroot().findall(".//{*}Parameter")] == [
            (OUTPUT, "constant")
        ]
        shown.locator("#export").click()
        shown.get_by_text("FMUs that start with these values").wait_for(timeout=120_000)
        (file,) = (tmp_path / "4-case1-fuzzy-explored" / "chosen").glob("Fuzzy*.fmu")
        start = {variable.name: variable.start for variable in read_model_description(file).modelVariables}
        assert start["fuzzy_output"] == str(1 + items.index("constant"))
        # The way back.
        number = ran(shown)
        control.locator("button").click()
        ran(shown, number)
        assert control.locator("select").input_value() == begin and metrics(shown) == before
    finally:
        served.process.kill()


def test_a_box_is_ticked_and_a_whole_number_typed(page: Callable[..., Any], tmp_path: Path) -> None:
    served = Explored(tmp_path, "3.3.1-case1", "--until", "0.5", "--separate")
    try:
        shown = page(served=served)
        shown.locator("#all").check()
        number = ran(shown)
        slider(shown, BOX).locator("input[type=checkbox]").click()
        number = ran(shown, number)
        entry = slider(shown, "controller.fixed_steps").locator("input[type=number]")
        entry.fill("1.5")
        entry.press("Enter")
        assert entry.input_value() == "1"
        entry.fill("3")
        entry.press("Enter")
        number = ran(shown, number)
        shown.wait_for_function("() => location.hash.includes('fixed_steps=3')")
        link = urlsplit(shown.url).fragment
        again = page(f"#{link}", served)
        assert slider(again, BOX).locator("input").is_checked() == slider(shown, BOX).locator("input").is_checked()
        assert "moved" in slider(again, BOX).get_attribute("class")
        assert slider(again, "controller.fixed_steps").locator("input").input_value() == "3"
        # A whole number that the unit doesn't allow is told at its field.
        entry.fill("0")
        entry.press("Enter")
        slider(shown, "controller.fixed_steps").locator(".wrong").wait_for(timeout=60_000)
    finally:
        served.process.kill()
