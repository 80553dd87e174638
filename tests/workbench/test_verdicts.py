"""What the page says where the answer is not one effect: nothing, something that is not listed, one of several."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cruise.csv_file import write_csv
from cruise.recording import Recording
from cruise.signals import INPUT
from tests.validation.driving import drive, wander
from tests.workbench.conftest import PATIENCE_MS, laid_out
from tests.workbench.test_walk import go, idle

SECONDS, DT_S = 160.0, 0.1
SAMPLES = round(SECONDS / DT_S)
PITCH = wander(SAMPLES, DT_S, 11, 2.5, 6.0)
HEADER = 300.0 + wander(SAMPLES, DT_S, 12, 60.0, 4.0)
GAIN = 1.0 - 0.08 * wander(SAMPLES, DT_S, 21, 1.0, 5.0)


def nothing() -> Recording:
    """The pitch moves and does nothing."""
    return drive(SECONDS, 4, DT_S, columns={"pitch_deg": PITCH, "header_height_mm": HEADER})


def late() -> Recording:
    """Nothing but 0.4 s more of dead time."""
    one = nothing()
    return replace(one, columns=dict(one.columns) | {INPUT: np.append(one.input[4:], np.full(4, one.input[-1]))})


def waiting() -> Recording:
    """A current that comes 0.4 s late for 25 s of every 50."""
    one = nothing()
    later = DT_S * np.arange(SAMPLES) % 50.0 < 25.0
    early = np.append(one.input[4:], np.full(4, one.input[-1]))
    return replace(one, columns=dict(one.columns) | {INPUT: np.where(later, early, one.input)})


def unlisted() -> Recording:
    """A dependence that no effect reads."""
    load_mps = 0.3 * np.cos((HEADER - 300.0) / 60.0)
    return drive(SECONDS, 4, DT_S, load_mps=load_mps, columns={"pitch_deg": PITCH, "header_height_mm": HEADER})


def ambiguous() -> Recording:
    """Oil that warms and an engine that slows by the same curve: either explains the drive."""
    oil_c = 50.0 + 33.0 * np.log1p((1.0 - GAIN) / 0.3)
    columns = {"engine_speed_rpm": 2100.0 * GAIN, "oil_temperature_c": oil_c}
    return drive(SECONDS, 4, DT_S, gain=GAIN, columns=columns)


def asked(page, recording: Recording, tmp_path) -> str:
    """The verdict on a recording that is dropped."""
    path = tmp_path / "drive.csv"
    write_csv(recording, path)
    page.locator("input[type=file]").set_input_files(path)
    page.get_by_text("How good, and how good at best").wait_for()
    idle(page)
    go(page, "What is missing")
    page.get_by_role("button", name="What is missing?").click()
    verdict = page.locator("[data-verdict]")
    verdict.wait_for()
    return verdict.get_attribute("data-verdict")


def test_nothing_is_missing_says_what_could_have_hidden(visit, tmp_path):
    page = visit()
    assert asked(page, nothing(), tmp_path) == "nothing"
    page.get_by_text("Nothing is missing.").wait_for()
    hidden = page.get_by_text(re.compile(r"by less than 0\.\d+ m/s RMS would not have been named"))
    hidden.wait_for()
    assert page.locator("[data-add]:visible").count() == 0, "nothing to add before one looks into a candidate"
    page.locator("[aria-expanded=false]").first.click()
    page.get_by_text("The evidence does not ask for it.").first.wait_for()
    laid_out(page)


def test_a_dead_time_that_the_models_taps_have_to_hold_is_said(visit, tmp_path):
    page = visit()
    assert asked(page, late(), tmp_path) == "nothing"
    page.get_by_text(re.compile(r"The dead time is 0\.\d+ s, and the model's is 0\.5 s")).wait_for()
    laid_out(page)


def test_a_dead_time_that_changes_is_named_and_no_constant_one_is_pressed_on_anybody(visit, tmp_path):
    page = visit()
    assert asked(page, waiting(), tmp_path) == "missing"
    page.get_by_text(re.compile("transport_delay is missing: .* No constant delay is a model of that")).wait_for()
    page.get_by_text(re.compile("^record when every command is sent")).wait_for()
    page.get_by_text("No constant delay is a model of one that changes").wait_for()
    assert "unelevated" not in (page.locator("[data-add=transport_delay]").get_attribute("class") or "")
    laid_out(page)


def test_what_is_not_in_the_library_is_named_by_its_signal(visit, tmp_path):
    page = visit()
    assert asked(page, unlisted(), tmp_path) == "unlisted"
    page.get_by_text("Something is missing that is none of the effects that cruise knows.").wait_for()
    page.get_by_text("1. a curve of header_height_mm").wait_for()
    page.get_by_text("A smooth curve without any physics").wait_for()
    page.get_by_text("The drive that tells", exact=True).wait_for()
    assert page.locator("[data-add]:visible").count() == 0, "a curve without physics can't be added"
    laid_out(page)


def test_what_can_not_be_told_apart_comes_with_the_drive_that_would_tell(visit, tmp_path):
    page = visit()
    assert asked(page, ambiguous(), tmp_path) == "ambiguous"
    page.get_by_text("this recording can't tell which of these it is").wait_for()
    offered = {one.get_attribute("data-add") for one in page.locator("[data-add]:visible").all()}
    assert {"engine_speed", "oil_temperature"} <= offered
    told = page.locator("section", has_text="The drive that tells").first.inner_text()
    assert "engine_speed:" in told
    assert "oil_temperature:" in told
    laid_out(page)


@pytest.mark.parametrize("view", ["Open", "Compare", "Where it fails", "Add", "Take away", "Live"])
def test_every_view_is_laid_out_well(begun, view):
    page = begun
    go(page, view)
    page.wait_for_timeout(1000)
    laid_out(page)


@pytest.fixture(scope="module")
def begun(chromium, server):
    """One visitor for all views, with the hidden effect added."""
    context = chromium.new_context(viewport={"width": 1440, "height": 900})
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(server)
    page.locator('[data-example="sometimes-slow"]').click()
    page.get_by_text("How good, and how good at best").wait_for()
    idle(page)
    go(page, "Add")
    page.get_by_label("Expression").fill("p1*pitch_deg")
    page.get_by_text("gain: scales the drive").click()
    page.get_by_role("option", name="load: adds a force").click()
    page.get_by_label("Expression").fill("p1*pitch_deg")
    page.get_by_role("button", name="See whether it helps").click()
    page.get_by_text("held-out error of this step").wait_for()
    idle(page)
    yield page
    context.close()
