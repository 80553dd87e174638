"""The cruise control as a service: node, bus, what is kept, and what systemd is told, from start to neutral."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import msgspec

from cruise import settings as strict
from cruise.can.bus import Filter, PatientBus, open_bus
from cruise.can.error_frames import BusHealth
from cruise.can.node_texts import NodeTexts
from cruise.service.chronicle import Chronicle
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lateness, serve
from cruise.service.notify import Notifier
from cruise.service.persistence import Keeper, StateFile, fingerprint
from cruise.service.realtime import Garbage, lock_memory
from cruise.service.settings import CruiseSettings
from cruise.service.station import FILTERS, Station

_NO_BUS = (BusHealth.OFF, BusHealth.LOST)


class Daemon:
    """One run with one set of settings; `say` takes lines for the log. Raises SettingsError."""

    def __init__(self, settings: CruiseSettings, notifier: Notifier, say: Callable[[str], None]) -> None:
        self.settings = settings
        self.notifier = notifier
        self.say = say
        self.node = CruiseNode.load(settings)
        self.station = Station(self.node, settings.can)
        self.lateness = Lateness()
        self.chronicle = self._chronicle()
        self.bus = PatientBus(settings.can.channel, lambda: open_bus(settings.can, filters=self._filters()))
        self._health = self.bus.health
        self._state = ""
        if self.node.canopen is not None:
            self.node.canopen.describe(self._texts())

    def run(self, running: Callable[[], bool], each_tick: Callable[[float], None]) -> None:
        """Serve until `running` says no; whatever ends it, the last word on the bus is neutral."""
        ended_s, garbage = 0.0, Garbage()
        lock_memory()
        self.notifier.ready()

        def tick(now_s: float) -> None:
            nonlocal ended_s
            ended_s = now_s
            self._look_after(now_s)
            each_tick(now_s)
            garbage.step(now_s)

        try:
            serve(self.station, self.bus, running, tick, self.lateness)
        finally:
            for frame in self.station.stop(ended_s):
                self.bus.send(frame)
            self.bus.close()
            garbage.close()
            if self.chronicle is not None:
                self.chronicle.close()

    def _look_after(self, now_s: float) -> None:
        # Without a bus, or an address on it, nobody hears the node: it lets go, and stays so until the operator acts.
        self.node.healthy = self.bus.health not in _NO_BUS and not self.station.lost
        if self.bus.health is not self._health:
            self.say(f"bus {self.settings.can.channel}: {self._health} -> {self.bus.health}")
            self._health = self.bus.health
        if self.node.engagement.state != self._state:
            self._state = self.node.engagement.state
            self.notifier.tell(f"STATUS={self._state}")
        if self.chronicle is not None:
            self.chronicle.step(now_s)
        self.notifier.alive(now_s)

    def _texts(self) -> NodeTexts:
        """What a CANopen master may read, and have stored or forgotten."""
        chronicle = self.chronicle

        def learned() -> str:
            model = self.node.estimator.snapshot()
            return json.dumps(dict(zip(model.parameter_names, model.theta, strict=True)))

        return NodeTexts(
            texts={
                "settings": lambda: strict.dump(self.settings),
                "learned": learned,
                "statistics": lambda: json.dumps(
                    msgspec.structs.asdict(chronicle.state().statistics) if chronicle else {}
                ),
            },
            store=chronicle.keep if chronicle else lambda: None,
            restore=self.node.estimator.forget,
            may_restore=lambda: not self.node.engagement.state.drives,
        )

    def _filters(self) -> tuple[Filter, ...]:
        canopen = self.node.canopen
        return (*self.node.hearing.codec.filters, *FILTERS, *(canopen.filters if canopen is not None else ()))

    def _chronicle(self) -> Chronicle | None:
        kept = self.settings.persistence
        if kept is None:
            return None
        estimator = self.node.estimator
        folder = Path(os.environ.get("STATE_DIRECTORY", kept.folder))
        folder.mkdir(parents=True, exist_ok=True)
        file = StateFile(folder / "state", kept.machine, fingerprint(estimator.factory))
        found = file.read(lambda state: estimator.restore(state.learned))
        for problem in found.problems:
            self.say(problem)
        return Chronicle(self.node, kept, found.kept, Keeper(file))
