"""The budget of false alarms of one campaign, split evenly among its tests.

Every test of the data, from a channel that is stuck to a run that contradicts the others, takes its limit
from here. A clean campaign of Gaussian noise then raises any alarm at all with a probability of at most
`BUDGET` (Bonferroni's bound: the tests need not be independent). A test is applied many times, to runs,
channels, lags, times or frequencies, which share what it has.
"""

from collections.abc import Mapping
from types import MappingProxyType

BUDGET = 2.8e-3  # probability that a clean campaign raises an alarm

#: The tests by family.
FAMILIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "samples": ("straight lines",),
        "loop response": ("guidance gain",),
        "glitches": ("matched filter",),
        "model": ("driven bins", "templates", "masks at injections", "drift in a run", "drift in all runs"),
        "noise": ("residual power", "subtraction"),
        "consistency": ("runs", "gain drift", "constraints"),
        "frame": ("centrifugal force",),
        "loop": ("loop",),  # of an identification
    }
)
TESTS = tuple(test for tests in FAMILIES.values() for test in tests)


def p_limit(test: str, n_tests: int = 1) -> float:
    """Return the p-value below which one of several applications of a test is an alarm.

    Parameters
    ----------
    test : str
        One of `TESTS`.
    n_tests : int
        How often it is applied in the campaign.

    Raises
    ------
    KeyError
        If there is no such test.
    """
    if test not in TESTS:
        raise KeyError(test)
    return BUDGET / len(TESTS) / max(n_tests, 1)


def chi2_limit(test: str, dof: int = 1, n_tests: int = 1) -> float:
    """Return the Delta chi^2 of `dof` parameters from which one of several applications is an alarm."""
    from scipy import special

    return float(special.chdtri(dof, p_limit(test, n_tests)))


def sigma_limit(test: str, n_tests: int = 1) -> float:
    """Return the size in sigma, of either sign, from which one of several applications is an alarm."""
    from scipy import special

    return -float(special.ndtri(p_limit(test, n_tests) / 2))
