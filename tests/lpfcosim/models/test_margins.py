"""Margins, poles and spectra of the whole spacecraft against an independent design and flight."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.linear import ClosedLoop, margins, stability
from lpfcosim.linear.sampled_model import SampledModel
from lpfcosim.models import model_of

H = 0.1
I_TM, W_ANGLE = 6.80e-4, -1.5e-6
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


@pytest.mark.parametrize(("truth", "slowest"), [(UNIT_GAIN, 4740), ({}, 5074)])
def test_slowest_mode_is_the_known_one(make_run, truth, slowest):
    """4740 s from the independent design; the true gain of the forces makes it 5074 s."""
    z = stability.poles(make_run(spacecraft="lpf", truth=truth))
    assert -H / np.log(np.abs(z[0])) == pytest.approx(slowest, rel=2e-3)


def test_thrusters_answer_x_1_as_in_flight(run):
    """|F/x| within 30 % of flight telemetry at 50, 100, 200 mHz; unity gain at 70 - 100 mHz."""
    f = np.array([50e-3, 100e-3, 200e-3])
    law = SampledModel("WholeDragFreeControl", model_of(run).parameters(run)["WholeDragFreeControl"], H)
    system = law.linearize(law.operating_point([0.0] * len(law.inputs)), moves=False)
    stiffness = np.abs(system.select(("o_1",), ("F_x_sc",)).frequency_response(f)[:, 0, 0])
    np.testing.assert_allclose(stiffness, [58, 141, 255], rtol=0.3)
    assert 0.07 < margins.margins(run)[0].unity_gain < 0.1


def levels(f):
    """Noise of the design: white, sensors 1/f below 1 mHz, torques on the test masses below 0.2 mHz."""
    psd = {"n_ast_theta": 0.6e-3**2, "n_ast_eta": 0.6e-3**2, "n_ast_phi": 0.13e-3**2}
    psd |= {f"F_noise_{k}_sc": 0.15e-6**2 for k in "xyz"} | {f"N_noise_{k}_sc": 0.08e-6**2 for k in "xyz"}
    for j in (1, 2):
        psd |= {f"n_grs_{k}_{j}": 1.8e-9**2 * (1 + (1e-3 / f) ** 2) for k in "xyz"}
        for k in ("theta", "eta", "phi"):
            psd[f"n_grs_{k}_{j}"] = 120e-9**2 * (1 + (1e-3 / f) ** 2)
            psd[f"gamma_{k}_{j}"] = 1.5e-12**2 * (1 + (0.2e-3 / f) ** 2)
    return psd | {f"n_{k}_{j}": 150e-12**2 for k in ("eta", "phi") for j in (1, 12)}


def spectra(run, f, psd):
    """Return PSDs of outputs that independent noise of these PSDs makes, by name."""
    system = ClosedLoop(run).linearize()
    power = np.abs(system.select(tuple(psd), system.outputs).frequency_response(f)) ** 2
    drive = np.array([np.broadcast_to(S, f.shape) for S in psd.values()])
    return dict(zip(system.outputs, np.einsum("nik,kn->in", power, drive), strict=True))


def test_rotation_emerges_with_its_known_spectrum(make_run):
    """From an independent design of the same loops, phi; the eta of its noisier axis is 4.4 times that."""
    f = np.array([0.03e-3, 0.1e-3, 0.3e-3, 1e-3])
    run = make_run(spacecraft="lpf", truth=UNIT_GAIN)
    S = spectra(run, f, levels(f))
    Omega = np.sqrt(S["Omega_phi"])
    np.testing.assert_allclose(Omega, [3.1e-8, 8.4e-8, 3.6e-8, 3.4e-9], rtol=0.05)
    np.testing.assert_allclose(2 * np.pi * f * Omega, [5.9e-12, 5.3e-11, 6.7e-11, 2.1e-11], rtol=0.05)
    np.testing.assert_allclose(np.sqrt(S["Omega_eta"]) / Omega, 4.6, rtol=0.05)
    np.testing.assert_allclose(2 * np.pi * f * np.sqrt(S["Phi"]), Omega, rtol=1e-6)
    with_flight_gain = spectra(replace(run, truth={}), f, levels(f))
    np.testing.assert_allclose(np.sqrt(with_flight_gain["Omega_phi"]), Omega, rtol=0.11)


def test_jitter_is_the_known_one(run):
    f = np.array([20e-3, 30e-3, 50e-3, 70e-3, 100e-3])
    S = spectra(run, f, levels(f))
    np.testing.assert_allclose(np.sqrt(S["y_1"]), np.array([19, 11, 5, 2.6, 1.3]) * 1e-9, rtol=0.06)
    np.testing.assert_allclose(np.sqrt(S["phi_1"]), np.array([24, 15, 7, 4.4, 2.6]) * 1e-9, rtol=0.06)
