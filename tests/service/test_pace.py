"""The program's own pace: pauses, a clock that runs back, a processor that is shared out."""

import pytest

from cruise.service.pace import Pace


def test_ticks_in_step_are_on_time():
    pace = Pace(0.05)
    assert all(pace.tick(0.05 * k) for k in range(200))
    assert pace.slowness == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("passed_s", "on_time", "words"),
    [
        (0.149, True, "no turn for 0.15 s"),
        (0.16, False, "no turn for 0.16 s"),
        (3.0, False, "no turn for 3.00 s"),
        (0.0, False, "the clock ran back"),
        (-2.0, False, "the clock ran back"),
    ],
)
def test_a_pause_and_a_clock_that_runs_back_are_not(passed_s, on_time, words):
    pace = Pace(0.05)
    pace.tick(10.0)
    assert pace.tick(10.0 + passed_s) is on_time
    assert pace.words == words
    assert pace.tick(10.0 + passed_s + 0.05) is True


def test_turns_that_are_left_out_add_up():
    pace = Pace(0.05)
    for k in range(60):
        assert pace.tick(0.1 * k)
    assert pace.slowness == pytest.approx(2.0, rel=0.01)
