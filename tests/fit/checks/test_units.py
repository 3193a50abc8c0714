"""Channels in another unit or of the other sign are named before any prior acts, clean ones never."""

import re
from dataclasses import replace

import pytest

from fit.checks.units import free_fit, unit_faults
from fit.errors import InputError
from fit.pipeline import calibrate
from fit.whitening import pair
from tests.oracles import synthetic, thirteen

PAIR = thirteen.campaign(5, names=("C4",))


def scaled(run, **factors):
    channels = {name: factor * run.channels[name] for name, factor in factors.items()}
    return replace(run, channels=run.channels | channels)


def reasons(runs):
    return [fault.message for e in pair(runs) for fault in unit_faults(e)]


@pytest.mark.parametrize("runs", ["experiment", "both"])
@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"o_12": 1e9}, "lambda_2 is estimated as 1.08e+09"),
        ({"o_12": 1e-3}, "lambda_2 is estimated as 0.00108"),
        ({"o_1": 1e3}, "o_1 is in another unit"),
        ({"f_x_2": -1e12}, "lambda_2 is estimated as -1.08e-12"),
        ({"f_x_2": thirteen.MASS}, "lambda_2 is estimated as 0.559"),
        ({"o_12": -1}, "lambda_2 is estimated as -1.08"),
    ],
    ids=str,
)
def test_a_wrong_unit_or_sign_is_refused(factors, words, runs):
    sysid, noise = (PAIR[f"C4-{kind}"] for kind in ("sysid", "noise"))
    faulty = [scaled(sysid, **factors), scaled(noise, **factors) if runs == "both" else noise]
    with pytest.raises(InputError, match=re.escape(words)):
        calibrate(faulty)


def test_a_wrong_unit_of_the_noise_run_is_found():
    (reason,) = reasons([PAIR["C4-sysid"], scaled(PAIR["C4-noise"], o_12=1e6)])
    assert reason.startswith("C4-noise.h5: o_12 is in another unit")


def test_a_single_tone_determines_the_sign_of_a_gain():
    runs = synthetic.pair(synthetic.World(), "A", seed=1, tones_12=(1e-3,), tones_1=())
    (reason,) = reasons([scaled(run, o_12=-1) for run in runs])
    assert "lambda_2 is estimated as -" in reason


@pytest.mark.stat  # fixed seeds
def test_clean_experiments_have_plausible_gains_and_read_outs():
    for e in pair(list(thirteen.campaign(7, names=("A1", "D2", "G3")).values())):
        assert not list(unit_faults(e))
        assert free_fit(e.sysid).gains[2] == pytest.approx(1.0776, abs=5e-4)
