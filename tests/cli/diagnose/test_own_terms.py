"""Where no effect is missing, terms of the signal that is are there to begin with, and the error falls by them."""

from dataclasses import replace

import pytest

from cruise.effects.custom import Custom
from cruise.report.own_terms import own_terms
from cruise.validation.candidates import with_effect
from cruise.validation.unnamed import SPEED
from tests.cli.diagnose.drives import unlisted


def test_the_terms_are_what_add_takes_and_the_error_falls_by_one_of_them(hills):
    found = unlisted(hills)
    gain, load = own_terms(found)
    assert [Custom.written(str(one)) for one in (gain, load)] == [gain, load]
    assert gain.needs == load.needs == ("pitch_deg",)
    search, base = found.study.search, found.study.base
    left = [
        search.fitted(with_effect(base.explanation, one)).mean_square / base.fit.mean_square for one in (gain, load)
    ]
    assert left[1] < left[0] < 0.3, "a slope is a load"
    turned = own_terms(
        replace(found, base=replace(found.base, fit=replace(found.base.fit, error_mps=-found.base.fit.error_mps)))
    )
    assert turned[1].expression == load.expression.removeprefix("-")


def test_a_dependence_on_the_models_own_speed_is_a_gain_of_it(hills):
    (term,) = own_terms(replace(unlisted(hills), signals=(SPEED,)))
    assert term.reads_speed
    assert not term.needs


@pytest.mark.parametrize("signals", [(), ("pump_current_ma",), ("Slope [%]",), ("nobody_recorded_it",)])
def test_what_no_expression_can_name_has_none(hills, signals):
    assert own_terms(replace(unlisted(hills), signals=signals)) == ()
    assert own_terms(hills) == ()


def test_a_signal_with_the_name_of_something_else_has_none(hills):
    found = unlisted(hills)
    scene = found.study.search.scene
    scene_of_p1 = {**scene.signals, "p1": scene.signals["pitch_deg"]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "signals", scene_of_p1)
        assert own_terms(replace(found, signals=("p1",))) == ()
