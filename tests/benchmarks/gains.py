"""A mission along x whose gains live, from the equations of its models, and the fit of it.

``python -m tests.benchmarks.gains`` prints what each way to live makes of lambda_2 of the experiments: the
paper's puzzle (lambda_2 within 0.5 %, chi2_red near 90), cause by cause.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import fit
import lpfcosim
from fit.fitting.random_effects import weighted_mean
from fit.results import Results
from fit.telemetry.reader import Telemetry
from tests import ROOT

SETS = "ABCDABCDABC"
#: Amplitudes that give lambda_2 of an experiment the sigma of the flight, 3e-4.
WEAK = 0.18
_SINES = (("0.833 mHz", 10, 4, 900), ("1.667 mHz", 10, 4, 5762), ("3.333 mHz", 10, 5, 8222),
          ("13.33 mHz", 5, 12, 9783), ("53.33 mHz", 0.7, 24, 10744))  # fmt: skip


def campaign(folder: Path, truth: Mapping[str, str], sets: str = SETS, amplitude: float = WEAK) -> Path:
    """Write a campaign of experiments of 6 h along x, each after a noise run of 4 h.

    Parameters
    ----------
    folder : Path
        Where it goes.
    truth : mapping of str to str
        What is added to `[truth]`, as it is written.
    sets : str
        Authority set of each experiment.
    amplitude : float
        Of the sines into the suspension loop, relative to those of mission-x; those into the drag-free loop
        are as there.
    """
    sines = [
        f'  {{ into = "guidance_o_12", shape = "sine", frequency = "{f}", '
        f'amplitude = "{amplitude * a:g} nm", cycles = {n}, start = "{start} s" }},'
        for f, a, n, start in _SINES
    ]
    lines = ['schema = "lpf-campaign/1"', f'extends = "{(ROOT / "campaigns/mission-x.toml").as_posix()}"',
             'name = "gains"', "seed = 4", "[truth]", *(f"{key} = {value}" for key, value in truth.items()),
             "[sequences]", "weak = [", *sines, "]"]  # fmt: skip
    for n, name in enumerate(sets):
        lines += ["[[experiments]]", f'name = "{name}{n}"', f'authority = "{name}"', 'sample_rate = "1 Hz"',
                  'duration = "6 h"', 'noise_duration = "4 h"', 'sequences = ["weak", "drag_free"]',
                  'noise = { plateau = "3 fm s^-2 Hz^-0.5", tail = 1.2 }']  # fmt: skip
    path = folder / "gains.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def flown(folder: Path, truth: Mapping[str, str], **kind: object) -> list[Telemetry]:
    """Simulate such a campaign in a folder, without FMUs."""
    lpfcosim.simulate(campaign(folder, truth, **kind), folder / "out", fmus=False)
    return fit.load(folder / "out")


def chi2_red(results: Results) -> tuple[float, float, float]:
    """Return chi2_red of lambda_2 of the experiments about their mean, their relative rms, and a sigma."""
    gains = [e.parameters["lambda_2"] for e in results.experiments.values()]
    values = np.array([g.value for g in gains])
    rms = float(values.std(ddof=1) / values.mean())
    return weighted_mean(gains).chi2_red, rms, float(np.median([g.sigma for g in gains]))


CASES = {
    "nothing": {},
    "scatter 0.28 %": {"lambda_scatter": "0.0028"},
    "drift 0.1 % a day": {"lambda_drift_2": '"1e-3 day^-1"'},
    "random walk, 0.5 % after a day": {"lambda_walk_2": '"5e-3 day^-0.5"'},
    "0.5 % at 1 nN": {"lambda_bend_2": "5e-3"},
}


def main() -> None:
    """Print a line for each way to live."""
    for name, truth in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            found = fit.calibrate(flown(Path(folder), truth), scatter=[])
        chi2, rms, sigma = chi2_red(found)
        print(f"{name}: chi2_red {chi2:.3g}, rms {100 * rms:.2g} %, sigma of an experiment {sigma:.2g}")


if __name__ == "__main__":
    main()
