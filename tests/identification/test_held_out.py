"""Held-out parts: every sample is judged once, by a fit that has not seen it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.identification.held_out import FOLDS, SHORTEST_BLOCK_S, folds
from cruise.recording import MIN_SAMPLES, Recording
from cruise.signals import INPUT, OUTPUT

PERIOD_S = 0.2


def recording(samples: int, number: int = 0) -> Recording:
    """A recording whose times are its own: the fold's parts can be told from it."""
    time_s = 10_000.0 * number + PERIOD_S * np.arange(samples)
    return Recording(time_s, {INPUT: time_s, OUTPUT: time_s}, PERIOD_S, f"{number}.csv")


@given(lengths=st.lists(st.integers(MIN_SAMPLES, 600), min_size=1, max_size=12))
def test_every_sample_is_unseen_once_and_never_in_what_was_seen_then(lengths):
    recordings = [recording(samples, i) for i, samples in enumerate(lengths)]
    judged = [np.zeros(samples, int) for samples in lengths]
    for fold in folds(recordings):
        seen = np.concatenate([part.time_s for part in fold.training]) if fold.training else np.zeros(0)
        for one, unseen, times in zip(recordings, fold.unseen, judged, strict=True):
            times[unseen] += 1
            assert not np.isin(one.time_s[unseen], seen).any()
    assert all((times == 1).all() for times in judged)


@given(lengths=st.lists(st.integers(MIN_SAMPLES, 600), min_size=1, max_size=8))
def test_what_was_seen_is_all_the_rest_and_never_joined(lengths):
    recordings = [recording(samples, i) for i, samples in enumerate(lengths)]
    for fold in folds(recordings):
        for part in fold.training:
            np.testing.assert_allclose(np.diff(part.time_s), PERIOD_S)
        lost = sum(lengths) - sum(s.stop - s.start for s in fold.unseen) - sum(map(len, fold.training))
        assert 0 <= lost < 2 * MIN_SAMPLES * len(lengths)  # pieces too short to be recordings


def test_a_long_recording_gives_a_block_to_every_fold():
    found = folds([recording(1000), recording(505, 1)])
    assert [fold.unseen[0] for fold in found] == [slice(200 * i, 200 * i + 200) for i in range(FOLDS)]
    assert [fold.unseen[1] for fold in found] == [slice(101 * i, 101 * i + 101) for i in range(FOLDS)]
    assert [len(part) for part in found[2].training] == [400, 400, 202, 202]


def test_short_recordings_are_held_out_whole_where_there_are_many():
    short = round(FOLDS * SHORTEST_BLOCK_S / PERIOD_S) - 1
    several = [recording(short, i) for i in range(FOLDS + 1)]
    found = folds(several)
    assert [[s.stop - s.start for s in fold.unseen] for fold in found[:2]] == [
        [short, 0, 0, 0, 0, short],
        [0, short, 0, 0, 0, 0],
    ]
    assert [len(fold.training) for fold in found] == [FOLDS - 1, FOLDS, FOLDS, FOLDS, FOLDS]
    few = folds(several[: FOLDS - 1])
    assert all(0 < s.stop - s.start < short for fold in few for s in fold.unseen)
    long = folds([recording(short + 1, i) for i in range(FOLDS)])
    assert all(0 < s.stop - s.start < short for fold in long for s in fold.unseen)


def test_the_number_of_folds_can_be_chosen():
    assert [fold.unseen for fold in folds([recording(100)], 2)] == [(slice(0, 50),), (slice(50, 100),)]
    with pytest.raises(IndexError):
        folds([recording(100)], 2)[2]
