"""The sigmas of tilt-to-length coefficients that a manoeuvre of three LISA spacecraft is expected to give."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.tilt_to_length import Measurements, expected_sigmas, michelson
from lpfcosim.campaign import Campaign
from lpfcosim.constellation import ASSEMBLIES, LEAD, TAIL, assembly_angles, spacecraft_motion
from lpfcosim.linear import response
from lpfcosim.models import model_of

MANOEUVRES = {"guidance_theta", "guidance_eta", "guidance_phi", "guidance_opening"}  # set points
LINK_DELAY = 2.5e9 / michelson.C  # s, of an arm of 2.5 Gm
RATE = 5.0  # Hz, of the motion


def expected_ttl_sigmas(campaign: Campaign) -> dict[str, float]:
    """Return the sigmas to expect of the 24 coefficients [m/rad].

    They follow from the motion that the injections cause and the noise of `fit.tilt_to_length.LINK_ASD`, see
    `fit.tilt_to_length.expected_sigmas`. The runs with injections are those of spacecraft 1, 2 and 3.

    Returns
    -------
    dict of str to float
        Infinite where a coefficient is not determined; empty for a campaign that moves no three spacecraft.

    Raises
    ------
    InputError
        If the runs are too short for a fit.
    """
    runs = [run for run in campaign.runs if run.kind == "sysid"]
    is_excited = [any(injection.into in MANOEUVRES for injection in run.injections) for run in runs]
    same_length = len({run.n_samples for run in runs}) == 1
    has_telescopes = all("half_opening" in model_of(run).attributes(run) for run in runs)
    if not (has_telescopes and same_length and len(runs) == len(ASSEMBLIES) and all(is_excited)):
        return {}
    series: dict[str, NDArray[np.float64]] = {}
    for run, spacecraft in zip(runs, ASSEMBLIES, strict=True):
        half_opening = float(model_of(run).attributes(run)["half_opening"])
        motion = response.linear_response(run, rate=RATE)
        series |= spacecraft_motion(motion, spacecraft, half_opening)
    used = slice(round(LEAD * RATE), -round(TAIL * RATE))
    rates = {name: np.gradient(x, 1 / RATE)[used] for name, x in assembly_angles(series).items()}
    delays = {link: LINK_DELAY for pair in ASSEMBLIES.values() for link in pair}
    michelson_variables = dict.fromkeys(michelson.VARIABLES, np.zeros_like(next(iter(rates.values()))))
    measurements = Measurements(Path(campaign.name), RATE, michelson_variables, rates, delays)
    return expected_sigmas(measurements)
