"""Work on all cores gives what work on one gives, in the same order, and leaves nothing behind."""

import multiprocessing
import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from cruise.validation.side_by_side import side_by_side


@pytest.fixture(scope="module")
def own_core() -> None:
    """None: here all of them are asked for."""


several = pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two cores")


def test_results_come_in_the_order_of_the_items():
    known = 3  # a child has what this process has: nothing of it need be picklable
    assert list(side_by_side(lambda item: (time.sleep(0.02 * (5 - item)), known * item)[1], range(5))) == [
        3 * item for item in range(5)
    ]
    assert list(side_by_side(str, [])) == []


@several
def test_the_work_is_done_in_children():
    assert os.getpid() not in set(side_by_side(lambda _: os.getpid(), range(4)))
    assert list(side_by_side(lambda _: os.getpid(), [0])) == [os.getpid()]  # one item is worth no child


def test_an_error_is_raised_here():
    def work(item: int) -> float:
        return 1.0 / item

    with pytest.raises(ZeroDivisionError):
        list(side_by_side(work, [1, 0, 2]))
    assert list(side_by_side(work, [1, 2])) == [1.0, 0.5]


def _in_a_daemon(queue) -> None:
    queue.put(set(side_by_side(lambda _: os.getpid(), range(3))) == {os.getpid()})


def test_where_no_children_are_allowed_the_work_is_done_here():
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    daemon = context.Process(target=_in_a_daemon, args=(queue,), daemon=True)
    daemon.start()
    assert queue.get(timeout=60.0)
    daemon.join()


def _hand_over(sender, _: int) -> None:
    sender.send(os.getpid())
    time.sleep(60.0)


def _parent(sender) -> None:
    list(side_by_side(partial(_hand_over, sender), range(2)))


@several
def test_children_are_gone_with_a_parent_that_is_killed():
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    parent = context.Process(target=_parent, args=(sender,))
    parent.start()
    children = [receiver.recv(), receiver.recv()]
    os.kill(parent.pid or 0, signal.SIGKILL)
    parent.join()
    until = time.monotonic() + 10.0
    while any(runs(child) for child in children) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(runs(child) for child in children)


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
