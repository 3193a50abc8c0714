"""Settings, maps and results that are damaged or hostile: one sentence, or sound."""

import json
import os
import random
import tomllib
from functools import partial
from pathlib import Path

import pytest
import tomlkit

from fit import results as fit_results
from fit import settings as fit_settings
from fit.telemetry import conversion
from fit.telemetry import maps as mapping
from lpfcosim.campaign import loading
from tests import ROOT
from tests.hostile.mutations import damaged, restructured, survives, swapped

SETTINGS = (ROOT / "fit" / "default.toml").read_text(encoding="utf-8")
MAP = """\
schema = "lpf-map/1"
time = { column = "t" }
[attributes]
kind = "noise"
F_max_1 = "0 pN"
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"
[[runs]]
file = "a.csv"
run = "A"
experiment = "A"
t0 = 2016-04-16T00:00:00Z
alignment_epoch = 1
m_tm = "1.928 kg"
[channels]
o_1 = { column = "o1", unit = "nm" }
o_12 = { column = "o12", unit = "nm" }
f_x_1 = { column = "a1" }
f_x_2 = { column = "a2" }
"""
TABLE = "t,o1,o12,a1,a2\n" + "".join(f"{i},{i % 7}e-3,{i % 5}e-3,0,{i % 3}e-12\n" for i in range(60))
RESULTS = {
    "schema": "lpf-results/1",
    "joint": {
        "parameters": {"C_2": {"value": 0.186, "sigma": 1e-3, "unit": "s"}},
        "names": ["C_2"],
        "covariance": [[1e-6]],
        "chi2": 1.0,
        "dof": 2,
        "converged": True,
        "warnings": [{"code": "indeterminable", "parameters": ["C_1"], "message": "not told"}],
    },
    "provenance": {"telemetry": ["telemetry/A.h5"]},
}


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    return path


def mutated(text, rng):
    """Return a TOML file after one of the mutations."""
    how = rng.randrange(3)
    if how == 0:
        return damaged(text.encode(), rng)
    if how == 1:
        return swapped(text, rng)
    try:
        return tomlkit.dumps(restructured(tomllib.loads(text), rng))
    except (TypeError, ValueError):  # what cannot be written
        return swapped(text, rng)


def test_settings(tmp_path, cases):
    for n in range(cases(0.05, 100)):
        path = written(tmp_path, "fit.toml", mutated(SETTINGS, random.Random(n)))
        survives(lambda path=path: fit_settings.read(path), path, f"settings {n}")


def test_maps_and_their_tables(tmp_path, cases):
    home = tmp_path / "in"
    home.mkdir()
    for n in range(cases(0.1, 60)):
        rng = random.Random(n)
        path = written(home, "map.toml", MAP if n % 2 else mutated(MAP, rng))
        written(home, "a.csv", damaged(TABLE.encode(), rng) if n % 2 else TABLE)
        convert = partial(conversion.convert, [path], home / "telemetry", any_gaps=False)
        survives(convert, path, f"map {n}")
    assert {p.name for p in tmp_path.iterdir()} == {"in"}
    assert {p.name for p in home.iterdir()} <= {"map.toml", "a.csv", "telemetry"}


def test_results(tmp_path, cases):
    for n in range(cases(0.1, 150)):
        rng = random.Random(n)
        if n % 2:
            content = json.dumps(restructured(json.loads(json.dumps(RESULTS)), rng))
        else:
            content = damaged(json.dumps(RESULTS).encode(), rng)
        path = written(tmp_path, "results.json", content)
        survives(lambda path=path: fit_results.load(path), path, f"results {n}")


LIMITS = {
    "endless": lambda folder: Path("/dev/zero"),
    "pipe": lambda folder: _pipe(folder / "pipe.toml"),
    "deep": lambda folder: written(folder, "deep.toml", "a = " + "[" * 500_000),
}


def _pipe(path):
    os.mkfifo(path)
    return path


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has neither pipes nor devices among its files")
@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.parametrize("reader", [loading.load, fit_settings.read, mapping.load, fit_results.load])
def test_what_has_no_end(tmp_path, limit, reader):
    path = LIMITS[limit](tmp_path)
    assert survives(lambda: reader(path), path, limit)
