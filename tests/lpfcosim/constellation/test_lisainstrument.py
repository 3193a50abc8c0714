"""lisainstrument, moved: its signs and units, and the chain to the coefficients; needs the extra ``lisa``."""

from importlib.util import find_spec

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.tilt_to_length import NAMES, read_measurements
from fit.tilt_to_length.normal_equations import least_squares
from fit.tilt_to_length.response import response_spectra
from lpfcosim.constellation import Jitter, simulate_measurements
from lpfcosim.constellation.jitter import SERIES, join
from lpfcosim.constellation.lisainstrument_adapter import LEAD, rate
from lpfcosim.workflows.ttl import run_ttl
from tests import ROOT
from tests.lpfcosim.constellation.spacecraft import manoeuvre, write_constellation

FILTER_DELAY = 4.5  # s, of the anti-aliasing filter of lisainstrument
lisa = pytest.mark.lisa
installed = pytest.mark.skipif(find_spec("lisainstrument") is None, reason="needs the extra lisa")


@pytest.fixture(scope="module")
def quiet(tmp_path_factory):
    """Return motion and measurements of a constellation without noise."""
    folder = tmp_path_factory.mktemp("lisa")
    jitter = join(write_constellation(folder, 1000.0, manoeuvre()))
    simulate_measurements(jitter, folder / "m.h5", quiet=True)
    return jitter, read_measurements(folder / "m.h5")


@lisa
@installed
def test_wavefront_sensing_reads_the_motion_with_its_signs(quiet):
    jitter, measurements = quiet
    rates = {name: rate(series, jitter.fs) for name, series in jitter.series.items()}
    # the filter before 4 Hz delays all that lisainstrument measures; both rates have these instants in common
    instants = round(16 * (LEAD - FILTER_DELAY)) + 4 * np.arange(measurements.size)
    rates = {name: x[instants] for name, x in rates.items()}
    for assembly, side in (("12", 1), ("13", -1), ("23", 1), ("21", -1), ("31", 1), ("32", -1)):
        a, sc = np.deg2rad(30.0 * side), assembly[0]
        expected = {
            "phi": rates[f"sc_phi_{sc}"] + rates[f"mosa_phi_{assembly}"],
            "eta": np.cos(a) * rates[f"sc_eta_{sc}"] - np.sin(a) * rates[f"sc_theta_{sc}"],
        }
        for angle, x in expected.items():
            sensed = measurements.rates[f"{angle}_{assembly}"]
            assert np.abs(sensed - x).max() < 1e-4 * np.abs(x).max()


@lisa
@installed
def test_without_noise_the_coefficients_are_exact(quiet):
    _, measurements = quiet
    spectra = response_spectra(measurements)
    c = least_squares(spectra, np.ones(spectra.data.shape), 0.0).c
    truth = np.array([measurements.truth[name] for name in NAMES])
    assert np.abs(truth).max() > 1e-3
    assert np.abs(c - truth).max() < 0.1e-6


@lisa
@installed
def test_longitudinal_motion_cancels(quiet):
    _, measurements = quiet
    residual = response_spectra(measurements)
    c = np.array([measurements.truth[name] for name in NAMES])
    # beat notes of 10 MHz are rounded to 2e-9 Hz, which leaves 4e-8 cycles Hz^-0.5; noise of a link has 1e-5
    assert np.abs(residual.residual(c)).max() < 1e-3 * np.abs(residual.data).max()


@lisa
@installed
def test_wavefront_sensing_reads_the_noise_of_the_loop(tmp_path):
    # two measurements with other seeds have the same wavefront sensing, that of the telemetry
    rng, t = np.random.default_rng(1), np.arange(6000) / 10.0
    noise = {f"n_dws_{angle}_{j}": rng.normal(size=t.size) for angle in ("phi", "eta") for j in (1, 2)}
    level = 4e-10  # rad Hz^-0.5
    motions = [
        m | {name: lambda t, x=x: level * np.sqrt(5.0) * x[: t.size] for name, x in noise.items()}
        for m in manoeuvre()
    ]
    jitter = join(write_constellation(tmp_path, 600.0, motions))
    read = []
    for seed in (1, 2):
        simulate_measurements(jitter, tmp_path / "m.h5", seed=seed)
        read.append(read_measurements(tmp_path / "m.h5"))
        assert read[-1].dws_asd == pytest.approx(level, rel=0.02)
    for name, x in read[0].rates.items():
        np.testing.assert_array_equal(x, read[1].rates[name])
        angle = np.cumsum(x) / read[0].fs
        assert np.std(np.diff(angle)) > 0.5 * level * np.sqrt(2.0)


@lisa
@installed
def test_beat_notes_are_read_as_a_phasemeter_gives_them(tmp_path):
    path = tmp_path / "m.h5"
    simulate_measurements(join(write_constellation(tmp_path, 600.0, manoeuvre())), path)
    whole = read_measurements(path)
    with h5py.File(path, "r+") as file:
        file.pop("debug", None)
        file["sci_carriers"]["23"][400:440] = np.nan
    gap = read_measurements(path)
    for name, x in gap.michelson.items():
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(x)), np.arange(400, 440))
        np.testing.assert_array_equal(x[:350], whole.michelson[name][:350])
    with h5py.File(path, "r+") as file:
        file["sci_carriers"]["12"][:] = 0.0
    dead = read_measurements(path)
    assert list(dead.michelson) == ["Z2"]
    assert "sci_12" in dead.silent
    np.testing.assert_array_equal(dead.michelson["Z2"], gap.michelson["Z2"])


def test_rates_are_flat_up_to_one_hertz():
    t, t_physics = np.arange(3000) / 10.0, np.arange(4800) / 16.0
    for f in (0.01, 0.2, 1.0):
        w = 2 * np.pi * f
        expected = w * np.cos(w * t_physics)
        assert np.abs(rate(np.sin(w * t), 10.0) - expected)[160:-160].max() < 1e-4 * w


def test_motion_that_is_too_short_or_too_slow_is_refused(tmp_path):
    short = Jitter(10.0, {name: np.zeros(3000) for name in SERIES})
    with pytest.raises(InputError, match=r"300 s, expected 450 s or more: measurements begin 300 s after"):
        simulate_measurements(short, tmp_path / "m.h5")
    slow = Jitter(1.0, {name: np.zeros(3000) for name in SERIES})
    with pytest.raises(InputError, match="sampled at 1 Hz, expected 4 Hz or more"):
        simulate_measurements(slow, tmp_path / "m.h5")


@pytest.mark.skipif(find_spec("lisainstrument") is not None, reason="it is installed")
def test_without_the_extra_nothing_is_simulated(tmp_path):
    with pytest.raises(InputError, match="need lisainstrument, of the extra"):
        run_ttl(ROOT / "campaigns" / "lisa-ttl.toml", tmp_path / "out")
    assert not (tmp_path / "out").exists()
