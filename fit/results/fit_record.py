"""The record of one fit, and those of a section of results by their key."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NoReturn, overload

import numpy as np
from numpy.typing import NDArray

from fit.display import Displayed
from fit.errors import InputError, MissingKeyError, shown
from fit.results import data_frames
from fit.results.estimates import Diagnostics, Estimate, SolvedModel, Stiffness, correlation_matrix
from fit.warnings import FitWarning

if TYPE_CHECKING:
    import pandas
    from lmfit import Minimizer, Parameters
    from lmfit.minimizer import MinimizerResult


@dataclass(frozen=True, repr=False)
class Fit(Displayed):
    """Estimates of one fit.

    Attributes
    ----------
    parameters : dict of str to Estimate
        The parameters that the data determine.
    covariance_matrix : ndarray, shape (P, P)
        In the order of `parameters`, products of their units.
    chi2 : float
        At the estimate.
    dof : int
        Degrees of freedom.
    converged : bool
        Whether the iteration met its tolerance.
    warnings : tuple of FitWarning
        Exclusions and doubts, with their reasons.
    masked_samples : int, optional
        Missing samples that were masked, where they were counted.
    diagnostics : Diagnostics, optional
        Of the residual of a single experiment.
    centrifugal : Estimate, optional
        Of an inertial period: coefficient of g_Omega if it is free; 1 expected.
    stiffness : tuple of Stiffness
        Of a joint fit: omega2_j at the authorities of its runs, also where its parts are not determined.
    solved : SolvedModel, optional
        The fitted model; not in files.
    """

    parameters: dict[str, Estimate]
    covariance_matrix: NDArray[np.float64]
    chi2: float
    dof: int
    converged: bool
    warnings: tuple[FitWarning, ...]
    masked_samples: int | None = None
    diagnostics: Diagnostics | None = None
    centrifugal: Estimate | None = None
    stiffness: tuple[Stiffness, ...] = ()
    solved: SolvedModel | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        sound = not self.unsound
        estimates = {
            name: e if e.sound == sound else replace(e, sound=sound) for name, e in self.parameters.items()
        }
        object.__setattr__(self, "parameters", estimates)

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter.

        Raises
        ------
        InputError
            If the fit has none of that name.
        """
        if not isinstance(name, str) or name not in self.parameters:
            is_undetermined = name in self.undetermined
            why = "is not determined by these data" if is_undetermined else "is no parameter of this fit"
            raise InputError(f"{name} {why}, expected one of {', '.join(self.parameters) or 'none'}")
        return self.parameters[name]

    @property
    def values(self) -> dict[str, float]:
        """The estimates by name, in their units."""
        return {name: estimate.value for name, estimate in self.parameters.items()}

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters)

    @property
    def lmfit(self) -> "MinimizerResult":
        """The least-squares estimate as lmfit has it, with all that was fitted along.

        ``covar`` is the true covariance, window and priors included; ``chisqr`` and ``nfree`` are those of
        the consistency of the runs with each other.
        """
        return self._solved.result

    @property
    def minimizer(self) -> "Minimizer":
        """The problem as lmfit has it: `emcee`, ``lmfit.conf_interval`` with ``prob_func=fit.delta_chi2``."""
        return self._solved.minimizer

    def refit(self, params: "Parameters") -> "MinimizerResult":
        """Fit the compressed runs again, which takes milliseconds.

        Parameters
        ----------
        params : lmfit.Parameters
            Those of `lmfit`, some of them fixed, bounded or tied; priors are `fit.Prior` as ``user_data``.
        """
        return self._solved.refit(params)

    def without(self, *runs: str) -> "MinimizerResult":
        """Fit the compressed runs again without some of the experiments, which takes milliseconds."""
        return self._solved.exclude(*runs)

    @property
    def _solved(self) -> SolvedModel:
        if self.solved is None:
            raise InputError("results from a file hold no lmfit model, expected those of fit.calibrate")
        return self.solved

    @property
    def unsound(self) -> tuple[FitWarning, ...]:
        """The warnings that invalidate the uncertainties; none in a sound fit."""
        return tuple(w for w in self.warnings if w.kind.unsound)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The parameters that the data do not determine."""
        names = (name for w in self.warnings if w.code == "indeterminable" for name in w.parameters)
        return tuple(dict.fromkeys(names))

    @overload
    def covariance(self, *, as_frame: Literal[False] = False) -> NDArray[np.float64]: ...
    @overload
    def covariance(self, *, as_frame: Literal[True]) -> "pandas.DataFrame": ...
    def covariance(self, *, as_frame: bool = False) -> "NDArray[np.float64] | pandas.DataFrame":
        """Return the covariance of the estimates, shape (P, P), in the order of `parameters`.

        Parameters
        ----------
        as_frame : bool
            As a data frame with the names of the parameters on both axes.
        """
        return (
            data_frames.covariance_frame(self.covariance_matrix, list(self))
            if as_frame
            else self.covariance_matrix
        )

    @property
    def correlation(self) -> NDArray[np.float64]:
        """The correlation matrix, shape (P, P), in the order of `parameters`."""
        return correlation_matrix(self.covariance_matrix)


class KeyedFits(dict[str, Fit]):
    """The fits of a section of results by experiment, epoch or period, which is their `kind`."""

    def __init__(self, kind: str, fits: Mapping[str, Fit]) -> None:
        super().__init__(fits)
        self.kind = kind

    def __missing__(self, key: object) -> NoReturn:
        known = ", ".join(self) or "none"
        raise MissingKeyError(f"no {self.kind} {shown(key)} in these results, known: {known}")
