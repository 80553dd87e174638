"""The user's own term: an effect like any other, in models, searches and structures."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.effects import Custom, Stage
from cruise.effects.expression import ExpressionError
from cruise.identification.regressors import FitError, checked_signals
from cruise.identification.shapes import fit_shapes
from cruise.identification.structures import parse
from cruise.model import prediction
from cruise.model.model import Model
from cruise.recording import Recording

HEADER = Custom("header", Stage.GAIN, "1 + p1*(header_height_mm - 300)", (("p1", -0.002, 0.002),), p1=1e-3)
DRAG = Custom("drag", Stage.LOAD, "-p2 * speed_mps * abs(speed_mps)", p2=0.5)
BENT = Custom("bent", Stage.COMMAND, "sign(value) * max(abs(value) - 300, 0) * (1 + p1 * abs(value) / 1000)", p1=0.4)


def test_it_is_an_effect_like_any_other():
    assert (HEADER.needs, HEADER.reads_speed, HEADER.acts_as) == (("header_height_mm",), False, Stage.GAIN)
    assert (DRAG.needs, DRAG.reads_speed, DRAG.acts_as) == ((), True, Stage.LOAD)
    assert list(HEADER.parameters) == ["p1"]
    assert (HEADER.parameters["p1"].low, HEADER.parameters["p1"].high) == (-0.002, 0.002)
    assert DRAG.parameters["p2"].neutral == 0.0
    assert all(getattr(HEADER.about, name) for name in ("physics", "equation", "source", "signature", "experiment"))
    assert HEADER.reshaped(p1=0.0) == Custom("header", Stage.GAIN, HEADER.expression, HEADER.bounds)


def test_it_acts_at_its_stage():
    assert HEADER.step(2.0, 0.0, {"header_height_mm": 400.0}, None, 0.2)[0] == pytest.approx(2.2)
    assert DRAG.step(0.0, -2.0, {}, None, 0.2)[0] == pytest.approx(2.0)
    assert BENT.step(-800.0, 0.0, {}, None, 0.2)[0] == pytest.approx(-500 * 1.32)
    assert isinstance(BENT.step(800.0, 0.0, {}, None, 0.2)[0], float)


@pytest.mark.parametrize("term", [HEADER, DRAG, BENT], ids=str)
def test_it_meets_the_contract(term):
    rng = np.random.default_rng(2)
    values, speeds = rng.uniform(-1200, 1200, 30), rng.uniform(-2, 2, 30)
    signals = {"header_height_mm": rng.uniform(0, 900, 30)}
    whole, _ = term.over(values, speeds, signals, 0.2)
    for k in range(30):
        now = {name: float(column[k]) for name, column in signals.items()}
        assert term.step(float(values[k]), float(speeds[k]), now, None, 0.2)[0] == pytest.approx(whole[k], rel=1e-12)
    name = next(iter(term.parameters))
    both = term.reshaped(**{name: np.array([[0.0], [getattr(term, name)]])})
    several = both.step(values, speeds, signals, None, 0.2)[0]
    np.testing.assert_allclose(several[1], whole, rtol=1e-12)
    np.testing.assert_allclose(several[0], term.reshaped(**{name: 0.0}).step(values, speeds, signals, None, 0.2)[0])
    for lacking in term.needs:
        assert math.isnan(term.step(1.0, 0.0, {lacking: math.nan}, None, 0.2)[0])


def test_in_a_model_it_predicts_what_the_formula_says():
    model = Model(0.2, 1, 1, 0, (BENT, HEADER, DRAG), (0.5, 1e-3, 0.1, 0.02))
    assert model.needs == ("header_height_mm",)
    assert model.reads_speed
    now = {"header_height_mm": 500.0}
    state = model.apply(model.start(1.0, 800.0, now), 800.0, now)
    expected = 0.5 * 1.0 + 1e-3 * 1.2 * 500 * 1.32 - 0.1 * 0.5 + 0.02
    assert model.next_speed(state) == pytest.approx(expected)


@given(current_ma=st.floats(-1500, 1500))
def test_a_rising_characteristic_is_inverted(current_ma):
    drive_ma, _ = BENT.step(current_ma, 0.0, {}, None, 0.2)
    inverse = BENT.inverse(drive_ma, {}, None)
    assert not inverse.refused
    assert inverse.low - 1e-6 <= current_ma <= inverse.high + 1e-6
    assert BENT.step(inverse.nearest(current_ma), 0.0, {}, None, 0.2)[0] == pytest.approx(drive_ma, abs=1e-6)


def test_a_plateau_leaves_a_choice_and_so_does_the_stop():
    stop = Custom("stop", Stage.COMMAND, "clip(value, -900, 900)")
    dead, top, foot = BENT.inverse(0.0, {}, None), stop.inverse(900.0, {}, None), stop.inverse(-900.0, {}, None)
    assert (dead.low, dead.high) == pytest.approx((-300.0, 300.0), abs=1e-6)
    assert (top.low, top.high) == pytest.approx((900.0, 2000.0), abs=1e-6)
    assert (foot.low, foot.high) == pytest.approx((-2000.0, -900.0), abs=1e-6)


@pytest.mark.parametrize(
    ("term", "wanted_ma", "reason"),
    [
        (Custom("hill", Stage.COMMAND, "value * (1000 - abs(value))"), 10.0, "does not rise with the current"),
        (Custom("upside", Stage.COMMAND, "-value"), 10.0, "does not rise with the current"),
        (Custom("drooping", Stage.COMMAND, "value - 10 * speed_mps"), 10.0, "reads the speed"),
        (Custom("stop", Stage.COMMAND, "clip(value, -900, 900)"), 901.0, "no current up to 2000 mA gives 901 mA"),
        (Custom("root", Stage.COMMAND, "sqrt(value)"), 10.0, "does not rise with the current"),
        (HEADER, 1.0, "does not act on the current"),
    ],
    ids=str,
)
def test_where_there_is_no_inverse_the_reason_is_said(term, wanted_ma, reason):
    inverse = term.inverse(wanted_ma, {"header_height_mm": 300.0}, None)
    assert reason in inverse.refused
    assert math.isnan(inverse.nearest(0.0))


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        (("Header", Stage.GAIN, "1"), "name 'Header': use small letters"),
        (("a-b", Stage.GAIN, "1"), "name 'a-b'"),
        (("a", Stage.SENSOR, "1"), "stage sensor: .* command, gain, load"),
        (("a", Stage.GAIN, "1 + value"), "known to command terms only; this one is a gain term"),
        (("a", Stage.COMMAND, "2 * p1"), "a command term reshapes value"),
        (("a", Stage.LOAD, "ground_speed_mps"), "ground_speed_mps is what is predicted: write speed_mps"),
        (("a", Stage.GAIN, "1 + p1 * ground_speed_mps"), "write speed_mps"),
        (("a", Stage.COMMAND, "value + p1 * ground_speed_mps"), "write speed_mps"),
        (("a", Stage.LOAD, "p0 * pitch_deg"), "p0 is no parameter: they are p1 to p9"),
        (("a", Stage.LOAD, "p12 * pitch_deg"), "p12 is no parameter"),
        (("a", Stage.LOAD, "sinus(pitch_deg)"), r"column 1: no function sinus; did you mean sin\?"),
        (("a", Stage.GAIN, "1 + p1", (("p2", -1.0, 1.0),)), "bounds of p2, which is no parameter in '1 \\+ p1'"),
        (("a", Stage.GAIN, "1 + p1", (("p1", 0.5, 1.0),)), "bounds of p1: 0.5 to 1 must hold 0"),
    ],
)
def test_a_term_that_can_not_be_is_refused(fields, complaint):
    with pytest.raises(ExpressionError, match=complaint):
        Custom(*fields)


def test_a_structure_can_have_it_written_out():
    text = "arx:na=1,nb=2,delay_s=0.2+dead_zone+custom(header, gain, 1 + p1*(header_height_mm - 300))+grade"
    structure = parse(text)
    assert structure.effects == ("dead_zone", "header", "grade")
    assert parse(str(structure)) == structure
    model = structure.model(0.2)
    assert [effect.name for effect in model.effects] == ["dead_zone", "header", "grade"]
    assert model.needs == ("header_height_mm", "pitch_deg")
    assert len(parse("arx10B+custom(mud, load, -pitch_deg)").model(0.2).load_effects) == 1


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("arx10B+custom(header, gain)", "write custom"),
        ("arx10B+custom", "write custom"),
        ("arx10B+custom(header, gian, 1 + p1)", "stage gian"),
        ("arx10B+custom(header, gain, 1 + sine(gear))", "column 5: no function sine"),
        ("arx10B+custom(grade, load, -pitch_deg)", "grade is an effect already"),
        ("arx10B+custom(a, load, -pitch_deg)+custom(a, load, -gear)", "once"),
    ],
)
def test_a_structure_with_a_mistake_in_it_is_refused(text, complaint):
    with pytest.raises(FitError, match=complaint):
        parse(text)


def driven(count=900):
    rng = np.random.default_rng(8)
    columns = {
        "pump_current_ma": np.repeat(rng.uniform(300, 900, count // 10), 10),
        "header_height_mm": 300 + 250 * np.sin(np.arange(count) / 37.0),
        "ground_speed_mps": np.zeros(count),
    }
    model = Model(0.2, 1, 1, 1, (HEADER,), (0.6, 8e-4, 0.0))
    signals = {"header_height_mm": columns["header_height_mm"]}
    columns["ground_speed_mps"][:2] = 0.5
    run = prediction.free_run(model, columns["pump_current_ma"], columns["ground_speed_mps"], signals)
    columns["ground_speed_mps"] = np.where(np.isnan(run), 0.5, run) + 0.01 * rng.standard_normal(count)
    return Recording(0.2 * np.arange(count), columns, 0.2, "test")


def test_its_parameter_is_found_in_a_recording():
    start = Model(0.2, 1, 1, 1, (HEADER.reshaped(p1=0.0),), (0.0, 0.0, 0.0))
    found = fit_shapes(start, [driven()], [("header", "p1")])
    header = found.effects[0]
    assert isinstance(header, Custom)
    assert header.p1 == pytest.approx(1e-3, rel=0.05)


def test_a_misspelt_signal_is_named_with_what_was_meant():
    term = Custom("header", Stage.GAIN, "1 + p1*header_heigth_mm")
    model = Model(0.2, 1, 1, 1, (term,), (0.0, 0.0, 0.0))
    with pytest.raises(FitError, match=r"header_heigth_mm.*did you mean header_height_mm\?"):
        checked_signals(model, driven(60))


def test_a_term_that_was_evaluated_goes_to_another_process():
    term = HEADER.reshaped(p1=0.5)
    signals = {"header_height_mm": 400.0}
    before = term.step(1.0, 0.0, signals, None, 0.2)
    assert term.needs == ("header_height_mm",)
    carried = pickle.loads(pickle.dumps(term))
    assert carried == term
    assert carried.step(1.0, 0.0, signals, None, 0.2) == before
