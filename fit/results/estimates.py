"""Records of a fit: estimates and their constraints, diagnostics, stiffness."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from fit.files import problem
from fit.tables import FIXED, measurement, rounded, withheld
from fit.units import campaign_unit, concise_value, prior_text

CONFIG = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False)
ConstraintKind = Literal["fixed", "tied", "prior", "bounds"]
Bound = Literal["min", "max"]
_Number = Annotated[float, Field(ge=-1e100, le=1e100)]  # its square is still a number


@dataclass(frozen=True)
class Constraint:
    """What a user states of a parameter, and whether its estimate is at a bound.

    Attributes
    ----------
    kind : {"fixed", "tied", "prior", "bounds"}
        A parameter with a prior may have bounds as well.
    expr : str or None
        Expression of a tied parameter.
    prior : tuple of float or None
        Mean and sigma of a Gaussian prior, SI.
    min, max : float or None
        Bounds, SI.
    at_bound : {"min", "max"} or None
        The bound that the estimate is at.
    """

    kind: ConstraintKind
    expr: str | None = None
    prior: tuple[float, float] | None = None
    min: float | None = None
    max: float | None = None
    at_bound: Bound | None = None

    def __str__(self) -> str:
        if self.expr is not None:
            return f"tied to {self.expr}"
        if self.kind == "fixed":
            return FIXED
        words = [f"prior {prior_text(*self.prior)}"] if self.prior else []
        if self.at_bound:
            words.append(f"at bound {self.min if self.at_bound == 'min' else self.max:.9g}")
        elif (self.min, self.max) != (None, None):
            low, high = ("" if limit is None else f"{limit:.9g}" for limit in (self.min, self.max))
            words.append(f"bounds {low}:{high}")
        return ", ".join(words)


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
    constraint : Constraint or None
        Constraint by the user, if there is one.
    sound : bool
        Whether `sigma` is valid: that of an unsound `Fit` is not. Files state it of the fit.
    """

    value: _Number
    sigma: _Number
    unit: str
    truth: float | None = None
    pull: float | None = None
    constraint: Constraint | None = None
    sound: Annotated[bool, Field(exclude=True)] = field(default=True, compare=False)

    @model_validator(mode="after")
    def _check_sigma(self) -> "Estimate":
        """Refuse the sigma of a file if it is none, which would make an estimate look exact."""
        kind = self.constraint.kind if self.constraint else ""
        if self.sigma > 0 or (self.is_exact and kind in ("fixed", "tied")):
            return self
        raise problem(
            f'{self.sigma:g}, expected more than 0, or 0 with a constraint "fixed" or "tied"', "sigma"
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
        stated = str(self.constraint or "")
        return f"{text} ({stated})" if stated not in ("", FIXED) else text

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
