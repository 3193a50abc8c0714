"""Long channels piece by piece: what is made on the way to an answer then takes no memory of their length."""

from collections.abc import Iterator

PIECE = 2**17  # samples: a megabyte, which processors keep close


def pieces(size: int, overlap: int = 0, each: int = PIECE) -> Iterator[slice]:
    """Yield slices of `each` samples that cover `size`; all but the first begin `overlap` samples early."""
    for start in range(0, max(size - overlap, 0), each):
        yield slice(start, min(start + each + overlap, size))
