"""Everything together: on the virtual combine, on measured drives, and on data that are of no use."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cruise import settings as files
from cruise.columns import RecordingSettings
from cruise.csv_file import read_csv
from cruise.identification.explore import (
    ANALYSES,
    CrossCorrelation,
    Estimate,
    FrequencyResponse,
    NotPossible,
    StaticCurve,
    explore,
)
from cruise.plant import Combine, Inputs, PlantSettings, SensorReading
from cruise.recording import Recording, RecordingError
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.signals import INPUT, OUTPUT
from tests.identification.explore.drives import DT_S, recording, steps, up_and_down, white

CONFIG = Path(__file__).parents[3] / "config"


def driven(currents_ma: np.ndarray, seed: int) -> Recording:
    """The virtual combine in second gear on level concrete, as the service would have recorded it."""
    combine, sampler, rows = Combine(PlantSettings(), seed), StreamSampler(SamplingSettings()), []
    for k, current_ma in enumerate(currents_ma.tolist(), 1):
        for reading in combine.advance(Inputs(current_ma), k * DT_S):
            assert isinstance(reading, SensorReading)
            if reading.name != OUTPUT or reading.sensor == "drive_feedback":
                sampler.push(reading.name, reading.time_s, reading.value)
        sample = sampler.sample(k * DT_S, DT_S)
        rows.append((sample[INPUT], sample[OUTPUT]))
    table = np.array(rows)
    return recording(table[:, 0], table[:, 1], source=f"combine {seed}")


@pytest.fixture(scope="module")
def combine():
    """White noise and one slow ramp up and down."""
    return explore([driven(white(4000, 3), 1), driven(up_and_down(20.0), 2)])


def test_the_virtual_combine_shows_its_delay_and_passes_low_frequencies(combine):
    correlation, response = combine.cross_correlation, combine.frequency_response
    assert isinstance(correlation, CrossCorrelation)
    delay_s = PlantSettings().pump.transport_delay_s
    assert correlation.delay_s == pytest.approx(delay_s, abs=0.1)
    assert delay_s < correlation.peak_lag_s < delay_s + 0.4
    assert isinstance(response, FrequencyResponse)
    assert response.cutoff is not None
    assert 0.3 < response.cutoff.frequency_hz < 3.0
    assert response.lag_s.value == pytest.approx(correlation.peak_lag_s, abs=0.2)


def test_the_virtual_combine_shows_its_curve_and_its_loop(combine):
    curve, pump = combine.static_curve, PlantSettings().pump
    assert isinstance(curve, StaticCurve)
    assert isinstance(curve.threshold_ma, Estimate)
    assert pump.threshold_ma < curve.threshold_ma.value < pump.threshold_ma + 100.0
    loop_ma = 2.0 * PlantSettings().hysteresis.half_width_ma
    assert isinstance(curve.loop_width_ma, Estimate)
    assert abs(curve.loop_width_ma.value - loop_ma) < 3.0 * curve.loop_width_ma.std
    assert curve.gross_loop_width_ma is not None
    assert curve.gross_loop_width_ma > loop_ma + 15.0


def test_the_report_is_json_without_nan(combine):
    text = json.dumps(combine.report(), allow_nan=False)
    report = json.loads(text)
    assert set(ANALYSES) | {"words", "recordings", "samples", "duration_s", "period_s"} == set(report)
    assert report["frequency_response"]["cutoff"]["frequency_hz"] > 0.0
    assert report["quality"]["jitter"] == {"not_possible": combine.quality.jitter.reason}
    assert set(report["words"]) == set(ANALYSES)


def test_ramps_alone_show_no_dynamics():
    u = up_and_down(20.0)
    found = explore([recording(u, u / 300.0)])
    assert isinstance(found.frequency_response, NotPossible)
    assert isinstance(found.cross_correlation, NotPossible)
    assert "slow ramps excite too little" in found.frequency_response.reason
    assert isinstance(found.static_curve, StaticCurve)


def test_other_periods_and_no_recording_are_refused():
    u = white(200, 1)
    with pytest.raises(RecordingError, match=r"b\.csv is sampled every 0\.1 s, a\.csv every 0\.05 s"):
        explore([recording(u, u), recording(u, u, 0.1, "b.csv")])
    with pytest.raises(RecordingError, match="give one or more"):
        explore([])


HOLED = np.where(np.arange(400) % 3 == 0, np.nan, white(400, 1))
BAD = {
    "all NaN": (np.full(50, np.nan), np.full(50, np.nan)),
    "one sample": (np.array([1.0]), np.array([2.0])),
    "constant": (np.full(500, 7.0), np.full(500, 1.0)),
    "constant input": (np.full(500, 7.0), white(500, 1)),
    "constant output": (white(500, 1), np.full(500, 1.0)),
    "holes everywhere": (HOLED, HOLED),
    "two samples": (np.array([1.0, 2.0]), np.array([0.0, 1.0])),
    "one impulse": (np.eye(1, 500, 250)[0], np.eye(1, 500, 260)[0]),
    "output is input": (white(500, 1), white(500, 1)),
    "tiny": (1e-12 * white(500, 1), 1e-12 * white(500, 2)),
    "huge": (1e12 * white(500, 1), 1e12 * white(500, 2)),
    "periodic": (np.tile(steps(40, 1, 4), 50), np.tile(steps(40, 2, 4), 50)),
    "backward ramp": (-up_and_down(20.0), -up_and_down(20.0) / 300.0),
}


@pytest.mark.parametrize("name", BAD)
def test_useless_data_end_in_sentences(name):
    found = explore([recording(*BAD[name])])
    json.dumps(found.report(), allow_nan=False)
    assert all(sentence for sentences in found.words().values() for sentence in sentences)


@settings(max_examples=40)
@given(
    samples=st.integers(1, 400),
    hold=st.integers(1, 50),
    hole=st.integers(0, 400),
    dt_s=st.sampled_from([0.01, 0.05, 0.2, 1.0]),
    seed=st.integers(0, 99),
)
def test_no_recording_crashes_it(samples, hold, hole, dt_s, seed):
    u = steps(samples, seed, hold)
    y = np.round(u / 300.0 + 0.1 * np.random.default_rng(seed).standard_normal(samples), 1)
    y[hole : hole + 5] = np.nan
    json.dumps(explore([recording(u, y, dt_s)]).report(), allow_nan=False)


def test_a_current_that_moves_at_no_rate_of_its_own_is_no_ramp():
    rates = np.repeat([-5.0, 20.0, 2.0, -20.0, -2.0, 5.0], [10, 6, 9, 6, 9, 10])
    u = np.cumsum(np.tile(rates, 4))
    json.dumps(explore([recording(u, u / 300.0, 1.0)]).report(), allow_nan=False)


def test_measured_drives_run_through(dart):
    columns = files.load(CONFIG / "dart_columns.yaml", RecordingSettings)
    tables = [read_csv(path, columns) for path in sorted(dart.glob("*/*.csv"))]
    found = explore(tables)
    json.dumps(found.report(), allow_nan=False)
    assert isinstance(found.frequency_response, FrequencyResponse)
    assert found.frequency_response.segments > 40
    assert isinstance(found.cross_correlation, CrossCorrelation)
    assert 0.0 < found.cross_correlation.peak_lag_s < 0.6
    assert isinstance(found.static_curve, NotPossible)
