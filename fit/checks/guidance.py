"""Whether ``o_1`` responds to slow guidance with a gain of one, well below the band of the drag-free loop.

The transfer of a loop whose gain grows without bound at low frequency is a power series of i f that begins
with 1. An ``o_1`` of another scale or sign responds by another factor, at all low frequencies alike. No
controller does that: where the response of a loop is not one, it changes with frequency. The equation of
motion hardly shows such a scale if all runs of an alignment epoch have it, since ``delta_ifo`` absorbs it.
The fit takes nothing from guidance, so that no other property of the response matters.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.false_alarms import sigma_limit
from fit.findings import Amount, Finding
from fit.parallel import parallel_map
from fit.spectra import derivatives, windowing
from fit.telemetry import Telemetry
from fit.units import concise_value
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]

BAND = (2e-4, 2.2e-3)  # Hz
NEGLIGIBLE = 0.02  # departure of the gain from 1, which changes delta_ifo by less than its sigma
CONSTANT = 0.5  # change of the response over the band, over that departure, up to which it is a scale
COHERENCE = 0.9  # of o_1 and guidance
ITERATIONS = 3  # of weights and fit
ROUNDING = 1e-12  # of the largest, below which a residual is no noise
MIN_RUNS = 2  # runs of an alignment epoch that show a fault in common


@dataclass(frozen=True)
class SlowResponse:
    """Response of ``o_1`` to slow guidance, a power series of i f / BAND[1].

    Attributes
    ----------
    series, sigma : ndarray, shape (3,)
        Coefficients, the first of which is the gain, and their standard deviations.
    coherence : float
        Share of the power of ``o_1`` over the band that is response.
    """

    series: Array
    sigma: Array
    coherence: float

    def is_measured(self, n_sigma: float) -> bool:
        """Whether a gain other than one would show."""
        return bool(self.coherence > COHERENCE and n_sigma * self.sigma[0] < CONSTANT)

    def is_scaled(self, n_sigma: float) -> bool:
        """Whether the gain departs from one by `n_sigma`, at all frequencies of the band alike."""
        departure = abs(float(self.series[0]) - 1)
        change = np.abs(self.series[1:]) - 3 * self.sigma[1:]
        significant = departure > max(NEGLIGIBLE, n_sigma * float(self.sigma[0]))
        return bool(significant and np.all(change < CONSTANT * departure))


def find(campaign: Campaign) -> list[Finding]:
    """Return the experiments whose ``o_1`` or guidance is of another scale or sign.

    Where all runs of an alignment epoch that show their gain have another one, so have the others.
    """
    experiments = campaign.usable
    runs = parallel_map(lambda e: slow_response(e.sysid), experiments, Experiment.samples)
    n_sigma = sigma_limit(len(experiments))
    responses = {
        e.name: response
        for e, response in zip(experiments, runs, strict=True)
        if response and response.is_measured(n_sigma)
    }
    findings = {
        e.name: _scale_finding(e.sysid.telemetry, responses[e.name])
        for e in experiments
        if e.name in responses and responses[e.name].is_scaled(n_sigma)
    }
    for epoch in sorted({e.sysid.telemetry.alignment_epoch for e in experiments}):
        members = {e.name: e for e in experiments if e.sysid.telemetry.alignment_epoch == epoch}
        measured = members.keys() & responses.keys()
        if len(measured) < MIN_RUNS or not measured <= findings.keys():
            continue
        words = (
            f"nothing distinguishes its o_1 from that of {', '.join(sorted(measured))}, of the same "
            "alignment epoch, which does not follow its guidance by one"
        )
        for name in members.keys() - measured:
            run = members[name].sysid.telemetry
            findings[name] = Finding("guidance_scale", f"{run.path}: {words}", run.run, "o_1")
    return list(findings.values())


def _scale_finding(run: Telemetry, response: SlowResponse) -> Finding:
    gain, sigma = float(response.series[0]), float(response.sigma[0])
    kind = "sign" if gain < 0 else "scale"
    words = (
        f"the gain from slow guidance_o_1 to o_1 is {concise_value(gain, sigma)}, expected 1: "
        f"the {kind} of one of the two is wrong"
    )
    return Finding("guidance_scale", f"{run.path}: {words}", run.run, "o_1", amount=Amount(gain, sigma))


def slow_response(run: Run) -> SlowResponse | None:
    """Measure the response of ``o_1`` to slow guidance; None if it is not driven so."""
    if "guidance_o_1" not in run.telemetry.channels:
        return None
    fs = run.telemetry.fs
    taps, factor = derivatives.low_pass(fs)
    guidance, masked, _ = derivatives.preprocess(run.telemetry.channels["guidance_o_1"], fs, taps, factor)
    if np.ptp(guidance) <= 1e-9 * np.max(np.abs(guidance)):
        return None
    pair = np.stack([guidance, run.channels.series["o_1"]], axis=1)
    spectra = windowing.transform(
        pair - pair.mean(axis=0), run.channels.valid & ~masked, run.channels.fs, band=BAND
    )
    return _power_series(spectra.f, *spectra.columns.T)


def _power_series(
    f: Array, guidance: NDArray[np.complex128], o_1: NDArray[np.complex128]
) -> SlowResponse | None:
    """Fit the response at frequencies f [Hz], shape (B,), in noise that is a power of frequency."""
    if f.size < 4 or not np.all(guidance):
        return None
    columns = (1j * f[:, None] / BAND[1]) ** np.arange(3) * guidance[:, None]
    level = np.ones(f.size)
    for _ in range(ITERATIONS):
        whitened = np.column_stack([columns, o_1]) / level[:, None]
        rows = np.concatenate([whitened.real, whitened.imag])
        X, y = rows[:, :3], rows[:, 3]
        c, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
        if rank < 3:
            return None
        residual = np.maximum(np.abs(o_1 - columns @ c), ROUNDING * np.abs(o_1).max())
        power = float(np.sum((y - X @ c) ** 2)) / (y.size - 3)
        sigma = np.sqrt(power * np.diag(np.linalg.inv(X.T @ X)))
        level = np.exp(np.polyval(np.polyfit(np.log(f), np.log(residual), 1), np.log(f)))
    coherence = 1 - float(np.sum(residual**2)) / float(np.sum(np.abs(o_1) ** 2))
    return SlowResponse(c, sigma, coherence)
