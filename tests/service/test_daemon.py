"""The service from start to neutral: what systemd is told, what is kept, what a lost bus does. On the virtual bus."""

import os
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from cruise.can.bus import Bus, open_bus
from cruise.can.codec import Codec
from cruise.can.error_frames import BusHealth
from cruise.can.settings import CanSettings
from cruise.cli.places import CONFIG
from cruise.control.controller import Command
from cruise.control.engagement import State
from cruise.estimation.shadow import Shadow
from cruise.estimation.supervision import Change, Decision
from cruise.model import files
from cruise.model.files import Provenance
from cruise.service import settings as service_settings
from cruise.service.daemon import Daemon
from cruise.service.notify import RELOAD_S, Notifier
from cruise.service.persistence import PersistenceSettings
from cruise.service.settings import CruiseSettings
from cruise.settings import SettingsError


@pytest.fixture
def settings(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CruiseSettings:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "kept"))
    monkeypatch.setattr("cruise.service.daemon.STORED_S", 60.0)  # the disk here may be as slow as it likes
    found = service_settings.load(CONFIG / "cruise.yaml")
    can = CanSettings(bus="virtual", channel=request.node.name)
    return structs.replace(found, can=can, persistence=PersistenceSettings(machine="A1"))


def run(daemon: Daemon, ticks: int, each_tick=lambda now_s: None) -> None:
    """Serve for some ticks."""
    done = 0

    def tick(now_s: float) -> None:
        nonlocal done
        done += 1
        each_tick(now_s)

    daemon.run(lambda: done < ticks, tick)


def last_command(far: Bus, settings: CruiseSettings) -> dict[str, float]:
    codec = Codec.load(settings.database, settings.can)
    decoded = [codec.decode(frame) for frame in far.drain()]
    commands = [one for one in decoded if one.message == "PumpCurrentCommand"]
    return {reading.name: reading.value for reading in commands[-1].readings}


def test_systemd_is_told_and_the_watchdog_is_fed(settings: CruiseSettings, tmp_path: Path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(5.0)
        environment = {
            "NOTIFY_SOCKET": str(tmp_path / "notify"),
            "WATCHDOG_USEC": "200000",
            "WATCHDOG_PID": str(os.getpid()),
        }
        run(Daemon(settings, Notifier.of(environment), print), 10)
        told = []
        systemd.setblocking(False)
        try:
            while True:
                told.append(systemd.recv(1000).decode())
        except BlockingIOError:
            pass
    assert told[0] == "READY=1\nWATCHDOG_USEC=200000"
    assert "STATUS=off" in told
    assert 5 <= told.count("WATCHDOG=1") <= 10, "every 50 ms, and at most once a tick"


def test_under_systemd_an_interface_that_comes_late_is_waited_for(settings: CruiseSettings, tmp_path: Path):
    absent = structs.replace(settings, can=CanSettings(bus="socketcan", channel="never0"))
    with pytest.raises(SettingsError):
        Daemon(absent, Notifier(""), print)
    said: list[str] = []
    daemon = Daemon(absent, Notifier(str(tmp_path / "notify")), said.append)
    assert daemon.bus.health is BusHealth.LOST
    run(daemon, 10)
    assert daemon.node.engagement.state is State.OFF
    assert [line for line in said if line.startswith("waits for its bus")] == said, "once, with the remedy"
    assert len(said) == 1


def test_on_a_bus_that_comes_late_or_again_the_address_is_claimed_before_anything_is_said(
    settings: CruiseSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def comes_late(*_: object, **__: object) -> Bus:
        tries.append(None)
        if len(tries) < 3:
            raise SettingsError("no such interface")
        return open_bus(settings.can)

    tries: list[None] = []
    monkeypatch.setattr("cruise.service.daemon.open_bus", comes_late)
    daemon = Daemon(settings, Notifier(str(tmp_path / "notify")), print)
    heard: list[list[int]] = []

    def each_tick(now_s: float) -> None:
        heard.append([frame.arbitration_id for frame in far.drain() if frame.is_extended_id])
        if len(heard) == 15:
            daemon.bus._lose()

    with open_bus(settings.can) as far:
        run(daemon, 30, each_tick)
    for part in heard[:15], heard[15:]:
        said = [identifiers for identifiers in part if identifiers]
        assert said[0] == [0x18EEFF11], "the claim alone"
        assert 0x0CFF1211 in said[1], "then the command"


def test_what_cannot_be_kept_is_said_when_that_begins_and_at_the_end(settings: CruiseSettings, tmp_path: Path):
    assert settings.persistence is not None
    kept = structs.replace(settings.persistence, every_s=0.1)
    said: list[str] = []
    daemon = Daemon(structs.replace(settings, persistence=kept), Notifier.of({}), said.append)
    (tmp_path / "kept" / "state.new").symlink_to("/dev/full")
    run(daemon, 20)
    begin, end = (line for line in said if "cannot be written: No space left on device" in line)
    assert "from now on is lost" in begin
    assert end.startswith("what was learned and counted in this run is lost")


def test_that_the_last_state_could_not_be_written_is_said(settings: CruiseSettings, tmp_path: Path):
    said: list[str] = []
    daemon = Daemon(settings, Notifier.of({}), said.append)
    (tmp_path / "kept" / "state.new").symlink_to("/dev/full")
    run(daemon, 3)  # less than it takes to the first write
    (line,) = said
    assert line.startswith("what was learned and counted in this run is lost")
    assert line.endswith("state: cannot be written: No space left on device")


def test_at_the_start_it_is_said_that_nothing_can_be_kept_and_it_drives_on(settings: CruiseSettings, tmp_path: Path):
    said: list[str] = []
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "state.new").symlink_to("/dev/full")
    daemon = Daemon(settings, Notifier.of({}), said.append)
    (line,) = said
    assert "state: cannot be written: No space left on device; what is learned and counted from now on is lost" in line
    (tmp_path / "kept" / "state.new").unlink()
    run(daemon, 3)
    assert (tmp_path / "kept" / "state").exists()
    assert said == [line], "nor anything at the end"


def test_that_the_folder_was_tried_leaves_nothing_in_it(settings: CruiseSettings, tmp_path: Path):
    said: list[str] = []
    daemon = Daemon(settings, Notifier.of({}), said.append)
    assert said == []
    assert list((tmp_path / "kept").iterdir()) == []
    daemon.bus.close()


def test_a_bus_without_room_is_said_when_it_begins_and_when_it_ends(settings: CruiseSettings):
    said: list[str] = []
    daemon = Daemon(settings, Notifier.of({}), said.append)

    def each_tick(now_s: float) -> None:
        if daemon.bus.no_room < 10:
            daemon.bus.no_room += 1

    run(daemon, 50, each_tick)
    begin, end = (line for line in said if line.startswith("bus"))
    assert "no room to send" in begin
    assert "sends again; 10 frames were not sent" in end


def test_what_could_not_be_stored_is_no_success(settings: CruiseSettings, tmp_path: Path):
    daemon = Daemon(settings, Notifier.of({}), print)
    daemon._store()
    (tmp_path / "kept" / "state.new").symlink_to("/dev/full")
    with pytest.raises(SettingsError, match="No space left on device"):
        daemon._store()
    run(daemon, 2)


def test_a_disk_that_is_slow_while_nothing_drives_is_no_pause(settings: CruiseSettings):
    daemon = Daemon(settings, Notifier.of({}), print)
    assert daemon.node.pace.tick(1.0)
    daemon._store()
    assert daemon.node.pace.tick(1.17), "more than the drive would wait"
    assert not daemon.node.pace.tick(1.37)
    run(daemon, 2)


def test_back_to_the_factorys_model_is_what_drives_too(settings: CruiseSettings):
    daemon = Daemon(settings, Notifier.of({}), print)
    node = daemon.node
    factory = node.estimator.factory
    learned = factory.with_theta(tuple(1.02 * value for value in factory.theta))
    node.estimator.rls.theta = np.array(learned.theta)
    node.supervisor._driving = node.supervisor._learned = Shadow(learned, node.supervisor._horizon)
    node.controller.adopt(learned)
    daemon._restore()
    assert node.supervisor.driving is factory
    assert node.controller.adopted is factory
    assert node.estimator.snapshot().theta == pytest.approx(factory.theta)
    assert node.estimator.rls.prior == pytest.approx(factory.theta)
    run(daemon, 2)


def test_settings_that_a_master_stored_outlive_a_new_model(settings: CruiseSettings, tmp_path: Path):
    first = Daemon(settings, Notifier(""), print, reload=lambda: None)
    first._change('{"engagement": {"speed_max_mps": 3.0}}')
    first._store()
    run(first, 2)
    model = files.load(settings.model)
    files.save(tmp_path / "better.yaml", model.with_theta(1.01 * value for value in model.theta), Provenance())
    second = Daemon(structs.replace(settings, model=str(tmp_path / "better.yaml")), Notifier(""), print)
    assert second.settings.engagement.speed_max_mps == 3.0
    second.bus.close()


WIDE = '{"estimator": {"gain_range": 5.0}, "engagement": {"speed_max_mps": 3.0}}'


def learned_under_a_wide_range(settings: CruiseSettings) -> Daemon:
    """A run that learned a gain four times the factory's, as a master lets it, and has ended."""
    first = Daemon(settings, Notifier(""), print, reload=lambda: None)
    first._change(WIDE)
    first._store()
    run(first, 2)
    first = Daemon(settings, Notifier(""), print, first.changes, lambda: None)
    saved, model = first.node.estimator.save(), first.node.estimator.factory
    saved["theta"][model.na : model.na + model.nb] = [
        4.0 * one for one in saved["theta"][model.na : model.na + model.nb]
    ]
    first.node.estimator.restore(saved)
    run(first, 2)
    return first


def test_what_was_learned_is_taken_up_under_the_settings_that_were_stored_with_it(settings: CruiseSettings):
    first = learned_under_a_wide_range(settings)
    second = Daemon(settings, Notifier(""), print, reload=lambda: None)
    assert second.settings.engagement.speed_max_mps == 3.0
    assert second.node.estimator.save() == first.node.estimator.save()
    run(second, 2)


def test_a_file_that_does_not_let_it_be_forgets_what_was_learned_and_nothing_else(settings: CruiseSettings):
    wide = structs.replace(settings, estimator=structs.replace(settings.estimator, gain_range=5.0))
    learned_under_a_wide_range(wide)
    said: list[str] = []
    narrow = structs.replace(settings, estimator=structs.replace(settings.estimator, gain_range=2.0))
    second = Daemon(narrow, Notifier(""), said.append, {"engagement": {"speed_max_mps": 3.0}}, lambda: None)
    assert any("gain_range, 2 times the factory's" in line for line in said)
    assert second.node.estimator.save()["theta"] == list(second.node.estimator.factory.theta)
    assert second.settings.engagement.speed_max_mps == 3.0
    assert second.chronicle is not None
    assert second.chronicle.state().statistics.starts == 3
    run(second, 2)


def test_what_was_learned_is_not_written_away(settings: CruiseSettings):
    first = learned_under_a_wide_range(settings)
    with pytest.raises(SettingsError, match="gain_range, 2 times the factory's"):
        first._change('{"estimator": {"gain_range": 2.0}}')


def test_a_bad_file_after_a_reload_ends_nothing_that_was_learned(settings: CruiseSettings):
    first = learned_under_a_wide_range(settings)
    second = Daemon(first.of_file, Notifier(""), print, first.changes, lambda: None, again=first)
    assert second.node.estimator.save() == first.node.estimator.save()
    run(second, 2)


def test_settings_that_the_file_no_longer_agrees_with_are_said_once(settings: CruiseSettings):
    first = Daemon(settings, Notifier(""), print, reload=lambda: None)
    first._change('{"control": {"limits": {"current_max_ma": 1100.0}}}')
    first._store()
    run(first, 2)
    limits = structs.replace(settings.control.limits, current_min_ma=1150.0)
    other = structs.replace(settings, control=structs.replace(settings.control, limits=limits))
    said: list[str] = []
    second = Daemon(other, Notifier(""), said.append, reload=lambda: None)
    assert [line.split(":")[0] for line in said] == ["settings written by SDO are not used"]
    assert second.settings == other
    second.bus.close()


def test_a_folder_that_cannot_be_made_is_a_mistake_in_the_settings(
    settings: CruiseSettings, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("STATE_DIRECTORY")
    kept = PersistenceSettings(machine="A1", folder="/proc/kept")
    with pytest.raises(SettingsError, match="/proc/kept cannot be made"):
        Daemon(structs.replace(settings, persistence=kept), Notifier(""), print)


def test_a_run_after_a_bad_file_goes_on_with_a_node_that_lives(settings: CruiseSettings):
    first = Daemon(settings, Notifier(""), print, reload=lambda: None)
    run(first, 40)
    with open_bus(settings.can) as far:
        second = Daemon(first.of_file, Notifier(""), print, first.changes, lambda: None, again=first)
        run(second, 40)
        heard = [frame.arbitration_id for frame in far.drain()]
    assert second.node.canopen is not first.node.canopen
    assert 0x711 in heard, "its heartbeat"


def test_a_decision_about_a_learned_model_is_said_once_and_kept(settings: CruiseSettings):
    said: list[str] = []
    daemon = Daemon(settings, Notifier(""), said.append)
    decided = Decision(0.1, Change.REFUSED, "its margins are too small", {"gain_margin": 1.234})

    def each_tick(now_s: float) -> None:
        if not daemon.node.supervisor.decisions:
            daemon.node.supervisor.decisions.append(decided)

    run(daemon, 5, each_tick)
    assert [line for line in said if "margins" in line] == [
        "learned model refused: its margins are too small (gain_margin 1.23)"
    ]
    assert daemon.node.status(0.5).decision is decided
    second = Daemon(settings, Notifier(""), print)
    assert second.chronicle is not None
    assert second.chronicle.state().statistics.decisions == {"refused: its margins are too small": 1}
    second.bus.close()


def test_a_watchdog_meant_for_another_process_is_not_fed(settings: CruiseSettings):
    notifier = Notifier.of({"NOTIFY_SOCKET": "", "WATCHDOG_USEC": "200000", "WATCHDOG_PID": "1"})
    notifier.alive(5.0)  # and without a socket nothing happens at all
    notifier.tell("READY=1")


def test_the_last_word_is_neutral_even_after_an_error(settings: CruiseSettings):
    def fail(now_s: float) -> None:
        raise RuntimeError("on purpose")

    with open_bus(settings.can) as far:
        with pytest.raises(RuntimeError, match="on purpose"):
            run(Daemon(settings, Notifier(""), print), 10, fail)
        assert last_command(far, settings) == {"pump_current_command_ma": 0.0, "command_active": 0.0}


def test_the_last_word_is_neutral_even_where_the_law_fails(settings: CruiseSettings, monkeypatch: pytest.MonkeyPatch):
    daemon = Daemon(settings, Notifier(""), print)
    law, steps = daemon.node.controller.step, []

    def step(*arguments: Any, **named: Any) -> Command:
        daemon.node.engagement.state = State.ENGAGED
        steps.append(arguments)
        if len(steps) > 5:
            raise RuntimeError("on purpose")
        return law(*arguments, **named)

    monkeypatch.setattr(daemon.node.controller, "step", step)
    with open_bus(settings.can) as far:
        with pytest.raises(RuntimeError, match="on purpose"):
            run(daemon, 10)
        assert last_command(far, settings) == {"pump_current_command_ma": 0.0, "command_active": 0.0}


def test_the_watchdog_waits_for_the_disk_when_the_loop_has_ended(
    settings: CruiseSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    told: list[str] = []
    notifier = Notifier(str(tmp_path / "notify"), watchdog_s=0.5)
    monkeypatch.setattr(notifier, "tell", lambda *lines: told.extend(lines))
    daemon = Daemon(settings, notifier, print)
    monkeypatch.setattr(daemon.chronicle, "close", lambda: told.append("written"))
    run(daemon, 3)
    assert told[-2:] == [f"WATCHDOG_USEC={1e6 * RELOAD_S:.0f}", "written"]


def test_statistics_and_parameters_are_there_at_the_next_start(settings: CruiseSettings):
    first = Daemon(settings, Notifier(""), print)
    first.node.estimator.rls.theta = 1.01 * first.node.estimator.rls.theta
    learned = first.node.estimator.rls.theta.tolist()
    run(first, 4)
    second = Daemon(settings, Notifier(""), print)
    assert second.node.estimator.rls.theta.tolist() == learned
    assert second.chronicle is not None
    assert second.chronicle.state().statistics.starts == 2
    assert second.chronicle.state().statistics.run_s == pytest.approx(4 * second.node.period_s, abs=0.1)
    run(second, 1)  # another service would not be let in before
    other = structs.replace(settings, persistence=PersistenceSettings(machine="B2"))
    lines: list[str] = []
    third = Daemon(other, Notifier(""), lines.append)
    assert third.node.estimator.rls.theta.tolist() != learned
    assert "is for machine A1, here is B2" in lines[0]
    run(third, 2)
    fourth = Daemon(settings, Notifier(""), lines.append)
    assert fourth.node.estimator.rls.theta.tolist() == learned
    assert "this machine is back" in lines[-1]
    fourth.bus.close()


def test_that_a_stop_let_go_is_counted_and_said(settings: CruiseSettings):
    said: list[str] = []
    daemon = Daemon(settings, Notifier(""), said.append)
    assert daemon.chronicle is not None
    chronicle, ticks = daemon.chronicle, []

    def engaged_at_the_end(now_s: float) -> None:
        ticks.append(now_s)
        if len(ticks) == 4:
            daemon.node.engagement.state = State.ENGAGED
            chronicle.step(now_s)

    run(daemon, 4, engaged_at_the_end)
    assert daemon.node.engagement.exit_condition
    assert chronicle.state().statistics.exits == {daemon.node.engagement.exit_condition: 1}
    assert [line for line in said if line.startswith("let go")] == [
        "let go, now standby: operator lost (ISO exit reason 1, operator lost)"
    ]


def test_a_button_that_is_refused_is_said_once_for_every_press(settings: CruiseSettings):
    said: list[str] = []
    daemon = Daemon(settings, Notifier(""), said.append)
    panel = Codec.load(settings.database, settings.can)
    released = dict.fromkeys(("cruise_enable", "cruise_set", "cruise_resume", "cruise_accelerate", "cruise_coast"), 0.0)

    def each_tick(now_s: float) -> None:
        ticks.append(now_s)
        held = 5 < len(ticks) % 20 < 15
        far.send(panel.encode("CCVS", {**released, "cruise_set": float(held)}, now_s))

    ticks: list[float] = []
    with open_bus(settings.can) as far:
        run(daemon, 40, each_tick)
    assert said == 2 * ["a button was refused: the main switch is off"]


@pytest.mark.parametrize("health", [BusHealth.OFF, BusHealth.LOST])
def test_without_a_bus_it_lets_go_and_does_not_come_back_by_itself(settings: CruiseSettings, health: BusHealth):
    lines: list[str] = []
    daemon = Daemon(settings, Notifier(""), lines.append)
    states = []

    def each_tick(now_s: float) -> None:
        ticks = len(states)
        if ticks == 1:
            daemon.node.engagement.state = State.ENGAGED
            daemon.bus.health = health
        if ticks == 4:
            daemon.bus.health = BusHealth.ACTIVE
        states.append(daemon.node.engagement.state)

    run(daemon, 10, each_tick)
    assert states[1] is State.ENGAGED
    assert states[3:] == [State.FAULT] * 7
    bus = [line for line in lines if line.startswith("bus")]
    assert [line.split(": ")[1] for line in bus] == [f"active -> {health}", f"{health} -> active"]
    assert [line for line in lines if line not in bus] == [
        "let go, now standby: operator lost (ISO exit reason 1, operator lost)",
        f"now fault, while a person drove: the bus is {health}",
    ]


def test_the_loop_keeps_its_pace(settings: CruiseSettings):
    daemon = Daemon(settings, Notifier(""), print)
    begin_s = time.monotonic()
    run(daemon, 20)
    assert time.monotonic() - begin_s >= 20 * daemon.node.period_s
