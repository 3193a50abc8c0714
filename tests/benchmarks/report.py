"""Time the report of a folder, stage by stage, and weigh it.

    python tests/benchmarks/report.py mission-x
    python tests/benchmarks/report.py mission-x --before ../another-checkout

The folder is that of an earlier ``lpfcosim run``; nothing in it is touched. Each measurement is a process of
its own; with another checkout the two take turns, and the ratio is the median of the pairs'. Prints JSON.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# seconds on the clock and on the processors, in a fresh interpreter that has read in nothing of ours
CODE = """
import json, resource, sys, tempfile, time
from pathlib import Path
told, last = {}, [time.perf_counter(), time.process_time()]
def stage(name):
    now = [time.perf_counter(), time.process_time()]
    told[name + "_s"], told[name + "_cpu_s"] = (a - b for a, b in zip(now, last))
    last[:] = now
from fit.crosstalk import refit
from fit.report import page
stage("import")
results, telemetries = refit.load(Path(sys.argv[1]))
stage("load")
with tempfile.TemporaryDirectory() as folder:
    path = page.write_report(Path(folder), results, telemetries)
    stage("report")
    told["megabytes"] = path.stat().st_size / 1e6
told["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
if hasattr(page, "figure_specs"):
    for drawing in page.figure_specs(results, telemetries):
        drawing.draw()
        stage(drawing.name)
print(json.dumps(told))
"""


def measured(checkout: Path, folder: Path) -> dict[str, float]:
    """Return the seconds of every stage; of the figures, drawn once more one by one, their sum by kind."""
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-P", "-c", CODE, str(folder.resolve())]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    found: dict[str, float] = {}
    for name, value in json.loads(done.stdout).items():
        kind = name.rpartition("-")[2] if "-" in name else name
        key = f"figures: {kind}" if kind != name else kind
        found[key] = found.get(key, 0.0) + value
    return found


def middle(rounds: list[dict[str, float]]) -> dict[str, float]:
    """Return the median of every number."""
    return {name: round(statistics.median(r[name] for r in rounds), 3) for name in rounds[0]}


def main() -> None:
    """Print the medians, and with another checkout the ratios to it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--before", type=Path, help="another checkout, to compare with")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    now, before = [], []
    for _ in range(given.rounds):
        now.append(measured(ROOT, given.folder))
        if given.before:
            before.append(measured(given.before, given.folder))
    found: dict[str, object] = {"now": middle(now)}
    if before:
        found["before"] = middle(before)
        found["ratio"] = {
            name: round(statistics.median(a[name] / b[name] for a, b in zip(before, now, strict=True)), 2)
            for name in ("import_s", "load_s", "report_s", "report_cpu_s", "megabytes", "peak_mb")
        }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
