"""How the paper's recordings are made ready: filtered, then decimated, without folding and without a phase."""

import numpy as np
import pytest

from cruise.identification.preparation import PreparationSettings, smoother
from cruise.paper.tables import ready
from cruise.recording import Recording

SMOOTH = smoother(PreparationSettings(), 0.05)
GAIN = 10.0 ** (-2.0 * 0.05 / 20.0)  # of the Chebyshev filter, run twice, at 0 Hz: 0.05 dB of ripple each time


def test_at_5_hz_slow_signals_are_left_and_fast_ones_gone_from_current_and_speed_alike():
    assert SMOOTH is not None
    time_s = 0.05 * np.arange(2400)
    slow, fast = np.sin(2.0 * np.pi * 0.3 * time_s), np.sin(2.0 * np.pi * 4.6 * time_s)  # 4.6 Hz would fold to 0.4 Hz
    made = Recording(
        time_s,
        {"pump_current_ma": 600.0 + 50.0 * (slow + fast), "ground_speed_mps": 1.0 + 0.5 * (slow + fast)},
        0.05,
        "made",
    )
    inner = slice(50, -50)
    judged = ready(made, (), 5.0, SMOOTH)
    assert judged.dt_s == pytest.approx(0.2)
    assert judged.time_s == pytest.approx(time_s[::4])
    assert judged.input[inner] == pytest.approx(GAIN * (600.0 + 50.0 * slow)[::4][inner], abs=1.0)
    assert judged.output[inner] == pytest.approx(GAIN * (1.0 + 0.5 * slow)[::4][inner], abs=0.01)


def test_the_speed_is_filtered_only_where_a_model_is_fitted_to_it():
    assert SMOOTH is not None
    time_s = 0.05 * np.arange(2400)
    fast = np.sin(2.0 * np.pi * 3.0 * time_s)
    made = Recording(time_s, {"pump_current_ma": 600.0 + fast, "ground_speed_mps": 1.0 + fast}, 0.05, "made")
    assert ready(made, (), 20.0, SMOOTH).output == pytest.approx(made.output)
    assert ready(made, (), 20.0, SMOOTH, output=True).output[200:-200] == pytest.approx(1.0, abs=1e-3)
