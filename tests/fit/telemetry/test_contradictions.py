"""What an archive says of itself, beside a map that says something else."""

import numpy as np
import pytest

from tests.fit.telemetry.mapped import CHANNELS, N

COLUMNS = dict(zip(CHANNELS, ("x1", "x12", "a1", "a2"), strict=True))
PICO = "s,pm,pm,pm/s^2,pm/s^2"


@pytest.fixture
def written(archive):
    """Write an archive with a line of units, and return what the map says of its columns."""

    def write_archive(units=PICO, unit="", start=0.0, **columns):
        values = np.random.default_rng(3).normal(0.0, 1.0, (N, 4))
        rows = np.column_stack([start + np.arange(N) / 10, values]).tolist()
        lines = [",".join(["t", *COLUMNS.values()]), *([units] if units else [])]
        lines += [",".join(map(repr, row)) for row in rows]
        (archive.folder / "A.csv").write_text("\n".join(lines))
        named = {name: f'{{ column = "{column}" }}' for name, column in (COLUMNS | columns).items()}
        named["o_1"] = f'{{ column = "x1"{unit and ", " + unit} }}'
        return {"columns": named}, values[:, 0]

    return write_archive


@pytest.mark.parametrize(
    ("units", "unit", "factor"),
    [
        (PICO, "", 1e-12),
        (PICO, 'unit = "pm"', 1e-12),
        ("s,counts,pm,pm/s^2,pm/s^2", 'unit = "nm"', 1e-9),
        ("", 'unit = "nm"', 1e-9),
    ],
    ids=["of the file", "of both", "which explains counts", "of the map"],
)
def test_the_unit_of_a_column(archive, written, units, unit, factor):
    mapped, column = written(units, unit)
    np.testing.assert_allclose(archive.convert(**mapped).channels["o_1"], column * factor, rtol=1e-12)


def test_units_of_file_and_map_that_contradict_each_other(archive, written):
    mapped, _ = written(unit='unit = "nm"')
    message = archive.refusal(**mapped)
    assert "column x1 (channel o_1): in 'pm' by the file, but in 'nm' by the map" in message


def test_two_channels_of_one_column(archive, written):
    mapped, _ = written(o_12="x1")
    message = archive.refusal(**mapped)
    assert "column x1 (channel o_12): also that of channel o_1, expected a column" in message


def test_seconds_of_a_gps_week(archive, written):
    mapped, _ = written(start=568817.0)
    message = archive.refusal(clock='column = "t"\nformat = "gps"', t0="", **mapped)
    assert "seconds of a GPS week; expected seconds since 1980-01-06" in message
