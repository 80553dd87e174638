"""A recording is uniform, complete and not to be written to; a part of it is one."""

import numpy as np
import pytest

from cruise.recording import Recording, RecordingError
from cruise.signals import INPUT, OUTPUT


def recording(count: int = 50, dt_s: float = 0.05) -> Recording:
    random = np.random.default_rng(3)
    time_s = 5.0 + dt_s * np.arange(count)
    columns = {INPUT: random.normal(size=count), OUTPUT: random.normal(size=count), "gear": np.full(count, 2.0)}
    return Recording(time_s, columns, dt_s, "made up", ("a note",))


def test_a_part_of_a_recording_is_one():
    whole = recording()
    part = whole[10:30]
    assert len(part) == 20
    assert (part.source, part.notes, part.dt_s) == (whole.source, whole.notes, whole.dt_s)
    np.testing.assert_array_equal(part.input, whole.input[10:30])
    np.testing.assert_array_equal(part.time_s, whole.time_s[10:30])
    with pytest.raises(RecordingError, match="use resample"):
        whole[::2]


def test_a_recording_cannot_be_written_to_and_leaves_its_arrays_alone():
    speeds = np.ones(20)
    made = Recording(np.arange(20) * 0.1, {INPUT: np.ones(20), OUTPUT: speeds}, 0.1, "x")
    with pytest.raises(ValueError, match="read-only"):
        made.output[0] = 2.0
    speeds[0] = 1.0


@pytest.mark.parametrize(
    ("columns", "time_s", "expected"),
    [
        ({INPUT: np.ones(20)}, np.arange(20) * 0.1, "no signal ground_speed_mps; it has pump_current_ma"),
        ({INPUT: np.ones(20), OUTPUT: np.ones(19)}, np.arange(20) * 0.1, "ground_speed_mps has shape"),
        ({INPUT: np.ones(20), OUTPUT: np.ones(20)}, np.arange(20) * 0.11, "does not rise in steps of 0.1 s"),
    ],
)
def test_a_recording_is_uniform_and_complete(columns, time_s, expected):
    with pytest.raises(RecordingError, match=expected):
        Recording(time_s, columns, 0.1, "x")
