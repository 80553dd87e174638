"""The shaper's gain over frequency is the one written down, and its response is the one it plans with."""

import math

import numpy as np
import pytest

from cruise.control.shaping import CommandShaper


@pytest.mark.parametrize("frequency_hz", [0.2, 1.0, 2.0, 4.0])
def test_gain_over_frequency(frequency_hz):
    cutoff_hz, dt_s = 1.2, 0.01
    shaper = CommandShaper(cutoff_hz, 2, dt_s)
    time_s = np.arange(0, 20, dt_s)
    sent = np.array([shaper.step(math.sin(2 * math.pi * frequency_hz * t)) for t in time_s])
    gain = np.ptp(sent[len(sent) // 2 :]) / 2
    assert gain == pytest.approx(1 / (1 + (frequency_hz / cutoff_hz) ** 2), rel=0.06)


def test_the_planned_response_is_what_comes_out():
    rng = np.random.default_rng(0)
    shaper = CommandShaper(1.2, 3, 0.05)
    shaper.states_ma = [100.0, 200.0, 300.0]
    wanted = rng.uniform(0, 1000, 10)
    from_states, from_wanted = shaper.response(10)
    planned = from_states @ np.array(shaper.states_ma) + from_wanted @ wanted
    sent = np.array([shaper.step(value) for value in wanted])
    np.testing.assert_allclose(planned, sent, rtol=1e-12)


def test_a_reset_holds_the_current():
    shaper = CommandShaper(1.2, 2, 0.05)
    shaper.reset(640.0)
    assert [shaper.step(640.0) for _ in range(5)] == pytest.approx([640.0] * 5)
