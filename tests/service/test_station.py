"""The station answers what other J1939 controllers ask it for, while the address is its own."""

import pytest

from cruise.can.frame import Frame
from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode
from cruise.service.station import Station

SOFTWARE, DM1, COMMAND = 0xFEDA, 0xFECA, 0xFF12  # PGNs


def asked(station: Station, *pgns: int) -> list[int]:
    """Return what it says in the third tick, having been asked before that: identifiers."""
    station.tick(0.0)  # the claim
    station.tick(0.05)
    for pgn in pgns:
        station.receive(Frame(arbitration_id=0x18EA1126, data=pgn.to_bytes(3, "little"), timestamp=0.06))
    return [frame.arbitration_id for frame in station.tick(0.1) if frame.is_extended_id]


@pytest.fixture
def station() -> Station:
    settings = service_settings.load(CONFIG / "cruise.yaml")
    return Station(CruiseNode.load(settings), settings.can)


def test_what_it_has_is_sent_and_what_it_has_not_is_refused(station: Station):
    assert asked(station, SOFTWARE, DM1, COMMAND) == [0x0CFF1211, 0x18E8FF11, 0x18FECA11]


def test_without_being_asked_it_says_its_own(station: Station):
    assert asked(station) == [0x0CFF1211]


def test_who_lost_its_address_refuses_nothing(station: Station):
    station.receive(Frame(arbitration_id=0x18EEFF11, data=bytes(8), timestamp=0.0))
    assert asked(station, SOFTWARE, DM1) == []
