"""The 1 Hz limit on what the command contains: a cascade of equal first-order lags, known to the law that plans.

    x_1' = w_c (u - x_1),  x_i' = w_c (x_(i-1) - x_i),   |G(f)| = (1 + (f / f_c)^2)^(-n/2)

u wanted current in mA, x_n the current that is sent. It limits the content, not the rate of the frames: between the
plans of the predictive law the lags run at the rate of the frames. Every state is itself a current, so that it passes
through the model's static characteristic like one.
"""

import math

import numpy as np


class CommandShaper:
    """`states_ma` (n,) are all its state; the last one is the shaped current."""

    def __init__(self, cutoff_hz: float, order: int, dt_s: float) -> None:
        self.share = 1.0 - math.exp(-2.0 * math.pi * cutoff_hz * dt_s)
        self.states_ma = [0.0] * order

    def reset(self, current_ma: float) -> None:
        """Start from the current that flows already."""
        self.states_ma = [current_ma] * len(self.states_ma)

    def step(self, wanted_ma: float) -> float:
        """The shaped current after one frame."""
        value = wanted_ma
        for i, state in enumerate(self.states_ma):
            value = self.states_ma[i] = state + self.share * (value - state)
        return value

    def response(self, horizon: int) -> tuple[np.ndarray, np.ndarray]:
        """What is sent in the next `horizon` frames: (horizon, n) from the states, (horizon, horizon) from the wanted.

        sent = from_states @ states + from_wanted @ wanted, with one wanted value per frame.
        """
        order = len(self.states_ma)
        probe = CommandShaper.__new__(CommandShaper)
        probe.share = self.share

        def sent(states: list[float], first: float) -> np.ndarray:
            probe.states_ma = states
            return np.array([probe.step(first if k == 0 else 0.0) for k in range(horizon)])

        from_states = np.column_stack([sent([float(i == j) for i in range(order)], 0.0) for j in range(order)])
        pulse = sent([0.0] * order, 1.0)
        lag = np.subtract.outer(np.arange(horizon), np.arange(horizon))
        return from_states, np.where(lag >= 0, pulse[np.maximum(lag, 0)], 0.0)
