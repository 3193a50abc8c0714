"""The plant of the whole spacecraft as an FMU against closed forms: free fall, conservation laws, forces."""

import fmpy
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from lpfcosim.modelica import build

pytestmark = [pytest.mark.fmu, pytest.mark.slow]

M_TM, I_TM, D = 1.928, 6.80e-4, 0.376
ANGLES = ("theta", "eta", "phi")
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
        scalars = {v.name for v in description.modelVariables}
        parts = {name: [name] if name in scalars else [f"{name}[{i}]" for i in (1, 2, 3)] for name in output}
        elements = [part for names in parts.values() for part in names]
        result = fmpy.simulate_fmu(
            folder, model_description=description, stop_time=stop, output_interval=h,
            input=table if signals else None, start_values=start or {}, output=elements,
        )  # fmt: skip
        series = {name: np.stack([result[part] for part in names], axis=-1) for name, names in parts.items()}
        return {"time": result["time"], **{n: x[:, 0] if x.shape[1] == 1 else x for n, x in series.items()}}

    return run


def vector(name, values):
    return {f"{name}[{i}]": float(x) for i, x in enumerate(values, start=1)}


def rate(Omega):
    return {f"Omega_{k}_start": x for k, x in zip(ANGLES, Omega, strict=True)}


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
