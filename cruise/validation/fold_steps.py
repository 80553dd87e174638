"""How far the parameters move where a part of the recording is left out.

    (H - H_i) z = p_i,    z of what a bound holds 0,    |z| <= 1

z change of the parameters in units of their own scale, H = S' S of all samples with S the derivatives of the errors and
H_i of the part that is left out, p_i = S_i' e_i its pull with e the errors. What the full fit has left of its own pull
is no news of the part. A parameter that the pull of all holds on its bound stays there, and the others go where they
want to be beside it: with it in the equations they would make room for what it can't do, and no such step errs less.
Source: L. Ljung, System Identification, 2nd ed. 1999, section 10.2 (one step of Gauss and Newton).
"""

from typing import Final

import numpy as np

from cruise.validation.fitting import Layout

DAMPING: Final = 1e-3  # of the diagonal: directions that nothing excites stay
ON_BOUND: Final = 1e-3  # of a parameter's scale, within which a bound holds it


def fold_steps(
    plan: Layout, vector: np.ndarray, slopes: np.ndarray, error_mps: np.ndarray, held: np.ndarray, count: int
) -> list[np.ndarray]:
    """The step (p,) of `vector` for each of `count` parts; `held` (N,) is the part that a sample is of.

    `slopes` (N, p) are in m/s per scale of a parameter, errors (N,) in m/s.
    """
    scale = plan.scale
    low, high = plan.bounds
    products = np.array([slopes[held == i].T @ slopes[held == i] for i in range(count)])
    pulls = np.array([slopes[held == i].T @ error_mps[held == i] for i in range(count)])
    total = pulls.sum(axis=0)
    below, above = (vector - low) / scale < ON_BOUND, (high - vector) / scale < ON_BOUND
    free = ~((below & (total > 0.0)) | (above & (total < 0.0)))
    steps = []
    for i in range(count):
        curvature = (products.sum(axis=0) - products[i])[np.ix_(free, free)]
        damped = curvature + np.diag(DAMPING * np.diag(curvature) + 1e-12 * np.trace(curvature) + 1e-30)
        step = np.zeros(len(vector))
        step[free] = np.clip(np.linalg.solve(damped, pulls[i][free]), -1.0, 1.0)
        steps.append(scale * step)
    return steps
