"""The worst stretches: the maximal scoring subsequences, ranked, in words."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.recording import Recording, resample
from cruise.validation.worst_stretches import maximal_stretches, worst_stretches
from tests.validation.machine import record


@pytest.fixture(scope="module")
def drive() -> Recording:
    return resample(record(seed=1, seconds=300.0), 0.2)


def by_definition(scores: list[int], offset: int = 0) -> list[tuple[int, int]]:
    """The best contiguous part, the shortest of equals, then the same left and right of it."""
    runs = [(sum(scores[i:j]), i - j, -i, (i, j)) for i in range(len(scores)) for j in range(i + 1, len(scores) + 1)]
    best = max(runs, default=(0, 0, 0, (0, 0)))
    if best[0] <= 0:
        return []
    i, j = best[3]
    left, right = by_definition(scores[:i], offset), by_definition(scores[j:], offset + j)
    return [*left, (offset + i, offset + j), *right]


@given(st.lists(st.integers(-6, 6).filter(bool), max_size=14))
def test_all_maximal_stretches_are_found(scores: list[int]):
    found, expected = maximal_stretches(np.array(scores, float)), by_definition(scores)

    def total(runs: list[tuple[int, int]]) -> list[int]:
        return sorted(sum(scores[i:j]) for i, j in runs)

    assert total(found)[-1:] == total(expected)[-1:]
    assert all(i >= j for (i, _), (_, j) in zip(found[1:], found, strict=False))
    sums = [sum(scores[i:j]) for i in range(len(scores)) for j in range(i + 1, len(scores) + 1)]
    if len(set(sums)) == len(sums):  # else there are ties, and more than one answer
        assert found == expected


def scanned(scores: np.ndarray) -> list[tuple[int, int]]:
    """The same as the paper has it before its last section: every earlier candidate is looked at."""
    kept: list[tuple[int, int, float, float]] = []
    sums = np.concatenate([[0.0], np.cumsum(scores)]).tolist()
    for k in np.flatnonzero(scores > 0.0).tolist():
        one = (k, k + 1, sums[k], sums[k + 1])
        while True:
            place = next((j for j in reversed(range(len(kept))) if kept[j][2] < one[2]), None)
            if place is None or kept[place][3] >= one[3]:
                break
            one = (kept[place][0], one[1], kept[place][2], one[3])
            del kept[place:]
        kept.append(one)
    return [(start, stop) for start, stop, _, _ in kept]


@given(st.lists(st.integers(-6, 6), max_size=60))
def test_to_jump_over_candidates_leaves_none_out(scores: list[int]):
    assert maximal_stretches(np.array(scores, float)) == scanned(np.array(scores, float))


def test_a_long_drive_costs_no_more_per_sample_than_a_short_one():
    squared = np.random.default_rng(0).standard_normal(200_000) ** 2
    began_s = time.process_time()
    found = maximal_stretches(squared - 2.0)
    assert time.process_time() - began_s < 2.0, "0.05 s; every candidate with every earlier one takes 300 times as long"
    assert len(found) > 20_000


def test_known_subsequences():
    scores = np.array([4, -5, 3, -3, 1, 2, -2, 2, -2, 1, 5], float)  # the example of Ruzzo and Tompa's paper
    assert maximal_stretches(scores) == [(0, 1), (2, 3), (4, 11)]


def test_the_worst_come_first_with_their_share_and_words(drive):
    error = 0.01 * np.random.default_rng(1).standard_normal(len(drive))
    error[400:450] += 0.3
    error[900:920] -= 0.2
    slope = np.array(drive.columns["pitch_deg"])
    slope[900:920] = 7.0
    changed = Recording(drive.time_s, {**drive.columns, "pitch_deg": slope}, drive.dt_s, "x.csv")
    first, second = worst_stretches([changed], [error])[:2]
    assert (first.start, first.stop) == (400, 450)
    assert (first.start_s, first.end_s) == pytest.approx((changed.time_s[400], changed.time_s[449]))
    assert first.error_share == pytest.approx(np.sum(error[400:450] ** 2) / np.sum(error**2))
    assert first.error_words == "0.3 m/s faster than predicted"
    assert (second.start, second.stop) == (900, 920)
    assert second.error_words == "0.2 m/s slower than predicted"
    assert "7 deg uphill" in second.sentence
    assert first.error_share > second.error_share


def test_several_recordings_share_one_ranking_and_holes_count_nothing(drive):
    quiet, loud = np.full(len(drive), 0.01), np.full(len(drive), 0.01)
    loud[100:140] = 0.5
    loud[120:122] = np.nan
    found = worst_stretches([drive, drive], [quiet, loud])
    assert [(one.recording, one.start, one.stop) for one in found] == [(1, 100, 140)]
    assert found[0].rmse_mps == pytest.approx(0.5)
    assert found[0].error_share > 0.95


def test_a_spike_is_no_stretch_and_no_error_has_none(drive):
    error = np.zeros(len(drive))
    assert worst_stretches([drive], [error]) == ()
    error[50] = 1.0
    assert worst_stretches([drive], [error]) == ()
