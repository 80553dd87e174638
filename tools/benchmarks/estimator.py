"""The time of one estimator update, beside a bare recursive least squares and two libraries.

    numpy RLS:  K = P x / (lambda + x' P x),   theta += K (y - x' theta),   P = (P - K x' P) / lambda

The contenders are given finished regressor rows x (n,) and targets y; Estimator.learn builds its own from a sample,
filters them, predicts, judges the sample at the gate, learns, forgets and keeps the model safe. They take turns block
by block, so that the machine's noise hits all alike; the garbage collector is off. Source of the numpy form: Ljung,
System Identification, 2nd ed. 1999, equation 11.9.
"""

import gc
import platform
from collections.abc import Callable, Sequence
from time import perf_counter_ns

import numpy as np
from filterpy.kalman import KalmanFilter
from padasip.filters import FilterRLS

from cruise import settings
from cruise.estimation.estimator import Estimator, EstimatorSettings
from cruise.estimation.gate import Gate
from cruise.identification.least_squares import regression_over
from cruise.model import files
from cruise.model.model import Model
from cruise.plant import PlantSettings
from cruise.recording import Recording

from .figures import Figure, Part
from .recordings import CONFIG, drive, samples

SEED = 11
SECONDS = 400.0  # s of driving
ROUNDS = 8  # times over it
BLOCK = 100  # updates before the next contender's turn
FORGETTING = 0.998  # lambda, a memory of 100 s at 5 Hz
LATEST_US = 1000.0  # issue 2: p99 below 1 ms

Update = Callable[[int], object]


class NumpyRls:
    """The textbook's form, nothing around it."""

    def __init__(self, size: int) -> None:
        self.theta = np.zeros(size)
        self.covariance = 1e3 * np.eye(size)

    def adapt(self, target: float, row: np.ndarray) -> None:
        """One update."""
        spread = self.covariance @ row
        gain = spread / (FORGETTING + row @ spread)
        self.theta += gain * (target - row @ self.theta)
        self.covariance = (self.covariance - np.outer(gain, spread)) / FORGETTING


def kalman_rls(size: int, noise_std_mps: float) -> KalmanFilter:
    """filterpy's filter as recursive least squares: parameters that walk, each sample a measurement of them."""
    found = KalmanFilter(dim_x=size, dim_z=1)
    found.P *= 1e3
    found.R *= noise_std_mps**2
    found.Q = 1e-8 * np.eye(size)  # the walk that makes it forget
    return found


def open_samples(model: Model, recording: Recording) -> list[bool]:
    """Which samples teach."""
    estimator = Estimator(model, EstimatorSettings())
    return [estimator.learn(sample).gate is Gate.OPEN for sample in samples(recording)]


def times_us(updates: dict[str, Sequence[Update]], count: int) -> dict[str, np.ndarray]:
    """Times in us of update 0..count-1 of every contender, (rounds, count); contenders take turns block by block."""
    found = {name: np.zeros((len(rounds), count)) for name, rounds in updates.items()}
    gc.collect()
    gc.disable()
    try:
        for turn in range(len(next(iter(updates.values())))):
            for start in range(0, count, BLOCK):
                for name, rounds in updates.items():
                    update, row = rounds[turn], found[name][turn]
                    for k in range(start, min(start + BLOCK, count)):
                        begin_ns = perf_counter_ns()
                        update(k)
                        row[k] = 1e-3 * (perf_counter_ns() - begin_ns)
    finally:
        gc.enable()
    return found


def measure(seconds: float = SECONDS, rounds: int = ROUNDS) -> Part:
    """Time all contenders on one drive of the virtual combine."""
    model = files.load(CONFIG / "factory_model.yaml")
    recording = drive(settings.load(CONFIG / "plant.yaml", PlantSettings), SEED, seconds)
    given = samples(recording)
    matrix, target = regression_over(model, recording)
    rows, targets = list(matrix), target.tolist()
    columns = [row[None, :] for row in rows]
    count, size = min(len(rows), len(given)), len(model.theta)

    def learning() -> Update:
        estimator = Estimator(model, EstimatorSettings())
        return lambda k: estimator.learn(given[k])

    def recursion() -> Update:
        estimator = Estimator(model, EstimatorSettings())
        rls = estimator.rls

        def update(k: int) -> None:
            rls.update(rows[k], targets[k] - float(rows[k].dot(rls.theta)), FORGETTING)

        return update

    def textbook() -> Update:
        rls = NumpyRls(size)
        return lambda k: rls.adapt(targets[k], rows[k])

    def padasip() -> Update:
        rls = FilterRLS(n=size, mu=FORGETTING)
        return lambda k: rls.adapt(targets[k], rows[k])

    def filterpy() -> Update:
        rls = kalman_rls(size, model.residual_std_mps)

        def update(k: int) -> None:
            rls.predict()
            rls.update(targets[k], H=columns[k])

        return update

    makers = {"learn": learning, "recursion": recursion, "numpy": textbook, "padasip": padasip, "filterpy": filterpy}
    times = times_us({name: [make() for _ in range(rounds)] for name, make in makers.items()}, count)
    taught = np.array(open_samples(model, recording)[:count])
    counted = {name: found[:, taught].ravel() for name, found in times.items()}
    middle = {name: float(np.median(found)) for name, found in counted.items()}
    learn = counted["learn"]
    figures = [
        Figure("update_p50_us", middle["learn"], "us", "Estimator.learn, p50"),
        Figure("update_p99_us", float(np.quantile(learn, 0.99)), "us", "Estimator.learn, p99", at_most=LATEST_US),
        Figure("update_max_us", float(learn.max()), "us", "Estimator.learn, max"),
        Figure("over_numpy", middle["learn"] / middle["numpy"], "1", "relative to a bare numpy RLS"),
        Figure("over_padasip", middle["learn"] / middle["padasip"], "1", "relative to padasip's FilterRLS.adapt"),
        Figure(
            "over_filterpy",
            middle["learn"] / middle["filterpy"],
            "1",
            "relative to filterpy's KalmanFilter",
            at_most=1.0,
        ),
        Figure(
            "recursion_over_filterpy",
            middle["recursion"] / middle["filterpy"],
            "1",
            "its SquareRootRls alone, like for like, relative to filterpy",
        ),
        *(
            Figure(f"{name}_p50_us", middle[name], "us", f"{title}, p50")
            for name, title in (
                ("recursion", "SquareRootRls alone"),
                ("numpy", "numpy RLS"),
                ("padasip", "padasip"),
                ("filterpy", "filterpy"),
            )
        ),
        Figure("updates", float(learn.size), "1", "updates timed, all with the gate open"),
        Figure("parameters", float(size), "1", "parameters"),
    ]
    note = f"{platform.python_implementation()} {platform.python_version()}, numpy {np.__version__}, one thread"
    return Part(tuple(figures), (SEED,), (note,))
