"""The cruise control as a service: node, bus, what is kept, and what systemd is told, from start to neutral.

Settings are the file's, and on top of them what a CANopen master wrote (object 2F00h of config/cruise.eds), which is
checked by the same structs. There is one way to change them: the run ends with neutral, whoever made the Daemon reads
the file again and makes the next one with the `changes` of this one, as after SIGHUP. After a start nothing is engaged.
"""

import json
import logging
import math
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import msgspec

from cruise import settings as strict
from cruise.can.bus import Bus, Filter, PatientBus, open_bus
from cruise.can.error_frames import BusHealth
from cruise.can.node_texts import NodeTexts
from cruise.control.engagement import State
from cruise.estimation.supervision import Decision
from cruise.service.chronicle import Chronicle
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Lateness, serve
from cruise.service.notify import Notifier
from cruise.service.persistence import Keeper, Kept, StateFile, fingerprint, held
from cruise.service.realtime import Garbage, lock_memory
from cruise.service.settings import CruiseSettings
from cruise.service.station import FILTERS, Station
from cruise.settings import SettingsError

_NO_BUS = (BusHealth.OFF, BusHealth.LOST)
SENDS_S = 1.0  # s without a frame for which the bus had no room, after which it has room again
STORED_S = 0.2  # s that the loop waits for the disk where a master has something stored; less than the watchdog's


class Changes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a CANopen master may write: these parts of CruiseSettings, of each the settings that are to change.

    The others are the file's alone: what names files, the bus (who cuts itself off can't take it back), the machine's
    identity, and whether experiments may be driven.
    """

    setpoint_from: Literal["j1939", "canopen"] | None = None
    sampling: dict[str, Any] = {}
    estimator: dict[str, Any] = {}
    supervision: dict[str, Any] = {}
    engagement: dict[str, Any] = {}
    plausibility: dict[str, Any] = {}
    control: dict[str, Any] = {}


class Daemon:
    """One run with one set of settings; `say` takes lines for the log. Raises SettingsError.

    `changes` are those of the run before, None at the first: then what is stored counts. `reload` asks for the next
    run; without it settings can't be written. `again` is a run that has ended, whose files were good: what it read of
    them is not read anew. Then, and under systemd, the bus is waited for: at boot an interface may come late.
    """

    def __init__(
        self,
        settings: CruiseSettings,
        notifier: Notifier,
        say: Callable[[str], None],
        changes: Mapping[str, Any] | None = None,
        reload: Callable[[], None] | None = None,
        again: "Daemon | None" = None,
    ) -> None:
        self.settings = self.of_file = settings
        self.notifier = notifier
        self.say = say
        # What a client of the bus does wrong is answered there; at a thousand frames a second a log would cost time.
        logging.getLogger("canopen").setLevel(logging.CRITICAL)
        self.node = CruiseNode.load(settings) if again is None else again._with(again.changes)[1]
        self.changes: Mapping[str, Any] = {}
        self._reload = reload
        file = self._state_file()
        with ExitStack() as begun:
            unlocked = begun.enter_context(held(file.path.parent)) if file is not None else ""
            if unlocked:
                self.say(unlocked)
            self._begin(file, changes, at_once=again is None and not notifier.listened_to)
            self._held = begun.pop_all()

    def _begin(self, file: StateFile | None, changes: Mapping[str, Any] | None, at_once: bool) -> None:
        """Take up what is kept, and open the bus."""
        settings = self.settings
        stored = file.read().kept if file is not None else None
        self._adopt(changes if changes is not None or stored is None else stored.settings)
        state, keeper = self._kept(file)  # what was learned counts under the settings that it was learned with
        self.station = Station(self.node, settings.can)
        self.lateness = Lateness()
        self._keeper, self.chronicle = keeper, None
        if keeper is not None and settings.persistence is not None:
            self.chronicle = Chronicle(self.node, settings.persistence, state, keeper)
        self.bus = PatientBus(settings.can.channel, self._opened, at_once)
        self._health = self.bus.health
        self._state = self._problem = self._no_bus = self._loss = ""
        self._exits = self._refusals = 0
        self._decision: Decision | None = None
        self._refused, self._refused_s, self._full = 0, -math.inf, False  # frames for which the bus had no room
        if self.node.canopen is not None:
            self.node.canopen.describe(self._texts())
        self._look_at_the_keeper()

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
            self._look_at_the_engagement()
            if self.chronicle is not None:
                self.chronicle.step(ended_s)  # that it let go counts, too
            self.bus.close()
            garbage.close()
            if self.chronicle is not None:
                self.notifier.ended()
                self.chronicle.close()
                if self._keeper is not None and self._keeper.problem:
                    self.say(f"what was learned and counted in this run is lost: {self._keeper.problem}")
            self._held.close()

    def _look_after(self, now_s: float) -> None:
        # Without a bus, or an address on it, nobody hears the node: it lets go, and stays so until the operator acts.
        no_bus = f"the bus is {self.bus.health}" if self.bus.health in _NO_BUS else ""
        self.node.ailment = no_bus or ("the address is lost" if self.station.lost else "")
        if self.bus.health is not self._health:
            self.say(f"bus {self.settings.can.channel}: {self._health} -> {self.bus.health}")
            self._health = self.bus.health
        if self.station.loss != self._loss:
            self._loss = self.station.loss
            self.say(self._loss or "the address is our own again")
        self._look_at_the_queue(now_s)
        if self.bus.problem != self._no_bus:
            self._no_bus = self.bus.problem
            self.say(f"waits for its bus: {self._no_bus}" if self._no_bus else "its bus is there")
        self._look_at_the_engagement()
        if self.node.supervisor.decision is not self._decision:
            self._decision = self.node.supervisor.decision
            self.say(f"learned model {self._decision}")
        if self.chronicle is not None:
            self.chronicle.step(now_s)
        self._look_at_the_keeper()
        self.notifier.alive(now_s)

    def _look_at_the_engagement(self) -> None:
        """Say once what an operator will ask: why it let go or can't drive, and why a button did nothing."""
        engagement = self.node.engagement
        if engagement.state != self._state:
            self._state = engagement.state
            self.notifier.tell(f"STATUS={self._state}")
            if self._state is State.FAULT and engagement.exits == self._exits:
                self.say(f"now fault, while a person drove: {engagement.ailed}")
        if engagement.exits != self._exits:
            self._exits = engagement.exits
            self.say(f"let go, now {engagement.state}: {engagement.ended_by}")
        if engagement.refusals != self._refusals:
            self._refusals = engagement.refusals
            self.say(f"a button was refused: {engagement.refused}")

    def _look_at_the_keeper(self) -> None:
        """Say that states can't be written, when that begins, and when it is over."""
        if self._keeper is not None and self._keeper.problem != self._problem:
            self._problem = self._keeper.problem
            lost = "what is learned and counted from now on is lost when this run ends"
            self.say(f"{self._problem}; {lost}" if self._problem else "what is kept can be written again")

    def _look_at_the_queue(self, now_s: float) -> None:
        """Say that frames can't be sent, when it begins, and when none was refused for a second."""
        refused = self.bus.no_room
        if refused > self._refused:
            if not self._full:
                channel = self.settings.can.channel
                self.say(f"bus {channel}: no room to send: nobody acknowledges, or there is more than the bus carries")
            self._full, self._refused, self._refused_s = True, refused, now_s
        elif self._full and now_s - self._refused_s > SENDS_S:
            self._full = False
            self.say(f"bus {self.settings.can.channel}: sends again; {refused} frames were not sent since the start")

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
            store=self._store,
            restore=self._restore,
            may_change=lambda: not self.node.engagement.state.drives,
            change=self._change if self._reload is not None else None,
        )

    def _change(self, text: str) -> None:
        """Have the settings in `text` changed in the next run, which comes at once. Raises SettingsError."""
        written = strict.parse(text, Changes, "object 2F00h")
        changes = _merged(self.changes, msgspec.to_builtins(written))
        self._with(changes)
        self.changes = changes
        self._ask_for_reload()

    def _store(self) -> None:
        if self.chronicle is None or self._keeper is None:
            raise SettingsError("nothing is kept here; add the section persistence to the settings")
        self._keeper.settings = dict(self.changes)
        written = self.chronicle.keep().wait(STORED_S)
        self.node.pace.restart()  # the disk had the program's turn, while nothing drove
        if not written or self._keeper.problem:
            raise SettingsError(self._keeper.problem or "the disk is slow; try again")

    def _restore(self) -> None:
        """Back to the factory's model and the file's settings, now and after a restart."""
        self.node.learning.forget()
        changed, self.changes = bool(self.changes), {}
        if changed:
            self._ask_for_reload()
        if self.chronicle is not None:
            self._store()

    def _ask_for_reload(self) -> None:
        if self._reload is not None:
            self._reload()

    def _adopt(self, changes: Mapping[str, Any] | None) -> None:
        """Go on with `changes`, or with the file alone where it no longer agrees with them."""
        if not changes:
            return
        try:
            self.settings, self.node = self._with(changes)
            self.changes = changes
        except SettingsError as error:
            self.say(f"settings written by SDO are not used: {error}")

    def _with(self, changes: Mapping[str, Any]) -> tuple[CruiseSettings, CruiseNode]:
        """Return the file's settings with `changes`, and a new node that has them, and what was learned.

        Raises SettingsError, also where nothing like it can be learned under these settings.
        """
        node = self.node
        canopen = node.canopen.anew() if node.canopen is not None else None
        experiments = tuple(node.engagement.experiments.values())
        try:
            settings = msgspec.convert(_merged(msgspec.to_builtins(self.of_file), changes), CruiseSettings)
            fresh = CruiseNode(settings, node.estimator.factory, node.codec, canopen, experiments)
            fresh.estimator.restore(node.estimator.save())
        except (msgspec.ValidationError, ValueError, ArithmeticError) as error:
            raise SettingsError(f"object 2F00h: {error}; the settings stay as they were") from error
        return settings, fresh

    def _opened(self) -> Bus:
        """The bus, whenever it is there; who is on it shall hear whose address is whose before anything else."""
        bus = open_bus(self.settings.can, filters=self._filters())
        self.station.begin()
        return bus

    def _filters(self) -> tuple[Filter, ...]:
        canopen = self.node.canopen
        return (*self.node.hearing.codec.filters, *FILTERS, *(canopen.filters if canopen is not None else ()))

    def _state_file(self) -> StateFile | None:
        """Where the runs before left their state, if it is kept. Raises SettingsError where there is no such place."""
        kept = self.settings.persistence
        if kept is None:
            return None
        folder = Path(os.environ.get("STATE_DIRECTORY", kept.folder))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SettingsError(f"persistence.folder: {folder} cannot be made: {error.strerror}") from error
        return StateFile(folder / "state", kept.machine, fingerprint(self.node.estimator.factory))

    def _kept(self, file: StateFile | None) -> tuple[Kept | None, Keeper | None]:
        """What the runs before left, given to the estimator, and who keeps what this one leaves."""
        if file is None:
            return None, None
        found = file.read(lambda state: self.node.estimator.restore(state.learned))
        for problem in found.problems:
            self.say(problem)
        keeper = Keeper(file, found.kept.settings if found.kept is not None else None)
        keeper.try_to_write()
        return found.kept, keeper


def _merged(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return `values` with `changes` in them, mappings within mappings likewise."""
    merged = dict(values)
    for name, value in changes.items():
        old = merged.get(name)
        merged[name] = _merged(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return merged
