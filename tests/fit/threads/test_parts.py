"""Work in threads comes out as without them, in its order, with the first error."""

import threading
import time

import pytest

from fit.threads import alone, cached_property, each, following, parts


@pytest.fixture(autouse=True)
def three_processors(monkeypatch):
    monkeypatch.setattr(parts, "processors", lambda: 3)


def test_results_come_in_the_order_of_the_items():
    turn = threading.Barrier(3, timeout=30)

    def late(n):
        turn.wait()  # three at once, or never
        return n * n

    assert each(late, range(3)) == [0, 1, 4]
    assert each(lambda n: -n, range(100)) == [-n for n in range(100)]
    assert each(late, []) == []


def test_the_largest_are_begun_first_and_come_in_their_order():
    turn, begun = threading.Barrier(3, timeout=30), []

    def late(n):
        begun.append(n)
        turn.wait()
        return -n

    assert each(late, [2, 6, 1, 5, 3, 4], size=float) == [-2, -6, -1, -5, -3, -4]
    assert sorted(begun[:3]) == [4, 5, 6]


def test_who_has_nothing_left_helps_with_the_parts_of_another_part():
    together = threading.Barrier(3, timeout=30)

    def part(long):
        return each(lambda _: together.wait(), range(3)) if long else []  # three at once, or never

    assert sorted(each(part, [True, False])[0]) == [0, 1, 2]


def test_no_more_threads_are_at_work_than_there_are_processors():
    busy, most, lock = 0, 0, threading.Lock()

    def least(_):
        nonlocal busy, most
        with lock:
            busy += 1
            most = max(most, busy)
        time.sleep(0.002)
        with lock:
            busy -= 1

    each(lambda n: each(least, range(n)), [1, 30, 2, 3, 1, 1, 20, 1])
    assert most <= 3
    assert parts._CREW.hire()  # everybody has left
    parts._CREW.change(-1)


def test_work_beside_other_processes_stays_in_its_thread():
    with alone():
        assert each(lambda _: threading.get_ident(), range(5)) == [threading.get_ident()] * 5


def test_whoever_does_a_part_it_is_told_of():
    told = []
    with following(told.append):
        each(lambda n: each(float, range(n)), range(8))
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert len(told) == 8  # parts of parts are nobody's business


def test_a_property_may_be_shared_among_threads():
    class Node:
        def __init__(self, inner):
            self.inner = inner

        @cached_property
        def depth(self):
            return 1 + max(each(lambda node: node.depth, self.inner), default=0)

    leaf = Node([])
    assert Node([Node([leaf] * 3), Node([leaf] * 3), leaf]).depth == 3
    assert isinstance(Node.depth, cached_property)


def test_the_first_that_fails_is_told():
    def fail(n):
        if n in (7, 2, 40):
            raise ValueError(str(n))
        return n

    with pytest.raises(ValueError, match=r"^2$"):
        each(fail, range(50))
    with pytest.raises(ValueError, match=r"^2$"):
        each(fail, range(50), size=float)


def test_an_interrupt_ends_all_of_it():
    begun = []

    def stop(n):
        begun.append(n)
        time.sleep(0.01)
        if n == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        each(stop, range(1000))
    assert len(begun) < 100
