"""Simulated calibrations of tilt-to-length coupling: errors, pulls and coverage of the 24 coefficients.

    python -m tests.benchmarks.tilt_to_length -n 100 --log tilt_to_length.jsonl

simulates `campaigns/lisa-ttl.toml` through the FMUs with new noise, three spacecraft with and without
manoeuvre; lisainstrument measures both with new noise and coefficients; pytdi and the fit follow. Needs
lpfcosim[lisa].

The log has a line for each calibration, and the same command continues it; a calibration depends on its
number alone. ``--docs`` writes the table of a log into docs/ttl-pulls.csv and its summary into
docs/lisa-ttl.md.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from textwrap import fill
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

import fit
import lpfcosim
from fit.tilt_to_length import NAMES
from lpfcosim.campaign import loading, montecarlo
from lpfcosim.constellation import join
from tests import ROOT
from tests.benchmarks.sbc import known

CAMPAIGN = ROOT / "campaigns" / "lisa-ttl.toml"
RANGE = 2.3e-3  # m/rad, of the coefficients, uniform: about that of lisainstrument
DOCS = ROOT / "docs" / "lisa-ttl.md"
BEGIN, END = "<!-- from tilt_to_length.py -->", "<!-- end of tilt_to_length.py -->"
HEAD = (
    "coefficient",
    "n",
    "rms_error_um_per_rad",
    "mean_sigma_um_per_rad",
    "mean_pull",
    "std_pull",
    "coverage",
)
Line = dict[str, Any]


def calibrate(number: int, folder: Path) -> Line:
    """Simulate a calibration in a folder; return errors and sigmas [m/rad]."""
    plan = montecarlo.numbered(loading.load(CAMPAIGN), number, redraw=False)
    rng = np.random.default_rng([plan.seed, 1])
    c = dict(zip(NAMES, rng.uniform(-RANGE, RANGE, len(NAMES)).tolist(), strict=True))
    files = lpfcosim.simulate(plan, folder, jobs=1)
    for kind, seed in zip(("sysid", "noise"), rng.integers(1, 2**31, 2).tolist(), strict=True):
        runs = sorted(file for file in files if file.stem.endswith("-noise") == (kind == "noise"))
        lpfcosim.simulate_measurements(join(runs), folder / f"{kind}.h5", seed=seed, coefficients=c)
    ttl = fit.calibrate_ttl(folder / "sysid.h5", folder / "noise.h5").ttl
    assert ttl is not None
    return {
        "number": number,
        "errors": {name: ttl[name].value - c[name] for name in NAMES},
        "sigmas": {name: ttl[name].sigma for name in NAMES},
        "chi2_red": ttl.chi2 / ttl.dof,
        "warnings": [w.code for w in ttl.warnings],
    }


def run(n: int, log: Path) -> list[Line]:
    """Simulate what is missing of `n` calibrations; return all."""
    sources = sorted([*(ROOT / "fit" / "tilt_to_length").glob("*.py"), CAMPAIGN])
    header = {"sources": sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()}
    lines = {int(line["number"]): line for line in known(log, header)}
    with log.open("a", encoding="utf-8") as file:
        for number in (number for number in range(n) if number not in lines):
            start = _seconds()
            with tempfile.TemporaryDirectory() as folder:
                lines[number] = calibrate(number, Path(folder))
            end = _seconds()
            file.write(json.dumps(lines[number]) + "\n")
            file.flush()
            spent = f"{end[0] - start[0]:.0f} s, {end[1] - start[1]:.0f} s of CPU"
            print(f"{number}: {spent}", file=sys.stderr, flush=True)
    return [lines[number] for number in sorted(lines)]


def _seconds() -> tuple[float, float]:
    """Return wall clock and CPU time, that of processes that ended included [s]."""
    return time.perf_counter(), sum(os.times()[:4])


def table(lines: Sequence[Line]) -> list[tuple[str, ...]]:
    """Return a row for each coefficient, as `HEAD` names the columns."""
    rows = []
    for name in NAMES:
        error, sigma = (np.array([line[key][name] for line in lines]) for key in ("errors", "sigmas"))
        pull = error / sigma
        lengths = (1e6 * np.sqrt(np.mean(error**2)), 1e6 * sigma.mean())
        numbers = (pull.mean(), pull.std(ddof=1), np.mean(np.abs(pull) < 1))
        rows.append((name, str(pull.size), *(f"{x:.2f}" for x in lengths), *(f"{x:.3f}" for x in numbers)))
    return rows


def summary(lines: Sequence[Line]) -> str:
    """Return the text of the page."""
    errors, sigmas = (
        1e6 * np.array([[line[key][name] for name in NAMES] for line in lines])
        for key in ("errors", "sigmas")
    )
    pulls, rms = errors / sigmas, np.sqrt(np.mean(errors**2, axis=1))
    rows = table(lines)
    mean, std, coverage = (np.array([float(row[k]) for row in rows]) for k in (4, 5, 6))
    return (
        f"In {len(lines)} simulated calibrations the rms error is {np.sqrt(np.mean(errors**2)):.1f} um/rad, "
        f"{rms.min():.1f} to {rms.max():.1f} in a single one, and the mean sigma {sigmas.mean():.1f} um/rad. "
        f"The rms pull is {np.sqrt(np.mean(pulls**2)):.3f}, the largest {np.abs(pulls).max():.1f}; "
        f"{100 * np.mean(np.abs(pulls) < 1):.1f} % of all estimates lie within 1 sigma. Of single "
        f"coefficients mean pulls are {mean.min():+.2f} to {mean.max():+.2f}, standard deviations "
        f"{std.min():.2f} to {std.max():.2f}, and {100 * coverage.min():.0f} to {100 * coverage.max():.0f} % "
        "lie within 1 sigma ([all numbers](ttl-pulls.csv))."
    )


def write(lines: Sequence[Line]) -> None:
    """Write the table as CSV, and its summary into the page."""
    with DOCS.with_name("ttl-pulls.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEAD, *table(lines)])
    page = DOCS.read_text(encoding="utf-8")
    DOCS.write_text(
        f"{page.split(BEGIN)[0]}{BEGIN}\n{fill(summary(lines), 124)}\n{END}{page.split(END)[1]}",
        encoding="utf-8",
    )


def main() -> None:
    """Simulate, or write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=100, help="number of calibrations")
    parser.add_argument(
        "--log", type=Path, default=Path("tilt_to_length.jsonl"), help="continued where it ends"
    )
    parser.add_argument("--docs", action="store_true", help="write the table of the log, simulate nothing")
    arguments = parser.parse_args()
    if arguments.docs:
        write([json.loads(line) for line in arguments.log.read_text(encoding="utf-8").splitlines()[1:]])
        return
    print(summary(run(arguments.n, arguments.log)))


if __name__ == "__main__":
    main()
