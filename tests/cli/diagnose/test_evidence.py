"""What stands behind a verdict: an effect's curve, the residual before and after, the telling minute, its picture."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from cruise.identification.structures import parse
from cruise.report import diagnosis, diagnosis_picture, evidence
from cruise.report.curve import Curve, curve
from cruise.report.evidence import Number
from cruise.validation.diagnose import Diagnosis
from cruise.validation.numbers import numbers
from cruise.validation.study import study
from cruise.workbench import cards
from tests.cli.diagnose.drives import FLOOR, GAIN, MODEL, PULL, ambiguous, drive, unlisted


def test_the_curve_of_an_effect_is_its_own_code_with_its_uncertainty(hills):
    drawn = curve(hills.study, hills.base, hills.final, "grade")
    assert (drawn.x_name, drawn.x_unit) == ("pitch_deg", "deg")
    load = next(one for one in numbers(hills.study, hills.final) if one.name == "load")
    wanted = -load.value * 9.81 * np.sin(np.radians(drawn.x))
    assert drawn.y == pytest.approx(wanted, abs=1e-9)
    assert drawn.std is not None
    assert drawn.std[-1] == pytest.approx(load.std * 9.81 * np.sin(np.radians(drawn.x[-1])), rel=1e-3)
    delayed = next(one.judged for one in hills.steps[0].tried if one.name == "transport_delay")
    response = curve(hills.study, hills.base, delayed, "transport_delay")
    low, high = np.nanquantile(hills.study.search.scene.current_ma, (0.25, 0.75))
    assert response.y[-1] - response.y[0] == pytest.approx(GAIN * (high - low), rel=0.02)
    reached = np.interp(2.0, response.x, response.y) - response.y[0]
    assert 0.75 < reached / (response.y[-1] - response.y[0]) < 0.95
    assert np.ptp(response.y[response.x < 0.0]) == pytest.approx(0.0, abs=1e-9)


@pytest.fixture
def later(hills) -> Diagnosis:
    """What is found where the slope pulls half as much once all that is missing is there."""
    fit = hills.final.fit
    half = np.where([slot.name == "load" for slot in fit.layout.slots], 0.5, 1.0)
    return replace(hills, final=replace(hills.final, fit=replace(fit, vector=half * fit.vector)))


def test_text_picture_and_page_show_an_effect_as_the_final_model_has_it(later):
    (load,) = (one for one in numbers(later.study, later.final) if one.name == "load")
    grade = evidence.first_tried(later, "grade")
    assert grade is not None
    card = cards.card(later, grade)
    assert card.curve is not None
    assert {one.name: one.value for one in card.numbers}["load"] == diagnosis.figure(load.value)
    wanted = -load.value * 9.81 * np.sin(np.radians(card.curve.x))
    np.testing.assert_allclose(card.curve.y, wanted, atol=1e-9)
    axis = Figure().subplots()
    diagnosis_picture._curve(axis, later, evidence.rungs(later)[0])
    drawn = {line.get_label(): np.asarray(line.get_ydata(), float) for line in axis.get_lines()}
    np.testing.assert_allclose(drawn["with"], wanted, atol=1e-9)


def test_what_the_final_model_does_not_hold_is_shown_as_it_was_tried(hills):
    friction = evidence.first_tried(hills, "coulomb_friction")
    assert friction is not None
    tried = evidence.numbers_of(friction.name, numbers(hills.study, friction.judged))
    assert [one.value for one in cards.card(hills, friction).numbers] == [diagnosis.figure(one.value) for one in tried]
    both = ambiguous(hills)
    assert evidence.fit_of(both, friction.name, friction.judged) is friction.judged


UP = np.linspace(300.0, 700.0, 41)


@pytest.mark.parametrize(("std", "ends"), [(10.0, (236.0, 764.0)), (1e6, (-226.0, 1226.0))])
def test_the_band_of_what_runs_up_and_back_has_an_area_and_leaves_the_curve_to_be_seen(std, ends):
    x = np.concatenate([UP, UP[::-1]])
    drawn = Curve(x, x + np.where(np.arange(82) < 41, -20.0, 20.0), np.full(82, std), x, "current", "mA", "mA", None)
    assert len(drawn.bands) == 2
    for along, low, high in drawn.bands:
        assert abs(np.trapezoid(high - low, along)) == pytest.approx(4.0 * std * 400.0)
    assert drawn.limits == pytest.approx(ends)


def test_the_residual_follows_the_signature_before_and_not_after(hills):
    (one,) = evidence.rungs(hills)
    assert (one.added, one.dropped) == (("grade",), ())
    known = np.isfinite(one.before.error_mps)
    before, after = one.before.error_mps[known], one.after.error_mps[known]
    x = before - after
    for error, slope in ((before, 1.0), (after, 0.0)):
        middles, ten, median, ninety = diagnosis_picture.binned(x, error)
        assert np.polyfit(middles, median, 1)[0] == pytest.approx(slope, abs=0.15)
        assert np.all(ten < median)
        assert np.all(median < ninety)


def test_the_telling_minute_is_that_in_which_the_error_falls_most(hills):
    number, stretch = diagnosis_picture.telling_stretch(hills, hills.final)
    assert (number, stretch.stop - stretch.start) == (0, 300)
    fallen = np.nan_to_num(hills.base.error_mps**2 - hills.final.error_mps**2)
    sums = [fallen[i : i + 300].sum() for i in range(len(fallen) - 299)]
    assert fallen[stretch].sum() == pytest.approx(max(sums))


def test_the_telling_minute_lies_within_one_of_several_recordings(hills):
    two = study([drive(1, PULL), drive(3, PULL, seconds=40.0)], parse(MODEL), None, 0.2)
    second = two.search.scene.parts[1]
    for better, wanted in ((slice(second.start, second.stop), (1, second)), (slice(100, 400), (0, slice(100, 400)))):
        error = two.base.error_mps.copy()
        error[better] *= 0.01
        found = replace(hills, study=two, base=two.base)
        assert diagnosis_picture.telling_stretch(found, replace(two.base, error_mps=error)) == wanted


@pytest.mark.parametrize("which", ["missing", "nothing", "unlisted", "ambiguous"])
def test_every_verdict_has_its_picture(hills, flat, tmp_path, which):
    found = {"missing": hills, "nothing": flat, "unlisted": unlisted(hills), "ambiguous": ambiguous(hills)}[which]
    path = diagnosis_picture.draw(found, FLOOR, tmp_path / "p.png")
    width, height = (int.from_bytes(path.read_bytes()[at : at + 4], "big") for at in (16, 20))
    assert width == 1430
    assert height > (1700 if which == "ambiguous" else 1300)


def number(value: float, std: float = 0.01, low: float = 0.0, high: float = 1.0, neutral: float = 0.5) -> Number:
    return Number("grade", "share", "-", value, std, low, high, neutral, "")


def test_a_number_is_plausible_strictly_between_its_bounds():
    assert [number(value).plausible for value in (0.0, 0.2, 1.0)] == [False, True, False]
    assert number(0.0, neutral=0.0).remark == "no sign of it"
    assert number(0.0, neutral=0.0).plausible
    assert number(0.3, std=0.7).remark == "not told by the data"
    assert number(0.3, std=0.0).remark == "not told by the data"
    assert number(1.0).remark == "at its bound"
    assert number(0.3, std=np.inf, low=-np.inf, high=np.inf).remark == "not told by the data"
    assert number(-0.1, high=np.inf).remark == "implausible"
    assert number(2e-4, low=-1.0, neutral=0.0).remark == "plausible", "a few thousandths per mm are no nothing"
    assert number(0.0, high=np.inf, neutral=0.0).remark == "no sign of it"
    free, pushing = number(-0.1, low=-np.inf, high=np.inf, neutral=np.nan), number(0.0, high=np.inf, neutral=np.nan)
    assert (free.plausible, pushing.plausible) == (True, False)


def test_a_number_whose_error_is_larger_and_much_of_its_range_is_hardly_told():
    assert evidence.remark(number(0.2)) == "plausible"
    assert evidence.remark(number(0.2, std=0.3)) == "hardly told"
    assert evidence.remark(number(0.02, std=0.03)) == "plausible", "it is told to be little"
    assert evidence.remark(number(0.03, std=0.05, high=np.inf)) == "hardly told"
    assert evidence.remark(number(0.2, std=0.7)) == "not told by the data"
    assert evidence.remark(number(1.0, std=2.0, high=1.0)) == "not told by the data"


def test_figures_have_three_digits():
    values = {
        7.66e-17: "0.00",
        0.0068: "0.00680",
        161.2: "161",
        12345.6: "12346",
        np.nan: "-",
        np.inf: "-",
        5.514e-6: "5.51e-06",
    }
    assert [diagnosis.figure(value) for value in values] == list(values.values())
    assert [diagnosis.confidence(value) for value in (0.999, 0.5, 1e-9)] == ["> 0.99", "0.50", "< 0.01"]
