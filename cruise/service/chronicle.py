"""What a run adds to what is kept of a machine: time, distance, exits, what was learned and what of it was refused."""

import math
from collections import Counter
from threading import Event

from cruise.estimation.supervision import Decision
from cruise.service.cruise_node import CruiseNode
from cruise.service.persistence import Keeper, Kept, PersistenceSettings, Statistics, fingerprint


class Chronicle:
    """Continues from `before` (None: a new machine), is told of every tick, and hands the state to `keeper`."""

    def __init__(self, node: CruiseNode, settings: PersistenceSettings, before: Kept | None, keeper: Keeper) -> None:
        self._node, self._settings, self._keeper = node, settings, keeper
        self._model = fingerprint(node.estimator.factory)
        self._before = before.statistics if before is not None else Statistics()
        self._exits, self._decisions = Counter(self._before.exits), Counter(self._before.decisions)
        self._decision: Decision | None = None
        self._run_s = self._engaged_s = self._distance_m = 0.0
        self._controls = False
        self._next_s = settings.every_s

    def step(self, now_s: float) -> None:
        """Take a tick in; keep the state where the controller let go, and every now and then."""
        passed_s, self._run_s = now_s - self._run_s, now_s
        controls = self._node.engagement.state.controls
        let_go, self._controls = self._controls and not controls, controls
        if controls:
            speed_mps = self._node.hearing.value("ground_speed_mps", now_s)
            self._engaged_s += passed_s
            self._distance_m += 0.0 if math.isnan(speed_mps) else abs(speed_mps) * passed_s
        decision = self._node.supervisor.decision
        if decision is not None and decision is not self._decision:
            self._decision = decision
            self._decisions[f"{decision.change}: {decision.why}"] += 1
        if let_go:
            self._exits[self._node.engagement.exit_condition] += 1
        if let_go or now_s >= self._next_s:
            self._next_s = now_s + self._settings.every_s
            self.keep()

    def keep(self) -> Event:
        """Have the state written now; set once it is, or could not be."""
        return self._keeper.keep(self.state())

    def state(self) -> Kept:
        """Everything up to now."""
        before = self._before
        statistics = Statistics(
            starts=before.starts + 1,
            run_s=before.run_s + self._run_s,
            engaged_s=before.engaged_s + self._engaged_s,
            distance_m=before.distance_m + self._distance_m,
            exits=dict(self._exits),
            decisions=dict(self._decisions),
        )
        learned = self._node.estimator.save()
        return Kept(machine=self._settings.machine, model=self._model, learned=learned, statistics=statistics)

    def close(self) -> None:
        """Keep the state as the run ends."""
        self.keep()
        self._keeper.close()
