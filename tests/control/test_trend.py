"""The trend follows a ramp of gain and load, forgets jumps, and knows nothing at the start."""

import math

import numpy as np
import pytest

from cruise.control.trend import Trend


def test_a_ramp_is_seen_with_its_slope():
    trend = Trend(0.5, 0.05)
    for k in range(200):
        trend.step(math.exp(-0.06 * 0.05 * k), 0.02 * 0.05 * k)
    assert trend.rate_mps2(1.5) == pytest.approx(-0.06 * 1.5 + 0.02, rel=0.06)


def test_steady_signals_have_no_trend_and_a_gear_is_none():
    trend = Trend(0.5, 0.05)
    for gain in [1.0] * 50 + [1.7] * 5:
        trend.step(gain, 0.1)
    assert trend.rate_mps2(1.5) == pytest.approx(0.0, abs=1e-12)


def test_what_comes_while_the_drive_moves_is_believed_when_it_lasts():
    """An engine that dips by a twentieth and a load beside it: at once while it is calm, within seconds otherwise."""
    trend = Trend(0.5, 0.05)
    for k in range(400):
        trend.step(1.0 if k < 200 else 0.95, 0.0 if k < 200 else 0.1)
        if k == 203:
            assert trend.believed(1.0) == pytest.approx((0.95, 0.1))
            assert trend.believed(0.0) == pytest.approx((1.0, 0.0), abs=0.006)
            assert trend.believed(0.5) == pytest.approx((0.95**0.25, 0.025), abs=0.006)
    assert trend.believed(0.0) == pytest.approx((0.95, 0.1), abs=0.01)


def test_what_no_dip_of_an_engine_explains_is_believed_at_once():
    """A throttle that doubles the engine's speed in 3 s moves the drive as well, and is not the drive's doing."""
    trend = Trend(0.5, 0.05)
    for k in range(100 + 60):
        trend.step(math.exp(math.log(2.0) * max(k - 99, 0) / 60.0), 0.0)
    gain, _ = trend.believed(0.0)
    assert gain == pytest.approx(2.0 * math.exp(-0.05))
    assert trend.rate_mps2(1.0, calm=0.0) == pytest.approx(math.log(2.0) / 3.0, rel=0.15)


def test_an_engine_that_lugs_is_doubted_however_far():
    """A drum that plugs is free again at once: who made up for the engine is too fast then."""
    trend = Trend(0.5, 0.05)
    for k in range(100 + 20):
        trend.step(math.exp(-0.2 * max(k - 99, 0) / 20.0), 0.0)
    gain, _ = trend.believed(0.0)
    assert gain > 0.95
    assert trend.rate_mps2(1.0, calm=0.0) == pytest.approx(0.0, abs=1e-12)


def test_the_trend_of_what_may_be_a_dip_is_doubted():
    trend = Trend(0.5, 0.05)
    for k in range(220):
        trend.step(math.exp(-0.04 * max(k - 199, 0) / 20.0), 0.0)
    assert trend.rate_mps2(1.5) < -0.03
    assert trend.rate_mps2(1.5, calm=0.0) == pytest.approx(0.0, abs=1e-12)


def test_a_gear_is_believed_at_once():
    trend = Trend(0.5, 0.05)
    for gain in [1.0] * 50 + [1.7]:
        trend.step(gain, 0.1)
    assert trend.believed(0.0) == pytest.approx((1.7, 0.1))


def test_neutral_and_the_first_sample_are_no_trend():
    trend = Trend(0.5, 0.05)
    assert trend.rate_mps2(1.0) == 0.0
    for gain in (1.0, 0.0, 0.0, 1.0, 1.0):
        trend.step(gain, 0.0)
        assert np.isfinite(trend.rate_mps2(1.0))
    assert trend.rate_mps2(1.0) == 0.0
