"""Another world is one module: its tables choose the wiring, the reference plant and all that follows."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lpfcosim.cosim import co_simulation, compatibility
from lpfcosim.execution import telemetry_file
from lpfcosim.linear import margins, saturation, stability
from lpfcosim.modelica import build
from lpfcosim.models import along_x, drive, whole, world, world_of
from lpfcosim.spacecraft.spacecraft import Spacecraft


@dataclass(frozen=True)
class Witness:
    """What a run along x of a third world has: a window on the test mass, and a set point that grows."""

    rate: float


def simulate(run):
    found = along_x.WORLD.simulate(run)
    return found | {"x_1": found["o_1"] - drive.noise(run)["n_1"]}


WATCHED = replace(
    along_x.WORLD,
    name="along x, watched",
    equipment=Witness,
    record={**along_x.RECORD, "x_1": "Plant.x_1", "shown": "shown"},
    turns=lambda run: {"shown": run.spacecraft.rate},
    simulate=simulate,
    truth=lambda run: {"rate": run.spacecraft.rate},
    attributes=lambda _: {"watched": 1},
)


@pytest.fixture
def run(make_run, flight_noise, monkeypatch):
    monkeypatch.setattr(world, "WORLDS", dict(world.WORLDS))
    world.register(WATCHED)
    return make_run(noise=flight_noise, n_samples=600, spacecraft=Witness(1e-9))


def test_a_run_chooses_its_world(run):
    assert world_of(run) is WATCHED
    assert world_of(replace(run, spacecraft=None)) is along_x.WORLD
    assert world_of(replace(run, spacecraft=Spacecraft())) is whole.WORLD


def test_third_world_is_simulated_without_fmus(run):
    channels = WATCHED.simulate(run)
    assert channels["x_1"].std() > 0
    assert np.array_equal(channels["o_12"], along_x.WORLD.simulate(replace(run, spacecraft=None))["o_12"])


@pytest.mark.fmu
def test_third_world_is_wired_and_recorded(run):
    fmus = build.build([c.model for c in WATCHED.components])
    found = compatibility.read_interfaces(run, fmus)
    assert [i.model for i in found] == [c.model for c in WATCHED.steps(run)]
    (got,) = co_simulation.blocks(run, found)
    assert got.keys() == WATCHED.record.keys()
    expected = WATCHED.simulate(run)["x_1"]
    # the plant steps last: what it puts out is where its step has led
    np.testing.assert_allclose(got["x_1"][:-1], expected[1:], rtol=0, atol=1e-9 * expected.std())
    assert np.array_equal(got["shown"], 1e-9 * run.time)


def test_third_world_has_loops_limits_attributes_and_truth(run):
    stability.check(run)
    assert [m.loop for m in margins.margins(run)] == ["drag_free_x", "suspension_x"]
    assert saturation.count(run, {"f_x_2": np.array([0.0, 1.0])}) == 1
    assert telemetry_file.attributes(run)["watched"] == 1
    assert telemetry_file.truth(run)["rate"] == 1e-9


def test_margins_along_x_are_those_of_the_whole_spacecraft(make_run):
    alone = margins.margins(make_run())
    together = {m.loop: m for m in margins.margins(make_run(spacecraft=Spacecraft()))}
    for margin in alone:
        other = together[margin.loop]
        assert margin.unity_gain == pytest.approx(other.unity_gain, rel=1e-9)
        assert margin.phase_margin == pytest.approx(other.phase_margin, rel=1e-9)
        assert margin.gain_margin == pytest.approx(other.gain_margin, rel=1e-9)
