"""The core: its discrete parameters are those of the physics, and a model file in which they are not is refused."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from msgspec import structs

from cruise import settings
from cruise.effects.dead_zone import DeadZone
from cruise.effects.grade import Grade
from cruise.effects.leakage import Leakage
from cruise.model import files
from cruise.model.core import Core, discretised
from cruise.model.files import ModelFile, PhysicalCore, Provenance
from cruise.model.prediction import free_run
from cruise.settings import SettingsError

cores = st.builds(
    Core,
    gain_mps_per_ma=st.floats(-0.01, 0.01).filter(lambda gain: abs(gain) > 1e-5),
    delay_s=st.floats(0.0, 2.0),
    lag_s=st.floats(0.02, 2.0),
    time_constant_s=st.floats(0.03, 10.0),
    second_lag_s=st.sampled_from([0.0, 0.05, 0.4]),
    resonance_share=st.sampled_from([0.0, 0.3]),
    resonance_hz=st.floats(0.5, 2.4),
    damping=st.floats(0.1, 0.9),
    servo_hz=st.sampled_from([0.0, 0.5, 3.0]),
    servo_damping=st.floats(0.6, 0.99),
    stroke_share=st.sampled_from([0.0, 0.4]),
)


def written(core: Core, loads=(), offset_mps=0.1, period_s=0.2):
    """A model file with both views of a core."""
    effects = (DeadZone(100.0), Grade(), Leakage())[: 1 + len(loads)]
    model = discretised(core, effects, loads, offset_mps, period_s)
    own = {one.name: getattr(core, one.name) for one in fields(core)}
    names = (effect.name for effect in effects[1:])
    section = PhysicalCore(**own, loads_mps=dict(zip(names, loads, strict=True)), offset_mps=offset_mps)
    return files.file_of("m.yaml", model, Provenance(), core=section), model


@hypothesis_settings(max_examples=30)
@given(
    core=cores, loads=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), period_s=st.sampled_from([0.05, 0.1, 0.2])
)
def test_a_file_keeps_core_and_parameters_equal(core, loads, period_s):
    file, model = written(core, loads, 0.1, period_s)
    again = settings.parse(settings.dump(file), ModelFile, "m.yaml")
    assert again.core == file.core
    assert files.model_of("m.yaml", again) == model


@pytest.mark.parametrize("key", ["a_1", "b_0_mps_per_ma", "c_grade", "c_0_mps"])
def test_a_parameter_that_does_not_follow_from_the_core_is_refused(key):
    file, _ = written(Core(0.0025, 0.3, 0.15, 0.6), (0.05,))
    off = {**file.parameters, key: 1.001 * file.parameters[key]}
    with pytest.raises(
        SettingsError, match=rf"m\.yaml: parameters\.{key}: .* by the core it is .*delete the section core"
    ):
        files.model_of("m.yaml", structs.replace(file, parameters=off))
    rounded = {name: float(f"{value:.5g}") for name, value in file.parameters.items()}
    files.model_of("m.yaml", structs.replace(file, parameters=rounded))


CHANGES = {
    "gain_mps_per_ma": 0.0026,
    "delay_s": 0.35,
    "lag_s": 0.16,
    "time_constant_s": 0.61,
    "second_lag_s": 0.02,
    "resonance_share": 0.1,
    "servo_hz": 3.0,
    "stroke_share": 0.3,
    "offset_mps": 0.2,
}


@pytest.mark.parametrize("key", CHANGES)
def test_every_number_of_the_core_counts(key):
    file, _ = written(Core(0.0025, 0.3, 0.15, 0.6))
    assert file.core is not None
    changed = structs.replace(file.core, **{key: CHANGES[key]})
    with pytest.raises(SettingsError, match="core"):
        files.model_of("m.yaml", structs.replace(file, core=changed))


def test_a_core_of_another_structure_is_refused():
    file, _ = written(Core(0.0025, 0.3, 0.15, 0.6), (0.05,))
    assert file.core is not None
    without = structs.replace(file, core=structs.replace(file.core, loads_mps={}))
    with pytest.raises(SettingsError, match=r"core\.loads_mps: grade missing"):
        files.model_of("m.yaml", without)
    slower = structs.replace(file, core=structs.replace(file.core, delay_s=1.3))
    with pytest.raises(SettingsError, match="core: asks for delay of 6 samples, the model has 1"):
        files.model_of("m.yaml", slower)


def test_the_file_has_a_place_for_all_that_a_core_is():
    assert {one.name for one in fields(Core)} <= set(PhysicalCore.__struct_fields__)


def test_what_was_learned_further_has_no_core(tmp_path):
    file, model = written(Core(0.0025, 0.3, 0.15, 0.6))
    files.save(tmp_path / "m.yaml", model.with_theta(1.05 * value for value in model.theta), Provenance())
    assert files.read(tmp_path / "m.yaml").core is None
    assert files.load(tmp_path / "m.yaml").theta[0] == pytest.approx(1.05 * file.parameters["a_1"])


@pytest.mark.parametrize(
    "core",
    [
        Core(0.0025, 0.3, 0.15, 0.6),
        Core(0.0025, 0.07, 0.4, 0.3),
        Core(0.0025, 0.3, 0.15, 0.6, second_lag_s=0.2),
        Core(0.0025, 0.2, 0.1, 0.4, resonance_share=0.5, resonance_hz=0.8, damping=0.2),
        Core(0.0025, 0.2, 0.1, 0.4, servo_hz=0.9, servo_damping=0.7),
    ],
)
def test_the_discrete_model_is_the_physics(core):
    """Against the differential equations, stepped at 1 ms; the model at 100 Hz, means over its periods."""
    step_s, period_s, seconds = 1e-3, 0.01, 30.0
    many = round(period_s / step_s)
    levels = np.random.default_rng(3).uniform(0.0, 800.0, 12)
    u = np.repeat(levels, round(seconds / step_s / len(levels)))
    late = np.concatenate([np.full(round(core.delay_s / step_s), u[0]), u])[: len(u)]
    omega = 2.0 * math.pi * core.resonance_hz
    second_s = core.second_lag_s or step_s
    servo = 2.0 * math.pi * core.servo_hz
    w, w2, swing, rate, y, speeds = u[0], u[0], u[0], 0.0, core.gain_mps_per_ma * u[0] + 0.1, []
    w3, quick = u[0], 0.0
    for value in late.tolist():
        w += step_s / core.lag_s * (value - w)
        w2 += step_s / second_s * (w - w2)
        quick += step_s * (servo**2 * (w2 - w3) - 2.0 * core.servo_damping * servo * quick)
        w3 = w3 + step_s * quick if servo else w2
        rate += step_s * (omega**2 * (w3 - swing) - 2.0 * core.damping * omega * rate)
        swing += step_s * rate
        felt = (1.0 - core.resonance_share) * w3 + core.resonance_share * swing
        y += step_s / core.time_constant_s * (core.gain_mps_per_ma * felt + 0.1 - y)
        speeds.append(y)
    speed, current = (np.reshape(values, (-1, many)).mean(axis=1) for values in (speeds, u))
    model = discretised(core, (), (), 0.1, period_s)
    run = free_run(model, current, speed, {})
    known = np.isfinite(run)
    assert known.mean() > 0.8
    assert np.sqrt(np.mean((run - speed)[known] ** 2)) < 0.015 * np.std(speed)
    wrong = discretised(replace(core, delay_s=core.delay_s + 0.1), (), (), 0.1, period_s)
    assert np.sqrt(np.nanmean((free_run(wrong, current, speed, {}) - speed) ** 2)) > 0.05 * np.std(speed)


def test_the_steady_gain_is_the_cores():
    model = discretised(Core(0.0025, 0.3, 0.15, 0.6), (), (), 0.1, 0.2)
    assert model.dc_gain_mps_per_ma == pytest.approx(0.0025)
    assert model.theta[-1] / (1.0 - model.theta[0]) == pytest.approx(0.1)
