"""How fast is the engine? Ours, the plain FMPy loop and a monolithic C loop, on the same tables.

    python tests/benchmarks/engine.py [--hours 6] [--repeat 5] [--short]

All three step the closed loop of the quick start's first experiment. They are timed in one process, one after
the other and again, so that a drift of the machine touches all alike; medians are compared. The monolithic
loop is compiled with -O2. The time per step counts the exchange between the FMUs, their arithmetic and
recording; drawing noise and writing the file count neither there nor in `ratio_to_monolithic`, but do in
`hours_per_second`. The line before the last says what is left of the ratio when both loops have their noise
drawn, and when both write their file, which is what a user sees. Peak memory is that of a
whole run into a file, each length in a process of its own.

Then it tells where a step goes, along x and of the whole spacecraft, in processor time: what computes nothing
but takes and gives all values tells the price of the calls; what records nothing tells that of recording; the
rest of the loop is arithmetic. The rest of a whole run into a file is file, low-pass, start and end. The last
line is JSON.
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
from lpfcosim.cosim import co_simulation
from lpfcosim.cosim.compatibility import read_interfaces
from lpfcosim.execution import Provenance, runner
from lpfcosim.modelica import build
from lpfcosim.modelica.compiler import FLAGS, compiler
from lpfcosim.models import model_of, stimuli
from lpfcosim.spacecraft.run import Run
from tests.oracles import reference_plant

HERE = Path(__file__).parent
MONOLITHIC = HERE.parent / "oracles" / "monolithic.c"
QUICKSTART = HERE.parents[1] / "campaigns" / "quickstart.toml"


def first_experiment(hours: float) -> Run:
    """The first calibration run of the quick start, at the length wanted."""
    run = next(r for r in loading.load(QUICKSTART).runs if r.kind == "sysid")
    return replace(run, n_samples=round(hours * 36_000))


class Monolith(ctypes.Structure):
    """The constants of monolithic.c."""

    _fields_ = (
        ("e", ctypes.c_double * 75),
        *((f"{name}_{j}", ctypes.c_double * 3) for j in (1, 2) for name in ("decay", "entry", "r")),
        *((name, ctypes.c_double) for name in ("m_sc", "m_tm", "lambda_1", "lambda_2")),
        *((name, ctypes.c_double) for name in ("delta_ifo", "f_start", "F_max_1", "F_max_2")),
        ("whole", ctypes.c_int64 * 3),
    )


def monolith(run: Run) -> Monolith:
    """Fill in the constants, the step matrix from the exact discretisation."""
    from scipy.linalg import expm

    r, h = run.m_tm / run.m_sc, run.h
    force = np.zeros((2, 14))  # columns: 5 states, g_1, g_2, F_noise, 3 held forces, …
    a = np.zeros((11, 11))  # states, g_1, g_2, F_noise, f_applied_1, f_applied_2, F_x_sc
    force = np.zeros((2, 11))
    force[0, [0, 5, 8]] = -run.omega2_1, 1, 1
    force[1, [2, 6, 9]] = -run.omega2_2, 1, 1
    a_sc = -r * force.sum(axis=0)
    a_sc[[4, 7]] += 1 / run.m_sc
    a[0, 1] = a[2, 3] = 1
    a[1], a[3] = force[0] - a_sc, force[1] - a_sc
    a[4, [4, 10]] = -1 / run.thruster_lag, 1 / run.thruster_lag
    delays = (run.tau_1 - h / 2, run.tau_2 - h / 2, run.thruster_delay)
    whole = expm(a * h)[:5]
    e = np.zeros((5, 15))
    e[:, :8] = whole[:, :8]
    e[:, :5] -= np.eye(5)
    for j, delay in enumerate(delays):
        after = expm(a * (h - delay % h))[:5, 8 + j]
        e[:, 8 + j], e[:, 11 + j] = whole[:, 8 + j] - after, after
    filled = Monolith(
        m_sc=run.m_sc, m_tm=run.m_tm, lambda_1=run.truth.lambda_1, lambda_2=run.truth.lambda_2,
        delta_ifo=run.delta_ifo, f_start=run.f_x_2_start,
        F_max_1=run.authority.F_max_1, F_max_2=run.authority.F_max_2,
    )  # fmt: skip
    filled.e[:] = e.ravel().tolist()
    filled.whole[:] = [int(d // h) for d in delays]
    for j, controller in ((1, run.drag_free), (2, run.suspension)):
        p, r = reference_plant.partial_fractions(controller)
        getattr(filled, f"decay_{j}")[:] = ((2 - p * h) / (2 + p * h)).tolist()
        getattr(filled, f"entry_{j}")[:] = (h / (2 + p * h)).tolist()
        getattr(filled, f"r_{j}")[:] = list(r)
    return filled


def timed_loop(
    run: Run, fmus: dict[str, Path], engine: co_simulation.Engine, feeds: np.ndarray, out: np.ndarray
) -> float:
    """Seconds that one loop takes through the feeds."""
    with contextlib.ExitStack() as stack:
        found = read_interfaces(run, fmus)
        loop = co_simulation.RunCoSimulation(
            run, [i.component for i in found], co_simulation.start(stack, run, found), engine
        )
        loop.initialize(feeds[0])
        started = time.perf_counter()
        loop.advance(feeds, out, 0)
        return time.perf_counter() - started


def draw(run: Run) -> float:
    """Seconds that the injections and the noise of a run take, block by block."""
    started = time.perf_counter()
    noise = stimuli.noise_source(run)
    for start in range(0, run.n_samples, co_simulation.BLOCK):
        stop = min(start + co_simulation.BLOCK, run.n_samples)
        drawn = {**stimuli.injections(run, start, stop), **noise.take(stop - start)}
        np.column_stack([drawn[name] for name in model_of(run).stimuli(run)])
    return time.perf_counter() - started


def loops(hours: float, repeat: int) -> dict[str, float]:
    """Microseconds per step of the three loops and of drawing noise; sees that the loops compute the same."""
    run, fmus = first_experiment(hours), build.build()
    drawn = {**stimuli.injections(run), **stimuli.noise(run)}
    feeds = np.column_stack([drawn[name] for name in model_of(run).stimuli(run)])
    plain = feeds[: min(len(feeds), 20_000)]  # as slow as it is, a part suffices
    out = {name: np.zeros((len(feeds), len(model_of(run).record))) for name in ("ours", "fmpy", "monolithic")}
    with tempfile.TemporaryDirectory() as folder:
        c = compiled(MONOLITHIC, Path(folder) / "monolithic.so")
        constants = monolith(run)
        times: dict[str, list[float]] = {name: [] for name in (*out, "noise")}
        for _ in range(repeat):
            times["ours"].append(timed_loop(run, fmus, "compiled", feeds, out["ours"]) / len(feeds))
            times["fmpy"].append(timed_loop(run, fmus, "fmpy", plain, out["fmpy"]) / len(plain))
            started = time.perf_counter()
            c.run(
                ctypes.byref(constants),
                ctypes.c_void_p(feeds.ctypes.data),
                ctypes.c_void_p(out["monolithic"].ctypes.data),
                ctypes.c_int64(len(feeds)),
            )
            times["monolithic"].append((time.perf_counter() - started) / len(feeds))
            times["noise"].append(draw(run) / len(feeds))
    assert np.array_equal(out["ours"][: len(plain)], out["fmpy"][: len(plain)]), "the two loops differ"
    scale = np.sqrt(np.mean(out["ours"] ** 2, axis=0))
    worst = float(np.max(np.abs(out["ours"] - out["monolithic"]) / np.where(scale > 0, scale, 1)))
    assert worst < 1e-9, f"the monolithic loop differs by {worst:.1e} of the rms"
    return {name: 1e6 * statistics.median(t) for name, t in times.items()}


def whole_run(hours: float) -> tuple[float, float]:
    """Simulate into a file: seconds, and peak memory of this process in MB."""
    plan = loading.load(QUICKSTART)
    run, fmus = first_experiment(hours), build.build()
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        runner.write_telemetry(run, fmus, Path(folder) / "run.h5", Provenance.of(plan, fmus).attributes())
        seconds = time.perf_counter() - started
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def parts(campaign: str, hours: float, repeat: int) -> dict[str, float]:
    """Microseconds of processor time of what a step of the first run of a campaign consists of."""
    plan = loading.load(QUICKSTART.with_name(f"{campaign}.toml"))
    run = replace(plan.runs[0], n_samples=round(hours * 36_000))
    fmus = build.build(model_of(run).models)
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        nothing = compiled(HERE / "nothing.c", Path(folder) / "nothing.so")
        for _ in range(repeat):
            drawn = spent(lambda: draw(run))
            own, quiet = (stepped(run, fmus, record=record) for record in (True, False))
            calls = stepped(run, fmus, record=False, instead=nothing)
            whole = spent(lambda: runner.write_telemetry(run, fmus, Path(folder) / "run.h5", {}))
            found = {
                "step": own,
                "arithmetic": quiet - calls,
                "calls and exchange": calls,
                "recording": own - quiet,
                "noise": drawn,
                "file": whole - own - drawn,
            }
            for name, seconds in found.items():
                times.setdefault(name, []).append(1e6 * seconds / run.n_samples)
    return {name: round(statistics.median(t), 3) for name, t in times.items()}


def stepped(run: Run, fmus: dict[str, Path], *, record: bool, instead: ctypes.CDLL | None = None) -> float:
    """Processor seconds of the loop over a run, block by block; with other functions instead of the FMUs'."""
    noise = stimuli.noise_source(run)
    with contextlib.ExitStack() as stack:
        found = read_interfaces(run, fmus)
        loop = co_simulation.RunCoSimulation(
            run, [i.component for i in found], co_simulation.start(stack, run, found), "compiled"
        )
        for row in loop._compiled._table if instead else ():
            for name in ("set", "get", "step"):
                setattr(row, name, ctypes.cast(getattr(instead, name), ctypes.c_void_p))
        loop._record = loop._record if record else loop._record[:0]
        seconds = 0.0
        for start in range(0, run.n_samples, co_simulation.BLOCK):
            stop = min(start + co_simulation.BLOCK, run.n_samples)
            drawn = {**stimuli.injections(run, start, stop), **noise.take(stop - start)}
            feeds = np.stack([drawn[name] for name in model_of(run).stimuli(run)])
            if start == 0:
                loop.initialize(feeds[:, 0])
            out = np.zeros((len(loop._record), stop - start))
            seconds += spent(lambda f=feeds, o=out, s=start: loop.advance(f.T, o.T, s))
        return seconds


def spent(work: Callable[[], object]) -> float:
    """Seconds of processor time that something takes."""
    started = time.process_time()
    work()
    return time.process_time() - started


def compiled(source: Path, library: Path) -> ctypes.CDLL:
    """Compile C as it is read most plainly, with -O2."""
    flags = [flag.replace("-O3", "-O2").replace("=hidden", "=default") for flag in FLAGS]
    subprocess.run([*compiler().command, *flags, "-o", str(library), str(source)], check=True)
    return ctypes.CDLL(str(library))


def apart(hours: float) -> tuple[float, float]:
    """`whole_run` in a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__, "--whole", str(hours)], capture_output=True, text=True, check=True
    )
    seconds, megabytes = json.loads(done.stdout.splitlines()[-1])
    return seconds, megabytes


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=6.0)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--short", action="store_true", help="only see that it works")
    parser.add_argument("--whole", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.whole:
        print(json.dumps(whole_run(options.whole)))
        return
    hours, repeat, lengths = (
        (0.5, 2, (0.5, 1.0)) if options.short else (options.hours, options.repeat, (6.0, 65.0))
    )
    each = loops(hours, repeat)
    for name, us in each.items():
        print(f"{name:12s} {us:8.3f} us per step, median of {repeat}")
    seconds, short = apart(lengths[0])
    _, long = apart(lengths[1])
    print(f"whole run of {lengths[0]:g} h with noise and file: {seconds:.2f} s, peak {short:.0f} MB")
    print(f"whole run of {lengths[1]:g} h: peak {long:.0f} MB")
    rest = 1e6 * seconds / (lengths[0] * 36_000) - each["ours"]  # of a whole run, whatever its loop
    with_noise, with_file = (
        (each["ours"] + common) / (each["monolithic"] + common) for common in (each["noise"], rest)
    )
    print(
        f"ratio to the monolithic loop: {each['ours'] / each['monolithic']:.2f} alone, "
        f"{with_noise:.2f} with the noise drawn in both, {with_file:.2f} with noise and file in both"
    )
    of_steps = {
        name: parts(name, 0.5 if options.short else 4.0, repeat) for name in ("mission-x", "inertial")
    }
    for name, us in of_steps.items():
        print(
            f"{name}: {', '.join(f'{part} {value:.3f}' for part, value in us.items())} us of processor time"
        )
    print(
        json.dumps(
            {
                "parts": of_steps,
                "us_per_step": round(each["ours"], 4),
                "speedup_over_fmpy": round(each["fmpy"] / each["ours"], 1),
                "ratio_to_monolithic": round(each["ours"] / each["monolithic"], 2),
                "hours_per_second": round(lengths[0] / seconds, 1),
                "peak_rss_mb_6h": round(short, 1),
                "peak_rss_mb_65h": round(long, 1),
            }
        )
    )


if __name__ == "__main__":
    main()
