"""The measured drives are read, and their throttle acts only while it is safe."""

import numpy as np
import pytest

from cruise.columns import ActiveWhen, RecordingSettings
from cruise.csv_file import read_csv

DART = RecordingSettings(
    time="elapsed time sensors",
    input="throttle",
    output="vel encoder",
    active_when=ActiveWhen(column="safety_value", above=0.5),
)


def test_every_measured_drive_is_read(dart):
    files = sorted(dart.rglob("*.csv"))
    assert len(files) == 39
    for file in files:
        read = read_csv(file, DART)
        assert read.dt_s == pytest.approx(0.1)
        assert np.isfinite(read.input).all()
        assert np.isfinite(read.output).all()
        assert read.input.min() >= -1e-9
        assert read.input.max() <= 1000.0, "a share of all"
        assert any("read as A or a share of all" in note for note in read.notes) == bool(read.input.any())
        assert {"current", "voltage", "safety_value", "steering"} <= set(read.columns)


def test_the_throttle_of_a_measured_drive_acts_only_while_safe(dart):
    file = dart / "19_step_input_data" / "car_1_Datarecording_01_22_2024_15_01_37.csv"
    gated = read_csv(file, DART)
    raw = read_csv(file, RecordingSettings(time=DART.time, input=DART.input, output=DART.output))
    unsafe = gated.columns["safety_value"] == 0.0
    np.testing.assert_array_equal(gated.output, raw.output)
    assert raw.input[unsafe].max() > 0.1
    assert gated.input[unsafe].max() == 0.0
    np.testing.assert_array_equal(gated.input[~unsafe], raw.input[~unsafe])
