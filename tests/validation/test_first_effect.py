"""The first effect that is named: who leads where evidence is scarce, and what a force hides."""

from dataclasses import replace

from cruise.validation import selection
from cruise.validation.selection import FURTHER
from cruise.validation.tried import LOOSE, Tried, asked_alone


def one_of(diagnosis, name: str, loss: float, **said: float) -> Tried:
    """An effect as the first step has tried it, but with this share of the loss left, and what else is said of it."""
    step = diagnosis.steps[0]
    one = next(one for one in step.tried if one.name == name)
    judged = replace(step.before, raw=loss * step.before.raw)
    return replace(one, **{"credit": 1.0, "judged": judged, "compared": judged, **said})


def test_where_nobody_has_evidence_enough_the_one_that_leaves_clearly_less_leads(dead_zone):
    few = one_of(dead_zone, "active_braking", 0.68, evidence=67.0, gain=0.31, sureness=7.0)
    less = one_of(dead_zone, "hysteresis", 0.9 * 0.68 / LOOSE, evidence=12.0, gain=0.42, sureness=12.0)
    assert selection._best([few, less], []) is less
    hardly = one_of(dead_zone, "hysteresis", 1.1 * 0.68 / LOOSE, evidence=12.0, gain=0.42, sureness=12.0)
    assert selection._best([few, hardly], []) is few, "no form is exact enough for that to decide"
    enough = replace(few, evidence=asked_alone(few))
    assert selection._best([enough, less], []) is enough, "evidence goes before the size of the error"
    assert selection._best([few, less], ["grade"]) is few, "beside what was found the rest is of its form"


def test_what_a_force_hides_is_a_first_effect_where_every_force_is_known(dead_zone):
    step = dead_zone.steps[0]
    known = replace(step, forces=step.before)
    hidden = replace(
        one_of(dead_zone, "speed_droop", 1.1, gain=-0.1, evidence=4.0 * FURTHER, sureness=9.0),
        compared=replace(step.before, raw=0.4 * step.before.raw, white=0.4 * step.before.white),
    )
    assert selection._first(hidden, known)
    assert not selection._first(hidden, replace(step, forces=None)), "nothing says what a force hides"
    assert not selection._first(replace(hidden, evidence=0.9 * FURTHER), known)
    assert not selection._first(replace(hidden, compared=step.before), known), "it takes nothing there, either"
    assert not selection._first(replace(hidden, name="grade"), known), "a force is known there"
