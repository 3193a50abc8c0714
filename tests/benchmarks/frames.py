"""How often chance alone contradicts the frame: the coefficient of g_Omega, drawn again and again.

    python -m tests.benchmarks.frames -n 260

draws half a day of noise of a spacecraft that turns, as short as an Euler fit takes, by the oracle of the
tests, which closes the loops frequency by frequency and has the centrifugal term in full; it turns as in
flight, or less. Every draw is fitted with the dynamics that it was made with. What is done is in the log; the
same command continues it. A draw depends on its number alone.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from fit.crosstalk.euler_fit import MIN_DURATION, fit_period
from tests.oracles import rotation_synthetic as synthetic

#: Noise of Delta g [m s^-2 Hz^-0.5], and how much of the rate and of the noise of the star tracker is left.
NOISES = {"late, quiet": 1.74e-15, "early, loud": 5.57e-15}
TURNS = {"as in flight": 1.0, "a third of it": 1 / 3}


def turning(plateau: float, share: float) -> synthetic.World:
    """Return a spacecraft that turns by so much of what it does in flight."""
    planes = {}
    for axis in ("phi", "eta"):
        plane = getattr(synthetic.World(), axis)
        of = ("star_tracker", "rate", "drift")
        planes[axis] = replace(plane, **{name: share * getattr(plane, name) for name in of})
    return synthetic.World(plateau=plateau, **planes)


def draw(world: synthetic.World, number: int) -> dict[str, Any]:
    """Draw a run and fit it: the coefficient, its sigma, and what is said."""
    run, _ = synthetic.run(world, duration=MIN_DURATION, seed=number)
    fit = fit_period([run], synthetic.calibration(world).joint)
    assert fit.centrifugal is not None
    said = [w.code for w in fit.warnings if w.code != "degenerate_with_actuation_crosstalk"]
    return {"number": number, "value": fit.centrifugal.value, "sigma": fit.centrifugal.sigma, "said": said}


def row(name: str, found: list[dict[str, Any]]) -> str:
    """Return what is found of one kind of run, as a row of a table."""
    value, sigma = (np.array([f[key] for f in found]) for key in ("value", "sigma"))
    z = (value - 1) / sigma
    said = Counter(code for f in found for code in f["said"])
    told = ", ".join(f"{code} {n}" for code, n in said.items()) or "nothing"
    return (
        f"| {name} | {len(found)} | {value.mean():.2f} | {np.median(sigma):.2f} | {z.std():.2f} | "
        f"{z.min():.1f} to {z.max():.1f} | {value.min():.2f} | {told} |"
    )


def main() -> None:
    """Draw what is missing, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=260, help="draws of every kind")
    parser.add_argument("--log", type=Path, default=Path("frames.jsonl"), help="what is done")
    chosen = parser.parse_args()
    lines = chosen.log.read_text(encoding="utf-8").splitlines() if chosen.log.exists() else []
    done = {(line["kind"], line["number"]): line for line in map(json.loads, lines)}
    kinds = {
        f"{noise}; turns {turn}": turning(plateau, share)
        for noise, plateau in NOISES.items()
        for turn, share in TURNS.items()
    }
    for number in range(chosen.n):
        for kind, world in kinds.items():
            if (kind, number) not in done:
                done[kind, number] = {"kind": kind, **draw(world, number)}
                with chosen.log.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(done[kind, number]) + "\n")
    print("| noise | draws | mean | median of sigma | scatter of z | z | least | said |")
    print("|---" * 8 + "|")
    for kind in kinds:
        print(row(kind, [done[kind, number] for number in range(chosen.n)]))


if __name__ == "__main__":
    main()
