"""Margins, poles and spectra of the whole spacecraft against an independent design and flight."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.linear import ClosedLoop, margins, response, stability
from lpfcosim.linear.sampled_model import SampledModel
from lpfcosim.models import model_of

H = 0.1
UNIT_GAIN = {"lambda_1": 1.0, "lambda_2": 1.0, "C_1": 0.139, "C_2": 0.173}


@pytest.fixture(scope="module")
def run(make_run):
    return make_run(spacecraft="lpf")


DESIGN = {  # Hz, deg, dB
    "drag_free_x": (0.08, 45, 14.5),
    **{f"drag_free_{k}": (30e-3, 56, 19) for k in ("y", "z", "theta", "eta", "phi")},
    "suspension_x": (1.0e-3, 59, 30),
    **{f"suspension_{k}": (2e-3, 58, 30) for k in ("eta_1", "phi_1", "theta_2", "eta_2", "phi_2")},
    **{f"attitude_{k}": (0.07e-3, 45, 13) for k in ("theta", "eta", "phi")},
}


def test_margins_are_those_of_the_design(make_run):
    """From an independent design of the same controllers, with electrostatic forces of gain one."""
    for m in margins.margins(make_run(spacecraft="lpf", truth=UNIT_GAIN)):
        unity, phase, gain = DESIGN[m.loop]
        assert m.unity_gain == pytest.approx(unity, rel=0.05), m
        assert m.phase_margin == pytest.approx(phase, abs=1), m
        assert m.gain_margin == pytest.approx(gain, abs=1), m


def test_gain_beyond_its_margin_is_unstable(run):
    """The margin of the weakest loop, attitude, against the poles."""
    margin = {m.loop: m.gain_margin for m in margins.margins(run)}["attitude_phi"]
    gain = ClosedLoop(run).loop_gain()
    for decibel, stable in ((margin - 0.05, True), (margin + 0.05, False)):
        scale = np.array([10 ** (decibel / 20) if name == "attitude_phi" else 1.0 for name in gain.outputs])
        closed = gain.A - gain.B * scale @ gain.C
        assert (np.abs(np.linalg.eigvals(closed)).max() < 1) == stable


@pytest.mark.parametrize(
    ("spacecraft", "truth", "slowest", "rel"),
    [("lpf-x", {}, 2350, 0.1), ("lpf", UNIT_GAIN, 4740, 2e-3), ("lpf", {}, 5074, 2e-3)],
)
def test_slowest_mode_is_the_known_one(make_run, spacecraft, truth, slowest, rel):
    """From the independent design; the true gain of the forces makes 5074 s of 4740 s."""
    z = stability.poles(make_run(spacecraft=spacecraft, truth=truth))
    assert (np.diff(np.abs(z)) <= 0).all()
    assert -H / np.log(np.abs(z[0])) == pytest.approx(slowest, rel=rel)


def test_thrusters_answer_x_1_as_in_flight(run):
    """|F/x| within 30 % of flight telemetry at 50, 100, 200 mHz; unity gain at 70 - 100 mHz."""
    f = np.array([50e-3, 100e-3, 200e-3])
    law = SampledModel("WholeDragFreeControl", model_of(run).parameters(run)["WholeDragFreeControl"], H)
    system = law.linearize(law.operating_point([0.0] * len(law.inputs)), moves=False)
    stiffness = np.abs(system.select(("o_1",), ("F_x_sc",)).frequency_response(f)[:, 0, 0])
    np.testing.assert_allclose(stiffness, [58, 141, 255], rtol=0.3)
    assert 0.07 < margins.margins(run)[0].unity_gain < 0.1


#: Of the design: white, but for sensors, which rise as 1/f below 1 mHz, and torques, below 0.2 mHz.
NOISE = {
    "thruster": 0.15e-6, "thruster_torque": 0.08e-6, "grs": 1.8e-9, "grs_angle": 120e-9, "torque": 1.5e-12,
    "dws": 150e-12, "star_tracker_theta": 0.6e-3, "star_tracker_eta": 0.6e-3, "star_tracker_phi": 0.13e-3,
}  # fmt: skip


def asd(run, f, *channels):
    """Return ASDs of outputs of the models, shape (outputs, n)."""
    spectra = response.cross_spectra(replace(run, noise=NOISE), channels, f)
    return np.sqrt(np.diagonal(spectra, axis1=1, axis2=2).real.T)


def test_rotation_emerges_with_its_known_spectrum(make_run):
    """From an independent design of the same loops, phi; the eta of its noisier axis is 4.4 times that."""
    f = np.array([0.03e-3, 0.1e-3, 0.3e-3, 1e-3])
    run = make_run(spacecraft="lpf", truth=UNIT_GAIN)
    Omega, Omega_eta, Phi = asd(run, f, "Omega_phi", "Omega_eta", "Phi")
    np.testing.assert_allclose(Omega, [3.1e-8, 8.4e-8, 3.6e-8, 3.4e-9], rtol=0.05)
    np.testing.assert_allclose(2 * np.pi * f * Omega, [5.9e-12, 5.3e-11, 6.7e-11, 2.1e-11], rtol=0.05)
    np.testing.assert_allclose(Omega_eta / Omega, 4.6, rtol=0.05)
    np.testing.assert_allclose(2 * np.pi * f * Phi, Omega, rtol=1e-6)
    with_flight_gain = asd(make_run(spacecraft="lpf"), f, "Omega_phi")[0]
    np.testing.assert_allclose(with_flight_gain, Omega, rtol=0.11)


def test_jitter_is_the_known_one(run):
    y_1, phi_1 = asd(run, np.array([20e-3, 30e-3, 50e-3, 70e-3, 100e-3]), "y_1", "phi_1")
    np.testing.assert_allclose(y_1, np.array([19, 11, 5, 2.6, 1.3]) * 1e-9, rtol=0.06)
    np.testing.assert_allclose(phi_1, np.array([24, 15, 7, 4.4, 2.6]) * 1e-9, rtol=0.06)
