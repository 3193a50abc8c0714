"""How often chance alone contradicts the frame: the coefficient of g_Omega, drawn again and again.

    python -m tests.benchmarks.frames -n 400

draws half a day of noise of the whole spacecraft, as short as an Euler fit takes, from the spectra of its
loop, several of them in one go; it turns as campaigns/inertial.toml has it, or less. Every draw is fitted
with the true dynamics. What is done is in the log; the same command continues it. A draw depends on its
number alone.
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

from fit.estimate.inertial import SHORTEST, fit_period
from lpfcosim.campaign import loading
from lpfcosim.spacecraft import Run
from tests.benchmarks.alarms import drawn
from tests.benchmarks.inertial import CAMPAIGN, true_dynamics

#: By how much less the spacecraft turns, steadily and with the noise of its star tracker.
TURNS = {"as in flight": 1.0, "a third": 1 / 3, "a tenth": 0.1}
AT_ONCE = 10  # half days that are drawn in one go: a run of its own needs four times its samples
FIRST = {"late, quiet": "P3a", "early, loud": "P1"}  # the noise of which run


def half_day(name: str, share: float) -> Run:
    """Return half a day of a run that turns by so much of what the campaign says."""
    run = next(r for r in loading.load(CAMPAIGN).runs if r.experiment == name)
    tracker = {f"star_tracker_{k}": share * getattr(run.noise, f"star_tracker_{k}") for k in ("eta", "phi")}
    rates = tuple(share * rate for rate in run.spacecraft.Omega_DC)
    sc = replace(run.spacecraft, Omega_DC=rates)
    n = AT_ONCE * round(SHORTEST * run.fs)
    return replace(run, n_samples=n, noise=replace(run.noise, **tracker), spacecraft=sc)


def draws(run: Run, batch: int) -> Iterator[dict[str, Any]]:
    """Draw a run and fit every half day of it: the coefficient, its sigma, and what is said."""
    telemetry = drawn(run, batch)
    size = round(SHORTEST * telemetry.fs)
    for begin in range(0, AT_ONCE * size, size):
        channels = {name: x[begin : begin + size] for name, x in telemetry.channels.items()}
        part = replace(telemetry, time=telemetry.time[:size], channels=channels)
        fit = fit_period([part], true_dynamics(run))
        assert fit.centrifugal is not None
        said = [w.code for w in fit.warnings if w.code != "degenerate_with_actuation_crosstalk"]
        yield {"batch": batch, "value": fit.centrifugal.value, "sigma": fit.centrifugal.sigma, "said": said}


def row(name: str, found: list[dict[str, Any]]) -> str:
    """Return what is found of one kind of run, as a row of a table."""
    value, sigma = (np.array([f[key] for f in found]) for key in ("value", "sigma"))
    z = (value - 1) / sigma
    said = Counter(code for f in found for code in f["said"])
    told = ", ".join(f"{code} {n}" for code, n in said.items()) or "nothing"
    return (
        f"| {name} | {len(found)} | {value.mean():.3f} | {np.median(sigma):.3f} | {z.std():.2f} | "
        f"{z.min():.1f} | {z.max():.1f} | {value.min():.2f} | {told} |"
    )


def main() -> None:
    """Draw what is missing, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=200, help="draws of every kind")
    parser.add_argument("--log", type=Path, default=Path("frames.jsonl"), help="what is done")
    chosen = parser.parse_args()
    done: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for line in map(json.loads, chosen.log.read_text().splitlines() if chosen.log.exists() else []):
        done.setdefault((line["kind"], line["batch"]), []).append(line)
    batches, table = range(-(-chosen.n // AT_ONCE)), []
    for noise, name in FIRST.items():
        for turn, share in TURNS.items():
            run, kind = half_day(name, share), f"{noise}; turns {turn}"
            for batch in (b for b in batches if (kind, b) not in done):
                done[kind, batch] = list(draws(run, batch))
                with chosen.log.open("a", encoding="utf-8") as file:
                    file.writelines(json.dumps({"kind": kind, **line}) + "\n" for line in done[kind, batch])
            table.append(row(kind, [line for batch in batches for line in done[kind, batch]]))
    print("| kind | draws | mean | sigma | scatter of z | least z | largest z | least | said |")
    print("|---" * 9 + "|")
    print("\n".join(table))


if __name__ == "__main__":
    main()
