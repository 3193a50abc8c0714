"""The budget of false alarms of one campaign, split evenly among its tests.

Every test of the data, from a channel that is stuck to a run that contradicts the others, takes its limit
from here. A clean campaign of Gaussian noise then raises any alarm at all with a probability of at most
`BUDGET` (Bonferroni's bound: the tests need not be independent). A test is applied many times, to runs,
channels, lags, times or frequencies, which share what it has.
"""

BUDGET = 2.8e-3  # probability that a clean campaign raises an alarm
#: Of the checks of a campaign (`fit.checks`), and of the Euler force, the subtraction of Delta g, couplings
#: that drift, constraints and the loop of an identification.
N_TESTS = 15


def p_limit(n_applications: int = 1) -> float:
    """Return the p-value below which one of several applications of a test is an alarm."""
    return BUDGET / N_TESTS / max(n_applications, 1)


def chi2_limit(dof: int = 1, n_applications: int = 1) -> float:
    """Return the Delta chi^2 of `dof` parameters from which one of several applications is an alarm."""
    from scipy import special

    return float(special.chdtri(dof, p_limit(n_applications)))


def sigma_limit(n_applications: int = 1) -> float:
    """Return the size in sigma, of either sign, from which one of several applications is an alarm."""
    from scipy import special

    return -float(special.ndtri(p_limit(n_applications) / 2))
