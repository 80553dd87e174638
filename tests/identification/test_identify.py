"""From recordings to a judged model: known truths come back, and what judges a fit was never seen by it."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.saturation import Saturation
from cruise.identification import identify as module
from cruise.identification.accuracy import accuracy
from cruise.identification.arx import fit_arx
from cruise.identification.families import ahead
from cruise.identification.held_out import folds
from cruise.identification.identify import fit_family, identify, validation_filter, with_shapes
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.identification.regressors import FitError
from cruise.identification.structures import PRESETS, parse
from cruise.identification.whiteness import whiteness
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tests.identification.truth import STROKE_SHARE, STROKED_MODEL, stroked
from tests.model.test_prediction import Drag
from tools.benchmarks.recovery import SYSTEMS, currents, filtered, recording

RAW = PreparationSettings(cutoff_hz=0.0)
FILTERED = PreparationSettings()
WRITTEN = {
    "arx": "arx:na=2,nb=2,delay_s=0.4",
    "armax": "armax:na=2,nb=2,nc=1,delay_s=0.4",
    "output_error": "oe:nf=2,nb=2,delay_s=0.4",
}


@pytest.mark.parametrize("family", WRITTEN)
def test_the_truth_of_every_family_comes_back(family):
    system = SYSTEMS[family]
    found = identify(parse(WRITTEN[family]), [system.record(3)], RAW)
    error = np.abs(np.subtract(found.fitted.theta, system.truth)) / found.fitted.theta_std
    assert error.max() < 3.5
    assert found.fitted.converged
    assert not found.filtered
    assert found.whiteness.p_value > 0.001
    assert found.held_out is not None
    assert 0.97 < found.held_out.rmse_mps / found.training.rmse_mps < 1.1
    assert found.held_out.rmse_mps < 0.6 * found.persistence.rmse_mps
    assert (found.refused, found.horizon_s, found.fitted.unstable) == ("", pytest.approx(3.0), "")


@pytest.mark.parametrize(("family", "fed_back"), [("arx", 2), ("armax", 3), ("output_error", 0)])
def test_whiteness_knows_what_was_fed_back(family, fed_back):
    one = SYSTEMS[family].record(3)
    found = identify(parse(WRITTEN[family]), [one], RAW)
    expected = whiteness([one.output - found.fitted.ahead(one, 1)], fed_back)
    assert found.whiteness.p_value == pytest.approx(expected.p_value, rel=1e-9)


def test_a_family_that_is_not_the_truth_is_not_white():
    # ARX on output error: the residuals show it, and so do a simulation's against a fit one step ahead
    one = SYSTEMS["output_error"].record(3)
    arx, oe = (identify(parse(WRITTEN[family]), [one], RAW) for family in ("arx", "output_error"))
    assert arx.whiteness.p_value < 1e-6 < oe.whiteness.p_value
    assert oe.free_run.rmse_mps < arx.free_run.rmse_mps


def test_shapes_are_found_before_the_parameters_and_stand_in_the_model():
    one = SYSTEMS["hammerstein"].record(5)
    found = identify(parse("arx:na=1,nb=2,delay_s=0.4+saturation+dead_zone+quadratic_gain"), [one], RAW)
    assert found.model is not None
    assert found.model.effects == found.effects
    stop, zone, curve = found.effects
    assert stop == Saturation(), "no current reaches a stop: no sign of it"
    assert isinstance(zone, DeadZone)
    assert isinstance(curve, QuadraticGain)
    # A curve that may straighten and a rounded edge take a part of each other's bend.
    assert zone.threshold_ma == pytest.approx(500.0, abs=50.0)
    assert curve.curvature == pytest.approx(0.6, abs=0.4)
    assert found.fitted.theta[0] == pytest.approx(0.7, abs=0.05)


def test_the_search_for_shapes_begins_where_it_is_told():
    one = SYSTEMS["hammerstein"].record(5)
    structure = parse("arx:na=1,nb=2,delay_s=0.4+dead_zone")
    start = replace(structure.model(0.2), effects=(DeadZone(480.0),))
    told = []
    identify(structure, [one], RAW, start, show=told.append)
    assert "looking for threshold_ma of dead_zone" not in told
    assert told[0] == "fitting arx:na=1,nb=2,delay_s=0.4+dead_zone"
    assert told.index("looking for edge_ma of dead_zone") < told.index(
        "refining threshold_ma of dead_zone, edge_ma of dead_zone"
    )
    assert told[-1] == "judging on held-out part 5"


@pytest.mark.parametrize("family", ["arx:na=1,nb=1", "armax:na=1,nb=1,nc=1", "oe:nf=1,nb=1"])
def test_a_drive_that_yields_with_its_stroke_stays_one(family):
    found = identify(parse(f"{family},delay_s=0.2"), [stroked(900, noise_mps=0.005)], RAW, STROKED_MODEL)
    assert found.model is not None
    assert found.model.stroke_share == STROKE_SHARE
    assert found.held_out is not None
    assert found.held_out.rmse_mps < 0.006, "the noise, and next to nothing of the drive"


def test_held_out_is_what_each_fold_says_of_what_it_has_not_seen():
    parts = [SYSTEMS["hammerstein"].record(seed)[:300] for seed in (1, 2)]
    structure, smooth = parse("arx:na=1,nb=2,delay_s=0.4+dead_zone"), smoother(FILTERED, 0.2)
    found = identify(structure, parts, FILTERED)
    shaped = with_shapes(structure.model(0.2), parts, smooth)
    predicted = [np.full(len(one), np.nan) for one in parts]
    for fold in folds(parts):
        fitted = fit_family(structure, with_shapes(shaped, fold.training, smooth), fold.training, smooth)
        for one, unseen, result in zip(parts, fold.unseen, predicted, strict=True):
            result[unseen] = fitted.ahead(one, 15, smooth)[unseen]
    by_hand = accuracy([one.output for one in parts], predicted)
    assert found.held_out == by_hand
    assert by_hand.samples == found.training.samples


def test_no_fit_sees_what_it_is_judged_on(monkeypatch):
    one = SYSTEMS["hammerstein"].record(4)
    seen = []

    def watched(function):
        def call(first, second, *rest):
            recordings = second if function is with_shapes else rest[0]
            seen.append(np.concatenate([part.time_s for part in recordings]))
            return function(first, second, *rest)

        return call

    monkeypatch.setattr(module, "fit_family", watched(fit_family))
    monkeypatch.setattr(module, "with_shapes", watched(with_shapes))
    identify(parse("arx:na=1,nb=2,delay_s=0.4+dead_zone"), [one], RAW)
    assert [len(times) for times in seen[:2]] == [600, 600]
    assert len(seen) == 12, "shapes and parameters of every fold"
    for i, times in enumerate(seen[2:]):
        assert not np.isin(one.time_s[folds([one])[i // 2].unseen[0]], times).any()


def test_what_was_learnt_by_heart_explains_nothing_that_is_held_out():
    # 20 taps always find something in 40 s of a speed that has nothing to do with the current
    rng = np.random.default_rng(2)
    noise = recording(currents(rng, 200), 1.0 + 0.3 * rng.standard_normal(200))
    found = identify(parse("arx:na=0,nb=20,delay_s=0"), [noise], RAW)
    assert found.held_out is not None
    assert found.training.explained_pct > 5.0
    assert found.held_out.explained_pct < 0.0


def test_filtering_is_told_and_changes_the_fit():
    one = SYSTEMS["arx"].record(6)
    raw, filtered_ = identify(PRESETS["arx10"], [one], RAW), identify(PRESETS["arx10"], [one], FILTERED)
    assert (raw.filtered, filtered_.filtered) == (False, True)
    by_hand = fit_arx(PRESETS["arx10"].model(0.2), [one], smoother(FILTERED, 0.2))
    assert filtered_.fitted.theta == by_hand.theta != raw.fitted.theta
    np.testing.assert_array_equal(
        filtered_.predicted_mps[0], ahead(by_hand.model, one, 15, smoother(FILTERED, 0.2)), strict=True
    )


def test_an_effect_that_reads_the_speed_leaves_the_input_as_it_was():
    smooth = smoother(FILTERED, 0.2)
    assert validation_filter(Model(0.2, 1, 1, 0, (), (0.5, 1e-4, 0.0)), smooth) is smooth
    assert validation_filter(Model(0.2, 1, 1, 0, (Drag(),), (0.5, 1e-4, 0.1, 0.0)), smooth) is None
    assert validation_filter(Model(0.2, 1, 1, 0, (), (0.5, 1e-4, 0.0)), None) is None


def test_recordings_of_another_rate_are_brought_to_the_model_s():
    slow = SYSTEMS["arx"].record(7)
    fast = Recording(
        0.05 * np.arange(1, 2401),
        {INPUT: np.repeat(slow.input, 4), OUTPUT: np.repeat(slow.output, 4)},
        0.05,
        "fast.csv",
    )
    found = identify(parse(WRITTEN["arx"]), [slow, fast], RAW)
    assert [one.dt_s for one in found.recordings] == [0.2, 0.2]
    assert found.fitted.theta[0] == pytest.approx(1.2, abs=0.1)


def test_narx_has_effects_but_no_model_to_drive_with():
    found = identify(parse("narx:na=1,nb=2,degree=2,delay_s=0.4+dead_zone"), [SYSTEMS["hammerstein"].record(8)], RAW)
    assert found.model is None
    assert [effect.name for effect in found.effects] == ["dead_zone"]
    assert found.held_out is not None
    assert found.held_out.explained_pct > 80.0


def runaway(samples: int = 400) -> Recording:
    """A speed that leaves any stable model: y_k = 1.02 y_(k-1) + ..."""
    rng = np.random.default_rng(8)
    current = currents(rng, samples)
    return recording(current, filtered([1e-6], [1.0, -1.02], current - 700.0 + rng.standard_normal(samples)))


def test_an_unstable_predictor_is_said_to_be_and_has_no_held_out_figures():
    found = identify(parse("arx:na=1,nb=1,delay_s=0"), [runaway()], RAW)
    assert found.fitted.unstable == "pole at 1.02"
    assert found.held_out is None
    assert found.refused == "unstable without held-out part 1: pole at 1.02"


def test_recordings_too_short_to_hold_anything_out_still_give_a_model():
    one = SYSTEMS["arx"].record(9)[:28]
    found = identify(parse("arx:na=2,nb=5,delay_s=0"), [one], RAW)
    assert found.held_out is None
    assert "usable samples for 8 parameters: record for longer" in found.refused
    assert found.training.samples > 0


@pytest.mark.parametrize(
    ("part", "horizon_s", "says"),
    [
        (slice(0, 100), 30.0, r"no sample has 30 s of whole recording before it"),
        (slice(0, 12), 1.0, r"usable samples for 5 parameters: record for longer"),
    ],
)
def test_what_can_not_be_done_says_what_to_do(part, horizon_s, says):
    with pytest.raises(FitError, match=says):
        identify(parse(WRITTEN["arx"]), [SYSTEMS["arx"].record(9)[part]], RAW, horizon_s=horizon_s)


@pytest.mark.parametrize("family", ["arx10", "oe6", "armax", "narx1", "arx10B"])
def test_a_current_that_stays_is_refused_whatever_the_family(family):
    # readings of a constant current differ by rounding once they are averaged
    still = recording(700.0 * (1.0 + 1e-15 * np.arange(300)), 1.0 + 0.1 * np.sin(np.arange(300)))
    with pytest.raises(FitError, match="the current is 700 mA throughout; drive steps"):
        identify(PRESETS[family], [still], FILTERED)


def test_one_frequency_can_not_tell_many_parameters_apart():
    wave = np.sin(0.3 * np.arange(600))
    one = recording(700.0 + 200.0 * wave, 1.0 + 0.5 * wave)
    with pytest.raises(FitError, match=r"only \d of 11 parameters can be told apart.*drive steps of different size"):
        identify(PRESETS["arx2"], [one], RAW)


@pytest.mark.parametrize(
    "structure",
    [
        "arx:na=1,nb=3,delay_s=0.4+speed_droop",
        "armax:na=1,nb=3,nc=1,delay_s=0.4+speed_droop",
        "oe:nf=0,nb=2,delay_s=0.4+speed_droop",
    ],
)
def test_an_effect_that_reads_the_speed_is_found_with_filtered_training_too(structure):
    found = identify(parse(structure), [SYSTEMS["arx"].record(3)], FILTERED)
    assert not found.filtered, "what a speed moves can't be filtered before the prediction"
    assert np.isfinite(found.fitted.theta).all()
    assert found.training.samples > 0
