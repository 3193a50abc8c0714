"""The record of one fit: as it is in memory, and as it is in a file."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from pydantic import (
    Field,
    PlainSerializer,
    PlainValidator,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from fit.errors import InputError
from fit.files import problem
from fit.findings import Finding, distinct_messages
from fit.results.estimates import CONFIG, Diagnostics, Estimate, Stiffness, correlation_matrix
from fit.tables import Table, html_list, rounded
from fit.units import campaign_unit

if TYPE_CHECKING:
    from lmfit import Minimizer, Parameters
    from lmfit.minimizer import MinimizerResult


def _matrix(rows: Any) -> NDArray[np.float64]:
    try:
        return np.array(rows, dtype=np.float64)
    except (ValueError, TypeError):
        raise problem("expected rows of numbers") from None


@dataclass(frozen=True, repr=False)
class Fit:
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
    warnings : tuple of Finding
        Exclusions and doubts, with their reasons.
    masked_samples : int, optional
        Missing samples that were masked, where they were counted.
    diagnostics : Diagnostics, optional
        Of the residual of a single experiment.
    centrifugal : Estimate, optional
        Of an inertial period: coefficient of g_Omega if it is free; 1 expected.
    stiffness : tuple of Stiffness
        Of a joint fit: omega2_j at the authorities of its runs, also where its parts are not determined.
    solved : fit.fitting.SolvedModel, optional
        The fitted model; not in files.
    """

    __pydantic_config__ = CONFIG

    parameters: dict[str, Estimate]
    covariance_matrix: Annotated[
        NDArray[np.float64],
        PlainValidator(_matrix),
        PlainSerializer(lambda matrix: matrix.tolist()),
        Field(alias="covariance"),
    ]
    chi2: float
    dof: Annotated[int, Field(ge=0, le=2**53)]
    converged: bool
    warnings: tuple[Finding, ...]
    masked_samples: Annotated[int, Field(ge=0)] | None = None
    diagnostics: Diagnostics | None = None
    centrifugal: Estimate | None = None
    stiffness: tuple[Stiffness, ...] = ()
    solved: Annotated[Any, Field(exclude=True)] = field(default=None, compare=False)

    def __post_init__(self) -> None:
        sound = not self.unsound
        estimates = {
            name: e if e.sound == sound else replace(e, sound=sound) for name, e in self.parameters.items()
        }
        object.__setattr__(self, "parameters", estimates)

    @model_validator(mode="before")
    @classmethod
    def _order(cls, document: Any) -> Any:
        """Put the parameters of a file into the order of its covariance, and state why it is not sound."""
        if not isinstance(document, dict) or not isinstance(parameters := document.get("parameters"), dict):
            return document
        names = document.get("names")
        if not isinstance(names, list) or sorted(map(str, names)) != sorted(parameters):
            raise problem("expected each of the parameters once", "names")
        warnings = document.get("warnings")
        if document.get("sound") is False and isinstance(warnings, list):
            known = [w for w in warnings if isinstance(w, dict)]
            if not any(Finding(str(w.get("code")), "").kind.unsound for w in known):
                reasons = "; ".join(str(w.get("message")) for w in known) or "no warning"
                message = f"its file says sound = false and has as reason: {reasons}"
                warnings = [*warnings, {"code": "unsound_file", "parameters": (), "message": message}]
        ordered = {name: parameters[name] for name in names}
        return {**document, "parameters": ordered, "warnings": warnings, "solved": None}

    @model_validator(mode="after")
    def _check_covariance(self) -> "Fit":
        size, matrix = len(self.parameters), self.covariance_matrix
        if not size and not matrix.size:
            object.__setattr__(self, "covariance_matrix", np.empty((0, 0)))
            return self
        if matrix.shape != (size, size):
            raise problem(f"expected {size} rows of {size} numbers", "covariance")
        sigmas = np.array([e.sigma for e in self.parameters.values()])
        if not np.allclose(np.diag(matrix), sigmas**2, rtol=1e-6, atol=0):
            raise problem("expected the squares of the sigmas on the diagonal", "covariance")
        if not np.all(np.abs(matrix) <= (1 + 1e-6) * np.outer(sigmas, sigmas)):
            raise problem("expected correlations of at most 1", "covariance")
        return self

    @model_serializer(mode="wrap")
    def _write(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {**write(self), "names": list(self), "sound": not self.unsound}

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
        return self._model().result

    @property
    def minimizer(self) -> "Minimizer":
        """The problem as lmfit has it: `emcee`, ``lmfit.conf_interval`` with ``prob_func=fit.delta_chi2``."""
        return self._model().minimizer

    def refit(self, params: "Parameters") -> "MinimizerResult":
        """Fit the compressed runs again, which takes milliseconds.

        Parameters
        ----------
        params : lmfit.Parameters
            Those of `lmfit`, some of them fixed, bounded or tied; priors are `fit.Prior` as ``user_data``.
        """
        return self._model().refit(params)

    def without(self, *runs: str) -> "MinimizerResult":
        """Fit the compressed runs again without some of the experiments, which takes milliseconds."""
        return self._model().exclude(*runs)

    def _model(self) -> Any:
        if self.solved is None:
            raise InputError("results from a file hold no lmfit model, expected those of fit.calibrate")
        return self.solved

    def add(self, findings: Iterable[Finding]) -> "Fit":
        """Return the fit with more findings."""
        return replace(self, warnings=(*self.warnings, *findings))

    @property
    def unsound(self) -> tuple[Finding, ...]:
        """The warnings that invalidate the uncertainties; none in a sound fit."""
        return tuple(w for w in self.warnings if w.kind.unsound)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The parameters that the data do not determine."""
        names = (name for w in self.warnings if w.code == "indeterminable" for name in w.parameters)
        return tuple(dict.fromkeys(names))

    def covariance(self, *, as_frame: bool = False) -> Any:
        """Return the covariance of the estimates, shape (P, P), in the order of `parameters`.

        Parameters
        ----------
        as_frame : bool
            As a data frame with the names of the parameters on both axes.
        """
        if not as_frame:
            return self.covariance_matrix
        import pandas as pd  # slow to import

        return pd.DataFrame(self.covariance_matrix, index=[*self], columns=[*self])

    @property
    def correlation(self) -> NDArray[np.float64]:
        """The correlation matrix, shape (P, P), in the order of `parameters`."""
        return correlation_matrix(self.covariance_matrix)

    @property
    def state(self) -> str:
        """What chi2 is, and whether the uncertainties are valid, in words."""
        state = f"chi2 / dof = {self.chi2:.1f} / {self.dof}"
        state += f", {self.masked_samples} samples masked" if self.masked_samples else ""
        state += "; the uncertainties are not valid" if self.unsound else ""
        return state if self.converged else f"{state}; not converged"

    def messages(self) -> list[str]:
        """Return the messages of the warnings, once each."""
        return list(distinct_messages(self.warnings))

    def __repr__(self) -> str:
        warnings = (f"warning: {message}" for message in self.messages())
        return "\n".join([self.state, *estimates({"": self}).aligned(), *warnings])

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        table, state, messages = estimates({"": self}).html(), self.state, html_list(self.messages())
        return str(Markup("<div>{}<p>{}</p>{}</div>").format(table, state, messages))


def estimates(fits: Mapping[str, Fit]) -> Table:
    """Return the estimates of fits as value(uncertainty), with truth and pull where they are known.

    Uncertainties and pulls that are not valid are withheld.

    Parameters
    ----------
    fits : mapping of str to Fit
        By the suffix of the names of their parameters.

    Returns
    -------
    Table
        With a column ``constraint`` where the user states something of parameters.
    """
    rows = []
    for suffix, fit in fits.items():
        for name, e in fit.parameters.items():
            truth = "" if e.truth is None else rounded(e.truth, e.sigma)
            pull = "" if e.pull is None or not e.sound else f"{e.pull:+.2f}"
            rows.append((name + suffix, e.number, campaign_unit(e.unit), truth, pull, e.constraint))
    head = ("parameter", "estimate", "unit", "truth", "pull", "constraint")
    return Table(head, tuple(rows)).filled(n_always=3)
