"""General methods on the samples on which a missing effect is searched: SysIdentPy, PySINDy, gradient boosting.

    y_k = sum_t c_t z_i(t),k z_j(t),k ,   z_k = (y_(k-1) .. y_(k-p), u_k .. u_(k-q), s_k, 1)

y speed in m/s, u current in mA, s the measured signals, every column standardised, p and q the orders. FROLS takes the
terms one by one by their error reduction ratio, SINDy (discrete time) all of them and drops small ones again and again.
Both are fitted one step ahead and then run HORIZON steps on their own speeds. Boosting learns what the base model's
prediction leaves, HORIZON steps ahead at once, from that prediction, the current on the way, the signals, and speed and
error at the start.

Each is given a choice of orders: what errs least on every fourth minute, left out of the fit, is fitted again to all.
Currents and signals on the way are the measured ones, for everyone. A row of NaN separates what does not belong
together. Sources: S. Chen, S. A. Billings, W. Luo, Int. J. Control 50 (1989) 1873 (FROLS); S. L. Brunton, J. L.
Proctor, J. N. Kutz, PNAS 113 (2016) 3932 (SINDy); G. Ke et al., NeurIPS 2017 (boosting on histograms).
"""

import pickle
import subprocess
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from .peers import HOME, ROOT, made

HORIZON: Final = 15  # samples of 0.2 s: 3 s
ORDERS: Final = ((1, 8), (2, 8), (1, 12))  # p and q; q = 4, 1 s, was tried and was always worse
TERMS: Final = (10, 20, 40)  # that FROLS takes
THRESHOLDS: Final = (0.05, 0.1, 0.2, 0.4)  # below which SINDy drops a coefficient, of columns of length 1
RIDGE: Final = 1e-6  # of SINDy, whose default of 0.05 would bias lags that are nearly alike
LEAVES: Final = (6, 20)
TREES: Final = 150
LAGS: Final = (*range(1, 13), 15, 20)  # samples, at which boosting is shown the current
BLOCK: Final = 300  # samples, a minute
HELD_OF: Final = 4  # blocks, of which the last is held out to choose by
RAN_AWAY_MPS: Final = 10.0  # m/s, three times what the machine does: where a prediction that runs away is stopped


@dataclass(frozen=True, eq=False)
class Samples:
    """What everyone is given: `signals` (m, N), the others (N,), NaN where there is nothing."""

    current_ma: np.ndarray
    speed_mps: np.ndarray
    signals: np.ndarray
    base_mps: np.ndarray  # the prediction of the base model, HORIZON samples ahead

    def __len__(self) -> int:
        return len(self.speed_mps)


@dataclass(frozen=True, eq=False)
class Answer:
    """A method's predictions (N,) in m/s for the test, and the orders that it took."""

    predicted_mps: np.ndarray
    chosen: str


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A model of degree 2: `pairs` (t, 2) are the columns of z in each term, the last one is 1."""

    past: int
    lags: int
    mean: np.ndarray
    std: np.ndarray
    pairs: np.ndarray
    coefficients: np.ndarray

    def step(self, columns: np.ndarray) -> np.ndarray:
        """The next speed (n,) from columns (n, m)."""
        z = np.column_stack([(columns - self.mean) / self.std, np.ones(len(columns))])
        speed_mps = (z[:, self.pairs[:, 0]] * z[:, self.pairs[:, 1]]) @ self.coefficients
        return np.clip(speed_mps, -RAN_AWAY_MPS, RAN_AWAY_MPS)

    def ahead(self, samples: Samples) -> np.ndarray:
        """The speed (N,) at every sample as predicted HORIZON samples before; NaN where there was no start."""
        driven, past = _driven(samples, self.lags), [_lagged(samples.speed_mps, HORIZON + i) for i in range(self.past)]
        for step in range(HORIZON - 1, -1, -1):
            on_the_way = _lagged(driven, step)
            past = [self.step(np.column_stack([*past, on_the_way])), *past[:-1]]
        return past[0]


def frols(columns: np.ndarray, target: np.ndarray, terms: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of columns and coefficients that SysIdentPy's FROLS finds; lags are columns here, so that it needs none."""
    model = import_module("sysidentpy.model_structure_selection").FROLS(
        order_selection=False,
        n_terms=terms,
        ylag=1,
        xlag=[[1]] * columns.shape[1],
        basis_function=import_module("sysidentpy.basis_function").Polynomial(degree=2),
        estimator=import_module("sysidentpy.parameter_estimation").LeastSquares(),
        model_type="NFIR",
    )
    # It regresses y_k on x_(k-1).
    model.fit(X=np.vstack([columns, columns[-1:]]), y=np.concatenate([[0.0], target])[:, None])
    inputs = np.asarray(model.final_model) // 1000 - 2  # 2001 is the first input, one sample before; 0 is none
    return np.where(inputs < 0, columns.shape[1], inputs), np.ravel(model.theta)


def sindy(columns: np.ndarray, target: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray]:
    """The same by PySINDy's discrete SINDy: the first column is the state, the others are controls."""
    pysindy = import_module("pysindy")
    model = pysindy.DiscreteSINDy(
        optimizer=pysindy.STLSQ(threshold=threshold, alpha=RIDGE, normalize_columns=True),
        feature_library=pysindy.PolynomialLibrary(degree=2),
    )
    model.fit(columns[:, :1], t=1, x_next=target[:, None], u=columns[:, 1:])
    coefficients = np.ravel(model.coefficients())
    pairs = [
        [*np.repeat(np.arange(columns.shape[1]), powers), columns.shape[1], columns.shape[1]][:2]
        for powers in model.feature_library.powers_
    ]
    kept = coefficients != 0.0
    return np.array(pairs)[kept], coefficients[kept]


Fit = Callable[[np.ndarray, np.ndarray, Any], tuple[np.ndarray, np.ndarray]]
POLYNOMIALS: Final[dict[str, tuple[Fit, Sequence[float], str]]] = {
    "frols": (frols, TERMS, "terms"),
    "sindy": (sindy, THRESHOLDS, "threshold"),
}


def polynomial(fit: Fit, sizes: Sequence[float], word: str, train: Samples, test: Samples) -> Answer:
    """One of POLYNOMIALS with the orders and the size that err least where the fit was not."""
    held = _held(train)

    def fitted(past: int, lags: int, size: float, shown: np.ndarray) -> Polynomial:
        speeds = [_lagged(train.speed_mps, i) for i in range(1, past + 1)]
        columns = np.column_stack([*speeds, _driven(train, lags)])
        rows = shown & np.isfinite(columns).all(axis=1) & np.isfinite(train.speed_mps)
        mean, std = columns[rows].mean(axis=0), columns[rows].std(axis=0)
        std = np.where(std > 0.0, std, 1.0)
        pairs, coefficients = fit((columns[rows] - mean) / std, train.speed_mps[rows], size)
        return Polynomial(past, lags, mean, std, pairs, coefficients)

    def error_mps(option: tuple[tuple[int, int], float]) -> float:
        orders, size = option
        return _rms(train.speed_mps - fitted(*orders, size, ~held).ahead(train), held)

    (past, lags), size = min(product(ORDERS, sizes), key=error_mps)
    model = fitted(past, lags, size, np.ones(len(train), dtype=bool))
    return Answer(model.ahead(test), f"p {past}, q {lags}, {word} {size:g}")


def boosting(train: Samples, test: Samples) -> Answer:
    """Gradient boosting of the base model's residual, as many trees and leaves as err least where the fit was not."""
    ensemble = import_module("sklearn.ensemble")
    shown, residual, held = _shown(train), train.speed_mps - train.base_mps, _held(train)
    rows = np.isfinite(shown).all(axis=1) & np.isfinite(residual)

    def fitted(leaves: int, trees: int, where: np.ndarray):
        model = ensemble.HistGradientBoostingRegressor(
            max_iter=trees, max_leaf_nodes=leaves, l2_regularization=1.0, early_stopping=False, random_state=0
        )
        return model.fit(shown[where], residual[where])

    best = (np.inf, 0, 0)
    for leaves in LEAVES:
        stages = fitted(leaves, TREES, rows & ~held).staged_predict(shown[rows & held])
        errors = [float(np.mean((residual[rows & held] - stage) ** 2)) for stage in stages]
        best = min(best, (min(errors), leaves, int(np.argmin(errors)) + 1))
    _, leaves, trees = best
    return Answer(
        test.base_mps + fitted(leaves, trees, rows).predict(_shown(test)), f"{trees} trees of {leaves} leaves"
    )


def ask(cases: Sequence[tuple[Samples, Samples]]) -> list[dict[str, Answer]] | str:
    """The answers of POLYNOMIALS to each case (train, test), or why there are none."""
    reason = made()
    if reason:
        return f"SysIdentPy and PySINDy are not installed: {reason}"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cases"
        path.write_bytes(pickle.dumps(cases))
        call = f"from {__name__} import serve; serve({str(path)!r})"
        ended = subprocess.run([HOME / "bin" / "python", "-c", call], cwd=ROOT, capture_output=True, check=False)
        if ended.returncode:
            raise RuntimeError(f"the peers ended with code {ended.returncode}: {ended.stderr.decode()[-2000:]}")
        return pickle.loads(path.read_bytes())


def serve(path: str) -> None:
    """Answer the cases of a file, in its place; runs in the peers' environment."""
    warnings.simplefilter("ignore")
    cases: list[tuple[Samples, Samples]] = pickle.loads(Path(path).read_bytes())
    answers = [{name: polynomial(*peer, *case) for name, peer in POLYNOMIALS.items()} for case in cases]
    Path(path).write_bytes(pickle.dumps(answers))


def _lagged(values: np.ndarray, lag: int) -> np.ndarray:
    """`values` (N,) or (N, m), so many samples later; NaN at first."""
    result = np.full(values.shape, np.nan)
    result[lag:] = values[: len(values) - lag]
    return result


def _driven(samples: Samples, lags: int) -> np.ndarray:
    return np.column_stack([*(_lagged(samples.current_ma, lag) for lag in range(lags + 1)), *samples.signals])


def _shown(samples: Samples) -> np.ndarray:
    """What boosting is shown (N, m): no speed and no error after the start of the prediction."""
    error_mps = samples.speed_mps - samples.base_mps
    means = [np.mean([_lagged(one, lag) for lag in range(HORIZON)], axis=0) for one in samples.signals]
    columns = [samples.base_mps, _lagged(samples.speed_mps, HORIZON), _lagged(error_mps, HORIZON), samples.current_ma]
    return np.column_stack([*columns, *(_lagged(samples.current_ma, lag) for lag in LAGS), *samples.signals, *means])


def _held(samples: Samples) -> np.ndarray:
    """The samples (N,) that are left out to choose by."""
    return np.arange(len(samples)) // BLOCK % HELD_OF == HELD_OF - 1


def _rms(errors: np.ndarray, where: np.ndarray) -> float:
    known = errors[where & np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.inf
