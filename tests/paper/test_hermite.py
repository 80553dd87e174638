"""The NARX models of the paper: known systems are recovered; polynomials are taken before the current is slowed."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.identification.structures import parse
from cruise.paper.hermite import Hermite, fit_hermite
from cruise.paper.tables import variation_explained_pct
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

STRUCTURE = parse("narx:na=2,nb=3,degree=2,delay_s=0.1")
THETA = (1.2, -0.4, 0.02, 0.05, -0.01, 0.01, -0.03, 0.02, 0.3)  # poles at 0.6 +- 0.2j
HORIZON = 60


def recording(seed: int, seconds: float = 200.0) -> Recording:
    """What the known system makes of white current."""
    rng = np.random.default_rng(seed)
    current = rng.uniform(300.0, 900.0, round(20.0 * seconds))
    z = (current - 600.0) / 250.0
    first, second = 2.0 * z, 4.0 * z**2 - 2.0
    speed = np.zeros(len(current))
    for k in range(4, len(current)):
        drives = (first[k - 2], first[k - 3], first[k - 4], second[k - 2], second[k - 3], second[k - 4], 1.0)
        speed[k] = np.dot(THETA, (speed[k - 1], speed[k - 2], *drives))
    return Recording(
        0.05 * np.arange(len(current)), {"pump_current_ma": current, "ground_speed_mps": speed}, 0.05, "made"
    )


def as_it_is(one: Recording) -> Recording:
    return one


def test_a_known_system_is_recovered_whatever_the_scale_of_its_polynomials():
    fitted = fit_hermite(STRUCTURE, recording(1), as_it_is, 0.05, HORIZON)
    assert fitted.theta[:2] == pytest.approx(THETA[:2], abs=1e-6)
    assert not fitted.unstable
    unseen = recording(2)
    said = fitted.ahead(fitted.drives(unseen, as_it_is), unseen.output, HORIZON)
    assert np.all(np.isfinite(said[HORIZON + 10 :]))
    assert variation_explained_pct(unseen, said) == pytest.approx(100.0, abs=1e-3)


def test_equal_polynomials_have_equal_parameters():
    known = Hermite(STRUCTURE, 0.05, 600.0, 250.0)
    made = recording(1)
    columns = known.columns(known.drives(made, as_it_is), made.output)
    assert columns.shape == (len(made), len(THETA) - 1)
    said = columns @ np.array(THETA[:-1]) + THETA[-1]
    assert said[10:] == pytest.approx(made.output[10:], abs=1e-9)


def test_polynomials_are_of_the_current_as_applied_and_slowed_after_that():
    def levelled(one: Recording) -> Recording:
        return replace(one, columns={**one.columns, INPUT: np.full(len(one), one.input.mean())})

    model = Hermite(STRUCTURE, 0.05, 600.0, 250.0)
    made = recording(1)
    z = (made.input - 600.0) / 250.0
    _, second = model.drives(made, levelled)
    assert second[0] == pytest.approx(np.mean(4.0 * z**2 - 2.0))


def test_a_penalty_is_chosen_where_there_is_nothing_to_learn_and_none_where_there_is():
    made = recording(3, seconds=30.0)
    unrelated = np.random.default_rng(4).standard_normal(len(made))
    blind = replace(made, columns={**made.columns, OUTPUT: unrelated})
    assert fit_hermite(STRUCTURE, blind, as_it_is, 0.05, HORIZON).gamma >= 0.1
    assert fit_hermite(STRUCTURE, made, as_it_is, 0.05, HORIZON).gamma <= 1e-8


def test_a_predictor_that_runs_away_is_called_unstable():
    known = Hermite(STRUCTURE, 0.05, 600.0, 250.0, (1.2, -0.1, *THETA[2:]))
    assert "pole" in known.unstable
