"""Faults of the model that all runs have in common are named; clean runs raise no alarm."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fit.checks.misfit import model_findings
from fit.pipeline import calibrate
from fit.whitening import pair
from tests.hostile.catalogue import (
    averaged,
    leaking_guidance,
    played,
    pushed_at,
    weaker_at_large_force,
)
from tests.hostile.spoiling import all_of, changed, clean, every, gain, glitch, pushed, remade
from tests.oracles import thirteen

NAMES = ("A2", "G3", "B4", "C4", "D4")


@cache
def causes(spoil=None, names=NAMES):
    """Return the records of what is wrong with a campaign."""
    runs = clean(names)
    warnings = model_findings(pair(list((spoil(runs) if spoil else runs).values())))
    assert all(w.code == "model_misfit" and w.kind.unsound for w in warnings)
    return [cause for w in warnings for cause in w.causes]


@pytest.mark.parametrize("guidance", ["guidance_o_1", "guidance_o_12"])
def test_guidance_that_leaks_into_o_12_is_named(guidance):
    (cause,) = causes(leaking_guidance(guidance, 2e-4))
    assert (cause.channel, cause.code, cause.run) == ("o_12", "guidance leak", "")
    assert abs(cause.amount.value - 2e-4) < 1e-6 + 5 * cause.amount.sigma
    assert guidance in cause.message


def test_an_actuator_that_acts_less_at_large_forces_is_named():
    named = causes(every(lambda run: remade(run, hidden=gain(2, weaker_at_large_force(2e-4)))))
    assert {cause.code for cause in named} == {"gain by force"}
    assert "f_x_2" in {cause.channel for cause in named}
    sizes = {cause.channel: cause.amount.value for cause in named}
    assert abs(sizes["f_x_2"] + 2e-4) < 2e-5


def test_what_runs_have_in_common_with_a_template_is_a_misfit_though_it_is_not_all_of_it():
    runs = every(lambda run: changed(run, o_12=played))(clean(NAMES))
    (warning,) = model_findings(pair(list(runs.values())))
    assert warning.kind.unsound and "sigma of this" in warning.message


def test_of_two_runs_the_one_with_an_unrecorded_force_is_left_out():
    spoil = pushed_at(1.667e-3, amplitude=2e-15, names=("B4",))
    results = calibrate(list(spoil(clean(("B4", "C4"))).values()))
    assert results.provenance.joint_runs == ["C4-sysid"]
    assert not results.joint.unsound
    assert results.experiments["B4"].unsound


def test_a_force_that_the_only_run_does_not_record_is_named():
    (cause,) = causes(pushed_at(1.667e-3, amplitude=2e-14, names=("B4",)), ("B4",))
    assert (cause.code, cause.run) == ("unrecorded force", "B4")
    assert float(cause.message.split()[3]) == pytest.approx(2e-14, rel=0.1, abs=0)


@pytest.mark.parametrize("pulse", [(7000, 1e-9, 20, 60), (8000, 1e-10, 900, 7200)])
def test_a_glitch_in_the_only_run_is_no_misfit(pulse):
    assert causes(remade("B4-sysid", hidden=pushed(glitch(*pulse))), ("B4",)) == []


def test_read_outs_that_are_averaged_are_named():
    named = causes(averaged(), tuple(name for name in thirteen.PLANS if name != "D3"))
    assert {cause.code for cause in named} == {"averaging"}
    amounts = [cause.amount.value for cause in named if cause.amount]
    assert amounts
    assert amounts == pytest.approx([1] * len(amounts), abs=0.1)


def test_an_o_12_that_is_not_linear_is_named():
    runs = clean(NAMES)
    for name, run in runs.items():
        if run.kind == "sysid":
            o_12 = run.channels["o_12"]
            runs[name] = replace(
                run, channels=run.channels | {"o_12": o_12 * (1 - 2e-4 * (o_12 / 1e-8) ** 2)}
            )
    ((warning,),) = [model_findings(pair(list(runs.values())))]
    (cause,) = warning.causes
    assert (cause.channel, cause.code) == ("o_12", "non-linearity")
    assert abs(cause.amount.value + 2e-4) < 5 * cause.amount.sigma


def late(samples, *names):
    """Return a spoil that makes o_1 of some runs late by so many samples."""
    return all_of(*(changed(f"{name}-sysid", o_1=lambda x: np.roll(x, samples)) for name in names))


def hardening(time, channels):
    """What a stiffness of test mass 2 adds that falls by 1e-7 s-2 at 10 nm, with the square of x_2."""
    x_2 = channels["o_1"] + channels["o_12"]
    return 0 * time, 0 * time, 1e-7 * x_2 * (x_2 / 1e-8) ** 2


@pytest.mark.parametrize("names", [NAMES, ("B4",)])
def test_stiffness_that_depends_on_the_displacement_is_named(names):
    (cause,) = causes(every(lambda run: remade(run, hidden=hardening)), names)
    assert (cause.channel, cause.code, cause.amount.unit) == ("omega2_2", "non-linearity", "s-2")
    assert abs(cause.amount.value + 1e-7) < 5 * cause.amount.sigma
    assert cause.amount.sigma < 1e-8


def test_o_1_that_is_early_in_all_runs_of_an_epoch_is_named():
    (warning,) = model_findings(pair(list(late(-1, "B4", "C4", "D4")(clean(NAMES)).values())))
    assert (warning.code, warning.kind.unsound) == ("model_misfit", True)
    (cause,) = warning.causes
    assert abs(cause.amount.value + 1) < 0.1  # to first order
    assert "o_1 is early by" in warning.message


@pytest.mark.parametrize(
    "spoil",
    [
        None,
        remade("B4-sysid", hidden=gain(2, weaker_at_large_force(1e-2))),
        late(1, "B4"),
        remade("G3-sysid", hidden=pushed(glitch(3000, 1e-10, 100, 600))),
    ],
)
def test_what_a_single_run_has_is_none_of_the_model(spoil):
    assert causes(spoil) == []


@pytest.mark.stat
def test_a_clean_campaign_raises_no_alarm():
    """By chance one in 6,000 campaigns does."""
    assert model_findings(pair(list(thirteen.campaign(20, names=NAMES).values()))) == []
