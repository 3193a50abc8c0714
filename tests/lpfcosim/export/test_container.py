"""The loop as one FMU, stepped by FMPy, against our own master: the same bits."""

import sys
from dataclasses import replace

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from lpfcosim.errors import InputError
from lpfcosim.export.container import container
from lpfcosim.modelica import build
from lpfcosim.models import model_of, one_axis, stimuli
from lpfcosim.spacecraft.run import Authority, HalfCosine, Pulse, Sine
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.modelica.fmu_instance import fmu_instance

pytestmark = pytest.mark.fmu

CHANNELS = [channel for channel, source in one_axis.MODEL.record.items() if "." in source]


@pytest.fixture(scope="module")
def run(make_run, flight_noise):
    """Everything on, and a dc: commands before the start then differ from zero."""
    return make_run(
        n_samples=2000,
        authority=Authority("G", F_max_1=4400e-12, F_max_2=5000e-12, N_max_1=1.5e-12, N_max_2=10.4e-12),
        injections=(
            Sine("F_x_1", amplitude=0.6e-12, frequency=0.02, cycles=2, start=10.05),
            HalfCosine("F_x_2", amplitude=0.4e-9, start=20, end=120),
            Sine("guidance_o_1", amplitude=5e-9, frequency=0.05, cycles=5, start=0),
            Sine("guidance_o_12", amplitude=10e-9, frequency=0.01, cycles=1, start=50),
            Pulse("g_2", amplitude=2e-12, start=60, duration=5),
        ),
        dc=8e-12,
        noise=replace(flight_noise, f_x_1_jitter=1e-14),
    )


@pytest.fixture(scope="module")
def archive(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("container") / "folder" / "loop.fmu"
    assert container(run, build.build(fmi="2.0"), path) == path
    return path


def driven(archive, run):
    """Step a container through a run, each sample with its signals."""
    feeds = {**stimuli.injections(run), **stimuli.noise(run)}
    rows = np.column_stack(list(feeds.values())).tolist()
    recorded = []
    with fmu_instance(archive, **dict(zip(feeds, rows[0], strict=True))) as fmu:
        fmu.exitInitializationMode()
        for i, row in enumerate(rows):
            fmu.set(list(feeds), row)
            fmu.doStep(i * run.h, run.h)
            recorded.append(fmu.get(CHANNELS))
    return dict(zip(CHANNELS, np.array(recorded).T, strict=True))


def assert_same_bits(got, expected):
    for channel in CHANNELS:
        assert expected[channel].any(), channel
        assert got[channel].tobytes() == expected[channel].tobytes(), channel


def test_container_gives_the_same_bits(archive, run, tmp_path):
    assert_same_bits(driven(archive, run), in_memory.simulate(run, build.build(fmi="2.0")))


def test_delays_start_at_the_equilibrium(make_run, tmp_path):
    # Without signals nothing may move: the dc is held from before the first sample.
    run = make_run(n_samples=50, dc=8e-12)
    path = container(run, build.build(fmi="2.0"), tmp_path / "loop.fmu")
    got = driven(path, run)
    assert np.abs(got["o_12"]).max() < 1e-18
    assert got["f_x_2"] == pytest.approx(np.full(50, run.f_x_2_start), rel=1e-9)


def test_no_checker_finds_a_fault(archive):
    assert validate_fmu(archive) == []


def test_interface_is_signals_and_channels_with_their_units(archive, run):
    description = fmpy.read_model_description(str(archive))
    variables = {v.name: v for v in description.modelVariables}
    inputs = {n for n, v in variables.items() if v.causality == "input"}
    outputs = {n for n, v in variables.items() if v.causality == "output"}
    assert inputs == {*model_of(run).stimuli(run)}
    assert outputs == set(CHANNELS)
    assert {n: variables[n].unit for n in ("o_1", "f_x_2", "F_x_sc", "g_2", "F_x_1", "plant.x_1")} == {
        "o_1": "m",
        "f_x_2": "m/s2",
        "F_x_sc": "N",
        "g_2": "m/s2",
        "F_x_1": "N",
        "plant.x_1": "m",
    }
    assert all(v.unit for n, v in variables.items() if n != "time")
    assert {u.name for u in description.unitDefinitions} == {"m", "m/s2", "N"}
    experiment = description.defaultExperiment
    assert (float(experiment.stepSize), float(experiment.stopTime)) == (run.h, run.n_samples * run.h)


def test_bytes_are_reproducible(archive, run, tmp_path):
    again = container(run, build.build(fmi="2.0"), tmp_path / "again.fmu")
    assert again.read_bytes() == archive.read_bytes()
    assert list(tmp_path.iterdir()) == [again]
    other = container(replace(run, dc=0.0), build.build(fmi="2.0"), tmp_path / "other.fmu")
    assert fmpy.read_model_description(str(other)).guid != fmpy.read_model_description(str(archive)).guid


def test_missing_toolbox_is_told(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmu_manipulation_toolbox.container", None)
    with pytest.raises(InputError, match=r"'fmu-manipulation-toolbox', which is not installed"):
        container(run, build.build(fmi="2.0"), tmp_path / "loop.fmu")
