"""A current that is late shows while the command moves, whatever it is off by; one in time never does."""

import math
from random import Random

import pytest

from cruise.control.lateness import Lateness

FRAME_S = 0.05
ALLOWED_S = 0.25


def late_ma(
    late_s, command=lambda s: 800.0 + 30.0 * math.sin(2.0 * s), gain=1.0, off_ma=0.0, noise_ma=1.0, seconds=8.0
):
    """The greatest answer in a drive whose current is so late."""
    lateness, rng, seen = Lateness(FRAME_S, ALLOWED_S), Random(3), []
    for k in range(round(seconds / FRAME_S)):
        now_s = k * FRAME_S
        current_ma = 800.0 + gain * (command(now_s - late_s) - 800.0) + off_ma + rng.gauss(0.0, noise_ma)
        lateness.take(command(now_s), current_ma)
        seen.append(lateness.late_ma)
    return max(one for one in seen if math.isfinite(one))


@pytest.mark.parametrize("late_s", [0.35, 0.5, 0.8])
def test_a_current_that_is_late_is_found(late_s):
    assert late_ma(late_s) > 2.0


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.25])
@pytest.mark.parametrize(("gain", "off_ma"), [(1.0, 0.0), (0.9, 25.0), (1.1, -25.0)])
def test_one_in_time_is_not_whatever_it_is_off_by(late_s, gain, off_ma):
    assert late_ma(late_s, gain=gain, off_ma=off_ma) < 1.0


def test_where_the_command_stands_still_nothing_shows():
    assert late_ma(0.5, lambda s: 800.0, noise_ma=3.0) < 2.0


def test_a_step_of_the_command_at_its_greatest_rate_is_no_lateness():
    assert late_ma(0.1, lambda s: 800.0 + 600.0 * min(max(s - 3.0, 0.0), 0.5)) < 1.0


def test_it_begins_anew_where_nothing_is_commanded_or_measured():
    lateness = Lateness(FRAME_S, ALLOWED_S)
    for _ in range(40):
        lateness.take(800.0, 800.0)
    assert lateness.late_ma == 0.0
    lateness.take(math.nan, 800.0)
    assert math.isnan(lateness.late_ma)
    for _ in range(lateness.over + lateness.far - 1):
        lateness.take(800.0, 800.0)
        assert math.isnan(lateness.late_ma)
    lateness.take(800.0, 800.0)
    assert lateness.late_ma == 0.0
