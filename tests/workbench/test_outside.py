"""A workbench that others than this machine may reach."""

from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

pytest.importorskip("nicegui", reason="the extra workbench is not installed")
pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

from cruise.cli.workbench import _authority
from cruise.workbench.guard import cookie_of
from tools.page.served import served

TOKEN = "a token+of/the=test"


def answer(address: str, cookie: str = "") -> int:
    """The status of a request."""
    try:
        with urlopen(Request(address, headers={"Cookie": cookie}), timeout=20) as found:
            return found.status
    except HTTPError as error:
        return error.code


def test_bound_to_every_address_it_asks_everybody_for_the_token(cache, tmp_path, monkeypatch):
    monkeypatch.setenv("CRUISE_TOKEN", TOKEN)
    with served(cache, tmp_path / "said.txt", ["--host", "0.0.0.0"]) as address:
        assert answer(address) == 401
        assert answer(f"{address}/?token=guess") == 401
        assert answer(f"{address}/_nicegui/client/1/upload/1") == 401
        assert answer(_printed(tmp_path / "said.txt")) == 200
        assert answer(address, cookie_of(TOKEN, int(address.rpartition(":")[2]))) == 200


@pytest.mark.parametrize("horizon", ["nan", "-1", "0"])
def test_a_horizon_that_is_no_time_is_refused(verb, horizon):
    code, _, said = verb("workbench", "--no-browser", "--horizon", horizon)
    assert code != 0
    assert "give a time in s above 0" in " ".join(said.split())


def test_an_address_of_ipv6_stands_in_brackets():
    assert _authority("::1", 8080) == "[::1]:8080"
    assert _authority("10.0.0.7", 8080) == "10.0.0.7:8080"


def _printed(said: Path) -> str:
    """The address that the workbench printed, as this machine reaches it."""
    return said.read_text().partition("workbench on ")[2].split()[0].replace("0.0.0.0", "127.0.0.1")
