"""Is a design as good as it says? Another optimiser beside it, and the scatter of campaigns flown with it.

    lpfcosim design campaigns/quickstart.toml --out designed.toml
    python -m tests.benchmarks.designs climb campaigns/quickstart.toml designed.toml --seconds 600
    lpfcosim montecarlo designed.toml -n 50 --fmus --out many
    python -m tests.benchmarks.designs scatter designed.toml many

``climb`` starts from the design, from a design with drawn phases, and from drawn tones, and changes one tone
after the other by chance: what is better is kept. ``scatter`` compares the scatter of the estimates of the
campaigns with the sigmas that were forecast.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.settings import settings
from lpfcosim.campaign import loading
from lpfcosim.experiment_design import FitModel
from lpfcosim.experiment_design.design_problem import DesignProblem, design_problem
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.spacecraft import TaperedSine

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class Steady:
    """Tones of one experiment, as long as they are steady: what they tell once the tightest limit is met."""

    def __init__(self, experiment: DesignedExperiment, tones: list[TaperedSine]) -> None:
        self.experiment, first = experiment, tones[0]
        self.length = first.end - first.start
        t = np.linspace(0, experiment.model.duration, 4000)
        left = np.clip(np.minimum(t - first.start, first.end - t) / first.ramp, 0, 1)
        power = np.sin(np.pi / 2 * left) ** 4
        self.energy, self.worth = float(power.mean()), experiment.model.worth(power)
        self.number = np.array([round(tone.frequency * self.length) for tone in tones])
        self.loop = np.array([self._loop(tone.into) for tone in tones])
        self.size = np.array([tone.amplitude * np.exp(1j * (tone.phase - np.pi / 2)) for tone in tones])
        self.highest = round(0.095 * self.length)

    def _loop(self, into: str) -> int:
        return self.experiment.loops.index({"guidance_o_1": "o_1", "F_x_1": "F_x_1"}.get(into, "o_12"))

    def told(self, number: NDArray[np.intp], size: Complex) -> Array:
        """What the tones tell, shape (P, P)."""
        told, cost = self.experiment.responses(number / self.length)
        every = np.arange(number.size)
        signal = cost[every, :, self.loop] * size[:, None]
        bins = np.zeros((self.highest + 1, signal.shape[1]), dtype=complex)
        np.add.at(bins, number, signal)
        n = scipy.fft.next_fast_len(8 * self.highest, real=True)
        waves = scipy.fft.irfft(bins, n, axis=0) * n / 2
        rms = np.sqrt(np.sum(np.abs(bins) ** 2, axis=0) / 2 * self.energy)
        peaks = np.abs(waves).max(axis=0)
        of_rms = np.array([limit.kind == "rms" for limit in self.experiment.active_limits])
        reach = np.where(of_rms, rms, peaks).max()
        found = np.zeros((self.highest + 1, told.shape[1]), dtype=complex)
        np.add.at(found, number, told[every, :, self.loop] * (size / reach)[:, None])
        kept = found[np.unique(number)]
        return np.asarray((kept.conj().T @ kept).real * self.worth)


def climbed(
    problem: DesignProblem, tones: dict[str, list[TaperedSine]], start: str, seconds: float
) -> tuple[float, float, int]:
    """Objective of the beginning and of the best that is found, and how many trials that took."""
    rng = np.random.default_rng(len(start))
    experiments = [Steady(experiment, tones[experiment.run.experiment]) for experiment in problem.experiments]
    for one in experiments:
        if start != "design":
            one.size = one.size * np.exp(2j * np.pi * rng.uniform(size=one.size.size))
        if start == "drawn":
            one.number = rng.integers(20, one.highest, one.number.size)
    told = [one.told(one.number, one.size) for one in experiments]

    def value() -> float:
        return problem.objective.value(problem.objective.logs(problem.base_information + sum(told)))

    first = best = value()
    step, trials, until = 0.3, 0, time.process_time() + seconds
    while time.process_time() < until:
        trials += 1
        k = int(rng.integers(len(experiments)))
        one, before = experiments[k], told[k]
        number, size = one.number.copy(), one.size.copy()
        i = int(rng.integers(size.size))
        if rng.uniform() < 0.15:
            number[i] = np.clip(
                number[i] + round(rng.normal() * 0.1 * number[i]) + rng.integers(-1, 2), 20, one.highest
            )
        size[i] *= np.exp(step * (rng.normal() + 1j * rng.normal()))
        told[k] = one.told(number, size)
        now = value()
        if now < best:
            best, one.number, one.size, step = now, number, size, min(step * 1.5, 1.0)
        else:
            told[k], step = before, max(step * 0.995, 0.01)
    return first, best, trials


def climb(chosen: argparse.Namespace) -> None:
    """Print what chance makes of a design, and of beginnings of its own."""
    plan = loading.load(chosen.campaign)
    problem = design_problem(plan, FitModel(plan, settings(plan.fit, "fit")))
    tones = {
        e.name: [i for i in e.injections if isinstance(i, TaperedSine)]
        for e in loading.load(chosen.designed).experiments
    }
    for start in ("design", "phases", "drawn"):
        first, best, trials = climbed(problem, tones, start, chosen.seconds / 3)
        print(f"from {start}: {first:.4f}, after {trials} trials {best:.4f}", flush=True)


def scatter(chosen: argparse.Namespace) -> None:
    """Print the scatter of estimates over the sigmas that were forecast, with its error."""
    plan = loading.load(chosen.designed)
    expected = FitModel(plan, settings(plan.fit, "fit")).sigmas(plan)
    _, *lines = (chosen.folder / "campaigns.jsonl").read_text(encoding="utf-8").splitlines()
    found = [one["estimates"] for one in map(json.loads, lines) if "estimates" in one]
    n = len(found)
    print(f"{n} campaigns; error of each ratio {1 / np.sqrt(2 * (n - 1)):.3f}")
    for name, sigma in expected.items():
        pulls, sigmas = np.array([one[name] for one in found if name in one]).T
        off = pulls * sigmas
        print(
            f"{name:12} scatter over forecast {off.std(ddof=1) / sigma:.3f}, "
            f"sigmas {sigmas.mean() / sigma:.3f}"
        )


def main() -> None:
    """Do what is asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("climb")
    one.add_argument("campaign", type=Path)
    one.add_argument("designed", type=Path)
    one.add_argument("--seconds", type=float, default=600.0, help="of processor time")
    one.set_defaults(call=climb)
    two = commands.add_parser("scatter")
    two.add_argument("designed", type=Path)
    two.add_argument("folder", type=Path, help="of lpfcosim montecarlo")
    two.set_defaults(call=scatter)
    chosen = parser.parse_args()
    chosen.call(chosen)


if __name__ == "__main__":
    main()
