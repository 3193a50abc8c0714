"""Damaged and hostile input, made from good input with a random generator, and a guard to try it under.

    pytest -m '' tests/hostile/test_mutations_*.py --cases 10000    the long run, shared by kinds

Of whatever it is given, a reader says one sentence (`InputError`, `FitError`, `RunError`, none longer than
`LONGEST`), or succeeds; it raises nothing else, ends in time, and takes no more memory than allowed.
"""

import copy
import math
import os
import random
import resource
import signal
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import fit.errors
import lpfcosim.errors

LONGEST = 2000  # letters of a sentence
PATIENCE = 60  # s for a case; what takes longer hangs

REFUSALS = (fit.errors.CalibrationError, lpfcosim.errors.RunError)

#: What stands in the place of a value; every one of them has been the end of some program.
TEXTS = (
    "", " ", "\x00", "\x1b[2J", "a\nb", "../../etc/passwd", "/dev/zero", "con", "." * 300, "x" * 100_000,
    "nan", "1e999", "-1e308 m", "1 m^9^9^9", "{}", "%s%n", "{0.__class__}", "<script>alert(1)</script>",
    "\u202e", "\ud7ff\ue000", "💥" * 50, "1" * 5000, "None", "true", "0x10", "1_0", "１", "e\u0301",
)  # fmt: skip
NUMBERS = (
    0, -1, 1, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.0, -0.0, 1e-320, 1e308, -1e308, math.inf, math.nan,
)  # fmt: skip


_SYNTAX = (
    "=", "[", "]", "[[", '"', '"""', "{", "}", ".", ".a" * 500, "[" * 2000, "\\u0000", "true", "1979-05-27",
)  # fmt: skip


class HangError(BaseException):
    """A case took too long; no handler of the code under test takes it for an error of its own."""


@contextmanager
def guarded(seconds: int = PATIENCE) -> Iterator[None]:
    """End what does not end by itself."""

    def end(*_):
        raise HangError

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def survives(reader: Callable[[], object], path: Path | None, case: object) -> str | None:
    """Return the sentence with which a reader refuses its input, None if it succeeds; fail otherwise."""
    try:
        with guarded():
            reader()
    except REFUSALS as refusal:
        check_sentence(str(refusal), path, case)
        return str(refusal)
    except HangError:
        raise AssertionError(f"{case}: hangs") from None
    except Exception as error:
        raise AssertionError(f"{case}: {type(error).__name__}: {error}") from error
    return None


def check_sentence(sentence: str, path: Path | None, case: object) -> None:
    """Fail unless a refusal is one line for a terminal that names the file, if there is one."""
    assert sentence.isprintable(), f"{case}: {sentence!r}"
    assert len(sentence) <= LONGEST, f"{case}: {len(sentence)} letters: {sentence[:300]}"
    assert path is None or str(path.parent) in sentence, f"{case}: names no file: {sentence}"


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Return bytes with some of them other, missing, twice or moved."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 5, 30))):
        if not data:
            break
        at = rng.randrange(len(data))
        how = rng.randrange(7)
        if how <= 1:
            data[at] ^= 1 << rng.randrange(8)
        elif how == 2:
            data[at] = rng.choice((0, 0xFF, 0x7F, 0x80, rng.randrange(256)))
        elif how == 3:
            del data[at : at + rng.choice((1, 4, 100, len(data)))]
        elif how == 4:
            size = rng.choice((1, 4, 8, 64))
            data[at : at + size] = rng.choice((b"\xff", b"\x00", b"\x7f")) * size
        elif how == 5:
            data[at:at] = bytes(data[at : at + rng.choice((1, 8, 200))])
        else:
            start = rng.randrange(len(data))
            size = rng.choice((4, 8, 16))
            data[at : at + size] = data[start : start + size]
    return bytes(data)


def swapped(text: str, rng: random.Random) -> str:
    """Return text with words exchanged, left out, repeated or replaced by hostile ones."""
    lines = text.splitlines()
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(lines))
        how = rng.randrange(6)
        if how == 0:
            lines.insert(at, lines[rng.randrange(len(lines))])
        elif how == 1 and len(lines) > 1:
            del lines[at]
        elif how == 2:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        else:
            words = lines[at].split(" ")
            place = rng.randrange(len(words))
            words[place] = rng.choice(
                (str(rng.choice(NUMBERS)), rng.choice(TEXTS), rng.choice(words), *_SYNTAX)
            )
            lines[at] = " ".join(words)
    return "\n".join(lines)


def hostile(rng: random.Random, depth: int = 0) -> object:
    """Return a value of some type, be it a table or list of such."""
    how = rng.randrange(8)
    if how == 0 and depth < 3:
        return {
            rng.choice((*TEXTS[:16], "a", "name")): hostile(rng, depth + 1) for _ in range(rng.randrange(4))
        }
    if how == 1 and depth < 3:
        return [hostile(rng, depth + 1) for _ in range(rng.randrange(4))]
    if how == 2:
        return rng.choice((True, False))
    return rng.choice(TEXTS if how < 5 else NUMBERS)


def restructured(document: dict, rng: random.Random) -> dict:
    """Return a document of tables and lists with values of it replaced, left out, renamed or moved."""
    places = list(_places(document))
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        holder, key = rng.choice(places)
        if not _is_there(holder, key):
            continue
        how = rng.randrange(6)
        if how == 0:
            del holder[key]
        elif how == 1 and isinstance(holder, dict):
            holder[rng.choice(TEXTS)] = holder.pop(key)
        elif how == 2:
            other, place = rng.choice(places)
            if _is_there(other, place):
                holder[key] = copy.deepcopy(other[place])
        elif how == 3 and isinstance(holder[key], list):
            holder[key] = holder[key] * rng.choice((0, 2, 50))
        else:
            holder[key] = hostile(rng)
    return document


def _places(value: object) -> Iterator[tuple]:
    for key, inner in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(inner, dict | list):
            yield from _places(inner)


def _is_there(holder: dict | list, key: str | int) -> bool:
    return key in holder if isinstance(holder, dict) else key < len(holder)


def raw_archive(path: Path, entries: list[tuple[str, bytes]], **fields: int) -> Path:
    """Write a zip archive as it is told, be its names as they may; `fields` replace those of every entry.

    Fields are size (the declared one), flags, method, crc and mode (the Unix one).
    """
    body, directory = b"", b""
    for name, content in entries:
        packed = zlib.compress(content)[2:-4]
        encoded = name.encode("utf-8", "surrogatepass")
        common = struct.pack(
            "<HHHHHIIIHH", 20, 0x800 | fields.get("flags", 0), fields.get("method", zipfile.ZIP_DEFLATED), 0,
            0x21, fields.get("crc", zlib.crc32(content)), len(packed), fields.get("size", len(content)),
            len(encoded), 0,
        )  # fmt: skip
        mode = fields.get("mode", 0o100644) << 16
        directory += (
            b"PK\x01\x02"
            + struct.pack("<H", 0x0314)
            + common
            + struct.pack("<HHHII", 0, 0, 0, mode, len(body))
        )
        directory += encoded
        body += b"PK\x03\x04" + common + encoded + packed
    end = struct.pack("<HHHHIIH", 0, 0, len(entries), len(entries), len(directory), len(body), 0)
    path.write_bytes(body + directory + b"PK\x05\x06" + end)
    return path


def try_all(made: dict[Path, str], reader: Callable[[Path], object]) -> dict[str, int]:
    """Try files in children of this process, which HDF5 may crash; count what becomes of them."""
    counts = {"sound": 0, "refused": 0, "ended the process": 0}
    for path, case in made.items():
        counts[_in_child(lambda path=path, case=case: survives(lambda: reader(path), path, case))] += 1
    return counts


def _in_child(work: Callable[[], str | None]) -> str:
    """Return what becomes of a file; what `work` raises is raised here."""
    output, end = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
            answer = "refused" if work() else "sound"
        except BaseException as error:
            answer = f"fails: {error}"
        os.write(end, answer.encode(errors="replace"))
        os._exit(0)
    os.close(end)
    with os.fdopen(output) as file:
        answer = file.read() or "ended the process"
    os.waitpid(child, 0)
    assert not answer.startswith("fails"), answer
    return answer
