"""What came of a campaign, as an archive tells it: telemetry, how it was evaluated, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class IRLSResult:
    """The telemetry and the results of a campaign.

    Attributes
    ----------
    results : Path
        The file ``results.json``.
    telemetry : dict of str to Path
        By the name of the file as seen from the folder of the results.
    flown : dict of str to str
        By model the digest of the FMU that was simulated.
    simulated : dict of str to str
        What else telemetry says of how it was simulated: version, seed.
    evaluated : dict of str to str
        Settings of the fit, and versions of software.
    verdict : dict of str to str
        Whether sigmas hold, chi2, codes of the warnings.
    """

    results: Path
    telemetry: Mapping[str, Path]
    flown: Mapping[str, str]
    simulated: Mapping[str, str]
    evaluated: Mapping[str, str]
    verdict: Mapping[str, str]
