"""Time the fit of a campaign's telemetry: reading, filtering, joint fit, everything.

    python tests/benchmarks/mission.py mission-x/telemetry

The folder is that of an earlier ``lpfcosim run``. Medians of three; the last line is JSON.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

from fit.fitting.joint_fit import fit_joint
from fit.pipeline import calibrate
from fit.quality.glitches import remove_glitches
from fit.results.folders import telemetry_files
from fit.settings import settings
from fit.telemetry import reader as telemetry
from fit.whitening import pair


def seconds(work: Callable[[], object]) -> float:
    """Return the median of three timings."""
    took = []
    for _ in range(3):
        started = time.perf_counter()
        work()
        took.append(time.perf_counter() - started)
    return statistics.median(took)


def main(folder: Path) -> None:
    """Print each time, and all as JSON."""
    files = telemetry_files([folder])
    runs = telemetry.read_all(files)
    chosen = settings()
    found = {
        "runs": len(runs),
        "hours": sum(t.duration for t in runs) / 3600,
        "reading_s": seconds(lambda: telemetry.read_all(files)),
        "filtering_s": seconds(lambda: pair(runs)),
        # pairs anew each time: a run keeps its spectra
        "glitches_s": seconds(lambda: [remove_glitches(e) for e in pair(runs)]),
        "joint_fit_s": seconds(lambda: fit_joint(pair(runs), chosen)),
        "calibration_s": seconds(lambda: calibrate(runs)),
    }
    for name in ("glitches_s", "joint_fit_s"):
        found[name] -= found["filtering_s"]
    for name, value in found.items():
        print(f"{name:14s} {value:.3g}")
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
