"""Long channels piece by piece: what is made on the way to an answer then takes no memory of their length."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

PIECE = 2**17  # samples: a megabyte, which processors keep close


class Row(Protocol):
    """What an array of one dimension and a channel that stays in its file have in common."""

    @property
    def size(self) -> int:
        """Number of samples."""

    def __getitem__(self, index: slice, /) -> NDArray[np.float64]:
        """Return some of them."""


def pieces(size: int, overlap: int = 0, length: int = PIECE) -> Iterator[slice]:
    """Yield slices of `length` samples that cover `size`; all but the first begin `overlap` samples early."""
    for start in range(0, max(size - overlap, 0), length):
        yield slice(start, min(start + length + overlap, size))
