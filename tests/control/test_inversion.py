"""The inverse of the command effects: exact without hysteresis, continuous with it, robust to a width that is wrong."""

import numpy as np
import pytest

from cruise.control.inversion import Inversion, InversionSettings
from cruise.effects.dead_zone import DeadZone
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.saturation import Saturation
from cruise.model.model import Model

EFFECTS = (Hysteresis(40.0), DeadZone(400.0), QuadraticGain(0.5))
MODEL = Model(0.05, 1, 1, 0, EFFECTS, (0.4, 1e-3, 0.0))
PLAIN = Model(0.05, 1, 1, 0, EFFECTS[1:], (0.4, 1e-3, 0.0))
SETTINGS = InversionSettings(hysteresis_share=1.0, turn_ma=5.0)
FRAME_S = 0.05


def settled(model, currents):
    state = model.start(1.0, currents[0], {})
    for current in currents:
        state = model.apply(state, current, {})
    return state


def inverse(model, drive, state, settings=SETTINGS):
    """Of a wish that has only just come up."""
    return Inversion(settings, FRAME_S).step(model, drive, state, {})


def test_without_hysteresis_it_is_the_models_own():
    state = settled(PLAIN, [700.0])
    for drive in (50.0, 300.0, 500.0):
        assert inverse(PLAIN, drive, state) == PLAIN.current_for(drive, state, {})


def test_a_wish_far_off_is_met_exactly_and_through_the_right_edge():
    state = settled(MODEL, [500.0, 700.0])
    for drive in (100.0, 500.0):
        current = inverse(MODEL, drive, state).nearest(0.0)
        assert MODEL.drive_for(current, state, {}) == pytest.approx(drive)


def test_the_current_has_no_jump_where_the_wish_turns():
    state = settled(MODEL, [500.0, 700.0])
    stands = MODEL.drive_for(700.0, state, {})
    wishes = np.linspace(stands - 30.0, stands + 30.0, 601)
    currents = np.array([inverse(MODEL, wish, state).nearest(0.0) for wish in wishes])
    assert np.diff(currents).min() > 0.0
    assert np.diff(currents).max() < 0.1 * (1.0 + 20.0 / 5.0) * 1.05
    assert np.ptp(currents) > 60.0 / 1.4 + 30.0


@pytest.mark.parametrize("true_width", [0.0, 20.0, 40.0, 60.0])
def test_repeating_it_ends_near_the_wish_without_going_to_and_fro(true_width):
    """A machine whose band is another one: the current settles, and by less than its band away."""
    inversion = Inversion(InversionSettings(), FRAME_S)
    machine = Hysteresis(true_width)
    acts, state, sent = 700.0, settled(MODEL, [500.0, 700.0]), []
    for _ in range(600):
        current = inversion.step(MODEL, 250.0, state, {}).nearest(0.0)
        sent.append((sent[-1] if sent else 700.0) + 0.3 * (current - (sent[-1] if sent else 700.0)))
        state = MODEL.apply(state, sent[-1], {})
        acts, _ = machine.step(sent[-1], 0.0, {}, acts, 0.05)
    assert np.ptp(sent[-20:]) < 0.01
    assert (np.diff(sent) <= 1e-9).all()
    wish = PLAIN.current_for(250.0, settled(PLAIN, [700.0]), {}).low
    assert abs(acts - wish) < 0.5 * max(true_width, 40.0)


@pytest.mark.parametrize(
    ("end", "drive", "stands_ma"), [(Saturation(900.0), 900.0, 905.0), (DeadZone(400.0), 0.0, 380.0)]
)
def test_where_many_currents_would_do_it_takes_the_one_that_acts(end, drive, stands_ma):
    """At a stop and in a dead zone: their middle is far from any current that was asked for."""
    model = Model(0.05, 1, 1, 0, (Hysteresis(40.0), end), (0.4, 1e-3, 0.0))
    state = settled(model, [stands_ma - 60.0, stands_ma + 20.0])
    assert state.effects[0] == stands_ma
    assert abs(inverse(model, drive, state).nearest(0.0) - stands_ma) <= 20.0


def held(settings, wish_ma, seconds=20.0):
    """The output in mA of a play that was driven up to 700 mA, while one wish is held, and what the wish then lacks."""
    model = Model(FRAME_S, 1, 1, 0, (Hysteresis(40.0),), (0.4, 1e-3, 0.0))
    inversion, state = Inversion(settings, FRAME_S), settled(model, [500.0, 700.0])
    given = []
    for _ in range(round(seconds / FRAME_S)):
        current = inversion.step(model, wish_ma, state, {}).nearest(0.0)
        state = model.apply(state, current, {})
        given.append(state.drives[0])
    return np.array(given), inversion


@pytest.mark.parametrize("turned_ma", [-20.0, -8.0, 8.0])
def test_a_small_wish_that_stays_is_met_all_but_what_is_borne(turned_ma):
    settings = InversionSettings()
    given, inversion = held(settings, 680.0 + turned_ma)
    assert abs(given[-1] - (680.0 + turned_ma)) <= settings.borne_ma + 0.1
    assert np.ptp(given[-100:]) < 0.1
    assert abs(inversion.lacking_ma) <= 20.0
    at_once, _ = held(InversionSettings(lasting_s=1e9), 680.0 - 8.0)
    assert at_once[-1] - (680.0 - 8.0) == pytest.approx(8.0)  # the narrowed play alone does not move


def test_what_was_lacking_is_forgotten_once_the_wish_goes_far():
    model = Model(FRAME_S, 1, 1, 0, (Hysteresis(40.0),), (0.4, 1e-3, 0.0))
    _, inversion = held(InversionSettings(), 672.0)
    assert inversion.lacking_ma < -1.0
    state = settled(model, [500.0, 700.0])
    for _ in range(400):
        state = model.apply(state, inversion.step(model, 500.0, state, {}).nearest(0.0), {})
    assert state.drives[0] == pytest.approx(500.0, abs=InversionSettings().borne_ma + 0.5)
    inversion.restart()
    assert inversion.lacking_ma == 0.0


def test_where_springs_close_the_band_a_little_is_met_all_the_same():
    """From above it stands at 60 mA: to 30 mA the band's lower edge would lead with 10, which give no more than 20."""
    model = Model(FRAME_S, 1, 1, 0, (Hysteresis(40.0, closed_share=1.0),), (0.4, 1e-3, 0.0))
    state = settled(model, [700.0, 40.0])
    assert state.effects[0] == 60.0
    current = inverse(model, 30.0, state).nearest(0.0)
    assert current == 15.0
    assert model.drive_for(current, state, {}) == pytest.approx(30.0)
