"""Training data: the filter has the gain that it claims and no phase, and all recordings end on one grid."""

import numpy as np
import pytest
from scipy import signal

from cruise.identification.preparation import PreparationSettings, at_period, filter_in_words, smoother
from cruise.identification.regressors import FitError
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT


def filter_at(period_s: float, cutoff_hz: float = 1.0):
    """The paper's filter for data of this period."""
    smooth = smoother(PreparationSettings(period_s=period_s, cutoff_hz=cutoff_hz), period_s)
    assert smooth is not None
    return smooth


@pytest.mark.parametrize("period_s", [0.05, 0.2])
@pytest.mark.parametrize("frequency_hz", [0.3, 0.9, 1.0, 1.1, 1.5])
def test_gain_is_that_of_the_equation_and_phase_is_none(period_s, frequency_hz):
    time_s = period_s * np.arange(round(200.0 / period_s))
    middle = slice(len(time_s) // 4, 3 * len(time_s) // 4)
    wave = np.exp(2j * np.pi * frequency_hz * time_s)
    smooth = filter_at(period_s)
    answer = ((smooth(wave.real) + 1j * smooth(wave.imag)) / wave)[middle]
    warped = np.tan(np.pi * frequency_hz * period_s) / np.tan(np.pi * 1.0 * period_s)
    np.testing.assert_allclose(answer, 1.0 / (1.0 + warped**20), atol=2e-6)


def test_columns_are_filtered_one_by_one_and_a_constant_passes():
    both = np.column_stack([np.full(100, 3.0), np.random.default_rng(0).standard_normal(100)])
    smooth = filter_at(0.2)
    np.testing.assert_allclose(smooth(both)[:, 0], 3.0, rtol=1e-9)
    np.testing.assert_allclose(smooth(both)[:, 1], smooth(both[:, 1]))


@pytest.mark.parametrize("order", [1, 3, 9, 10])
@pytest.mark.parametrize("shape", [(200,), (200, 3)])
def test_it_is_scipys_forward_and_backward_filter(order, shape):
    smooth = smoother(PreparationSettings(order=order), 0.2)
    assert smooth is not None
    values = np.random.default_rng(order).standard_normal(shape)
    expected = signal.sosfiltfilt(signal.butter(order, 1.0, fs=5.0, output="sos"), values, axis=0)
    np.testing.assert_array_equal(smooth(values), expected)


def test_a_stretch_that_is_too_short_is_no_number():
    smooth = filter_at(0.05)
    assert np.isnan(smooth(np.ones((60, 2)))).all()
    assert smooth(np.ones((60, 2))).shape == (60, 2)
    assert np.isfinite(smooth(np.ones(64))).all()


def test_there_is_no_filter_where_none_is_wanted_or_nothing_is_above_it():
    words = {}
    for cutoff_hz, period_s in ((0.0, 0.2), (1.0, 0.5), (1.0, 0.2)):
        settings = PreparationSettings(period_s=period_s, cutoff_hz=cutoff_hz)
        words[cutoff_hz, period_s] = filter_in_words(settings)
        assert (smoother(settings, period_s) is None) == (words[cutoff_hz, period_s] != "filtered at 1 Hz")
    assert words == {
        (0.0, 0.2): "not filtered",
        (1.0, 0.5): "not filtered, nothing is above 1 Hz",
        (1.0, 0.2): "filtered at 1 Hz",
    }


def recording(period_s: float, seconds: float = 30.0, speed_mps: float | None = None, source: str = "a.csv"):
    """A speed that rises by 0.1 m/s every second, or stays."""
    time_s = period_s * np.arange(round(seconds / period_s))
    speed = 0.1 * time_s if speed_mps is None else np.full(len(time_s), speed_mps)
    return Recording(time_s, {INPUT: 700.0 + speed, OUTPUT: speed}, period_s, source)


def test_recordings_of_any_rate_end_on_one_grid():
    fast, same = at_period([recording(0.05), recording(0.2)], 0.2)
    assert fast.dt_s == same.dt_s == 0.2
    # a sample is the mean over the period that ends with it, as the service takes it
    np.testing.assert_allclose(fast.output, 0.1 * (fast.time_s - 0.1), atol=1e-9)
    np.testing.assert_array_equal(same.output, 0.1 * same.time_s)


@pytest.mark.parametrize("period_s", [0.2001, 0.1999, 0.19])
def test_a_clock_that_is_a_little_off_ends_on_the_model_s_grid_too(period_s):
    (one,) = at_period([recording(period_s)], 0.2)
    assert one.dt_s == 0.2
    np.testing.assert_allclose(one.output, 0.1 * one.time_s, atol=1e-9)


def test_a_recording_that_is_too_slow_is_named_with_the_remedy():
    with pytest.raises(FitError, match=r"slow\.csv is sampled every 0\.5 s, too slowly.*give --period 0\.5 or more"):
        at_period([recording(0.05), recording(0.5, source="slow.csv")], 0.2)


@pytest.mark.parametrize("speed_mps", [0.0, 1.7])
def test_a_machine_whose_speed_never_changes_is_refused(speed_mps):
    with pytest.raises(FitError, match=f"the speed is {speed_mps:g} m/s throughout.*drive the machine"):
        at_period([recording(0.05, speed_mps=speed_mps)], 0.2)
    two = [recording(0.2, speed_mps=speed_mps), recording(0.2, speed_mps=0.5)]
    assert at_period(two, 0.2) == two


def with_pedals(one: Recording, **pressed: slice) -> Recording:
    columns = {name: np.zeros(len(one)) for name in pressed}
    for name, where in pressed.items():
        columns[name][where] = 1.0
    return Recording(one.time_s, {**one.columns, **columns}, one.dt_s, one.source)


def test_the_speed_under_a_brake_or_clutch_says_nothing_of_the_drive_nor_what_follows_for_2_s():
    one = with_pedals(recording(0.05), brake_pedal=slice(100, 140), clutch_pedal=slice(400, 401))
    (left,) = at_period([one], 0.05)
    lost = np.flatnonzero(np.isnan(left.output)).tolist()
    assert lost == [*range(100, 180), *range(400, 441)]
    assert np.isfinite(left.input).all()
    (note,) = left.notes
    assert note.startswith("brake_pedal and clutch_pedal: pressed for 2.05 s: ")
    assert at_period([left], 0.05) == [left]
    (coarse,) = at_period([one], 0.2)
    assert np.isnan(coarse.output[27:44]).all(), "but what lives on for 0.3 s from before"
    assert np.isfinite(coarse.output).sum() > 110


def test_a_pedal_that_nobody_presses_or_that_is_not_known_changes_nothing():
    one = with_pedals(recording(0.2), brake_pedal=slice(0))
    unknown = Recording(one.time_s, {**one.columns, "brake_pedal": np.full(len(one), np.nan)}, 0.2, "b.csv")
    assert at_period([one, unknown], 0.2) == [one, unknown]


def test_a_pedal_that_is_pressed_throughout_is_named_with_the_remedy():
    pressed = with_pedals(recording(0.2), brake_pedal=slice(None))
    with pytest.raises(FitError, match=r"^brake_pedal is pressed wherever the speed is known.*take the column out"):
        at_period([pressed], 0.2)
    assert np.isnan(at_period([pressed, recording(0.2)], 0.2)[0].output).all()
