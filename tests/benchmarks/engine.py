"""Time and memory of the co-simulation loop, along x and of the whole spacecraft.

    python tests/benchmarks/engine.py [--hours 4] [--repeat 5] [--short]

The processor time of a step is divided into its parts: a loop over functions that copy values and compute
nothing gives the price of the FMI calls, a loop that records nothing that of recording, the remainder is
arithmetic; the remainder of a whole run is the file, the low-pass, start and end.
Peak memory is that of a run into a file, each length in a process of its own. The last line is JSON.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from lpfcosim.campaign import loading
from lpfcosim.cosim import co_simulation, read_interfaces
from lpfcosim.execution import runner
from lpfcosim.modelica import build
from lpfcosim.modelica.compiler import FLAGS, compiler
from lpfcosim.models import model_of, stimuli
from lpfcosim.spacecraft import Run

HERE = Path(__file__).parent
CAMPAIGNS = HERE.parents[1] / "campaigns"


def calibration_run(campaign: str, hours: float) -> Run:
    """Return the first calibration run of a campaign, with the length asked for."""
    run = next(r for r in loading.load(CAMPAIGNS / f"{campaign}.toml").runs if r.kind == "sysid")
    return replace(run, n_samples=round(hours * 36_000))


def blocks(run: Run) -> list[np.ndarray]:
    """Draw injections and noise of a run, block by block, each of shape (steps, stimuli)."""
    noise, drawn = stimuli.noise_source(run), []
    for start in range(0, run.n_samples, co_simulation.BLOCK):
        stop = min(start + co_simulation.BLOCK, run.n_samples)
        signals = {**stimuli.injections(run, start, stop), **noise.take(stop - start)}
        drawn.append(np.column_stack([signals[name] for name in model_of(run).stimuli(run)]))
    return drawn


@contextlib.contextmanager
def co_simulated(run: Run):
    """Start the FMUs of a run; a loop that is ready to advance."""
    with contextlib.ExitStack() as stack:
        interfaces = read_interfaces(run, build.build(model_of(run).models))
        components = [interface.component for interface in interfaces]
        yield co_simulation.RunCoSimulation(run, components, co_simulation.start(stack, run, interfaces))


def processor_time(work: Callable[[], object]) -> float:
    """Return the processor time that a call takes [s]."""
    started = time.process_time()
    work()
    return time.process_time() - started


def stepped(run: Run, *, record: bool = True, functions: ctypes.CDLL | None = None) -> float:
    """Return the processor time of the compiled loop [s]; `functions` replace those of the FMUs."""
    with co_simulated(run) as loop:
        for row in loop._compiled._table if functions else ():
            for name in ("set", "get", "step"):
                setattr(row, name, ctypes.cast(getattr(functions, name), ctypes.c_void_p))
        loop._record = loop._record if record else loop._record[:0]
        seconds, step = 0.0, 0
        for feeds in blocks(run):
            if step == 0:
                loop.initialize(feeds[0])
            out = np.zeros((len(feeds), len(loop._record)))
            seconds += processor_time(lambda f=feeds, o=out, s=step: loop.advance(f, o, s))
            step += len(feeds)
        return seconds


def empty_functions(folder: Path) -> ctypes.CDLL:
    """Compile the functions that copy values and compute nothing."""
    library = folder / "nothing.so"
    flags = [flag.replace("=hidden", "=default") for flag in FLAGS]
    subprocess.run([*compiler().command, *flags, "-o", str(library), str(HERE / "nothing.c")], check=True)
    return ctypes.CDLL(str(library))


def parts(campaign: str, hours: float, repeat: int) -> dict[str, float]:
    """Return the processor time of the parts of a step [us], medians."""
    run = calibration_run(campaign, hours)
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        functions = empty_functions(Path(folder))
        for _ in range(repeat):
            noise, step = processor_time(lambda: blocks(run)), stepped(run)
            quiet, calls = stepped(run, record=False), stepped(run, record=False, functions=functions)
            fmus = build.build(model_of(run).models)
            whole = processor_time(lambda f=fmus: runner.write_telemetry(run, f, Path(folder) / "run.h5", {}))
            seconds = {"step": step, "arithmetic": quiet - calls, "calls and exchange": calls}
            seconds |= {"recording": step - quiet, "noise": noise, "file": whole - step - noise}
            for name, value in seconds.items():
                times.setdefault(name, []).append(1e6 * value / run.n_samples)
    return {name: round(statistics.median(values), 3) for name, values in times.items()}


def peak_memory(hours: float) -> float:
    """Return the peak memory of a run of the quick start into a file [MB], in a process of its own."""
    command = [sys.executable, __file__, "--whole", str(hours)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def write_run(hours: float) -> float:
    """Simulate into a file; return the peak memory of this process [MB]."""
    run = calibration_run("quickstart", hours)
    with tempfile.TemporaryDirectory() as folder:
        runner.write_telemetry(run, build.build(model_of(run).models), Path(folder) / "run.h5", {})
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=4.0)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--short", action="store_true", help="only see that it works")
    parser.add_argument("--whole", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.whole:
        print(write_run(options.whole))
        return
    hours, repeat, lengths = (
        (0.5, 2, (0.5, 1.0)) if options.short else (options.hours, options.repeat, (6.0, 65.0))
    )
    figures = {
        "parts": {name: parts(name, hours, repeat) for name in ("mission-x", "inertial")},
        "peak_mb": {f"{length:g} h": round(peak_memory(length), 1) for length in lengths},
    }
    for name, microseconds in figures["parts"].items():
        print(f"{name}: {', '.join(f'{part} {value:.3f}' for part, value in microseconds.items())} us")
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
