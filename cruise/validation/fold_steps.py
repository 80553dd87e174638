"""How far the parameters move where a part of the recording is left out.

    minimise over z   1/2 z' (H - H_i) z - (p_i - p_b)' z,    l <= z <= u

z change of the parameters in units of their own scale, within their bounds and no more than one, H = S' S of all
samples with S the derivatives of the errors and H_i of the part that is left out, p_i = S_i' e_i its pull with e the
errors, p_b the pull of all where it holds a parameter on its bound. What a fit that has not ended pulls otherwise is no
news of the part. Where a bound holds one parameter, the others go where they want to be beside it: to cut the step of
all short instead would leave them where no fit has them. Source: J. Nocedal and S. Wright, Numerical Optimization,
2nd ed. 2006, chapter 16; solver: scipy's lsq_linear (Stark and Parker).
"""

from typing import Final

import numpy as np
from scipy.optimize import lsq_linear

from cruise.validation.fitting import Layout

DAMPING: Final = 1e-3  # of the diagonal: directions that nothing excites stay
ON_BOUND: Final = 1e-3  # of a parameter's scale, within which a bound holds it
FLAT: Final = 1e-12  # of the greatest curvature, below which a direction has that


def fold_steps(
    plan: Layout, vector: np.ndarray, slopes: np.ndarray, error_mps: np.ndarray, held: np.ndarray, count: int
) -> list[np.ndarray]:
    """The step (p,) of `vector` for each of `count` parts; `held` (N,) is the part that a sample is of.

    `slopes` (N, p) are in m/s per scale of a parameter, errors (N,) in m/s.
    """
    scale = plan.scale
    low, high = (np.clip((bound - vector) / scale, -1.0, 1.0) for bound in plan.bounds)
    products = np.array([slopes[held == i].T @ slopes[held == i] for i in range(count)])
    pulls = np.array([slopes[held == i].T @ error_mps[held == i] for i in range(count)])
    total = pulls.sum(axis=0)
    kept = np.where(((low > -ON_BOUND) & (total > 0.0)) | ((high < ON_BOUND) & (total < 0.0)), total, 0.0)
    steps = []
    for i in range(count):
        curvature = products.sum(axis=0) - products[i]
        steps.append(scale * _bounded(curvature + DAMPING * np.diag(np.diag(curvature)), pulls[i] - kept, low, high))
    return steps


def _bounded(curvature: np.ndarray, pull: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    strength, ways = np.linalg.eigh(curvature)
    root = np.sqrt(np.maximum(strength, FLAT * strength[-1] + np.finfo(float).tiny))
    return lsq_linear(root[:, None] * ways.T, ways.T @ pull / root, bounds=(low, high), method="bvls").x
