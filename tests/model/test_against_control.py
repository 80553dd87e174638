"""The linear core against python-control: the same transfer function, poles, DC gain and step response."""

import control
import numpy as np
import pytest

from cruise.effects.gear_ratio import GearRatio
from cruise.model.model import Model

A, B, DELAY, PERIOD_S = (0.6, 0.15), (2e-4, 4e-4, 1e-4), 3, 0.2
GEARS = GearRatio(1.4, 2.5, 4.4, 7.8)
MODEL = Model(PERIOD_S, 2, 3, DELAY, (GEARS,), (*A, *B, 0.0))


def transfer_function(gear: float) -> control.TransferFunction:
    """alpha g B(z) z^-d / (1 - alpha A(z) - (1 - alpha) z^-1), written in powers of z (equations 11 and 12)."""
    alpha, ratio = GEARS.pace({"gear": gear}, None), GEARS.ratio(gear)
    order = DELAY + len(B) - 1
    numerator = alpha * ratio * np.array(B)
    denominator = np.zeros(order + 1)
    denominator[0] = 1.0
    denominator[1 : 1 + len(A)] = -alpha * np.array(A)
    denominator[1] -= 1.0 - alpha
    return control.TransferFunction(numerator, denominator, PERIOD_S)


@pytest.mark.parametrize("gear", [1.0, 2.0, 3.0, 4.0])
def test_step_response_in_every_gear(gear):
    count = 60
    signals = {"gear": gear}
    speeds = MODEL.predict(MODEL.start(0.0, 0.0, signals), [100.0] * count, [signals] * count)
    response = control.step_response(transfer_function(gear), T=np.arange(count) * PERIOD_S)
    np.testing.assert_allclose(speeds, 100.0 * np.asarray(response.outputs), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("gear", [1.0, 2.0, 3.0, 4.0])
def test_dc_gain_of_the_controllers_view(gear):
    signals = {"gear": gear}
    response = MODEL.linearise(MODEL.start(0.0, 0.0, signals), signals)
    assert response.dc_gain == pytest.approx(float(np.real(control.dcgain(transfer_function(gear)))))


def test_poles():
    theirs = [pole for pole in control.poles(transfer_function(2.0)) if abs(pole) > 1e-6]
    np.testing.assert_allclose(sorted(np.abs(MODEL.poles)), sorted(np.abs(theirs)), rtol=1e-9)
