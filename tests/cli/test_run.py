"""`cruise run` as a process: signals, what its status says, and settings that change while it runs."""

import errno
import io
import os
import signal
import sys

import pytest

from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode
from cruise.settings import SettingsError


def test_run_stops_with_neutral_on_a_signal(verb, tmp_path, monkeypatch):
    from cruise.can.bus import LocalBus
    from cruise.cli import run

    sent = []
    monkeypatch.setattr(LocalBus, "send", lambda self, frame: sent.append(frame))
    ticks = iter(range(10))
    monkeypatch.setattr(run.Running, "__call__", lambda self: next(ticks, None) is not None)
    text = (CONFIG / "cruise.yaml").read_text().replace("bus: socketcan", "bus: virtual")
    for name in ("factory_model.yaml", "cruise.dbc", "cruise.eds"):
        text = text.replace(f" {name}", f" {CONFIG / name}")
    (tmp_path / "cruise.yaml").write_text(text + f"\ndictionary: {CONFIG / 'cruise.eds'}\n")
    code, _, err = verb("run", tmp_path / "cruise.yaml")
    assert code == 0
    assert "neutral sent" in err
    assert len(sent) > 10


def test_settings_are_checked_without_a_bus(verb, tmp_path, monkeypatch):
    from cruise.cli import run

    def opened(*asked: object) -> None:
        raise AssertionError("no bus is to be opened")

    monkeypatch.setattr(run, "Daemon", opened)
    code, out, _ = verb("run", CONFIG / "cruise.yaml", "--check")
    assert code == 0
    assert f"{CONFIG / 'cruise.yaml'}: good: drives on socketcan can0 with a command every 0.05 s" in out
    assert f"by {CONFIG / 'factory_model.yaml'}" in out
    (tmp_path / "cruise.yaml").write_text((CONFIG / "cruise.yaml").read_text())
    code, _, err = verb("run", tmp_path / "cruise.yaml", "--check")
    assert code != 0
    assert "cruise.eds: cannot be read" in err


def test_the_status_says_why_it_let_go_and_every_refusal(capsys):
    from cruise.cli.run import Lines
    from cruise.control.engagement import ExitReason, State

    settings = service_settings.load(CONFIG / "cruise.yaml")
    node = CruiseNode.load(settings)
    lines, engagement = Lines(node), node.engagement

    def printed(now_s: float) -> str:
        lines(now_s)
        return capsys.readouterr().out

    engagement.state = State.ENGAGED
    assert "let go" not in printed(0.0)
    engagement.state, engagement.exit_condition, engagement.exit_reason = State.OVERRIDDEN, "brake", ExitReason.OVERRIDE
    assert "let go: brake (ISO exit reason 3, override)" in printed(0.1)
    for press in (1, 2):
        engagement.refused, engagement.refusals = "no gear is engaged", press
        assert "refused: no gear is engaged" in printed(0.2 * press)
        assert printed(0.2 * press + 0.1) == ""


def test_a_log_on_a_full_disk_ends_no_drive_and_one_that_nobody_reads_does(monkeypatch):
    from cruise.cli.run import Lines

    class Broken(io.StringIO):
        number = errno.ENOSPC

        def write(self, text: str) -> int:
            raise OSError(self.number, os.strerror(self.number))

    lines = Lines(CruiseNode.load(service_settings.load(CONFIG / "cruise.yaml")))
    monkeypatch.setattr(sys, "stdout", Broken())
    lines(0.0)
    monkeypatch.setattr(Broken, "number", errno.EPIPE)
    with pytest.raises(BrokenPipeError):
        lines(20.0)


def _while_it_runs(monkeypatch, happens) -> None:
    """Have something happen whenever the service asks whether it goes on; the ninth time it is stopped."""
    from cruise.cli import run

    calls = 0

    def goes_on(running) -> bool:
        nonlocal calls
        calls += 1
        happens(running, calls)
        if calls == 9:
            running._stop(2, None)
        return not (running.stopped or running.reload)

    monkeypatch.setattr(run.Running, "__call__", goes_on)


def test_run_reads_its_settings_again_and_keeps_the_old_ones_where_they_are_wrong(verb, tmp_path, monkeypatch):
    config = tmp_path / "cruise.yaml"
    text = f"model: {CONFIG / 'factory_model.yaml'}\ndatabase: {CONFIG / 'cruise.dbc'}\ncan: {{bus: virtual}}\n"
    config.write_text(text)

    def happens(running, calls: int) -> None:
        if calls == 3:
            config.write_text(text + "control: {frame_s: 0.1}\n")
        if calls == 6:
            config.write_text(text + "misspelt: 1\n")
        if calls in (3, 6):
            running._reload(1, None)

    _while_it_runs(monkeypatch, happens)
    code, out, err = verb("run", config, "--quiet")
    assert code == 0
    assert [line.split()[-2] for line in out.splitlines() if "command every" in line] == ["0.05", "0.1", "0.1"]
    assert err.count("neutral sent") == 3
    assert "the settings stay as they were" in err
    assert "misspelt" in err


def test_after_a_signal_the_run_goes_on_until_the_settings_are_known_to_be_good(verb, tmp_path, monkeypatch):
    from cruise.cli import run

    config = tmp_path / "cruise.yaml"
    text = f"model: {CONFIG / 'factory_model.yaml'}\ndatabase: {CONFIG / 'cruise.dbc'}\ncan: {{bus: virtual}}\n"
    config.write_text(text)
    said, signals, calls = [], 0, 0
    monkeypatch.setattr(run, "say", said.append)

    def goes_on(running) -> bool:
        nonlocal signals, calls
        calls += 1
        assert calls < 1000
        bad = sum("the settings stay as they were" in line for line in said)
        if signals < 3 and bad == signals:
            text_now = [text + "misspelt: 1\n", text.replace("factory", "no"), text + "control: {frame_s: 0.1}\n"]
            config.write_text(text_now[signals])
            signals += 1
            os.kill(os.getpid(), signal.SIGHUP)
        if running.reload:
            signals += 1
        elif signals > 3:
            running._stop(2, None)
        return not (running.stopped or running.reload)

    monkeypatch.setattr(run.Running, "__call__", goes_on)
    code, out, err = verb("run", config, "--quiet")
    assert code == 0
    assert [line.split()[-2] for line in out.splitlines() if "command every" in line] == ["0.05", "0.1"]
    assert err.count("neutral sent") == 2
    assert "misspelt" in said[0]
    assert "no_model.yaml" in said[1]
    assert len(said) == 2


def test_run_goes_on_as_before_where_files_or_bus_are_gone_when_it_reads_again(verb, tmp_path, monkeypatch):
    from cruise.service import daemon

    config, model = tmp_path / "cruise.yaml", tmp_path / "model.yaml"
    model.write_bytes((CONFIG / "factory_model.yaml").read_bytes())
    config.write_text(f"model: {model}\ndatabase: {CONFIG / 'cruise.dbc'}\ncan: {{bus: virtual}}\n")
    open_bus = daemon.open_bus

    def no_bus(*given, **named):
        raise SettingsError("no such interface")

    def happens(running, calls: int) -> None:
        if calls == 3:
            model.write_text("half of a model file")
        if calls == 5:
            model.write_bytes((CONFIG / "factory_model.yaml").read_bytes())
            monkeypatch.setattr(daemon, "open_bus", no_bus)
        if calls == 8:
            monkeypatch.setattr(daemon, "open_bus", open_bus)
        if calls in (3, 6):
            running._reload(1, None)

    _while_it_runs(monkeypatch, happens)
    code, out, err = verb("run", config)
    assert code == 0
    assert out.count("command every 0.05 s") == 3
    assert err.count("the settings stay as they were") == 2
    assert "model.yaml" in err
    assert "no such interface" in err
    assert err.count("neutral sent") == 3


def test_run_goes_on_with_what_a_master_writes(verb, tmp_path, monkeypatch):
    from cruise.can.bus import open_bus
    from cruise.can.frame import Frame
    from cruise.can.settings import CanSettings

    config = tmp_path / "cruise.yaml"
    config.write_text(
        f"model: {CONFIG / 'factory_model.yaml'}\ndatabase: {CONFIG / 'cruise.dbc'}\n"
        f"dictionary: {CONFIG / 'cruise.eds'}\ncan: {{bus: virtual}}\ncanopen: {{node_id: 17}}\n"
    )
    text = b"control: {frame_s: 0.1}"
    segments = [text[k : k + 7] for k in range(0, len(text), 7)]
    requests = [b"\x21\x00\x2f\x00" + len(text).to_bytes(4, "little")]
    for k, part in enumerate(segments):  # CiA 301, 7.2.4.3.4: toggle bit, bytes not used, last one
        command = k % 2 << 4 | 7 - len(part) << 1 | (k == len(segments) - 1)
        requests.append(bytes([command]) + part.ljust(7, b"\x00"))

    def happens(running, calls: int) -> None:
        if calls == 3:
            with open_bus(CanSettings()) as master:
                for request in requests:
                    master.send(Frame(0.0, 0x611, is_extended_id=False, data=request))

    _while_it_runs(monkeypatch, happens)
    code, out, err = verb("run", config, "--quiet")
    assert code == 0
    assert [line.split()[-2] for line in out.splitlines() if "command every" in line] == ["0.05", "0.1"]
    assert err.count("neutral sent") == 2
