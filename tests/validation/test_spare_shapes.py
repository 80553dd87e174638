"""Forms that an effect takes seldom are found where they are: the error falls to the noise, and not without them."""

import numpy as np
import pytest

from cruise.effects.grade import Grade
from cruise.identification.structures import parse
from cruise.recording import Recording
from cruise.validation import ladder
from cruise.validation.candidates import candidate_of
from cruise.validation.diagnose import diagnose
from cruise.validation.study import Study
from tests.validation.diagnosing import DT_S, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE
from tests.validation.driving import DELAY_S, GAIN, GRAVITY_MPS2, LAG_S, OFFSET_MPS, drive, levels, wander

NOISE_MPS = 0.01
SEED = 4
OIL_C = 20.0 + 50.0 * np.linspace(0.0, 1.0, SAMPLES) + wander(SAMPLES, DT_S, 14, 2.0, 8.0)
LOAD_PCT = 55.0 + wander(SAMPLES, DT_S, 15, 15.0, 3.0)
BAR = 200.0 + wander(SAMPLES, DT_S, 16, 60.0, 3.0)
GEAR = np.where(np.arange(SAMPLES) * DT_S // 11.0 % 2 == 0, 2.0, 3.0)


def followed(values: np.ndarray, time_constant_s: float) -> np.ndarray:
    """A low-pass by hand, at rest before."""
    place, places = values[0], []
    for value in values.tolist():
        place += (1.0 - np.exp(-DT_S / time_constant_s)) * (value - place)
        places.append(place)
    return np.array(places)


def shifted() -> np.ndarray:
    """Third gear is 1.4 times second; with a shift half of the drive is gone, and comes back within 0.8 s."""
    ratio, before, places = np.where(GEAR == 3.0, 1.4, 1.0), 1.0, []
    place = 1.0
    for now in ratio.tolist():
        place *= 1.0 if now == before else 0.5
        place += (1.0 - np.exp(-DT_S / 0.8)) * (now - place)
        before = now
        places.append(place)
    return np.array(places)


def limited() -> np.ndarray:
    """What keeps the power at 12 kW: the force is that of 15 t uphill and of rolling."""
    late = round((DELAY_S + LAG_S) / DT_S)
    current_ma = levels(SAMPLES, DT_S, SEED)
    free_mps = GAIN * np.concatenate([np.full(late, current_ma[0]), current_ma[:-late]]) + OFFSET_MPS
    force_kn = 15.0 * GRAVITY_MPS2 * (np.sin(np.radians(PITCH)) + 0.04)
    return np.minimum(1.0, 12.0 / np.maximum(force_kn * free_mps, 1e-3))


def slowed() -> np.ndarray:
    """A load in m/s that takes a share of the speed: found over and over from the speed that it leaves."""
    load = np.zeros(SAMPLES)
    for _ in range(20):
        load = -0.6 * LOAD_PCT / 100.0 * drive(SECONDS, SEED, DT_S, 0.0, load_mps=load).output
    return load


def centred(current_ma: np.ndarray) -> np.ndarray:
    """A spool that lags 40 mA behind, and is in its middle where no current flows: never beyond twice the current."""
    stands, acts = current_ma[0], []
    for value in current_ma.tolist():
        stands = min(max(stands, value - 40.0), value + 40.0)
        acts.append(min(max(stands, 0.0), 2.0 * value))
    return np.array(acts)


FORMS = {
    "hysteresis": (
        {"command": centred, "current_ma": np.maximum(levels(SAMPLES, DT_S, SEED, -250.0, 700.0), 0.0)},
        {},
        {"width_ma": (80.0, 4.0), "closed_share": (1.0, 0.15)},
    ),
    "oil_temperature": (
        {"gain": 1.0 - 0.1 * np.maximum(np.exp((40.0 - OIL_C) / 33.0) - 1.0, 0.0)},
        {"oil_temperature_c": OIL_C},
        {"warm_c": (40.0, 3.0)},
    ),
    "gear_ratio": ({"gain": shifted()}, {"gear": GEAR}, {"shift_s": (0.8, 0.3), "shift_loss": (0.5, 0.15)}),
    "engine_droop": (
        {"gain": 1.0 - 0.4 * (LOAD_PCT - followed(LOAD_PCT, 5.0)) / 100.0},
        {"engine_load_pct": LOAD_PCT},
        {"recovery_per_s": (0.2, 0.05)},
    ),
    "crop_load": (
        {"load_mps": -1.5 * np.maximum(LOAD_PCT - 60.0, 0.0) / 100.0},
        {"engine_load_pct": LOAD_PCT},
        {},
    ),
    "crop_load, by the stroke": (
        {"load_mps": slowed()},
        {"engine_load_pct": LOAD_PCT},
        {"stroke_share": (1.0, 0.2)},
    ),
}
"""What is hidden, what is recorded, and the shapes that are found with how far they may be off."""


def base(recording: Recording) -> Study:
    return ladder.begin([recording], STRUCTURE, None, None, PERIOD_S)


@pytest.mark.parametrize("form", FORMS)
def test_a_form_that_is_looked_for_only_where_it_is_worth_it_is_found(form):
    hidden, columns, shapes = FORMS[form]
    name = form.partition(",")[0]
    begun = base(drive(SECONDS, SEED, DT_S, NOISE_MPS, columns=columns, **hidden))
    plain = begun.search.grown_from_all(begun.base.explanation, candidate_of(name, begun.recordings))
    freed = begun.search.freed(plain, name)
    assert freed.cost < 0.5 * plain.cost
    assert begun.search.judged(name, freed).loss < 0.04 * begun.base.loss
    (effect,) = (one for one in freed.explanation.effects if one.name == name)
    for shape, (value, off) in shapes.items():
        assert getattr(effect, shape) == pytest.approx(value, abs=off)


POWERS = {
    "that is kept": ({"gain": limited()}, {"pitch_deg": PITCH}, {"hold": (1.0, 0.2)}),
    "of a pressure cut-off": (
        {"gain": 1.0 - 0.004 * np.maximum(BAR - 230.0, 0.0)},
        {"pitch_deg": PITCH, "line_pressure_bar": BAR},
        {"cutoff_bar": (230.0, 15.0), "cut_per_bar": (0.004, 0.001)},
    ),
}


def test_how_much_wheels_slip_says_nothing_of_what_acts_on_the_command():
    hidden, _, _ = FORMS["hysteresis"]
    begun = base(drive(SECONDS, SEED, DT_S, NOISE_MPS, **hidden))
    search, bare = begun.search, begun.base.explanation
    plain = search.grown_from_all(bare, candidate_of("hysteresis", begun.recordings))
    search.slip_mps = 0.5
    assert search.freed(plain, "hysteresis") is not plain


@pytest.mark.parametrize("form", POWERS)
def test_a_limit_is_found(form):
    hidden, columns, shapes = POWERS[form]
    begun = base(drive(SECONDS, SEED, DT_S, NOISE_MPS, columns=columns, **hidden))
    found = begun.search.grown_from_all(begun.base.explanation, candidate_of("power_limit", begun.recordings))
    assert begun.search.judged("power_limit", found).loss < 0.15 * begun.base.loss
    (effect,) = found.explanation.effects
    for shape, (value, off) in shapes.items():
        assert getattr(effect, shape) == pytest.approx(value, abs=off)


def test_a_shape_that_a_larger_effect_hid_is_looked_for_once_that_is_there():
    """A slope that costs a share of the stroke, under a dead zone that the model lacks: no power limit beside it."""

    def command(current_ma: np.ndarray) -> np.ndarray:
        return np.maximum(current_ma - 450.0, 0.0)

    level_mps = drive(SECONDS, SEED, DT_S, 0.0, command=command).output
    lost_mps = 2.5 * np.sin(np.radians(PITCH)) * level_mps / 1.5
    columns = {"pitch_deg": PITCH}
    recording = drive(SECONDS, SEED, DT_S, NOISE_MPS, command=command, load_mps=-lost_mps, columns=columns)
    begun = ladder.begin([recording], parse("arx:na=1,nb=3,delay_s=0.4+grade"), None, None, PERIOD_S)
    found = diagnose(begun)
    added = ladder.add(begun, "dead_zone")
    assert found.effects == ("dead_zone",)
    for explanation in (found.final.explanation, added.after.explanation):
        (grade,) = (one for one in explanation.effects if isinstance(one, Grade))
        assert grade.stroke_share > 0.6
