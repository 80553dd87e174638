"""What two edges drag along, at once and step by step."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cruise.effects.drag import begins, dragged


@given(
    centres=st.lists(st.floats(-100.0, 100.0) | st.just(np.nan), max_size=300),
    half=st.floats(0.0, 30.0),
)
def test_at_once_is_step_by_step(centres, half):
    middle = np.array(centres, float)
    halves = np.where(begins(np.isfinite(middle)), 0.0, half)
    low, high = middle - halves, middle + halves
    held, place = [], np.nan
    for below, above in zip(low.tolist(), high.tolist(), strict=True):
        place = below if place != place or below != below else min(max(place, below), above)
        held.append(place)
    np.testing.assert_array_equal(dragged(low, high), np.array(held, float))
