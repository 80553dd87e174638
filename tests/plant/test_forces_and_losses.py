"""What acts on the machine from outside, what its motor loses at speed, and the power that its pump may take."""

import pytest
from msgspec.structs import replace

from cruise.plant import Combine, Inputs, PlantSettings
from cruise.plant.line import PA_PER_BAR
from cruise.plant.pump import PumpSettings, target
from cruise.plant.vehicle import LOSS_AT_RADPS

PLAIN = PlantSettings()


def settled(settings: PlantSettings, inputs: Inputs, seconds: float = 20.0) -> Combine:
    """The machine after it has driven with these inputs."""
    combine = Combine(settings, seed=1)
    combine.advance(inputs, seconds)
    return combine


def lossy(share: float, exponent: float) -> PlantSettings:
    transmission = replace(PLAIN.transmission, speed_loss_share=share, speed_loss_exponent=exponent)
    return replace(PLAIN, transmission=transmission)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_the_motor_loses_its_share_of_the_flow_at_speed(exponent):
    inputs = Inputs(1000.0)
    lossless, losing = settled(PLAIN, inputs).state, settled(lossy(0.1, exponent), inputs).state
    lost = 0.1 * (losing.shaft_speed_radps / LOSS_AT_RADPS) ** exponent
    assert 0.03 < lost < 0.1
    assert losing.ground_speed_mps * (1.0 + lost) == pytest.approx(lossless.ground_speed_mps, rel=0.01)


def test_a_loss_at_speed_is_none_at_creep():
    inputs = Inputs(480.0)
    lossless, losing = settled(PLAIN, inputs).state, settled(lossy(0.1, 2.0), inputs).state
    assert 0.0 < losing.ground_speed_mps == pytest.approx(lossless.ground_speed_mps, rel=1e-3)


def test_power_control_takes_the_stroke_back():
    settings = replace(PLAIN, pump=replace(PLAIN.pump, power_kw=20.0))
    uphill = Inputs(1100.0, grade_deg=8.0)
    free, held = settled(PLAIN, uphill).state, settled(settings, uphill).state
    power_w = held.line_pressure_pa * held.pump_flow_m3ps
    assert power_w == pytest.approx(20e3, rel=0.02)
    assert free.line_pressure_pa * free.pump_flow_m3ps > 1.5 * power_w


def test_power_control_leaves_braking_and_small_power_alone():
    settings = PumpSettings(power_kw=20.0, load_sensitivity_per_bar=1e-4)
    full_flow_m3ps = 4e-3
    braking = target(settings, 1150.0, -300.0 * PA_PER_BAR, full_flow_m3ps)
    assert braking == settings.stop
    assert target(settings, 1150.0, 20.0 * PA_PER_BAR, full_flow_m3ps) > 0.99
    forward, backward = (target(settings, sign * 1150.0, sign * 200e5, full_flow_m3ps) for sign in (1.0, -1.0))
    assert forward == pytest.approx(20e3 / (200e5 * full_flow_m3ps))
    assert backward == -forward


def test_an_implement_resists_the_motion_and_never_makes_one():
    assert settled(PLAIN, Inputs(0.0, implement_drag_n=20e3), 5.0).state.ground_speed_mps == 0.0
    for current_ma, sign in ((900.0, 1.0), (-900.0, -1.0)):
        alone = settled(PLAIN, Inputs(current_ma)).state.line_pressure_pa
        dragged = settled(PLAIN, Inputs(current_ma, implement_drag_n=8e3)).state
        assert sign * dragged.line_pressure_pa > sign * alone + 30e5
        assert sign * dragged.ground_speed_mps > 0.0


def test_a_pull_acts_whatever_the_motion():
    rolling = settled(PLAIN, Inputs(0.0, pull_n=20e3, clutch=True), 5.0).state
    assert rolling.ground_speed_mps < -1.0
    slower, faster = (settled(PLAIN, Inputs(900.0, pull_n=pull_n)).state for pull_n in (8e3, -8e3))
    assert slower.line_pressure_pa > faster.line_pressure_pa + 60e5
    assert slower.ground_speed_mps < faster.ground_speed_mps
