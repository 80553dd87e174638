"""When what one candidate explains is enough to be named, from both sides of every limit."""

from copy import copy
from dataclasses import replace

import pytest

from cruise.validation.tried import (
    ANYHOW,
    BEYOND_DOUBT,
    CARRIED,
    FEW,
    RARE,
    RESISTANCE,
    RESISTS,
    SOME,
    SURE,
    WHOLE,
    Tried,
    asked,
    enough,
    may_be_soil,
    whole,
)


def test_what_few_blocks_hold_needs_more_evidence(grade):
    one, (rare, times) = replace(grade.steps[0].tried[0], gain=0.4, credit=1.0), RARE
    assert enough(replace(one, evidence=1.1 * times * asked(0.4), sureness=1.1 * rare))
    assert not enough(replace(one, evidence=0.9 * times * asked(0.4), sureness=1.1 * rare))
    assert not enough(replace(one, evidence=1e4, sureness=0.9 * rare))


@pytest.mark.parametrize(
    ("name", "share", "sure"), [*((name, RESISTS, SURE) for name in sorted(RESISTANCE)), (*CARRIED, BEYOND_DOUBT)]
)
def test_what_soil_looks_like_needs_evidence_of_its_own_where_it_takes_little(grade, name, share, sure):
    """Friction needs more than others, the load of the engine a share of it, however sure."""
    one = replace(grade.steps[0].tried[0], name=name, gain=0.4, credit=1.0, sureness=sure)
    asks = share * asked(0.4)
    assert may_be_soil(replace(one, evidence=0.9 * asks))
    assert not may_be_soil(replace(one, evidence=1.1 * asks))
    assert not may_be_soil(replace(one, evidence=0.9 * asks, sureness=ANYHOW))
    assert not may_be_soil(replace(one, evidence=0.9 * asks, gain=1.01 * FEW))
    assert not may_be_soil(replace(one, evidence=0.9 * asks, name="grade"))


def test_what_takes_all_that_can_be_explained_is_named_with_little_evidence(grade):
    step = replace(grade.steps[0], background=copy(grade.steps[0].background))
    before, (gain, sure) = step.before, WHOLE
    step.background.noise = 0.5 * before.loss
    one = replace(step.tried[0], gain=1.1 * gain, credit=1.0, evidence=1.1 * SOME, sureness=1.1 * sure)

    def takes(share: float) -> Tried:
        return replace(one, judged=replace(before, raw=(1.0 - 0.5 * share) * before.raw))

    assert not enough(takes(0.95))
    assert whole(takes(0.95), step)
    assert not whole(takes(0.85), step), "soil that looks like friction takes as much"
    for less in ({"gain": 0.9 * gain}, {"evidence": 0.9 * SOME}, {"sureness": 0.9 * sure}):
        assert not whole(replace(takes(0.95), **less), step)


def test_little_evidence_needs_more_standard_errors(grade):
    one = replace(grade.steps[0].tried[0], gain=0.4, credit=1.0)
    assert enough(replace(one, evidence=SOME, sureness=BEYOND_DOUBT))
    assert not enough(replace(one, evidence=0.9 * SOME, sureness=BEYOND_DOUBT))
    assert enough(replace(one, evidence=0.9 * SOME, sureness=ANYHOW))
    assert not enough(replace(one, evidence=-SOME, sureness=ANYHOW))
