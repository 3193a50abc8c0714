"""Faults of telemetry that leave the contract intact: each is recognised and named, none passes for sound."""

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import CalibrationError
from fit.fitting import irls
from fit.pipeline import calibrate
from fit.settings import settings
from tests.oracles.synthetic import World, pair


def changed(run, **channels):
    """Return the run with channels replaced by functions of themselves."""
    return replace(run, channels=run.channels | {k: f(run.channels[k]) for k, f in channels.items()})


def runs():
    """Two experiments that tell all of test mass 2 and, the second, test mass 1."""
    return [*pair(World(), "A", seed=1), *pair(World(), "E", seed=2, drive_1=1e-12)]


def of(run, fault):
    """Return all runs, one of them with a fault."""
    return [fault(r) if r.run == run else r for r in runs()]


def clipped(level):
    """Clip f_x_2 at `level` of its extreme; of so heavy a test mass that the authority allows no more."""

    def fault(run):
        limit = level * np.abs(run.channels["f_x_2"]).max()
        at_limit = changed(run, f_x_2=lambda f: np.clip(f, -limit, limit))
        return replace(at_limit, m_tm=run.F_max_2 / limit)

    return fault


def storm(x):
    rng = np.random.default_rng(7)
    kicks = np.zeros(x.size)
    kicks[rng.integers(0, x.size, 900)] = rng.choice([-1, 1], 900) * 3e-9
    return x + kicks


def channel(run, name, function):
    """Return what makes all runs, a channel of one of them replaced."""
    return lambda: of(run, lambda r: changed(r, **{name: function}))


def two(**second):
    """Two experiments, the second in another world."""
    return lambda: [*pair(World(), "A", seed=1), *pair(World(**second), "E", seed=2, drive_1=1e-12)]


def silent_third():
    return [*runs(), *pair(World(), "B", seed=3, tones_12=(), tones_1=())]


#: What is wrong, the runs, and the code of what is then reported.
FAULTS = {
    "`f_x_1` with the wrong sign": (channel("E-sysid", "f_x_1", np.negative), "rejected"),
    "`f_x_2` in N instead of m s-2": (channel("A-sysid", "f_x_2", lambda f: 1.928 * f), "rejected"),
    "a noise run twice as loud as the experiment": (
        channel("A-noise", "o_12", lambda o: 2 * o),
        "marginalised_noise",
    ),
    "a noise run without any noise": (channel("A-noise", "o_12", np.zeros_like), "rejected"),
    "no noise run": (lambda: [r for r in runs() if r.run != "A-noise"], "no_noise_run"),
    "`f_x_2` at its limit now and then": (lambda: of("A-sysid", clipped(0.999)), "saturated"),
    "`f_x_2` at its limit for much of a run": (lambda: of("A-sysid", clipped(0.7)), "rejected"),
    "a storm of glitches": (channel("A-sysid", "o_12", storm), "rejected"),
    "experiments whose actuators differ by 1 %": (two(lambda_2=1.0884), "contradiction"),
    "an experiment without injections": (silent_third, "indeterminable"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_named(name):
    runs, code = FAULTS[name]
    joint = calibrate(runs()).joint
    codes = {w.code for w in (*joint.unsound, *joint.warnings)}
    assert code in codes
    assert bool(joint.unsound) == (code == "contradiction")
    assert ("rejected" in codes) == (code == "rejected")
    if not joint.unsound:  # what is shown holds
        for parameter, estimate in joint.parameters.items():
            assert abs(estimate.value - getattr(World(), parameter)) < 4.5 * estimate.sigma, parameter


def test_what_is_excluded_stops_nothing_and_is_no_sound_fit():
    wrong = channel("A-sysid", "o_12", np.negative)()
    results = calibrate(wrong, settings({"exclude": ["A"]}))
    assert not results.joint.unsound
    assert [w.code for w in results.experiments["A"].unsound] == ["implausible_gain"]
    assert not results.unsound


def test_an_iteration_that_does_not_settle_is_no_result(monkeypatch):
    monkeypatch.setattr(irls, "MAX_ITERATIONS", 2)
    with pytest.raises(CalibrationError, match=r"A, E: parameters still move by .* sigma after 2 iterations"):
        calibrate(runs())


def test_one_that_nearly_settles_is_not_sound(monkeypatch):
    monkeypatch.setattr(irls, "TOLERANCE", 0.0)
    results = calibrate(pair(World(), "A", seed=1))
    assert [w.code for w in results.joint.unsound] == ["not_converged"]
