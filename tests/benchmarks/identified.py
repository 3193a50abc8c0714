"""Redrawn campaigns, identified through the FMUs: are the sigmas true, and the estimates those of the fit?

    python -m tests.benchmarks.identified tests/benchmarks/pole.toml -n 200 --log pole.jsonl

draws a campaign again and again, without FMUs, with noise and truths of its own (gains within 5 %,
all else within 30 % of those of the campaign), and identifies what it seeks through the FMUs. It tells the
pulls, and how far the estimates are from those of the fit of the same telemetry. With ``--same-truths`` only
the noise is drawn anew. What is done is in the log; the same command continues it.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from lpfcosim.linear import ClosedLoop

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from fit.crosstalk import refit
from fit.errors import CalibrationError
from fit.forecasting import coverage
from fit.identification.identify import identify
from fit.parallel import serial
from fit.pipeline import calibrate
from fit.settings import settings
from fit.telemetry.reader import Telemetry
from lpfcosim.campaign import Campaign, loading, montecarlo
from lpfcosim.errors import RunError
from lpfcosim.execution import telemetry_file
from lpfcosim.execution.telemetry_file import truth
from lpfcosim.identification import ClosedLoopResponse
from lpfcosim.modelica import build
from lpfcosim.spacecraft import Run
from lpfcosim.workflows.identify import free_parameter
from tests.benchmarks.sbc import known

Line = dict[str, Any]


def cpu() -> float:
    """Return the processor time that was spent [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def drawn(run: Run) -> Telemetry:
    """Return a run as it is simulated without FMUs, at the rate of the loop."""
    said, channels = telemetry_file.attributes(run), ClosedLoop(run).simulate()
    known: Any = {name: said.pop(name) for name in [*said] if name in Telemetry.__dataclass_fields__}
    return Telemetry(
        **known, path=Path(run.name), time=run.time, channels=channels, units={}, attributes=said
    )


def trial(plan: Campaign, number: int) -> Line:
    """Draw a campaign and identify it; what is kept of it, or what went wrong."""
    began, line = cpu(), Line(number=number)
    runs = [drawn(run) for run in plan.runs]
    chosen = settings(dict(plan.fit), "fit")
    try:
        with serial(), ExitStack() as stack:
            results = calibrate(runs, chosen)
            between = cpu()
            experiments, how = refit.experiments(results, runs, Path("results.json"))
            flown = [run.telemetry for e in experiments for run in (e.sysid, e.noise) if run]
            loop = ClosedLoopResponse(stack, plan, flown, build.build())
            free = [free_parameter(target) for target in loop.targets]
            found = identify(experiments, free, loop, results, how, loop.fixed_values)
    except (CalibrationError, RunError) as error:
        return {**line, "failed": str(error)}
    given = {t.name: t.default_value for t in loop.targets if "." in t.name}
    joint = coverage.with_truth(found, runs, {run.name: given | truth(run) for run in plan.runs}).joint
    assert joint
    theirs = results.joint.parameters if results.joint else {}
    return {
        **line,
        "pulls": {name: e.pull for name, e in joint.parameters.items() if e.pull is not None},
        "from_fit": {
            n: (e.value - theirs[n].value) / theirs[n].sigma
            for n, e in joint.parameters.items()
            if n in theirs
        },
        "ratio": {n: e.sigma / theirs[n].sigma for n, e in joint.parameters.items() if n in theirs},
        "chi2": joint.chi2 / joint.dof,
        "warnings": [w.code for w in joint.warnings],
        "unsound": [w.code for w in joint.unsound],
        "cpu": [round(between - began, 2), round(cpu() - between, 2)],
    }


def run(plan: Campaign, n: int, log: Path, *, redraw: bool) -> list[Line]:
    """Do what is missing of the first `n` campaigns; all that are done, in their order."""
    lines = {int(line["number"]): line for line in known(log, {"digest": plan.digest, "redraw": redraw})}
    with log.open("a", encoding="utf-8") as file:
        for number in range(n):
            if number not in lines:
                lines[number] = trial(montecarlo.numbered(plan, number, redraw=redraw), number)
                file.write(json.dumps(lines[number]) + "\n")
                file.flush()
    return [lines[number] for number in sorted(lines)]


def table(lines: Sequence[Line]) -> list[str]:
    """Return pulls and distances from the fit as lines of Markdown."""
    done = [line for line in lines if "pulls" in line]
    sound = [line for line in done if not line["unsound"]]
    chi2 = np.mean([line["chi2"] for line in done])
    spent = np.mean([line["cpu"] for line in done], axis=0)
    text = [
        f"{len(lines)} campaigns, {len(lines) - len(done)} failed, {len(done) - len(sound)} not sound; chi2 "
        f"by degree of freedom {chi2:.4f}; {spent[0]:.1f} s of processor time to draw and fit, "
        f"{spent[1]:.1f} s to identify",
        "",
        "| | n | mean pull | standard deviation | within 1 sigma | from the fit: rms | largest | sigmas |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in {name: None for line in sound for name in line["pulls"]}:
        p, shift, ratio = (
            np.array([line[key][name] for line in sound if name in line[key]])
            for key in ("pulls", "from_fit", "ratio")
        )
        sd, within = p.std(ddof=1), np.mean(abs(p) < 1)
        told = f"| `{name}` | {p.size} | {p.mean():+.2f} ± {sd / np.sqrt(p.size):.2f} "
        told += f"| {sd:.2f} ± {1 / np.sqrt(2 * p.size):.2f} | {100 * within:.0f} % | "
        if shift.size:
            told += f"{np.sqrt(np.mean(shift**2)):.3f} | {abs(shift).max():.3f} "
            told += f"| {ratio.min():.4f}-{ratio.max():.4f} |"
        text.append(told if shift.size else told + "| | |")
    return text


def main() -> None:
    """Draw, identify, tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("-n", type=int, default=200, help="how many campaigns")
    parser.add_argument("--log", type=Path, required=True, help="what is done; continued")
    parser.add_argument("--same-truths", action="store_true", help="draw the noise alone")
    asked = parser.parse_args()
    lines = run(loading.load(asked.campaign), asked.n, asked.log, redraw=not asked.same_truths)
    print("\n".join(table(lines)))
    for line in lines:
        if "failed" in line:
            print(f"{line['number']}: {line['failed']}")
    print(Counter(code for line in lines for code in line.get("warnings", ())))


if __name__ == "__main__":
    main()
