"""What errors of the instrument do to the inertial calibration: ``python tests/benchmarks/inertial.py``.

Simulates three days of the last period of campaigns/inertial.toml through the FMUs, each seed anew, and fits
delta_phi and delta_eta with the true dynamics. The table pairs every change with the unchanged run of the
same seed, so that the noise cancels where the change leaves it alone.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from fit.crosstalk.euler_fit import fit_period
from fit.parameters import joint_names, joint_parameter
from fit.results import Fit
from fit.results.estimates import Estimate
from fit.telemetry import reader as telemetry
from lpfcosim.campaign import loading
from lpfcosim.execution import runner
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Run

CAMPAIGN = Path(__file__).parents[2] / "campaigns" / "inertial.toml"
NAMES = ("delta_phi", "delta_eta")


def three_days() -> Run:
    """The first noise run of the last period."""
    return next(r for r in loading.load(CAMPAIGN).runs if r.inertial_period == 3 and r.sample_rate == 1)


def true_dynamics(run: Run) -> Fit:
    """A joint fit that found the truth, with the sigmas of the flight."""
    known = {n: joint_parameter(n) for n in joint_names([run.alignment_epoch])}
    truth = run.truth
    estimates = {n: Estimate(float(truth[n]), p.sigma, p.unit) for n, p in known.items()}
    return Fit(estimates, np.diag([p.sigma**2 for p in known.values()]), 1.0, 1, True, ())


def fitted(run: Run, change: Callable[[telemetry.Telemetry], telemetry.Telemetry] = lambda t: t) -> Fit:
    """Simulate and fit one run."""
    fmus = build.build(model_of(run).models)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        runner.write_telemetry(run, fmus, path, {})
        return fit_period([change(telemetry.read(path))], true_dynamics(run))


def deviations(fit: Fit, run: Run) -> np.ndarray:
    """Estimate less truth, and sigma [rad], shape (2, 2)."""
    truth = (run.truth["delta_phi"], run.truth["delta_eta"])
    return np.array(
        [(fit.parameters[n].value - t, fit.parameters[n].sigma) for n, t in zip(NAMES, truth, strict=True)]
    )


def without(*beginnings: str) -> Callable[[telemetry.Telemetry], telemetry.Telemetry]:
    """Leave out channels."""

    def change(t: telemetry.Telemetry) -> telemetry.Telemetry:
        kept = {n: t.channels[n] for n in t.channels if not n.startswith(beginnings)}
        return replace(t, channels=kept)

    return change


def noisier(asd: float) -> Callable[[telemetry.Telemetry], telemetry.Telemetry]:
    """Add white noise of an ASD [rad s^-2 Hz^-0.5] to the torques as they are read out."""

    def change(t: telemetry.Telemetry) -> telemetry.Telemetry:
        rng = np.random.default_rng(7)
        size = asd * 6.8e-4 * np.sqrt(t.fs / 2)
        channels = {
            n: t.channels[n] + size * rng.standard_normal(t.time.size)
            if n.startswith("N_")
            else t.channels[n]
            for n in t.channels
        }
        return replace(t, channels=channels)

    return change


def cases(run: Run) -> Iterator[tuple[str, Run, Callable[[telemetry.Telemetry], telemetry.Telemetry]]]:
    """What is changed, in the simulation or in the telemetry."""
    truth, noise = run.truth, run.noise
    same = without("nothing")
    yield "torques 2 % stronger than commanded", replace(run, truth=truth | {"lambda_N": 1.02}), same
    yield (
        "torques leak force along x, kappa_phi = 0.01 /m",
        replace(run, truth=truth | {"kappa_phi": 1e-2}),
        same,
    )
    yield (
        "torque noise on the test masses x 3",
        replace(run, noise=noise | {"torque": 3 * noise["torque"]}),
        same,
    )
    yield (
        "torque noise on the test masses 1e-11 rad s^-2 Hz^-0.5",
        replace(run, noise=noise | {"torque": 1e-11}),
        same,
    )
    yield "torque read-out noise of 1e-11 rad s^-2 Hz^-0.5", run, noisier(1e-11)
    tracker = {f"star_tracker_{k}": 3 * noise[f"star_tracker_{k}"] for k in ("theta", "eta", "phi")}
    yield "star tracker noise x 3", replace(run, noise=noise | tracker), same
    yield "no star tracker in the telemetry", run, without("ast_")
    yield "no angles in the telemetry (N/I alone)", run, without("o_phi", "o_eta")


def sensitivity(seeds: int) -> None:
    """Print the table in Markdown."""
    run = three_days()
    plain = [deviations(fitted(replace(run, seed=s)), run) for s in range(1, seeds + 1)]
    print(f"Mean of {seeds} times three days of late-mission noise, paired by seed; shifts in per cent.\n")
    print(
        "| change | delta_phi | delta_eta | sigma of delta_phi | sigma of delta_eta |\n|---|---|---|---|---|"
    )
    truth = np.array([run.truth["delta_phi"], run.truth["delta_eta"]])
    for name, changed, change in cases(run):
        found = [deviations(fitted(replace(changed, seed=s), change), run) for s in range(1, seeds + 1)]
        shift = np.array([100 * (f[:, 0] - p[:, 0]) / truth for f, p in zip(found, plain, strict=True)])
        error = shift.std(axis=0, ddof=1) / np.sqrt(seeds)
        wider = np.mean([f[:, 1] / p[:, 1] for f, p in zip(found, plain, strict=True)], axis=0)
        moved = " | ".join(f"{m:+.1f} ± {e:.1f} %" for m, e in zip(shift.mean(axis=0), error, strict=True))
        print(f"| {name} | {moved} | x {wider[0]:.2f} | x {wider[1]:.2f} |", flush=True)


def main() -> None:
    """Print the table of some seeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    sensitivity(parser.parse_args().seeds)


if __name__ == "__main__":
    main()
