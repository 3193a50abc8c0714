"""The file of the motion of three spacecraft."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from lpfcosim.constellation import read_jitter, write_jitter
from lpfcosim.constellation.jitter import NOISES, SERIES, join
from tests.lpfcosim.constellation.spacecraft import manoeuvre, tone, write_constellation, write_run


@pytest.fixture
def files(tmp_path):
    return write_constellation(tmp_path, 60.0, manoeuvre())


def test_motion_has_the_signs_of_the_assemblies(files):
    jitter = join(files)
    t, motions = np.arange(600) / 10.0, manoeuvre()
    assert list(jitter.series) == [*SERIES, *NOISES]
    assert (len(SERIES), len(NOISES)) == (27, 12)
    for i, (left, right) in enumerate((("12", "13"), ("23", "21"), ("31", "32"))):
        for j, assembly in ((1, left), (2, right)):
            np.testing.assert_array_equal(jitter.series[f"mosa_phi_{assembly}"], motions[i][f"mosa_{j}"](t))
            np.testing.assert_array_equal(
                jitter.series[f"mosa_x_{assembly}"], -motions[i][f"jitter_x_{j}"](t)
            )
            assert not jitter.series[f"mosa_eta_{assembly}"].any()
        np.testing.assert_array_equal(jitter.series[f"sc_theta_{i + 1}"], motions[i]["jitter_theta"](t))


def test_noise_of_wavefront_sensing_is_what_the_loop_was_driven_by(tmp_path):
    noise = {f"n_dws_{angle}_{j}": tone(0.1 * j, 1e-9) for angle in ("phi", "eta") for j in (1, 2)}
    series = join(write_constellation(tmp_path, 60.0, [m | noise for m in manoeuvre()])).series
    t = np.arange(600) / 10.0
    for name in NOISES:
        j = 1 if name[-2:] in ("12", "23", "31") else 2
        np.testing.assert_allclose(series[name], noise[f"{name[:-2]}{j}"](t), atol=1e-22)


def test_another_opening_projects_the_attitude_otherwise(files):
    with h5py.File(files[0], "r+") as file:
        file.attrs["half_opening"] = np.radians(40.0)
        theta, eta = file["jitter_theta"][:], file["jitter_eta"][:]
    series = join(files).series
    for assembly, azimuth in (("12", 30.0), ("13", -30.0)):  # as lisainstrument projects
        pitch = np.cos(np.radians(azimuth)) * eta - np.sin(np.radians(azimuth)) * theta
        wide = np.radians(azimuth * 4 / 3)
        np.testing.assert_allclose(
            pitch + series[f"mosa_eta_{assembly}"], np.cos(wide) * eta - np.sin(wide) * theta, atol=1e-22
        )
    assert not series["mosa_eta_23"].any()


def test_a_file_comes_back_and_documents_itself(files, tmp_path):
    jitter = join(files)
    write_jitter(jitter, tmp_path / "j.h5", {"campaign": "lisa"})
    again = read_jitter(tmp_path / "j.h5")
    assert (again.fs, again.size, again.runs) == (10.0, 600, ("sc1.h5", "sc2.h5", "sc3.h5"))
    np.testing.assert_array_equal(again.series["sc_eta_2"], jitter.series["sc_eta_2"])
    with h5py.File(tmp_path / "j.h5") as file:
        assert {"schema", "dt", "t0", "size", "run_1", "campaign"} <= set(file.attrs)
        assert all(file[name].attrs["units"] in ("rad", "m") for name in SERIES)
    motion = {name: x for name, x in jitter.series.items() if name in SERIES}
    write_jitter(replace(jitter, series=motion), tmp_path / "motion.h5")
    assert list(read_jitter(tmp_path / "motion.h5").series) == list(SERIES)


def test_runs_that_do_not_belong_together_are_refused(files, tmp_path):
    with pytest.raises(InputError, match=r"2 runs, expected three, of spacecraft 1, 2 and 3"):
        join(files[:2])
    write_run(tmp_path / "slow.h5", 120.0, {}, fs=5.0)
    with pytest.raises(InputError, match=r"600 samples at 5 Hz .*, expected 600 samples at 10 Hz"):
        join([files[0], tmp_path / "slow.h5", files[2]])
    with h5py.File(files[2], "r+") as file:
        file["time"][:] += 100.0
    with pytest.raises(InputError, match=r"sc3.h5: .* from 100 s on, expected .* from 0 s on"):
        join(files)
    with h5py.File(files[0], "r+") as file:
        file.attrs["half_opening"] = 30.0  # degrees
    with pytest.raises(InputError, match=r"sc1.h5: attribute half_opening: 30.0, expected an angle in rad"):
        join(files)


def test_the_command_takes_files_and_folders(lpfcosim, tmp_path):
    folder = tmp_path / "lisa" / "telemetry"
    folder.mkdir(parents=True)
    write_constellation(folder, 60.0, manoeuvre())
    for i in (1, 2, 3):
        write_run(folder / f"sc{i}-noise.h5", 90.0, {"jitter_phi": tone(0.01, 1e-9)}, kind="noise")
    lpfcosim("jitter", "lisa", "--out", "j.h5", status=0)
    assert read_jitter(tmp_path / "j.h5").runs == ("sc1.h5", "sc2.h5", "sc3.h5")
    lpfcosim("jitter", "lisa", "--noise", "--out", "n.h5", status=0)
    assert read_jitter(tmp_path / "n.h5").duration == 90.0
