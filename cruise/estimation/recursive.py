"""Recursive least squares in square-root form, with forgetting that falls back to what was known before.

    minimise  sum_k lambda^(N-k) (y_k - x_k . theta)^2 / r  +  (theta - theta_0)' Pi_0 (theta - theta_0)

theta (n,) parameters, r variance of the noise, Pi_0 = diag(1 / std_0^2) what the factory model is worth. Plain
exponential forgetting lets the covariance of what is not excited grow without bound (wind-up); here the prior is
forgotten at the same rate as it is fed in again, one parameter at each update as a pseudo-measurement theta_i =
theta_0,i of variance std_0,i^2 / (n (1 - lambda)). So the covariance of what nothing excites stays about the factory's
(between two of its turns it grows by lambda^-n), and such directions return to the factory's values.

The covariance P = S S' is held as its root S (n, n): Potter's update, which keeps P symmetric and non-negative
whatever the rounding. Sources: Potter (in Battin, Astronautical Guidance, 1964, p. 338); Kulhavy and Kraus, "On
duality of regularized exponential and linear forgetting", Automatica 32 (1996); Ljung and Soderstrom, Theory and
Practice of Recursive Identification, 1983, section 5.5 (regularising one element at a time).
"""

import math

import numpy as np


class SquareRootRls:
    """Parameters `theta` (n,), root `root` (m, m) of the covariance of the first m, and the prior they fall back to.

    The last n - m are held: they keep their values, and what the others learn doesn't move them.
    """

    def __init__(self, theta: np.ndarray, std: np.ndarray, noise_std: float) -> None:
        self.prior = np.array(theta, float)
        self.prior_std = np.array(std, float)
        self.noise_variance = noise_std**2
        self.theta = self.prior.copy()
        self.root = np.diag(self.prior_std)
        self.turn = 0  # the parameter whose prior is fed in next

    @property
    def free(self) -> int:
        """How many parameters learn."""
        return len(self.root)

    def hold_after(self, free: int) -> None:
        """Let the first `free` parameters learn and hold the others.

        Holding forgets how the held ones are correlated with the rest; letting go starts them at the prior's
        uncertainty, for what they stand for may have changed in the meantime.
        """
        known = self.free
        if free < known:
            self.root = np.asarray(np.linalg.qr(self.root[:free].T, mode="r")).T
        elif free > known:
            root = np.diag(self.prior_std[:free])
            root[:known, :known] = self.root
            self.root = root

    def std(self) -> np.ndarray:
        """Standard deviations (n,) of the parameters; the prior's for those that are held."""
        result = self.prior_std.copy()
        result[: self.free] = np.sqrt(np.sum(self.root**2, axis=1))
        return result

    def update(self, columns: np.ndarray, innovation: float, forgetting: float) -> None:
        """Learn from one sample, columns (m,) and innovation y - x . theta, then forget by lambda = `forgetting`."""
        self._absorb(columns.dot(self.root), innovation, self.noise_variance)
        if forgetting < 1.0:
            self.root *= 1.0 / math.sqrt(forgetting)
            size = self.free
            i = self.turn = (self.turn + 1) % size
            pull = self.prior_std[i] ** 2 / (size * (1.0 - forgetting))
            self._absorb(self.root[i], float(self.prior[i] - self.theta[i]), pull)

    def _absorb(self, direction: np.ndarray, innovation: float, variance: float) -> None:
        """Potter's update with direction = S' x of a measurement of the given variance; what is certain stays."""
        total = float(direction.dot(direction)) + variance
        if total == 0.0:
            return
        gain = self.root.dot(direction)
        free = self.theta[: len(gain)]
        free += gain * (innovation / total)
        self.root -= gain[:, None] * (direction / (total + math.sqrt(variance * total)))
