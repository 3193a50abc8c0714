"""Work in threads comes out as without them, in its order, with the first error."""

import threading

import pytest

from fit.threads import alone, each, parts


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


def test_parts_of_parts_and_work_beside_other_processes_stay_in_their_thread():
    def names(_):
        return threading.get_ident(), each(lambda _: threading.get_ident(), range(5))

    for own, of_parts in each(names, range(4)):
        assert of_parts == [own] * 5
    with alone():
        assert each(lambda _: threading.get_ident(), range(5)) == [threading.get_ident()] * 5


def test_the_first_that_fails_is_told():
    def fail(n):
        if n in (7, 2, 40):
            raise ValueError(str(n))
        return n

    with pytest.raises(ValueError, match=r"^2$"):
        each(fail, range(50))
