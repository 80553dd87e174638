"""A signal that is known part of the time only does not choose the samples on which its effect is judged."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import EFFECTS
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.candidates import why_not
from cruise.validation.complete import complete
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.study import study
from tests.validation.diagnosing import DT_S, PERIOD_S, SECONDS, STRUCTURE
from tests.validation.driving import drive


def recorded(**holes: slice) -> Recording:
    rng, columns = np.random.default_rng(3), {}
    for name in (INPUT, OUTPUT, "pitch_deg", "oil_temperature_c"):
        columns[name] = rng.normal(size=100)
        columns[name][holes.get(name, slice(0))] = np.nan
    return Recording(0.1 * np.arange(100), columns, 0.1, "a.csv")


def test_a_signal_with_many_holes_is_left_out_and_one_with_few_makes_holes_of_the_recording():
    (one,) = complete([recorded(oil_temperature_c=slice(0, 40), pitch_deg=slice(90, 95))], ())
    assert set(one.columns) == {INPUT, OUTPUT, "pitch_deg"}
    assert one.notes == ("oil_temperature_c: known in 60 % of the time only, left out: it can't be blamed",)
    assert np.flatnonzero(np.isnan(one.output)).tolist() == [90, 91, 92, 93, 94]
    assert (
        why_not(EFFECTS["oil_temperature"], [one])
        == "oil_temperature_c is not recorded throughout: known in 60 % of the time only"
    )
    assert np.isfinite(one.input).all(), "what is known of the current acts on what comes behind the hole"


def test_an_offset_between_the_two_speeds_is_said_as_the_models_constant_takes_it():
    wheel = np.interp(np.arange(1800), np.arange(0, 1800, 30), np.random.default_rng(4).uniform(0.0, 2.0, 60))
    noise = 0.02 * np.random.default_rng(5).standard_normal(1800)
    columns = {INPUT: 300.0 * wheel, "wheel_speed_mps": wheel, "pitch_deg": noise}
    for offset_mps in (0.0, -0.05):
        one = Recording(0.1 * np.arange(1800), {**columns, OUTPUT: wheel + offset_mps + noise}, 0.1, "a.csv")
        (found,) = complete([one], ())
        assert any("m/s less than wheel speed, at any speed" in note for note in found.notes) is (offset_mps < 0.0)


def test_what_some_recordings_lack_is_said_with_their_names():
    with_it, without = recorded(), recorded()
    without = replace(without, source="b.csv", columns={INPUT: without.input, OUTPUT: without.output})
    one, other = complete([with_it, without], ())
    assert set(one.columns) == {INPUT, OUTPUT}
    assert one.notes == other.notes
    assert one.notes == tuple(
        f"{name}: not in b.csv, left out of all: it can't be blamed beside that one"
        for name in ("oil_temperature_c", "pitch_deg")
    )
    assert why_not(EFFECTS["grade"], [one, other]) == "pitch_deg is not recorded throughout: not in b.csv"
    assert why_not(EFFECTS["engine_speed"], [one, other]) == "engine_speed_rpm is not recorded"
    many = complete([with_it, *(replace(without, source=f"{k}.csv") for k in range(5))], ())
    assert "not in 0.csv, 1.csv, 2.csv and 2 more, left out" in many[0].notes[0]


def test_what_the_model_needs_stays_and_the_recording_has_its_holes():
    (one,) = complete([recorded(oil_temperature_c=slice(0, 40))], {"oil_temperature_c"})
    assert "oil_temperature_c" in one.columns
    assert np.isnan(one.output).sum() == 40


def test_holes_that_are_few_each_and_many_together_cost_the_signal_that_has_most():
    (one,) = complete([recorded(oil_temperature_c=slice(0, 9), pitch_deg=slice(50, 58))], ())
    assert set(one.columns) == {INPUT, OUTPUT, "pitch_deg"}


def test_what_is_asked_for_is_no_cause_unless_a_term_of_the_user_reads_it():
    one = recorded()
    asked = {name: np.roll(one.input, -20) for name in ("lever_pct", "cruise_set", "pump_current_command_ma")}
    told = replace(one, columns={**one.columns, **asked})
    assert set(complete([told], ())[0].columns) == set(one.columns)
    assert set(complete([told], ("lever_pct",))[0].columns) == {*one.columns, "lever_pct"}


def test_another_reading_of_the_speed_is_no_cause_unless_a_term_of_the_user_reads_it():
    one = recorded()
    told = replace(one, columns={**one.columns, "by_satellite_kmh": 3.6 * one.output})
    (left,) = complete([told], ())
    assert set(left.columns) == set(one.columns)
    assert left.notes == ("by_satellite_kmh: goes with the ground speed itself, left out: it is an answer, no cause",)
    assert "by_satellite_kmh" in complete([told], {"by_satellite_kmh"})[0].columns


def test_a_pedal_is_no_cause_and_makes_a_hole_of_the_speed():
    one = recorded()
    told = replace(one, columns={**one.columns, "brake_pedal": (np.arange(100) // 5 == 3).astype(float)})
    (left,) = complete([told], ())
    assert set(left.columns) == set(one.columns)
    assert np.flatnonzero(np.isnan(left.output)).tolist() == list(range(15, 40))
    assert ["brake_pedal: pressed for 0.5 s" in note for note in left.notes] == [True]
    both = complete([told, one], ())
    assert both[1].notes == (), "a recording without the pedal loses nothing"


@pytest.mark.parametrize("from_s", [0.0, SECONDS / 2])
def test_a_sensor_that_is_missing_where_the_ground_is_rough_is_not_what_is_missing(from_s):
    samples = round(SECONDS / DT_S)
    rng = np.random.default_rng(5)
    there = (np.arange(samples) * DT_S >= from_s) & (np.arange(samples) * DT_S < from_s + SECONDS / 2)
    rough = np.where(there, 0.01, 0.10) * np.convolve(rng.normal(size=samples), np.ones(20) / np.sqrt(20), "same")
    oil = np.where(there, np.linspace(20.0, 70.0, samples), np.nan)
    one = drive(SECONDS, 4, DT_S, 0.01, columns={"oil_temperature_c": oil})
    one = replace(one, columns={**one.columns, OUTPUT: one.output + rough})
    found = diagnose(study([one], STRUCTURE, None, PERIOD_S))
    assert found.verdict is not Verdict.MISSING
    assert "oil_temperature_c" not in found.signals
