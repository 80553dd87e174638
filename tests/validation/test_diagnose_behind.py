"""Two effects that a far larger one hides: too little of its error each, together all that is left."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from cruise.signals import INPUT
from cruise.validation import selection
from cruise.validation.diagnose import Diagnosis, diagnose
from cruise.validation.selection import FURTHER, LEAST_SHARE
from cruise.validation.study import study
from cruise.validation.tried import BEYOND_DOUBT, Step, tried_in
from tests.validation.diagnosing import DT_S, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, few
from tests.validation.driving import GRAVITY_MPS2, drive, wander


@pytest.fixture(scope="module")
def three() -> Iterator[Diagnosis]:
    engine = wander(SAMPLES, DT_S, 15, 0.03, 5.0)
    one = drive(
        SECONDS,
        4,
        DT_S,
        0.005,
        command=lambda u: np.maximum(u - 450.0, 0.0),
        gain=1.0 + 0.45 * engine,
        load_mps=-0.025 * GRAVITY_MPS2 * np.sin(np.radians(PITCH)),
        columns={"pitch_deg": PITCH, "engine_speed_rpm": 2000.0 * (1.0 + engine)},
    )
    with few():
        yield diagnose(study([one], STRUCTURE, None, PERIOD_S))


def test_two_that_a_far_larger_one_hides_are_both_named(three):
    assert three.effects == ("dead_zone", "grade", "engine_speed")
    first, second, third, _ = three.steps
    grade = tried_in(second, "grade")
    assert grade is not None
    assert second.before.loss - grade.judged.loss < LEAST_SHARE * first.before.loss, "too little for a further effect"
    assert three.final.loss < 1.2 * third.background.noise
    assert three.confidence > 0.6


def beside(three: Diagnosis, monkeypatch, **changed) -> tuple[Step, Step]:
    """The steps behind the first effect; in the later one that is found then stands changed."""
    _, second, third, _ = three.steps
    tried = tuple(replace(one, **changed) if one.name == "engine_speed" else one for one in third.tried)
    then = replace(third, tried=tried)
    monkeypatch.setattr(selection, "tried_beside", lambda *given: then)
    return second, then


def behind(three: Diagnosis, step: Step, chosen: tuple[str, ...] = ("dead_zone",)):
    return selection._behind(three.study, step, chosen, np.random.default_rng(0), lambda text: None)


@pytest.mark.parametrize(
    ("changed", "are"),
    [
        ({}, True),
        ({"sureness": BEYOND_DOUBT - 0.1}, False),
        ({"gain": 0.45}, False),
        ({"credit": 0.9}, False),
    ],
)
def test_the_second_takes_most_of_what_the_first_leaves_and_beyond_doubt(three, monkeypatch, changed, are):
    step, _ = beside(three, monkeypatch, **changed)
    assert (behind(three, step) is not None) == are


def test_together_they_take_all_that_could_be_explained(three, monkeypatch):
    step, then = beside(three, monkeypatch)
    second = tried_in(then, "engine_speed")
    assert second is not None
    little = replace(second.judged, raw=second.judged.raw + 0.15 * step.before.raw)
    monkeypatch.setattr(
        selection, "tried_beside", lambda *given: replace(then, tried=(replace(second, judged=little),))
    )
    assert behind(three, step) is None


def test_what_goes_by_the_signals_of_the_larger_one_may_be_its_form(three, monkeypatch):
    step, _ = beside(three, monkeypatch)
    (grade,) = (one for one in step.tried if one.name == "grade")
    assert selection._elsewhere(grade, {INPUT})
    assert not selection._elsewhere(grade, {INPUT, "pitch_deg"})
    assert not selection._elsewhere(replace(grade, name="quadratic_gain"), {INPUT})
    assert not selection._elsewhere(replace(grade, name="leakage"), {INPUT}), "soil shows in the pressure"
    assert not selection._elsewhere(replace(grade, name="unnamed:pitch_deg"), {INPUT}), "no effect of the table"
    soil = replace(grade, name="rolling_resistance", gain=0.5)
    assert selection._elsewhere(replace(soil, sureness=BEYOND_DOUBT), {INPUT})
    assert not selection._elsewhere(replace(soil, sureness=BEYOND_DOUBT - 0.1), {INPUT}), "it may be soil"
    assert behind(three, step, ("dead_zone", "saturation", "coulomb_friction")) is None, "one too many"


CURVE = {"gain": 0.4, "credit": 1.0, "evidence": 300.0, "sureness": BEYOND_DOUBT}
OF_IT = {"gain": 0.22, "credit": 1.0, "evidence": FURTHER + 30.0, "sureness": BEYOND_DOUBT}


@pytest.mark.parametrize(
    ("curve", "effect", "named"),
    [
        ({}, {}, ["engine_speed"]),
        ({}, {"gain": 0.18}, []),
        ({}, {"evidence": FURTHER - 1.0}, []),
        ({}, {"credit": 0.5}, []),
        ({}, {"name": "oil_temperature"}, []),
        ({"credit": 0.5}, {}, []),
        ({"gain": 0.1}, {}, []),
    ],
)
def test_an_effect_that_takes_most_of_a_curve_of_its_own_signal_is_what_the_curve_shows(three, curve, effect, named):
    _, step, *_ = three.steps
    shown, found = (tried_in(step, name) for name in ("unnamed:engine_speed_rpm", "engine_speed"))
    assert shown is not None
    assert found is not None
    most = replace(shown.judged, raw=0.3 * step.before.raw)
    step = replace(step, tried=(replace(shown, judged=most, **(CURVE | curve)), replace(found, **(OF_IT | effect))))
    assert [one.name for one in selection._in_its_curve(step, step.before, ("dead_zone",))] == named
    known = ("dead_zone", "engine_speed")  # what goes by the signals of what is there is its own form
    assert selection._in_its_curve(step, step.before, known) == []
