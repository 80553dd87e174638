"""The tree finds a regime of two conditions over a signal that nobody named, and nothing in noise."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.recording import Recording, resample
from cruise.validation.blocks import block_numbers
from cruise.validation.failure_tree import failure_tree
from tests.validation.machine import record
from tests.validation.test_regimes import noise

H = 15


@pytest.fixture(scope="module")
def drive() -> Recording:
    return resample(record(seed=1, seconds=900.0), 0.2)


def test_two_conditions_over_an_unnamed_column(drive):
    header, current = drive.columns["header_height"], drive.input
    inside = (header > 320.0) & (current > 650.0)
    error = noise(len(drive), 1) + 0.15 * inside
    found = failure_tree([drive], [error], H)
    best = found.leaves[0]
    assert set(best.keys) == {"header_height", "pump_current_ma"}
    assert "header_height above 3" in best.where
    assert "current above 6" in best.where
    share = float(np.sum(error[inside] ** 2) / np.sum(error**2))
    assert best.error_share == pytest.approx(share, abs=0.12)
    assert best.time_share == pytest.approx(inside.mean(), abs=0.06)
    assert best.mean_error_mps == pytest.approx(0.15, abs=0.03)
    assert 0.0 < best.excess_low < best.error_share - best.time_share < best.excess_high
    assert best.sentence.startswith(f"{100 * best.error_share:.0f} % of the squared error stands in ")
    assert found.explained > 0.3


@pytest.mark.parametrize("lost", [True, False])
def test_where_a_signal_is_missing_is_a_regime_in_words(drive, lost):
    gone = np.arange(len(drive)) // 150 % 4 == 1
    seen = np.where(np.arange(len(drive)) // 10 % 2 == 0, 1.0, 2.0)  # of no use by its values
    holed = replace(drive, columns={**drive.columns, "gear": np.where(gone, np.nan, seen)})
    error = noise(len(drive), 1) * np.where(gone == lost, 8.0, 1.0)
    (best, *_) = failure_tree([holed], [error], H).leaves
    assert best.where == ("gear not measured" if lost else "gear measured")


def test_a_range_with_which_the_missing_go_says_so(drive):
    gone = np.arange(len(drive)) // 150 % 4 == 1
    slope = np.where(gone, np.nan, drive.columns["pitch_deg"])
    holed = replace(drive, columns={**drive.columns, "pitch_deg": slope})
    steep = drive.columns["pitch_deg"] > 1.0
    (best, *_) = failure_tree([holed], [noise(len(drive), 1) + 0.15 * (gone | steep)], H).leaves
    assert best.where.endswith("or not measured")


def test_noise_has_no_leaves(drive):
    found = [failure_tree([drive], [noise(len(drive), seed)], H) for seed in range(40)]
    assert sum(bool(tree.leaves) for tree in found) <= 5  # 5 % of 40 is 2; more than 5 has a chance of 1 %


def test_one_burst_is_no_regime(drive):
    error = noise(len(drive), 2)
    error[2000:2050] += 0.6
    assert failure_tree([drive], [error], H).leaves == ()


def test_the_figures_are_of_time_that_did_not_grow_the_tree(drive):
    grew = block_numbers([drive], H) // 2 % 2 == 0
    error = noise(len(drive), 3) + 0.15 * (grew & (drive.columns["header_height"] > 320.0))
    assert failure_tree([drive], [error], H).leaves == ()


def test_too_short_a_recording_has_no_tree(drive):
    assert failure_tree([drive[:40]], [noise(40, 1)], H).leaves == ()
