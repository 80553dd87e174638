"""What holes in a recording cost: the same samples for every explanation, and no prediction reaches over one."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.grade import Grade
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.rate_limit import RateLimit
from cruise.model.core import TAIL
from cruise.recording import Recording, resample
from cruise.signals import INPUT, OUTPUT
from cruise.validation.explanation import Explanation
from cruise.validation.simulation import SETTLES_S, Scene
from tests.validation.scenes import AHEAD, CORE, PERIOD_S, recording, scene_of


def with_hole(one: Recording, name: str, start: int, stop: int) -> Recording:
    values = np.array(one.columns[name])
    values[start:stop] = np.nan
    return Recording(one.time_s, {**one.columns, name: values}, one.dt_s, one.source)


def changed(one: Recording, holed: Recording, explanation: Explanation) -> np.ndarray:
    """The samples (N,) that lose their number by a hole; all others must keep it to the bit."""
    (whole,), (poor,) = scene_of(one).simulate([explanation]), scene_of(holed).simulate([explanation])
    lost = np.isfinite(whole) & np.isnan(poor)
    kept = np.isfinite(poor)
    np.testing.assert_allclose(poor[kept], whole[kept], rtol=0.0, atol=1e-9)
    return lost


def not_judged(scene: Scene, explanation: Explanation) -> np.ndarray:
    """The samples behind the first segment's warm-up that have no error."""
    (error,) = scene.errors([explanation])
    np.testing.assert_array_equal(np.isfinite(error), scene.judged)
    return np.flatnonzero(np.isnan(error[AHEAD:])) + AHEAD


PLAIN = Explanation(CORE, (), (), 0.1)
RINGING = Explanation(replace(CORE, resonance_share=0.8, resonance_hz=0.4, damping=0.03, lag_s=2.0), (), (), 0.1)
HYSTERESIS = Explanation(CORE, (Hysteresis(60.0),), (), 0.1)
SETTLES = round(SETTLES_S / PERIOD_S)


@pytest.mark.parametrize("explanation", [PLAIN, RINGING, HYSTERESIS], ids=["plain", "ringing", "hysteresis"])
def test_a_hole_costs_every_explanation_the_same_samples_however_long_it_remembers(explanation):
    """Else who remembers for long would be judged by few samples, and seem to err little."""
    one = recording(60.0)
    assert not len(not_judged(scene_of(one), explanation))
    in_speed = scene_of(with_hole(one, OUTPUT, 70, 73))
    np.testing.assert_array_equal(not_judged(in_speed, explanation), np.arange(70, 73 + AHEAD))
    in_current = scene_of(with_hole(one, INPUT, 110, 112))
    np.testing.assert_array_equal(not_judged(in_current, explanation), np.arange(110, 112 + SETTLES + AHEAD))


def test_no_prediction_reaches_over_a_hole():
    """What moved the machine there, such as its brake, would stand in all that was predicted from before it."""
    one = recording(60.0)
    elsewhere = np.array(one.output)
    elsewhere[:75] += 1.0
    moved = replace(one, columns={**one.columns, OUTPUT: elsewhere})
    holed = [with_hole(each, OUTPUT, 70, 75) for each in (one, moved)]
    (before,), (after,) = (scene_of(each).simulate([PLAIN]) for each in holed)
    np.testing.assert_array_equal(before[75:], after[75:])


def test_after_a_hole_in_the_current_the_core_is_where_the_current_before_it_would_have_brought_it():
    one = recording(60.0)
    explanation = Explanation(CORE, (DeadZone(200.0),), (), 0.1)
    holed = with_hole(one, INPUT, 110, 112)
    whole, poor = (scene_of(each).felt(CORE, (DeadZone(200.0),)) for each in (one, holed))
    assert np.isfinite(poor).all()
    settled = slice(112 + SETTLES, None)
    assert np.max(np.abs(poor[settled] - whole[settled])) < TAIL * np.ptp(one.input)
    assert np.isfinite(scene_of(holed).simulate([explanation])[0]).sum() > 200


def test_a_hole_in_the_current_of_a_finer_recording_costs_the_periods_that_hold_it():
    fine = recording(40.0, dt_s=0.05)
    holed = with_hole(fine, INPUT, 400, 420)
    coarse = resample(holed, PERIOD_S)
    hole = np.flatnonzero(np.isnan(coarse.input))
    assert 2 < len(hole) < 7
    scene = scene_of(coarse, raw=(holed,))
    assert np.isfinite(scene.felt(replace(CORE, delay_s=0.0), ())).all()
    np.testing.assert_array_equal(not_judged(scene, PLAIN), np.arange(hole[0], hole[-1] + 1 + SETTLES + AHEAD))


@pytest.mark.parametrize("effect", [Hysteresis(60.0), RateLimit(400.0, 0.1), DeadZone(300.0)])
def test_a_command_with_memory_lives_on_after_a_hole(effect):
    one = recording(60.0)
    held = np.array(one.input)
    held[100:103] = held[99]
    by_hand = scene_of(replace(one, columns={**one.columns, INPUT: held})).drive((effect,))
    np.testing.assert_array_equal(scene_of(with_hole(one, INPUT, 100, 103)).drive((effect,)), by_hand)


@pytest.mark.parametrize(
    ("effect", "load", "signal"),
    [(Grade(), 0.4, "pitch_deg"), (EngineSpeed(1.0), None, "engine_speed_rpm"), (GearRatio(), None, "gear")],
)
def test_a_hole_in_a_signal_costs_the_rest_of_its_segments(effect, load, signal):
    one = recording(60.0)
    explanation = Explanation(CORE, (effect,), () if load is None else (load,), 0.1)
    lost = np.flatnonzero(changed(one, with_hole(one, signal, 110, 111), explanation))
    np.testing.assert_array_equal(lost, np.arange(110, 135))  # of the segments that start at 60 and 90
    nowhere = with_hole(one, signal, 0, len(one))
    assert np.isnan(scene_of(nowhere).simulate([explanation])).all()
    without = Explanation(CORE, (), (), 0.1)
    assert not changed(one, nowhere, without).any()
