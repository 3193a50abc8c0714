"""What tests of the Euler fit share."""

from dataclasses import replace

from fit.crosstalk.euler_fit import fit_period
from tests.oracles.rotation_synthetic import World, calibration

DAY = 86400.0
TRUTH = {"delta_phi": World().phi.delta, "delta_eta": World().eta.delta}
LOW_NOISE = World(plateau=0.5e-15, tail=3e-15)  # the angles' own errors stand out of Delta g


def pulls(fit, truth=None):
    truth = truth or TRUTH
    return [(e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()]


def codes(fit):
    return {w.code for w in fit.warnings}


def lacking(telemetry, *beginnings):
    channels = {k: v for k, v in telemetry.channels.items() if not k.startswith(beginnings)}
    return replace(telemetry, channels=channels)


def fitted(*runs, world=None):
    return fit_period(runs, calibration(world).joint)
