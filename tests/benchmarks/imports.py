"""How long it takes until a notebook can start: ``python -m tests.benchmarks.imports``."""

import subprocess
import sys
import time

STATEMENTS = ("import fit", "import lpfcosim", "from fit import calibrate", "from lpfcosim import simulate")
REPEATS = 5


def seconds(statement: str) -> float:
    """Return the best wall time of a fresh interpreter [s], less that of an empty one."""
    best = []
    for code in (statement, ""):
        took = []
        for _ in range(REPEATS):
            started = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True)
            took.append(time.perf_counter() - started)
        best.append(min(took))
    return best[0] - best[1]


if __name__ == "__main__":
    for statement in STATEMENTS:
        print(f"{statement:32s} {seconds(statement):.2f} s")
