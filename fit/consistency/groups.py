"""Runs that may be wrong for one reason, those of one authority or one alignment epoch, beside all others.

One fault that is in all of them moves them by one amount along one direction, the same as that of a cause of
a single run (`causes`). No run of them need stand out; T falls with the one column that they have in common.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.consistency.causes import ALIKE, DIRECTIONS, TOLD, Case, Direction
from fit.consistency.consistency import Regression, Squares

Array = NDArray[np.float64]
SECOND = 3.0  # sigma, by which a fault that runs share must stand out of them beyond any single one
#: By name, the runs of each group that may be wrong for one reason.
Groups = Collection[frozenset[str]]


@dataclass(frozen=True)
class Shift:
    """What one fault that runs have in common would explain.

    Attributes
    ----------
    members : tuple of int
        The runs, by number.
    direction : Direction
        In which it moves their parameters.
    column : ndarray, shape (N, 1)
        What it does to all that was measured.
    taken : Squares
        By how much T falls with it.
    left : Squares
        What then is left of T.
    """

    members: tuple[int, ...]
    direction: Direction
    column: Array
    taken: Squares
    left: Squares

    @property
    def excess(self) -> float:
        """What is left beyond noise."""
        return self.left.value - self.left.dof


def shifts(voices: Regression, groups: Groups) -> list[Shift]:
    """Return every fault that the runs of a group, two at least, may share and that others tell."""
    found = []
    for group in groups:
        members = tuple(i for i, v in enumerate(voices.voices) if v.name in group)
        if 1 < len(members) < len(voices.voices):
            found += of_members(voices, members)
    return found


def of_members(voices: Regression, members: Sequence[int]) -> list[Shift]:
    """Return every fault that runs, by number, may share and that others tell."""
    found, whole = [], voices.whole
    for direction in DIRECTIONS:
        column = sum(_columns(voices, members, direction), np.zeros((voices.z.size, 1)))
        taken = voices.of_columns(column)
        if taken.dof:
            left = Squares(whole.value - taken.value, whole.dof - taken.dof, whole.of_noise)
            found.append(Shift(tuple(members), direction, column, taken, left))
    return found


def _columns(voices: Regression, members: Sequence[int], direction: Direction) -> Iterator[Array]:
    """Yield what a fault does to each of some runs, by number."""
    for i in members:
        v = voices.voices[i]
        yield voices.column(i, v.answer @ v.gradient @ direction.of(v.theta, v.names))


def is_shared(voices: Regression, shift: Shift) -> bool:
    """Return whether more than one of the runs tells a fault: else it may be of that one as well."""
    each = _columns(voices, shift.members, shift.direction)
    return shift.taken.value > SECOND**2 + max(voices.of_columns(column).value for column in each)


def named_alike(voices: Regression, members: Sequence[int], case: Case, *, one_authority: bool) -> str:
    """Return what may be wrong with all of some runs, by number, to follow "perhaps".

    `case` is of one of them; without `one_authority` none is wrong in all of them, but their stiffness.
    """
    found = sorted(of_members(voices, members), key=lambda shift: shift.excess)
    told = []
    for shift in found[:TOLD]:
        if shift.excess < found[0].excess + ALIKE:
            words = shift.direction.words(*voices.amount(shift.column), case)
            told.append(words if one_authority else words.split(", or ")[-1])  # which tells the stiffness
    return ", or ".join(told).replace("its ", "their ")
