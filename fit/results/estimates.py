"""Records of a fit: estimates and their constraints, diagnostics, stiffness."""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from fit.files import problem
from fit.tables import FIXED, measurement, rounded, withheld
from fit.units import campaign_unit, concise_value

CONFIG = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False)
_Number = Annotated[float, Field(ge=-1e100, le=1e100)]  # its square is still a number


@dataclass(frozen=True, repr=False)
class Estimate:
    """One estimated parameter.

    Attributes
    ----------
    value, sigma : float
        Estimate and its standard deviation, in `unit`; 0 for an exact value.
    unit : str
        SI unit, ``"1"`` where dimensionless.
    truth, pull : float or None
        The simulated value and (value - truth)/sigma; None where unknown.
    constraint : str
        What the user states: ``fixed``, ``tied to EXPR``, ``prior MEAN ± SIGMA``, ``bounds MIN:MAX`` or ``at
        bound VALUE``; empty for nothing.
    sound : bool
        Whether `sigma` is valid: that of an unsound `Fit` is not. Files state it of the fit.
    """

    value: _Number
    sigma: _Number
    unit: str
    truth: float | None = None
    pull: float | None = None
    constraint: str = ""
    sound: Annotated[bool, Field(exclude=True)] = field(default=True, compare=False)

    @model_validator(mode="after")
    def _check_sigma(self) -> "Estimate":
        """Refuse the sigma of a file if it is none, which would make an estimate look exact."""
        if self.sigma > 0 or (self.is_exact and self.constraint.startswith((FIXED, "tied"))):
            return self
        raise problem(
            f'{self.sigma:g}, expected more than 0, or 0 with a constraint "fixed" or "tied to ..."', "sigma"
        )

    @property
    def is_exact(self) -> bool:
        """Whether it is no estimate: a fixed parameter, or one that is tied to fixed ones alone."""
        return self.sigma == 0

    @property
    def number(self) -> str:
        """In ASCII, with sigma in units of the last digits: ``-3.983(52)e-07``, ``-3.983(?)e-07``."""
        if self.is_exact:
            return f"{self.value:.8g} ({FIXED})"
        text = concise_value(self.value, self.sigma)
        return text if self.sound else withheld(text)

    def printed(self, exponent: int = 0) -> str:
        """Return the number for the page, in units of a power of ten."""
        return measurement(self.value, self.sigma, exponent, sound=self.sound)

    def __repr__(self) -> str:
        text = f"{self.number} {campaign_unit(self.unit)}".rstrip()
        text += "" if self.truth is None else f", truth {rounded(self.truth, self.sigma)}"
        text += "" if self.pull is None or not self.sound else f", pull {self.pull:+.2f}"
        return f"{text} ({self.constraint})" if self.constraint not in ("", FIXED) else text

    def difference(self, value: float, sigma: float = 0.0) -> float | None:
        """Return value of the estimate - `value` over both sigmas; None where neither has a sigma."""
        total = math.hypot(self.sigma, sigma)
        return (self.value - value) / total if total > 0 else None


def correlation_matrix(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlations of a covariance, both of shape (P, P); exact values have none with others."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)
    return np.asarray(covariance / np.outer(scale, scale) + np.diag((sigma == 0).astype(float)))


@dataclass(frozen=True)
class Diagnostics:
    """What the residual of an experiment is like where the model of signal and noise should hold.

    Attributes
    ----------
    chi2_red, chi2_red_sigma : float
        chi^2 over its degrees of freedom, 1 expected, and the scatter to expect.
    """

    chi2_red: float
    chi2_red_sigma: float


@dataclass(frozen=True)
class Stiffness:
    """omega2_j [s-2] of test mass j at an authority F_max_j [N], N_max_j [N m], and its sigma."""

    j: int
    F_max: float
    N_max: float
    value: float
    sigma: float
