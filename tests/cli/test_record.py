"""What `cruise record` finds out before anything is written."""

import pytest

from cruise.cli import record as record_verb
from cruise.settings import SettingsError


def no_bus(settings: object) -> None:
    raise SettingsError("can0: is not there")


def test_a_ring_without_a_bus_leaves_nothing_behind(verb, tmp_path, monkeypatch):
    monkeypatch.setattr(record_verb, "open_bus", no_bus)
    code, _, err = verb("record", "--ring", "ring")
    assert code == 2
    assert "can0: is not there" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "said"), [(("a.txt",), "let the name end in .log"), (("--ring", "a.log"), "is a file; with --ring give")]
)
def test_where_it_writes_is_checked_before_the_bus(words, said, verb, tmp_path, monkeypatch):
    (tmp_path / "a.log").write_text("")
    monkeypatch.setattr(record_verb, "open_bus", no_bus)
    code, _, err = verb("record", *words)
    assert code == 2
    assert said in err
