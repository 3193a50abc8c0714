"""The result of a calibration and its JSON form, schema ``lpf-results/1``."""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from fit.display import Displayed, latex
from fit.errors import InputError, shown
from fit.files import atomic, documents, place
from fit.results import data_frames
from fit.results.estimates import Diagnostics, Estimate, SolvedModel, Stiffness, correlation_matrix
from fit.results.provenance import Provenance
from fit.telemetry import Telemetry
from fit.warnings import Cause, FitWarning

if TYPE_CHECKING:
    import pandas
    from lmfit import Minimizer, Parameters
    from lmfit.minimizer import MinimizerResult

SCHEMA = "lpf-results/1"
_Count = Annotated[int, Field(ge=0, le=2**53)]
_LARGEST = 1e100  # value or sigma in any unit, whose square is still a number
_JSON_NAMES = {"covariance_matrix": "covariance"}  # of fields that have another name in the file
_SECTIONS = ("experiments", "cross_talk", "inertial")


@dataclass(frozen=True, repr=False)
class Fit(Displayed):
    """One fit.

    Attributes
    ----------
    parameters : dict of str to Estimate
        The determinable parameters.
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
        Of a joint fit: omega2_j at the authorities of its runs, also where the parts of that sum are lost.
    solved : SolvedModel, optional
        The model that was fitted; no file holds it.
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

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter.

        Raises
        ------
        InputError
            If the fit has none of that name.
        """
        if name not in self.parameters:
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
        """The warnings with which the sigmas do not hold; none in a sound fit."""
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

        Raises
        ------
        InputError
            If a frame is asked for and pandas is not installed.
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


@dataclass(frozen=True, repr=False)
class Results(Displayed):
    """Everything one calibration yields.

    Attributes
    ----------
    joint : Fit or None
        The joint fit over all experiments (eq. deltagjointfit).
    experiments : dict of str to Fit
        Each experiment on its own (eq. deltaglinear), by experiment name.
    cross_talk, inertial : dict of str to Fit
        By alignment epoch (eq. bump) and by inertial period.
    provenance : Provenance
        How they came about.
    """

    joint: Fit | None
    experiments: dict[str, Fit]
    cross_talk: dict[str, Fit]
    inertial: dict[str, Fit]
    provenance: Provenance

    @property
    def unsound(self) -> list[tuple[str, FitWarning]]:
        """Where sigmas do not hold, and why: in the joint fit, without one in experiments, and inertial."""
        single = {f"experiments.{name}": fit for name, fit in self.experiments.items()}
        headline = {"joint": self.joint} if self.joint else single
        fits = headline | {f"inertial.{k}": f for k, f in self.inertial.items()}
        return [(place, warning) for place, fit in fits.items() for warning in fit.unsound]

    def fits(self) -> Iterator[tuple[str, str, Fit]]:
        """Yield all fits with their section and their key in it, which is empty for the joint fit."""
        if self.joint is not None:
            yield "joint", "", self.joint
        for section in _SECTIONS:
            for key, fit in getattr(self, section).items():
                yield section, key, fit

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return all estimates: a row for each parameter with value, sigma, sound, constraint, truth, pull.

        The index is section, key (of an experiment, epoch or period), parameter and unit. Where `sound` is
        false, `sigma` does not hold; `constraint` is empty where the user states none.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        return data_frames.estimates_frame(
            (section, key, not fit.unsound, fit.parameters) for section, key, fit in self.fits()
        )

    def to_latex(self) -> str:
        r"""Return the joint fit and the inertial forces as a ``tabular`` of LaTeX, without packages.

        Without a joint fit it holds those of the experiments. A sigma that does not hold is ``?``.
        """
        return latex(self)

    def save(self, path: str | Path) -> None:
        """Write the results as JSON, schema ``lpf-results/1``; see `write`.

        Raises
        ------
        InputError
            If it is no path, or of a folder that does not exist.
        """
        if not isinstance(path, str | Path):
            raise InputError(f"save: path: {shown(path)}, expected the path of a file")
        if not Path(path).parent.is_dir():
            raise InputError(f"{path}: no such folder, expected a file in one that exists")
        write(self, Path(path))


def check_results(results: object, function: str) -> None:
    """Refuse what is no result of a calibration, as an argument of a function."""
    if not isinstance(results, Results):
        raise InputError(f"{function}: results: {shown(results)}, expected Results (fit.calibrate)")


def sound_joint(results: Results, place: str = "the results") -> Fit:
    """Return the joint fit of a calibration, for whatever is built on it; `place` names it in messages.

    Raises
    ------
    InputError
        If there is none, or its sigmas do not hold.
    """
    joint = results.joint
    if joint is None:
        raise InputError(f"{place}: joint: missing, expected the joint fit of a calibration")
    if joint.unsound:
        reasons = "; ".join(dict.fromkeys(w.message for w in joint.unsound))
        raise InputError(
            f"{place}: joint: is not sound ({reasons}); expected a calibration whose sigmas hold"
        )
    return joint


def check_frame(results: Results, run: Telemetry) -> None:
    """Check that a run is in the frame of the cross-talk and misalignments of a calibration.

    Raises
    ------
    InputError
        If the signs of its cross-talk or misalignments would be others there.
    """
    frame = results.provenance.frame
    if (results.cross_talk or results.inertial) and run.x_axis != frame:
        raise InputError(
            f"{run.path}: attribute x_axis: {run.x_axis!r}, expected {frame!r} as in the calibration, whose "
            "cross-talk and misalignments would have other signs"
        )


def write(results: Results, path: Path) -> str:
    """Write `results` as JSON, which is returned; the file appears whole or not at all.

    Raises
    ------
    FitError
        If a number is not finite: such a result must not look like one.
    """
    sections = {section: getattr(results, section) for section in ("joint", *_SECTIONS)}
    document = {"schema": SCHEMA, **_to_json(sections), "provenance": results.provenance.entries()}
    return atomic.write_json(path, document)


def _to_json(value: Any) -> Any:
    """Return records as JSON has them, without the fields that have their default."""
    if isinstance(value, Cause):
        return value.as_dict()
    if is_dataclass(value):
        values = {f: getattr(value, f.name) for f in fields(value) if f.compare}
        stated = {f.name: x for f, x in values.items() if f.default is MISSING or x != f.default}
        derived = {"names": list(value), "sound": not value.unsound} if isinstance(value, Fit) else {}
        entries = {_JSON_NAMES.get(name, name): x for name, x in (stated | derived).items()}
        return _to_json(entries)
    if isinstance(value, Mapping):
        return {name: _to_json(x) for name, x in value.items()}
    if isinstance(value, tuple | list):
        return [_to_json(x) for x in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


class _FitJson(BaseModel, strict=True, allow_inf_nan=False):
    parameters: dict[str, Estimate]
    names: list[str]
    covariance: list[list[float]]
    chi2: float
    dof: _Count
    converged: bool
    sound: bool | None = None  # without a warning of that effect, see `_missing_warnings`
    warnings: tuple[FitWarning, ...]
    masked_samples: _Count | None = None
    diagnostics: Diagnostics | None = None
    centrifugal: Estimate | None = None
    stiffness: tuple[Stiffness, ...] = ()


class _ResultsJson(BaseModel, strict=True, allow_inf_nan=False):
    joint: _FitJson | None = None
    experiments: dict[str, _FitJson] = {}
    cross_talk: dict[str, _FitJson] = {}
    inertial: dict[str, _FitJson] = {}
    provenance: dict[str, object] = {}


def load(path: Path) -> Results:
    """Read results.

    Raises
    ------
    InputError
        If the file is missing, is no JSON, has another schema or breaks it.
    """
    content = documents.from_json(path, "a file of results", SCHEMA, _ResultsJson)
    sections = {
        section: {
            name: _fit_from_json(fit, f"{path}: {place((section, name))}")
            for name, fit in getattr(content, section).items()
        }
        for section in _SECTIONS
    }
    return Results(
        joint=None if content.joint is None else _fit_from_json(content.joint, f"{path}: joint"),
        provenance=Provenance.from_entries(content.provenance),
        **sections,
    )


def _fit_from_json(fit: _FitJson, place: str) -> Fit:
    if sorted(fit.names) != sorted(fit.parameters):
        raise InputError(f"{place}.names: expected each of the parameters once")
    if [len(row) for row in fit.covariance] != [len(fit.names)] * len(fit.names):
        raise InputError(f"{place}.covariance: expected {len(fit.names)} rows of {len(fit.names)} numbers")
    covariance = np.array(fit.covariance).reshape(2 * [len(fit.names)])
    sigmas = np.array([fit.parameters[name].sigma for name in fit.names])
    values = np.array([fit.parameters[name].value for name in fit.names])
    if np.any(np.abs((values, sigmas)) > _LARGEST) or np.any(np.abs(covariance) > 1.01 * _LARGEST**2):
        raise InputError(f"{place}: too large to work with, expected values and sigmas below {_LARGEST:g}")
    for name in fit.names:
        estimate = fit.parameters[name]
        kind = estimate.constraint.kind if estimate.constraint else ""
        if not (estimate.sigma > 0 or (estimate.is_exact and kind in ("fixed", "tied"))):
            raise InputError(
                f"{place}.parameters.{name}.sigma: {estimate.sigma:g}, expected more than 0, or 0 with a "
                'constraint "fixed" or "tied"'
            )
    if not np.allclose(np.diag(covariance), sigmas**2, rtol=1e-6, atol=0):
        raise InputError(f"{place}.covariance: expected the squares of the sigmas on the diagonal")
    if np.any(np.abs(covariance) > (1 + 1e-6) * np.outer(sigmas, sigmas)):
        raise InputError(f"{place}.covariance: expected correlations of at most 1")
    names = (f.name for f in fields(Fit) if f.compare)
    entries = {name: getattr(fit, _JSON_NAMES.get(name, name)) for name in names} | {
        "parameters": {name: fit.parameters[name] for name in fit.names},
        "covariance_matrix": covariance,
        "warnings": (*fit.warnings, *_missing_warnings(fit)),
    }
    return Fit(**entries)


def _missing_warnings(fit: _FitJson) -> list[FitWarning]:
    """Return a warning for a fit whose file says it is unsound without a warning of a known kind."""
    if fit.sound is not False or any(w.kind.unsound for w in fit.warnings):
        return []
    reasons = "; ".join(w.message for w in fit.warnings) or "no warning"
    return [FitWarning("unsound_file", (), f"its file says sound = false and has as reason: {reasons}")]
