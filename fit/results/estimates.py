"""Records of a fit: estimates, diagnostics, stiffness."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Protocol

from pydantic import Field

from fit.display import Displayed

if TYPE_CHECKING:
    from lmfit import Minimizer, Parameters
    from lmfit.minimizer import MinimizerResult

QUANTILES = 27  # of a residual
FIXED = "fixed"  # shown for the sigma of a parameter that the settings fix
WITHHELD = "?"  # shown for a sigma that does not hold
_Score = Annotated[float, Field(ge=-1e9, le=1e9)]


@dataclass(frozen=True, repr=False)
class Estimate(Displayed):
    """One estimated parameter.

    Attributes
    ----------
    value, sigma : float
        Estimate and its standard deviation, in `unit`.
    unit : str
        SI unit, ``"1"`` where dimensionless.
    truth, pull : float or None
        The simulated value and (value - truth)/sigma; None where unknown.
    fixed : bool or None
        True where the settings fix it: a sigma of a millionth of its weak prior's width stands for none.
    """

    value: float
    sigma: float
    unit: str
    truth: float | None = None
    pull: float | None = None
    fixed: bool | None = None


@dataclass(frozen=True)
class Diagnostics:
    """What the residual of an experiment is like where the model of signal and noise should hold.

    Attributes
    ----------
    chi2_red, chi2_red_sigma : float
        chi^2 over its degrees of freedom, 1 expected, and the scatter to expect.
    whiteness : float
        p-value of the cumulative periodogram: how often noise departs farther from the shape of the model.
    kurtosis, kurtosis_sigma : float
        Excess kurtosis of the normalised residual, 0 expected, and the scatter to expect.
    quantiles : list of float
        Of the normalised residual at `NORMAL_SCORES` of `fit.quality`, which they should equal.
    """

    chi2_red: float
    chi2_red_sigma: float
    whiteness: float
    kurtosis: float
    kurtosis_sigma: float
    quantiles: Annotated[list[_Score], Field(min_length=QUANTILES, max_length=QUANTILES)]


@dataclass(frozen=True)
class Stiffness:
    """omega2_j [s-2] of test mass j at an authority F_max_j [N], N_max_j [N m], and its sigma."""

    j: int
    F_max: float
    N_max: float
    value: float
    sigma: float


class SolvedModel(Protocol):
    """A joint model and its solution by lmfit, see `fit.fitting.SolvedModel`."""

    @property
    def result(self) -> "MinimizerResult":
        """The estimate."""

    @property
    def minimizer(self) -> "Minimizer":
        """The problem as lmfit has it."""

    def refit(self, params: "Parameters") -> "MinimizerResult":
        """Return the fit with other settings of its parameters."""

    def exclude(self, *runs: str) -> "MinimizerResult":
        """Return the fit without some of the experiments."""
