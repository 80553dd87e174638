"""What was heard before is known again; noise and rest are not taken for it."""

from itertools import cycle, islice
from random import Random

import pytest

from cruise.service.playback import DIFFERENT, ROUND, Playback


def heard(contents):
    """The longest stretch that was said to be repeated."""
    playback, most = Playback(), 0
    for content in contents:
        playback.take(content)
        most = max(most, playback.repeated)
    return most


def noise(count, seed=1, values=60):
    rng = Random(seed)
    return [(rng.randrange(values), rng.randrange(6)) for _ in range(count)]


@pytest.mark.parametrize("around", [5, 11, 16, 40, ROUND])
def test_a_round_that_is_played_again_is_found_with_its_second_turn(around):
    before, loop = noise(200), noise(around, 2)
    assert heard(before + list(islice(cycle(loop), around))) < 5
    assert heard(before + list(islice(cycle(loop), around + 24))) >= 24


def test_noise_is_no_repetition():
    assert heard(noise(20000)) < 8
    assert heard(noise(20000, values=4)) < 16  # a coarse sensor


def test_at_rest_all_is_equal_and_none_of_it_played_back():
    assert heard([(0, 0)] * 300) == 0
    assert heard(list(islice(cycle(((0, 0), (0, 1), (1, 1))), 300))) == 0  # it hunts between its last digits
    assert DIFFERENT > 3


def test_a_value_that_is_sent_again_until_there_is_a_new_one_is_no_repetition():
    assert heard([content for content in noise(2000) for _ in range(5)]) < 24
