"""Closed-loop poles: against design values, and against what an unstable loop then does."""

import numpy as np
import pytest

from lpfcosim.errors import InputError
from lpfcosim.linear import stability
from tests.reference_run import simulate_reference

DRAG_FREE = {"f_u": 0.08, "f_z": 0.03, "f_i": 0.006, "f_p": 0.8, "f_r": 2.0}
SUSPENSION = {"f_u": 1e-3, "f_z": 0.3e-3, "f_i": 0.06e-3, "f_p": 6e-3, "f_r": 30e-3}


def drag_free(**values):
    return {"control": {"DragFreeControl": DRAG_FREE | values}}


def suspension(**values):
    return {"control": {"SuspensionControl": SUSPENSION | values}}


UNSTABLE = {
    "suspension too fast for its delay": {
        **suspension(f_u=0.6, f_p=6.0, f_r=30.0),
        "truth": {"C_2": 1.5},
    },
    "drag-free too fast for the thrusters": drag_free(f_u=0.5),
    "stiffness beyond the suspension": {"truth": {"omega2_2_0": -3e-4}},
}


@pytest.mark.parametrize("change", UNSTABLE.values(), ids=UNSTABLE)
def test_of_many_runs_the_unstable_one_is_refused_with_its_pole(make_run, change):
    stable = [make_run(name=f"calm{i}", noise={"oms": 1e-15 * i}, seed=i) for i in range(3)]
    stability.check(*stable)
    run = make_run(name="shaky", **change)
    with pytest.raises(InputError, match=r"^shaky: the closed loop is unstable.*1/s") as refusal:
        stability.check(*stable, run, *stable)
    assert f"z = {stability.poles(run)[0]:.6g}" in str(refusal.value)


@pytest.mark.parametrize("change", UNSTABLE.values(), ids=UNSTABLE)
def test_an_unstable_loop_grows_at_the_rate_of_its_pole(make_run, flight_noise, change):
    """The pole is right: a disturbance grows as |z|^n in the simulation."""
    growth = np.log(abs(stability.poles(make_run(**change))[0]))  # per sample
    # 1e-18 of the usual noise leaves many e-foldings of the pole alone before the test mass is lost
    faint = {"oms": 1e-18 * flight_noise["oms"], "thruster": 1e-18 * flight_noise["thruster"]}
    n = int(32 / growth)
    o = simulate_reference(make_run(noise=faint, n_samples=n, **change))
    size = np.maximum(np.abs(o["o_1"]), np.abs(o["o_12"]))
    quarter = int(8 / growth)
    later, earlier = size[-quarter:].max(), size[-2 * quarter : -quarter].max()
    assert np.log(later / earlier) / quarter == pytest.approx(growth, rel=0.1)
