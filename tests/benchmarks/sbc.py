"""Simulation-based calibration: are the posteriors right, for truths drawn from a prior?

    python -m tests.benchmarks.sbc -n 1000

draws campaigns of five experiments with their noise runs, fits each, and ranks every truth in its
posterior. Of right posteriors the ranks are uniform. Truths, the scatter of gains between experiments,
glitches and noise that changes between a run and its noise run come from the priors below. The telemetry
comes from the closed loop of tests/oracles, which shares no code with the fit. The same campaigns judge
models that are wrong on purpose.

It writes docs/sbc.csv, docs/sbc.svg and the tables in docs/validation.md. What is done is in the log; the
same command continues it. A campaign depends on its number and the seed, not on when or beside what it is
done.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # a process for each processor does better

import numpy as np
from scipy.stats import norm

from fit.errors import CalibrationError
from fit.fitting import random_effects, width_posterior
from fit.pipeline import calibrate
from fit.results import Fit
from fit.settings import settings
from fit.telemetry.reader import Telemetry
from tests.benchmarks import ranks_figure
from tests.benchmarks.ranks import chance
from tests.oracles import glitches, thirteen

SEED = 20160301
EXPERIMENTS = ("A1", "C2", "D2", "E3", "G3")  # the fewest that tell all parameters apart
DURATION = 21600.0  # s, of all runs
GAIN, OTHERS = 0.05, 0.3  # relative, even: gains; delays and stiffness
DELTA_IFO = 4e-5  # even, up to
WIDTHS = {
    "lambda": 0.005,
    "C": 0.02,
}  # relative, half-Cauchy: by which gains and delays scatter, on both masses
WIDEST = 4.0  # widths are cut off there, in units of those
LEVEL = 0.05  # of the logarithm of plateau and tail of a run from those of its noise run
A_DAY = 1.0  # glitches
RATIO, FALL = (
    (2.0, 200.0),
    (2.0, 7200.0),
)  # their ratio to noise, and the time of their fall [s]: even in the logarithm
FAR = 4.5  # sigma, that are counted
RIGID = 10  # every how manieth campaign is also fitted without scatter

DOCS = Path(__file__).parents[2] / "docs"
BEGIN, END = "<!-- from sbc.py -->", "<!-- end of sbc.py -->"
HEAD = ("model", "parameter", "n", "mean", "std", "within_sigma", "within_68", "chance")
Line = dict[str, Any]


# What a campaign is drawn from --------------------------------------------------------------------------


@dataclass(frozen=True)
class Drawn:
    """A campaign: its runs, the truth, and the relative widths by which gains and delays scatter."""

    runs: list[Telemetry]
    truth: Mapping[str, float]
    widths: Mapping[str, float]


def drawn(number: int) -> Drawn:
    """Draw a campaign."""
    rng = np.random.default_rng([SEED, number])
    truth = {}
    for name, value in thirteen.TRUTH.items():
        spread = GAIN if name.startswith("lambda") else OTHERS
        even = rng.uniform(-1, 1)
        truth[name] = DELTA_IFO * even if name.startswith("delta_ifo") else value * (1 + spread * even)
    widths = {
        name: scale * float(np.tan(np.arctan(WIDEST) * rng.uniform())) for name, scale in WIDTHS.items()
    }
    runs = []
    for experiment in EXPERIMENTS:
        own = _departed(rng, truth, widths)
        for kind in ("noise", "sysid"):
            how = replace(thirteen.made(experiment, kind, number, own), duration=DURATION)
            plateau, tail = np.exp(LEVEL * rng.standard_normal(2))
            struck = _struck(rng, how.duration)
            if kind == "sysid":
                noise = replace(how.noise, plateau=plateau * how.noise.plateau, tail=tail * how.noise.tail)
                how = replace(how, noise=noise)
            runs.append(glitches.struck(how, struck))
    return Drawn(runs, truth, widths)


def _departed(
    rng: np.random.Generator, truth: Mapping[str, float], widths: Mapping[str, float]
) -> dict[str, float]:
    """Return the truth of one experiment; a gain that departs takes C = lambda tau along."""
    own = dict(truth)
    for j in (1, 2):
        gain, delay = f"lambda_{j}", f"C_{j}"
        by = widths["lambda"] * rng.standard_normal()
        own[gain] += thirteen.TRUTH[gain] * by
        own[delay] += thirteen.TRUTH[delay] * (by + widths["C"] * rng.standard_normal())
    return own


def _struck(rng: np.random.Generator, duration: float) -> list[glitches.Glitch]:
    """Draw the glitches of a run."""
    struck: list[glitches.Glitch] = []
    often = rng.poisson(A_DAY * duration / 86400)
    while len(struck) < often:
        struck += glitches.draw(rng, 1, duration, RATIO, FALL)
    return struck


# What is kept of a fit ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Posterior:
    """What is known of parameters: normal distributions, shape (n, P), and how much of each."""

    weights: np.ndarray
    means: np.ndarray
    sigmas: np.ndarray

    def ranks(self, i: int, at: float) -> float:
        """Return the share of the distribution of a parameter below a value."""
        return float(self.weights @ norm.cdf((at - self.means[:, i]) / self.sigmas[:, i]))


#: What the fit of this process integrated last. It publishes mean and covariance, the ranks want all of it.
_heard: list[Posterior] = []
_integrate = width_posterior.marginalise


def _overheard(
    normal: width_posterior.NormalEquations, widths: Sequence[random_effects.ScaleParameter]
) -> width_posterior.WidthPosterior:
    points = np.array(list(product(*width_posterior._axes(normal, widths))))
    each = [width_posterior.conditional(normal, widths, point) for point in points]
    density = np.array([one[0] for one in each])
    weights = np.exp(density - density.max())
    sigmas = np.array([np.sqrt(np.diag(one[2])) for one in each])
    _heard.append(Posterior(weights / weights.sum(), np.array([one[1] for one in each]), sigmas))
    return _integrate(normal, widths)


def trial(number: int) -> Line:
    """Draw a campaign and fit it; the ranks of the truths, or what went wrong."""
    width_posterior.marginalise = _overheard
    campaign = drawn(number)
    line: Line = {"number": number, "widths": campaign.widths, "fit": _kept(campaign, {})}
    if number % RIGID == 0:
        line["rigid"] = _kept(campaign, {"scatter": []})
    return line


def _kept(campaign: Drawn, chosen: Mapping[str, object]) -> Line:
    _heard.clear()
    try:
        found = calibrate(campaign.runs, settings(dict(chosen), "sbc"))
    except CalibrationError as error:
        return {"failed": str(error)}
    joint = found.joint
    if joint is None:
        return {"failed": "no joint fit"}
    return {
        "pulls": {name: (e.value - campaign.truth[name]) / e.sigma for name, e in joint.parameters.items()},
        "ranks": _ranks(joint, campaign.truth, modelled=bool(found.provenance.scatter)),
        "sigmas": {name: e.sigma for name, e in joint.parameters.items()},
        "warnings": sorted({w.code for w in joint.warnings}),
        "unsound": [w.message for w in joint.unsound],
        "scatter": {name: told["value"] for name, told in (found.provenance.scatter or {}).items()},
        "runs": found.provenance.joint_runs,
    }


def _ranks(joint: Fit, truth: Mapping[str, float], *, modelled: bool) -> dict[str, float]:
    """Return the ranks of the truths, in the mixture where gains scatter."""
    ranks = {name: float(norm.cdf((truth[name] - e.value) / e.sigma)) for name, e in joint.parameters.items()}
    for i, (name, e) in enumerate(joint.parameters.items() if modelled else ()):
        whole = _heard[-1]
        if abs(whole.weights @ whole.means[:, i] - e.value) > 1e-3 * e.sigma:
            raise RuntimeError(f"{name}: another posterior than the one that was overheard")
        ranks[name] = whole.ranks(i, truth[name])
    return ranks


# The log --------------------------------------------------------------------------------------------------


def header() -> Line:
    """Return what a log is of: another fit, oracle or prior makes another."""
    root = Path(__file__).parents[2]
    files = sorted(
        [*(root / "fit").rglob("*.py"), *(root / "tests" / "oracles").glob("*.py"), Path(__file__)]
    )
    total = sha256(b"".join(file.read_bytes() for file in files))
    return {"seed": SEED, "sources": total.hexdigest()}


def known(log: Path, head: Line) -> list[Line]:
    """Return what a log holds, and leave it ready to be added to.

    Raises
    ------
    SystemExit
        If it is of something else.
    """
    lines: list[Line] = []
    if log.exists():
        text = log.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1].splitlines()  # a killed process leaves half a line
        first, *rest = [json.loads(line) for line in whole] or [head]
        if first != head:
            sys.exit(f"{log}: of another seed, prior or fit, expected another file (--log)")
        lines = rest
    log.write_text("".join(json.dumps(line) + "\n" for line in (head, *lines)), encoding="utf-8")
    return lines


def run(n: int, log: Path, jobs: int) -> list[Line]:
    """Do what is missing of the first `n` campaigns; all of them, in their order."""
    lines = {int(line["number"]): line for line in known(log, header())}
    missing = [number for number in range(n) if number not in lines]
    started = time.perf_counter()
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool, log.open("a", encoding="utf-8") as file:
        for done, future in enumerate(as_completed([pool.submit(trial, m) for m in missing]), 1):
            line = future.result()
            lines[int(line["number"])] = line
            file.write(json.dumps(line) + "\n")
            file.flush()
            if done % 20 == 0:
                spent = time.perf_counter() - started
                print(f"{done} of {len(missing)}, {spent / done:.1f} s each", file=sys.stderr, flush=True)
    return [lines[number] for number in range(n)]


# What comes out -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Model:
    """Ranks and pulls of every parameter under one model, shape (n,) each."""

    name: str
    ranks: Mapping[str, np.ndarray]
    pulls: Mapping[str, np.ndarray]


def models(lines: Sequence[Line]) -> list[Model]:
    """Return the fit and the wrong models; of the fit, those campaigns whose sigmas it says to hold."""
    fits = [line["fit"] for line in lines]
    sound = [fit for fit in fits if "ranks" in fit and not fit["unsound"]]
    rigid = [line["rigid"] for line in lines if "ranks" in line.get("rigid", {})]
    half = {f"C_{j}": thirteen.TRUTH[f"lambda_{j}"] * 0.05 for j in (1, 2)}

    def of(name: str, kept: Sequence[Line], change=None) -> Model:
        ranks, pulls = {}, {}
        for parameter in dict.fromkeys(p for one in kept for p in one["pulls"]):
            has = [one for one in kept if parameter in one["pulls"]]
            pulls[parameter] = np.array([one["pulls"][parameter] for one in has])
            ranks[parameter] = np.array([one["ranks"][parameter] for one in has])
            if change:
                sigmas = np.array([one["sigmas"][parameter] for one in has])
                pulls[parameter] = change(parameter, pulls[parameter], sigmas)
                ranks[parameter] = norm.cdf(-pulls[parameter])
        return Model(name, ranks, pulls)

    return [
        of("the fit", sound),
        of("its sigmas times 0.9", sound, lambda _, pulls, __: pulls / 0.9),
        of("delays off by half a sample", sound, lambda p, pulls, s: pulls + half.get(p, 0.0) / s),
        *([of("scatter not modelled", rigid)] if rigid else []),
    ]


def rows(found: Sequence[Model]) -> list[tuple[str, ...]]:
    """Return a line for each parameter under each model, as `HEAD` names the columns."""
    lines = []
    for model in found:
        for name, u in model.ranks.items():
            pulls, within = model.pulls[name], np.mean(np.abs(u - 0.5) < 0.34135)
            numbers = (np.mean(pulls), np.std(pulls, ddof=1), np.mean(np.abs(pulls) < 1), within)
            lines.append((model.name, name, str(u.size), *(f"{x:.3f}" for x in numbers), f"{chance(u):.4f}"))
    return lines


def section(lines: Sequence[Line], table: Sequence[tuple[str, ...]]) -> str:
    """Return the tables for the page."""
    fits = [line["fit"] for line in lines]
    failed = sum("failed" in fit for fit in fits)
    unsound = sum(bool(fit.get("unsound")) for fit in fits)
    fewer = sum(len(fit.get("runs") or EXPERIMENTS) < len(EXPERIMENTS) for fit in fits)
    scattered = sum(bool(fit.get("scatter")) for fit in fits)
    sound = [fit for fit in fits if "ranks" in fit and not fit["unsound"]]
    u = np.array([rank for fit in sound for rank in fit["ranks"].values()])
    far = int(np.count_nonzero(np.minimum(u, 1 - u) < norm.sf(FAR)))
    beyond = sum(abs(pull) > FAR for fit in sound for pull in fit["pulls"].values())
    numbers = [[float(cell) for cell in row[3:7]] for row in table if row[0] == "the fit"]
    mean, std, one_sigma, held = zip(*numbers, strict=True)
    text = [
        f"Of {len(fits)} campaigns, {failed} have no joint fit, and {unsound} have one whose uncertainties "
        f"are not valid; the others are ranked. In {fewer} a run was left out, in {scattered} the scatter of "
        f"gains was modelled. Of {u.size} true values, {beyond} are more than {FAR:g} sigma from the "
        f"estimate; by their rank, which includes the tails of the posterior, {far}. "
        f"Mean pulls of the {len(numbers)} parameters are {min(mean):+.2f} to "
        f"{max(mean):+.2f}, standard deviations {min(std):.2f} to {max(std):.2f}; "
        f"{100 * min(one_sigma):.1f} to {100 * max(one_sigma):.1f} % lie within 1 sigma, and 68 % intervals "
        f"contain {100 * min(held):.1f} to {100 * max(held):.1f} % ([all numbers](sbc.csv)).",
    ]
    text += [
        "",
        "| model | campaigns | curves outside the band | outside the joint band | 68 % intervals contain |",
    ]
    text.append("|---|---|---|---|---|")
    for model in dict.fromkeys(row[0] for row in table):
        own = [row for row in table if row[0] == model]
        chances = np.array([float(row[7]) for row in own])
        outside, all_of_them = (chances < 0.05).sum(), (chances < 1 - 0.95 ** (1 / len(own))).sum()
        shares = [100 * float(row[6]) for row in own]
        text.append(
            f"| {model} | {own[0][2]} | {outside} of {len(own)} | {all_of_them} | "
            f"{min(shares):.1f} to {max(shares):.1f} %, mean {np.mean(shares):.1f} % |"
        )
    return "\n".join(text) + "\n"


def write(lines: Sequence[Line], docs: Path) -> str:
    """Write the numbers and put the tables into the page; return these."""
    found = models(lines)
    table = rows(found)
    ranks_figure.save({model.name: model.ranks for model in found}, docs / "sbc.svg")
    with (docs / "sbc.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEAD, *table])
    page = docs / "validation.md"
    text, told = page.read_text(encoding="utf-8"), section(lines, table)
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    page.write_text(f"{before}{BEGIN}\n{told}\n{END}{after}", encoding="utf-8")
    return told


def main() -> None:
    """Do what is missing, and write what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=1000, help="campaigns")
    parser.add_argument("--log", type=Path, default=Path("sbc.jsonl"), help="what is done")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    chosen = parser.parse_args()
    print(write(run(chosen.n, chosen.log, chosen.jobs), DOCS))


if __name__ == "__main__":
    main()
