"""False alarms: what is said of campaigns with which nothing is wrong.

    python -m tests.benchmarks.alarms campaigns/mission-x.toml -n 300
    python -m tests.benchmarks.alarms campaigns/mission.toml -n 3 --stepped

simulates a campaign again and again, each time with new noise and every tenth time with new truths, and
fits it. Every warning that casts doubt on a fit, and every other one of `SAID`, is a false alarm. The noise
is drawn from the spectra of the closed loop; with `--stepped` the equations of the models, without FMUs, step
every run. What is done is in the log; the same command continues it. A campaign depends on its number alone.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from fit.errors import CalibrationError
from fit.findings import Finding, Severity
from fit.pipeline import calibrate
from fit.results import Results
from fit.settings import settings
from fit.telemetry.reader import Telemetry
from lpfcosim.campaign import Campaign, loading
from lpfcosim.campaign import montecarlo as campaigns
from lpfcosim.linear import ClosedLoop, response, spectral_simulation
from lpfcosim.models import model_of, stimuli
from lpfcosim.planned_experiments import telemetry_of
from lpfcosim.signals import decimation
from lpfcosim.spacecraft import Run

#: Notes that say of clean telemetry what is not so; the others state how it is fitted, or how well.
SAID = {"glitches", "marginalised_noise", "random_effects", "readout_excess_noise", "saturated"}
REDRAWN = 10  # every how manieth campaign has truths of its own


def drawn(run: Run, number: int) -> Telemetry:
    """Draw a run from the spectra of its loop, as `lpfcosim montecarlo` does, guidance included."""
    of_run = replace(run, seed=0)  # which counts for nothing else here
    if _simulations.get(run.name, (None, None))[0] != of_run:
        names = response.recorded_system(run).outputs
        _simulations[run.name] = of_run, spectral_simulation.Simulation(of_run, names)
    channels = _simulations[run.name][1].record(np.random.default_rng([number, *run.name.encode()]))
    stride = round(run.fs / response.RATE)
    given = stimuli.injections(run)
    shown = {name: given[name][::stride] for name in model_of(run).record if name in given}
    return telemetry_of(run, {**channels, **shown})


#: What the last campaign left, by run: made anew only if more than the seed is another.
_simulations: dict[str, tuple[Run, spectral_simulation.Simulation]] = {}


def stepped(run: Run, _: int) -> Telemetry:
    """Step a run from the equations of the models; at 1 Hz."""
    archived, record = replace(run, sample_rate=response.RATE), model_of(run).record
    simulated = ClosedLoop(archived).simulate()
    blocks = list(decimation.decimate(archived, [{name: simulated[name] for name in record}]))
    channels = {name: np.concatenate([block[name] for block in blocks]) for name in record}
    return telemetry_of(archived, channels)


def alarms(results: Results) -> Iterator[tuple[str, str, str]]:
    """Yield where, by which code and in which words something is said of a campaign."""
    fits = {"joint": results.joint} if results.joint else {}
    for name in ("experiments", "cross_talk", "inertial"):
        fits |= {f"{name} {key}": fit for key, fit in getattr(results, name).items()}
    for where, fit in fits.items():
        for warning in fit.warnings:
            if alarming(warning):
                yield where, warning.code, warning.message


def alarming(warning: Finding) -> bool:
    """Return whether nothing that is well lets this be said."""
    return warning.kind.severity is not Severity.NOTE or warning.kind.unsound or warning.code in SAID


def trial(plan: Campaign, number: int, *, step: bool) -> dict[str, Any]:
    """Simulate and fit one campaign; what is said of it."""
    numbered = campaigns.numbered(plan, number, redraw=number % REDRAWN == REDRAWN - 1)
    runs = [(stepped if step else drawn)(run, number) for run in numbered.runs]
    try:
        results = calibrate(runs, settings(plan.fit, "alarms"))
    except CalibrationError as error:
        return {"number": number, "alarms": [["", "failed", str(error)]]}
    return {"number": number, "alarms": list(alarms(results))}


def main() -> None:
    """Do what is missing, and print what was said."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", type=Path)
    parser.add_argument("-n", type=int, default=100, help="campaigns")
    parser.add_argument("--log", type=Path, help="what is done")
    parser.add_argument("--stepped", action="store_true", help="from the equations of the models")
    chosen = parser.parse_args()
    plan = replace(loading.load(chosen.campaign), events=None)  # glitches and gaps are no false alarms
    log = chosen.log or Path(f"{plan.name}-alarms.jsonl")
    lines = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {line["number"] for line in lines}
    with log.open("a", encoding="utf-8") as file:
        for number in range(chosen.n):
            if number not in known:
                lines.append(trial(plan, number, step=chosen.stepped))
                file.write(json.dumps(lines[-1]) + "\n")
                file.flush()
    said = Counter(code for line in lines for code in {code for _, code, _ in line["alarms"]})
    print(
        f"{len(lines)} campaigns; " + (", ".join(f"{code} in {n}" for code, n in said.items()) or "no alarm")
    )


if __name__ == "__main__":
    main()
