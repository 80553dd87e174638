"""A drive that yields more at a greater stroke, and in a higher gear: slower there, and a force costs it more."""

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from cruise.effects.gear_ratio import GearRatio
from cruise.effects.grade import Grade
from cruise.model import files
from cruise.model.core import Core, discretised
from cruise.model.model import Model
from cruise.model.prediction import ahead, free_run
from cruise.settings import SettingsError
from cruise.validation.explanation import Explanation

GEARS = GearRatio(1.4, 2.5, 4.4, 7.8)
CORE = Core(2.5e-3, 0.3, 0.1, 0.4, stroke_share=0.6)
LEVEL = {"gear": 2.0, "pitch_deg": 0.0, "machine_mass_kg": 15000.0}
UPHILL = {**LEVEL, "pitch_deg": 3.0}


def model_of(core=CORE, effects=(), loads=(), period_s=0.05):
    return discretised(core, effects, loads, 0.0, period_s)


def yields(drive_mps, share=0.6):
    """1 at 1.5 m/s, as much more or less as its share of the stroke says."""
    return 1.0 - share + share * drive_mps / 1.5


def settled(model, current_ma, signals=LEVEL, seconds=60.0):
    state = model.start(0.0, current_ma, signals)
    count = round(seconds / model.period_s)
    return model.predict(state, [current_ma] * count, [signals] * count)


@pytest.mark.parametrize("drive_mps", [0.3, 1.5, 2.2])
@pytest.mark.parametrize("period_s", [0.05, 0.2])
def test_the_time_constant_is_that_of_the_stroke_at_any_period(drive_mps, period_s):
    """From standstill, with the drive already there: what is missing shrinks by one factor in every sample."""
    speeds = np.array(settled(model_of(period_s=period_s), drive_mps / CORE.gain_mps_per_ma))
    missing = drive_mps - speeds[:10]
    found_s = -period_s / np.log(missing[1:] / missing[:-1])
    np.testing.assert_allclose(found_s, CORE.time_constant_s * yields(drive_mps), rtol=1e-6)


@pytest.mark.parametrize("drive_mps", [0.3, 1.5, 2.2])
def test_a_force_costs_as_much_more_as_the_drive_yields(drive_mps):
    model = model_of(effects=(Grade(),), loads=(0.2,))
    current_ma = drive_mps / CORE.gain_mps_per_ma
    cost = settled(model, current_ma)[-1] - settled(model, current_ma, UPHILL)[-1]
    assert cost == pytest.approx(0.2 * 9.81 * math.sin(math.radians(3.0)) * yields(drive_mps), rel=1e-6)


@pytest.mark.parametrize("gear", [1, 2, 3, 4])
def test_a_gear_yields_by_the_square_of_its_ratio(gear):
    """Gain, time constant and what a slope costs, below second gear too."""
    ratio, drive_mps = GEARS.ratio(float(gear)), 1.5
    model, signals = model_of(effects=(GEARS, Grade()), loads=(0.2,)), {"gear": float(gear)}
    current_ma = drive_mps / CORE.gain_mps_per_ma
    speeds = np.array(settled(model, current_ma, {**LEVEL, **signals}))
    assert speeds[-1] == pytest.approx(ratio * drive_mps)
    missing = ratio * drive_mps - speeds[:5]
    found_s = -model.period_s / np.log(missing[1:] / missing[:-1])
    np.testing.assert_allclose(found_s, CORE.time_constant_s * ratio**2, rtol=1e-6)
    cost = speeds[-1] - settled(model, current_ma, {**UPHILL, **signals})[-1]
    assert cost == pytest.approx(0.2 * 9.81 * math.sin(math.radians(3.0)) * ratio**2, rel=1e-6)


def test_a_model_that_does_not_know_how_its_drive_yields_keeps_equation_12():
    """A force costs the same in every gear, and first gear is as quick as second."""
    model = model_of(replace(CORE, stroke_share=0.0), (GEARS, Grade()), (0.2,))
    for gear, alpha in ((1.0, 1.0), (3.0, (2.5 / 4.4) ** 2)):
        state = model.apply(model.start(1.0, 400.0, LEVEL), 400.0, {**UPHILL, "gear": gear})
        assert state.pace == pytest.approx(alpha)
        assert state.loads[0] == pytest.approx(-9.81 * math.sin(math.radians(3.0)))


def test_a_whole_recording_and_single_steps_say_the_same():
    model = model_of(effects=(GEARS, Grade()), loads=(0.2,), period_s=0.2)
    rng, count = np.random.default_rng(1), 200
    currents = np.repeat(rng.uniform(100.0, 900.0, count // 10), 10)
    signals = {
        "gear": np.repeat([2.0, 3.0, 1.0, 4.0], count // 4),
        "pitch_deg": np.repeat(rng.uniform(-4.0, 4.0, count // 20), 20),
        "machine_mass_kg": np.full(count, 16000.0),
    }
    speeds = 1.0 + 0.1 * rng.standard_normal(count)
    rows = [{name: float(column[k]) for name, column in signals.items()} for k in range(count)]
    state, expected = model.start(speeds[0], currents[0], rows[0]), np.full(count, np.nan)
    for k in range(1, count):
        state = model.apply(state, currents[k], rows[k])
        expected[k] = model.next_speed(state)
        state = model.observe(state, speeds[k])
    found = ahead(model, currents, speeds, signals, 1)
    late = slice(model.delay + model.nb + 1, None)
    np.testing.assert_allclose(found[late], expected[late], rtol=1e-9)
    assert np.isfinite(free_run(model, currents, speeds, signals)[late]).all()


def test_a_stroke_that_slows_down_several_poles_is_refused():
    with pytest.raises(ValueError, match="a drive of one pole, not of na=2"):
        Model(0.2, 2, 1, 0, (), (0.4, 0.1, 1e-3, 0.0), stroke_share=0.3)


def test_a_file_that_slows_down_several_poles_is_refused_in_words():
    file = files.file_of("m.yaml", Model(0.2, 2, 1, 0, (), (0.4, 0.1, 1e-3, 0.0)), files.Provenance())
    with pytest.raises(SettingsError, match=r"m\.yaml: stroke_share: 0\.3 slows down a drive of one pole.*na: 2;"):
        files.model_of("m.yaml", structs.replace(file, stroke_share=0.3))


def test_an_explanation_hands_its_share_to_the_model():
    assert Explanation(CORE).model(0.2).stroke_share == 0.6
