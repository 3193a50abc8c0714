"""Faults of telemetry that leave the contract intact: each is recognised and named, none passes for sound."""

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import CalibrationError, InputError
from fit.fitting import irls
from fit.pipeline import calibrate
from fit.settings import settings
from tests.oracles.synthetic import World, pair


def changed(run, **channels):
    """Return the run with channels replaced by functions of themselves."""
    return replace(run, channels=run.channels | {k: f(run.channels[k]) for k, f in channels.items()})


def negative(values):
    return -values


def runs():
    """Two experiments that tell all of test mass 2 and, the second, test mass 1."""
    return [*pair(World(), "A", seed=1), *pair(World(), "E", seed=2, drive_1=1e-12)]


def of(run, fault):
    """Return all runs, one of them with a fault."""
    return [fault(r) if r.run == run else r for r in runs()]


def zero(values):
    return 0 * values


def weak(run):
    return replace(run, F_max_2=50e-12)


def guided(run):
    return replace(run, channels=run.channels | {"guidance_o_1": -run.channels["o_1"]})


def clipped(level):
    """Clip f_x_2 at `level` of its extreme; of so heavy a test mass that the authority allows no more."""

    def fault(run):
        limit = level * np.abs(run.channels["f_x_2"]).max()
        at_limit = changed(run, f_x_2=lambda f: np.clip(f, -limit, limit))
        return replace(at_limit, m_tm=run.F_max_2 / limit)

    return fault


def storm(run):
    rng = np.random.default_rng(7)
    kicks = np.zeros(run.time.size)
    kicks[rng.integers(0, kicks.size, 900)] = rng.choice([-1, 1], 900) * 3e-9
    return changed(run, o_12=lambda o: o + kicks)


def channels(run, **functions):
    """Return a function that makes all runs, channels of one of them replaced."""
    return lambda: of(run, lambda r: changed(r, **functions))


def louder(factor):
    return lambda values: factor * values


def two(**second):
    """Two experiments, the second in another world."""
    return lambda: [*pair(World(), "A", seed=1), *pair(World(**second), "E", seed=2, drive_1=1e-12)]


def silent_third():
    return [*runs(), *pair(World(), "B", seed=3, tones_12=(), tones_1=())]


#: What is wrong, the runs, and the code of what is then reported.
FAULTS = {
    "`o_12` with the wrong sign, in one experiment": (channels("A-sysid", o_12=negative), "rejected"),
    "the same where test mass 1 is driven too": (channels("E-sysid", o_12=negative), "rejected"),
    "`f_x_1` with the wrong sign": (channels("E-sysid", f_x_1=negative), "rejected"),
    "`f_x_2` in N instead of m s-2": (channels("A-sysid", f_x_2=louder(1.928)), "rejected"),
    "`o_12` in nm, declared as m": (channels("A-sysid", o_12=louder(1e9)), "rejected"),
    "`o_1` with the wrong sign, its guidance recorded": (lambda: of("A-sysid", guided), "rejected"),
    "a noise run at another authority": (lambda: of("A-noise", weak), "rejected"),
    "a noise run half as loud as the experiment": (
        channels("A-noise", o_12=louder(0.5)),
        "marginalised_noise",
    ),
    "a noise run twice as loud as the experiment": (
        channels("A-noise", o_12=louder(2)),
        "marginalised_noise",
    ),
    "a noise run of nothing but zeros": (channels("A-noise", o_12=zero, f_x_2=zero), "rejected"),
    "no noise run": (lambda: [r for r in runs() if r.run != "A-noise"], "no_noise_run"),
    "`f_x_2` at its limit now and then": (lambda: of("A-sysid", clipped(0.999)), "saturated"),
    "`f_x_2` at its limit for much of a run": (lambda: of("A-sysid", clipped(0.7)), "rejected"),
    "a storm of glitches": (lambda: of("A-sysid", storm), "rejected"),
    "experiments whose actuators differ by 1 %": (two(lambda_2=1.0884), "contradiction"),
    "one experiment, hence one authority": (lambda: pair(World(), "A", seed=1), "indeterminable"),
    "two tones too close to tell": (lambda: pair(World(), "A", seed=1, tones_12=(3e-3,)), "indeterminable"),
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


def single(name, tone, fault):
    return [fault(r) for r in pair(World(), "A", seed=1, experiment=name, tones_12=(tone,), tones_1=())]


def test_a_single_tone_determines_the_sign_of_a_gain():
    flipped = [*single("A", 1e-3, lambda r: changed(r, o_12=negative))]
    flipped += single("B", 2e-2, lambda r: changed(r, o_12=negative))
    with pytest.raises(InputError, match=r"A-sysid\.h5: o_12 or .* wrong sign.*B"):
        calibrate(flipped)


def test_what_is_excluded_stops_nothing_and_is_no_sound_fit():
    wrong = of("A-sysid", lambda r: changed(r, o_12=negative))
    results = calibrate(wrong, settings({"exclude": ["A"]}))
    assert not results.joint.unsound
    assert [w.code for w in results.experiments["A"].unsound] == ["implausible_gain"]
    assert not results.unsound


@pytest.mark.parametrize(
    "guidance",
    [
        lambda t: np.full(t.size, 3e-9),
        lambda t: 1e-9 * np.sin(2 * np.pi * 0.08 * t),
        lambda t: 1e-9 * np.sin(2 * np.pi * 0.03 * t),
        lambda t: 1e-12 * np.sin(2 * np.pi * 0.0011 * t),
    ],
    ids=["constant", "80 mHz", "30 mHz", "unanswered"],
)
def test_guidance_that_tells_no_sign_is_no_fault(guidance):
    sysid, *others = runs()
    with_guidance = sysid.channels | {"guidance_o_1": guidance(sysid.time)}
    assert not calibrate([replace(sysid, channels=with_guidance), *others]).joint.unsound


def test_an_iteration_that_does_not_settle_is_no_result(monkeypatch):
    monkeypatch.setattr(irls, "MAX_ITERATIONS", 2)
    with pytest.raises(CalibrationError, match=r"A, E: parameters still move by .* sigma after 2 iterations"):
        calibrate(runs())


def test_one_that_nearly_settles_is_not_sound(monkeypatch):
    monkeypatch.setattr(irls, "TOLERANCE", 0.0)
    results = calibrate(pair(World(), "A", seed=1))
    assert [w.code for w in results.joint.unsound] == ["not_converged"]
