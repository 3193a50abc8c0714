"""The built FMUs: valid archives, right numbers under plain FMPy, honest state handling."""

import ctypes
import shutil
import subprocess
import sys
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from scipy.integrate import solve_ivp

from lpfcosim.cosim import checks
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.modelica import compiler as compiling
from lpfcosim.modelica.compiler import compiler
from tests.lpfcosim.modelica.modelica_source import fmu, write

pytestmark = pytest.mark.fmu


@pytest.fixture
def instantiate(tmp_path):
    """Make initialised FMU3Slaves; freed at the end."""
    made = []

    def make(archive, name="instance", **values):
        description = fmpy.read_model_description(str(archive))
        folder = fmpy.extract(str(archive), str(tmp_path / name))
        slave = FMU3Slave(
            instanceName=name, guid=description.guid, unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        slave.instantiate(logMessage=lambda *_: None)
        made.append(slave)
        slave.vr = {v.name: v.valueReference for v in description.modelVariables}
        initialise(slave, **values)
        return slave

    yield make
    for slave in made:
        slave.fmi3FreeInstance(slave.component)
        slave.freeLibrary()


def initialise(slave, **values):
    slave.enterInitializationMode(startTime=0.0)
    slave.setFloat64([slave.vr[n] for n in values], list(values.values()))
    slave.exitInitializationMode()


def get(slave, name):
    return slave.getFloat64([slave.vr[name]])[0]


@pytest.mark.parametrize("model", build.MODELS)
def test_no_checker_finds_a_fault(fmus, model):
    assert checks.problems(fmus[model]) == []


@pytest.mark.parametrize("model", build.MODELS)
def test_archive_carries_sources_that_compile_without_a_warning(fmus, model, tmp_path):
    if not compiler().command[0].endswith(("cc", "gcc", "clang")):
        pytest.skip("the warning flags are those of gcc and clang")
    with zipfile.ZipFile(fmus[model]) as archive:
        archive.extractall(tmp_path)
    sources = sorted((tmp_path / "sources").glob("*.c"))
    names = ("all", "model", "core", "multiply", "instance", "derivatives", "fmi3")
    assert {f"{name}.c" for name in names} == {p.name for p in sources}
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-fsyntax-only"]
    done = subprocess.run(
        [*compiler().command, *flags, str(tmp_path / "sources" / "all.c")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("model", build.MODELS)
def test_every_variable_is_documented(fmus, model):
    for v in fmpy.read_model_description(str(fmus[model])).modelVariables:
        assert v.description, v.name
        assert v.unit, v.name
        if v.unit == "m" and v.causality in ("input", "output", "local"):  # motion, not geometry
            assert float(v.nominal) <= 1e-9, v.name


def test_same_sources_give_the_same_bytes(tmp_path):
    first, second = tmp_path / "1" / "Plant.fmu", tmp_path / "2" / "Plant.fmu"
    for archive in (first, second):
        build.build_one(build.PACKAGE, "LISAPathfinder.Plant", archive)
    assert first.read_bytes() == second.read_bytes()


def test_changed_equation_changes_the_simulation(tmp_path):
    package = tmp_path / "LISAPathfinder"
    shutil.copytree(build.PACKAGE, package)
    before = build.digest(package)

    def moved(archive):
        return fmpy.simulate_fmu(
            str(archive), stop_time=10, output_interval=0.1, start_values={"g_1": 1e-12}
        )["x_1"][-1]

    build.build_one(package, "LISAPathfinder.Plant", tmp_path / "before.fmu")
    file = package / "TestMass.mo"
    text = file.read_text()
    assert "der(v) = F/m_tm - a_SC;" in text
    file.write_text(text.replace("der(v) = F/m_tm - a_SC;", "der(v) = 3*F/m_tm - a_SC;"))
    assert build.digest(package) != before
    build.build_one(package, "LISAPathfinder.Plant", tmp_path / "after.fmu")
    # x = g t^2/2 in both, but for stiffness and back-reaction of order 1e-2
    assert moved(tmp_path / "after.fmu") == pytest.approx(3 * moved(tmp_path / "before.fmu"), rel=0.02)


def test_cache_is_used_and_refreshed(tmp_path, monkeypatch):
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path))
    archive = build.build(["OpticalMetrology"])["OpticalMetrology"]
    stamp = archive.stat().st_mtime_ns
    assert build.build(["OpticalMetrology"])["OpticalMetrology"].stat().st_mtime_ns == stamp
    archive.write_bytes(archive.read_bytes()[:5000])
    assert build.build(["OpticalMetrology"])["OpticalMetrology"].stat().st_size > 5000
    stamp = archive.stat().st_mtime_ns
    assert build.build(["OpticalMetrology"], force=True)["OpticalMetrology"].stat().st_mtime_ns != stamp


def test_missing_compiler_is_one_sentence_with_the_remedy(monkeypatch):
    compiler.cache_clear()
    monkeypatch.setenv("CC", "no-such-compiler")
    try:
        with pytest.raises(InputError, match=r"'no-such-compiler', is not there; .*pip install ziglang"):
            compiler()
    finally:
        compiler.cache_clear()


@pytest.mark.slow
def test_ziglang_gives_the_same_bits(fmus, tmp_path, monkeypatch):
    pytest.importorskip("ziglang")
    monkeypatch.setenv("CC", f"{sys.executable} -m ziglang cc")
    compiler.cache_clear()
    try:
        build.build_one(build.PACKAGE, "LISAPathfinder.Plant", tmp_path / "Plant.fmu")
    finally:
        monkeypatch.undo()
        compiler.cache_clear()
    signal = np.zeros(
        2000, dtype=[("time", float), ("f_applied_1", float), ("F_x_sc", float), ("g_2", float)]
    )
    rng = np.random.default_rng(1)
    signal["time"] = np.arange(2000) * 0.1
    for name, size in (("f_applied_1", 1e-12), ("F_x_sc", 1e-7), ("g_2", 1e-14)):
        signal[name] = size * rng.standard_normal(2000)
    runs = [
        fmpy.simulate_fmu(
            str(a), stop_time=199, output_interval=0.1, input=signal, output=["x_1", "x_2", "a_SC"]
        )
        for a in (fmus["Plant"], tmp_path / "Plant.fmu")
    ]
    for channel in ("x_1", "x_2", "a_SC"):
        np.testing.assert_array_equal(runs[0][channel], runs[1][channel])


def test_harmonic_oscillator_against_its_solution(tmp_path):
    archive = fmu(
        tmp_path,
        """model M
          parameter Real k = 0.04; input Real u;
          output Real x(start = 1e-9, fixed = true, nominal = 1e-9);
          Real v(start = 0, fixed = true, nominal = 1e-9);
        equation
          der(x) = v; der(v) = -k*x + u;
        end M;""",
    )
    result = fmpy.simulate_fmu(str(archive), stop_time=21600, output_interval=0.1, start_values={"u": 2e-11})
    t = result["time"]
    expected = 2e-11 / 0.04 + (1e-9 - 2e-11 / 0.04) * np.cos(0.2 * t)
    assert len(t) == 216001
    assert np.abs(result["x"] - expected).max() < 1e-10 * 1e-9


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.12345, 0.25, 0.3])
@pytest.mark.parametrize("nonlinear", [False, True])
def test_delayed_force_switches_inside_the_step(tmp_path, delay, nonlinear):
    # A unit step of the command at t = 1: x = (t - 1 - delay)^2 / 2 afterwards, exactly.
    # A term that vanishes, but is not linear, sends the second model down the Runge-Kutta path.
    archive = fmu(
        tmp_path,
        f"""model M
          input Real u; output Real x(start = 0, fixed = true); Real v(start = 0, fixed = true);
          parameter Real d = 0.2; parameter Real zero = 0;
        equation
          der(x) = v; der(v) = delay(u, d){" + zero*x*x" if nonlinear else ""};
        end M;""",
    )
    signal = np.array([(0.0, 0.0), (0.9, 0.0), (1.0, 1.0), (3.0, 1.0)], dtype=[("time", float), ("u", float)])
    result = fmpy.simulate_fmu(
        str(archive), stop_time=3, output_interval=0.1, input=signal, start_values={"d": delay}
    )
    # the input is held: the value at t_n counts from t_n on
    expected = 0.5 * np.clip(result["time"] - 1 - delay, 0, None) ** 2
    np.testing.assert_allclose(result["x"], expected, atol=1e-14)


def test_nonlinear_system_against_a_high_order_integrator(tmp_path):
    archive = fmu(
        tmp_path,
        """model M
          parameter Real k = 1; input Real u;
          output Real x(start = 1, fixed = true); Real v(start = 0, fixed = true);
        equation
          der(x) = v; der(v) = -k*sin(x) - 0.1*v*v*v + u*cos(time/3);
        end M;""",
    )
    result = fmpy.simulate_fmu(str(archive), stop_time=20, output_interval=0.1, start_values={"u": 0.3})
    exact = solve_ivp(
        lambda t, y: [y[1], -np.sin(y[0]) - 0.1 * y[1] ** 3 + 0.3 * np.cos(t / 3)],
        (0, 20), [1, 0], method="DOP853", rtol=1e-12, atol=1e-14, t_eval=result["time"],
    )  # fmt: skip
    error = np.abs(result["x"] - exact.y[0]).max()
    assert 1e-9 < error < 1e-5  # classical Runge-Kutta at h = 0.1: of order h^4, and not better by accident


SWITCHES = {
    "input": ("der(x) = if u > 1 then 3 else 5;", 3.0),
    "if equation": ("if u > 1 then der(x) = 3; else der(x) = 5; end if;", 3.0),
    "algebraic": ("der(x) = g; g = if u > 1 then 3 else 5;", 3.0),
    "maximum": ("der(x) = max(u, 1.5);", 2.0),
    "Runge-Kutta": ("der(x) = (if u > 1 then 3 else 5) + zero*x*x;", 3.0),
    "delayed": ("der(x) = if delay(u, 0.25) > 1 then 3 else 5;", 3.0),
    "sampled": ("der(x) = if n > 5.5 then 1 else 0; when sample(0, 0.1) then n = pre(n) + 1; end when;", 0.5),
}


@pytest.mark.parametrize("switch", SWITCHES)
def test_switch_on_a_held_signal_in_a_derivative(tmp_path, switch):
    equations, expected = SWITCHES[switch]
    extra = ("Real g;" if switch == "algebraic" else "") + (
        "discrete Real n(start = 0, fixed = true);" if switch == "sampled" else ""
    )
    archive = fmu(
        tmp_path,
        f"model M input Real u(start = 2); output Real x(start = 0, fixed = true); "
        f"parameter Real zero = 0; {extra} equation {equations} end M;",
    )
    result = fmpy.simulate_fmu(str(archive), stop_time=1, output_interval=0.1)
    assert result["x"][-1] == pytest.approx(expected, rel=1e-12)


def test_names_of_the_user_do_not_meet_those_of_the_generator(tmp_path):
    text = """model M
      output Real NAME = 7; Real x(start = 0.5, fixed = true); Real v(start = 0.5, fixed = true);
    equation
      der(x) = sin(x*v + 1); der(v) = sin(x*v + 1)*x - v;
    end M;"""
    ends = []
    for name in ("common_0", "common", "other"):
        archive = fmu(tmp_path, text.replace("NAME", name))
        ends.append(fmpy.simulate_fmu(str(archive), stop_time=1, output_interval=0.1, output=["x"])["x"][-1])
    assert ends[0] == ends[1] == ends[2]


def test_constants_of_mathematics(tmp_path):
    archive = fmu(
        tmp_path, "model M output Real y[3]; equation y = {4*atan(1.0), exp(1.0), log10(1000.0)}; end M;"
    )
    result = fmpy.simulate_fmu(str(archive), stop_time=0.1, output_interval=0.1)
    np.testing.assert_allclose(result["y"][-1], [np.pi, np.e, 3], rtol=1e-15)


def test_long_communication_step_is_divided(tmp_path):
    archive = fmu(
        tmp_path,
        "model M Real v(start = 0, fixed = true); output Real x(start = 1, fixed = true); "
        "equation der(x) = v; der(v) = -sin(x); end M;",
    )
    ends = [
        fmpy.simulate_fmu(str(archive), stop_time=33.3, output_interval=h)["x"][-1] for h in (0.1, 3.33, 0.37)
    ]
    np.testing.assert_allclose(ends, ends[0], atol=1e-4)


def test_start_time_other_than_zero(tmp_path):
    archive = fmu(
        tmp_path,
        """model M
          input Real u(start = 1); output Real x(start = 0, fixed = true); output Real t;
          discrete output Real n(start = 0, fixed = true);
        equation
          der(x) = delay(u, 0.25); t = time;
          when sample(0, 0.2) then n = pre(n) + 1; end when;
        end M;""",
    )
    result = fmpy.simulate_fmu(str(archive), start_time=5.1, stop_time=6.1, output_interval=0.1)
    np.testing.assert_allclose(result["t"], result["time"], rtol=1e-15)
    assert result["x"][-1] == pytest.approx(1.0, rel=1e-12)
    assert result["n"][-1] == 5  # at 5.2, 5.4, 5.6, 5.8, 6.0


def test_outputs_follow_the_inputs_without_a_step(fmus, instantiate):
    metrology = instantiate(fmus["OpticalMetrology"])
    for value in (1e-9, 2e-9):
        metrology.setFloat64([metrology.vr["x_1"]], [value])
        assert get(metrology, "o_1") == value


def test_singular_parameters_are_an_error_and_not_a_hang(fmus, instantiate):
    plant = instantiate(fmus["Plant"], T_sc=0.0)
    with pytest.raises(FMICallException):
        plant.doStep(0.0, 0.1)


def test_foreign_bytes_are_no_state(fmus, instantiate):
    plant = instantiate(fmus["Plant"])
    state = plant.getFMUState()
    size = len(plant.serializeFMUState(state))
    plant.freeFMUState(state)
    with pytest.raises(FMICallException):
        plant.deserializeFMUState(bytes(size))


def test_bytes_that_only_seem_to_be_a_state_are_none(instantiate):
    archive = build.build(["WholePlant"])["WholePlant"]  # whose step matrix has places in it
    plant = instantiate(archive)
    state = plant.getFMUState()
    blob = plant.serializeFMUState(state)
    plant.freeFMUState(state)
    token = fmpy.read_model_description(str(archive)).guid.encode()
    before, found, after = blob.partition(token)
    assert found == token
    wrong = b"\x7f" * len(before) + token + after
    with pytest.raises(FMICallException):
        plant.deserializeFMUState(wrong)
    kept = plant.deserializeFMUState(blob)
    raw = (ctypes.c_uint8 * len(wrong)).from_buffer_copy(wrong)
    with pytest.raises(FMICallException):
        plant.fmi3DeserializeFMUState(plant.component, raw, len(wrong), ctypes.byref(kept))
    assert plant.serializeFMUState(kept) == blob
    plant.setFMUState(kept)
    plant.freeFMUState(kept)


def test_clocks_of_different_rate(tmp_path):
    archive = fmu(
        tmp_path,
        """model M
          input Real u; discrete output Real fast(start = 0, fixed = true);
          discrete output Real slow(start = 0, fixed = true);
        equation
          when sample(0, 0.1) then fast = pre(fast) + 1; end when;
          when sample(0.2, 0.3) then slow = pre(slow) + 1; end when;
        end M;""",
    )
    result = fmpy.simulate_fmu(str(archive), stop_time=1.2, output_interval=0.1)
    np.testing.assert_array_equal(result["fast"], np.arange(13))
    # samples at 0.2, 0.5, 0.8, 1.1, seen from the end of the step that begins there
    np.testing.assert_array_equal(result["slow"], [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4])


def test_shorter_and_longer_communication_steps(tmp_path):
    text = """model M
      input Real u; output Real x(start = 1, fixed = true); discrete output Real n(start = 0, fixed = true);
    equation
      der(x) = -x + u;
      when sample(0, 0.1) then n = pre(n) + 1; end when;
    end M;"""
    archive = fmu(tmp_path, text)
    for step in (0.01, 0.05, 0.1, 0.5):
        result = fmpy.simulate_fmu(str(archive), stop_time=1, output_interval=step)
        np.testing.assert_allclose(result["x"], np.exp(-result["time"]), rtol=1e-14)
        assert result["n"][-1] == 10
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(archive), stop_time=0.9, output_interval=0.03)


def test_calculated_parameters_follow_what_is_set(fmus, instantiate):
    plant = instantiate(
        fmus["Plant"], F_max_1=1e-9, N_max_1=5e-12, omega2_1_0=-1e-7, alpha_x_1=-300, alpha_phi_1=-2e4
    )
    assert get(plant, "testMass_1.omega2") == pytest.approx(-1e-7 - 300 * 1e-9 - 2e4 * 5e-12, rel=1e-15)


def test_variables_that_cannot_be_set_are_refused(fmus, instantiate):
    plant = instantiate(fmus["Plant"])
    for name in ("x_1", "tau_1", "testMass_1.omega2", "time"):
        with pytest.raises(FMICallException):
            plant.setFloat64([plant.vr[name]], [1.0])


def drive(slave, n, first=0):
    out = []
    for i in range(first, first + n):
        slave.setFloat64(
            [slave.vr["F_x_sc"], slave.vr["f_applied_2"]], [1e-7 * np.sin(i), 1e-12 * np.cos(0.3 * i)]
        )
        slave.doStep(i * 0.1, 0.1)
        out.append((get(slave, "x_1"), get(slave, "x_2")))
    return out


def test_saved_state_gives_the_same_bits(fmus, instantiate):
    plant = instantiate(fmus["Plant"])
    drive(plant, 50)
    state = plant.getFMUState()
    onward = drive(plant, 50, first=50)
    plant.setFMUState(state)
    assert drive(plant, 50, first=50) == onward
    blob = plant.serializeFMUState(state)
    other = instantiate(fmus["Plant"], name="other")
    restored = other.deserializeFMUState(blob)
    other.setFMUState(restored)
    assert drive(other, 50, first=50) == onward
    plant.freeFMUState(state)
    other.freeFMUState(restored)


def test_reset_starts_anew_and_instances_do_not_touch_each_other(fmus, instantiate):
    one, two = instantiate(fmus["Plant"], "one"), instantiate(fmus["Plant"], "two", m_sc=100.0)
    alone = drive(one, 40)
    one.reset()
    initialise(one)
    mixed = []
    for i in range(40):
        mixed += drive(one, 1, first=i)
        drive(two, 1, first=i)
    assert mixed == alone
    assert drive(two, 1, first=40) != drive(one, 1, first=40)


def test_checker_finds_a_fault_in_a_broken_description(fmus, tmp_path):
    broken = tmp_path / "Plant.fmu"
    with zipfile.ZipFile(fmus["Plant"]) as source, zipfile.ZipFile(broken, "w") as target:
        for item in source.infolist():
            data = source.read(item)
            if item.filename == "modelDescription.xml":
                data = data.replace(b'variability="fixed"', b'variability="continuous"', 1)
            target.writestr(item, data)
    assert checks.problems(broken)


def test_generated_c_is_refused_if_it_does_not_compile(tmp_path, monkeypatch):
    from lpfcosim.errors import RunError

    monkeypatch.setattr(compiling, "FLAGS", (*compiling.FLAGS, "--no-such-flag"))
    with pytest.raises(RunError, match="does not compile"):
        build.build_one(
            write(tmp_path, "model M output Real x; equation x = 1; end M;"), "M", tmp_path / "M.fmu"
        )
    assert not (tmp_path / "M.fmu").exists()
