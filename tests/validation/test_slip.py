"""Slip is what makes wheel and ground speed differ: not the tyre's radius, not a late sensor, not noise."""

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.slip import WHEEL, slip_mps
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
