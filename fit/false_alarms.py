"""The budget of false alarms of one campaign, split evenly among the families of tests.

Every test of the data, from a channel that is stuck to a run that contradicts the others, takes its limit
from here. A clean campaign of Gaussian noise then raises any alarm at all with a probability of at most
`BUDGET` (Bonferroni's bound: the tests need not be independent).
"""

from collections.abc import Mapping
from types import MappingProxyType

BUDGET = 1e-3  # probability that a clean campaign raises an alarm

#: The families of tests and what each looks for.
FAMILIES: Mapping[str, str] = MappingProxyType(
    {
        "samples": "values of a channel that no instrument gives",
        "loop response": "guidance that the read-outs do not follow",
        "glitches": "forces and jumps of a read-out that do not last",
        "model": "signals that the equation of motion lacks",
        "noise": "noise other than that of the noise run",
        "consistency": "runs that contradict the others",
        "frame": "inertial forces that contradict the frame of the angles",
    }
)


def p_limit(family: str, n_tests: int = 1) -> float:
    """Return the p-value below which one of several tests of a family is an alarm.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    n_tests : int
        Number of tests of that family in the campaign: over runs, channels, lags, times, frequencies.

    Raises
    ------
    KeyError
        If there is no such family.
    """
    if family not in FAMILIES:
        raise KeyError(family)
    return BUDGET / len(FAMILIES) / max(n_tests, 1)


def budget_by_family() -> dict[str, float]:
    """Return the probability of a false alarm that each family of tests may raise in a clean campaign."""
    return {family: p_limit(family) for family in FAMILIES}


def chi2_limit(family: str, dof: int = 1, n_tests: int = 1) -> float:
    """Return the Delta chi^2 of `dof` parameters from which one of several tests of a family is an alarm."""
    from scipy import special

    return float(special.chdtri(dof, p_limit(family, n_tests)))


def sigma_limit(family: str, n_tests: int = 1) -> float:
    """Return the size in sigma, of either sign, from which one of several tests of a family is an alarm."""
    from scipy import special

    return -float(special.ndtri(p_limit(family, n_tests) / 2))
