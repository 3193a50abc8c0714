"""What electrodes do to a run, against electrodes one by one."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.cosim import read_interfaces
from lpfcosim.linear import response
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Authority, HalfCosine
from tests.oracles import electrodes as oracle
from tests.oracles import reference_plant

M_TM = 1.928
SET = Authority("G", 4400e-12, 5000e-12, 1.5e-12, 10.4e-12)


@pytest.mark.parametrize(("F", "N"), [(0, 0), (1500e-12, 0), (-2000e-12, 6e-12), (2200e-12, -10.4e-12)])
def test_three_sums_stand_for_four_electrodes(make_run, F, N):
    run = make_run(noise={"electrode": 1e-6}, n_samples=500)
    limits = run.authority.F_max_2, run.authority.N_max_2
    eps = 1e-6 * np.random.default_rng(1).standard_normal((4, 500))
    turning = -oracle.SIDES * oracle.ENDS
    drawn = {
        "e_x_2": oracle.SIDES @ eps / 2,
        "gain_2": eps.sum(axis=0) / 2,
        "e_N_2": (oracle.SIDES * turning) @ eps / 2,
    }
    error = reference_plant.actuation_errors(run, drawn)[1]
    f = F / run.truth["lambda_2"] / M_TM  # what the test mass receives is F
    got = [run.truth["lambda_2"] * M_TM * error(i, f, N) for i in range(500)]
    expected = oracle.force_noise(F, N, *limits, eps)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


@pytest.mark.fmu
def test_what_is_not_asked_for_is_not_wired(make_run, fmus):
    (usual,) = (c for c in model_of(make_run()).components(make_run()) if c.model == "Actuation")
    assert set(usual.inputs) == {"f_control_2", "F_x_1", "F_x_2", "f_x_1_jitter"}
    asked = make_run(noise={"electrode": 1e-6})
    (result,) = (i for i in read_interfaces(asked, fmus) if i.model == "Actuation")
    assert set(result.inputs) - set(usual.inputs) == {"e_x_1", "e_x_2", "gain_1", "gain_2"}
    assert "N_max_2" in result.settings


def psd(run, frequency):
    """Return the PSDs of the force per unit mass on test masses 1 and 2 by the electrodes, at a frequency."""
    system = response.noise_system(run)
    weights, of_streams = response.noise_streams(run, system, np.array([frequency]))
    loud = [bool(re.match("e_|gain_", name)) for name in system.inputs]
    power = (weights**2 @ of_streams[0]) * loud
    system = system.select(system.inputs, ("f_applied_1", "f_applied_2"))
    return system.D**2 @ power


@pytest.mark.parametrize(
    ("authority", "expected"),
    [
        (Authority("A", 0, 2200e-12, 10.4e-12, 10.4e-12), (10.4e-12 / 0.011, 2200e-12 + 10.4e-12 / 0.011)),
        (Authority("D", 0, 50e-12, 1.5e-12, 1e-12), (1.5e-12 / 0.011, 50e-12 + 1e-12 / 0.011)),
    ],
)
def test_expected_noise_follows_the_authority(make_run, authority, expected):
    """At 0.1 mHz 2e-6 has risen to 6.3e-6; nothing else is noisy, nothing is commanded."""
    run = make_run(authority=authority, noise={"electrode": 2e-6})
    for power, F in zip(psd(run, 1e-4), expected, strict=True):
        assert np.sqrt(power) == pytest.approx(2e-6 * np.sqrt(10) * F / M_TM, rel=0.065, abs=0)


def test_common_noise_follows_the_force(make_run):
    """4 nN on both test masses: 8 fm s-2 Hz-1/2 each at 4e-6 of the force, above 1 mHz; none without it."""
    quiet = make_run(authority=SET, noise={"electrode_common": 2e-6})
    assert psd(quiet, 0.01)[0] == 0
    steps = [HalfCosine(f"F_x_{j}", 4e-9, 0.0, 1.0) for j in (1, 2)]
    loud = psd(replace(quiet, injections=tuple(steps)), 0.02)
    for power, gain in zip(loud, (1.0748, 1.0776), strict=True):
        assert np.sqrt(power) == pytest.approx(4e-6 * gain * 4e-9 / M_TM, rel=0.07, abs=0)
    steady = psd(replace(quiet, dc=1e-11), 0.02)
    assert np.sqrt(steady[1]) == pytest.approx(4e-6 * 1e-11, rel=0.07, abs=0)
