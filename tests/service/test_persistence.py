"""What survives: whole at every instant, of this machine and model only, the one before where the newest is broken."""

import hashlib
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from cruise.cli.places import CONFIG
from cruise.estimation.estimator import Estimator, EstimatorSettings
from cruise.model import files
from cruise.service import persistence
from cruise.service.persistence import Keeper, Kept, StateFile, Statistics, fingerprint

KILLS, SEED = 200, 7
# Calls in one write after which the process may be gone: 4 opens, fsync, unlink, link, 2 renames, fsync, unlink; over
# another's 3 opens, fsync, 3 renames, fsync, unlink.
STEPS, STEPS_OVER_ANOTHERS = 11, 9


def state(starts: int) -> Kept:
    learned = {"theta": [float(starts)] * 12, "root": [[0.125] * 12] * 12, "turn": starts}
    return Kept(machine="A1", model="m", learned=learned, statistics=Statistics(starts=starts))


@pytest.fixture
def file(tmp_path: Path) -> StateFile:
    return StateFile(tmp_path / "state", "A1", "m")


def test_it_comes_back_as_it_was_and_the_one_before_stays(file: StateFile):
    assert file.read() == persistence.Found(None, ())
    file.write(state(1))
    file.write(state(2))
    assert file.read() == persistence.Found(state(2), ())
    assert StateFile(file.previous, "A1", "m").read().kept == state(1)


@pytest.mark.parametrize("at", [0, 30, 64, 65, 200])
def test_a_broken_file_gives_way_to_the_previous_one(file: StateFile, at: int):
    file.write(state(1))
    file.write(state(2))
    data = bytearray(file.path.read_bytes())
    data[at] ^= 1
    file.path.write_bytes(data)
    found = file.read()
    assert found.kept == state(1)
    assert "checksum" in found.problems[0]
    file.write(state(3))  # the broken one does not become the previous one
    assert StateFile(file.previous, "A1", "m").read().kept == state(1)
    assert file.read().kept == state(3)


@pytest.mark.parametrize("length", [0, 10, 65, 300])
def test_a_truncated_file_gives_way_to_the_previous_one(file: StateFile, length: int):
    file.write(state(1))
    file.write(state(2))
    file.path.write_bytes(file.path.read_bytes()[:length])
    assert file.read().kept == state(1)


def test_what_cannot_be_read_gives_way_to_the_previous_one_and_is_said_in_few_words(file: StateFile):
    file.write(state(1))
    file.path.rename(file.previous)
    file.path.mkdir()
    assert file.read() == persistence.Found(state(1), (f"{file.path}: cannot be read: Is a directory; it is not used",))


def names(file: StateFile) -> list[str]:
    return sorted(path.name for path in file.path.parent.iterdir())


def test_what_belongs_to_another_machine_is_not_used_and_stays_until_that_machine_is_back(file: StateFile):
    file.write(state(1))
    file.write(state(2))
    other = StateFile(file.path, "B2", "m")
    found = other.read()
    assert found.kept is None
    (said,) = found.problems
    assert said.startswith(f"{file.path.parent}: ")
    assert "is for machine A1, here is B2; it is not used, and kept as state.of-A1.v1" in said
    assert names(file) == ["state", "state.previous"], "reading changes nothing"
    for number in (3, 4):
        other.write(msgspec.structs.replace(state(number), machine="B2"))
    assert names(file) == ["state", "state.of-A1.v1", "state.previous"]
    assert other.read().problems == ()
    found = file.read()
    assert found.kept == state(2)
    assert "is for machine B2" in found.problems[0]
    assert "state.of-A1.v1: this machine is back" in found.problems[1]
    file.write(state(5))
    assert names(file) == ["state", "state.of-B2.v1"]
    assert file.read() == persistence.Found(state(5), ())
    assert other.read().kept == msgspec.structs.replace(state(4), machine="B2")


def test_of_each_machine_one_file_stays(file: StateFile):
    for number in range(8):
        machine = "AB"[number // 2 % 2]
        of_this = StateFile(file.path, machine, "m")
        of_this.write(msgspec.structs.replace(state(number), machine=machine))
    assert names(file) == ["state", "state.of-A.v1", "state.previous"]


@pytest.mark.parametrize("machine", ["../0815/7", "Mähdrescher " + 400 * "9"])
def test_whatever_a_machine_is_called_its_state_is_kept_in_the_folder(file: StateFile, machine: str):
    named = StateFile(file.path, machine, "m")
    named.write(msgspec.structs.replace(state(1), machine=machine))
    file.write(state(2))
    assert len(names(file)) == 2
    assert named.read().kept == msgspec.structs.replace(state(1), machine=machine)


def test_a_previous_one_of_another_machine_stays_too(file: StateFile):
    file.write(state(1))
    file.path.rename(file.previous)
    other = StateFile(file.path, "B2", "m")
    for number in (3, 4):
        other.write(msgspec.structs.replace(state(number), machine="B2"))
    assert file.read().kept == state(1)


def test_with_another_model_only_what_was_learned_is_forgotten(file: StateFile):
    slower = {"engagement": {"speed_max_mps": 3.0}}
    file.write(msgspec.structs.replace(state(5), settings=slower))
    found = StateFile(file.path, "A1", "other").read(lambda kept: pytest.fail("nothing that was learned is left"))
    assert found.kept is not None
    assert (found.kept.model, found.kept.learned) == ("other", {})
    assert found.kept.settings == slower
    assert found.kept.statistics.starts == 5
    assert "what was learned is for model m" in found.problems[0]


def test_another_version_is_not_used_and_stays_for_a_program_that_knows_it(file: StateFile):
    body = b'{"machine":"A1","version":2,"what":"nobody knows yet"}'
    written = hashlib.sha256(body).hexdigest().encode() + b"\n" + body
    file.path.write_bytes(written)
    found = file.read()
    assert found.kept is None
    assert "is for version 2, here is 1; it is not used, and kept as state.of-A1.v2" in found.problems[0]
    file.write(state(1))
    assert file.path.with_name("state.of-A1.v2").read_bytes() == written
    assert file.read() == persistence.Found(state(1), ())


def test_what_the_estimator_calls_unsafe_is_refused(file: StateFile):
    estimator = Estimator(files.load(CONFIG / "factory_model.yaml"), EstimatorSettings())
    good = msgspec.structs.replace(state(1), learned=estimator.save())
    runaway = {**estimator.save(), "theta": [5.0] * len(estimator.factory.theta)}
    file.write(good)
    file.write(msgspec.structs.replace(state(2), learned=runaway))
    found = file.read(lambda kept: estimator.restore(kept.learned))
    assert found.kept == msgspec.structs.replace(state(2), learned=good.learned)
    assert "not those of a stable drive" in found.problems[0]


def test_where_nothing_learned_is_let_pass_the_rest_stays(file: StateFile):
    slower = {"engagement": {"speed_max_mps": 3.0}}
    file.write(state(4))
    file.write(msgspec.structs.replace(state(5), settings=slower))

    def never(kept: Kept) -> None:
        raise ValueError("gain_range")

    found = file.read(never)
    assert found.kept == msgspec.structs.replace(state(5), settings=slower, learned={})
    assert len(found.problems) == 2


def test_the_fingerprint_tells_models_apart():
    model = files.load(CONFIG / "factory_model.yaml")
    assert fingerprint(model) == fingerprint(files.load(CONFIG / "factory_model.yaml"))
    assert fingerprint(model) != fingerprint(model.with_theta([1.01 * value for value in model.theta]))


def forked(work: Callable[[], None]) -> int:
    """Run `work` in a process of its own and return its number."""
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return child


def write_on(file: StateFile, told: int, number: int) -> None:
    """Write states with rising numbers and tell of each one that has been written."""
    while True:
        number += 1
        file.write(state(number))
        os.write(told, f"{number}\n".encode())


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_killed_at_random_instants_nothing_is_lost_or_broken(file: StateFile):
    draw = random.Random(SEED)
    written = 0
    for kill in range(KILLS):
        hear, told = os.pipe()
        child = forked(lambda told=told, number=written: write_on(file, told, number))
        os.close(told)
        with os.fdopen(hear) as lines:
            acknowledged = int(lines.readline())  # it is at work
            time.sleep(draw.uniform(0.0, 0.003))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            acknowledged = max([acknowledged, *(int(line) for line in lines)])
        found = file.read()
        assert found.kept is not None, f"kill {kill}: {found.problems}"
        assert not found.problems, f"kill {kill}: {found.problems}"
        assert acknowledged <= found.kept.statistics.starts <= acknowledged + 1
        assert found.kept == state(found.kept.statistics.starts)
        written = found.kept.statistics.starts


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("step", range(STEPS))
def test_gone_after_any_step_of_a_write_it_is_the_old_or_the_new_one(file: StateFile, step: int, monkeypatch):
    file.write(state(1))
    file.write(state(2))
    die_in_a_write(file, step, monkeypatch)
    found = file.read()
    assert found.kept in (state(2), state(3))
    assert not found.problems
    file.write(state(4))
    assert file.read().kept == state(4)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("step", range(STEPS_OVER_ANOTHERS))
def test_gone_after_any_step_of_a_write_over_another_machines_state_both_are_whole(
    file: StateFile, step: int, monkeypatch
):
    file.write(state(1))
    other = StateFile(file.path, "B2", "m")
    for number in (6, 7):
        other.write(msgspec.structs.replace(state(number), machine="B2"))
    die_in_a_write(file, step, monkeypatch)
    assert file.read().kept in (state(1), state(3))
    assert other.read().kept == msgspec.structs.replace(state(7), machine="B2")


def die_in_a_write(file: StateFile, step: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write state 3 in a process that is gone after a step of it."""
    taken = 0

    def leave(real: Callable) -> Callable:
        def call(*arguments, **options):
            nonlocal taken
            result = real(*arguments, **options)
            taken += 1
            if taken > step:
                os.kill(os.getpid(), signal.SIGKILL)
            return result

        return call

    def work() -> None:
        for place, name in ((os, "fsync"), (os, "link"), (Path, "replace"), (Path, "unlink"), (Path, "open")):
            monkeypatch.setattr(place, name, leave(getattr(place, name)))
        file.write(state(3))

    _, status = os.waitpid(forked(work), 0)
    assert os.WIFSIGNALED(status), "the write has fewer steps than this test thinks"


def test_the_keeper_writes_the_newest_and_says_what_is_wrong(file: StateFile, tmp_path: Path):
    keeper = Keeper(file)
    for number in range(1, 50):
        keeper.keep(state(number))
    keeper.close()
    assert file.read().kept == state(49)
    nowhere = Keeper(StateFile(tmp_path / "no" / "state", "A1", "m"))
    assert nowhere.keep(state(1)).wait(5.0)
    assert nowhere.problem, "once that is over, it is known what became of it"
    nowhere.close()
    assert "No such file" in nowhere.problem


def test_the_keeper_outlives_whatever_goes_wrong(file: StateFile, monkeypatch: pytest.MonkeyPatch):
    def broken(self: StateFile, kept: Kept) -> None:
        raise TypeError("on purpose")

    keeper = Keeper(file)
    with monkeypatch.context() as patched:
        patched.setattr(StateFile, "write", broken)
        assert keeper.keep(state(1)).wait(5.0)
    assert "TypeError: on purpose" in keeper.problem
    assert keeper.keep(state(2)).wait(5.0)
    keeper.close()
    assert not keeper.problem
    assert file.read().kept == state(2)
