"""One LISA spacecraft in closed loop, in the plane: an oracle that shares no code with the fit.

Newton's equations of the spacecraft and of two test masses in housings 60 degrees apart, their sensors and
control loops are solved, frequency by frequency, as one linear system. Commands act like samples of a
10 Hz loop that are held and delayed, without the images of the hold, which are 1e-8 of them.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np

from fit.telemetry.reader import Telemetry

FS = 1.0  # Hz
TOTAL = 54368  # samples of a run and of what is before and after it, in which the loop settles
HOLD, THRUSTER_DELAY, THRUSTER_LAG = 0.1, 0.25, 0.1  # s
M_TM, M_SC, I_ZZ = 1.928, 1500.0, 1200.0  # kg, kg m^2
HALF_OPENING, BASELINE, ARM = np.pi / 6, 0.5, 0.10  # rad; m
TONES = (0.833e-3, 1.667e-3, 3.333e-3, 6.667e-3, 13.33e-3)  # Hz
OUTPUTS = ("o_1", "o_2", "grs_y_1", "grs_y_2", "dws_phi", "F_y_1", "F_y_2", "F_x_2", "X_1", "X_2")


@dataclass(frozen=True)
class World:
    """Truth, and noise in units per root Hz."""

    truth: dict[str, float] = field(
        default_factory=lambda: {
            "omega2_x_1": -6e-7, "omega2_x_2": -5e-7, "omega2_xy_1": 3e-8, "omega2_xy_2": -2e-8,
            "omega2_y_1": -1e-6, "omega2_y_2": -1.1e-6, "lambda_y_1": 1.05, "lambda_y_2": 1.07,
            "C_y_1": 1.05 * 0.15, "C_y_2": 1.07 * 0.17, "grs_gain_y_1": 1.002, "grs_gain_y_2": 0.997,
            "x_per_y_1": 2e-3, "x_per_y_2": -1e-3, "lambda_x_2": 1.06, "C_x_2": 1.06 * 0.16,
            "o_per_y_1": 0.0, "o_per_y_2": 0.0, "grs_y_per_x_1": 0.0, "grs_y_per_x_2": 0.0, "opening": 0.0,
        }
    )  # fmt: skip
    geometry: dict[str, float] = field(default_factory=dict)
    tmi: float = 1.42e-12  # m
    grs: float = 2.0e-9  # m, 1/f below 1 mHz
    dws: float = 0.15e-9  # rad
    force: float = 2.4e-15  # m s^-2, of each test mass along each axis
    lateral: float = 5e-15  # m s^-2
    thrust: float = 0.1e-6  # N
    torque: float = 0.05e-6  # N m
    fall_back: bool = False
    arms: tuple[int, ...] = ()  # test masses whose long arm is measured
    half_opening: float = HALF_OPENING

    def __hash__(self) -> int:
        return id(self)

    def turn(self, j):
        """The matrix from housing j to the spacecraft; `opening` turns the first."""
        half = self.half_opening
        angle = half + self.geometry.get("opening", 0.0) if j == 1 else -half
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def housing(self, j):
        """The position of housing j [m]; d_x, d_y lead from the second to the first."""
        if j == 2:
            return np.array([ARM, -BASELINE / 2])
        d_x, d_y = self.geometry.get("d_x", 0.0), self.geometry.get("d_y", BASELINE)
        return np.array([ARM + d_x, d_y - BASELINE / 2])


WORLD = World()


def pulls(joint, world=WORLD):
    """Sizes of the pulls of the estimates of a fit that are not exact."""
    estimates = joint.parameters.items()
    return np.array([abs(e.difference(world.truth[name])) for name, e in estimates if not e.is_exact])


def compensator(s, unity, zero, integral, poles):
    """Lead and integrator whose product with 1/s^2 has unity gain at `unity` [Hz]."""
    w = 2 * np.pi

    def shape(s):
        value = (s + w * zero) * (s + w * integral) / s
        for pole in poles:
            value = value / (1 + s / (w * pole))
        return value

    at_unity = 2j * np.pi * unity
    return shape(s) * (2 * np.pi * unity) ** 2 / np.abs(shape(at_unity))


def hold(s, delay):
    """A sampled command as it acts: held for 0.1 s, `delay` is that of the middle of the hold."""
    return np.exp(-s * delay) * np.sinc(np.abs(s) / (2 * np.pi) * HOLD)


UNKNOWNS = ("x_1", "y_1", "x_2", "y_2", "phi", "a_x", "a_y", "f_y_1", "f_y_2", "f_x_2")
INDEX = {name: i for i, name in enumerate(UNKNOWNS)}
NOISES = ("n_o_1", "n_o_2", "n_y_1", "n_y_2", "n_phi", "g_x_1", "g_y_1", "g_x_2", "g_y_2")
NOISES += ("thrust_x", "thrust_y", "torque", "n_X_1", "n_X_2")
SOURCES = (*NOISES, "r_o_1", "r_o_2", "r_y_1", "r_y_2", "r_phi")


def closed_loop(world, f):
    """Responses of `OUTPUTS` and of `UNKNOWNS` to `SOURCES` at f, (n, len(OUTPUTS), S) and (n, 10, S)."""
    s, n = 2j * np.pi * f, f.size
    A, B = np.zeros((n, 10, 10), complex), {name: np.zeros((n, 10), complex) for name in SOURCES}
    read, forces = read_outs(world, n), forces_per_mass(world, s)
    for j in (1, 2):
        add_test_mass(A, B, world, s, j)
        A[:, 2 * j - 2 : 2 * j] -= forces[j]
    add_spacecraft(A, B, world, s, forces)
    add_control(A, B, world, read, s)
    unknowns = np.linalg.solve(A, np.stack([B[name] for name in SOURCES], axis=-1))
    rows = [np.einsum("nk,nks->ns", read[name], unknowns) for name in OUTPUTS[:5]]
    rows += [unknowns[:, INDEX[name]] * M_TM for name in ("f_y_1", "f_y_2", "f_x_2")]
    rows += [rows[j - 1] + position(world, unknowns, s, j) for j in (1, 2)]
    outputs = np.stack(rows, axis=1)
    for i in range(5):  # each read-out has its own noise
        outputs[:, i, i] += 1
    for j in (1, 2):
        outputs[:, OUTPUTS.index(f"X_{j}"), SOURCES.index(f"n_X_{j}")] += 1
    return outputs, unknowns


def position(world, unknowns, s, j):
    """Housing j in inertial space along its telescope, (n, S)."""
    (u_x, u_y), (r_x, r_y) = world.turn(j)[:, 0], world.housing(j)
    spacecraft = u_x * unknowns[:, INDEX["a_x"]] + u_y * unknowns[:, INDEX["a_y"]]
    turned = (u_y * r_x - u_x * r_y) * unknowns[:, INDEX["phi"]]
    return spacecraft / (s**2)[:, None] + turned


def forces_per_mass(world, s):
    """Electrostatic forces along x and y of housing j as rows for the unknowns, each of shape (n, 2, 10)."""
    value, forces = world.truth, {j: np.zeros((s.size, 2, 10), complex) for j in (1, 2)}
    for j in (1, 2):
        delay = value[f"C_y_{j}"] / value[f"lambda_y_{j}"]
        along = np.array([value[f"x_per_y_{j}"], value[f"lambda_y_{j}"]])
        forces[j][:, :, INDEX[f"f_y_{j}"]] = hold(s, delay)[:, None] * along
    if world.fall_back:
        command = hold(s, value["C_x_2"] / value["lambda_x_2"])
        forces[2][:, 0, INDEX["f_x_2"]] = command * value["lambda_x_2"]
    return forces


def add_test_mass(A, B, world, s, j):
    """``s^2 s_j + K s_j - f_j + R_j^T (a_O + phi'' z x r_j) = g_j``, the forces left out."""
    rows = slice(2 * j - 2, 2 * j)
    value, turn, (r_x, r_y) = world.truth, world.turn(j), world.housing(j)
    cross = value[f"omega2_xy_{j}"]
    A[:, rows, rows] += (s**2)[:, None, None] * np.eye(2)
    A[:, rows, rows] += np.array([[value[f"omega2_x_{j}"], cross], [cross, value[f"omega2_y_{j}"]]])
    A[:, rows, 5:7] += turn.T
    A[:, rows, 4] += (s**2)[:, None] * (turn.T @ np.array([-r_y, r_x]))
    B[f"g_x_{j}"][:, 2 * j - 2] = B[f"g_y_{j}"][:, 2 * j - 1] = 1


def add_spacecraft(A, B, world, s, forces):
    """``m a_O = thrust - forces``, ``J phi'' = torque - r x forces``, thrust left out."""
    A[:, 5, 5] = A[:, 6, 6] = 1
    A[:, 4, 4] = s**2
    for j in (1, 2):
        r, reaction = world.housing(j), np.einsum("ab,nbk->nak", world.turn(j), forces[j]) * M_TM
        A[:, 5:7] += reaction / M_SC
        A[:, 4] += (r[0] * reaction[:, 1] - r[1] * reaction[:, 0]) / I_ZZ
    B["thrust_x"][:, 5] = B["thrust_y"][:, 6] = 1 / M_SC
    B["torque"][:, 4] = 1 / I_ZZ


def add_control(A, B, world, read, s):
    """Drag-free control of both x_j, or of x_1, and of the attitude by thrust; suspension of the rest."""
    thruster = hold(s, THRUSTER_DELAY + HOLD / 2) / (1 + THRUSTER_LAG * s)
    drag_free = compensator(s, 0.08, 0.03, 0.006, (0.8, 2.0)) * thruster
    axes = np.stack([world.turn(1)[:, 0], world.turn(2)[:, 0]])
    accelerations = np.stack([axes[0], np.zeros(2)], axis=1) if world.fall_back else np.linalg.inv(axes)
    for j in (1, 2):
        along = accelerations[:, j - 1]
        A[:, 5:7] -= drag_free[:, None, None] * along[:, None] * read[f"o_{j}"][:, None, :]
        B[f"n_o_{j}"][:, 5:7] = drag_free[:, None] * along
        B[f"r_o_{j}"][:, 5:7] = -drag_free[:, None] * along
    attitude = compensator(s, 0.03, 0.009, 0.0018, (0.24, 0.6)) * thruster
    A[:, 4] += attitude[:, None] * read["dws_phi"]
    B["n_phi"][:, 4], B["r_phi"][:, 4] = -attitude, attitude
    lateral = compensator(s, 2e-3, 0.6e-3, 0.12e-3, (12e-3, 60e-3))
    loops = [(f"f_y_{j}", f"grs_y_{j}", f"y_{j}", lateral) for j in (1, 2)]
    suspension = compensator(s, 1e-3, 0.3e-3, 0.06e-3, (6e-3, 30e-3)) * world.fall_back
    for command, channel, name, law in (*loops, ("f_x_2", "o_2", "o_2", suspension)):
        row = INDEX[command]
        A[:, row, row] = 1
        A[:, row] += law[:, None] * read[channel]
        B[f"n_{name}"][:, row] -= law
        B[f"r_{name}"][:, row] += law


def read_outs(world, n):
    """The first five `OUTPUTS` without noise as rows for the unknowns, each of shape (n, 10)."""
    rows = {name: np.zeros((n, 10), complex) for name in OUTPUTS[:5]}
    for j in (1, 2):
        rows[f"o_{j}"][:, 2 * j - 2] = 1
        rows[f"o_{j}"][:, 2 * j - 1] = world.geometry.get(f"o_per_y_{j}", 0.0)
        rows[f"grs_y_{j}"][:, 2 * j - 1] = world.truth[f"grs_gain_y_{j}"]
        rows[f"grs_y_{j}"][:, 2 * j - 2] = world.geometry.get(f"grs_y_per_x_{j}", 0.0)
    rows["dws_phi"][:, 4] = world.geometry.get("dws_gain", 1.0)
    return rows


def levels(world, f):
    """One-sided ASD of every source of noise, each of shape (n,)."""
    tmi = world.tmi * np.sqrt(1 + (2e-3 / f) ** 4)
    grs = world.grs * np.sqrt(1 + (1e-3 / f) ** 2)
    force = world.force * np.sqrt(1 + (0.4e-3 / f) ** 2) * np.sqrt(1 + (f / 8e-3) ** 4)
    lateral = world.lateral * np.sqrt(1 + (0.4e-3 / f) ** 2)
    even = np.ones(f.size)
    # the other test mass of the arm, and interferometers between and to them (lisainstrument 2.3.0)
    interferometers = np.hypot(6.35e-12, 2**0.5 * 1.42e-12) * np.sqrt(1 + (2e-3 / f) ** 4)
    far = np.hypot(2.4e-15 * np.sqrt(1 + (0.4e-3 / f) ** 2) / (2 * np.pi * f) ** 2, interferometers)
    return {
        "n_o_1": tmi, "n_o_2": tmi, "n_y_1": grs, "n_y_2": grs, "n_phi": world.dws * even,
        "g_x_1": force, "g_x_2": force, "g_y_1": lateral, "g_y_2": lateral,
        "thrust_x": world.thrust * even, "thrust_y": world.thrust * even, "torque": world.torque * even,
        "n_X_1": far, "n_X_2": far,
    }  # fmt: skip


@dataclass(frozen=True)
class Tone:
    """Cycles of a sine in a set point (``r_o_1``, ``r_y_1``, ``r_phi``), from `start` [s] on."""

    source: str
    frequency: float
    amplitude: float
    cycles: float
    start: float


def sequence(amplitude, *, start=900.0, into=(("r_o_1", "r_o_2"), ("r_y_1", "r_y_2")), yaw=0.0):
    """Five tones of half an hour into x_1 and, 1.13 times as fast, x_2; then five into y_1, y_2."""
    tones, begin = [], start
    for pair in into:
        for f in TONES:
            for source, ratio in zip(pair, (1.0, 1.13), strict=False):
                tones.append(Tone(source, f * ratio, amplitude, 1800 * f * ratio, begin))
            begin += 1860.0
    if yaw:
        tones.append(Tone("r_phi", 10e-3, yaw, 18, start))
    return tuple(tones)


@lru_cache(maxsize=8)
def responses(world):
    f = np.fft.rfftfreq(TOTAL, 1 / FS)[1:]
    return f, closed_loop(world, f)[0]


def series(spectrum):
    """Time series of one-sided transforms without the mean, shape (n, ...)."""
    return np.fft.irfft(np.concatenate([np.zeros((1, *spectrum.shape[1:])), spectrum]), TOTAL, axis=0)


def injected(tones, begin):
    """Transforms of the set points by source, for a run that begins at a sample."""
    time, signals = (np.arange(TOTAL) - begin) / FS, {}
    for tone in tones:
        phase = tone.frequency * (time - tone.start)
        wave = tone.amplitude * np.sin(2 * np.pi * phase) * ((phase >= 0) & (phase < tone.cycles))
        signals[tone.source] = signals.get(tone.source, 0.0) + wave
    return {name: np.fft.rfft(wave)[1:] for name, wave in signals.items()}


def run(world, tones=(), *, duration=21600, seed=None, name="A", kind="sysid"):
    """Telemetry of a run; without noise if there is no seed."""
    n = int(duration * FS)
    begin = (TOTAL - n) // 2
    f, outputs = responses(world)
    drive = injected(tones, begin)
    if seed is not None:
        rng = np.random.default_rng([seed, *kind.encode()])
        for source, asd in levels(world, f).items():
            white = rng.normal(size=(f.size, 2)) @ [1, 1j] * np.sqrt(TOTAL * FS / 4)
            drive[source] = drive.get(source, 0.0) + asd * white
    spectrum = sum(outputs[:, :, SOURCES.index(source)] * x[:, None] for source, x in drive.items())
    values = series(spectrum)[begin : begin + n]
    channels = dict(zip(OUTPUTS, values.T.copy(), strict=True))
    phi = channels.pop("dws_phi")
    for j in {1, 2} - {*world.arms}:
        del channels[f"X_{j}"]
    channels |= {"dws_phi_1": phi, "dws_phi_2": phi, "F_x_1": np.zeros(n)}
    if not world.fall_back:
        channels["F_x_2"] = np.zeros(n)
    return Telemetry(
        path=Path(f"{name}-{kind}.h5"), run=f"{name}-{kind}", experiment=name, kind=kind, fs=FS,
        t0="2036-01-01T00:00:00Z", F_max_1=1e-9, F_max_2=1e-9, N_max_1=1e-11, N_max_2=1e-11,
        alignment_epoch=0, m_tm=M_TM, time=np.arange(n) / FS, channels=channels, units={},
        attributes={"spacecraft": "LISA", "d_y": BASELINE},
    )  # fmt: skip


def campaign(world, tones, *, duration=21600, seed=0, name="A"):
    """A run with injections and a noise run of eight hours."""
    sysid = run(world, tones, duration=duration, seed=seed, name=name)
    return [sysid, run(world, duration=28800, seed=seed, name=name, kind="noise")]


def save(folder, runs, truth=None):
    """Write runs as files of the telemetry contract."""
    units = {"F": "N", "dws": "rad"}  # by the first word of a channel
    for telemetry in runs:
        with h5py.File(folder / f"{telemetry.run}.h5", "w") as file:
            file.attrs.update(telemetry.root)
            time = file.create_dataset("time", data=telemetry.time)
            time.attrs["units"] = "s"
            time.make_scale("time")
            for name, values in telemetry.channels.items():
                dataset = file.create_dataset(name, data=values)
                dataset.attrs["units"] = units.get(name.split("_")[0], "m")
                dataset.dims[0].attach_scale(time)
            file.create_group("truth").attrs.update(truth or {})
    return folder


def cross_spectra(world, names, f):
    """One-sided cross-spectra of channels, ``<x_i^* x_j>``, shape (n, C, C)."""
    outputs, _ = closed_loop(world, f)
    position = {name: i for i, name in enumerate(OUTPUTS)} | {"dws_phi_1": 4, "dws_phi_2": 4}
    T, asd = np.zeros((f.size, len(names), len(NOISES)), complex), levels(world, f)
    level = np.stack([asd[source] for source in NOISES], axis=-1)
    for i, name in enumerate(names):
        if name in position:
            T[:, i] = outputs[:, position[name], : len(NOISES)] * level
    return np.einsum("bik,bjk->bij", T.conj(), T)
