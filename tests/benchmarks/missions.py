"""Many missions with truths of their own: are the sigmas of what a mission claims true?

    python -m tests.benchmarks.missions -n 200 --log missions.jsonl

draws `campaigns/mission.toml` again and again: noise, glitches, levels of the noise, scatter of the gains,
truths (gains within 5 %, all else within 30 % of the flight's) and, where asked for, cross-talk and
misalignments. It fits each as `lpfcosim run` does and tells the pulls.

* ``--kind x``: the thirteen experiments with their noise runs, along x, drawn from the spectra of the closed
  loop (`lpfcosim.linear.spectral_simulation`).
* ``--kind whole``: the same with the whole spacecraft.
* ``--kind euler``: the Euler fit, from three days of noise of a period, stepped through the FMUs.

What is done is in the log; the same command continues it. A mission depends on its number, not on when or
beside what it is done. ``--docs`` draws nothing, and writes the table of a log into
docs/mission-pulls-KIND.csv with a summary in docs/mission.md.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # a process for each processor does better

import numpy as np

from fit.crosstalk.euler_fit import fit_period
from fit.errors import CalibrationError
from fit.forecasting import coverage
from fit.parameters import joint_names, joint_parameter
from fit.pipeline import calibrate
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.settings import settings
from fit.telemetry.reader import read_all
from lpfcosim.campaign import Campaign, loading, montecarlo
from lpfcosim.errors import RunError
from lpfcosim.execution import runner
from lpfcosim.execution.telemetry_file import truth
from lpfcosim.linear import spectral_simulation
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.planned_experiments import telemetry_of
from lpfcosim.spacecraft import Run
from lpfcosim.workflows.montecarlo_trial import channels_of_fit
from tests import ROOT
from tests.benchmarks.sbc import known

CAMPAIGN = ROOT / "campaigns" / "mission.toml"
SPREAD = 0.3  # of cross-talk and misalignments about those of the campaign, relative, even
DAYS = 3  # of noise for an Euler fit
LAMBDA = 8e-4  # sigma of the gains in a mission of which they scatter
KINDS = {
    "x": "Thirteen experiments, along x",
    "whole": "Thirteen experiments, whole spacecraft",
    "euler": "Euler fit, three days of noise",
}
DOCS = ROOT / "docs" / "mission.md"
Line = dict[str, Any]


def drawn(plan: Campaign, number: int, kind: str) -> Campaign:
    """Return mission `number`: what `kind` needs of it, with truths of its own."""
    plan = montecarlo.numbered(plan, number, redraw=True)
    rng = np.random.default_rng([plan.seed, 1])
    b, misaligned = 1 + rng.uniform(-SPREAD, SPREAD, 6), 1 + rng.uniform(-SPREAD, SPREAD, 2)
    experiments = []
    for e in plan.experiments:
        craft = None
        if kind != "x":
            delta_phi, delta_eta = misaligned * (e.spacecraft.delta_phi, e.spacecraft.delta_eta)
            lever = replace(
                e.spacecraft, delta_phi=-e.spacecraft.delta_phi, delta_eta=-e.spacecraft.delta_eta
            )
            left = np.array(lever.compensated().b)  # after the lever arm
            own = replace(e.spacecraft, b=tuple(left * b), delta_phi=delta_phi, delta_eta=delta_eta)
            craft = own.compensated()
        if kind == "euler" and not e.n_samples:
            experiments.append(replace(e, spacecraft=craft, n_noise_samples=DAYS * 864_000))
        if kind != "euler" and e.n_samples:
            period = e.inertial_period if craft else 0
            experiments.append(replace(e, spacecraft=craft, inertial_period=period))
    return replace(plan, experiments=tuple(experiments))


def known_dynamics(run: Run) -> Fit:
    """Return a joint fit that found the truth, with sigmas of a mission."""
    known = {name: joint_parameter(name) for name in joint_names([run.alignment_epoch])}
    about = run.about or run.truth
    true = vars(about) | {f"delta_ifo_{k}": v for k, v in about.delta_ifo.items()}
    estimates = {
        name: Estimate(float(true[name]), LAMBDA if name.startswith("lambda") else p.sigma, p.unit)
        for name, p in known.items()
    }
    return Fit(estimates, np.diag([e.sigma**2 for e in estimates.values()]), 1.0, 1, True, ())


def rotated(number: int) -> Line:
    """Step three days of noise of one period, in turn, and fit the misalignment."""
    runs = drawn(loading.load(CAMPAIGN), number, "euler").runs
    run = runs[number % len(runs)]
    fmus = build.build(model_of(run).models)
    with tempfile.TemporaryDirectory() as folder:
        runner.write_telemetry(run, fmus, Path(folder) / "run.h5", {})
        found = fit_period(read_all(sorted(Path(folder).glob("*.h5")), trusted=True), known_dynamics(run))
    true = {name: getattr(run.spacecraft, name) for name in found.parameters}
    turned = found.centrifugal
    return {
        "number": number,
        "pulls": {name: (e.value - true[name]) / e.sigma for name, e in found.parameters.items()}
        | ({"coefficient of g_Omega": (turned.value - 1) / turned.sigma} if turned else {}),
        "sigmas": {name: e.sigma for name, e in found.parameters.items()},
        "period": run.inertial_period,
        "unsound": [w.code for w in found.unsound],
        "left_out": [],
        "scatter": {},
    }


def fitted(plan: Campaign, number: int) -> Results:
    """Return the fit of a mission whose runs are drawn from spectra."""
    runs = []
    for run in plan.runs:
        rng = np.random.default_rng([number, plan.seed, *run.name.encode()])
        runs.append(telemetry_of(run, spectral_simulation.Simulation(run, channels_of_fit(run)).record(rng)))
    results = calibrate(runs, settings(dict(plan.fit), "missions"))
    return coverage.with_truth(results, runs, {run.name: truth(run) for run in plan.runs})


def trial(number: int, kind: str) -> Line:
    """Draw a mission and fit it; what is kept of it, or what went wrong."""
    try:
        if kind == "euler":
            return rotated(number)
        plan = drawn(loading.load(CAMPAIGN), number, kind)
        found = fitted(plan, number)
    except (CalibrationError, RunError) as error:
        return {"number": number, "failed": str(error)}
    fits = {"": found.joint} | {f"{epoch}: ": fit for epoch, fit in found.cross_talk.items()}
    line: Line = {"number": number, "pulls": {}, "sigmas": {}, "withheld": [], "unsound": []}
    for place, fit in fits.items():
        if fit is None:
            continue
        line["unsound"] += [f"{place}{w.code}" for w in fit.unsound]
        line["withheld"] += [
            f"{place}{name}" for w in fit.warnings if w.code == "indeterminable" for name in w.parameters
        ]
        for name, estimate in fit.parameters.items():
            if estimate.pull is not None:
                line["pulls"][place + name] = estimate.pull
                line["sigmas"][place + name] = estimate.sigma
    line["left_out"] = sorted(plan_names(plan) - set(found.provenance.joint_runs))
    line["scatter"] = {name: told["value"] for name, told in (found.provenance.scatter or {}).items()}
    return line


def plan_names(plan: Campaign) -> set[str]:
    """Return the names of the runs with injections."""
    return {run.name for run in plan.runs if run.kind == "sysid"}


def header(kind: str) -> Line:
    """Return what a log is of: another campaign or fit makes another."""
    files = sorted([*(ROOT / "fit").rglob("*.py"), *(ROOT / "lpfcosim" / "linear").rglob("*.py")])
    total = sha256(b"".join(file.read_bytes() for file in files))
    return {"digest": loading.load(CAMPAIGN).digest, "kind": kind, "sources": total.hexdigest()}


def run(n: int, log: Path, jobs: int, kind: str) -> list[Line]:
    """Do what is missing of the first `n` missions; return all that are done, in their order."""
    lines = {int(line["number"]): line for line in known(log, header(kind))}
    missing = [number for number in range(n) if number not in lines]
    started = time.perf_counter()
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool, log.open("a", encoding="utf-8") as file:
        futures = [pool.submit(trial, m, kind) for m in missing]
        for done, future in enumerate(as_completed(futures), 1):
            line = future.result()
            lines[int(line["number"])] = line
            file.write(json.dumps(line) + "\n")
            file.flush()
            spent = time.perf_counter() - started
            print(f"{done} of {len(missing)}, {spent / done:.1f} s each", file=sys.stderr, flush=True)
    return [lines[number] for number in sorted(lines)]


def table(lines: Sequence[Line]) -> list[str]:
    """Return pulls as lines of Markdown, and above them what became of the missions.

    What has a value for each alignment epoch is one line.
    """
    failed = [line for line in lines if "failed" in line]
    unsound = [line for line in lines if line.get("unsound")]
    sound = [line for line in lines if "pulls" in line and not line["unsound"]]
    fewer = sum(bool(line["left_out"]) for line in sound)
    scattered = sum(bool(line["scatter"]) for line in sound)
    text = [
        f"{len(lines)} missions, {len(failed)} without a joint fit, {len(unsound)} whose uncertainties are "
        f"not valid; {len(sound)} are counted. In {fewer} an experiment was left out, in {scattered} the "
        "scatter of gains was modelled.",
        "",
        "| parameter | n | mean pull | standard deviation | within 1 sigma | largest |",
        "|---|---|---|---|---|---|",
    ]
    pulled: dict[str, list[float]] = {}
    for name, pull in (pair for line in sound for pair in line["pulls"].items()):
        pulled.setdefault(re.sub(r"^\d+: |(?<=delta_ifo)_\d+$", "", name), []).append(pull)  # all epochs
    for name, pulls_of in pulled.items():
        p = np.array(pulls_of)
        text.append(
            f"| {name} | {p.size} | {p.mean():+.2f} ± {p.std(ddof=1) / np.sqrt(p.size):.2f} "
            f"| {p.std(ddof=1):.2f} ± {1 / np.sqrt(2 * p.size):.2f} | {100 * np.mean(abs(p) < 1):.0f} % "
            f"| {abs(p).max():.1f} |"
        )
    return text


def summary(rows: Sequence[Sequence[str]]) -> str:
    """Return the ranges of the pulls of a table, of which each row is a parameter."""
    means, deviations = (np.array([float(row[k].split(" ±")[0]) for row in rows]) for k in (2, 3))
    shares = [int(row[4].removesuffix(" %")) for row in rows]
    return (
        f"Mean pulls are {means.min():+.2f} to {means.max():+.2f}, standard deviations "
        f"{deviations.min():.2f} to {deviations.max():.2f}; {min(shares)} to {max(shares)} % of the "
        "estimates lie within 1 sigma."
    )


def write(kind: str, text: Sequence[str]) -> None:
    """Write a table as CSV, and its summary into the page."""
    counts, _, heading, _, *body = text
    rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in (heading, *body)]
    path = DOCS.with_name(f"mission-pulls-{kind}.csv")
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    begin, end = f"<!-- from missions.py {kind} -->", f"<!-- end of missions.py {kind} -->"
    page = DOCS.read_text(encoding="utf-8")
    before, after = page.split(begin)[0], page.split(end)[1]
    paragraph = f"**{KINDS[kind]}** ([pulls]({path.name})). {counts} {summary(rows[1:])}"
    DOCS.write_text(f"{before}{begin}\n{paragraph}\n{end}{after}", encoding="utf-8")


def main() -> None:
    """Draw, fit, tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=200, help="how many missions")
    parser.add_argument("--log", type=Path, required=True, help="what is done; continued")
    parser.add_argument("--kind", choices=KINDS, default="x")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--docs", action="store_true", help="write the table of the log, draw nothing")
    asked = parser.parse_args()
    if asked.docs:
        _, *done = asked.log.read_text(encoding="utf-8").splitlines()
        write(asked.kind, table([json.loads(line) for line in done]))
        return
    lines = run(asked.n, asked.log, asked.jobs, asked.kind)
    print("\n".join(table(lines)))
    for line in lines:
        if "failed" in line:
            print(f"{line['number']}: {line['failed']}")
    print(Counter(code for line in lines for code in line.get("unsound", ())))


if __name__ == "__main__":
    main()
