"""The fit of the 24 coefficients: weights from noise, estimates, blind directions, lmfit's model of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.findings import Finding
from fit.fitting import (
    JointModel,
    Prior,
    RunEstimate,
    SolvedModel,
    constraint_test,
    constraints,
    null_space,
    parameter_values,
)
from fit.results import Estimate, Fit
from fit.spectra import NoiseModel, fit_noise
from fit.tilt_to_length import michelson
from fit.tilt_to_length.channel_tests import channel_findings, light_time_findings
from fit.tilt_to_length.coefficients import COEFFICIENTS, NAMES, WIDTH
from fit.tilt_to_length.measurements import Measurements
from fit.tilt_to_length.normal_equations import (
    LinearEstimate,
    instrumental_variables,
    least_squares,
    product,
)
from fit.tilt_to_length.response import ResponseSpectra, response_spectra
from fit.units import prior_text

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

ITERATIONS = 4  # of weights: the noise run is freed of coupling by the last estimate
MAX_BIAS = 0.3  # sigma, of least squares by noise of an unknown level, beyond which a warning says so
MAX_CHI2 = 0.2  # by which chi^2 per degree of freedom may differ from 1
CHI2_SIGMA = 5.0  # and by how many times its scatter
MIN_DOF = 1e-3  # of a bin that a fit takes out
NEGLIGIBLE = 0.05  # part of a blind direction that is not named
LINK_NOISE = (1e-18, 1e-6)  # m Hz^-0.5, of a link: a range that a wrong unit leaves (choice)
DWS_ASD = 7e-8 / 335  # rad Hz^-0.5, of lisainstrument: where measurements do not state it
PRIOR = f"left at the prior, {prior_text(0, 1e3 * WIDTH)} mm/rad"


@dataclass(frozen=True)
class Identity:
    """Coefficients of the columns are the parameters themselves, see `fit.fitting.RunEstimate`."""

    def coefficients(self, theta: Array) -> Array:
        """Return the coefficients, shape (25,), the first that of the data."""
        return np.concatenate([[1.0], theta])

    def gradient(self, theta: Array) -> Array:
        """Return their derivatives, shape (25, 24)."""
        return np.concatenate([np.zeros((1, theta.size)), np.eye(theta.size)])


def calibrate_ttl(
    measurements: Measurements, noise: Measurements | None = None, params: lmfit.Parameters | None = None
) -> tuple[Fit, dict[str, dict[str, float]]]:
    """Fit the coefficients of tilt-to-length coupling.

    Parameters
    ----------
    measurements : Measurements
        With manoeuvres, or long.
    noise : Measurements, optional
        A noise run; without one, the residual of the measurements themselves weighs them.
    params : lmfit.Parameters, optional
        Coefficients that are fixed, bounded, tied or have a `Prior`.

    Returns
    -------
    fit : Fit
        With truth and pull where the measurements have the truth.
    compared : dict of str to dict
        By coefficient that is determined [m/rad]: sigma of ``least_squares`` and of ``instruments``, and the
        ``bias`` of least squares by noise of wavefront sensing, which the estimates are free of.

    Raises
    ------
    InputError
        If the measurements do not fit together, or a parameter is none of the coefficients.
    FitError
        If no estimate comes out.
    """
    if noise is not None:
        _check_noise_run(measurements, noise)
        both = measurements.michelson.keys() & noise.michelson.keys()
        measurements, noise = measurements.select(both), noise.select(both)
    spectra = response_spectra(measurements)
    reference = spectra if noise is None else response_spectra(noise)
    dws_asd = DWS_ASD if measurements.dws_asd is None else measurements.dws_asd
    weights, estimate = _weigh(spectra, reference, dws_asd)
    _check_unit(noise or measurements, weights)
    instruments = instrumental_variables(spectra, weights)
    compared = _by_estimator(estimate, instruments)
    warnings = [*_absence(measurements), *([] if noise is not None else [_NO_NOISE_RUN])]
    if measurements.dws_asd is None:
        bias = float(np.max(np.abs(estimate.bias) / estimate.sigma))
        estimate = estimate.with_uncertain_bias()
        is_better = bool(np.all(instruments.sigma <= estimate.sigma))
        estimate = instruments if is_better else estimate
        warnings += _unstated_noise_warnings(bias, is_better)
    solved, undetermined, blind = _solve(measurements, estimate, params)
    c = parameter_values(solved.result.params)
    chi2 = float(2 * np.sum(weights * np.abs(spectra.residual(c)) ** 2))
    dof = 2 * weights.size - len(NAMES)
    warnings += [
        *channel_findings(reference),
        *light_time_findings(measurements, spectra, weights, c, dws_asd),
        *blind,
        *_misfit_warnings(chi2 / dof, math.sqrt(2 * spectra.variance_factor / dof)),
    ]
    estimates, covariance = _estimates(solved, undetermined, _stated(params), measurements.truth)
    return Fit(estimates, covariance, chi2, dof, True, tuple(warnings), solved=solved), compared


def _by_estimator(estimate: LinearEstimate, instruments: LinearEstimate) -> dict[str, dict[str, float]]:
    """Return sigmas and bias by coefficient, without those that are not determined."""
    columns = {"least_squares": estimate.sigma, "bias": estimate.bias, "instruments": instruments.sigma}
    return {
        key: {name: float(x) for name, x in zip(NAMES, column, strict=True) if np.isfinite(x)}
        for key, column in columns.items()
    }


def _weigh(
    spectra: ResponseSpectra, reference: ResponseSpectra, dws_asd: float
) -> tuple[Array, LinearEstimate]:
    """Return the inverse PSDs of what coupling leaves in `reference`, shape (V, B), and least squares."""
    weights = 1 / np.stack([_psd(reference.f, x, np.zeros(x.size))(spectra.f) for x in reference.data])
    estimate = least_squares(spectra, weights, dws_asd)
    for _ in range(ITERATIONS):
        leverage = _leverage(spectra, weights) if reference is spectra else np.zeros(reference.data.shape)
        psds = map(_psd, [reference.f] * len(weights), reference.residual(estimate.c), leverage)
        weights = 1 / np.stack([psd(spectra.f) for psd in psds])
        estimate = least_squares(spectra, weights, dws_asd)
    return weights, estimate


def _check_noise_run(measurements: Measurements, noise: Measurements) -> None:
    """Refuse a noise run of another laser frequency, and the measurements themselves."""
    if noise.central_frequency != measurements.central_frequency:
        raise InputError(
            f"{noise.path}: central_frequency: {noise.central_frequency:.7g} Hz, expected "
            f"{measurements.central_frequency:.7g} Hz as in {measurements.path}"
        )
    if not (both := measurements.michelson.keys() & noise.michelson.keys()):
        raise InputError(
            f"{noise.path}: none of the Michelson variables of {measurements.path}, expected one"
        )
    if any(np.array_equal(noise.michelson[name], measurements.michelson[name]) for name in both):
        raise InputError(
            f"{noise.path}: holds the measurements themselves, expected a run without manoeuvre; leave the "
            "noise run out if there is none"
        )


def _check_unit(measurements: Measurements, weights: Array) -> None:
    """Refuse noise that no link has, such as that of Michelson variables in another unit."""
    asd = michelson.C / measurements.central_frequency / math.sqrt(2 * float(np.median(weights)))
    if not LINK_NOISE[0] < asd < LINK_NOISE[1]:
        raise InputError(
            f"{measurements.path}: X2, Y2, Z2 have a noise of {asd:.1g} m Hz^-0.5 in a link, expected "
            f"{LINK_NOISE[0]:g} to {LINK_NOISE[1]:g}; give them as frequencies of the beat notes in Hz"
        )


_NO_NOISE_RUN = Finding(
    "no_noise_run",
    "no noise run: the measurements' own residual gives the weights, and chi2 does not test the fit",
)


def _absence(measurements: Measurements) -> list[Finding]:
    """Return which variables are left out, and the coefficients that the others do not contain."""
    if len(measurements.michelson) == len(michelson.VARIABLES):
        return []
    reason = f"without data: {', '.join(measurements.silent)}; " if measurements.silent else ""
    message = f"{measurements.path}: {reason}of X2, Y2, Z2 the fit uses {', '.join(measurements.michelson)}"
    findings = [Finding("missing_variables", message)]
    if absent := _absent(measurements.michelson):
        message = f"{', '.join(measurements.michelson)} does not contain {', '.join(absent)}; {PRIOR}"
        findings.append(Finding("indeterminable", message, parameters=absent))
    return findings


def _absent(variables: Iterable[str]) -> tuple[str, ...]:
    """Return the coefficients of assemblies in none of the variables."""
    present = {assembly for name in variables for assembly in michelson.LINKS[name]}
    return tuple(name for name in NAMES if name.split("_")[1] not in present)


def _psd(f: Array, residual: NDArray[np.complex128], leverage: Array) -> NoiseModel:
    """Return the smooth PSD of one variable from its residual, of which a fit took out the leverage."""
    return fit_noise(f, np.abs(residual) ** 2, np.maximum(1 - leverage, MIN_DOF))


def _leverage(spectra: ResponseSpectra, weights: Array) -> Array:
    """Return the share of every bin that the fit takes out, shape (V, B)."""
    covariance = scipy.linalg.pinvh(product(spectra.columns, weights, spectra.columns))
    columns = spectra.columns
    return np.asarray(np.einsum("vbk,kl,vbl->vb", columns.conj(), covariance, columns).real * weights)


def _solve(
    measurements: Measurements, estimate: LinearEstimate, params: lmfit.Parameters | None
) -> tuple[SolvedModel, NDArray[np.bool_], list[Finding]]:
    """Return lmfit's model of an estimate, which coefficients are not determined, and findings."""
    values, vectors = np.linalg.eigh(estimate.information * WIDTH**2)
    informed = values > max(null_space.FLOOR, 1e-13 * float(values[-1]))
    if not (np.isfinite(values).all() and informed.any()):
        raise FitError(f"{measurements.path}: the measurements determine no coefficient")
    root = (np.sqrt(values[informed]) * vectors[:, informed] / WIDTH).T
    model = JointModel([RunEstimate("ttl", estimate.c, root, Identity())])
    weak = [Prior(p.value, p.prior_sigma) for p in COEFFICIENTS]
    from lmfit.minimizer import MinimizerResult  # slow to import

    initial = make_params()
    unsolved = SolvedModel(model, MinimizerResult(params=initial), weak)
    free = unsolved.refit(initial)
    result = unsolved.refit(params) if params else free
    undetermined, directions = null_space.null_space(estimate.information, np.full(len(NAMES), WIDTH))
    sigma = np.sqrt(np.diag(free.covar))
    test = constraint_test.compare(
        _stated(params),
        {NAMES[i]: bound for i, bound in constraints.at_bound(result.params, sigma).items()},
        result.params.valuesdict(),
        {name: (p.value, s) for (name, p), s in zip(free.params.items(), sigma, strict=True)},
        result.chisqr - free.chisqr,
    )
    warnings = [*test.warnings, *blind_warnings(undetermined, directions, tuple(measurements.michelson))]
    return SolvedModel(model, result, weak), undetermined, warnings


def _stated(params: lmfit.Parameters | None) -> dict[str, str]:
    """Return what the user states of coefficients, in words."""
    return {name: text for name, p in (params or {}).items() if (text := constraints.text(p))}


def _estimates(
    solved: SolvedModel, undetermined: NDArray[np.bool_], stated: dict[str, str], truth: dict[str, float]
) -> tuple[dict[str, Estimate], Array]:
    """Return the coefficients that are determined or constrained, and their covariance."""
    is_free = [p.vary and not p.expr for p in solved.result.params.values()]
    reported = np.flatnonzero(~(undetermined & is_free))
    covariance = solved.model.covariance(solved.result.params)[np.ix_(reported, reported)]
    theta, sigma = parameter_values(solved.result.params)[reported], np.sqrt(np.diag(covariance))
    estimates = {}
    for i, value, error in zip(reported, theta.tolist(), sigma.tolist(), strict=True):
        p = COEFFICIENTS[i]
        estimate = Estimate(value, error, p.unit, truth.get(p.name), constraint=stated.get(p.name, ""))
        pull = estimate.difference(truth[p.name]) if p.name in truth else None
        estimates[p.name] = replace(estimate, pull=pull)
    return estimates, covariance


def make_params() -> lmfit.Parameters:
    """Return the 24 coefficients, free and at zero, to be fixed, bounded, tied or given a `Prior`."""
    import lmfit  # slow to import

    params = lmfit.Parameters()
    for name in NAMES:
        params.add(name, value=0.0)
    return params


def blind_warnings(
    undetermined: NDArray[np.bool_], directions: Array, variables: Sequence[str] = michelson.VARIABLES
) -> list[Finding]:
    """Name every combination that the data do not determine.

    Parameters
    ----------
    undetermined : ndarray of bool, shape (24,)
        Which coefficients are not.
    directions : ndarray, shape (K, 24)
        The combinations, see `fit.fitting.null_space`.
    variables : sequence of str
        The Michelson variables; coefficients that they do not contain are not named.
    """
    absent = {*_absent(variables)}
    warnings, covered = [], {*absent}
    is_complete = len(variables) == len(michelson.VARIABLES)
    for direction in directions:
        part = np.flatnonzero(np.abs(direction) > NEGLIGIBLE)
        names = tuple(NAMES[i] for i in part)
        if absent.issuperset(names):
            continue
        covered |= set(names)
        cure = _cure(names) if is_complete else "a third Michelson variable would"
        combination = {NAMES[i]: float(direction[i]) for i in part}
        text = " ".join(f"{x:+.2g} {name}" for name, x in combination.items())
        message = f"the measurements do not determine {text}; {cure}; {PRIOR}"
        warnings.append(Finding("indeterminable", message, parameters=names, combination=combination))
    rest = tuple(NAMES[i] for i in np.flatnonzero(undetermined) if NAMES[i] not in covered)
    if rest:
        message = f"the measurements determine {', '.join(rest)} to no better than {1e3 * WIDTH:g} mm/rad"
        warnings.append(Finding("indeterminable", message, parameters=rest))
    return warnings


def _cure(names: tuple[str, ...]) -> str:
    """Return what motion would determine a combination."""
    spacecraft = ", ".join(sorted({name[2] for name in names}))
    if all("_phi_" in name for name in names):
        return f"move one assembly of spacecraft {spacecraft} in phi against the other"
    return f"turn spacecraft {spacecraft} about theta, eta and phi at different frequencies"


def _unstated_noise_warnings(bias: float, has_instruments: bool) -> list[Finding]:
    """Return a warning of noise of an unknown level, where its `bias` [sigma] matters."""
    if has_instruments:
        consequence = "the estimates are those of instrumental variables"
    elif bias > MAX_BIAS:
        consequence = f"the bias by {DWS_ASD:.2g} rad Hz^-0.5 is subtracted, and part of the sigmas"
    else:
        return []
    message = f"the noise of wavefront sensing is not stated (dws_asd): {consequence}"
    return [Finding("wavefront_noise", message)]


def _misfit_warnings(chi2_red: float, scatter: float) -> list[Finding]:
    """Return a warning where the residual has another power than the noise."""
    if abs(chi2_red - 1) < max(MAX_CHI2, CHI2_SIGMA * scatter):
        return []
    message = (
        f"the residual has {chi2_red:.2g} times the power of the noise; expected noise and units as "
        "in the noise run"
    )
    return [Finding("noise_mismatch", message)]
