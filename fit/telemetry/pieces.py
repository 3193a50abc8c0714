"""Long channels piece by piece: what is made on the way to an answer then takes no memory of their length."""

from collections.abc import Iterator

PIECE = 2**17  # samples: a megabyte, which processors keep close


def pieces(size: int, overlap: int = 0) -> Iterator[slice]:
    """Yield slices that cover `size` samples; all but the first begin `overlap` samples early."""
    for start in range(0, max(size - overlap, 0), PIECE):
        yield slice(start, min(start + PIECE + overlap, size))
