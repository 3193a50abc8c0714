"""Archives of LISA: a map has its channels, and converts them."""

import numpy as np
import pytest

import fit
from fit.telemetry.contract import LISA_REQUIRED
from tests.oracles import lisa_loop

PICO = 1e-12
MAP = """
schema = "lpf-map/1"
[attributes]
m_tm = "1.928 kg"
F_max_1 = "1 nN"
F_max_2 = "1 nN"
N_max_1 = "10 pN m"
N_max_2 = "10 pN m"
alignment_epoch = 1
half_opening = "30 deg"
[time]
column = "t"
[channels]
{channels}
{runs}
"""


@pytest.fixture
def runs_and_map(tmp_path):
    """Runs, and a map of their CSV files with forces in pN."""
    runs = lisa_loop.campaign(lisa_loop.World(), lisa_loop.sequence(1e-6), duration=3600)
    for run in runs:
        columns = [run.time, *(run.channels[name] / _unit(name) for name in LISA_REQUIRED)]
        header = ",".join(["t", *LISA_REQUIRED])
        np.savetxt(
            tmp_path / f"{run.run}.csv", np.transpose(columns), "%.17g", ",", header=header, comments=""
        )
    channels = [
        f'{n} = {{ column = "{n}"{", unit = " + chr(34) + "pN" + chr(34) if n[0] == "F" else ""} }}'
        for n in LISA_REQUIRED
    ]
    entries = [
        f'[[runs]]\nfile = "{{run}}.csv"\nrun = "{r.run}"\nkind = "{r.kind}"\n'
        f'experiment = "{r.experiment}"\nt0 = {r.t0}\n'
        for r in runs
    ]
    path = tmp_path / "A.toml"
    path.write_text(MAP.format(channels="\n".join(channels), runs="".join(entries)))
    return runs, path


def _unit(channel):
    return PICO if channel.startswith("F_") else 1.0


def test_map_converts_archives_of_lisa(runs_and_map, tmp_path):
    runs, path = runs_and_map
    converted = {run.run: run for run in fit.load(path, folder=tmp_path / "out")}
    for run in runs:
        assert converted[run.run].spacecraft == "LISA"
        assert converted[run.run].attributes["half_opening"] == pytest.approx(np.pi / 6)
        for name in LISA_REQUIRED:
            np.testing.assert_allclose(converted[run.run].channels[name], run.channels[name], rtol=1e-12)
