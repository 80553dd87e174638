"""The static curve finds dead zone, saturation, curvature and loop of a known drive from its ramps."""

import numpy as np
import pytest

from cruise.identification.explore import Estimate, NotPossible, StaticCurve, ramps, static_curve
from tests.identification.explore.drives import lag, noise, play, recording, steps, through, up_and_down, white

THRESHOLD_MA, SATURATION_MA, WIDTH_MA, LAG_S = 420.0, 1100.0, 30.0, 0.5 + 0.05 / (1.0 - np.exp(-2.0 * np.pi * 0.05))


def ramped(
    rate: float, seed: int = 0, width=WIDTH_MA, low=THRESHOLD_MA, high=SATURATION_MA, quadratic=3e-6, noise_mps=0.02
):
    """The ramp through play, dead zone, parabola, saturation, a lag of 1 Hz and 0.5 s."""
    u = up_and_down(rate)
    x = np.clip(play(u, width), low, high) - low
    y = through(*lag(1.0, gain=1.0), 10, 0.003 * x + quadratic * x**2) + noise(len(u), seed, noise_mps)
    return recording(u + np.random.default_rng(seed).standard_normal(len(u)), y, source=f"ramp {rate}")


def curve(*recordings, lag_s=None) -> StaticCurve:
    found = static_curve(recordings, lag_s)
    assert isinstance(found, StaticCurve)
    return found


def near(estimate: Estimate | None, truth: float, floor: float) -> bool:
    assert estimate is not None
    return abs(estimate.value - truth) < 3.0 * estimate.std + floor


@pytest.mark.parametrize("seed", range(3))
def test_dead_zone_saturation_and_curvature_are_found(seed):
    found = curve(ramped(20.0, seed), ramped(45.0, seed + 10))
    assert near(found.threshold_ma, THRESHOLD_MA, 2.0)
    assert near(found.saturation_ma, SATURATION_MA, 2.0)
    assert near(found.slope_mps_per_ma, 0.003, 3e-5)
    assert near(found.quadratic_mps_per_ma2, 3e-6, 5e-8)
    assert near(found.offset_mps, 0.0, 0.005)
    assert found.quadratic_needed


def test_ramps_of_two_rates_tell_the_loop_from_the_lag():
    found = curve(ramped(15.0), ramped(45.0, 1))
    assert near(found.loop_width_ma, WIDTH_MA, 1.5)
    assert near(found.lag_s, LAG_S, 0.02)
    assert "different rates" in found.lag_from
    assert found.gross_loop_width_ma == pytest.approx(WIDTH_MA + 2.0 * 30.0 * LAG_S, abs=5.0)


def test_a_given_lag_is_taken_out_of_one_rate_and_without_one_the_width_is_gross():
    given = curve(ramped(20.0), lag_s=Estimate(LAG_S, 0.01))
    assert near(given.loop_width_ma, WIDTH_MA, 1.5)
    alone = curve(ramped(20.0))
    assert alone.loop_width_ma is None
    assert alone.gross_loop_width_ma == pytest.approx(WIDTH_MA + 2.0 * 20.0 * LAG_S, abs=2.0)
    assert "hysteresis and lag together" in alone.words()[-1]


def test_no_loop_no_dead_zone_no_curvature_are_not_invented():
    found = curve(ramped(20.0, low=0.0, high=5000.0, quadratic=0.0, width=0.0), lag_s=Estimate(LAG_S, 0.01))
    assert found.threshold_ma is None
    assert found.saturation_ma is None
    assert not found.quadratic_needed
    assert near(found.loop_width_ma, 0.0, 1.0)
    assert "no dead zone above" in " ".join(found.words())


def test_the_test_for_curvature_errs_as_seldom_as_it_says():
    refused = [
        curve(ramped(45.0, seed, quadratic=0.0, noise_mps=0.1), lag_s=Estimate(LAG_S, 0.01)).quadratic_needed
        for seed in range(20)
    ]
    assert np.mean(refused) <= 0.15


def test_one_way_only_gives_no_loop():
    whole = ramped(20.0)
    found = curve(whole[: 100 + 900 + 100])
    assert found.gross_loop_width_ma is None
    assert found.loop_width_ma is None
    assert found.threshold_ma is not None
    assert np.all(np.isnan(found.falling_speed_mps))


def test_ramps_are_found_where_they_are():
    found = ramps([ramped(20.0)])
    assert [np.sign(ramp.rate_ma_per_s) for ramp in found] == [1.0, -1.0]
    assert [abs(ramp.rate_ma_per_s) for ramp in found] == pytest.approx([20.0, 20.0], rel=0.01)
    assert found[0].start_s == pytest.approx(5.0, abs=3.0)
    assert found[0].stop_s == pytest.approx(50.0, abs=3.0)


@pytest.mark.parametrize("u", [white(4000, 1), steps(4000, 1), 700.0 + 200.0 * np.sin(np.arange(4000) / 40.0)])
def test_other_experiments_hold_no_ramp(u):
    found = static_curve([recording(u, through(*lag(1.0), 10, u))])
    assert isinstance(found, NotPossible)
    assert found.reason == "no ramps in this recording: drive `cruise experiment ramp`"


def test_a_ramp_below_the_dead_zone_says_so():
    u = up_and_down(20.0, 100.0, 400.0)
    found = static_curve([recording(u, np.where(np.arange(len(u)) < 3, 0.1, 0.0))])
    assert isinstance(found, NotPossible)
    assert "from below the dead zone to full stroke" in found.reason
