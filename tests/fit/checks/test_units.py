"""Channels in another unit or of the other sign are named before any prior acts, clean ones never."""

from dataclasses import replace

import pytest

from fit.checks.units import free_fit, unit_faults
from fit.errors import InputError
from fit.pipeline import calibrate
from fit.whitening import pair
from tests.oracles import thirteen

PAIR = thirteen.campaign(5, names=("C4",))


def scaled(run, **factors):
    channels = {name: factor * run.channels[name] for name, factor in factors.items()}
    return replace(run, channels=run.channels | channels)


def reasons(runs):
    return [fault.message for e in pair(runs) for fault in unit_faults(e)]


@pytest.mark.parametrize(
    ("factors", "reason"),
    [
        ({"o_12": 1e9}, "o_12 is in nm and not in m"),
        ({"o_12": 1e-3}, "o_12 is in another unit, 1000 times too small"),
        ({"o_1": 1e3}, "o_1 is in mm and not in m"),
        ({"f_x_2": -1e12}, "f_x_2 is in pm s-2 and not in m s-2 and has the wrong sign"),
        ({"f_x_2": thirteen.MASS}, "f_x_2 is in N and not in m s-2"),
        ({"f_x_2": -1}, "f_x_2 has the wrong sign"),
        ({"o_12": -1}, "o_12 has the wrong sign"),
        ({"f_x_2": 4}, "f_x_2 has the wrong scale"),
    ],
    ids=str,
)
@pytest.mark.parametrize("runs", ["experiment", "both"])
def test_a_wrong_unit_or_sign_is_named(factors, reason, runs):
    sysid, noise = (PAIR[f"C4-{kind}"] for kind in ("sysid", "noise"))
    faulty = [scaled(sysid, **factors), scaled(noise, **factors) if runs == "both" else noise]
    message = reasons(faulty)[0]
    assert message.startswith("C4-sysid.h5: ")
    assert reason.removesuffix(" has the wrong sign") in message
    with pytest.raises(InputError, match=r"C4-sysid\.h5"):
        calibrate(faulty)


def test_a_wrong_unit_of_the_noise_run_is_named():
    (reason,) = reasons([PAIR["C4-sysid"], scaled(PAIR["C4-noise"], o_12=1e6)])
    assert reason.startswith("C4-noise.h5: o_12 is in um and not in m")


@pytest.mark.stat  # fixed seeds
def test_clean_experiments_have_plausible_gains_and_read_outs():
    for e in pair(list(thirteen.campaign(7, names=("A1", "D2", "G3")).values())):
        assert not list(unit_faults(e))
        assert free_fit(e.sysid).gains[2] == pytest.approx(1.0776, abs=5e-4)
