"""Ways to damage files, drawn by hypothesis, and what a reader may make of a damaged file."""

import copy
import multiprocessing
import resource
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

import fit.errors
import lpfcosim.errors

REFUSALS = (fit.errors.CalibrationError, lpfcosim.errors.RunError)
LONGEST = 2000  # letters of a sentence
TIME_LIMIT = 60  # s of CPU for one file
APART = (".h5", ".mat", ".fits")  # on which HDF5 may crash, and which astropy leaves open

#: Texts that have been the end of some program.
TEXTS = (
    "", "\x00", "\x1b[2J", "a\nb", "../../etc/passwd", "/dev/zero", "x" * 100_000, "1" * 5000, "nan", "1e999",
    "-1e308 m", "1 m^9^9^9", "{0.__class__}", "<script>alert(1)</script>", "\u202e", "\ud7ff\ue000", "１",
)  # fmt: skip
NUMBERS = (0, -1, 2**31, 2**63, 10**400, -0.0, 1e-320, -1e308, float("inf"), float("nan"))
scalars = st.booleans() | st.sampled_from(TEXTS) | st.sampled_from(NUMBERS) | st.text(max_size=20)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Draw bytes with some of them other, missing, twice or moved."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        at, origin = (draw(st.integers(0, len(data))) for _ in range(2))
        part = slice(at, at + draw(st.sampled_from((1, 4, 8, 64, len(data)))))
        size = len(data[part])
        other = bytes(data[origin : origin + size])
        data[part] = draw(st.sampled_from((b"", b"\x00" * size, b"\xff" * size, 2 * data[part], other)))
        if size == 1 and part.stop <= len(data):
            data[at] ^= 1 << draw(st.integers(0, 7))
    return bytes(data)


@st.composite
def restructured(draw: st.DrawFn, document: dict[str, Any]) -> dict[str, Any]:
    """Draw a document of tables and lists with values left out, renamed, exchanged or replaced."""
    document = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        places = list(_places(document))
        if not places:
            break
        holder, key = draw(st.sampled_from(places))
        old = holder.pop(key)
        change = draw(st.sampled_from(("remove", "rename", "repeat", "replace", "replace")))
        if change == "remove":
            continue
        if change == "rename" and isinstance(holder, dict):
            key = draw(st.sampled_from(TEXTS))
        other, name = draw(st.sampled_from(places))
        new = draw(values) if change == "replace" else old
        if change == "repeat":
            new = copy.deepcopy(other[name]) if _has(other, name) else 50 * [old]
        if isinstance(holder, dict):
            holder[key] = new
        else:
            holder.insert(key, new)
    return document


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    for key, inner in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(inner, dict | list):
            yield from _places(inner)


def _has(holder: Any, key: Any) -> bool:
    return key in holder if isinstance(holder, dict) else key < len(holder)


def check_reader(read: Callable[[Path], object], path: Path) -> None:
    """Fail unless a file is read, or refused in one sentence that names it."""
    try:
        _read_in_child(read, path) if path.suffix in APART else read(path)
    except REFUSALS as refusal:
        sentence = str(refusal)
        assert sentence.isprintable(), repr(sentence)
        assert len(sentence) <= LONGEST, sentence[:300]
        assert str(path.parent) in sentence, f"names no file: {sentence}"


def _read_in_child(read: Callable[[Path], object], path: Path) -> None:
    """Read a file in a process of its own, which may end before it has an answer."""
    limit = (resource.RLIMIT_CPU, (TIME_LIMIT, TIME_LIMIT))
    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(1, context, initializer=resource.setrlimit, initargs=limit)
    with pool, suppress(BrokenProcessPool):
        pool.submit(read, path).result()
