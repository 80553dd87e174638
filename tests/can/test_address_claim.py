"""The address claim against the rules of J1939-81, by hand-made frames of another controller"""

import pytest

from cruise.can.address_claim import WAIT_S, AddressClaim, Claim, name_of
from cruise.can.frame import Frame
from cruise.can.settings import NameSettings

NAME = 0x2000_0E00_0020_0007


def claimed(source: int, name: int, time_s: float = 1.0) -> Frame:
    return Frame(arbitration_id=0x18EEFF00 | source, data=name.to_bytes(8, "little"), timestamp=time_s)


def request(destination: int, pgn: int = 0xEE00) -> Frame:
    return Frame(arbitration_id=0x18EA0026 | destination << 8, data=pgn.to_bytes(3, "little"), timestamp=2.0)


def held(address: int = 0x11) -> AddressClaim:
    end = AddressClaim(address, NAME)
    end.tick(0.0)
    end.tick(WAIT_S + 0.01)
    assert end.claim is Claim.HELD
    return end


def sent(end: AddressClaim, now_s: float) -> list[tuple[int, int]]:
    return [(frame.arbitration_id, int.from_bytes(frame.data, "little")) for frame in end.tick(now_s)]


def test_the_name_has_its_parts_where_the_standard_has_them():
    name = NameSettings(
        identity_number=1, manufacturer_code=2, ecu_instance=3, function_instance=4, function=5, vehicle_system=6,
        vehicle_system_instance=7, industry_group=1,
    )  # fmt: skip
    assert f"{name_of(name):064b}" == "0001011100001100000001010010001100000000010" + f"{1:021b}"


def test_the_claim_comes_first_and_an_assigned_address_counts_at_once():
    end = AddressClaim(0x11, NAME)
    assert sent(end, 0.0) == [(0x18EEFF11, NAME)]
    assert sent(end, 0.05) == []
    assert end.claim is Claim.HELD


def test_an_address_that_anybody_may_take_counts_after_a_quarter_of_a_second():
    end = AddressClaim(0x90, NAME)
    end.tick(0.0)
    end.tick(0.24)
    assert end.claim is Claim.WAITING
    end.tick(0.26)
    assert end.claim is Claim.HELD


def test_on_another_bus_it_is_claimed_anew_even_where_it_was_lost():
    end = held()
    end.receive(claimed(0x11, NAME - 1))
    assert end.claim is Claim.LOST
    end.begin()
    assert sent(end, 5.0) == [(0x18EEFF11, NAME)]
    assert sent(end, 5.05) == []
    assert end.claim is Claim.HELD


@pytest.mark.parametrize("destination", [0xFF, 0x11])
def test_a_request_is_answered(destination: int):
    end = held()
    end.receive(request(destination))
    assert sent(end, 2.05) == [(0x18EEFF11, NAME)]


@pytest.mark.parametrize("asked", [request(0x12), request(0xFF, 0xFECA)])
def test_a_request_for_another_is_not(asked: Frame):
    end = held()
    end.receive(asked)
    assert sent(end, 2.05) == []


def test_a_larger_name_is_told_that_the_address_is_taken():
    end = held()
    end.receive(claimed(0x11, NAME + 1))
    assert sent(end, 1.05) == [(0x18EEFF11, NAME)]
    assert end.claim is Claim.HELD


@pytest.mark.parametrize("name", [NAME - 1, NAME, 0])
def test_a_smaller_name_takes_the_address_for_good(name: int):
    end = held()
    end.receive(claimed(0x11, name))
    assert end.claim is Claim.LOST
    frames = [frame for k in range(10) for frame in sent(end, 1.0 + 0.05 * k)]
    assert frames == [(0x18EEFFFE, NAME)], "cannot claim, once"
    end.receive(request(0xFF))
    assert [frame for k in range(10) for frame in sent(end, 2.0 + 0.05 * k)] == [(0x18EEFFFE, NAME)]
    end.receive(request(0x11))
    assert [frame for k in range(10) for frame in sent(end, 2.5 + 0.05 * k)] == [], "that is the winner's to answer"
    end.receive(claimed(0x11, NAME + 1, 3.0))
    assert end.claim is Claim.LOST


def test_other_addresses_and_short_frames_do_not_matter():
    end = held()
    end.receive(claimed(0x12, 0))
    end.receive(Frame(arbitration_id=0x18EEFF11, data=b"\x00" * 7))
    end.receive(Frame(arbitration_id=0x18EEFF11, is_error_frame=True))
    assert end.claim is Claim.HELD
    assert sent(end, 2.0) == []
