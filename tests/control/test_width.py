"""The believed width: the model as if it had always had that one, and what a little more of it would change."""

import math

import numpy as np
import pytest

from cruise.control.width import BelievedWidth
from cruise.effects.dead_zone import DeadZone
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.model.model import Model

BAND_MA, FRAME_S = 40.0, 0.05
PATHS = {
    "rising": [500.0, 600.0, 700.0],
    "turned": [500.0, 800.0, 700.0],
    "turned within the band": [500.0, 800.0, 790.0],
    "turned twice": [500.0, 800.0, 700.0, 705.0],
}


def model(*after, share=1.0):
    """A model with so much of the band."""
    return Model(FRAME_S, 1, 2, 3, (Hysteresis(share * BAND_MA, 0.9), *after), (0.4, 5e-4, 5e-4, 0.0))


def driven(width, currents, state=None):
    """The state after these currents, with the width stepped beside."""
    state = width.model.start(1.0, currents[0], {}) if state is None else state
    for current_ma in currents:
        after = width.model.apply(state, current_ma, {})
        width.step(state, after, current_ma, {})
        state = after
    return state


def alone(drives_with, currents):
    """The state of a model after these currents."""
    state = drives_with.start(1.0, currents[0], {})
    for current_ma in currents:
        state = drives_with.apply(state, current_ma, {})
    return state


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("share", [0.98, 0.7, 0.3])
def test_after_a_change_the_state_is_as_if_the_width_had_always_been_that_one(path, share):
    width, currents = BelievedWidth(model()), PATHS[path]
    moved = width.believe(share, driven(width, currents))
    expected = alone(model(share=share), currents)
    effect = width.model.effects[0]
    assert isinstance(effect, Hysteresis)
    assert (effect.width_ma, effect.share) == (pytest.approx(share * BAND_MA), 0.9)
    if path != "turned within the band":  # of less of a band it would have been at the other edge
        assert moved.drives == pytest.approx(expected.drives)
        assert moved.effects == pytest.approx(expected.effects)
    more = [*currents, 650.0, 850.0]
    again = driven(width, [650.0, 850.0], moved)
    assert again.drives[0] == pytest.approx(alone(model(share=share), more).drives[0])


@pytest.mark.parametrize("path", PATHS)
def test_what_a_little_more_would_change_is_what_it_changes(path):
    after = (DeadZone(400.0), QuadraticGain(0.5))
    width, currents = BelievedWidth(model(*after)), PATHS[path]
    state = driven(width, currents)
    wider = alone(model(*after, share=1.01), currents)
    expected = (np.array(wider.drives) - state.drives) / 0.01
    assert abs(expected[0]) > 5.0
    assert width.drives_ma == pytest.approx(expected, rel=0.02)


def test_changing_it_to_and_fro_changes_nothing():
    width = BelievedWidth(model(DeadZone(400.0)))
    state = driven(width, PATHS["turned"])
    again = width.believe(1.0, width.believe(0.6, state))
    assert again.drives == pytest.approx(state.drives)
    assert again.effects[0] == pytest.approx(state.effects[0])


def test_less_than_a_grain_is_no_change():
    width = BelievedWidth(model())
    before, state = width.model, driven(width, PATHS["turned"])
    assert width.believe(0.996, state) is state
    assert width.model is before
    assert width.believe(0.99, state) is not state
    assert width.share == 0.99


def test_a_model_without_hysteresis_has_no_width():
    plain = Model(FRAME_S, 1, 1, 0, (DeadZone(400.0),), (0.4, 1e-3, 0.0))
    width = BelievedWidth(plain)
    state = driven(width, PATHS["turned"])
    assert width.believe(0.5, state) is state
    assert width.model is plain
    assert not width.drives_ma.any()


def test_another_model_keeps_the_share_and_the_path_of_the_current():
    width = BelievedWidth(model())
    state = width.believe(0.7, driven(width, PATHS["turned"]))
    known = width.drives_ma.copy()
    width.adopt(Model(FRAME_S, 1, 4, 3, (Hysteresis(BAND_MA, 0.9),), (0.5, 1e-4, 2e-4, 3e-4, 4e-4, 0.0)))
    effect = width.model.effects[0]
    assert isinstance(effect, Hysteresis)
    assert effect.width_ma == pytest.approx(0.7 * BAND_MA)
    assert width.drives_ma[:5] == pytest.approx(known)
    assert len(width.drives_ma) == 7
    assert width.wider_ma != state.effects[0]


def test_begun_anew_it_knows_the_share_and_not_the_path():
    width = BelievedWidth(model())
    width.believe(0.7, driven(width, PATHS["turned"]))
    width.restart()
    assert width.share == 0.7
    assert math.isnan(width.wider_ma)
    assert not width.drives_ma.any()
