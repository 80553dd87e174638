"""Transport delay: a matter of structure."""

import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.transport_delay import TransportDelay


@pytest.mark.parametrize(
    ("delay_s", "period_s", "more"), [(0.0, 0.05, 0), (0.3, 0.05, 6), (0.34, 0.2, 2), (2.0, 0.2, 10)]
)
def test_the_model_gets_more_delay_in_whole_samples_and_nothing_else(delay_s, period_s, more):
    assert TransportDelay(delay_s).restructured(1, 3, 2, period_s) == (1, 3, 2 + more)


def test_most_effects_leave_the_structure_as_it_is():
    assert DeadZone(300.0).restructured(1, 3, 2, 0.2) == (1, 3, 2)
