"""Archives in text: every encoding, layout and spelling of numbers gives the same columns."""

import bz2
import gzip
import lzma
import re

import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry.archives import open_table

NAN = float("nan")
SAMPLES = [[0.0, 1e-9, -1.5], [1.0, 2e-9, -2.5], [2.0, 3e-9, -3.5]]
ROWS = "".join(f"{t!r},{x!r},{y!r}\n" for t, x, y in SAMPLES)
PLAIN = {"t": (None, [0, 1, 2]), "x": (None, [1e-9, 2e-9, 3e-9]), "y": (None, [-1.5, -2.5, -3.5])}
IN_UNITS = {name: (unit, PLAIN[name][1]) for name, unit in {"t": "s", "x": "nm", "y": "m/s^2"}.items()}
SHORT = {"t": PLAIN["t"], "x": PLAIN["x"]}
SMALL = {"t": (None, [0.5, 1.5]), "x": (None, [1.5e-101, 0.5e101])}
STAMPS = [f"2016-04-16T14:00:0{i}.000Z" for i in range(3)]
STAMPED = "".join(f"{stamp},{i}\n" for i, stamp in enumerate(STAMPS))


def named(columns, *names):
    return dict(zip(names, columns.values(), strict=True))


NUMBERED = named(PLAIN, "1", "2", "3")
LAYOUTS = {
    "names": ("t,x,y\n" + ROWS, PLAIN),
    "blanks": ("t x  y\n" + ROWS.replace(",", "   "), PLAIN),
    "quotes": ('"t","x","y"\n' + re.sub(r"([^,\n]+)", r'"\1"', ROWS), PLAIN),
    "line ends of Windows": (("t,x,y\n" + ROWS).replace("\n", "\r\n"), PLAIN),
    "delimiters at the end": ("t,x,y,\n" + ROWS.replace("\n", ",\n"), PLAIN),
    "comments": (f"# made by hand\n#\n# t,x,y\n{ROWS}# the end\n", PLAIN),
    "other lines above": (f"Instrument: OMS, on board\nDate: 2016-04-16\n\nt,x,y\n{ROWS}", PLAIN),
    "units below": (f"t,x,y\ns,nm,m/s^2\n{ROWS}", IN_UNITS),
    "units in comments": (f"# t x y\n# s nm m/s^2\n{ROWS}", IN_UNITS),
    "units in names": (f"t [s],x [nm],y (m/s^2)\n{ROWS}", named(IN_UNITS, "t [s]", "x [nm]", "y (m/s^2)")),
    "no units": (f"t,x,y\ns,-,1\n{ROWS}", PLAIN | {"t": IN_UNITS["t"]}),
    "no names": (ROWS, NUMBERED),
    "an index of pandas": (",x,y\n" + ROWS, named(PLAIN, "1", "x", "y")),
    "a name twice": ("x,t,x\n" + ROWS, named(PLAIN, "1", "t", "3")),
    "save -ascii": ("".join(f"   {t:.16e}   {x:.16e}  {y:.16e}\n" for t, x, y in SAMPLES), NUMBERED),
    "Fortran": ("t x\n" + "".join(f" {t:.3E} {x:.3E}\n".replace("E", "D") for t, x, _ in SAMPLES), SHORT),
    "exponents of three digits": ("t,x\n0.5,1.5-101\n1.5,+.5+101\n", SMALL),
    "decimal commas": ("t;x;y\n" + ROWS.replace(",", ";").replace(".", ","), PLAIN),
    "decimal commas and tabs": (ROWS.replace(",", "\t").replace(".", ","), NUMBERED),
    "missing": ("t,x\n0,\n1,NaN\n2,NA\n3,#N/A\n4,5\n", {"t": (None, range(5)), "x": (None, [NAN] * 4 + [5])}),
    "a column that is missing": ("t,x\n0,\n1,\n", {"t": (None, [0, 1]), "x": (None, [NAN, NAN])}),
    "missing in one column": ("1.5\n\n \n2.5\n\n", {"1": (None, [1.5, NAN, NAN, 2.5])}),
    "blank lines among two columns": ("t,x\n\n0,1\n\n1,2\n", {"t": (None, [0, 1]), "x": (None, [1, 2])}),
    "missing between tabs": (
        "x\ty\n\t\n1.5\t2\n\n\t\n2.5\t3\n\t\n",
        {"x": (None, [NAN, 1.5, NAN, 2.5]), "y": (None, [NAN, 2, NAN, 3])},
    ),
    "integers": ("t,x\n0,921\n1,45\n", {"t": (None, [0, 1]), "x": (None, [921, 45])}),
    "stamps": ("t,x\n" + STAMPED, {"t": (None, STAMPS), "x": (None, [0, 1, 2])}),
    "names alone": ("t,x\n", {"t": (None, []), "x": (None, [])}),
    "nothing": ("", {}),
}  # fmt: skip


def columns(path):
    """All columns of an archive that are numbers or texts, with units."""
    with open_table(path, None) as table:
        values_by_name = {}
        for name, column in table.columns.items():
            values_by_name[name] = (
                column.unit,
                list((table.texts if column.is_text else table.numbers)(name)),
            )
            assert len(values_by_name[name][1]) == column.size
        return values_by_name


def assert_columns(values_by_name, expected):
    assert list(values_by_name) == list(expected)
    for name, (unit, values) in expected.items():
        assert values_by_name[name][0] == unit, name
        np.testing.assert_array_equal(values_by_name[name][1], list(values), name)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(tmp_path, layout):
    text, expected = LAYOUTS[layout]
    (tmp_path / "a.txt").write_bytes(text.encode())
    assert_columns(columns(tmp_path / "a.txt"), expected)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "utf-32", "latin-1"])
def test_encodings(tmp_path, encoding):
    (tmp_path / "a.csv").write_bytes(f"t,Länge [µm],y\n{ROWS}".encode(encoding))
    expected = {"t": PLAIN["t"], "Länge [µm]": ("µm", PLAIN["x"][1]), "y": PLAIN["y"]}
    assert_columns(columns(tmp_path / "a.csv"), expected)


@pytest.mark.parametrize(("suffix", "pack"), [("gz", gzip), ("bz2", bz2), ("xz", lzma)])
def test_compressed(tmp_path, suffix, pack):
    path = tmp_path / f"a.csv.{suffix}"
    whole = pack.compress(("t,x,y\n" + 99 * ROWS).encode("utf-16"))
    path.write_bytes(whole)
    assert np.array_equal(columns(path)["x"][1], 99 * PLAIN["x"][1])
    path.write_bytes(whole[:-9])
    with pytest.raises(InputError, match=rf"a\.csv\.{suffix}: cannot be read as text, expected a whole file"):
        columns(path)


def test_a_bomb_of_a_text(tmp_path):
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"t,x\n" + b"1" * 2**22))
    with pytest.raises(InputError, match=r"a\.csv\.gz: line 2: 1048576 letters or more, expected a row"):
        columns(tmp_path / "a.csv.gz")


def test_long_texts_come_in_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr("fit.telemetry.archives.text._BLOCK", 100)
    lines = "".join(f"{i},-{i}.5,{STAMPS[i % 3]}\n" for i in range(1050))
    (tmp_path / "a.csv").write_text("n,x,t\n" + lines)
    expected = {"n": (None, range(1050)), "x": (None, [-i - 0.5 for i in range(1050)])}
    assert_columns(columns(tmp_path / "a.csv"), expected | {"t": (None, 350 * STAMPS)})


REFUSALS = {
    "words": ("t,x\n0,1\n1,off\n", r"line 3: column x: 'off', expected a number with a decimal point, or"),
    "more cells": ("t,x\n0,1\n1,2,3\n2,3\n", r"line 3: 3 cells, expected the 2 of the line with the names"),
    "fewer cells": ("t,x\n0,1\n1\n2,3\n", r"line 3: 1 cells, expected the 2"),
    "a line end in quotes": ('t,x\n0,"1\n2"\n3,4\n4,5\n5,6\n', "line 2: a quote without its end"),
    "thousands, perhaps": ("t;x\n1,234;2,345\n", r"line 2: '1,234', the comma may be"),
    "columns with a title": ("x1 [nm]\n\n0,5\n,25\n", r"line 3: '0,5', .*, or the names of two columns"),
    "missing at the start": ("\n\n1.5\n2.5\n", r"line 1: blank above the first number of a single column"),
    "both marks": ("t;x\n1,5;2.5\n", r"line 2: '1,5', the comma may be a decimal mark or separate thousands"),
    "a point among commas": ("t;x\n" + 250 * "1,5;2\n" + "1.5;2\n", r"line 252: column t: '1\.5', .* comma"),
    "ZIP": ("PK\x03\x04", "an archive of ZIP, as Excel's .xlsx is, expected text as its name says"),
    "zero bytes": ("t,x\n1,2\n\0", "line 3: a zero byte, expected text"),
}  # fmt: skip


@pytest.mark.parametrize("fault", REFUSALS)
def test_one_sentence_for_what_is_wrong(tmp_path, fault):
    text, expected = REFUSALS[fault]
    (tmp_path / "a.csv").write_text(text)
    refused = pytest.raises(InputError, match=rf"a\.csv: {expected}")
    with refused, open_table(tmp_path / "a.csv", None) as table:
        table.numbers("t"), table.numbers("x")


def test_columns_by_name_and_number(tmp_path):
    (tmp_path / "a.csv").write_text("t [s],x12 [nm],a,a\n0,1,2,3\n1,2,3,4\n")
    with open_table(tmp_path / "a.csv", None) as table:
        assert [table.column(key) for key in ("t", "t [s]", 1, "x12", 2, 3, 4)] == [
            *("t [s]", "t [s]", "t [s]", "x12 [nm]", "x12 [nm]", "3", "4"),
        ]
        for key, expected in {
            "a": "column a (channel o_1): there are several, expected one of the columns: 3, 4",
            "x1": "column x1 (channel o_1): missing, expected it among the columns: t [s], x12 [nm], 3, 4; "
            'did you mean "x12 [nm]"?',
            0: "column 0 (channel o_1): missing, expected a number from 1 to 4: t [s], x12 [nm], 3, 4",
        }.items():
            with pytest.raises(InputError, match=re.escape(expected) + "$"):
                table.column(key, " (channel o_1)")


def test_a_header_without_end_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("# a line of a comment\n" * 200_000 + "t,x\n0,1\n", encoding="utf-8")
    refused = pytest.raises(InputError, match=r"a\.csv: line \d+: no row of data in the first 4 MiB")
    with refused, open_table(tmp_path / "a.csv", None):
        pass
