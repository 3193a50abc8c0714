"""Every FMU against an exact solution, an hour at 0.1 s; instances, saved states, another compiler.

    python -m tests.lpfcosim.modelica.test_numerics        prints the errors of six hours as a table

Oracle. It shares nothing with the FMUs but the equations. The plant is the matrix exponential of the whole
system, held commands included, taken at 50 digits over the intervals between the switches of the delayed
forces. A compensator is the bilinear rule put into the factors of K(s), one after the other, where the FMU
adds partial fractions. Metrology and actuation are their formulas. The recursions run in extended precision
(a mantissa of 64 bits); what they round is below 1e-14.

Judged. The largest error of any output at any step, relative to the largest value that this output has had
until then: below 1e-10. Actuation is not linear, for it clips; the bound is the same.

The plant appears twice. Stable (the signs of both stiffnesses turned), without damping, it moves by
nanometres. With the stiffness of flight and nothing that controls it, its motion grows by e^20 and e^26 in
six hours, and so does whatever was rounded at the start: there the error can only be small beside the motion
of its transition time, which is what the measure asks for.
"""

import contextlib
import shutil
import sys
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path

import fmpy
import mpmath as mp
import numpy as np
import pytest

from lpfcosim.modelica import build, compiler
from tests.oracles.fmpy_loop import Slave

pytestmark = pytest.mark.fmu

H = 0.1  # s
N = 216_000 if __name__ == "__main__" else 36_000  # six hours, or one
SHORT = 2000
BOUND = 1e-10
M_TM, M_SC = 1.928, 422.7  # kg


@dataclass(frozen=True)
class Case:
    """One model in one setting; ``inputs`` with their size per unit of displacement or acceleration."""

    model: str
    inputs: dict[str, float]
    outputs: tuple[str, ...]
    parameters: dict[str, float]


_PLANT = (
    {"f_applied_1": 1.0, "f_applied_2": 1.0, "F_x_sc": M_SC, "g_1": 1.0, "g_2": 1.0, "F_noise_x_sc": M_SC},
    ("x_1", "x_2", "a_SC"),
)
_FLIGHT = {
    "m_sc": M_SC, "m_tm": M_TM, "tau_1": 0.149 / 1.0748 - H / 2, "tau_2": 0.186 / 1.0776 - H / 2,
    "omega2_1_0": -3.99e-7, "omega2_2_0": -4.19e-7, "alpha_x_1": -345.0, "alpha_x_2": -317.0,
    "alpha_phi_1": -28.2e3, "alpha_phi_2": -27.4e3, "F_max_1": 1100e-12, "F_max_2": 2200e-12,
    "N_max_1": 1.5e-12, "N_max_2": 10.4e-12, "tau_sc": 0.25, "T_sc": 0.1,
}  # fmt: skip
CASES = {
    "OpticalMetrology": Case(
        "OpticalMetrology",
        {"x_1": 1.0, "x_2": 1.0, "n_1": 1e-4, "n_12": 1e-4},
        ("o_1", "o_12"),
        {"delta_ifo": -2.2e-5},
    ),
    "DragFreeControl": Case(
        "DragFreeControl",
        {"o_1": 1.0, "guidance_o_1": 1.0},
        ("F_x_sc",),
        {"h": H, "m_sc": M_SC, "f_u": 0.08, "f_z": 0.03, "f_i": 0.006, "f_p": 0.8, "f_r": 2.0},
    ),
    "SuspensionControl": Case(
        "SuspensionControl",
        {"o_12": 1.0, "guidance_o_12": 1.0},
        ("f_control_2",),
        {"h": H, "f_x_2_start": 1e-14, "f_u": 1e-3, "f_z": 0.3e-3, "f_i": 0.06e-3, "f_p": 6e-3, "f_r": 30e-3},
    ),
    "Actuation": Case(
        "Actuation",
        {"f_control_2": 1.0, "F_x_1": M_TM, "F_x_2": M_TM, "f_x_1_jitter": 1e-3},
        ("f_x_1", "f_x_2", "f_applied_1", "f_applied_2"),
        {"h": H, "m_tm": M_TM, "lambda_1": 1.0748, "lambda_2": 1.0776, "F_max_1": 1e-10, "F_max_2": 2e-10},
    ),
    "Plant, stable": Case("Plant", *_PLANT, {name: abs(value) for name, value in _FLIGHT.items()}),
    "Plant, as in flight": Case("Plant", *_PLANT, _FLIGHT),
}  # fmt: skip


@cache
def drive(name):
    """Inputs, shape (N, number of inputs): 0.3 nm at each of four frequencies, or that as acceleration."""
    case = CASES[name]
    t = np.arange(N) * H
    columns = []
    for i, size in enumerate(case.inputs.values()):
        w = 2 * np.pi * np.array([0.9e-3, 4.1e-3, 17e-3, 97e-3]) * (1 + 0.07 * i)
        # A cosine of acceleration moves a mass at rest to and fro; a sine would also throw it away.
        scale, phase = (w**2, 0.0) if case.model in ("Plant", "Actuation") else (np.ones(4), i)
        columns.append(sum(0.3e-9 * size * a * np.cos(f * t + phase) for a, f in zip(scale, w, strict=True)))
    return np.column_stack(columns)


def archive(name):
    model = CASES[name].model
    return build.build([model])[model]


@contextlib.contextmanager
def stepper(name, path):
    """Yield an instance and a function that steps it, its inputs zero until the first step."""
    with contextlib.ExitStack() as stack:
        fmu = Slave(stack, path, CASES[name].parameters)
        inputs, outputs = (
            [fmu.references[variable] for variable in names]
            for names in (CASES[name].inputs, CASES[name].outputs)
        )
        fmu.exitInitializationMode()

        def step(first, n):
            """Outputs after each of ``n`` steps from number ``first`` on, shape (n, number of outputs)."""
            rows = np.empty((n, len(outputs)))
            for k, values in enumerate(drive(name)[first : first + n].tolist()):
                fmu.setReal(inputs, values)
                fmu.doStep((first + k) * H, H)
                rows[k] = fmu.getReal(outputs)
            return rows

        yield fmu, step


def outputs(name, n, path):
    """Outputs of an FMU after each of the first ``n`` steps."""
    with stepper(name, path) as (_, step):
        return step(0, n)


@cache
def simulated(name):
    """Outputs of an FMU over all steps, or over some minutes of those that keep no state."""
    stateless = CASES[name].model in ("OpticalMetrology", "Actuation")
    return outputs(name, SHORT if stateless else N, archive(name))


def extended(values):
    """Numbers with a mantissa of 64 bits."""
    values = np.asarray(values)
    if values.dtype != object:
        return values.astype(np.longdouble)
    return np.array([np.longdouble(mp.nstr(v, 25)) for v in values.flat]).reshape(values.shape)


def plant(p, u, to):
    """The three-body plant: x_1, x_2, a_SC at the end of every step."""
    p = {name: mp.mpf(value) for name, value in p.items()}
    # Columns: x_1, v_1, x_2, v_2, F_thrust, then all that is held: f_1, f_2, F_x_sc, g_1, g_2, F_noise.
    force_1, force_2, a_SC, rates = mp.zeros(1, 11), mp.zeros(1, 11), mp.zeros(1, 11), mp.zeros(11)
    for j, force in ((1, force_1), (2, force_2)):
        omega2 = (
            p[f"omega2_{j}_0"] + p[f"alpha_x_{j}"] * p[f"F_max_{j}"] + p[f"alpha_phi_{j}"] * p[f"N_max_{j}"]
        )
        force[2 * j - 2], force[4 + j], force[7 + j] = -omega2, 1, 1
    a_SC[4] = a_SC[10] = 1 / p["m_sc"]
    a_SC -= p["m_tm"] / p["m_sc"] * (force_1 + force_2)
    rates[0, 1] = rates[2, 3] = 1
    rates[1, :], rates[3, :] = force_1 - a_SC, force_2 - a_SC
    rates[4, 4], rates[4, 7] = -1 / p["T_sc"], 1 / p["T_sc"]

    delays = [p["tau_1"], p["tau_2"], p["tau_sc"]]
    whole = [int(mp.floor(d / H)) for d in delays]
    switch = [d - n * mp.mpf(H) for d, n in zip(delays, whole, strict=True)]
    # Columns of a step: states, the three commands before their switch and after it, g_1, g_2, F_noise.
    step = mp.zeros(5, 14)
    step[:, :5] = mp.eye(5)
    times = sorted({mp.mpf(0), *switch, mp.mpf(H)})
    for start, end in pairwise(times):
        e = mp.expm(rates * (end - start))
        step = e[:5, :5] * step
        for j in range(3):
            step[:, 5 + j + (3 if start >= switch[j] else 0)] += e[:5, 5 + j]
            step[:, 11 + j] += e[:5, 8 + j]
    change = step.copy()
    change[:, :5] -= mp.eye(5)

    u = to(u)
    late = [np.concatenate([to(np.zeros(n + 1)), u[:, j]]) for j, n in enumerate(whole)]
    held = np.column_stack([*(c[:N] for c in late), *(c[1 : N + 1] for c in late), u[:, 3:]])
    transition = to(np.array(change[:, :5].tolist()))
    pushed = held @ to(np.array(change[:, 5:].tolist())).T
    x, states = to(np.zeros(5)), np.empty((N, 5), dtype=pushed.dtype)
    for n in range(N):
        x = x + (transition @ x + pushed[n])
        states[n] = x
    acceleration = np.column_stack([states, held[:, 3:]]) @ to(np.array(a_SC.tolist()[0]))
    return np.column_stack([states[:, 0], states[:, 2], acceleration])


def compensator(p, error, to):
    """K(s) = k (s+wz)(s+wi) / [s (1+s/wp)(1+s/wr)] with |K| = w^2 at the unity gain, by the bilinear rule."""
    u, wz, wi, wp, wr = (2 * mp.pi * mp.mpf(p[f"f_{name}"]) for name in "uzipr")
    factors = [((1, wz), (1, 0)), ((1, wi), (1 / wp, 1)), ((0, 1), (1 / wr, 1))]  # (b s + c)/(d s + e)
    rate = 2 / mp.mpf(p["h"])  # s = rate (1 - q)/(1 + q), where q delays by a sample
    k = u**2
    for b, a in factors:
        k *= abs((a[0] * 1j * u + a[1]) / (b[0] * 1j * u + b[1]))
        new, last, old = to(
            np.array([b[1] + b[0] * rate, b[1] - b[0] * rate, a[0] * rate - a[1]]) / (a[0] * rate + a[1])
        )
        driven = new * error
        driven[1:] += last * error[:-1]
        error = np.array([*accumulate(driven, lambda y, d, old=old: old * y + d)])
    return to(np.array(k)) * error


def exact(name, to):
    """Outputs of a case in the numbers that ``to`` makes, shape (N, number of outputs)."""
    p = {key: to(value) for key, value in CASES[name].parameters.items()}
    u = to(drive(name))
    if name == "OpticalMetrology":
        x_1, x_2, n_1, n_12 = u.T
        return np.column_stack([x_1 + n_1, x_2 - x_1 + p["delta_ifo"] * x_1 + n_12])
    if name == "Actuation":
        f_control_2, F_1, F_2, jitter = u.T
        f_1 = np.clip(F_1, -p["F_max_1"], p["F_max_1"]) / p["m_tm"] + jitter
        f_2 = np.clip(p["m_tm"] * f_control_2 + F_2, -p["F_max_2"], p["F_max_2"]) / p["m_tm"]
        return np.column_stack([f_1, f_2, p["lambda_1"] * f_1, p["lambda_2"] * f_2])
    if CASES[name].model == "Plant":
        return plant(CASES[name].parameters, drive(name), to)
    a = compensator(CASES[name].parameters, u[:, 0] - u[:, 1], to)
    expected = p["m_sc"] * a if name == "DragFreeControl" else p["f_x_2_start"] - a
    return expected[:, None]


@cache
def oracle(name):
    """Outputs of a case in extended precision."""
    if np.finfo(np.longdouble).nmant < 63:
        pytest.skip("this machine has no extended precision")
    with mp.workdps(50):
        return exact(name, extended)


def relative_error(got, expected):
    """Largest error, relative to the largest value that an output has had until then."""
    expected = expected[: len(got)]
    until_then = np.maximum.accumulate(np.abs(expected))
    return float(np.max(np.abs(got - expected) / np.where(until_then > 0, until_then, 1)))


@pytest.mark.parametrize("name", CASES)
def test_outputs_are_those_of_the_exact_solution(name):
    assert relative_error(simulated(name), oracle(name)) < BOUND


def test_the_cases_are_what_they_are_meant_to_be():
    motion = np.abs(oracle("Plant, stable")[:, :2])
    assert 1e-9 < motion.max() < 1e-8
    assert motion[N // 2 :].max() > 0.5 * motion.max()  # nothing has died away
    f_x_2 = np.abs(oracle("Actuation")[:, 1])
    limit = CASES["Actuation"].parameters["F_max_2"] / M_TM
    assert 0.1 < np.mean(f_x_2 > 0.999999 * limit) < 0.9  # at times it clips


@pytest.mark.parametrize("name", ["Plant, stable", "SuspensionControl"])
def test_instances_are_independent_and_a_reset_or_a_saved_state_gives_the_same_bits(name):
    with stepper(name, archive(name)) as (fmu, step), stepper(name, archive(name)) as (_, other_step):
        step(0, 40)
        fmu.reset()
        fmu.initialize(CASES[name].parameters)
        fmu.exitInitializationMode()
        other_step(0, 7)
        before = step(0, 40)
        other_step(7, 7)
        state = fmu.getFMUState()
        step(40, 7)
        fmu.setFMUState(state)
        fmu.freeFMUState(state)
        after = step(40, 40)
    np.testing.assert_array_equal(np.concatenate([before, after]), outputs(name, 80, archive(name)))


def test_outputs_follow_the_inputs_without_a_step():
    with contextlib.ExitStack() as stack:
        metrology = Slave(stack, archive("OpticalMetrology"), {})
        metrology.exitInitializationMode()
        for value in (1e-9, 2e-9):
            metrology.set({"x_1": value})
            assert metrology.get(["o_1"]) == [value]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Plant, stable", "DragFreeControl"])
def test_another_compiler_gives_the_same_bits(name, tmp_path, monkeypatch):
    pytest.importorskip("ziglang")
    if "zig" in compiler.compiler().version:
        pytest.skip("there is no other compiler than zig")
    folder = Path(fmpy.extract(str(archive(name)), str(tmp_path / "fmu")))
    (binary,) = folder.glob(f"binaries/*/*{fmpy.sharedLibraryExtension}")
    before = binary.read_bytes()
    monkeypatch.setattr(compiler, "compiler", compiler.zig)
    compiler.compile_library(folder / "sources" / "all.c", binary)
    assert binary.read_bytes() != before
    path = shutil.make_archive(str(tmp_path / "other"), "zip", folder)
    np.testing.assert_array_equal(outputs(name, SHORT, path), simulated(name)[:SHORT])


def main():
    """Print the errors as a table in Markdown."""
    for name in CASES:
        sys.stdout.write(f"| {name} | {relative_error(simulated(name), oracle(name)):.1e} |\n")


if __name__ == "__main__":
    main()
