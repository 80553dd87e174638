"""What a view says and does with what was found, without a browser."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from matplotlib import colormaps
from nicegui import Client, ui
from nicegui.page import page

from cruise.effects import Stage
from cruise.model.files import CustomTerm
from cruise.workbench import commands
from cruise.workbench.found import Card, Diagnosed, Minute, Question, Signature
from cruise.workbench.live import Live
from cruise.workbench.page import Page
from cruise.workbench.session import MODEL
from cruise.workbench.verbs import added
from cruise.workbench.views import adding, failing, missing, taking
from tests.workbench.conftest import quiet


def shown(view, session) -> list:
    """The elements of a view."""
    with Client(page(""), request=None) as client:
        view.show(Page(session, session.setup, Live(), client))
        return list(client.elements.values())


def test_another_stage_leaves_what_was_typed(session):
    elements = shown(adding, session)
    stage = next(one for one in elements if isinstance(one, ui.select) and Stage.LOAD in one.options)
    text = next(one for one in elements if isinstance(one, ui.input) and one.value in adding.EXAMPLE.values())
    stage.set_value(Stage.LOAD)
    assert text.value == adding.EXAMPLE[Stage.LOAD]
    text.set_value("tanh(speed_mps)")
    stage.set_value(Stage.GAIN)
    assert text.value == "tanh(speed_mps)"


def test_what_shows_the_page_anew_leaves_a_term_as_it_was_typed(session, better):
    fields: list[Any] = [one for one in shown(adding, session) if isinstance(one, ui.input | ui.number)]
    for one, value in zip(fields, ("header", "-tanh(p1*pitch_deg)", 4.0), strict=True):
        one.set_value(value)
    again = [one.value for one in shown(adding, session) if isinstance(one, ui.input | ui.number)]
    assert again == ["header", "-tanh(p1*pitch_deg)", 4.0]
    session._stepped(replace(better, effect="header"))
    assert session.draft.name == "my_term"


def test_the_example_of_a_load_has_no_coefficient_beside_the_loads_own(recording, tmp_path):
    term = CustomTerm(name="hill", stage=Stage.LOAD, expression=adding.EXAMPLE[Stage.LOAD])
    found = added([recording], Question(MODEL), term, tmp_path / "hill.yaml", quiet)
    told = [one for one in found.parameters if one.name.startswith("hill.")]
    assert [one.name for one in told] == ["hill.load"]
    assert 0.0 < told[0].std < 0.1 * abs(told[0].after)
    assert found.doubts == ()


def test_a_load_of_the_wrong_sign_is_said_to_be_one(session, recording, tmp_path):
    term = CustomTerm(name="hill", stage=Stage.LOAD, expression="pitch_deg")  # which would push uphill
    found = added([recording], Question(MODEL), term, tmp_path / "hill.yaml", quiet)
    assert "There is no sign of it in these recordings" in found.doubts[0]
    session._stepped(found)
    labels = [one.text for one in shown(adding, session) if isinstance(one, ui.label)]
    assert any("where it gives some, write custom(hill, load, -(pitch_deg))" in text for text in labels)
    session._stepped(replace(found, doubts=("It makes the model worse: cruise diagnose says what would help.",)))
    labels = [one.text for one in shown(adding, session) if isinstance(one, ui.label)]
    assert "It makes the model worse: What is missing says what would help." in labels


def diagnosed_as(verdict: str, *effects: str) -> Diagnosed:
    """A diagnosis that named these, with little behind it."""
    x = np.linspace(0.0, 1.0, 5)
    one = Signature((x, x, x, x), (x, x, x, x))
    cards = tuple(
        Card(
            effect=name, headline="", physics="", equation="", confidence_words="", error_before_mps=0.2,
            error_after_mps=0.1, gain=0.5, sureness=3.0, counts=1.0, step=place, chosen=True, worth_adding=True,
            listed=True, numbers=(), look_alikes=(), experiment="", signature=one, curve=None,
        )
        for place, name in enumerate(effects, 1)
    )  # fmt: skip
    return Diagnosed(
        horizon_s=3.0, verdict=verdict, explained=True, effects=effects, signals=(), sentence="", next_experiment=(),
        hints=(), discounted="", core=(), hidden_mps=0.01, cards=cards, others=(), refused=(), error_before_mps=0.2,
        error_after_mps=0.1, floor_mps=(0.01, 0.02), minute=Minute(x, x, x, x, ""), picture=b"",
    )  # fmt: skip


def test_what_was_found_beside_what_was_added_is_still_said(session, better):
    session.steps[0].diagnosed = diagnosed_as("missing", "grade", "dead_zone")
    assert session.found_before == ("dead_zone",)
    buttons = [one.props["data-add"] for one in shown(missing, session) if "data-add" in one.props]
    assert buttons == ["dead_zone"]
    session.undo()
    assert session.found_before == (), "the search itself is shown there"
    session.redo()
    session.steps[1].added = replace(better, effect="my_term")
    assert session.found_before == (), "nobody searched beside it"
    session.steps[1].added = better
    session.steps[0].diagnosed = diagnosed_as("ambiguous", "grade", "dead_zone")
    assert session.found_before == (), "only one of them is missing"


def test_the_headline_counts_what_is_missing(session):
    session.undo()
    for effects, headline in ((("grade",), "and it is this one"), (("grade", "dead_zone"), "and it is these")):
        session.steps[0].diagnosed = diagnosed_as("missing", *effects)
        assert any(headline in str(getattr(one, "text", "")) for one in shown(missing, session))


def test_a_column_that_may_be_known_is_said(session):
    session.undo()
    hint = "if Slope [%] is pitch_deg, a line of the file of columns says so; then grade can be tried"
    session.steps[0].diagnosed = replace(diagnosed_as("unlisted"), hints=(hint,))
    assert any("If Slope [%] is pitch_deg" in str(getattr(one, "text", "")) for one in shown(missing, session))


def test_a_model_that_errs_more_is_none_to_drive_with(session, better):
    assert commands.lines(session)[-1].startswith("cruise run")
    session.steps[1].added = replace(better, error_before_mps=0.0856, error_after_mps=0.619)
    lines = commands.lines(session)
    assert not any("cruise run" in line for line in lines)
    assert lines[-1].startswith("# + grade did not lower the held-out error, 0.0856 before and 0.619 m/s now")
    words = " ".join(str(getattr(one, "text", "")) for one in shown(taking, session))
    assert "0.0856 before and 0.619 m/s now: drive with the model before it." in words
    assert "estimator and controller run" not in words


def test_the_colours_of_the_heat_map_begin_at_no_error(session):
    figure = next(
        one._props["options"] for one in shown(failing, session)
        if isinstance(one, ui.plotly) and one._props["options"]["data"][0]["type"] == "heatmap"
    )  # fmt: skip
    heat, _ = figure["data"]
    assert (heat["zmin"], heat["zmax"]) == (0.0, np.nanmax(heat["z"]))


def test_what_is_written_in_the_map_can_be_read_on_every_colour(begun, session):
    with Client(page(""), request=None) as client:
        heat, words = failing._figure(begun.cells, Page(session, session.setup, Live(), client))["data"]
    for x, y, ink in zip(words["x"], words["y"], words["textfont"]["color"], strict=True):
        share = heat["z"][heat["y"].index(y), heat["x"].index(x)] / heat["zmax"]
        light = np.array(colormaps["cividis"](share)[:3])
        light = np.where(light <= 0.04045, light / 12.92, ((light + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722)
        contrast = (light + 0.05) / 0.05 if ink == "#000000" else 1.05 / (light + 0.05)
        assert contrast > 4.5, "WCAG 2.2, 1.4.3"
