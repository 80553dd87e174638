"""The catch-all foretells what has a cause in the recorded signals, of whatever law, and no noise."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from cruise.validation.foretold import CHANCE, LITTLE, beside, foretold
from cruise.validation.search import BLOCK_S
from cruise.validation.simulation import Scene
from cruise.validation.unnamed import SPEED
from tests.validation.driving import wander

DT_S, N = 0.2, 3000
RNG = np.random.default_rng(8)
CURRENT = np.repeat(RNG.uniform(300.0, 900.0, N), RNG.integers(5, 30, N))[:N]
MODELLED = 2e-3 * np.asarray(signal.lfilter([0.2], [1.0, -0.8], CURRENT))
NOISE = 0.02 * RNG.standard_normal(N)
HEADER = 300.0 + wander(N, DT_S, 1, 60.0, 4.0)
PRESSURE = 100.0 + wander(N, DT_S, 2, 40.0, 4.0)
BLOCKS = (np.arange(N) * DT_S // BLOCK_S).astype(int)
SLOPES = np.column_stack([MODELLED, np.ones(N)]) * 0.1


def scene(error: np.ndarray, header_mm: np.ndarray = HEADER) -> Scene:
    columns = {
        INPUT: CURRENT,
        OUTPUT: MODELLED + np.nan_to_num(error),
        "header_height_mm": header_mm,
        "line_pressure_bar": PRESSURE,
    }
    return Scene([Recording(DT_S * np.arange(N), columns, DT_S, "made")], [*columns])


def fitted(error: np.ndarray, slopes: np.ndarray = SLOPES) -> Any:
    """A fit of which only the error and its derivatives are asked."""
    return SimpleNamespace(error_mps=error, jacobian=slopes, layout=SimpleNamespace(scale=np.ones(slopes.shape[1])))


def looked(error: np.ndarray, *others: np.ndarray, header_mm: np.ndarray = HEADER) -> Any:
    return foretold(scene(error, header_mm), fitted(error), [fitted(one) for one in others], BLOCKS)


def test_noise_is_not_foretold():
    found = looked(NOISE)
    assert found.share < 0.1 < CHANCE
    assert found.signals == ()
    assert found.loss == pytest.approx(max(found.share, 0.0) * np.mean(NOISE**2), rel=0.2, abs=1e-6)


def test_a_law_that_nobody_named_is_and_its_signal_is_named():
    law = 0.05 * np.sign(np.sin((HEADER - 300.0) / 15.0))
    found = looked(NOISE + law)
    assert found.share > 0.6
    assert found.signals == ("header_height_mm",)
    assert found.loss == pytest.approx(np.mean(law**2), rel=0.25)


def test_so_is_what_acts_while_a_signal_moves_whichever_way():
    """Oil that turns the wheels is missing at the drive while they turn."""
    turned = 30.0 * np.sin(np.cumsum(np.repeat(RNG.choice([0.0, 0.0, 0.15], 200), 15)))[:N]
    law = 0.06 * (np.abs(np.gradient(turned)) / DT_S > 3.0)
    found = looked(NOISE + law, header_mm=300.0 + turned)
    assert found.share > CHANCE
    assert found.signals[0] == "header_height_mm"


def test_what_wanders_as_slowly_as_a_clock_tells_is_none_of_it():
    """Soil, and a header that is lowered all the time: trees would read the clock off its height."""
    soil = wander(N, DT_S, 5, 0.05, 40.0)
    lowered = 600.0 - 0.1 * np.arange(N)
    found = looked(NOISE + soil, header_mm=lowered)
    assert found.share < CHANCE
    assert found.signals == ()
    assert found.drift == pytest.approx(np.mean(soil**2), rel=0.2)
    law = 0.05 * np.sign(np.sin(lowered / 15.0)) * np.sign(CURRENT - 600.0)
    assert looked(NOISE + soil + law, header_mm=lowered).share > CHANCE, "but not what comes and goes with the current"


def test_of_the_pitch_the_slope_is_seen_by_the_name_of_the_signal():
    slope_deg = wander(N, DT_S, 6, 3.0, 6.0)
    pitch_deg = slope_deg + np.degrees(np.gradient(MODELLED, DT_S) / 9.81)
    error = NOISE + 0.05 * np.sign(np.sin(slope_deg))
    columns = {INPUT: CURRENT, OUTPUT: MODELLED + error, "pitch_deg": pitch_deg}
    hills = Scene([Recording(DT_S * np.arange(N), columns, DT_S, "hills")], [*columns])
    found = foretold(hills, fitted(error), [], BLOCKS)
    assert found.share > CHANCE
    assert found.signals == ("pitch_deg",)


def test_so_is_a_memory_of_the_current():
    poles = np.exp((-0.15 + 1j) * 2.0 * np.pi * 0.8 * DT_S)
    ringing = np.asarray(signal.lfilter([1.0, -1.0], np.real(np.poly([poles, np.conj(poles)])), CURRENT))
    error = NOISE + 0.05 * ringing / ringing.std()
    found = looked(error)
    assert found.share > 0.4
    assert found.signals[0] in (INPUT, SPEED)


def test_what_the_drive_itself_moves_is_not_asked():
    assert looked(NOISE + 0.05 * (PRESSURE - 100.0) / 40.0).share < CHANCE


def test_half_of_what_a_known_effect_takes_away_is_nothing_new():
    law = 0.04 * np.sign(HEADER - 300.0)
    error = NOISE + law
    known = looked(error, error - 2.0 * law)
    assert known.share < CHANCE < 0.5 < looked(error).share
    larger = beside(fitted(error), [fitted(error - law)])
    assert larger == pytest.approx(beside(fitted(NOISE + (1.0 - LITTLE) * law), []), abs=0.01)


def test_a_known_effect_only_takes_away_and_the_core_moves_by_a_typical_change():
    law = 0.04 * np.sign(HEADER - 300.0)
    opposite = beside(fitted(NOISE + law), [fitted(NOISE + 2.0 * law)])
    assert np.std(opposite) == pytest.approx(np.std(NOISE + law), rel=0.02)
    assert np.std(beside(fitted(NOISE + SLOPES[:, 0]), [])) == pytest.approx(0.02, rel=0.05)
    assert np.std(beside(fitted(NOISE + 5.0 * SLOPES[:, 0]), [])) > 0.04


def test_what_is_not_judged_is_left_out():
    error = NOISE + 0.05 * np.sign(HEADER - 300.0)
    holes = np.where(np.arange(N) % 7 < 3, np.nan, error)
    found = looked(holes)
    assert np.isnan(beside(fitted(holes), [])).sum() == np.isnan(holes).sum()
    assert found.share == pytest.approx(looked(error).share, abs=0.1)
