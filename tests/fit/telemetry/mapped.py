"""Archives that a map describes, and what it makes of them."""

from dataclasses import dataclass

import numpy as np
import pytest
from astropy.time import Time, TimeDelta

from fit.errors import InputError
from fit.telemetry.conversion import convert
from fit.telemetry.reader import read

N = 2400
CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
M_TM = 1.928
T0 = "2016-04-16T14:00:00Z"
ATTRIBUTES = f"""
m_tm = {M_TM}
F_max_1 = 0.0
F_max_2 = 2.2e-9
N_max_1 = 1e-11
N_max_2 = 1e-11
alignment_epoch = 1
experiment = "A"
kind = "sysid"
"""


@dataclass
class Archive:
    """A folder with archives, and what a map makes of them."""

    folder: object

    def convert(
        self,
        *,
        clock='column = "t"',
        columns=None,
        run='file = "A.csv"',
        t0=T0,
        top="",
        attributes="",
        names=CHANNELS,
    ):
        """Convert run A; `columns` are what stands for each of the channels `names`."""
        columns = {name: f'{{ column = "{name}" }}' for name in names} | (columns or {})
        lines = "".join(f"{name} = {column}\n" for name, column in columns.items())
        start = f"t0 = {t0}\n" if t0 else ""
        time = f"[time]\n{clock}\n" if clock else ""
        path = self.folder / "map.toml"
        path.write_text(
            f'schema = "lpf-map/1"\n{top}\n[attributes]\n{ATTRIBUTES}{attributes}\n{time}[channels]\n{lines}'
            f'[[runs]]\nrun = "A"\n{run}\n{start}',
            encoding="utf-8",
        )
        (converted,) = convert([path], self.folder / "out", any_gaps=False)
        return read(converted)

    def refusal(self, **changes):
        with pytest.raises(InputError) as refused:
            self.convert(**changes)
        text = str(refused.value)
        assert "\n" not in text and text.startswith(str(self.folder))
        return text.replace(f"{self.folder}/", "")


def write(path, columns, *, names=True, delimiter=","):
    rows = [delimiter.join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([delimiter.join(columns)] * names + rows) + "\n", encoding="utf-8")


def listed(channels):
    return {name: values.tolist() for name, values in channels.items()}


def assert_same(run, channels, rtol=1e-15):
    for name, values in channels.items():
        np.testing.assert_allclose(run.channels[name], values, rtol=rtol, atol=0)


# Time stamps ---------------------------------------------------------------------------------------------


def instants(fs, start="2016-04-16T14:00:00", scale="utc"):
    return Time(start, scale="utc") + TimeDelta(np.arange(N) / fs, format="sec")


def isot(times, digits=3):
    times.precision = digits
    return times.isot.tolist()
