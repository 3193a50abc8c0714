"""A loop that is simulated by its equations: what an identification asks for, without any FMU."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy

from fit.campaign import Campaign
from fit.checks import checked
from fit.errors import FitError, InputError
from fit.identification.identify import identify
from fit.identification.loop import FreeParameter
from fit.settings import settings
from fit.telemetry.reader import Telemetry
from fit.whitening import pair
from lpfcosim.execution import telemetry_file
from lpfcosim.linear import ClosedLoop, response
from lpfcosim.models import one_axis
from lpfcosim.spacecraft import Sine
from tests.oracles.reference_plant import tustin

TONES = (
    Sine("guidance_o_12", 10e-9, 1.5e-3, 4, 300),
    Sine("guidance_o_12", 5e-9, 13e-3, 12, 3100),
    Sine("guidance_o_1", 5e-9, 6e-3, 20, 1000),
)
NOISE = {"oms": 35e-15, "thruster": 0.15e-6, "plateau": 5.6e-15, "tail": 1.5}


def recorded_experiment(make_run, name, truth, seed):
    """Return an experiment of 5400 s and its noise run, and their telemetry from the reference plant."""
    common = {
        "experiment": name,
        "n_samples": 54000,
        "seed": seed,
        "truth": truth,
        "dc": 5e-12,
        "noise": NOISE,
    }
    runs = [
        make_run(name=name, kind="sysid", injections=TONES, **common),
        make_run(name=f"{name}-noise", kind="noise", injections=(), **common),
    ]
    return runs, [_recorded(run) for run in runs]


def _recorded(run):
    root, channels = telemetry_file.attributes(run), ClosedLoop(run).simulate()
    fields = {name: root.pop(name) for name in list(root) if name in Telemetry.__dataclass_fields__}
    return Telemetry(
        **fields, path=Path(run.name), time=run.time, channels=channels, units={}, attributes=root
    )


class Feeds:
    """Series that drive a loop, handed on as noise is."""

    def __init__(self, signals, n):
        self._signals = {"g_2": np.zeros(n), **signals}
        self._taken = 0

    def take(self, n):
        series = {name: x[self._taken : self._taken + n] for name, x in self._signals.items()}
        self._taken += n
        return series


def with_law(run, **values):
    """Return a run with other values of its suspension control."""
    law = {**run.control["SuspensionControl"], **values}
    return replace(run, control={**run.control, "SuspensionControl": law})


class LinearLoop:
    """The loop of ours along x, linear about its equilibrium; a `fit.identification.loop.Loop`."""

    simulated_telemetry = False  # the telemetry does not say what simulated it

    def __init__(self, runs):
        self._runs = {run.name: run for run in runs}
        self.refused = lambda _theta: False
        self.simulated = 0

    def _run(self, telemetry, theta):
        run = self._runs[telemetry.run]
        truth = dict(theta)
        epoch = f"delta_ifo_{run.alignment_epoch}"
        truth[epoch] = truth.pop("delta_ifo", run.truth[epoch])
        laws = {name: f"Controller.{name}" for name in ("f_u", "f_p")}
        law = {name: truth.pop(key) for name, key in laws.items() if key in truth}
        return replace(with_law(run, **law), truth={**run.truth, **truth})

    def response(self, telemetry, theta, inputs):
        self.simulated += 1
        if self.refused(theta):
            raise FitError("the loop is not stable")
        n = inputs["f_x_1"].size
        run = replace(self._run(telemetry, theta), n_samples=n)
        driven = {"f_x_1_jitter": inputs["f_x_1"], "F_noise_x_sc": inputs["F_noise_x_sc"]}
        try:
            expected = response.linear_response(run, Feeds(driven, n), run.fs)
        except InputError as error:  # a delay became negative
            raise FitError(str(error)) from error
        return {name: expected[name] for name in ("o_1", "o_12")}

    def command(self, telemetry, theta, o_12):
        run = self._run(telemetry, theta)
        decay, entry, direct = tustin(run.control["SuspensionControl"], run.h)
        command = direct * o_12
        for d, e in zip(decay, entry, strict=True):
            command = command + scipy.signal.lfilter([0, e], [1, -d], o_12)
        return -command


# What the tests of one experiment share -------------------------------------------------------------------

CHOSEN = settings({"include_short": True, "glitches": False})
TRUTH = {"lambda_2": 1.06, "C_2": 0.2, "omega2_2_0": -4.6e-7}
FREE = (
    FreeParameter("lambda_2"),
    FreeParameter("C_2"),
    FreeParameter("omega2_1_0"),
    FreeParameter("omega2_2_0"),
    FreeParameter("delta_ifo", shared="alignment_epoch"),
)


def identified(
    flown,
    free=FREE,
    refused=lambda _theta: False,
    unity_gain=1e-3,
    chosen=CHOSEN,
    *,
    simulated=False,
    fixed=None,
):
    """Identify `free` with a loop whose other parameters have flight values, or those in `fixed`."""
    runs, telemetries, calibrated = flown
    blank = [replace(run, truth={**one_axis.MODEL.stated_truth, **(fixed or {})}, dc=0.0) for run in runs]
    loop = LinearLoop([with_law(run, f_u=unity_gain) for run in blank])
    loop.refused, loop.simulated_telemetry = refused, simulated
    experiments = pair(telemetries)
    campaign = checked(Campaign({e.name: e for e in experiments}, CHOSEN), "o_1")
    return identify([*campaign.experiments.values()], free, loop, calibrated, chosen, fixed or {})
