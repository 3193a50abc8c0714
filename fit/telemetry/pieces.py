"""Long arrays in pieces that fit into the cache of a processor."""

from collections.abc import Iterator

PIECE = 2**17  # samples: a megabyte


def pieces(size: int, overlap: int = 0, length: int = PIECE) -> Iterator[slice]:
    """Yield slices of `length` samples that cover `size`; all but the first begin `overlap` samples early."""
    for start in range(0, max(size - overlap, 0), length):
        yield slice(start, min(start + length + overlap, size))
