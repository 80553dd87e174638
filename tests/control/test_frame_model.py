"""The model at the rate of the frames is the same machine: gain, mean delay, spread, and what the recording says."""

import numpy as np
import pytest

from cruise.control.frame_model import at_period, core_of, cumulants_s
from cruise.effects.dead_zone import DeadZone
from cruise.effects.grade import Grade
from cruise.model.core import Core, discretised
from cruise.model.model import Model

MODEL = Model(0.2, 1, 3, 2, (DeadZone(400.0), Grade()), (0.4, 2e-4, 8e-4, 8e-4, 0.03, 0.02))


def frequency_response(model: Model, hz: float) -> complex:
    a, b, *_ = model.split(model.theta)
    q = np.exp(-2j * np.pi * hz * model.period_s)
    return sum(v * q ** (model.delay + j) for j, v in enumerate(b)) / (
        1 - sum(v * q ** (i + 1) for i, v in enumerate(a))
    )


@pytest.mark.parametrize("period_s", [0.05, 0.1, 0.01])
def test_gain_mean_delay_and_spread_stay(period_s):
    fast = at_period(MODEL, period_s)
    assert fast.dc_gain_mps_per_ma == pytest.approx(MODEL.dc_gain_mps_per_ma)
    assert cumulants_s(fast)[0] == pytest.approx(cumulants_s(MODEL)[0], abs=3e-3)
    assert cumulants_s(fast)[1] == pytest.approx(cumulants_s(MODEL)[1], rel=0.06)


def test_below_half_a_hertz_the_two_say_the_same():
    fast = at_period(MODEL, 0.05)
    for hz in (0.1, 0.3, 0.5):
        assert abs(frequency_response(fast, hz) / frequency_response(MODEL, hz) - 1.0) < 0.03


def test_what_loads_and_offset_cost_at_rest_stays():
    fast = at_period(MODEL, 0.05)
    for model in (MODEL, fast):
        a, _, loads, c_0 = model.split(model.theta)
        np.testing.assert_allclose(np.array([*loads, c_0]) / (1.0 - a[0]), [0.05, 0.02 / 0.6])


def test_a_core_comes_back():
    core = Core(3e-3, 0.5, 0.15, 0.2)
    found = core_of(discretised(core, (), (), 0.0, 0.05), 0.05)
    assert (found.delay_s, found.lag_s, found.time_constant_s) == pytest.approx((0.5, 0.15, 0.2), abs=0.012)


def test_cumulants_are_those_of_the_impulse_response():
    a, b, *_ = MODEL.split(MODEL.theta)
    response = np.zeros(400)
    for k in range(400):
        response[k] = (a[0] * response[k - 1] if k else 0.0) + (b[k - 2] if 2 <= k < 5 else 0.0)
    shares, times = response / response.sum(), 0.2 * np.arange(400)
    mean = shares @ times
    assert cumulants_s(MODEL) == pytest.approx((mean, shares @ (times - mean) ** 2))
