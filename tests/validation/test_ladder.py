"""The ladder: an effect is fitted jointly with all that is there, judged on what no fit has seen, or refused."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import Custom, Stage
from cruise.identification.regressors import FitError
from cruise.identification.structures import parse
from cruise.model import files
from cruise.model.files import Provenance
from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation import ladder
from cruise.validation.numbers import NOT_TOLD, PLAUSIBLE, numbers
from tests.validation.machine import GAIN, record

STRUCTURE = "arx:na=1,nb=3,delay_s=0.4"
LOSS = 0.002  # m/s per mm of header_height, in the recordings that have it


@pytest.fixture(scope="module")
def hills():
    return [record(seed=1, seconds=240.0, noise_mps=0.01, grade_mps_per_deg=0.03)]


@pytest.fixture(scope="module")
def header(hills):
    """The same drive without its hills and with a loss that only a term of one's own describes."""
    drive = record(seed=1, seconds=240.0, noise_mps=0.01)
    speed = drive.output - LOSS * (drive.columns["header_height"] - 300.0)
    return [Recording(drive.time_s, {**drive.columns, OUTPUT: speed}, drive.dt_s, "header.csv")]


@pytest.fixture(scope="module")
def study(hills):
    return ladder.begin(hills, parse(STRUCTURE), None, None, 0.2)


@pytest.fixture(scope="module")
def graded(study):
    return ladder.add(study, "grade")


def test_the_error_falls_to_the_noise_with_the_right_effect(study, graded, hills):
    assert graded.error_before_mps > 2.5 * graded.error_after_mps
    error_mps = study.search.scene.speed_mps - graded.predicted_mps
    assert graded.error_after_mps == pytest.approx(np.sqrt(np.nanmean(error_mps**2)), rel=1e-6)
    assert graded.error_after_mps > np.sqrt(graded.after.fit.mean_square), "seen, it errs less"
    floor = ladder.floor(study, hills, graded)
    assert floor.white is not None
    assert floor.white.value_mps < graded.error_after_mps < graded.error_before_mps
    assert graded.samples == np.isfinite(graded.predicted_mps).sum()


def test_a_wrong_effect_brings_little(study, graded):
    wrong = ladder.add(study, "coulomb_friction")
    assert wrong.error_after_mps > 2.0 * graded.error_after_mps


def test_the_parameters_are_physical_and_say_where_they_were(study, graded):
    found = {one.name: one for one in ladder.parameters(study, graded)}
    gain, pull = found["gain_mps_per_ma"], found["grade.load"]
    assert gain.after == pytest.approx(GAIN, abs=3.0 * gain.std)
    assert gain.after == pytest.approx(GAIN, rel=0.01)
    assert gain.before is not None
    assert abs(gain.before - GAIN) > abs(gain.after - GAIN)
    assert pull.before is None
    assert pull.after == pytest.approx(0.03 / (9.81 * np.radians(1.0)), rel=0.1)  # no less mass matters in this machine
    assert all(one.std >= 0.0 for one in found.values())
    assert {one.remark for one in (gain, pull)} == {PLAUSIBLE}


def test_a_product_of_which_only_the_whole_is_told_says_so_of_both_factors(study):
    added = ladder.add(study, Custom("slope", Stage.LOAD, "p1 * pitch_deg"))
    found = {one.name: one for one in ladder.parameters(study, added)}
    for factor in (found["slope.load"], found["slope.p1"]):
        assert (factor.std, factor.remark) == (np.inf, NOT_TOLD)
    assert 0.0 < found["gain_mps_per_ma"].std < 0.1 * found["gain_mps_per_ma"].after
    assert all(np.isfinite(added.model.theta_std))


def test_numbers_that_are_hardly_told_are_said_to_be(study, graded):
    """Beside a width of next to nothing no one can say how much of it is friction."""
    added = ladder.add(study, "hysteresis")
    found = {one.name: one for one in ladder.parameters(study, added)}
    width, share = found["hysteresis.width_ma"], found["hysteresis.share"]
    assert width.after < 2.0
    assert share.remark == NOT_TOLD
    assert [one.remark for one in ladder.parameters(study, graded)] == [
        one.remark for one in numbers(study, graded.after)
    ]


def test_what_is_written_is_the_model_that_was_judged(tmp_path, graded):
    core = ladder.physical(graded.after.explanation)
    file = files.file_of("m.yaml", graded.model, Provenance(), core=core)
    assert files.model_of("m.yaml", file) == graded.model
    assert (core.loads_mps["grade"], core.effects) == (graded.after.explanation.loads[0], ())


@pytest.mark.parametrize("effect", ["resonance", "transport_delay"])
def test_an_effect_of_the_core_stays_when_the_model_is_taken_up_again(study, hills, effect):
    added = ladder.add(study, effect)
    core = ladder.physical(added.after.explanation)
    assert core.effects == (effect,)
    assert (core.resonance_share != 0.0) is (effect == "resonance")
    delay_s = added.model.delay * 0.2
    structure = replace(parse(STRUCTURE), nb=added.model.nb, delay_s=delay_s)
    again = ladder.begin(hills, structure, added.model, core, 0.2)
    assert again.base.explanation.names == (effect,)
    with pytest.raises(FitError, match=f"the model has {effect} already"):
        ladder.add(again, effect)


def test_every_effect_is_refitted_when_the_next_one_comes(hills, graded):
    structure = replace(parse(STRUCTURE), effects=("grade",))
    again = ladder.begin(hills, structure, graded.model, ladder.physical(graded.after.explanation), 0.2)
    both = ladder.add(again, "quadratic_gain")
    assert both.before.explanation.names == ("grade",)
    assert set(both.after.explanation.names) == {"grade", "quadratic_gain"}
    assert both.error_before_mps == pytest.approx(graded.error_after_mps, rel=0.05)
    assert both.error_after_mps < 1.1 * both.error_before_mps


def test_refusals_say_what_is_in_the_way(study, hills):
    for effect, complaint in (
        ("oil_temperature", "oil_temperature can't be added: oil_temperature_c is not recorded"),
        ("gear_ratio", "gear_ratio can't be added: gear is not recorded"),
        (Custom("mud", Stage.LOAD, "p1 * moisture"), "mud can't be added: moisture is not recorded"),
        (
            Custom("bent", Stage.COMMAND, "value * (1 + p1 * speed_mps)"),
            "bent: a command term .* nothing but the current",
        ),
        (Custom("root", Stage.GAIN, "1 + p1 * log(pitch_deg - 90)"), "root is not a number in every sample"),
    ):
        with pytest.raises(FitError, match=complaint):
            ladder.add(study, effect)
    still = Recording(
        hills[0].time_s, {**hills[0].columns, "pitch_deg": 0.0 * hills[0].time_s}, hills[0].dt_s, "level.csv"
    )
    level = ladder.begin([still], parse(STRUCTURE), None, None, 0.2)
    with pytest.raises(FitError, match="grade can't be added: pitch_deg never moves"):
        ladder.add(level, "grade")
    with pytest.raises(FitError, match="lift can't be added: pitch_deg never moves"):
        ladder.add(level, Custom("lift", Stage.LOAD, "-pitch_deg"))


@pytest.mark.parametrize(
    "term",
    [
        Custom("lift", Stage.LOAD, "300 - header_height"),
        Custom("lift", Stage.LOAD, "p1 * (header_height - 300)"),
        Custom("lift", Stage.LOAD, "p1 * (header_height - 300)", (("p1", -100.0, 100.0),)),
    ],
)
def test_a_term_of_ones_own_is_fitted_like_any_other(header, term):
    study = ladder.begin(header, parse(STRUCTURE), None, None, 0.2)
    added = ladder.add(study, term)
    assert added.error_after_mps < 0.2 * added.error_before_mps
    (fitted,) = added.after.explanation.effects
    assert isinstance(fitted, Custom)
    slope = added.after.explanation.loads[0] * (fitted.p1 if fitted.parameters else -1.0)
    assert slope == pytest.approx(-LOSS, rel=0.05)


def test_a_term_that_scales_the_drive_and_reads_the_speed_is_fitted_too(hills):
    drive = hills[0]
    study = ladder.begin([drive], parse(STRUCTURE), None, None, 0.2)
    added = ladder.add(study, Custom("slope", Stage.GAIN, "1 + p1 * pitch_deg + p2 * speed_mps"))
    (fitted,) = added.after.explanation.effects
    assert isinstance(fitted, Custom)
    assert added.error_after_mps < 0.7 * added.error_before_mps
    assert fitted.p1 < 0.0


def test_a_term_that_reshapes_the_current_is_fitted_too():
    bent = [record(seed=1, seconds=240.0, noise_mps=0.01, curvature=0.3)]
    study = ladder.begin(bent, parse(STRUCTURE), None, None, 0.2)
    added = ladder.add(study, Custom("bent", Stage.COMMAND, "value * (1 + p1 * value / 1000)"))
    (fitted,) = added.after.explanation.effects
    assert isinstance(fitted, Custom)
    assert fitted.p1 == pytest.approx(0.3 / 0.6 / 0.7, rel=0.05)  # 1 + 0.3 (u - 600) / 600, in units of its value at 0


def test_terms_of_a_structure_are_there_from_the_start(header):
    text = f"{STRUCTURE}+custom(lift, load, 300 - header_height)"
    study = ladder.begin(header, parse(text), None, None, 0.2)
    assert study.base.explanation.names == ("lift",)
    assert study.base.explanation.loads[0] == pytest.approx(LOSS, rel=0.05)
    added = ladder.add(study, "quadratic_gain")
    again = ladder.begin(header, parse(f"{text}+quadratic_gain"), added.model, None, 0.2)
    assert set(again.base.explanation.names) == {"quadratic_gain", "lift"}


def test_both_errors_are_of_the_same_samples(hills):
    """Where the effect's own signal has a hole there is no prediction with it, and none without it counts."""
    drive = hills[0]
    pitch = drive.columns["pitch_deg"].copy()
    pitch[2000:2600] = np.nan
    holed = [Recording(drive.time_s, {**drive.columns, "pitch_deg": pitch}, drive.dt_s, "hole.csv")]
    study = ladder.begin(holed, parse(STRUCTURE), None, None, 0.2, wanted="grade")
    added = ladder.add(study, "grade")
    whole = np.isfinite(added.predicted_mps)
    assert added.samples == whole.sum() < 0.9 * len(whole)
    assert np.array_equal(np.isfinite(study.base.error_mps), np.isfinite(added.after.error_mps))
