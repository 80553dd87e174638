"""Known systems come back within their standard errors; `tools/bench recovery` shows 200 seeds of the same."""

import numpy as np
import pytest

from tools.benchmarks.recovery import SYSTEMS, recovered

SEEDS = range(60)  # a standard deviation from 60 seeds is known to 9 %


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_truth_lies_within_three_honest_standard_errors(name):
    found = recovered(SYSTEMS[name], SEEDS)
    assert found.within >= 0.95
    assert found.ratios.min() > 0.75
    assert found.ratios.max() < 1.35
    assert found.converged == 1.0
    assert np.abs(found.bias).max() < 4.5  # a bias of half a standard error
