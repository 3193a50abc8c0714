"""Every FMU against an exact solution, six hours at 0.1 s; saved states, other instances, another compiler.

    python -m tests.lpfcosim.modelica.test_numerics        prints the errors as a table

Oracle. It shares nothing with the FMUs but the equations. The plant is the matrix exponential of the whole
system, held commands included, taken at 50 digits over the intervals between the switches of the delayed
forces. A compensator is the bilinear rule put into the factors of K(s), one after the other, where the FMU
adds partial fractions. Metrology and actuation are their formulas. The recursions run in extended precision
(a mantissa of 64 bits); what they round is below 1e-14, which a slow test shows with 30 digits.

Judged. The largest error of any output at any step, relative to the largest value that this output has had
until then: below 1e-10. Actuation is not linear, for it clips; the bound is the same.

The plant appears twice. Stable (the signs of both stiffnesses turned), without damping, it moves by
nanometres for six hours. With the stiffness of flight and nothing that controls it, its motion grows by e^20
and e^26 in that time, and so does whatever was rounded at the start: there the error can only be small beside
the motion of its transition time, which is what the measure asks for.
"""

import contextlib
import ctypes
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, count, pairwise
from pathlib import Path

import fmpy
import mpmath as mp
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lpfcosim.modelica import build, compiler

pytestmark = pytest.mark.fmu

H = 0.1  # s
N = 216_000  # six hours
HALF = N // 2
HOUR = N // 6
BOUND = 1e-10
VERSIONS = ("2.0", "3.0")
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
MODELS = [name for name in CASES if name != "Plant, as in flight"]  # each once
each_model = pytest.mark.parametrize("name", MODELS)
each_version = pytest.mark.parametrize("fmi", VERSIONS)


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


class Instance:
    """An FMU under plain FMPy, its inputs zero until the first step."""

    def __init__(self, stack, folder, case, parameters):
        description = fmpy.read_model_description(folder)
        reference = {v.name: v.valueReference for v in description.modelVariables}
        self._inputs = (ctypes.c_uint32 * len(case.inputs))(*(reference[n] for n in case.inputs))
        self._outputs = (ctypes.c_uint32 * len(case.outputs))(*(reference[n] for n in case.outputs))
        self._two = description.fmiVersion == "2.0"
        self.fmu = (FMU2Slave if self._two else FMU3Slave)(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        stack.callback(self.fmu.freeLibrary)
        self.fmu.instantiate()
        free = self.fmu.fmi2FreeInstance if self._two else self.fmu.fmi3FreeInstance
        stack.callback(free, self.fmu.component)
        if self._two:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        put = self.fmu.setReal if self._two else self.fmu.setFloat64
        put([reference[p] for p in parameters], list(parameters.values()))
        self.fmu.exitInitializationMode()

    def run(self, inputs, first=0):
        """Outputs after each of the steps from number ``first`` on, shape (steps, number of outputs)."""
        n_u, n_y = len(self._inputs), len(self._outputs)
        outputs = np.empty((len(inputs), n_y))
        put, step, get = self._functions()
        component, refused = self.fmu.component, 0
        ins, outs = (ctypes.addressof(self._inputs), n_u), (ctypes.addressof(self._outputs), n_y)
        more_u, more_y = ((), ()) if self._two else ((n_u,), (n_y,))
        told = [ctypes.c_double() for _ in range(4)]  # room for what a step of FMI 3.0 tells
        end = (H, 1) if self._two else (H, True, *map(ctypes.addressof, told))
        rows_u = count(inputs.ctypes.data, 8 * n_u)
        rows_y = count(outputs.ctypes.data, 8 * n_y)
        for i, u, y in zip(range(first, first + len(inputs)), rows_u, rows_y, strict=False):
            refused |= put(component, *ins, u, *more_u)
            refused |= step(component, i * H, *end)
            refused |= get(component, *outs, y, *more_y)
        assert refused == 0
        return outputs

    def _functions(self):
        """The three functions of a step without FMPy around them, which would take minutes."""
        real, size, pointer = ctypes.c_double, ctypes.c_size_t, ctypes.c_void_p
        if self._two:
            names, more = ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal"), ()
            end = (ctypes.c_int,)
        else:
            names, more = ("fmi3SetFloat64", "fmi3DoStep", "fmi3GetFloat64"), (size,)
            end = (ctypes.c_bool, pointer, pointer, pointer, pointer)
        values = (pointer, size, pointer, *more)
        for name, arguments in zip(names, (values, (real, real, *end), values), strict=True):
            address = ctypes.cast(getattr(self.fmu.dll, name), pointer).value
            yield ctypes.CFUNCTYPE(ctypes.c_int, pointer, *arguments)(address)


@contextlib.contextmanager
def unpacked(name, fmi):
    """Folder of the unpacked FMU of a case."""
    model = CASES[name].model
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        fmpy.extract(str(build.build([model], fmi=fmi)[model]), folder)
        yield folder


@contextlib.contextmanager
def instances(name, folder, *parameters):
    """Instances of one library, one for each set of parameters."""
    with contextlib.ExitStack() as stack:
        yield [Instance(stack, folder, CASES[name], p) for p in parameters]


def others(name):
    """Parameters of another instance, all but the step different."""
    return {p: value if p == "h" else 1.1 * value for p, value in CASES[name].parameters.items()}


@cache
def six_hours(name, fmi):
    """Outputs of an FMU, and its state in the middle as bytes."""
    with unpacked(name, fmi) as folder, instances(name, folder, CASES[name].parameters) as [instance]:
        first = instance.run(drive(name)[:HALF])
        state = instance.fmu.getFMUState()
        saved = instance.fmu.serializeFMUState(state)
        instance.fmu.freeFMUState(state)
        return np.concatenate([first, instance.run(drive(name)[HALF:], HALF)]), saved


def extended(values):
    """Numbers with a mantissa of 64 bits."""
    values = np.asarray(values)
    if values.dtype != object:
        return values.astype(np.longdouble)
    return np.array([np.longdouble(mp.nstr(v, 25)) for v in values.flat]).reshape(values.shape)


def arbitrary(values):
    """Numbers of mpmath."""
    values = np.asarray(values)
    return np.array([mp.mpf(v) for v in values.ravel().tolist()], dtype=object).reshape(values.shape)


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
    wanted = p["m_sc"] * a if name == "DragFreeControl" else p["f_x_2_start"] - a
    return wanted[:, None]


@cache
def oracle(name):
    """Outputs of a case in extended precision."""
    if np.finfo(np.longdouble).nmant < 63:
        pytest.skip("this machine has no extended precision")
    with mp.workdps(50):
        return exact(name, extended)


def relative_error(got, wanted):
    """Largest error, relative to the largest value that an output has had until then."""
    until_then = np.maximum.accumulate(np.abs(wanted))
    return float(np.max(np.abs(got - wanted) / np.where(until_then > 0, until_then, 1)))


def errors():
    """Relative error of every case, by its name and the version of FMI."""
    return {(n, fmi): relative_error(six_hours(n, fmi)[0], oracle(n)) for n in CASES for fmi in VERSIONS}


@pytest.mark.parametrize("name", CASES)
@each_version
def test_six_hours_against_the_exact_solution(name, fmi):
    assert relative_error(six_hours(name, fmi)[0], oracle(name)) < BOUND


def test_the_cases_are_what_they_are_meant_to_be():
    motion = np.abs(oracle("Plant, stable")[:, :2])
    assert 1e-9 < motion.max() < 1e-8
    assert motion[HALF:].max() > 0.5 * motion.max()  # nothing has died away
    f_x_2 = np.abs(oracle("Actuation")[:, 1])
    limit = CASES["Actuation"].parameters["F_max_2"] / M_TM
    assert 0.1 < np.mean(f_x_2 > 0.999999 * limit) < 0.9  # at times it clips
    assert np.all(np.abs(oracle("Plant, as in flight")[-1, :2]) > 1e-9 * np.exp(19))


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_rounding_of_the_oracle_itself(name):
    with mp.workdps(30):
        more = exact(name, arbitrary)
        leading = more.astype(float)
        wanted = extended(leading) + extended((more - leading).astype(float))
    assert relative_error(oracle(name), wanted) < 1e-14


@each_model
@each_version
def test_a_saved_state_goes_on_with_the_same_bits(name, fmi):
    expected, saved = six_hours(name, fmi)
    with unpacked(name, fmi) as folder, instances(name, folder, others(name)) as [instance]:
        instance.run(drive(name)[:7])
        state = instance.fmu.deserializeFMUState(saved)
        instance.fmu.setFMUState(state)
        instance.fmu.freeFMUState(state)
        later = slice(HALF, HALF + HOUR)
        np.testing.assert_array_equal(instance.run(drive(name)[later], HALF), expected[later])


@each_model
@each_version
def test_instances_of_one_library_do_not_disturb_each_other(name, fmi):
    n, inputs = 2000, drive(name)
    disturbing = -0.7 * inputs[:n]
    with unpacked(name, fmi) as folder:
        with instances(name, folder, others(name)) as [alone]:
            expected = alone.run(disturbing)
        with instances(name, folder, CASES[name].parameters, others(name)) as [one, two]:
            mixed = [
                (one.run(inputs[i : i + 1], i)[0], two.run(disturbing[i : i + 1], i)[0]) for i in range(n)
            ]
    np.testing.assert_array_equal([m[0] for m in mixed], six_hours(name, fmi)[0][:n])
    np.testing.assert_array_equal([m[1] for m in mixed], expected)
    assert np.all(expected[-1] != mixed[-1][0])


@each_model
@each_version
def test_another_compiler_gives_the_same_bits(name, fmi, monkeypatch):
    pytest.importorskip("ziglang")
    if "zig" in compiler.compiler().version:
        pytest.skip("there is no other compiler than zig")
    n = 20_000
    with unpacked(name, fmi) as folder:
        (binary,) = Path(folder, "binaries").glob(f"*/*{fmpy.sharedLibraryExtension}")
        before = binary.read_bytes()
        monkeypatch.setattr(compiler, "compiler", compiler.cross_compiler)
        compiler.compile_library(Path(folder, "sources"), ["all.c"], binary)
        assert binary.read_bytes() != before
        with instances(name, folder, CASES[name].parameters) as [instance]:
            np.testing.assert_array_equal(instance.run(drive(name)[:n]), six_hours(name, fmi)[0][:n])


def main():
    """Print the errors as a table in Markdown."""
    found = errors()
    rows = [f"| {n} | {' | '.join(f'{found[n, fmi]:.1e}' for fmi in VERSIONS)} |\n" for n in CASES]
    heads = ["| FMU | FMI 2.0 | FMI 3.0 |\n", "|---|---|---|\n"]
    sys.stdout.write("".join([*heads, *rows]))


if __name__ == "__main__":
    main()
