"""Slip is what makes wheel and ground speed differ by a share: not the tyre's radius, not a late sensor, no bias."""

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.slip import FEWEST_BLOCKS, WHEEL, slip_mps, sure_of_slip
from tests.validation.driving import wander

DT_S, SAMPLES = 0.2, 3000
SPEED = 1.6 + 0.5 * wander(SAMPLES, DT_S, 1, 1.0, 4.0)
RNG = np.random.default_rng(2)
NOISE = 0.02 * RNG.standard_normal((2, SAMPLES))


def recorded(wheel: np.ndarray, ground: np.ndarray = SPEED) -> Recording:
    columns = {"pump_current_ma": np.zeros(SAMPLES), OUTPUT: ground + NOISE[0], WHEEL: wheel + NOISE[1]}
    return Recording(DT_S * np.arange(SAMPLES), columns, DT_S, "test")


def test_slip_that_wanders_is_found_in_its_size():
    slip = 0.06 * wander(SAMPLES, DT_S, 3, 1.0, 15.0)
    slip -= slip.mean()
    assert slip_mps([recorded(SPEED + slip)]) == pytest.approx(slip.std(), rel=0.15)


@pytest.mark.parametrize("wheel", [SPEED, 1.04 * SPEED + 0.05, np.concatenate([SPEED[:1], SPEED[:-1]])])
def test_radius_offset_and_lateness_are_no_slip(wheel):
    assert slip_mps([recorded(wheel)]) < 0.006


def test_without_the_wheels_or_with_holes_only_nothing_is_said():
    one = recorded(SPEED)
    bare = Recording(one.time_s, {name: one.columns[name] for name in ("pump_current_ma", OUTPUT)}, DT_S, "test")
    assert slip_mps([one, bare]) == 0.0
    assert slip_mps([recorded(np.full(SAMPLES, np.nan))]) == 0.0


@pytest.mark.parametrize("time_constant_s", [5.0, 15.0, 60.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_share_of_the_speed_is_told_from_what_is_the_same_at_any_speed(seed, time_constant_s):
    lost = wander(SAMPLES, DT_S, 40 + seed, 1.0, time_constant_s)
    assert sure_of_slip([recorded(SPEED, SPEED * (1.0 - 0.08 - 0.04 * lost))]) > 1.2
    assert sure_of_slip([recorded(SPEED, SPEED + 0.1 + 0.06 * lost)]) < -1.2


def test_where_the_speed_hardly_changes_or_the_drive_is_short_nothing_is_told():
    lost = wander(SAMPLES, DT_S, 40, 1.0, 15.0)
    assert abs(sure_of_slip([recorded(np.full(SAMPLES, 1.5), 1.5 + 0.06 * lost)])) < 2.0
    short = round((FEWEST_BLOCKS - 1) * 20.0 / DT_S)
    one = recorded(SPEED, SPEED + 0.06 * lost)
    brief = Recording(one.time_s[:short], {name: column[:short] for name, column in one.columns.items()}, DT_S, "test")
    assert sure_of_slip([brief]) == 0.0
    bare = Recording(one.time_s, {name: one.columns[name] for name in ("pump_current_ma", OUTPUT)}, DT_S, "test")
    assert sure_of_slip([one, bare]) == 0.0
    assert sure_of_slip([recorded(np.full(SAMPLES, np.nan))]) == 0.0
    assert sure_of_slip([recorded(np.zeros(SAMPLES))]) == 0.0
