"""The spacecraft that can be calibrated, a file for each; nothing else asks which one it is."""

from collections.abc import Sequence

from fit.errors import InputError
from fit.model import Spacecraft
from fit.results import Results
from fit.spacecraft import saturation
from fit.spacecraft.lisa import LISA
from fit.spacecraft.pathfinder import DELTA_G, PATHFINDER
from fit.spacecraft.terms import CalibratedTerms, Terms, equation_terms
from fit.telemetry import Telemetry

#: By the name that telemetry states.
SPACECRAFT = {spacecraft.name: spacecraft for spacecraft in (PATHFINDER, LISA)}


def spacecraft_of(telemetry: Telemetry) -> Spacecraft:
    """Return the spacecraft of a run.

    Raises
    ------
    InputError
        If it is not known.
    """
    name = telemetry.spacecraft
    if name not in SPACECRAFT:
        known = " or ".join(SPACECRAFT)
        raise InputError(f"{telemetry.path}: attribute spacecraft: {name!r} is not known, expected {known}")
    return SPACECRAFT[name]


def spacecraft_of_results(results: Results, telemetries: Sequence[Telemetry]) -> Spacecraft:
    """Return the spacecraft of results: that of their runs, or else the one whose gain they hold."""
    if telemetries:
        return spacecraft_of(telemetries[0])
    names = {name for fit in results.experiments.values() for name in fit}
    return next((one for one in SPACECRAFT.values() if names & {*one.overview}), PATHFINDER)


def check_same(telemetries: Sequence[Telemetry]) -> None:
    """Refuse runs of different spacecraft.

    Raises
    ------
    InputError
        If there are any.
    """
    for run in telemetries:
        if run.spacecraft != telemetries[0].spacecraft:
            raise InputError(
                f"{run.path}: telemetry of {run.spacecraft}, but {telemetries[0].path} is of "
                f"{telemetries[0].spacecraft}; expected one of the two in a fit"
            )
