"""The signals: their range, their spectrum, their length, how gently they begin and end, and that a seed fixes them."""

import math
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal as dsp

from cruise import settings
from cruise.control.excitation import GRID_S, Excitation, Kind, Multisine, Phase, Ramp, Steps, WhiteNoise
from cruise.settings import SettingsError

NOISE = WhiteNoise(low_ma=450.0, high_ma=1050.0, seconds=400.0)
STEPS = Steps(low_ma=450.0, high_ma=1050.0, hold_min_s=1.0, hold_max_s=4.0, seconds=400.0)
RAMP = Ramp(low_ma=300.0, high_ma=1200.0, rate_ma_per_s=15.0)
SINES = Multisine(mean_ma=750.0, peak_ma=250.0, low_hz=0.1, high_hz=2.5, period_s=20.0, periods=3)
KINDS = (NOISE, STEPS, RAMP, SINES)
NAMES = [type(kind).__name__ for kind in KINDS]
SEED = (1, 0)


def values(kind: Kind, seed: tuple[int, ...] = SEED, step_s: float = GRID_S) -> np.ndarray:
    """The signal on the grid of the frames."""
    form = kind.form(seed)
    return np.array([form(k * step_s) for k in range(round(kind.duration_s / step_s))])


def whole(kind: Kind) -> tuple[Excitation, np.ndarray]:
    """The current of a whole experiment, frame by frame."""
    excitation = Excitation.of(kind, SEED, lead_s=5.0, settle_s=3.0)
    return excitation, np.array(
        [excitation.current_ma(k * GRID_S) for k in range(round(excitation.over_s / GRID_S) + 3)]
    )


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_it_fills_its_range_and_never_leaves_it(kind):
    low_ma, high_ma = kind.range_ma
    current = values(kind)
    assert low_ma - 1e-9 <= current.min()
    assert current.max() <= high_ma + 1e-9
    assert np.ptp(current) > 0.9 * (high_ma - low_ma)
    assert np.abs(np.diff(current)).max() <= kind.jump_ma(GRID_S) + 1e-9


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_it_begins_at_neutral_and_ends_there_without_a_jump_of_its_own(kind):
    excitation, current = whole(kind)
    begin, end = round(excitation.begin_s / GRID_S), round(excitation.end_s / GRID_S)
    assert current[0] == 0.0
    assert current[-3:].tolist() == [0.0, 0.0, 0.0]
    lead_ma = 1200.0 * GRID_S / 5.0  # the whole range over the lead
    assert np.abs(np.diff(current[:begin])).max() <= lead_ma + 1e-9
    assert np.abs(np.diff(current[end:])).max() <= lead_ma + 1e-9
    waiting = current[round(5.0 / GRID_S) + 1 : begin]
    np.testing.assert_allclose(waiting, excitation.rest_ma)
    np.testing.assert_allclose(current[begin:end], values(kind)[: end - begin], rtol=1e-12)


def test_the_phases_follow_each_other():
    excitation = Excitation.of(RAMP, SEED, lead_s=5.0, settle_s=3.0)
    at_s = (0.0, 7.95, 8.0, 8.0 + 239.95, 248.0, 252.95, 253.0, 1e6)
    phases = [excitation.phase(time_s) for time_s in at_s]
    assert phases == [
        Phase.LEADING_IN,
        Phase.LEADING_IN,
        Phase.EXCITING,
        Phase.EXCITING,
        Phase.LEADING_OUT,
        Phase.LEADING_OUT,
        Phase.OVER,
        Phase.OVER,
    ]


@pytest.mark.parametrize("kind", [NOISE, STEPS, msgspec.structs.replace(SINES, phases="random")])
def test_a_seed_fixes_it_and_another_gives_another(kind):
    np.testing.assert_array_equal(values(kind), values(kind))
    assert not np.allclose(values(kind), values(kind, (1, 1)))
    assert not np.allclose(values(kind), values(kind, (2, 0)))


def test_noise_is_white():
    current = values(NOISE)
    moving = current - current.mean()
    spectrum_hz, density = dsp.welch(moving, 1.0 / GRID_S, nperseg=256)
    bands = [density[(spectrum_hz > low) & (spectrum_hz <= high)].mean() for low, high in ((0.1, 3), (3, 6), (6, 9.9))]
    assert max(bands) / min(bands) < 1.2
    correlations = [abs(moving[lag:] @ moving[:-lag]) / (moving @ moving) for lag in range(1, 41)]
    assert max(correlations) < 3.5 / math.sqrt(len(current))
    assert current.std() == pytest.approx(600.0 / math.sqrt(12.0), rel=0.03)  # of a uniform distribution


def test_gaussian_noise_has_its_deviation_and_is_clipped():
    kind = msgspec.structs.replace(NOISE, distribution="gaussian", deviation_ma=100.0)
    assert values(kind).std() == pytest.approx(100.0, rel=0.03)
    wide = msgspec.structs.replace(kind, deviation_ma=400.0)
    assert {450.0, 1050.0} <= set(values(wide))


def test_a_value_of_noise_is_held():
    kind = msgspec.structs.replace(NOISE, hold_s=0.2)
    held = values(kind).reshape(-1, 4)
    assert (np.ptp(held, axis=1) == 0.0).all()
    assert (np.diff(held[:, 0]) != 0.0).all()


def test_steps_are_held_between_the_bounds():
    current = values(STEPS)
    ends = np.flatnonzero(np.diff(current)) + 1
    holds_s = np.diff(ends, prepend=0) * GRID_S
    assert holds_s.min() >= 1.0 - 1e-9
    assert holds_s.max() <= 4.0 + 1e-9
    assert holds_s.mean() == pytest.approx(2.5, abs=0.25)


def test_listed_levels_go_round():
    kind = Steps(levels_ma=(500.0, 900.0, 700.0), hold_min_s=2.0, hold_max_s=2.0, seconds=20.0)
    expected = np.repeat([500.0, 900.0, 700.0] * 4, 40)[:400]
    np.testing.assert_array_equal(values(kind), expected)


def test_a_ramp_goes_up_and_down_at_its_rate_as_often_as_it_says():
    current = values(RAMP)
    assert RAMP.duration_s == 240.0
    rates = np.diff(current) / GRID_S
    np.testing.assert_allclose(np.abs(rates), 15.0, rtol=1e-6)
    assert [sign for sign, other in pairwise([*np.sign(rates), 0.0]) if sign != other] == [1.0, -1.0, 1.0, -1.0]


@pytest.mark.parametrize("phases", ["schroeder", "random"])
def test_a_multisine_is_flat_in_its_band_and_empty_elsewhere(phases):
    kind = msgspec.structs.replace(SINES, phases=phases)
    current = values(kind)
    lines = np.abs(np.fft.rfft(current - 750.0))
    every = np.arange(len(lines)) / kind.duration_s
    inside = (np.arange(len(lines)) % kind.periods == 0) & (every > 0.099) & (every < 2.501)
    assert inside.sum() == 49
    assert np.ptp(lines[inside]) < 0.01 * lines[inside].mean()
    assert lines[~inside].max() < 1e-3 * lines[inside].mean()
    assert np.abs(current - 750.0).max() == pytest.approx(250.0, rel=0.01)
    np.testing.assert_allclose(current[:400], current[400:800], atol=1e-6)


def test_schroeders_phases_keep_the_peaks_low():
    def crest_factor(kind: Multisine) -> float:
        current = values(kind, step_s=0.005) - 750.0
        return float(np.abs(current).max() / current.std())

    assert crest_factor(SINES) < 1.95
    assert crest_factor(msgspec.structs.replace(SINES, phases="random")) > 2.4


@given(st.sampled_from(KINDS), st.floats(1.0, 1000.0))
def test_another_length_is_whole_periods(kind, seconds):
    longer = kind.lasting(seconds)
    if isinstance(kind, Ramp | Multisine):
        periods = longer.duration_s / kind.period_s
        assert periods == pytest.approx(max(round(seconds / kind.period_s), 1))
    else:
        assert longer.duration_s == seconds
    assert longer.form(SEED)(longer.duration_s - 0.01) >= 0.0  # there is a value to the very end


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"kind": "white_noise", "low_ma": 900.0, "high_ma": 500.0, "seconds": 9.0}, "low_ma has to be below high_ma"),
        ({"kind": "white_noise", "low_ma": -1.0, "high_ma": 500.0, "seconds": 9.0}, "low_ma: expected float >= 0.0"),
        ({"kind": "steps", "levels_ma": [5.0], "hold_min_s": 1.0, "hold_max_s": 2.0, "seconds": 9.0}, "one level"),
        (
            {
                "kind": "steps",
                "levels_ma": [5.0, 6.0],
                "low_ma": 5.0,
                "hold_min_s": 1.0,
                "hold_max_s": 2.0,
                "seconds": 9.0,
            },
            "either levels_ma or low_ma and high_ma",
        ),
        (
            {"kind": "steps", "low_ma": 5.0, "high_ma": 6.0, "hold_min_s": 2.0, "hold_max_s": 1.0, "seconds": 9.0},
            "no multiple of 0.05 s lies between",
        ),
        (msgspec.to_builtins(SINES) | {"low_hz": 0.01, "high_hz": 0.04}, "choose a longer period_s"),
        (msgspec.to_builtins(SINES) | {"mean_ma": 200.0}, "would reverse the machine"),
        ({"kind": "white_noice", "low_ma": 1.0, "high_ma": 2.0, "seconds": 9.0}, "did you mean white_noise?"),
    ],
)
def test_a_signal_that_makes_no_sense_is_refused(tmp_path: Path, change: dict, complaint: str):
    class File(msgspec.Struct):
        excitation: Kind

    with pytest.raises(SettingsError) as caught:
        settings.parse(msgspec.json.encode({"excitation": change}).decode(), File, "experiments.yaml")
    assert complaint in str(caught.value)
