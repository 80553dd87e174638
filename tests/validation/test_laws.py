"""A law of one signal is refuted where any law of another leaves clearly less."""

from dataclasses import replace

import pytest

from cruise.signals import INPUT
from cruise.validation.candidates import UNNAMED
from cruise.validation.laws import law_of, ruled_out
from cruise.validation.tried import LOOSE, Tried
from cruise.validation.unnamed import SPEED


@pytest.mark.parametrize(
    ("name", "signal"),
    [
        ("quadratic_gain", INPUT),
        ("saturation", INPUT),
        ("speed_droop", SPEED),
        ("coulomb_friction", SPEED),
        ("rate_limit", ""),
        ("hysteresis", ""),
        ("grade", ""),
        ("resonance", ""),
    ],
)
def test_a_law_of_one_signal_is_static_and_reads_nothing_else(name, signal):
    assert law_of(name) == signal


def test_a_law_of_the_current_is_refuted_where_any_law_of_the_speed_leaves_clearly_less(grade):
    one = next(one for one in grade.steps[0].tried if one.name == "quadratic_gain")

    def left(name: str, share: float) -> Tried:
        judged = replace(one.judged, raw=share * one.judged.raw, white=share * one.judged.white)
        return replace(one, name=name, judged=judged)

    def no_law(of_current: float, of_speed: float, quadratic: float = 9.0, by: str = "speed_droop") -> bool:
        tried = [left(f"{UNNAMED}{INPUT}", of_current), left(f"{UNNAMED}{SPEED}", of_speed)]
        return ruled_out("quadratic_gain", by, [*tried, left("quadratic_gain", quadratic)])

    assert no_law(1.01 * LOOSE, 1.0)
    assert not no_law(0.99 * LOOSE, 1.0)
    assert not no_law(2.0 * LOOSE, 1.0, quadratic=0.99 * LOOSE), "the curve is no limit where the effect leaves less"
    assert not no_law(2.0 * LOOSE, 1.0, by="saturation"), "that is a law of the current, too"
    assert not no_law(2.0 * LOOSE, 1.0, by="grade")
    assert not ruled_out("quadratic_gain", "speed_droop", [left(f"{UNNAMED}{INPUT}", 9.0)]), "nothing says so"
