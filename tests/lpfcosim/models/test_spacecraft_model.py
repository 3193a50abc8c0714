"""Another spacecraft model is one module: its models and tables choose the wiring and all that follows."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.cosim import co_simulation, compatibility
from lpfcosim.execution import telemetry_file
from lpfcosim.linear import ClosedLoop, margins, saturation, stability
from lpfcosim.modelica import build
from lpfcosim.models import model_of, one_axis, register, six_dof, spacecraft_model
from lpfcosim.spacecraft.spacecraft import Spacecraft

WATCHED = replace(
    one_axis.MODEL,
    key="watched",
    name="along x, watched",
    attitude_rates=lambda _: {"guidance_o_1": 1e-12},
    truth=lambda _: {"rate": 1e-12},
    attributes=lambda _: {"watched": 1},
)


@pytest.fixture
def run(make_run, flight_noise, monkeypatch):
    monkeypatch.setattr(spacecraft_model, "MODELS", dict(spacecraft_model.MODELS))
    register(WATCHED)
    return make_run(noise=flight_noise, n_samples=600, spacecraft="watched")


def test_a_run_chooses_its_model(run):
    assert model_of(run) is WATCHED
    assert model_of(replace(run, spacecraft=None)) is one_axis.MODEL
    assert model_of(replace(run, spacecraft=Spacecraft())) is six_dof.MODEL


@pytest.mark.fmu
def test_third_model_is_wired_and_recorded(run):
    found = compatibility.read_interfaces(run, build.build(WATCHED.models))
    assert [i.model for i in found] == [c.model for c in WATCHED.components(run)]
    (got,) = co_simulation.blocks(run, found)
    assert got.keys() == WATCHED.record.keys()
    expected = ClosedLoop(run).simulate()["o_12"]
    np.testing.assert_allclose(got["o_12"], expected, rtol=0, atol=1e-9 * expected.std())
    assert np.array_equal(got["guidance_o_1"], 1e-12 * run.time)


def test_third_model_has_loops_limits_attributes_and_truth(run):
    stability.check(run)
    assert [m.loop for m in margins.margins(run)] == ["drag_free_x", "suspension_x"]
    assert saturation.count(ClosedLoop(run).limits, {"f_x_2": np.array([0.0, 1.0])}) == 1
    assert telemetry_file.attributes(run)["watched"] == 1
    assert telemetry_file.truth(replace(run, parameters={"lambda_bend_1": 0.01})) == {
        "rate": 1e-12,
        "lambda_bend_1": 0.01,
    }


def test_margins_along_x_are_those_of_the_whole_spacecraft(make_run):
    alone = margins.margins(make_run())
    together = {m.loop: m for m in margins.margins(make_run(spacecraft=Spacecraft()))}
    for margin in alone:
        other = together[margin.loop]
        assert margin.unity_gain == pytest.approx(other.unity_gain, rel=1e-9)
        assert margin.phase_margin == pytest.approx(other.phase_margin, rel=1e-9)
        assert margin.gain_margin == pytest.approx(other.gain_margin, rel=1e-9)
