"""What an archive says of itself, beside a map that says something else."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fit.errors import InputError
from fit.telemetry.conversion import convert
from fit.telemetry.reader import read

N = 2400
MAP = """
schema = "lpf-map/1"
[attributes]
m_tm = 1.928
F_max_1 = 0.0
F_max_2 = 2.2e-9
N_max_1 = 1e-11
N_max_2 = 1e-11
alignment_epoch = 1
experiment = "A"
kind = "sysid"
[time]
column = "t"
{clock}
[channels]
o_1 = {{ column = "x1"{unit} }}
o_12 = {{ column = "{o_12}" }}
f_x_1 = {{ column = "a1" }}
f_x_2 = {{ column = "a2" }}
[[runs]]
file = "A.csv"
run = "A"
{t0}
"""


@pytest.fixture
def converted(tmp_path):
    rng = np.random.default_rng(3)
    columns = np.column_stack([np.arange(N) / 10, rng.normal(0.0, 1.0, (N, 4))])

    def of(units="s,pm,pm,pm/s^2,pm/s^2", clock="", unit="", o_12="x12", start=0.0, t0='t0 = "2016-04-16"'):
        shifted = columns + np.array([start, 0, 0, 0, 0])
        lines = [",".join(map(repr, row)) for row in shifted.tolist()]
        text = "\n".join(["t,x1,x12,a1,a2", *([units] if units else []), *lines])
        (tmp_path / "A.csv").write_text(text)
        t0 = t0.replace('16"', '16T00:00:00Z"')
        (tmp_path / "m.toml").write_text(MAP.format(clock=clock, unit=unit and f", {unit}", o_12=o_12, t0=t0))
        (path,) = convert([tmp_path / "m.toml"], tmp_path / "out", any_gaps=False)
        return read(path).channels["o_1"], columns[:, 1]

    return of


@pytest.mark.parametrize(
    ("units", "unit", "factor"),
    [
        ("s,pm,pm,pm/s^2,pm/s^2", "", 1e-12),
        ("s,pm,pm,pm/s^2,pm/s^2", 'unit = "pm"', 1e-12),
        ("s,counts,pm,pm/s^2,pm/s^2", 'unit = "nm"', 1e-9),
        ("", 'unit = "nm"', 1e-9),
    ],
    ids=["of the file", "of both", "which explains counts", "of the map"],
)
def test_the_unit_of_a_column(converted, units, unit, factor):
    channel, column = converted(units, unit=unit)
    assert_allclose(channel, column * factor, rtol=1e-12)


def test_units_of_file_and_map_that_contradict_each_other(converted):
    with pytest.raises(
        InputError, match=r"column x1 .channel o_1.: in 'pm' by the file, but in 'nm' by the map"
    ):
        converted(unit='unit = "nm"')


def test_two_channels_of_one_column(converted):
    with pytest.raises(
        InputError, match=r"column x1 .channel o_12.: also that of channel o_1, expected a column"
    ):
        converted(o_12="x1")


def test_seconds_of_a_gps_week(converted):
    with pytest.raises(InputError, match="seconds of a GPS week; expected seconds since 1980-01-06"):
        converted(clock='format = "gps"', start=568817.0, t0="")
