"""An offset between the two speeds is found whatever else parts them, and a model's constant takes it."""

import numpy as np
import pytest

from cruise.identification.explore import Quality, quality
from cruise.identification.explore.two_speeds import WHEEL, two_speeds
from cruise.recording import Recording
from cruise.signals import OUTPUT
from tests.identification.explore.drives import DT_S, lag, noise, recording, steps, through

SAMPLES = 6000


def drive(offset_mps: float = 0.0, share: float = 0.0, later_s: float = 0.0, seed: int = 1) -> Recording:
    """Ground speed reads that much more than wheel speed, and comes later."""
    u = steps(SAMPLES, seed, hold=160)
    wheel = through(*lag(1.0), 10, u) - 1.5
    late = np.interp(DT_S * np.arange(SAMPLES) - later_s, DT_S * np.arange(SAMPLES), wheel)
    one = recording(u, (1.0 + share) * late + offset_mps + noise(SAMPLES, seed, 0.02))
    return Recording(one.time_s, {**one.columns, WHEEL: wheel + noise(SAMPLES, seed + 50, 0.02)}, DT_S, "two.csv")


@pytest.mark.parametrize("offset_mps", [-0.04, 0.0, 0.03])
@pytest.mark.parametrize("share", [-0.05, 0.0])
def test_the_offset_is_found_beside_slip_and_a_sensor_that_is_late(offset_mps, share):
    found = two_speeds([drive(offset_mps, share, later_s=0.2)])
    assert found is not None
    assert found.offset_mps.value == pytest.approx(offset_mps, abs=4.0 * found.offset_mps.std)
    assert found.offset_mps.std < 0.003
    assert found.share.value == pytest.approx(share, abs=0.004)
    assert found.offset is (offset_mps != 0.0)
    words = " ".join(found.words())
    assert ("less than wheel speed" in words) is (offset_mps < 0.0)
    assert ("more than wheel speed" in words) is (offset_mps > 0.0)


def test_two_recordings_tell_as_much_as_one_and_holes_are_left_out():
    one, other = drive(0.04), drive(0.04, seed=2)
    speed = one.output.copy()
    speed[1000:2000] = np.nan
    holed = Recording(one.time_s, {**one.columns, OUTPUT: speed}, DT_S, "holed.csv")
    found = two_speeds([holed, other])
    assert found is not None
    assert found.offset_mps.value == pytest.approx(0.04, abs=4.0 * found.offset_mps.std)


def test_nothing_is_said_of_one_speed_of_a_short_drive_or_of_a_machine_that_stood():
    one = drive(0.04)
    still = Recording(one.time_s, {**one.columns, WHEEL: np.zeros(SAMPLES)}, DT_S, "still.csv")
    alone = Recording(one.time_s, {k: v for k, v in one.columns.items() if k != WHEEL}, DT_S, "alone.csv")
    assert two_speeds([one, alone]) is None
    assert two_speeds([one[0:1600]]) is None
    assert two_speeds([one[0:1600], one[2000:3600]]) is not None, "blocks of one recording are none of another"
    assert two_speeds([still]) is None


def test_it_stands_with_what_is_wrong_with_the_data():
    found = quality([drive(-0.04)])
    assert isinstance(found, Quality)
    assert any("one of the sensors has an offset" in sentence for sentence in found.words())
    assert not any("offset" in sentence for sentence in quality([drive()]).words())
