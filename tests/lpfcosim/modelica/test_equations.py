"""Equations as FMUs, stepped by plain FMPy, against their solutions."""

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.integrate import solve_ivp

from tests.lpfcosim.modelica.modelica_source import fmu

pytestmark = pytest.mark.fmu


def simulate(archive, stop_time, h=0.1, **options):
    return fmpy.simulate_fmu(str(archive), stop_time=stop_time, step_size=h, output_interval=h, **options)


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
    result = simulate(archive, 3600, start_values={"u": 2e-11})
    expected = 2e-11 / 0.04 + (1e-9 - 2e-11 / 0.04) * np.cos(0.2 * result["time"])
    assert np.abs(result["x"] - expected).max() < 1e-11 * 1e-9


@pytest.mark.parametrize("nonlinear", [False, True])
def test_delayed_force_switches_inside_the_step(tmp_path, nonlinear):
    # A unit step of the command at t = 1: x = (t - 1 - delay)^2 / 2 afterwards, exactly.
    # A term that vanishes, but is not affine, sends the second model down the Runge-Kutta path.
    archive = fmu(
        tmp_path,
        f"""model M
          input Real u; output Real x(start = 0, fixed = true); Real v(start = 0, fixed = true);
          parameter Real d = 0.2; parameter Real zero = 0;
        equation
          der(x) = v; der(v) = delay(u, d){" + zero*sin(x)" if nonlinear else ""};
        end M;""",
    )
    signal = np.array([(0.0, 0.0), (0.9, 0.0), (1.0, 1.0), (3.0, 1.0)], dtype=[("time", float), ("u", float)])
    for delay in (0.0, 0.03, 0.1, 0.12345, 0.25, 0.3):
        result = simulate(archive, 3, input=signal, start_values={"d": delay})
        # the input is held: the value at t_n counts from t_n on
        expected = 0.5 * np.clip(result["time"] - 1 - delay, 0, None) ** 2
        np.testing.assert_allclose(result["x"], expected, atol=1e-14, err_msg=str(delay))


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
    result = simulate(archive, 20, start_values={"u": 0.3})
    exact = solve_ivp(
        lambda t, y: [y[1], -np.sin(y[0]) - 0.1 * y[1] ** 3 + 0.3 * np.cos(t / 3)],
        (0, 20), [1, 0], method="DOP853", rtol=1e-12, atol=1e-14, t_eval=result["time"],
    )  # fmt: skip
    error = np.abs(result["x"] - exact.y[0]).max()
    assert 1e-9 < error < 1e-5  # classical Runge-Kutta at h = 0.1: of order h^4, and not better by accident
    coarse = simulate(archive, 20, h=5.0, start_values={"u": 0.3})  # a long step is divided
    np.testing.assert_allclose(coarse["x"], result["x"][::50], atol=1e-4)


def test_polynomial_remainder_is_extrapolated_and_the_affine_part_exact(tmp_path):
    # The lag of 0.05 s is half a step: only an exact exponential resolves it.
    archive = fmu(
        tmp_path,
        """model M
          input Real u; Real lag(start = 0, fixed = true); Real a;
          output Real x(start = 1, fixed = true); Real v(start = 0, fixed = true);
        equation
          0.05*der(lag) = u - lag; a = lag - x; der(x) = v; der(v) = a - 0.1*x^2*v + 0.05*a*x;
        end M;""",
    )

    def rate(_, y):
        a = y[0] - y[1]
        return [(0.3 - y[0]) / 0.05, y[2], a - 0.1 * y[1] ** 2 * y[2] + 0.05 * a * y[1]]

    time = np.arange(201) / 10
    exact = solve_ivp(rate, (0, 20), [0, 1, 0], method="DOP853", rtol=1e-12, atol=1e-14, t_eval=time).y[1]
    steps = (0.1, 0.05, 0.025)
    results = [simulate(archive, 20, h, start_values={"u": 0.3})["x"][:: round(0.1 / h)] for h in steps]
    errors = [np.abs(x - exact).max() for x in results]
    assert errors[0] < 1e-3
    np.testing.assert_allclose(np.divide(errors[:2], errors[1:]), 4, rtol=0.2)


SWITCHES = {  # equations of x_1, x_2 ... with u = 2, and x after 1 s
    "der(x_1) = if u > 1 then 3 else 5;": 3.0,
    "if u > 1 then der(x_2) = 3; else der(x_2) = 5; end if;": 3.0,
    "der(x_3) = g; g = if u > 1 then 3 else 5;": 3.0,
    "der(x_4) = max(u, 1.5);": 2.0,
    "der(x_5) = if delay(u, 0.25) > 1 then 3 else 5;": 3.0,
    "der(x_6) = if n > 5.5 then 1 else 0; when sample(0, 0.1) then n = pre(n) + 1; end when;": 0.5,
}


@pytest.mark.parametrize("nonlinear", [False, True])  # by the exact step, and by Runge-Kutta
def test_switches_on_held_signals_in_derivatives(tmp_path, nonlinear):
    archive = fmu(
        tmp_path,
        f"""model M
          input Real u(start = 2); parameter Real zero = 0; Real g; discrete Real n(start = 0, fixed = true);
          {" ".join(f"output Real x_{i}(start = 0, fixed = true);" for i in range(1, 7))}
          Real y(start = 0, fixed = true);
        equation
          der(y) = {"zero*sin(y)" if nonlinear else "-y"}; {" ".join(SWITCHES)}
        end M;""",
    )
    result = simulate(archive, 1)
    for i, (equation, expected) in enumerate(SWITCHES.items(), 1):
        assert result[f"x_{i}"][-1] == pytest.approx(expected, rel=1e-12), equation


def test_shorter_and_longer_communication_steps(tmp_path):
    text = """model M
      input Real u; output Real x(start = 1, fixed = true); discrete output Real n(start = 0, fixed = true);
    equation
      der(x) = -x + u;
      when sample(0, 0.1) then n = pre(n) + 1; end when;
    end M;"""
    archive = fmu(tmp_path, text)
    for step in (0.01, 0.05, 0.1, 0.5):
        result = simulate(archive, 1, step)
        np.testing.assert_allclose(result["x"], np.exp(-result["time"]), rtol=1e-14)
        assert result["n"][-1] == 10
    with pytest.raises(FMICallException):
        simulate(archive, 0.9, 0.03)


def test_clocks_of_different_rate_and_a_start_time_other_than_zero(tmp_path):
    archive = fmu(
        tmp_path,
        """model M
          input Real u(start = 1); output Real x(start = 0, fixed = true); output Real t;
          discrete output Real fast(start = 0, fixed = true);
          discrete output Real slow(start = 0, fixed = true);
        equation
          der(x) = delay(u, 0.25); t = time;
          when sample(0, 0.1) then fast = pre(fast) + 1; end when;
          when sample(0.2, 0.3) then slow = pre(slow) + 1; end when;
        end M;""",
    )
    result = simulate(archive, 1.2)
    np.testing.assert_array_equal(result["fast"], np.arange(13))
    # samples at 0.2, 0.5, 0.8, 1.1, seen from the end of the step that begins there
    np.testing.assert_array_equal(result["slow"], [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4])
    later = simulate(archive, 6.1, start_time=5.1)
    np.testing.assert_allclose(later["t"], later["time"], rtol=1e-15)
    assert later["x"][-1] == pytest.approx(1.0, rel=1e-12)
    assert (later["fast"][-1], later["slow"][-1]) == (10, 3)  # the latter at 5.3, 5.6, 5.9
