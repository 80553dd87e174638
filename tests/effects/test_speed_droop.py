"""What the speed takes from the drive, in either direction of travel."""

import math

import numpy as np
import pytest

from cruise.effects.speed_droop import SpeedDroop


def test_each_metre_per_second_takes_its_share_forward_and_backward():
    gain, _ = SpeedDroop(0.2).step(1.0, np.array([-2.0, -1.0, 0.0, 1.0, 6.0]), {}, None, 0.2)
    np.testing.assert_allclose(gain, [0.6, 0.8, 1.0, 0.8, -0.2])


def test_with_the_square_of_the_speed_little_is_lost_when_slow_and_much_when_fast():
    gain, _ = SpeedDroop(0.02, 2.0).step(1.0, np.array([-3.0, 0.5, 1.0, 3.0]), {}, None, 0.2)
    np.testing.assert_allclose(gain, [0.82, 0.995, 0.98, 0.82])


def test_the_machine_settles_where_drive_and_droop_balance():
    free_mps, speed_mps = 3.0, 0.0
    for _ in range(200):
        speed_mps = 0.7 * speed_mps + 0.3 * SpeedDroop(0.25).step(1.0, speed_mps, {}, None, 0.2)[0] * free_mps
    assert speed_mps == pytest.approx(free_mps / (1.0 + 0.25 * free_mps))


def test_an_unmeasured_speed_is_no_number():
    assert math.isnan(SpeedDroop(0.25).step(1.0, math.nan, {}, None, 0.2)[0])
