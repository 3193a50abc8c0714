"""The FMUs of the whole spacecraft against closed forms: free fall, conservation laws, transfer functions."""

import fmpy
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from lpfcosim.cosim import checks
from lpfcosim.modelica import build

pytestmark = [pytest.mark.fmu, pytest.mark.slow]

MODELS = ("WholePlant", "WholeActuation", "WholeMetrology", "InertialSensor", "StarTracker",
          "WholeDragFreeControl", "WholeSuspensionControl", "AttitudeControl")  # fmt: skip
M_SC, M_TM, I_TM, D = 422.7, 1.928, 6.80e-4, 0.376
I_SC = np.array([202.5, 209.7, 191.7])
AXES, ANGLES = "xyz", ("theta", "eta", "phi")
ROUND = dict.fromkeys(("I_xx_sc", "I_yy_sc", "I_zz_sc"), 200.0)  # no gyroscopic torque
LOOSE = dict.fromkeys(
    ("omega2_1_0", "omega2_2_0", "omega2_y", "omega2_z", *(f"omega2_{k}" for k in ANGLES),
     *(f"alpha_{k}_{j}" for k in ("x", "phi") for j in (1, 2))), 0.0)  # fmt: skip


@pytest.fixture(scope="module")
def simulate(tmp_path_factory):
    """Simulate an FMU; every result is a dictionary of arrays, also by name of a vector: shape (n, 3)."""
    unpacked = {}

    def run(model, stop, start=None, signals=None, output=(), h=0.1):
        if model not in unpacked:
            archive = build.build([model])[model]
            folder = fmpy.extract(str(archive), str(tmp_path_factory.mktemp(model)))
            unpacked[model] = folder, fmpy.read_model_description(str(archive))
        folder, description = unpacked[model]
        columns = {"time": h * np.arange(round(stop / h) + 1), **(signals or {})}
        table = np.zeros(len(columns["time"]), dtype=[(n, float) for n in columns])
        for name, values in columns.items():
            table[name] = values
        result = fmpy.simulate_fmu(
            folder, model_description=description, stop_time=stop, output_interval=h,
            input=table if signals else None, start_values=start or {}, output=output,
        )  # fmt: skip
        return {name: result[name] for name in ("time", *output)}

    return run


def vector(name, values):
    return {name: [float(x) for x in values]}


def rate(Omega):
    return {f"Omega_{k}_start": x for k, x in zip(ANGLES, Omega, strict=True)}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_no_checker_finds_a_fault(model, fmi):
    assert checks.problems(build.build([model], fmi=fmi)[model]) == []


# The plant -----------------------------------------------------------------------------------------------


def free_fall(simulate, Omega, h):
    """Largest distance of a free mass from its straight line, and how far it went; likewise its angles."""
    s, v, w = np.array([1e-3, -2e-3, 3e-3]), np.array([2e-5, 1e-5, -3e-5]), np.array([2e-6, -1e-6, 3e-6])
    start = {
        **LOOSE, **ROUND, **rate(Omega), "delta_y": 2e-2, "delta_z": -1e-2,
        **vector("testMass_2.s", s), **vector("testMass_2.v", v), **vector("testMass_2.w", w),
    }  # fmt: skip
    got = simulate("WholePlant", 600, start, output=("testMass_2.s", "testMass_2.w"), h=h)
    # Without forces O stays and the rate stays: in body axes all that is inertial turns by -Omega t.
    back = Rotation.from_rotvec(-np.outer(got["time"], Omega))
    R = np.array([D, 2e-2, -1e-2]) / 2
    straight = R + s + np.outer(got["time"], v + np.cross(Omega, R + s))
    expected = back.apply(straight) - R
    error = np.abs(got["testMass_2.s"] - expected).max(), np.abs(got["testMass_2.w"] - back.apply(w)).max()
    return np.array(error), np.array([np.abs(expected - s).max(), np.abs(back.apply(w) - w).max()])


@pytest.mark.parametrize("size", [1e-4, 1e-3])
def test_free_mass_moves_in_a_straight_line(simulate, size):
    Omega = size * np.array([2, -1, 2]) / 3
    error, moved = free_fall(simulate, Omega, 0.1)
    assert (error < 10 * (0.1 * size) ** 2 * moved).all()
    half, _ = free_fall(simulate, Omega, 0.05)
    np.testing.assert_allclose(half, error / 4, rtol=0.02)


def momenta(simulate, h):
    """Total momentum and angular momentum in inertial axes while the bodies tumble and push each other."""
    m_sc, I_sc, offset = 5.0, np.array([0.5, 0.3, 0.4]), np.array([D, 0.1, -0.2]) / 2
    start = {
        **rate([1e-3, -2e-3, 1.5e-3]), "delta_y": 0.1, "delta_z": -0.2,
        "m_sc": m_sc, **dict(zip(("I_xx_sc", "I_yy_sc", "I_zz_sc"), I_sc, strict=True)),
        "omega2_1_0": 3e-3, "omega2_2_0": 5e-3, "omega2_y": 2e-3, "omega2_z": 4e-3,
        "omega2_theta": 6e-3, "omega2_eta": 2e-3, "omega2_phi": 3e-3, "b_5": 1e-3, "b_6": -2e-3,
        **vector("testMass_1.s", [1e-3, 2e-3, -1e-3]), **vector("testMass_2.s", [-2e-3, 1e-3, 1e-3]),
        **vector("testMass_1.v", [1e-5, 0, 2e-5]), **vector("testMass_2.w", [1e-3, -2e-3, 1e-3]),
        "f_applied_1": 2e-6, "F_applied_y_2": 3e-6, "N_applied_eta_1": 2e-9, "N_applied_theta_2": -3e-9,
    }  # fmt: skip
    parts = [f"testMass_{j}.{n}" for j in (1, 2) for n in "svw"]
    got = simulate("WholePlant", 300, start, output=(*parts, "spacecraft.Omega", "spacecraft.a_O"), h=h)
    time, Omega = got["time"], got["spacecraft.Omega"]
    # Out of the turning axes, and on to velocity and place of O, by integration of what the FMU shows.
    fine = CubicSpline(time, Omega)((np.arange(8 * (len(time) - 1)) + 0.5) * h / 8)
    turns = [Rotation.identity()]
    for steps in Rotation.from_rotvec(fine * h / 8).as_matrix().reshape(-1, 8, 3, 3):
        turns.append(turns[-1] * Rotation.from_matrix(np.linalg.multi_dot(steps)))
    out = Rotation.concatenate(turns).apply
    a_O = CubicSpline(time, out(got["spacecraft.a_O"]))
    V, X = a_O.antiderivative()(time), a_O.antiderivative(2)(time)
    P, L = m_sc * V, np.cross(X, m_sc * V) + out(I_sc * Omega)
    for j, R in ((1, -offset), (2, offset)):
        s, v, w = (got[f"testMass_{j}.{n}"] for n in "svw")
        p = M_TM * (V + out(v + np.cross(Omega, R + s)))
        P, L = P + p, L + np.cross(X + out(R + s), p) + I_TM * out(Omega + w)
    return P, L, m_sc * V, out(I_sc * Omega)


@pytest.mark.slow
def test_momentum_is_conserved_without_external_forces(simulate):
    P, L, exchanged, turned = momenta(simulate, 0.1)
    half = [np.ptp(x, axis=0).max() for x in momenta(simulate, 0.05)[:2]]
    for total, part, smaller in ((P, exchanged, half[0]), (L, turned, half[1])):
        lost = np.ptp(total, axis=0).max()
        # Of the quadratic terms (h omega)^2 is lost, where omega = 0.1/s is the fastest oscillation.
        assert lost < 1e-5 * np.ptp(part, axis=0).max()
        assert smaller == pytest.approx(lost / 4, rel=0.01)


MODES = {
    # degree of freedom: what multiplies omega2 if both test masses move alike, and oppositely
    "x": (1 + 2 * M_TM / M_SC, 1),
    "y": (1 + 2 * M_TM / M_SC, 1 + M_TM * D**2 / (2 * I_SC[2])),
    "z": (1 + 2 * M_TM / M_SC, 1 + M_TM * D**2 / (2 * I_SC[1])),
    **{k: (1 + 2 * I_TM / I_k, 1) for k, I_k in zip(ANGLES, I_SC, strict=True)},
}


@pytest.mark.parametrize("freedom", MODES)
@pytest.mark.parametrize("alike", [True, False])
@pytest.mark.parametrize("omega2", [9e-4, -4e-4])
def test_each_degree_of_freedom_is_an_oscillator(simulate, freedom, alike, omega2):
    i = [*AXES, *ANGLES].index(freedom)
    state, one = "s" if i < 3 else "angle", 1e-9 * np.eye(3)[i % 3]
    stiffness = ("omega2_1_0", "omega2_2_0") if freedom == "x" else (f"omega2_{freedom}",)
    start = {
        **LOOSE, **dict.fromkeys(stiffness, omega2),
        **vector(f"testMass_1.{state}", one if alike else -one), **vector(f"testMass_2.{state}", one),
    }  # fmt: skip
    got = simulate("WholePlant", 100, start, output=(f"{freedom}_2",))
    omega = np.sqrt(complex(omega2 * MODES[freedom][not alike]))
    expected = 1e-9 * np.cos(omega * got["time"]).real
    np.testing.assert_allclose(got[f"{freedom}_2"], expected, atol=1e-9 * 1e-13)


def ramp(t):
    """Integral of the response of the thrusters, of lag 0.15 s, to a step."""
    return t + 0.15 * np.expm1(-t / 0.15)


MOTION = [f"{k}_{j}" for j in (1, 2) for k in (*AXES, *ANGLES)]
THRUST = [*(f"a_{k}_sc" for k in AXES), *(f"Omega_{k}" for k in ANGLES)]
FORCES = {  # input: outputs that could move, the one that does, its delay, its response to a step of 1
    **{f"F_{k}_sc": (THRUST, f"a_{k}_sc", 0.234, lambda t: -np.expm1(-t / 0.15) / M_SC) for k in AXES},
    **{
        f"N_{k}_sc": (THRUST, f"Omega_{angle}", 0.234, lambda t, I_k=I_k: ramp(t) / I_k)
        for k, angle, I_k in zip(AXES, ANGLES, I_SC, strict=True)
    },
    "f_applied_1": (MOTION, "x_1", 0.14, lambda t: t**2 / 2),
    "f_applied_2": (MOTION, "x_2", 0.16, lambda t: t**2 / 2),
    **{
        f"F_applied_{k}_{j}": (MOTION, f"{k}_{j}", 0.123, lambda t: t**2 / 2 / M_TM)
        for j in (1, 2)
        for k in "yz"
    },
    **{
        f"N_applied_{k}_{j}": (MOTION, f"{k}_{j}", 0.123, lambda t: t**2 / 2 / I_TM)
        for j in (1, 2)
        for k in ANGLES
    },
}


@pytest.mark.parametrize("force", FORCES)
def test_each_force_acts_after_its_delay_and_lag(simulate, force):
    output, moved, delay, response = FORCES[force]
    size = 1e-6 if output is THRUST else 1e-9
    start = {**LOOSE, "tau_sc": 0.234, "T_sc": 0.15, "tau_1": 0.14, "tau_2": 0.16, "tau_es": 0.123}
    if output is MOTION:  # without recoil of the spacecraft
        start |= dict.fromkeys(("m_sc", "I_xx_sc", "I_yy_sc", "I_zz_sc"), 1e15)
    step = {"time": np.array([0, 0.9, 1, 5]), force: np.array([0, 0, size, size])}
    got = simulate("WholePlant", 5, start, step, output=output)
    expected = size * response(np.clip(got["time"] - 1 - delay, 0, None))
    for name in output:
        np.testing.assert_allclose(got[name], expected if name == moved else 0, atol=1e-12 * expected.max())


def test_along_x_it_is_the_plant_along_x(simulate):
    sizes = {"f_applied_1": 1e-11, "f_applied_2": 1e-11, "F_x_sc": 1e-6, "g_1": 1e-13, "g_2": 1e-13,
             "F_noise_x_sc": 1e-6}  # fmt: skip
    rng = np.random.default_rng(5)
    signals = {name: size * rng.standard_normal(5001) for name, size in sizes.items()}
    start = {"F_max_1": 1e-9, "tau_1": 0.17, "T_sc": 0.3}
    wanted = simulate("Plant", 500, start, signals, output=("x_1", "x_2", "a_SC"))
    got = simulate("WholePlant", 500, start, signals, output=("x_1", "x_2", "a_x_sc", "y_1", "Omega_eta"))
    for name, other in (("x_1", "x_1"), ("x_2", "x_2"), ("a_x_sc", "a_SC")):
        np.testing.assert_allclose(got[name], wanted[other], atol=1e-12 * np.abs(wanted[other]).max())
    assert not got["y_1"].any()
    assert not got["Omega_eta"].any()


APPARENT = {  # rate [rad/s] and angular acceleration [rad/s2]: apparent acceleration x_2'' - x_1''
    "centrifugal phi": (rate([0, 0, 2e-5]), {}, 4e-10 * D),
    "centrifugal eta": (rate([0, -2e-5, 0]), {}, 4e-10 * D),
    "none by theta": (rate([3e-5, 0, 0]), {}, 0),
    "Euler phi": ({}, {"N_noise_z_sc": 1e-9}, 1e-9 * 2e-3),
    "Euler eta": ({}, {"N_noise_y_sc": 1e-9}, 1e-9 * 1e-3),
    "none by dOmega_theta": ({}, {"N_noise_x_sc": 1e-9}, 0),
}


@pytest.mark.parametrize("case", APPARENT)
def test_rotation_pulls_the_test_masses_apart(simulate, case):
    start, torques, expected = APPARENT[case]
    signals = {name: np.full(101, 200 * dOmega) for name, dOmega in torques.items()}
    offsets = {"delta_y": 2e-3, "delta_z": -1e-3}
    got = simulate("WholePlant", 10, {**LOOSE, **ROUND, **offsets, **start}, signals, ("x_1", "x_2"))
    apart = got["x_2"] - got["x_1"]
    np.testing.assert_allclose(apart, expected * got["time"] ** 2 / 2, atol=1e-3 * 50 * max(expected, 1e-12))


def test_lateral_place_pulls_along_x(simulate):
    places = {**vector("testMass_1.s", [0, 2e-6, 0]), **vector("testMass_2.s", [0, 0, 4e-6])}
    start = {**LOOSE, **places, "m_sc": 1e9, "b_5": 3e-7, "b_6": -2e-7}
    got = simulate("WholePlant", 10, start, output=("x_1", "x_2"))
    expected = -(3e-7 * 1e-6 - 2e-7 * 2e-6) * got["time"] ** 2 / 2
    np.testing.assert_allclose(got["x_2"], expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(got["x_1"]).max() < 1e-7 * np.abs(expected).max()


# Sensors and actuators ------------------------------------------------------------------------------------


def test_read_outs_are_positions_and_noise(simulate):
    names = [f"{k}_{j}" for j in (1, 2) for k in (*AXES, *ANGLES)]
    true = {n: (i + 1) * 1e-9 for i, n in enumerate(names)}
    noise = {f"n_grs_{n}": (3 * i + 1) * 1e-10 for i, n in enumerate(names)}
    got = simulate("InertialSensor", 0.1, {**true, **noise}, output=[f"grs_{n}" for n in names])
    for n in names:
        assert got[f"grs_{n}"][-1] == true[n] + noise[f"n_grs_{n}"]
    true = {"Theta": 1e-3, "Eta": 2e-3, "Phi": 4e-3}
    noise = {"n_ast_theta": 5e-5, "n_ast_eta": 6e-5, "n_ast_phi": 7e-5}
    got = simulate("StarTracker", 0.1, {**true, **noise}, output=[f"ast_{k}" for k in ANGLES])
    assert [got[f"ast_{k}"][-1] for k in ANGLES] == [1e-3 + 5e-5, 2e-3 + 6e-5, 4e-3 + 7e-5]


def test_jitter_couples_into_the_differential_read_out(simulate):
    still = simulate("WholeMetrology", 0.1, {"x_1": 2e-9, "x_2": 5e-9, "delta_ifo": 1e-2}, output=("o_12",))
    assert still["o_12"][-1] == pytest.approx(3e-9 + 2e-11, rel=1e-12)
    b = {"phi": "b_1", "eta": "b_2", "y": "b_3", "z": "b_4"}
    for k, coefficient in b.items():
        start = {"delta_ifo": 0, coefficient: 2e-5, f"{k}_1": 1e-8, f"{k}_2": 5e-8, "n_12": 7e-14}
        got = simulate("WholeMetrology", 0.1, start, output=("o_12",))
        assert got["o_12"][-1] == pytest.approx(7e-14 - 2e-5 * 3e-8, rel=1e-12), k
    true = {"phi_1": 1e-8, "phi_2": 4e-8, "eta_1": 2e-8}
    noise = {"n_phi_1": 1e-10, "n_phi_12": 2e-10, "n_eta_12": 3e-10}
    got = simulate(
        "WholeMetrology", 0.1, {**true, **noise}, output=("o_phi_1", "o_phi_12", "o_eta_1", "o_eta_12")
    )
    expected = [1.01e-8, 3.02e-8, 2e-8, -1.97e-8]
    np.testing.assert_allclose([got[n][-1] for n in got if n != "time"], expected, rtol=1e-12)


def test_commands_stay_within_their_authority(simulate):
    start = {"F_max_yz": 5e-11, "N_max_theta": 1e-12, "N_max_eta": 2e-12, "N_max_1": 3e-12, "N_max_2": 4e-12,
             "F_max_1": 6e-12, "F_max_2": 7e-12, "lambda_1": 1.1, "lambda_2": 1.2, "lambda_N": 1.3,
             "leak_phi_1": 40.0, "kappa_phi": 30.0, "kappa_eta": -20.0, "f_x_1_jitter": 1e-14}  # fmt: skip
    limits = {
        **{f"F_{k}_{j}": 5e-11 for j in (1, 2) for k in "yz"},
        **{f"N_theta_{j}": 1e-12 for j in (1, 2)}, **{f"N_eta_{j}": 2e-12 for j in (1, 2)},
        "N_phi_1": 3e-12, "N_phi_2": 4e-12,
    }  # fmt: skip
    gains = {n: 1.3 if n[0] == "N" else {"1": 1.1, "2": 1.2}[n[-1]] for n in limits}
    output = [*limits, *(n.replace("_", "_applied_", 1) for n in limits)]
    along_x = ("f_x_1", "f_x_2", "f_applied_1", "f_applied_2")
    for share in (-3, -0.5, 0.25, 2):
        asked = {n.replace("_", "_control_", 1): share * limit for n, limit in limits.items()}
        asked |= {"F_x_1": share * 6e-12, "F_x_2": 2 * share * 7e-12, "f_control_2": -share * 7e-12 / M_TM}
        got = simulate("WholeActuation", 0.1, {**start, **asked}, output=(*output, *along_x))
        within = np.clip(share, -1, 1)
        for n, limit in limits.items():
            assert got[n][-1] == pytest.approx(within * limit, rel=1e-14), n
            assert got[n.replace("_", "_applied_", 1)][-1] == pytest.approx(gains[n] * within * limit), n
        f_x_1 = within * (6e-12 + 40 * 3e-12) / M_TM + 1e-14
        f_x_2 = within * 7e-12 / M_TM
        crossed = within * (30 * 4e-12 - 20 * 2e-12) / M_TM
        expected = f_x_1, f_x_2, 1.1 * f_x_1, 1.2 * f_x_2 + crossed
        np.testing.assert_allclose([got[n][-1] for n in along_x], expected, rtol=1e-13)


# Controllers ----------------------------------------------------------------------------------------------


def law(f_u, zeros, poles, integrators=1):
    """Frequency response of a controller of unity gain f_u, as the bilinear rule samples it at 10 Hz."""

    def shape(s):
        over = np.prod([s + 2 * np.pi * f for f in zeros])
        return over / (s**integrators * np.prod([1 + s / (2 * np.pi * f) for f in poles]))

    def response(f):
        u = 2 * np.pi * f_u
        return u**2 / abs(shape(1j * u)) * shape(20j * np.tan(np.pi * f * 0.1))

    return response


def drag_free_inputs(x, y, z, theta, eta, phi):
    return {
        "o_1": 0.75 * x, "guidance_o_1": -0.25 * x, "grs_theta_1": theta,
        "grs_y_1": y - phi * D / 2, "grs_y_2": y + phi * D / 2,
        "grs_z_1": z + eta * D / 2, "grs_z_2": z - eta * D / 2,
    }  # fmt: skip


def suspension_inputs(x, eta_1, phi_1, theta_2, eta_2, phi_2):
    return {
        "o_12": 0.75 * x, "guidance_o_12": -0.25 * x, "grs_theta_2": theta_2,
        "o_eta_1": eta_1, "o_eta_12": eta_2 - eta_1, "o_phi_1": phi_1, "o_phi_12": phi_2 - phi_1,
    }  # fmt: skip


def attitude_inputs(theta, eta, phi):
    return {
        "ast_theta": 0.75 * theta, "attitude_theta": -0.25 * theta,
        "ast_eta": 0.75 * eta, "attitude_eta": -0.25 * eta,
        "ast_phi": 0.75 * phi, "attitude_phi": -0.25 * phi,
    }  # fmt: skip


K_X, K_ROT = law(0.08, (0.03, 0.006), (0.8, 2)), law(0.03, (9e-3, 1.8e-3), (0.24, 0.6))
K_X_2, K_ANGLE = law(1e-3, (0.3e-3, 0.06e-3), (6e-3, 30e-3)), law(2e-3, (0.6e-3, 0.12e-3), (12e-3, 60e-3))
L = law(0.07e-3, (0.021e-3,), [0.42e-3] * 3, integrators=0)
# model: inputs that make the errors; the cycles of each error in a window; its length and that of the time
# to settle before it [samples]; each output with its error, gain and law; start values
CONTROLLERS = {
    "WholeDragFreeControl": (
        drag_free_inputs, (8, 3, 5, 10, 20, 40), 1000, 300,
        {"F_x_sc": (0, M_SC, K_X), "F_y_sc": (1, M_SC, K_ROT), "F_z_sc": (2, M_SC, K_ROT),
         "N_x_sc": (3, I_SC[0], K_ROT), "N_y_sc": (4, I_SC[1], K_ROT), "N_z_sc": (5, I_SC[2], K_ROT)},
        {},
    ),
    "WholeSuspensionControl": (
        suspension_inputs, (1, 2, 3, 4, 5, 7), 10_000, 10_000,
        {"f_control_2": (0, -1, K_X_2), "N_control_eta_1": (1, -I_TM, K_ANGLE),
         "N_control_phi_1": (2, -I_TM, K_ANGLE), "N_control_theta_2": (3, -I_TM, K_ANGLE),
         "N_control_eta_2": (4, -I_TM, K_ANGLE), "N_control_phi_2": (5, -I_TM, K_ANGLE)},
        {"f_x_2_start": 1e-11},
    ),
    "AttitudeControl": (
        attitude_inputs, (1, 2, 4), 20_000, 80_000,
        {"N_control_theta_1": (0, -I_TM, L),
         "F_control_z_1": (1, -M_TM * D / 2, L), "F_control_z_2": (1, M_TM * D / 2, L),
         "F_control_y_1": (2, M_TM * D / 2, L), "F_control_y_2": (2, -M_TM * D / 2, L)},
        {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("model", CONTROLLERS)
def test_controller_has_the_frequency_response_of_its_law(simulate, model):
    inputs, cycles, window, settle, laws, start = CONTROLLERS[model]
    frequencies = np.array(cycles) / (0.1 * window)
    n = np.arange(settle + window + 1)
    errors = [1e-9 * np.cos(2 * np.pi * f * 0.1 * n) for f in frequencies]
    got = simulate(model, 0.1 * (settle + window), start, inputs(*errors), laws)
    kept = np.exp(-2j * np.pi * np.outer(frequencies, 0.1 * n[settle:-1])) * 2 / window
    for output, (error, gain, response) in laws.items():
        expected = [1e-9 * gain * response(f) * (i == error) for i, f in enumerate(frequencies)]
        answer = kept @ got[output][settle + 1 :]  # to sample n, seen at the end of its step
        np.testing.assert_allclose(answer, expected, atol=1e-7 * abs(expected[error]))
