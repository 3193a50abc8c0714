"""Telemetry of a rotating spacecraft, made in the frequency domain: an oracle without code of the fit.

In each of the planes y-phi and z-eta the loops of the real scheme are solved frequency by frequency: the
thrusters turn the spacecraft after the differential position of the test masses (u = difference / baseline),
the star tracker steers it through differential electrostatic forces, and the angle of each test mass follows
the spacecraft electrostatically. Omega is what these loops make of their noises. Along x the suspension loop
is closed on the differential acceleration in which the apparent forces appear.
"""

from dataclasses import dataclass, field

import numpy as np

from fit.parameters import joint_names, joint_parameter
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance
from tests.oracles.contract_file import write_contract_file
from tests.oracles.synthetic import AUTHORITIES, recorded

BASELINE = 0.376
INERTIA = 6.80e-4


@dataclass(frozen=True)
class Plane:
    """Noise and truth about one axis; ASDs in SI, one-sided."""

    star_tracker: float  # rad Hz^-0.5
    rate: float  # rad/s, mean Omega
    delta: float  # rad, delta_phi or delta_eta
    drift: float = 1e-13  # rad s^-2, slow change of the mean Omega
    balance: float = 2e-10  # rad s^-2, constant torque on a test mass over its inertia


@dataclass(frozen=True)
class World:
    """Truth and noise of a noise run."""

    phi: Plane = field(default_factory=lambda: Plane(0.13e-3, 2.0e-7, -0.40e-3))
    eta: Plane = field(default_factory=lambda: Plane(0.6e-3, -3e-8, -0.137e-3))
    plateau: float = 5.57e-15  # m s^-2 Hz^-0.5, of Delta g
    tail: float = 60e-15  # m s^-2 Hz^-0.5 at 20 uHz, falling as 1/f
    lambda_1: float = 1.0748
    lambda_2: float = 1.0776
    C_1: float = 0.149
    C_2: float = 0.186
    omega2_1: float = -6.9e-7
    omega2_2: float = -14.0e-7
    delta_ifo: float = -2.2e-5
    jitter: float = 2e-10  # m Hz^-0.5 of x_1
    b_1: float = 1.2e-5  # m/rad, Eq. (3)
    b_2: float = -0.9e-5
    leak: float = 1e-3  # m s^-2 of f_x_1 per rad s^-2 of N_phi_1 / I
    omega2_angle: float = -1.5e-6  # s^-2
    omega2_y: float = -8e-7  # s^-2
    torque: float = 1.5e-12  # rad s^-2 Hz^-0.5 on a test mass, 1/f below 0.2 mHz
    dws: float = 150e-12  # rad Hz^-0.5
    grs: float = 1.8e-9  # m Hz^-0.5, 1/f below 1 mHz
    thruster: float = 0.08e-6 / 200  # rad s^-2 Hz^-0.5 of the spacecraft
    latency: float = 0.15  # s, of torques: transport and half a hold


def controller(s, unity, zeros, poles, integrator=True):
    """Return K(s), a PID or PD with roll-off, that makes |K/s^2| = 1 at `unity` Hz."""

    def shape(s):
        k = np.ones_like(s)
        for zero in zeros:
            k = k * (s + 2 * np.pi * zero)
        for pole in poles:
            k = k / (1 + s / (2 * np.pi * pole))
        return k / s if integrator else k

    at_unity = np.array([2j * np.pi * unity])
    return shape(s) * np.abs(at_unity**2 / shape(at_unity))[0]


def run(world=None, *, duration=3 * 86400.0, fs=1.0, seed=0, name="inertial", **attributes):
    """Make one noise run.

    Returns
    -------
    Telemetry
        With angles, torques and star tracker; `attributes` join its root attributes.
    dict
        The truth as time series: ``Omega_phi``, ``dOmega_phi``, ``Omega_eta``, ``dOmega_eta``, ``delta_g``.
    """
    world = world or World()
    rng = np.random.default_rng([seed, *name.encode()])
    kept = int(duration * fs)
    n = 2 * kept  # twice as long as kept, so that nothing is periodic in the run
    f = np.fft.rfftfreq(n, 1 / fs)
    f[0] = 1e-3 * f[1]  # no noise is drawn there
    s = 2j * np.pi * f
    keep = slice(n // 4, n // 4 + kept)
    t = np.arange(kept) / fs

    def noise(asd):
        draw = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
        band = (np.arange(f.size) > 0) & (f < 0.45 * fs)
        return np.where(band, draw * asd * np.sqrt(n * fs / 4), 0)

    def series(spectrum):
        return np.fft.irfft(spectrum, n)

    actuators = np.exp(-0.25 * s) / (1 + 0.1 * s)
    delay = np.exp(-world.latency * s)
    drag_free = controller(s, 30e-3, (9e-3, 1.8e-3), (0.24, 0.6)) * actuators
    attitude = controller(s, 0.07e-3, (0.021e-3,), 3 * (0.42e-3,), integrator=False) * delay
    suspension = controller(s, 2e-3, (0.6e-3, 0.12e-3), (12e-3, 60e-3))
    channels, truth = {}, {}
    centrifugal, euler, bump = 0.0, 0.0, 0.0
    for axis, sign in (("phi", 1), ("eta", -1)):
        plane = getattr(world, axis)
        n_ast = noise(plane.star_tracker)
        n_u = noise(np.sqrt(2) * world.grs / BASELINE * np.maximum(1, 1e-3 / f))
        G = drag_free / (s**2 + world.omega2_y)
        psi = (-G * attitude * n_ast + drag_free * n_u + noise(world.thruster)) / (
            s**2 + G * (attitude + s**2)
        )
        b = world.b_1 if axis == "phi" else world.b_2
        read = []
        for j in (1, 2):
            n_j = noise(world.dws)
            gamma = noise(world.torque * np.maximum(1, 0.2e-3 / f))
            angle = (gamma - s**2 * psi - suspension * delay * n_j) / (
                s**2 + world.omega2_angle + suspension * delay
            )
            read.append(angle + n_j)
            bump = bump + b * angle / 2
            channels[f"N_{axis}_{j}"] = INERTIA * (series(-suspension * read[-1])[keep] - plane.balance)
        channels[f"o_{axis}_1"] = series(read[0])[keep]
        channels[f"o_{axis}_12"] = series(read[1] - read[0])[keep]
        slow = plane.rate + plane.drift * (t - t[kept // 2])
        Omega = series(s * psi)
        dOmega = series(s**2 * psi)
        channels[f"ast_{axis}"] = (
            series(psi + n_ast)[keep] + plane.rate * t + plane.drift * (t**2 / 2 - t * t[kept // 2])
        )
        truth[f"Omega_{axis}"] = Omega[keep] + slow
        truth[f"dOmega_{axis}"] = dOmega[keep] + plane.drift
        centrifugal = centrifugal + BASELINE * (Omega**2 + 2 * plane.rate * Omega)
        euler = euler + sign * BASELINE * plane.delta * dOmega
        # The slow part is no periodic function; what it adds is made up for below, where it is quasi-static.
        channels[f"slow_{axis}"] = (
            BASELINE * (2 * Omega[keep] * (slow - plane.rate) + slow**2)
            + sign * BASELINE * plane.delta * plane.drift
        )
    low = np.maximum(f, 1 / duration)
    delta_g = noise(np.sqrt(world.plateau**2 + (world.tail * 20e-6 / low) ** 2))
    pull = delta_g + np.fft.rfft(centrifugal + euler)
    x_1 = noise(world.jitter / (1 + (f / 0.05) ** 2))
    hold = np.sinc(0.1 * f)
    gain_1 = world.lambda_1 * hold * np.exp(-s * world.C_1 / world.lambda_1)
    gain_2 = world.lambda_2 * hold * np.exp(-s * world.C_2 / world.lambda_2)
    N_phi_1 = np.fft.rfft(np.pad(channels["N_phi_1"] / INERTIA, (n // 4, n - n // 4 - kept), mode="reflect"))
    f_x_1 = world.leak * N_phi_1 + noise(1e-14 * np.minimum(10, 1e-3 / f))
    K = controller(s, 1e-3, (0.3e-3, 0.06e-3), (6e-3, 30e-3))
    known = world.delta_ifo * x_1 - bump + noise(35e-15)
    pull = pull - (world.omega2_2 - world.omega2_1) * x_1 - gain_1 * f_x_1
    x_12 = (pull - gain_2 * K * known) / (s**2 + world.omega2_2 + gain_2 * K)
    o_12 = x_12 + known
    slow = channels.pop("slow_phi") + channels.pop("slow_eta")
    channels |= {
        "o_1": series(x_1)[keep],
        "o_12": series(o_12)[keep],
        "f_x_1": series(f_x_1)[keep],
        "f_x_2": series(-K * o_12)[keep] - slow / world.lambda_2,
    }
    truth["delta_g"] = series(delta_g)[keep]
    attributes = {"omega2_phi": -1.5e-6, "omega2_eta": -1.5e-6, **attributes}
    t0 = "2016-06-19T00:00:00Z"
    made = recorded(AUTHORITIES["A"], name, "noise", channels, fs=fs, run=name, t0=t0, attributes=attributes)
    return made, truth


def calibration(world=None):
    """Return results whose joint fit knows the dynamics of `world` with the sigmas of the flight."""
    world = world or World()
    values = {
        "lambda_1": world.lambda_1,
        "lambda_2": world.lambda_2,
        "C_1": world.C_1,
        "C_2": world.C_2,
        "alpha_x_1": -345.0,
        "alpha_x_2": -317.0,
        "alpha_phi_1": -28.2e3,
        "alpha_phi_2": -27.4e3,
        "omega2_1_0": world.omega2_1 + 28.2e3 * 10.4e-12,
        "omega2_2_0": world.omega2_2 + 317 * 2200e-12 + 27.4e3 * 10.4e-12,
        "delta_ifo_1": world.delta_ifo,
    }
    known = {name: joint_parameter(name) for name in joint_names([1])}
    estimates = {name: Estimate(values[name], p.sigma, p.unit) for name, p in known.items()}
    joint = Fit(estimates, np.diag([p.sigma**2 for p in known.values()]), 1e4, 10_000, True, ())
    return Results(joint, {}, {}, {}, Provenance(joint_runs=["A1"]))


def write(folder, run, world=None):
    """Write a run as a file of the contract, the truth in its group /truth."""
    world = world or World()
    units = {"o_1": "m", "o_12": "m", "f_x_1": "m s-2", "f_x_2": "m s-2"}
    by_letter = {"N": "N m", "a": "rad", "o": "rad"}
    channels = {
        name: (values, units.get(name) or ("1" if "_q_" in name else by_letter[name[0]]))
        for name, values in run.channels.items()
    }
    names = ("run", "experiment", "kind", "fs", "t0", "F_max_1", "F_max_2", "N_max_1", "N_max_2", "m_tm")
    return write_contract_file(
        folder / f"{run.run}.h5",
        samples=run.time.size,
        channels=channels,
        truth={"delta_phi": world.phi.delta, "delta_eta": world.eta.delta},
        alignment_epoch=run.alignment_epoch,
        **{name: getattr(run, name) for name in names},
        **run.attributes,
    )
