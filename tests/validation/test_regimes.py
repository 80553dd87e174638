"""Errors that stand in a regime are found there; noise is named nothing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from cruise.recording import Recording, resample
from cruise.signals import INPUT, OUTPUT
from cruise.validation.quantities import ACCELERATION, BRAKING, RATE, TURNS, quantities
from cruise.validation.regimes import _best, _out_of_sample, in_words, regimes, round_edges
from tests.validation.machine import record

H = 15


@pytest.fixture(scope="module")
def drive() -> Recording:
    return resample(record(seed=1, seconds=900.0), 0.2)


def noise(samples: int, seed: int, time_constant: float = 5.0) -> np.ndarray:
    """Errors that overlap as those of predictions 3 s ahead do, 0.05 m/s."""
    pole = np.exp(-1.0 / time_constant)
    white = np.random.default_rng(seed).standard_normal(samples + 100)
    return 0.05 * np.sqrt(1.0 - pole**2) * signal.lfilter([1.0], [1.0, -pole], white)[100:]


def test_an_error_uphill_is_said_to_stand_uphill(drive):
    slope = drive.columns["pitch_deg"]
    uphill = slope > 2.0
    error = noise(len(drive), 1) - 0.1 * uphill
    found = regimes([drive], [error], H)
    first = found.named[0]
    share = float(np.sum(error[uphill] ** 2) / np.sum(error**2))
    assert first.where == "uphill above 2 deg"
    assert first.error_share == pytest.approx(share)
    assert first.time_share == pytest.approx(uphill.mean())
    assert first.error_share_low < share < first.error_share_high
    assert first.mean_error_mps == pytest.approx(-0.1, abs=0.02)
    assert first.p_value <= 0.01
    words = f"{100 * share:.0f} % of the squared error stands in {100 * uphill.mean():.0f} % of the time: uphill above"
    assert first.sentence.startswith(words)
    assert {one.key for one in found.named} == {"pitch_deg"}
    assert found.heat_map is not None
    assert "pitch_deg" in (found.heat_map.rows.key, found.heat_map.columns.key)
    assert found.heat_map.excess_low > 0.1


def test_an_error_that_goes_with_the_slope_stands_at_both_ends_of_it(drive):
    slope = drive.columns["pitch_deg"] * np.where(np.arange(len(drive)) // 400 % 2, 1.0, -1.0)
    both_ways = replace(drive, columns={**drive.columns, "pitch_deg": slope})
    found = regimes([both_ways], [noise(len(drive), 5) + 0.03 * slope], H)
    first = found.named[0]
    assert first.where == "downhill above 2 deg, or uphill above 2 deg"
    assert first.time_share == pytest.approx(np.mean(np.abs(slope) > 2.0), abs=0.001)
    assert first.error_share > first.time_share + 0.2


@pytest.mark.parametrize("seed", range(5))
def test_the_best_of_all_runs_and_of_both_ends_is_chosen(seed):
    excess = np.random.default_rng(seed).standard_normal(6)
    both = [*range(6)]
    runs = {(i, j): sum(excess[i:j]) for i in both for j in range(i + 1, 7) if j - i < 6}
    ends = {(i, j): sum(excess[:j]) + sum(excess[i:]) for i in range(2, 6) for j in range(1, i)}
    assert _best(excess, ordered=False) == max(runs, key=lambda run: runs[run])
    assert _best(excess, ordered=True) == max(runs | ends, key=lambda run: (runs | ends)[run])


def test_noise_is_named_nothing(drive):
    named = [bool(regimes([drive], [noise(len(drive), seed)], H).named) for seed in range(20)]
    assert sum(named) <= 4  # 5 % of 20 is 1; more than 4 has a chance of 0.3 %


def test_one_burst_is_a_coincidence_not_a_regime(drive):
    error = noise(len(drive), 2)
    error[2000:2050] += 0.6
    assert regimes([drive], [error], H).named == ()


def test_two_regimes_together_make_the_map(drive):
    slope, current = drive.columns["pitch_deg"], drive.input
    error = noise(len(drive), 3) * (1.0 + 4.0 * ((slope > 2.0) & (current > 600.0)))
    found = regimes([drive], [error], H).heat_map
    assert found is not None
    assert {found.rows.key, found.columns.key} == {"pitch_deg", INPUT}
    assert found.error_share.sum() == pytest.approx(1.0)
    assert found.time_share.sum() == pytest.approx(1.0)
    i, j = np.unravel_index(np.argmax(found.rmse_mps), found.rmse_mps.shape)
    assert found.rmse_mps[i, j] > 2.5 * np.median(found.rmse_mps[np.isfinite(found.rmse_mps)])


def test_the_map_is_judged_on_blocks_that_did_not_choose_its_cells():
    rng = np.random.default_rng(6)
    blocks = np.arange(4500) // 50
    held = [_out_of_sample(rng.integers(0, 36, 4500), rng.standard_normal(4500) ** 2, blocks) for _ in range(10)]
    assert np.mean([one.mean() for one in held if one is not None]) == pytest.approx(0.0, abs=0.015)


def test_tables_hold_all_time_and_all_error(drive):
    error = noise(len(drive), 4)
    error[:15] = np.nan
    found = regimes([drive], [error], H)
    (speed,) = (table for table in found.tables if table.key == OUTPUT)
    assert speed.time_share.sum() == pytest.approx(1.0, abs=0.01)
    assert speed.error_share.sum() == pytest.approx(1.0, abs=0.01)
    assert {table.key for table in found.tables} >= {INPUT, OUTPUT, TURNS, BRAKING, ACCELERATION, "header_height"}
    assert all(table.time_share.min() >= 0.03 for table in found.tables)


def test_states_are_named_by_their_names(drive):
    gear = np.where(np.arange(len(drive)) // 400 % 3 == 0, 3.0, 2.0)
    other = Recording(drive.time_s, {**drive.columns, "gear": gear}, drive.dt_s, "gears.csv")
    found = regimes([other], [noise(len(drive), 5) * np.where(gear == 3.0, 3.0, 1.0)], H)
    assert found.named[0].where == "gear 3"


def test_turns_and_braking_follow_the_machine(drive):
    by_key = {one.key: one.values for one in quantities([drive])}
    change = np.diff(drive.output, prepend=np.nan)
    assert np.nanmean(change[by_key[BRAKING] == -1.0]) < 0.0 < np.nanmean(change[by_key[BRAKING] == 1.0])
    k = int(np.nanargmax(by_key["rate of current"]))
    assert by_key[TURNS][k] == 1.0
    assert by_key["rate of current"][k] == pytest.approx(drive.input[k] - drive.input[k - 5])


@pytest.mark.parametrize("period_s", [0.2, 0.3, 0.7, 1.6])
def test_rates_are_per_second_at_any_period(period_s):
    time_s = period_s * np.arange(1, 400)
    ramps = {INPUT: 50.0 * np.abs(time_s % 20.0 - 10.0), OUTPUT: 0.1 * np.abs(time_s % 20.0 - 10.0)}
    by_key = {one.key: one.values for one in quantities([Recording(time_s, ramps, period_s, "ramps.csv")])}
    for key, slope in ((RATE, 50.0), (ACCELERATION, 0.1)):
        assert np.nanmax(by_key[key]) == pytest.approx(slope)
        assert np.nanmin(by_key[key]) == pytest.approx(-slope)


def test_the_sample_that_is_judged_does_not_sort_itself(drive):
    spike = np.array(drive.output)
    spike[500] += 5.0
    other = Recording(drive.time_s, {**drive.columns, OUTPUT: spike}, drive.dt_s, "spike.csv")
    for key in (OUTPUT, ACCELERATION):
        before, after = (
            next(one.values for one in quantities([part]) if one.key == key)[500] for part in (drive, other)
        )
        assert before == pytest.approx(after)


def test_time_since_engagement_begins_when_it_was_switched_on():
    time_s = 0.2 * np.arange(100)
    enable = ((time_s > 4.0) & (time_s < 10.0)).astype(float)
    columns = {INPUT: 600.0 + time_s, OUTPUT: 1.0 + 0.01 * time_s, "cruise_enable": enable}
    (since,) = (one for one in quantities([Recording(time_s, columns, 0.2, "x.csv")]) if "time" in one.key)
    assert since.words == "time since engagement"
    assert np.isnan(since.values[:20]).all()
    assert since.values[21:50] == pytest.approx(0.2 * np.arange(29), abs=1e-9)
    assert np.isnan(since.values[50:]).all()


@pytest.mark.parametrize(
    ("low", "high", "edges"), [(0.0, 6.0, [1, 2, 3, 4, 5]), (-4.0, 8.0, [-2, 0, 2, 4, 6]), (0.013, 0.019, None)]
)
def test_edges_are_round(low: float, high: float, edges: list[float] | None):
    found = round_edges(np.linspace(low, high, 1001))
    assert found == (edges or pytest.approx([0.014, 0.015, 0.016, 0.017, 0.018]))


def test_words_of_a_slope():
    assert in_words("pitch_deg", "slope", "deg", 2.0, None) == "uphill above 2 deg"
    assert in_words("pitch_deg", "slope", "deg", None, -2.0) == "downhill above 2 deg"
    assert in_words("pitch_deg", "slope", "deg", -2.0, 1.0) == "slope from -2 to 1 deg"
    assert in_words("pitch_deg", "slope", "deg", None, 0.0) == "downhill"
    assert in_words("engine_speed_rpm", "engine speed", "rpm", None, 1900.0) == "engine speed below 1900 rpm"


def test_nothing_to_say_without_errors(drive):
    assert regimes([drive], [np.full(len(drive), np.nan)], H).tables == ()
