"""A loop that is simulated by its equations: what an identification asks for, without any FMU."""

from dataclasses import replace

import numpy as np
import scipy

from fit.errors import FitError
from lpfcosim.plant import planning
from lpfcosim.worlds import drive
from lpfcosim.worlds.loop import sampled


class Feeds:
    """Series that drive a loop, handed on as noise is."""

    def __init__(self, signals, n):
        self._signals = {"g_2": np.zeros(n), **signals}
        self._taken = 0

    def take(self, n):
        found = {name: x[self._taken : self._taken + n] for name, x in self._signals.items()}
        self._taken += n
        return found


class LinearLoop:
    """The loop of ours along x, linear about its equilibrium; a `fit.identification.loop.Loop`."""

    simulated_telemetry = False  # the telemetry does not say what simulated it

    def __init__(self, runs):
        self._runs = {run.name: run for run in runs}
        self.refused = lambda _theta: False
        self.simulated = 0

    def _run(self, telemetry, theta):
        run = self._runs[telemetry.run]
        own = dict(theta)
        delta_ifo = {run.alignment_epoch: own.pop("delta_ifo", run.delta_ifo)}
        law = replace(
            run.suspension,
            unity_gain=own.pop("Controller.f_u", run.suspension.unity_gain),
            poles=(own.pop("Controller.f_p", run.suspension.poles[0]), run.suspension.poles[1]),
        )
        return replace(run, truth=replace(run.truth, delta_ifo=delta_ifo, **own), suspension=law)

    def response(self, telemetry, theta, inputs):
        self.simulated += 1
        if self.refused(theta):
            raise FitError("the loop is not stable")
        n = inputs["f_x_1"].size
        run = replace(self._run(telemetry, theta), n_samples=n)
        driven = {"f_x_1_jitter": inputs["f_x_1"], "F_noise_x_sc": inputs["F_noise_x_sc"]}
        found = planning.response(run, Feeds(driven, n), run.fs)
        return {name: found[name] for name in ("o_1", "o_12")}

    def command(self, telemetry, theta, o_12):
        run = self._run(telemetry, theta)
        decay, entry, direct = sampled(run.suspension, run.h)
        asked = direct * o_12
        for d, e in zip(decay, entry, strict=True):
            asked = asked + scipy.signal.lfilter([0, e], [1, -d], o_12)
        return -asked

    def direct(self, telemetry):
        run = self._runs[telemetry.run]
        return drive.injections(run)["F_x_2"] / run.m_tm
