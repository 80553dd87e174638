"""A model whose effects need what the speed sensors show drives the machine: the node offers the ground speed too."""

from dataclasses import replace

import pytest

from cruise.effects import Custom, Effect, Stage
from cruise.effects.active_braking import ActiveBraking
from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.grade import Grade
from cruise.effects.sensor_bias import SensorBias
from cruise.effects.wheel_slip import WheelSlip
from cruise.model import files
from cruise.model.model import Model
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lockstep
from tests.service.drive import Whole, codec, cruise_settings

OWN = Custom("own", Stage.GAIN, "1 + p1 * (oil_temperature_c - 50)", p1=1e-4)


def with_effects(*effects: Effect) -> Model:
    """The factory model and these, their loads at one hundredth."""
    model = files.load(cruise_settings().model)
    loads = sum(effect.acts_as is Stage.LOAD for effect in effects)
    theta = (*model.theta[:-1], *(0.01,) * loads, model.theta[-1])
    std = (*model.theta_std[:-1], *(0.01,) * loads, model.theta_std[-1])
    return replace(model, effects=(*model.effects, *effects), theta=theta, theta_std=std)


def drive(model: Model, until_s: float) -> Whole:
    """The whole machine on one wire, driven by this model."""
    whole = Whole()
    whole.node = CruiseNode(cruise_settings(), model, codec())
    nodes = (whole.machine, whole.panel, whole.node, whole.listener)
    whole.loop = Lockstep([(node, whole.wire.end()) for node in nodes])
    return whole.run(until_s)


@pytest.mark.parametrize(
    "effects", [(SensorBias(), WheelSlip(1.0)), (Grade(), CoulombFriction(), ActiveBraking(0.8), OWN)]
)
def test_it_engages_holds_the_speed_and_learns(effects):
    whole = drive(with_effects(*effects), 25.0)
    assert whole.engaged_at(20.0)
    assert whole.combine.truth.ground_speed_mps == pytest.approx(1.2, abs=0.08)
    assert whole.node.estimator.snapshot().theta != with_effects(*effects).theta
