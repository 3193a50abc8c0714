"""The simulated mission beside the flight, point by point: ``python -m tests.benchmarks.flight mission``.

The folder is that of ``lpfcosim run campaigns/mission.toml``. Everything is read from its results and
telemetry, or computed from these, but for the forecast of the fit that the flight made: gains common to all
experiments, cross-talk not subtracted (Eq. (11)). ``--docs`` writes them into docs/mission.md and
the CSV files beside it.
"""

from __future__ import annotations

import argparse
import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import scipy

from fit import deltag
from fit.fitting.random_effects import weighted_mean
from fit.forecasting import expected_fit as forecasts
from fit.model import dynamics
from fit.parameters import FLIGHT
from fit.results import Fit, Results, load
from fit.settings import settings
from fit.telemetry.reader import Telemetry, inertial_period, read_all
from fit.whitening import Experiment
from fit.whitening.run import Run
from lpfcosim.campaign import loading
from lpfcosim.planned_experiments import planned_experiments
from tests import ROOT

CAMPAIGN = ROOT / "campaigns" / "mission.toml"
DOCS = ROOT / "docs" / "mission.md"
BEGIN, END = "<!-- from flight.py -->", "<!-- end of flight.py -->"
CSV_FILES = {
    "Dynamics": "mission-dynamics.csv",
    "Misalignment angles": "mission-angles.csv",
    "Spectra by date": "mission-spectra.csv",
    "Rotation and motion": "mission-motion.csv",
}
MOTION = {name for parts in dynamics.MEANS.values() for name in parts}
#: Frequencies [Hz], the stretches that are averaged [s], and what the flight has there in fm s^-2 Hz^-1/2.
SPECTRA = (
    (1e-4, 40_000.0, "11, by 1/f from 1.1 ± 0.3 at 1 mHz (arXiv 2405.05207)"),
    (1e-3, 7200.0, "5.57 (2016), 1.74 (2017) and the tail of 1.1 (arXiv 2405.05207)"),
    (1e-2, 3600.0, "5.57 ± 0.04 (2016), 1.74 ± 0.05 (2017, above 2 mHz)"),
    (3e-2, 3600.0, "the same, and 1.2 of read-out (35 fm Hz^-1/2, PRL 116, 231101)"),
    (5e-2, 3600.0, "the same, and 3.5 of read-out"),
)
BAND = 1.25  # from f / BAND to f BAND
#: Frequencies [Hz] at which the shares of rotation and motion are told, and the stretches [s].
SHARES = {2e-4: 40_000.0, 5e-4: 20_000.0, 1e-3: 7200.0, 3e-3: 7200.0} | dict.fromkeys(
    (1e-2, 2e-2, 3e-2, 5e-2, 7e-2), 3600.0
)
EULER = {  # Euler fit of the paper, mrad
    "1": ((-0.47, 0.03), (-0.066, 0.007)),
    "2": ((-0.40, 0.03), (-0.032, 0.003)),
    "3": ((-0.39, 0.02), (-0.137, 0.003)),
}


def as_flown() -> Fit:
    """Return the forecast of a fit as the flight made it: common gains, cross-talk not subtracted."""

    def bare(plan):
        def make() -> Experiment:
            made = plan.make()
            told = made.sysid.telemetry
            channels = {name: x for name, x in told.channels.items() if name not in MOTION}
            run = Run(replace(told, channels=channels))
            return Experiment(run, run if made.noise else None)

        return replace(plan, make=make)

    plans = [bare(plan) for plan in planned_experiments(loading.load(CAMPAIGN))]
    return forecasts.expected_fit(plans, settings({"scatter": []}), {})


def parameters(results: Results, flown: Fit) -> Iterator[str]:
    """The fourteen parameters of the joint fit."""
    heads = ("parameter", "flight", "true value", "estimate", "pull")
    yield f"| {' | '.join((*heads, 'sigma / flight', 'as flown / flight'))} |"
    yield "|---|---|---|---|---|---|---|"
    for name, told in FLIGHT.items():
        if name not in flown.parameters:
            continue
        as_then = f"{flown.parameters[name].sigma / told.sigma:.2f}"
        e = results.joint.parameters.get(name)
        here = ("", "withheld", "", "")
        if e is not None:
            here = (
                f"{e.truth:.5g}",
                f"{e.value:.5g} ± {e.sigma:.1g}",
                f"{e.pull:+.1f}",
                f"{e.sigma / told.sigma:.2f}",
            )
        yield f"| {name} | {told.value:.5g} ± {told.sigma:.1g} | " + " | ".join((*here, as_then)) + " |"


def angles(results: Results) -> Iterator[str]:
    """The six angles of the Euler fit."""
    heads = ("angle [mrad], period", "flight", "true value", "estimate", "pull")
    yield f"| {' | '.join((*heads, 'sigma / flight'))} |"
    yield "|---|---|---|---|---|---|"
    for period, told in EULER.items():
        for name, (value, sigma) in zip(("delta_phi", "delta_eta"), told, strict=True):
            e = results.inertial[period].parameters[name]
            yield (
                f"| {name}, {period} | {value:.3g} ± {sigma:g} | {1e3 * e.truth:.3g} "
                f"| {1e3 * e.value:.4f} ± {1e3 * e.sigma:.4f} | {e.pull:+.1f} | {1e3 * e.sigma / sigma:.2f} |"
            )


def struck(results: Results) -> dict[str, list[tuple[float, float]]]:
    """Return begin and end of the glitches that the fit found, by run."""
    fits = [*results.experiments.values(), *results.inertial.values()]
    found: dict[str, list[tuple[float, float]]] = {}
    for finding in (w for f in fits for w in f.warnings if w.code == "glitches"):
        found.setdefault(finding.run, []).extend(finding.spans)
    return found


def level(
    x: np.ndarray, fs: float, f: float, length: float, spans: Sequence[tuple[float, float]]
) -> tuple[float, int]:
    """Return the ASD about a frequency over stretches without glitches, and how many there are."""
    n, powers = round(length * fs), []
    for first in range(0, x.size - n + 1, n // 2):
        part, begin, end = x[first : first + n], first / fs, (first + n) / fs
        if not np.isfinite(part).all() or any(a < end and b > begin for a, b in spans):
            continue
        at, power = scipy.signal.periodogram(part, fs, "blackmanharris", detrend="linear")
        powers.append(power[(at > f / BAND) & (at < f * BAND)].mean())
    return (float(np.sqrt(np.mean(powers))), len(powers)) if powers else (float("nan"), 0)


def spectra(results: Results, runs: Sequence[Telemetry]) -> Iterator[str]:
    """Delta g_x and Delta g by date."""
    yield "| noise run | date | " + " | ".join(f"{1e3 * f:g} mHz" for f, _, _ in SPECTRA) + " |"
    yield "|---|---|" + "---|" * len(SPECTRA)
    found = struck(results)
    for run in sorted((r for r in runs if r.kind == "noise"), key=lambda r: r.t0):
        product = deltag.delta_g(run, results)
        told = []
        for f, length, _ in SPECTRA:
            both = [
                level(product.channels[name], product.fs, f, length, found.get(run.run, ()))
                for name in ("delta_g_x", "delta_g")
            ]
            told.append(" → ".join(f"{1e15 * asd:.1f}" for asd, _ in both) if both[0][1] else "")
        yield f"| {run.run} | {run.t0[:10]} | " + " | ".join(told) + " |"
    yield "| flight | | " + " | ".join(said for _, _, said in SPECTRA) + " |"


def shares(results: Results, runs: Sequence[Telemetry]) -> Iterator[str]:
    """What rotation and motion make of Delta g_x, in the longest noise run of each inertial period."""
    yield "| period, run | term | " + " | ".join(f"{1e3 * f:g} mHz" for f in SHARES) + " |"
    yield "|---|---|" + "---|" * len(SHARES)
    found = struck(results)
    for period in sorted(results.inertial):
        own = [r for r in runs if r.kind == "noise" and inertial_period(r) == period]
        run = max(own, key=lambda r: r.duration)
        product = deltag.delta_g(run, results)
        x = product.channels
        told = {
            "centrifugal": x["g_Omega"],
            "Euler and cross-talk": x["g_dOmega"] + x["delta_g_SC"],
            "Delta g_x": x["delta_g_x"],
            "Delta g": x["delta_g"],
        }
        for name, series in told.items():
            levels = (level(series, product.fs, f, s, found.get(run.run, ()))[0] for f, s in SHARES.items())
            yield f"| {period}, {run.run} | {name} | " + " | ".join(f"{1e15 * v:.1f}" for v in levels) + " |"


def points(results: Results, runs: Sequence[Telemetry]) -> Iterator[str]:
    """What is one number each."""
    yield "| | flight | simulation |"
    yield "|---|---|---|"
    own = {k: f.parameters["lambda_2"] for k, f in results.experiments.items() if "lambda_2" in f.parameters}
    statistic = weighted_mean([*own.values()])
    farthest = 100 * max(abs(e.value / statistic.mean - 1) for e in own.values())
    yield f"| reduced chi-square of lambda_2 about its mean | near 90 | {statistic.chi2_red:.0f} |"
    yield f"| largest deviation of lambda_2 from the mean | about 0.5 % | {farthest:.2f} % |"
    spread = 100 * np.std([e.value for e in own.values()], ddof=1) / statistic.mean
    yield f"| rms of lambda_2 by experiment | 0.28 % (1.080 ± 0.003) | {spread:.2f} % |"
    days, true, seen, spans = sum(r.duration for r in runs) / 86400, 0, 0, struck(results)
    for run in runs:
        with h5py.File(run.path) as file:
            truth = file["truth"]
            begins, falls = (
                truth[f"glitch_{x}"][:] if f"glitch_{x}" in truth else [] for x in ("begin", "fall")
            )
        for begin, fall in zip(begins, falls, strict=True):
            true += 1
            seen += any(a < begin + fall + 60 and b > begin - 60 for a, b in spans.get(run.run, ()))
    told = f"{true / days:.2f} in {days:.1f} days; {seen} of {true} detected"
    yield f"| glitches a day | about 1 (arXiv 2205.11938) | {told} |"
    messages = [
        w.message for fit in results.cross_talk.values() for w in fit.warnings if w.code == "correlation"
    ]
    values = re.findall(r"([+-]\d\.\d+) \((b_\d)\)", " ".join(messages))
    value, name = max(values, key=lambda pair: abs(float(pair[0])))
    yield f"| largest correlation of delta_ifo with b_i | not negligible | {value} ({name}) |"


def tables(folder: Path) -> Mapping[str, list[str]]:
    """Return every table by its heading, as lines of Markdown."""
    results = load(folder / "results.json")
    runs = read_all(sorted((folder / "telemetry").glob("*.h5")), trusted=True)
    return {
        "Dynamics": [*parameters(results, as_flown())],
        "Misalignment angles": [*angles(results)],
        "Gains and glitches": [*points(results, runs)],
        "Spectra by date": [*spectra(results, runs)],
        "Rotation and motion": [*shares(results, runs)],
    }


def write_csv(path: Path, table: Sequence[str]) -> None:
    """Write a table of Markdown as CSV."""
    heading, _, *rows = ([cell.strip() for cell in line[1:-1].split("|")] for line in table)
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([heading, *rows])


def write(tables_by_heading: Mapping[str, Sequence[str]]) -> None:
    """Write the short table into the page and the long ones into CSV files beside it."""
    short = {h: lines for h, lines in tables_by_heading.items() if h not in CSV_FILES}
    text = "\n\n".join("\n".join(lines) for lines in short.values())
    page = DOCS.read_text(encoding="utf-8")
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    DOCS.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")
    for heading, name in CSV_FILES.items():
        write_csv(DOCS.with_name(name), tables_by_heading[heading])


def main() -> None:
    """Print the tables, and write them with ``--docs``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--docs", action="store_true", help="write the tables into the documentation")
    arguments = parser.parse_args()
    tables_by_heading = tables(arguments.folder)
    for heading, lines in tables_by_heading.items():
        print(f"### {heading}\n", *lines, "", sep="\n")
    if arguments.docs:
        write(tables_by_heading)


if __name__ == "__main__":
    main()
