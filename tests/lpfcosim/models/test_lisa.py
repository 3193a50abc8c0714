"""One spacecraft of LISA: margins, spectra, the loop by a general integrator, FMUs, the packaged example."""

import numpy as np
import pytest

import fit
import lpfcosim
from lpfcosim.campaign import loading
from lpfcosim.execution import telemetry_file
from lpfcosim.linear import ClosedLoop, margins, response
from lpfcosim.modelica import build, numpy_models
from lpfcosim.models import lisa, model_of
from lpfcosim.spacecraft import Sine
from tests import ROOT
from tests.agreement import assert_agree
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.models.test_lisa_plant import SKEW
from tests.oracles.lisa_equations import by_integration

LEVELS = {
    "tmi": 1.42e-12, "tmi_dws": 0.15e-9, "dws": 0.209e-9, "grs": 1.8e-9, "grs_angle": 120e-9,
    "thruster": 0.1e-6, "thruster_torque": 0.05e-6, "test_mass": 2.4e-15, "lateral": 1e-14, "torque": 1.5e-12,
}  # fmt: skip
FALL_BACK = "lisa-fall-back"


@pytest.fixture
def lisa_run(make_run):
    """Make a run of LISA with the noise of flight."""
    return lambda key="lisa", **fields: make_run(**{"spacecraft": key, "noise": {**LEVELS}, **fields})


def test_fifteen_loops_and_the_opening_keep_their_margins(lisa_run):
    table = {margin.loop: margin for margin in margins.margins(lisa_run())}
    assert len(table) == 16
    assert all(margin.phase_margin > 45 and margin.gain_margin > 14 for margin in table.values())
    for j in ("x_1", "plane"):
        assert table[f"drag_free_{j}"].unity_gain == pytest.approx(80e-3, rel=0.01)
    assert table["pointing_opening"].unity_gain == pytest.approx(3e-3, rel=0.01)
    assert table["suspension_plane"].unity_gain == pytest.approx(2e-3, rel=0.01)


def test_fall_back_suspends_test_mass_2_at_1_mhz(lisa_run):
    table = {margin.loop: margin for margin in margins.margins(lisa_run(FALL_BACK))}
    # authority along x_2 adds to the stiffness there
    assert table["suspension_plane"].unity_gain == pytest.approx(0.97e-3, rel=0.02)
    assert table["drag_free_plane"].unity_gain == pytest.approx(30e-3, rel=0.01)


def test_jitter_spectra(lisa_run):
    """Of the same prototype, at 100 mHz recomputed for 0.25 s of transport: 0.24 nm there, not 0.25."""
    frequency = np.array([1e-3, 3e-3, 10e-3, 30e-3, 100e-3])
    channels = ["jitter_x_1", "jitter_x_2", "jitter_eta"]
    S = response.cross_spectra(lisa_run(), channels, frequency)
    x_1, x_2, eta = np.sqrt(np.abs(np.diagonal(S, axis1=1, axis2=2))).T * 1e9
    np.testing.assert_allclose(x_1, [0.12, 0.33, 0.63, 0.69, 0.24], rtol=0.05)
    np.testing.assert_allclose(x_2, x_1, rtol=1e-4)
    np.testing.assert_allclose(eta, [2.6, 4.5, 4.5, 1.7, 0.18], rtol=0.05)


def shaken(run, scale):
    """Return noise on every signal from outside."""
    sizes = {
        "F_noise": 1e-5,
        "N_noise": 1e-5,
        "n_grs": 5e-9,
        "n_1": 1e-10,
        "n_2": 1e-10,
        "guidance": 1e-9,
        "e_": 1e-2,
    }
    rng = np.random.default_rng(3)
    driven = {}
    for name in sorted({*ClosedLoop(run).inputs, "g_1", "g_2"}):
        size = next((x for key, x in sizes.items() if name.startswith(key)), 3e-10)
        driven[name] = scale * size * rng.standard_normal(run.n_samples)
    return driven


@pytest.mark.parametrize("key", ["lisa", FALL_BACK])
def test_everything_at_once_against_a_general_integrator(lisa_run, key):
    errors = {name: 0.1 * (i + 1) for i, name in enumerate(n for n in lisa.MODEL.truth_keys if "o_per" in n)}
    gains = {"lambda_x_2": 1.05, "lambda_y_1": 0.95, "lambda_y_2": 1.07, "lambda_z_1": 0.9, "lambda_z_2": 1.1,
             "lambda_N": 1.03, "grs_gain_y_1": 1.2, "grs_gain_y_2": 0.8, "dws_gain": 0.9, "x_per_y_1": 0.2,
             "x_per_y_2": -0.1, "x_per_phi_1": 30.0, "x_per_phi_2": -20.0, "grs_y_per_x_1": 0.15,
             "grs_y_per_x_2": -0.25}  # fmt: skip
    limits = {"F_max_yz": 1e-9, "N_max_eta": 5e-13}
    run = lisa_run(key, n_samples=40, truth={**SKEW, **errors, **gains, **limits})
    driven = shaken(run, 1e-3)
    models = model_of(run)
    p = {name: value for m in models.models for name, (value, _) in numpy_models.load(m).PARAMETERS.items()}
    p |= {name: value for values in models.parameters(run).values() for name, value in values.items()}
    channels, expected = ClosedLoop(run).simulate(driven), by_integration(p, driven, run.n_samples)
    assert_agree(channels, expected, 3e-8)
    assert channels["F_x_2"].any() == (key == FALL_BACK)


def test_record_attributes_and_truth(lisa_run):
    run = lisa_run(truth={"lambda_y_1": 1.05, "tau_1": 0.2})
    assert {"o_1", "o_2", "dws_phi_1", "mosa_2", "F_y_1", "guidance_opening", "jitter_theta"} <= set(
        lisa.MODEL.record
    )
    assert not {"o_12", "f_x_1", "f_x_2"} & set(lisa.MODEL.record)
    attributes, truth = telemetry_file.attributes(run), telemetry_file.truth(run)
    assert attributes["half_opening"] == pytest.approx(np.pi / 6, rel=1e-15)
    assert (attributes["d_x"], attributes["d_y"]) == (0.0, 0.5)
    assert truth["C_y_1"] == pytest.approx(1.05 * 0.25, rel=1e-15)
    assert truth["omega2_x_1"] == pytest.approx(-3.2e-7 - 26.5e3 * run.authority.N_max_1, rel=1e-12, abs=0)
    assert "C_1" not in truth


def test_stiffness_of_the_shipped_campaign_follows_its_authority():
    plan = loading.load(ROOT / "campaigns" / "lisa.toml")
    assert model_of(plan.runs[0]) is lisa.MODEL
    stiffness = {run.name: telemetry_file.truth(run)["omega2_x_1"] for run in plan.runs}
    assert stiffness["B"] - stiffness["A"] == pytest.approx(-26.5e3 * (5e-12 - 10.4e-12), rel=1e-9, abs=0)


@pytest.mark.slow
def test_fall_back_is_calibrated_with_priors_of_the_science_mode(tmp_path):
    plan = lpfcosim.load_campaign(ROOT / "campaigns" / "lisa-fall-back.toml")
    lpfcosim.simulate(plan, tmp_path, fmus=False)
    joint = fit.calibrate(fit.load(tmp_path), parameters=plan.fit["parameters"]).joint
    assert not joint.unsound
    assert joint["lambda_x_2"].sigma == pytest.approx(lpfcosim.forecast(plan)["lambda_x_2"].sigma, rel=0.1)
    assert max(abs(e.pull) for e in joint.parameters.values()) < 3.5


@pytest.mark.fmu
@pytest.mark.parametrize("key", ["lisa", FALL_BACK])
def test_fmus_agree_with_the_equations(lisa_run, key):
    tones = [Sine("guidance_o_1", 1e-6, 0.01, 5, 50.0), Sine("guidance_phi", 3e-8, 0.043, 20, 50.0)]
    tones += [Sine("guidance_opening", 6e-8, 0.046, 20, 50.0), Sine("guidance_y_2", 1e-6, 0.005, 2, 50.0)]
    run = lisa_run(key, n_samples=6000, injections=tuple(tones))
    got, expected = in_memory.simulate(run, build.build(lisa.MODEL.models)), ClosedLoop(run).simulate()
    assert set(got) == set(lisa.MODEL.record)
    assert_agree(got, expected, floor=1e-28)
