"""The sampler against integrals written by hand, against a brute-force mean, and against bad time stamps."""

import math
from itertools import accumulate

import hypothesis
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.sampling import MAX_READINGS, Kind, Pushed, SamplingSettings, Stream, StreamSampler, kind_of, means
from cruise.signals import SIGNALS


def stream(kind: Kind, readings: list[tuple[float, float]], stale_after_s: float = 0.3) -> Stream:
    filled = Stream(kind, stale_after_s)
    for time_s, value in readings:
        assert filled.push(time_s, value) is Pushed.KEPT
    return filled


RAMP = [(0.0, 0.0), (0.1, 1.0), (0.2, 2.0)]


@pytest.mark.parametrize(
    ("kind", "readings", "from_s", "until_s", "expected"),
    [
        (Kind.CONTINUOUS, RAMP, 0.0, 0.2, 1.0),
        (Kind.CONTINUOUS, RAMP, 0.05, 0.15, 0.5 * (0.075 + 0.1) / 0.1),  # rises to 1.0 at 0.1, then held: unknown yet
        (Kind.CONTINUOUS, RAMP, 0.1, 0.3, (0.1 * 1.5 + 0.1 * 2.0) / 0.2),  # held after the last reading
        (Kind.HELD, RAMP, 0.0, 0.2, 0.5),
        (Kind.HELD, RAMP, 0.05, 0.15, 0.5),
        (Kind.STATE, RAMP, 0.0, 0.2, 2.0),
        (Kind.STATE, RAMP, 0.0, 0.199, 1.0),
        (Kind.CONTINUOUS, [(0.0, 5.0)], 0.1, 0.3, 5.0),
        (Kind.CONTINUOUS, [(0.0, 5.0)], 0.19, 0.39, 5.0),  # half of the period is fresh enough
        (Kind.CONTINUOUS, [(0.0, 5.0)], 0.21, 0.41, math.nan),
        (Kind.STATE, [(0.0, 5.0)], 0.2, 0.3, 5.0),
        (Kind.STATE, [(0.0, 5.0)], 0.2, 0.31, math.nan),
        (Kind.CONTINUOUS, [(0.1, 5.0)], 0.0, 0.2, 5.0),  # begins in the period
        (Kind.CONTINUOUS, [(0.11, 5.0)], 0.0, 0.2, math.nan),
        (Kind.CONTINUOUS, [(0.3, 5.0)], 0.0, 0.2, math.nan),  # has not happened yet
        (Kind.CONTINUOUS, [], 0.0, 0.2, math.nan),
        (Kind.CONTINUOUS, [(0.0, 1.0), (0.1, math.nan), (0.2, 3.0)], 0.0, 0.2, 1.0),  # no line to or from a NaN
        (Kind.CONTINUOUS, [(0.0, 1.0), (0.09, math.nan), (0.2, 3.0)], 0.0, 0.2, math.nan),
        (Kind.STATE, [(0.0, 1.0), (0.1, math.nan)], 0.0, 0.2, math.nan),
        (Kind.HELD, [(0.0, 1.0), (0.1, math.inf), (0.2, 3.0)], 0.0, 0.4, 7.0 / 3.0),
        (Kind.CONTINUOUS, [(0.0, 1.0), (0.25, 9.0)], 0.1, 0.2, 1.0),  # what comes later is not known yet
        (Kind.CONTINUOUS, [(0.0, 1.0), (0.5, 9.0)], 0.0, 0.4, 1.0),  # too far apart for a line
    ],
)
def test_a_mean_is_the_integral_by_hand(kind, readings, from_s, until_s, expected):
    assert stream(kind, readings).mean(from_s, until_s) == pytest.approx(expected, nan_ok=True)


def brute_force(
    kind: Kind, readings: list[tuple[int, float]], from_ms: int, until_ms: int, stale_ms: int
) -> list[float]:
    """Return the value in the middle of every measured millisecond, as the definition gives it."""
    known = [reading for reading in readings if reading[0] <= until_ms]
    values = []
    for time_ms in np.arange(from_ms, until_ms) + 0.5:
        before = [reading for reading in known if reading[0] <= time_ms]
        after = [reading for reading in known if reading[0] > time_ms]
        if not before:
            continue
        (begin_ms, value), (end_ms, end) = before[-1], after[0] if after else (math.inf, math.nan)
        if kind is Kind.CONTINUOUS and end_ms - begin_ms <= stale_ms and not math.isnan(end):
            value += (end - value) * (time_ms - begin_ms) / (end_ms - begin_ms)
        elif time_ms - begin_ms > stale_ms:
            continue
        if not math.isnan(value):
            values.append(value)
    return values


@hypothesis.settings(max_examples=50)
@given(
    kind=st.sampled_from([Kind.CONTINUOUS, Kind.HELD]),
    steps_ms=st.lists(st.integers(1, 400), min_size=1, max_size=12),
    data=st.data(),
    period_ms=st.integers(20, 300),
)
def test_every_mean_of_a_run_equals_the_brute_force_mean(kind, steps_ms, data, period_ms):
    times_ms = list(accumulate(steps_ms))
    values = data.draw(st.lists(st.just(math.nan) | st.floats(-9, 9), min_size=len(times_ms), max_size=len(times_ms)))
    readings = list(zip(times_ms, values, strict=True))
    sampled, pushed = Stream(kind, 0.301), 0  # no rounding at 300 ms
    for until_ms in range(period_ms, 6 * period_ms, period_ms):
        while pushed < len(readings) and readings[pushed][0] <= until_ms:
            sampled.push(readings[pushed][0] / 1000.0, readings[pushed][1])
            pushed += 1
        mean = sampled.mean((until_ms - period_ms) / 1000.0, until_ms / 1000.0)
        measured = brute_force(kind, readings, until_ms - period_ms, until_ms, 301)
        if abs(len(measured) - 0.5 * period_ms) >= 1.0:  # half a period exactly is a matter of rounding
            expected = np.mean(measured) if len(measured) > 0.5 * period_ms else math.nan
            assert mean == pytest.approx(expected, abs=1e-9, nan_ok=True)


TAIL_S = 0.02 + 2 * 0.009  # the last reading can be so old, and is held


@hypothesis.settings(max_examples=30)
@given(
    slope=st.floats(-5, 5), offset=st.floats(-5, 5), jitter_ms=st.lists(st.integers(-9, 9), min_size=60, max_size=60)
)
def test_a_straight_line_keeps_its_mean_under_jitter(slope, offset, jitter_ms):
    times = np.arange(60) * 0.02 + np.array(jitter_ms) / 1000.0
    sampled = stream(Kind.CONTINUOUS, [(t, offset + slope * t) for t in times.tolist()])
    assert sampled.mean(0.4, 0.6) == pytest.approx(offset + slope * 0.5, abs=abs(slope) * TAIL_S**2 / (2 * 0.2) + 1e-9)


def test_frequencies_at_multiples_of_the_sampling_rate_vanish():
    times = np.arange(0.0, 4.0, 0.01)
    tone = np.sin(2 * np.pi * 5.0 * times)  # would alias to a constant at 5 Hz
    samples = means(times, tone, np.arange(1, 20) * 0.2, 0.2, Kind.CONTINUOUS, 0.3)
    assert np.max(np.abs(samples)) < 0.01
    assert np.max(np.abs(tone[7::20])) > 0.5


def test_offline_equals_online_to_the_bit():
    random = np.random.default_rng(1)
    times = {name: np.cumsum(random.uniform(0.5, 1.5, 400) * step) for name, step in RATES.items()}
    values = {name: np.where(random.random(400) < 0.1, np.nan, random.normal(size=400)) for name in RATES}
    grid = np.arange(1, 60) * 0.2
    sampler = StreamSampler(SamplingSettings(), RATES)
    events = sorted((t, name, v) for name in RATES for t, v in zip(times[name], values[name], strict=True))
    online: dict[str, list[float]] = {name: [] for name in RATES}
    at = 0
    for until_s in grid.tolist():
        # the loop is late: frames that came after the end of the period are in already
        while at < len(events) and events[at][0] <= until_s + 0.007:
            sampler.push(events[at][1], events[at][0], events[at][2])
            at += 1
        for name, value in sampler.sample(until_s, 0.2).items():
            online[name].append(value)
    for name in RATES:
        stale_s = SamplingSettings().stale_after(name)
        offline = means(times[name], values[name], grid, 0.2, kind_of(name), stale_s)
        np.testing.assert_array_equal(offline, online[name])
        assert 0 < np.isnan(offline).sum() < len(grid) or name == "oil_temperature_c"


RATES = {"ground_speed_mps": 0.02, "pump_current_ma": 0.02, "gear": 0.1, "pitch_deg": 0.01, "oil_temperature_c": 1.0}


@pytest.mark.parametrize(
    ("time_s", "outcome", "newest_s", "mean"),
    [
        (0.25, Pushed.KEPT, 0.25, 1.5),
        (0.2, Pushed.REPLACED, 0.2, 2.0),
        (0.15, Pushed.LATE, 0.2, 1.0),
        (-0.09, Pushed.LATE, 0.2, 1.0),
        (-0.2, Pushed.RESTARTED, -0.2, math.nan),
        (math.nan, Pushed.NO_TIME, 0.2, 1.0),
        (math.inf, Pushed.NO_TIME, 0.2, 1.0),
        (-math.inf, Pushed.NO_TIME, 0.2, 1.0),
    ],
)
def test_odd_time_stamps_are_named_outcomes(time_s, outcome, newest_s, mean):
    sampled = stream(Kind.HELD, [(0.0, 1.0), (0.1, 1.0), (0.2, 1.0)])
    assert sampled.push(time_s, 3.0) is outcome
    assert sampled.times_s[-1] == newest_s
    assert sampled.mean(0.1, 0.3) == pytest.approx(mean, nan_ok=True)


def test_a_repeated_time_takes_the_later_value():
    sampled = stream(Kind.HELD, [(0.0, 1.0)])
    sampled.push(0.0, 5.0)
    assert sampled.mean(0.0, 0.2) == 5.0
    assert sampled.times_s == [0.0]


def test_a_clock_that_was_set_back_is_followed():
    sampled = stream(Kind.HELD, [(1000.0, 1.0), (1000.1, 1.0)])
    for time_s in (5.0, 5.1, 5.2):
        sampled.push(time_s, 2.0)
    assert sampled.mean(5.0, 5.2) == 2.0


def test_memory_is_bounded_with_and_without_samples():
    sampled = Stream(Kind.CONTINUOUS, 0.3)
    for index in range(3 * MAX_READINGS):
        sampled.push(index * 0.01, 1.0)
        assert len(sampled.times_s) <= MAX_READINGS
    assert sampled.mean(59.0, 59.2) == pytest.approx(1.0)
    assert len(sampled.times_s) < 110


def test_a_mean_stays_exact_after_a_day():
    sampled = Stream(Kind.HELD, 0.3, [86400.0], [1200.0], [1200.0 * 86400.0], [86400.0])
    sampled.push(86400.02, 1000.0)
    assert sampled.mean(86400.0, 86400.04) == pytest.approx(1100.0, abs=1e-3)


def test_the_sampler_aligns_signals_of_different_rates():
    sampler = StreamSampler(SamplingSettings(), RATES)
    for index in range(100):
        time_s = index * 0.01
        sampler.push("pitch_deg", time_s, 10.0 * time_s)
        if index % 10 == 3:
            sampler.push("ground_speed_mps", time_s, 2.0 * time_s)
    sampler.push("oil_temperature_c", 0.05, 60.0)
    sampler.push("gear", 0.95, 2.0)
    sample = sampler.sample(0.9, 0.2)
    assert sample == {
        "ground_speed_mps": pytest.approx(1.6, abs=0.05),
        "pump_current_ma": pytest.approx(math.nan, nan_ok=True),
        "gear": pytest.approx(math.nan, nan_ok=True),
        "pitch_deg": pytest.approx(8.0),
        "oil_temperature_c": pytest.approx(60.0),
    }


def test_a_name_that_was_not_declared_is_a_bug():
    with pytest.raises(KeyError, match="groundspeed"):
        StreamSampler(SamplingSettings()).push("groundspeed", 0.0, 1.0)


def test_all_signals_are_known_by_default_and_nothing_was_measured_yet():
    sample = StreamSampler(SamplingSettings()).sample(1.0, 0.05)
    assert set(sample) == set(SIGNALS)
    assert all(math.isnan(value) for value in sample.values())


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("pump_current_ma", Kind.HELD),
        ("ground_speed_mps", Kind.CONTINUOUS),
        ("gear", Kind.STATE),
        ("brake_pedal", Kind.STATE),
        ("header_height_mm", Kind.CONTINUOUS),
    ],
)
def test_what_a_signal_does_between_two_readings(name, kind):
    assert kind_of(name) is kind


def test_how_long_a_reading_counts_is_a_setting():
    settings = msgspec.convert({"stale_after_s": {"ground_speed_mps": 0.6}}, SamplingSettings)
    assert settings.stale_after("ground_speed_mps") == 0.6
    assert settings.stale_after("pump_current_ma") == 0.3
    assert settings.stale_after("oil_temperature_c") == 3.0
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"stale_after_s": {"gear": 0.0}}, SamplingSettings)
