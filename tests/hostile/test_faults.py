"""Faults of telemetry that leave the contract intact: each is recognised and named, none passes for sound."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from fit.errors import CalibrationError, InputError
from fit.fitting import irls
from fit.pipeline import calibrate
from fit.settings import settings
from tests.oracles.contract_file import UNITS, write_contract_file
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


@dataclass(frozen=True, eq=False)
class Fault:
    """A fault and what becomes of it.

    `outcome` is "refused" (exit status 2), "failed" (1), "no sigma", "left out" or "sound"; `code` that of
    the warning, if there is one.
    """

    name: str
    runs: Callable[[], list]
    outcome: str
    code: str | None = None


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


LEFT_OUT, MARGINALISED = ("left out", "rejected"), ("sound", "marginalised_noise")
BLIND = ("sound", "indeterminable")
FAULTS = [
    Fault("`o_12` with the wrong sign, in one experiment", channels("A-sysid", o_12=negative), *LEFT_OUT),
    Fault("the same where test mass 1 is driven too", channels("E-sysid", o_12=negative), *LEFT_OUT),
    Fault("`f_x_1` with the wrong sign", channels("E-sysid", f_x_1=negative), *LEFT_OUT),
    Fault("`f_x_2` in N instead of m s-2", channels("A-sysid", f_x_2=louder(1.928)), *LEFT_OUT),
    Fault("`o_12` in nm, declared as m", channels("A-sysid", o_12=louder(1e9)), *LEFT_OUT),
    Fault("`o_1` with the wrong sign, its guidance recorded", lambda: of("A-sysid", guided), *LEFT_OUT),
    Fault("a noise run at another authority", lambda: of("A-noise", weak), *LEFT_OUT),
    Fault("a noise run half as loud as the experiment", channels("A-noise", o_12=louder(0.5)), *MARGINALISED),
    Fault("a noise run twice as loud as the experiment", channels("A-noise", o_12=louder(2)), *MARGINALISED),
    Fault("a noise run of nothing but zeros", channels("A-noise", o_12=zero, f_x_2=zero), *LEFT_OUT),
    Fault("no noise run", lambda: [r for r in runs() if r.run != "A-noise"], "sound", "no_noise_run"),
    Fault("`f_x_2` at its limit now and then", lambda: of("A-sysid", clipped(0.999)), "sound", "saturated"),
    Fault("`f_x_2` at its limit for much of a run", lambda: of("A-sysid", clipped(0.7)), *LEFT_OUT),
    Fault("a storm of glitches", lambda: of("A-sysid", storm), *LEFT_OUT),
    Fault("experiments whose actuators differ by 1 %", two(lambda_2=1.0884), "no sigma", "contradiction"),
    Fault("one experiment, hence one authority", lambda: pair(World(), "A", seed=1), *BLIND),
    Fault("two tones too close to tell", lambda: pair(World(), "A", seed=1, tones_12=(3e-3,)), *BLIND),
    Fault("an experiment without injections", silent_third, *BLIND),
]


@cache
def told(fault):
    """Return what becomes of a fault, the results if there are any, and what is said of it."""
    try:
        results = calibrate(fault.runs())
    except InputError as error:
        return "refused", None, [str(error)]
    except CalibrationError as error:
        return "failed", None, [str(error)]
    codes = {w.code for w in results.joint.warnings}
    what = "no sigma" if results.joint.unsound else "left out" if "rejected" in codes else "sound"
    named = [*results.joint.unsound, *results.joint.warnings]
    return what, results, [w.message for w in named if fault.code in (w.code, None)]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_fault_is_named(fault):
    outcome, results, said = told(fault)
    assert outcome == fault.outcome
    assert said
    if results is not None and fault.outcome in ("sound", "left out"):  # what is shown holds
        for name, estimate in results.joint.parameters.items():
            assert abs(estimate.value - getattr(World(), name)) < 4.5 * estimate.sigma, name


def single(name, tone, fault):
    return [fault(r) for r in pair(World(), "A", seed=1, experiment=name, tones_12=(tone,), tones_1=())]


def test_a_single_tone_determines_the_sign_of_a_gain():
    flipped = [*single("A", 1e-3, lambda r: changed(r, o_12=negative))]
    flipped += single("B", 2e-2, lambda r: changed(r, o_12=negative))
    with pytest.raises(InputError, match=r"A-sysid\.h5: o_12 or .* wrong sign.*B-sysid\.h5: o_12 or"):
        calibrate(flipped)


def test_what_is_excluded_stops_nothing_and_is_no_sound_fit():
    wrong = of("A-sysid", lambda r: changed(r, o_12=negative))
    results = calibrate(wrong, settings({"exclude": ["A"]}))
    assert not results.joint.unsound
    assert [w.code for w in results.experiments["A"].unsound] == ["invalid_data"]
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


def test_what_rests_on_the_joint_fit_shares_its_doubts(monkeypatch):
    monkeypatch.setattr(irls, "TOLERANCE", 0.0)
    results = calibrate(mission_runs())
    assert results.cross_talk
    for fit in results.cross_talk.values():
        assert "not_converged" in {w.code for w in fit.unsound}


def mission_runs():
    found = [*pair(World(), "A", seed=1)]
    rng = np.random.default_rng(4)
    names = ("o_phi_1", "o_phi_12")
    return [
        replace(r, channels=r.channels | {n: 1e-8 * rng.standard_normal(r.time.size) for n in names})
        for r in found
    ]


def test_an_iteration_that_does_not_settle_is_no_result(monkeypatch):
    monkeypatch.setattr(irls, "MAX_ITERATIONS", 2)
    with pytest.raises(CalibrationError, match=r"A, E: parameters still move by .* sigma after 2 iterations"):
        calibrate(runs())


def test_one_that_nearly_settles_is_not_sound(monkeypatch):
    monkeypatch.setattr(irls, "TOLERANCE", 0.0)
    results = calibrate(pair(World(), "A", seed=1))
    assert [w.code for w in results.joint.unsound] == ["not_converged"]


@pytest.mark.slow
def test_no_table_shows_sigmas_that_do_not_hold(tmp_path, lpfcosim):
    wrong = next(fault for fault in FAULTS if fault.name.startswith("experiments whose actuators"))
    for run in wrong.runs():
        names = [
            "run",
            "experiment",
            "kind",
            "fs",
            "F_max_1",
            "F_max_2",
            "N_max_1",
            "N_max_2",
            "alignment_epoch",
        ]
        channels = {name: (values, UNITS[name]) for name, values in run.channels.items()}
        attributes = {name: getattr(run, name) for name in names}
        truth = {"lambda_2": World().lambda_2}
        write_contract_file(
            tmp_path / f"{run.run}.h5", samples=run.time.size, channels=channels, truth=truth, **attributes
        )
    status, out, err = lpfcosim("fit", tmp_path, "--out", tmp_path / "out")
    assert status == 1
    assert "the experiments contradict each other" in err.splitlines()[-1]
    row = next(line.split() for line in out.splitlines() if "lambda_2" in line)
    assert row[-2:] == ["1.083342(?)", "1.077600"]  # no sigma, truth, and no pull
    document = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert document["joint"]["sound"] is False
    assert "pull" not in document["joint"]["parameters"]["lambda_2"]
    assert (document["experiments"]["A"]["sound"], document["experiments"]["E"]["sound"]) == (True, True)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "(?)" in page
