"""Line pressure holds every force, recorded or not, and tells them from what acts on the command."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np
import pytest

from cruise.effects import EFFECTS, Stage
from cruise.effects.leakage import Leakage
from cruise.report.diagnosis import sentence
from cruise.signals import INPUT
from cruise.validation import mediator
from cruise.validation.diagnose import Diagnosis, Verdict, diagnose
from cruise.validation.study import study
from tests.validation.diagnosing import DT_S, HEADER, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, few, found
from tests.validation.driving import GRAVITY_MPS2, drive, wander
from tools.trial.run import table_without

MASS_KG = 15000.0 + wander(SAMPLES, DT_S, 14, 2500.0, 6.0)
LITTLE_MPS = 0.011  # standard deviation of a cause that leaves as much as noise of 0.02 m/s at 20 Hz does in 0.2 s


@pytest.fixture(scope="module", autouse=True)
def forces_and_others() -> Iterator[None]:
    """What is asked here is told by forces and a few of what is no force."""
    with few():
        yield


def pressed(
    pressure_bar: np.ndarray,
    load_mps: np.ndarray,
    mass_kg: np.ndarray | None = None,
    pitched: bool = True,
    others: Mapping[str, np.ndarray] = MappingProxyType({}),
    **hidden,
) -> Diagnosis:
    columns = {"header_height_mm": HEADER, "line_pressure_bar": pressure_bar}
    columns |= {"pitch_deg": PITCH} if pitched else {}
    columns |= {} if mass_kg is None else {"machine_mass_kg": mass_kg}
    columns |= others
    one = drive(SECONDS, 4, DT_S, 0.02, columns=columns, load_mps=load_mps, **hidden)
    return diagnose(study([one], STRUCTURE, None, PERIOD_S))


def bent(current_ma: np.ndarray) -> np.ndarray:
    """A characteristic that rises ever more steeply, as behind a dead zone whose edge is worn."""
    return np.maximum(current_ma - 350.0, 0.0)


def test_what_acts_on_the_command_is_weighed_where_the_pressure_shows_every_force():
    soil_mps = wander(SAMPLES, DT_S, 13, 0.06, 4.0)
    blind, seeing = found(load_mps=soil_mps, command=bent), pressed(120.0 - 300.0 * soil_mps, soil_mps, command=bent)
    assert (seeing.verdict, seeing.effects) == (Verdict.MISSING, ("dead_zone",))
    first = seeing.steps[0]
    mine = next(one for one in first.tried if one.name == "dead_zone")
    alone = next(one for one in blind.steps[0].tried if one.name == "dead_zone")
    assert mine.compared is not mine.judged
    assert mine.compared.loss < 0.2 * mine.judged.loss
    assert mine.evidence > 3.0 * alone.evidence
    assert first.forces is not None
    assert blind.steps[0].forces is None


def test_a_force_that_the_pressure_shows_is_nothing_that_acts_on_the_command():
    pull_mps = -0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    one = pressed(120.0 - 300.0 * pull_mps, pull_mps)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("grade",))
    first = one.steps[0]
    assert first.forces is None
    assert {"dead_zone", "quadratic_gain", "saturation"} <= set(first.refuted)
    assert all(one.credit == 0.0 for one in first.tried if one.name in first.refuted)
    assert EFFECTS["grade"].stage is Stage.LOAD
    assert "grade" not in first.refuted


def test_a_force_that_the_pressure_does_not_show_is_found_all_the_same():
    pull_mps = -0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    one = pressed(wander(SAMPLES, DT_S, 13, 60.0, 4.0), pull_mps)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("grade",))
    assert one.steps[0].refuted == ()


def test_leakage_is_found_beside_what_acts_on_the_command():
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.002 * (pressure_bar - 120.0), command=bent)
    assert (one.verdict, set(one.effects)) == (Verdict.MISSING, {"leakage", "dead_zone"})


def test_a_relief_valve_that_weeps_is_leakage_from_a_pressure_on():
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.004 * np.maximum(pressure_bar - 130.0, 0.0))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, Leakage)
    assert effect.onset_bar == pytest.approx(130.0, abs=5.0)


def test_a_force_that_nobody_recorded_shows_in_the_pressure_and_is_no_leakage():
    wind_mps = wander(SAMPLES, DT_S, 13, 0.2, 4.0)
    one = pressed(120.0 - 300.0 * wind_mps, wind_mps)
    assert one.unrecorded
    assert (one.verdict, one.effects, one.signals) == (Verdict.UNLISTED, (), ("line_pressure_bar",))
    assert one.explained
    assert one.final.loss < 0.1 * one.base.loss
    assert "a force that nobody recorded. It shows in `line_pressure_bar`" in sentence(one)


def test_a_force_that_nobody_recorded_is_said_beside_what_acts_on_the_command():
    wind_mps = wander(SAMPLES, DT_S, 13, 0.08, 4.0)
    one = pressed(120.0 - 300.0 * wind_mps, wind_mps, command=bent)
    assert (one.verdict, one.effects, one.beside) == (Verdict.MISSING, ("dead_zone",), "line_pressure_bar")
    assert "Beside it something is missing that line_pressure_bar shows" in sentence(one)
    still = pressed(120.0 + 10.0 * PITCH, 0.0 * PITCH, command=bent)
    assert (still.effects, still.beside) == (("dead_zone",), "")


def test_a_slope_is_a_force_though_no_effect_of_one_is_known():
    pull_mps = -0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    pressure_bar = 120.0 - 300.0 * pull_mps
    with table_without(["grade"]):
        one = pressed(pressure_bar, pull_mps)
    assert (one.verdict, one.signals) == (Verdict.UNLISTED, ("pitch_deg",))


@pytest.mark.parametrize(("by_current", "leaks"), [(0.5, True), (0.6, False)])
def test_what_the_current_alone_foretells_is_the_drives_answer_and_no_leakage(monkeypatch, by_current, leaks):
    """0.6 is what all signals foretell together."""
    monkeypatch.setattr(mediator, "share_told", lambda *given: by_current if given[-1] == INPUT else 0.6)
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.002 * (pressure_bar - 120.0))
    first = one.steps[0]
    leakage = next(tried for tried in first.tried if tried.name == "leakage")
    assert (leakage.credit == 1.0) == ("leakage" in one.effects) == leaks
    assert bool(first.refuted) == leaks


def test_where_no_slope_is_recorded_what_the_pressure_costs_is_leakage():
    """Any ground has slopes: that nothing foretells the force is no news of it."""
    slope_mps = -0.05 * PITCH
    one = pressed(120.0 - 300.0 * slope_mps, slope_mps, pitched=False)
    assert not one.unrecorded
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))


def test_what_the_pressure_costs_whoever_moves_it_is_leakage():
    pressure_bar = 120.0 + 15.0 * PITCH + 0.6 * (HEADER - 300.0)
    one = pressed(pressure_bar, -0.004 * (pressure_bar - 120.0))
    assert not one.unrecorded
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))


def test_leakage_is_one_cause_where_two_forces_would_act_in_just_the_proportion_that_the_pressure_shows():
    slope, weight = np.sin(np.radians(PITCH)), (MASS_KG - MASS_KG.mean()) / 15000.0
    in_proportion = 120.0 + 800.0 * slope + 150.0 * weight
    one = pressed(in_proportion, -0.002 * (in_proportion - 120.0), MASS_KG)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))
    assert any(step.taken == "leakage" and step.mediated > 0.0 for step in one.steps)
    two = pressed(120.0 + 800.0 * slope + 15.0 * weight, -0.002 * (in_proportion - 120.0), MASS_KG)
    assert (two.verdict, set(two.effects)) == (Verdict.MISSING, {"grade", "rolling_resistance"})


def test_leakage_is_one_cause_where_the_slope_is_most_of_the_pressure_and_nobody_recorded_the_rest():
    slope_bar = 800.0 * np.sin(np.radians(PITCH))
    other_bar = wander(SAMPLES, DT_S, 13, 0.6 * float(np.std(slope_bar)), 4.0)
    one = pressed(120.0 + slope_bar + other_bar, -0.004 * (slope_bar + other_bar))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("leakage",))
    alone = pressed(120.0 + slope_bar + other_bar, -0.004 * slope_bar)
    assert (alone.verdict, alone.effects) == (Verdict.MISSING, ("grade",))
    soil = pressed(120.0 + slope_bar + 0.25 * other_bar, -0.004 * (slope_bar + 0.25 * other_bar))
    assert (soil.verdict, soil.effects) == (Verdict.MISSING, ("grade",))


def test_one_recorded_signal_that_foretells_the_pressures_force_is_what_nobody_lists():
    pull_mps = 0.3 * np.cos((HEADER - 300.0) / 60.0)
    one = pressed(120.0 - 300.0 * (pull_mps + 0.1 * wander(SAMPLES, DT_S, 13, 0.2, 4.0)), pull_mps)
    assert (one.verdict, one.signals) == (Verdict.UNLISTED, ("header_height_mm",))
    assert not one.unrecorded


def test_the_pressures_force_is_that_of_one_recorded_signal_though_no_smooth_curve_has_its_form():
    pull_mps = -0.6 * np.clip((250.0 - HEADER) / 60.0, 0.0, 0.4)
    one = pressed(120.0 - 300.0 * pull_mps, pull_mps)
    assert (one.verdict, one.signals) == (Verdict.UNLISTED, ("header_height_mm",))


def test_a_little_soil_that_shows_in_the_pressure_is_nothing():
    soil_mps = wander(SAMPLES, DT_S, 13, 1.0, 4.0)
    pressure_bar = 120.0 - 25.0 * soil_mps / soil_mps.std()
    one = pressed(pressure_bar, LITTLE_MPS * soil_mps / soil_mps.std(), MASS_KG)
    assert (one.verdict, one.effects) == (Verdict.NOTHING, ())
