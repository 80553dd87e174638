"""The margins are python-control's of the loop written out, and the response is that of the controller that drives."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from cruise.control.controller import Controller, ControlSettings
from cruise.control.margins import Drive, FirstMove, Law
from cruise.control.observer import DisturbanceObserver
from cruise.control.predictive import Programme
from cruise.control.shaping import CommandShaper
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.rate_limit import RateLimit
from cruise.model.model import Model
from cruise.signals import Sample

GEARS = GearRatio(1.4, 2.5, 4.4, 7.5)
MODEL = Model(0.2, 1, 3, 2, (GEARS,), (0.6, 3e-4, 9e-4, 4e-4, 0.0))
SETTINGS = ControlSettings()
FRAME_S = SETTINGS.frame_s
PACES = (1.0, (2.5 / 4.4) ** 2, (2.5 / 7.5) ** 2)


def with_gain(model, factor):
    a, b, loads, c_0 = model.split(model.theta)
    return model.with_theta((*a, *(factor * value for value in b), *loads, c_0))


def matrices(step, size):
    """A, B, C, D of a linear step (state, input) -> (state, output), by unit inputs."""
    columns = [step(np.eye(size)[i], 0.0) for i in range(size)]
    driven, through = step(np.zeros(size), 1.0)
    rows = np.column_stack([state for state, _ in columns])
    return rows, driven[:, None], np.array([[output for _, output in columns]]), np.array([[through]])


def margin(driver, plant):
    """python-control's, from the response on a fine grid: of a polynomial of degree 60 it warns by itself."""
    omega = np.geomspace(1e-2, math.pi / FRAME_S, 1000)
    return control.margin(control.frd(-driver * plant, omega, smooth=True))


def written_out(model, machine, pace, hill=0.0):
    """Controller and machine as they step, frame by frame, in python-control; the loop is opened at the machine."""
    own, other = Drive(model, FRAME_S, pace), Drive(machine, FRAME_S, pace)
    shaper = CommandShaper(SETTINGS.shaping_hz, SETTINGS.shaping_order, FRAME_S)
    law = Programme(own.pole, own.response, own.delay, shaper, FRAME_S, SETTINGS.predictive, pace)
    depth, order = own.delay + len(own.response), SETTINGS.shaping_order
    move = FirstMove.of(law, depth, order)
    seen = DisturbanceObserver(FRAME_S, SETTINGS.observer).filter(own.pole, pace)
    gain = seen.gain + hill * (seen.hill_gain - seen.gain)

    def controller(state, speed):
        observed, wanted = state[:4], state[4]
        drives, lags = state[5 : 5 + depth], list(state[5 + depth :])
        drives = np.concatenate([[lags[-1]], drives[:-1]])  # what was sent a frame ago has flowed
        felt = own.response @ drives[own.delay :]
        expected = seen.moves @ observed
        expected[0] += (1.0 - own.pole) * felt
        observed = expected + gain * (speed - expected[0] - expected[3])
        wanted = (
            move.speed * observed[0]
            + move.drives @ drives
            + move.shaper @ np.array(lags)
            + move.load * observed[1]
            + move.wanted * wanted
        )
        value = wanted
        for i in range(order):
            value = lags[i] = lags[i] + shaper.share * (value - lags[i])
        return np.concatenate([observed, [wanted], drives, lags]), value

    length = other.delay + len(other.response)

    def plant(state, sent):
        drives = np.concatenate([[sent], state[1:length]])
        felt = other.gain / own.gain * other.response @ drives[other.delay :]
        return np.concatenate([[other.pole * state[0] + (1.0 - other.pole) * felt], drives]), state[0]

    return (
        control.ss(*matrices(controller, 5 + depth + order), FRAME_S),
        control.ss(*matrices(plant, 1 + length), FRAME_S),
    )


@pytest.mark.parametrize(
    ("factor", "pace", "hill"),
    [
        (1.0, PACES[0], 0.0),
        (1.6, PACES[0], 0.0),
        (0.5, PACES[1], 0.0),
        (1.0, PACES[2], 0.0),
        (1.0, PACES[1], 1.0),
        (1.3, PACES[2], 1.0),
        (1.0, PACES[2], 0.4),
    ],
)
def test_the_margins_are_those_of_python_control(factor, pace, hill):
    machine = with_gain(MODEL, factor)
    driver, plant = written_out(MODEL, machine, pace, hill)
    found = Law(MODEL, SETTINGS, pace, hill).around(machine)
    gain, phase_deg, _, crossover = margin(driver, plant)
    assert found.gain == pytest.approx(gain, rel=0.01)
    assert found.phase_deg == pytest.approx(phase_deg, abs=0.5)
    assert found.crossover_hz == pytest.approx(crossover / (2.0 * math.pi), rel=0.02)


@pytest.mark.parametrize("factor", [0.9, 0.98, 1.02, 1.1, 1.5, 5.0])
def test_a_loop_is_stable_where_its_poles_are(factor):
    law = Law(MODEL, SETTINGS)
    machine = with_gain(MODEL, factor * law.around(MODEL).gain)
    driver, plant = written_out(MODEL, machine, 1.0)
    stable = np.abs(control.poles(control.feedback(plant, -driver))).max() < 1.0  # pyright: ignore[reportArgumentType]
    assert stable == (factor < 1.0)
    assert (law.around(machine).gain > 1.0) == stable


@pytest.mark.parametrize("pace", PACES[:2])
def test_another_delay_and_pole_in_the_machine_count(pace):
    machine = replace(MODEL, delay=3, theta=(0.7, 3e-4, 9e-4, 4e-4, 0.0))
    driver, plant = written_out(MODEL, machine, pace)
    gain, phase_deg, _, _ = margin(driver, plant)
    found = Law(MODEL, SETTINGS, pace).around(machine)
    assert found.gain == pytest.approx(gain, rel=0.01)
    assert found.phase_deg == pytest.approx(phase_deg, abs=0.5)


@pytest.mark.parametrize(("gear", "servo_s"), [(2.0, 0.0), (4.0, 0.0), (2.0, 0.4)])
@pytest.mark.parametrize("hz", [0.1, 0.5, 2.0])
def test_the_response_is_that_of_the_controller_that_drives(hz, gear, servo_s):
    """A ripple of the speed, small enough that nothing is limited and the observer stays calm; the current flows."""
    signals = {"gear": gear}
    ratio = GEARS.ratio(gear)
    model = replace(MODEL, effects=(RateLimit(lag_s=servo_s), GEARS))
    law = Law(model, SETTINGS, GEARS.pace(signals, ()), hz=np.array([hz]))
    controller = Controller(model, SETTINGS)
    frames = round(max(30.0, 6.0 / hz) / FRAME_S)
    rippled = 0.002 * np.sin(2.0 * math.pi * hz * FRAME_S * np.arange(frames))
    still_mps, sent = 1.2 * ratio, [1.2 / MODEL.dc_gain_mps_per_ma]
    for k in range(frames):
        sample = Sample(FRAME_S * k, sent[-1], still_mps + rippled[k], signals)
        command = controller.step(sample, still_mps if k else None)
        sent.append(command.current_ma if k else sent[-1])
    late = slice(frames // 2, frames)
    angle = 2.0 * math.pi * hz * FRAME_S * np.arange(frames)[late]
    columns = np.column_stack([np.cos(angle), -np.sin(angle), np.ones(len(angle))])
    fitted = [np.linalg.lstsq(columns, one, rcond=None)[0] for one in (np.array(sent[1:])[late], rippled[late])]
    found, given = (real + 1j * imaginary for real, imaginary, _ in fitted)
    found /= given
    assert found == pytest.approx(law.response[0] / (law.gain * ratio), rel=1e-3)
