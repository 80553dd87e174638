"""A dependence that no effect is: the signals that may matter, its curve, and what it spans."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.candidates import unnamed
from cruise.validation.unnamed import (
    FARTHEST,
    KNOTS_PCT,
    SPEED,
    UnnamedCurve,
    UnnamedDirection,
    UnnamedGain,
    UnnamedLoad,
    UnnamedPush,
    knots_of,
    range_of,
)
from tests.validation.driving import wander
from tests.validation.recorded import BARE, SAMPLES, everything, recorded


def test_every_recorded_signal_may_matter_but_those_that_are_the_speed_itself():
    one = everything()
    rest = Recording(
        one.time_s,
        {
            **one.columns,
            "header_height": wander(SAMPLES, 0.2, 5, 30.0, 4.0),
            "still": np.ones(SAMPLES),
        },
        0.2,
        "x.csv",
    )
    names = {candidate.name for candidate in unnamed([rest], BARE)}
    assert {"unnamed:header_height", "unnamed:pitch_deg", f"unnamed:{INPUT}", f"unnamed:{SPEED}"} <= names
    assert not {f"unnamed:{name}" for name in (OUTPUT, "wheel_speed_mps", "still", "slope_deg")} & names
    only_one = {candidate.name for candidate in unnamed([rest, one], BARE)}
    assert names - only_one == {"unnamed:header_height"}


def test_a_curve_spans_what_was_measured():
    one = recorded(header=np.concatenate([np.full(5, 1e6), np.linspace(0.0, 100.0, SAMPLES - 5)]))
    (header,) = [candidate for candidate in unnamed([one], BARE) if candidate.signal == "header"]
    assert header.centre == pytest.approx(50.0, abs=2.0)
    assert header.half_width == pytest.approx(48.0, abs=2.0)
    gain = UnnamedGain("header", header.centre, header.half_width, 0.1, 0.2, 0.3)
    z = np.array([-1.5, -1.0, 0.0, 1.0, 1.5])
    values = header.centre + header.half_width * np.array([-9.0, -1.0, 0.0, 1.0, 9.0])
    found, _ = gain.step(1.0, np.zeros(5), {"header": values}, None, 0.2)
    assert pytest.approx(1.0 + 0.1 * z + 0.2 * z**2 + 0.3 * z**3) == found
    assert abs(z[0]) == FARTHEST
    load, _ = UnnamedLoad("header", header.centre, header.half_width, 2).step(
        0.0, np.full(5, -5.0), {"header": values}, None, 0.2
    )
    assert load == pytest.approx(-(z**2))
    at_rest, _ = UnnamedLoad("header", header.centre, header.half_width, 2).step(
        0.0, np.zeros(5), {"header": values}, None, 0.2
    )
    assert at_rest == pytest.approx(np.zeros(5))
    for speed_mps in (-5.0, 0.0, 5.0):  # a slope pushes whichever way the machine moves
        push, _ = UnnamedPush("header", header.centre, header.half_width, 2).step(
            0.0, np.full(5, speed_mps), {"header": values}, None, 0.2
        )
        assert push == pytest.approx(z**2)


def test_a_curve_of_the_current_is_broken_at_its_knots():
    (candidate,) = [one for one in unnamed([recorded()], BARE) if one.signal == INPUT]
    (grown,) = candidate.grown(BARE)
    curve, direction = grown.effects
    assert isinstance(curve, UnnamedCurve)
    assert isinstance(direction, UnnamedDirection)
    current = recorded().columns[INPUT]
    assert curve.knots_ma == knots_of(current) == tuple(np.percentile(current, KNOTS_PCT))
    standing = np.concatenate([np.full(SAMPLES, 0.5), [np.nan], -current])
    assert knots_of(standing) == pytest.approx(curve.knots_ma)
    u = np.linspace(-1.2, 1.2, 201) * current.max()
    same, _ = curve.step(u, u, {}, None, 0.2)
    np.testing.assert_array_equal(same, u)
    width_ma, stop_ma, last_ma = curve.knots_ma[1], curve.knots_ma[-2], curve.knots_ma[-1]
    dead, _ = replace(curve, p0=-1.0, p1=-1.0).step(u, u, {}, None, 0.2)
    assert dead == pytest.approx(np.sign(u) * np.maximum(np.abs(u) - width_ma, 0.0))
    stopped, _ = replace(curve, p8=-1.0, p9=-1.0).step(u, u, {}, None, 0.2)
    assert stopped == pytest.approx(np.clip(u, -stop_ma, stop_ma))
    steep, _ = replace(curve, p9=2.0).step(u, u, {}, None, 0.2)
    assert steep == pytest.approx(u + 2.0 * np.sign(u) * np.maximum(np.abs(u) - last_ma, 0.0))
    weak, _ = replace(curve, reverse=0.25).step(u, u, {}, None, 0.2)
    assert weak == pytest.approx(np.where(u < 0.0, 0.75 * u, u))


def test_the_direction_of_the_current_is_that_of_the_last_second():
    direction = UnnamedDirection()
    current = np.concatenate([np.full(20, 500.0), np.full(20, 700.0), np.full(40, 400.0)])
    felt, _ = direction.over(0.0, np.zeros(80), {"pump_current_ma": current}, 0.2)
    assert felt[:20] == pytest.approx(np.zeros(20))
    assert felt[20] > 0.9
    assert felt[40] < -0.9
    assert abs(felt[39]) < 0.5
    assert abs(felt[79]) < 0.1


def test_what_never_moves_has_no_range():
    assert range_of(np.full(10, 3.0)) == (3.0, 0.0)
    assert range_of(np.full(10, np.nan)) == (0.0, 0.0)
    rare = np.zeros(1000)
    rare[500] = 4.0
    assert range_of(rare) == (2.0, 2.0)
