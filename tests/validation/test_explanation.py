"""An explanation knows its effects' places, and gives the discrete model that the core's physics asks for."""

import math

import pytest

from cruise.effects import Stage
from cruise.effects.active_braking import ActiveBraking
from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.grade import Grade
from cruise.effects.sensor_bias import SensorBias
from cruise.model.core import Core
from cruise.validation.explanation import CORE, Explanation

EFFECTS = (DeadZone(200.0), EngineSpeed(), Grade(), CoulombFriction(), ActiveBraking(0.5), SensorBias())
ONE = Explanation(Core(2.5e-3, 0.3, 0.15, 0.6), EFFECTS, (0.4, 0.2, 0.7), 0.1, frozenset({"resonance"}))


def test_it_lists_what_it_holds_and_where():
    assert ONE.names == (*(effect.name for effect in EFFECTS), "resonance")
    assert ONE.at(Stage.COMMAND) == (0,)
    assert ONE.at(Stage.GAIN) == (1,)
    assert ONE.at(Stage.LOAD) == (2, 3, 5)
    assert ONE.at(Stage.DYNAMICS) == (4,)


@pytest.mark.parametrize("period_s", [0.05, 0.2])
def test_its_model_has_the_parameters_of_the_physics(period_s):
    model = ONE.model(period_s)
    a = math.exp(-period_s / 0.6)
    named = dict(zip(model.parameter_names, model.theta, strict=True))
    assert named["a_1"] == pytest.approx(a)
    assert named["c_grade"] == pytest.approx((1.0 - a) * 0.4)
    assert named["c_coulomb_friction"] == pytest.approx((1.0 - a) * 0.2)
    assert named["c_sensor_bias"] == pytest.approx((1.0 - a) * 0.7)
    assert named["c_0_mps"] == pytest.approx((1.0 - a) * 0.1)
    assert model.dc_gain_mps_per_ma == pytest.approx(2.5e-3)
    assert model.effects == EFFECTS
    assert (model.period_s, model.na, model.delay) == (period_s, 1, {0.05: 6, 0.2: 1}[period_s])


def test_like_another_model_it_has_that_ones_delay_and_taps():
    like = Explanation(Core(2.5e-3, 0.7, 0.3, 0.6), EFFECTS, (0.4, 0.2, 0.7), 0.1).model(0.2)
    model = ONE.model(0.2, like)
    assert (model.delay, model.nb) == (like.delay, like.nb)
    assert ONE.model(0.2, ONE.model(0.2)).theta == pytest.approx(ONE.model(0.2).theta, rel=0.02)
    assert model.theta != pytest.approx(ONE.model(0.2).theta[: len(model.theta)])


def test_the_bounds_hold_the_cores_of_this_class_of_machine():
    for name, bound in CORE.items():
        assert bound.low <= bound.neutral <= bound.high
        assert hasattr(ONE.core, name)
        assert bound.low <= getattr(ONE.core, name) or name in ("second_lag_s", "servo_hz", "stroke_share")
