"""Files that contradict themselves or each other are excluded by name, and no others."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fit.campaign import LATER
from fit.checks import apply
from fit.errors import InputError
from fit.pipeline import calibrate
from fit.whitening import pair
from tests.fit.checks.campaigns import campaign as campaign_of
from tests.oracles import synthetic
from tests.oracles.synthetic import World


def runs(*names, **options):
    return {
        r.run: r for n, name in enumerate(names) for r in synthetic.pair(World(), name, seed=n, **options)
    }


def changed(run, **channels):
    return replace(run, channels=run.channels | {k: f(run.channels[k]) for k, f in channels.items()})


def renamed(run, name):
    return replace(
        run, path=run.path.with_name(f"{name}-{run.kind}.h5"), run=f"{name}-{run.kind}", experiment=name
    )


def faults(campaign):
    found = apply("files", campaign_of(pair(list(campaign.values()))))
    found.sort(key=lambda finding: finding.code in LATER)
    return {finding.run.partition("-")[0]: finding.message for finding in reversed(found)}


def cut(run, part):
    channels = {name: values[part] for name, values in run.channels.items()}
    return replace(run, channels=channels, time=run.time[: channels["o_1"].size])


# --- one run under two names ----------------------------------------------------------------------------


def exchange(campaign, run, source, *names):
    """Replace channels of a run, all where no name is given, by those of another."""
    channels = campaign[source].channels
    channels = {name: channels[name] for name in names or channels}
    campaign[run] = replace(
        campaign[run], channels=campaign[run].channels | channels, time=campaign[source].time
    )


@pytest.mark.parametrize(
    ("exchanged", "excluded"),
    [
        (("B-sysid", "A-sysid", "o_12"), ["A", "B"]),
        (("A-noise", "A-sysid"), ["A"]),
        (("A-noise", "B-sysid"), ["A"]),
        (("A-sysid", "B-noise"), ["A"]),
        (("B-noise", "A-noise"), ["A", "B"]),
    ],
    ids=[
        "read-out",
        "noise run of its sysid run",
        "noise run of another",
        "no injections",
        "shared noise run",
    ],
)
def test_samples_of_another_run_exclude_the_experiments_in_doubt(exchanged, excluded):
    campaign = runs("A", "B", "E")
    exchange(campaign, *exchanged)
    assert sorted(faults(campaign)) == excluded


@pytest.mark.parametrize(
    ("disguise", "words"),
    [
        (lambda r: changed(r, o_1=lambda x: -x, o_12=lambda x: -x), "the same noise"),
        (lambda r: cut(r, slice(1800, None)), "1800 s earlier"),
        (
            lambda r: changed(r, o_12=lambda x: np.where(np.arange(x.size) % 500, x, 1e-6)),
            "the same noise",
        ),
    ],
    ids=["turned", "cut", "spoilt here and there"],
)
def test_one_experiment_under_two_names(disguise, words):
    campaign = runs("A", "E")
    campaign |= {
        r.run: r for r in (renamed(disguise(campaign[f"A-{kind}"]), "B") for kind in ("sysid", "noise"))
    }
    ((name, reason),) = faults(campaign).items()
    assert name == "B"
    assert reason.startswith("B-sysid.h5: o_1 and o_12: the same noise as in A-sysid.h5")
    assert words in reason


# --- what files say of themselves -----------------------------------------------------------------------


def test_a_noise_run_of_another_authority_costs_one_experiment_only():
    campaign = runs("A", "B", "E")
    campaign["A-noise"] = replace(campaign["A-noise"], F_max_2=50e-12)
    assert list(faults(campaign)) == ["A"]
    assert calibrate(list(campaign.values())).provenance.joint_runs == ["B-sysid", "E-sysid"]
    with pytest.raises(
        InputError, match=r"^A-noise\.h5: attribute F_max_2: 5e-11, expected 2\.2e-09 as in A"
    ):
        calibrate([campaign["A-sysid"], campaign["A-noise"]])


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({"F_max_2": 0.0}, "f_x_2 is up to .*, but its authority F_max_2 is zero"),
        ({"F_max_2": 2200.0}, "attribute F_max_2: 2200 N would make a stiffness"),
        ({"N_max_1": 10.4}, r"attribute N_max_1: 10.4 N m would make a stiffness"),
    ],
)
def test_implausible_authorities(attributes, words):
    campaign = runs("A", "B")
    campaign |= {name: replace(campaign[name], **attributes) for name in ("A-sysid", "A-noise")}
    ((name, reason),) = faults(campaign).items()
    assert name == "A"
    assert re.search(words, reason)


@pytest.mark.parametrize("sign", [1, -1])
def test_commands_of_both_test_masses_exchanged(sign):
    """Either sign of the force would give a gain; that no force may act on test mass 1 says what is wrong."""
    campaign = runs("A", "B")
    forces = campaign["A-sysid"].channels
    swapped = {"f_x_1": sign * forces["f_x_2"], "f_x_2": forces["f_x_1"]}
    campaign["A-sysid"] = replace(campaign["A-sysid"], channels={**forces, **swapped})
    ((name, reason),) = faults(campaign).items()
    assert name == "A"
    assert "f_x_1 is up to" in reason


# --- nothing where there is nothing ---------------------------------------------------------------------
