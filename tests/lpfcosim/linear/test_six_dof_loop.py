"""The loop of the whole spacecraft, from its equations, against closed forms and a general integrator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from lpfcosim.linear import ClosedLoop, response
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Authority, HalfCosine, Sine
from tests.agreement import assert_agree
from tests.oracles.whole_equations import I_SC, SKEW, D, H, by_integration
from tests.reference_run import simulate_reference


@pytest.fixture(scope="module")
def craft(make_run):
    """Make a noise-free run of the whole spacecraft."""
    return lambda truth=None, **fields: make_run(spacecraft="lpf", truth=truth or {}, **fields)


RATES = tuple(f"Omega_{k}_start" for k in ("theta", "eta", "phi"))
SIGNALS = [
    *("f_x_1_jitter", "n_1", "n_12", "n_phi_1", "n_phi_12", "n_eta_1", "n_eta_12"),
    *(f"n_grs_{k}_{j}" for j in (1, 2) for k in ("x", "y", "z", "theta", "eta", "phi")),
    *(f"n_ast_{k}" for k in ("theta", "eta", "phi")),
    *("guidance_o_1", "guidance_o_12", "attitude_theta", "attitude_eta", "attitude_phi"),
    *(f"{kind}_noise_{k}_sc" for kind in ("F", "N") for k in ("x", "y", "z")),
    *("g_1", "g_y_1", "g_z_1", "g_2", "g_y_2", "g_z_2"),
    *(f"gamma_{k}_{j}" for j in (1, 2) for k in ("theta", "eta", "phi")),
    *(f"{name}_{j}" for name in ("gain", "e_x", "e_N") for j in (1, 2)),
]


def shaken(n, scale):
    """Noise on every input, for scale = 1 far above the usual."""
    size = {"n_1": 1e-12, "n_12": 1e-12, "F_noise": 1e-5, "N_noise": 1e-5, "n_grs": 5e-9, "n_ast": 1e-4}
    size |= {"gain": 1e-2, "e_x": 1e-2, "e_N": 1e-2}
    rng = np.random.default_rng(3)
    driven = {}
    for name in SIGNALS:
        level = next((s for key, s in size.items() if name.startswith(key)), 3e-10)
        driven[name] = scale * level * rng.standard_normal(n)
    return driven


@pytest.mark.parametrize(
    ("Omega", "scale", "tau_es", "tolerance", "n"),
    [((3e-9, -5e-9, 7e-9), 1e-3, 0.1, 3e-8, 50), ((3e-4, -5e-4, 7e-4), 1.0, 0.13, 1e-4, 100)],
    ids=["linear", "fast rotation, authority reached"],
)
def test_everything_at_once_against_a_general_integrator(craft, Omega, scale, tau_es, tolerance, n):
    """What is quadratic in the motion is held over a step: this alone leaves an error."""
    run = craft(
        {
            **SKEW,
            "omega2_1_0": -4e-3,
            "omega2_2_0": 2e-3,
            "tau_es": tau_es,
            **dict(zip(RATES, Omega, strict=True)),
        },
        n_samples=n,
        authority=Authority("any", 2200e-12, 2200e-12, 10.4e-12, 5e-12),
        noise={"electrode": 1e-6},
        alignment_epoch=3,
        dc=1.2e-11,
        injections=(Sine("guidance_o_1", 4e-9, 0.2, 1, 2.0), HalfCosine("F_x_1", 2500e-12, 1.0, 6.0)),
    )
    driven = stimuli.injections(run) | shaken(n, scale)
    driven["F_x_1"], driven["F_x_2"] = stimuli.injections(run)["F_x_1"], 5e-12 * np.sin(np.arange(n))
    driven["g_2"] += run.dc
    got, expected = ClosedLoop(run).simulate(driven), by_integration(run, driven)
    assert_agree(got, expected, tolerance)


def test_x_axis_alone_is_the_reference_of_the_x_axis(craft, flight_noise):
    run = craft(
        n_samples=12_000,
        authority=Authority("tight", 10e-12, 20e-12, 10.4e-12, 1e-12),
        noise={**flight_noise, "f_x_1_jitter": 1e-14},
        dc=1e-11,
        injections=(
            Sine("guidance_o_1", 4e-9, 26.7e-3, 8, 10.0),
            Sine("guidance_o_12", 10e-9, 10e-3, 3, 100.0),
            HalfCosine("F_x_1", 12e-12, 300.0, 800.0),
        ),
    )
    quiet = replace(run, spacecraft="lpf-x")
    got = ClosedLoop(run).simulate(stimuli.injections(quiet) | stimuli.noise(quiet))
    assert_agree(got, simulate_reference(quiet), 1e-10)
    assert not got["Omega_phi"].any()
    assert not got["y_1"].any()


@pytest.mark.parametrize(
    ("truth", "driven", "expected"),
    [
        ({"delta_phi": -0.47e-3}, "N_noise_z_sc", 1e-6 / I_SC[2] * -0.47e-3 * D),
        ({"delta_eta": -0.137e-3}, "N_noise_y_sc", -1e-6 / I_SC[1] * -0.137e-3 * D),
        ({"Omega_phi_start": 2e-6}, "", 4e-12 * D),
        ({"Omega_eta_start": 3e-6}, "", 9e-12 * D),
        ({"Omega_theta_start": 3e-6}, "", 0.0),
    ],
)
def test_apparent_forces_have_the_sign_of_minus_g_rot(craft, truth, driven, expected):
    """x_2 - x_1 accelerates by Omega^2 d + dOmega_phi delta_y - dOmega_eta delta_z before control answers."""
    n = 4
    channels = ClosedLoop(craft(truth, n_samples=n)).simulate({driven: np.full(n, 1e-6)})
    acceleration = np.diff(channels["x_2"] - channels["x_1"], 2)[0] / H**2
    assert acceleration == pytest.approx(expected, rel=1e-3, abs=1e-20)


@pytest.mark.stat
def test_simulated_jitter_has_the_spectrum_of_the_linear_loop(craft):
    """20 - 100 mHz in 6 segments of 250 s: 4 sigma of their mean (p = 6e-5 each)."""
    noise = {
        "thruster": 0.15e-6,
        "thruster_torque": 0.08e-6,
        "grs": 1.8e-9,
        "grs_angle": 120e-9,
        "dws": 150e-12,
    }
    run = craft(n_samples=15_000, noise=noise)
    channels = ClosedLoop(run).simulate()
    f, _ = welch(channels["y_1"], fs=10, nperseg=2500)
    band = (f >= 20e-3) & (f <= 100e-3)
    names = ("y_1", "z_2", "eta_1", "phi_2", "theta_1", "Omega_phi", "ast_phi", "N_phi_1", "F_z_sc")
    spectra = response.cross_spectra(run, names, f[band])
    for i, name in enumerate(names):
        ratio = welch(channels[name], fs=10, nperseg=2500)[1][band] / spectra[:, i, i].real
        assert ratio.mean() == pytest.approx(1, abs=4 / np.sqrt(6 * band.sum())), name
