"""Shape parameters: a known dead zone and curvature come back, together with the linear parameters."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.identification.least_squares import FitError, fit
from cruise.identification.shapes import ahead_rms_mps, excited_shapes, fit_shapes
from cruise.identification.structures import parse
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tests.identification.truth import CURVATURE, EFFECTS, MODEL, THETA, THRESHOLD_MA, currents, recording

SHAPES = (("dead_zone", "threshold_ma"), ("quadratic_gain", "curvature"))


def wrong(threshold_ma: float, curvature: float):
    """The model with other shapes and no linear parameters."""
    effects = (DeadZone(threshold_ma), QuadraticGain(curvature), *EFFECTS[2:])
    return replace(MODEL, effects=effects, theta=(0.0,) * 4)


def shapes_of(model: Model) -> tuple[float, float]:
    """Threshold in mA and curvature."""
    zone, curve, *_ = model.effects
    assert isinstance(zone, DeadZone)
    assert isinstance(curve, QuadraticGain)
    return zone.threshold_ma, curve.curvature


def test_without_noise_dead_zone_and_curvature_come_back_exactly():
    found = fit_shapes(wrong(300.0, 0.0), [recording(400, noise_mps=0.0)], SHAPES)
    assert shapes_of(found) == (pytest.approx(THRESHOLD_MA, abs=1.0), pytest.approx(CURVATURE, abs=0.02))
    np.testing.assert_allclose(found.theta, THETA, rtol=0.03)


def test_with_noise_they_come_back_closely_and_predict_as_well_as_the_truth():
    taught, unseen = recording(800, 3, 0.01), recording(600, 4, 0.01)
    found = fit_shapes(wrong(350.0, 0.2), [taught], SHAPES)
    assert shapes_of(found) == (pytest.approx(THRESHOLD_MA, abs=20.0), pytest.approx(CURVATURE, abs=0.3))
    truth_mps = ahead_rms_mps(MODEL, [unseen], 3.0)
    assert ahead_rms_mps(found, [unseen], 3.0) < 1.05 * truth_mps
    assert ahead_rms_mps(fit(wrong(350.0, 0.2), [taught]), [unseen], 3.0) > 1.1 * truth_mps


def test_only_what_is_named_moves():
    found = fit_shapes(wrong(430.0, CURVATURE), [recording(400, noise_mps=0.0)], SHAPES[:1])
    assert shapes_of(found) == (pytest.approx(THRESHOLD_MA, abs=0.5), CURVATURE)
    assert found.effects[2:] == EFFECTS[2:]


def test_a_threshold_above_every_current_is_passed_over_in_the_search():
    low = recording(400, noise_mps=0.0, current_ma=currents(400, 5, 450.0, 560.0))
    found = fit_shapes(wrong(540.0, CURVATURE), [low], SHAPES[:1])
    assert shapes_of(found)[0] == pytest.approx(THRESHOLD_MA, abs=2.0)


def test_shapes_stay_within_their_bounds():
    found = fit_shapes(wrong(5.0, CURVATURE), [recording(300, 6, 0.0)], SHAPES[:1])
    assert 0.0 <= shapes_of(found)[0] <= 800.0


def test_what_can_not_be_fitted_at_all_says_why():
    with pytest.raises(FitError, match="does not excite"):
        fit_shapes(wrong(300.0, 0.0), [recording(300, current_ma=np.full(300, 700.0))], SHAPES)


def test_the_error_ahead_is_that_of_persistence_for_a_model_that_holds_its_speed():
    held = replace(MODEL, nb=1, effects=(), theta=(1.0, 0.0, 0.0))
    one = recording(300, 7, 0.0)
    moved = one.output[15:] - one.output[:-15]
    assert ahead_rms_mps(held, [one], 3.0) == pytest.approx(float(np.sqrt(np.mean(moved[1:] ** 2))), rel=1e-3)


def test_a_recording_shorter_than_the_horizon_has_no_error_ahead():
    with pytest.raises(FitError, match="3 s of whole recording"):
        ahead_rms_mps(MODEL, [recording(300)[:12]], 3.0)


def test_of_an_effect_that_is_not_there_its_first_parameter_is_looked_for():
    model = parse("arx:na=1,nb=1,delay_s=0+power_limit+coulomb_friction").model(0.2)
    columns = {INPUT: np.arange(50.0), OUTPUT: np.arange(50.0), "pitch_deg": np.sin(np.arange(50.0))}
    shapes = excited_shapes(model, [Recording(0.2 * np.arange(50), columns, 0.2, "made up")])
    assert shapes == [("power_limit", "power_kw"), ("coulomb_friction", "crossover_mps")]


@pytest.mark.parametrize("name", ["transport_delay", "resonance"])
def test_what_is_of_the_cores_structure_is_refused_as_a_term(name):
    with pytest.raises(FitError, match=f"{name} is no term"):
        parse(f"arx:na=1,nb=1,delay_s=0+{name}").model(0.2)
