"""Tunable parameters: they act from the next step on, and what places clocks, delays and starts is fixed."""

import math

import pytest
from fmpy.fmi1 import FMICallException

from tests.lpfcosim.modelica.fmu_instance import Description, fmu_instance
from tests.lpfcosim.modelica.modelica_source import fmu
from tests.lpfcosim.modelica.test_dependencies import archive

pytestmark = pytest.mark.fmu


def test_tuned_parameter_acts_from_the_next_step_on(tmp_path):
    text = """model M
      parameter Real k(unit = "s-1") = 1 "Rate"; final parameter Real r(unit = "s-1") = 2*k "Twice";
      parameter Real h(unit = "s") = 0.1 "Sampling"; parameter Real z(unit = "1") = 1 "Start";
      output Real x(start = z, fixed = true, unit = "1") "Falls";
      discrete output Real n(start = 0, fixed = true);
    equation
      der(x) = -r*x; when sample(0, h) then n = pre(n) + 1; end when;
    end M;"""
    path = fmu(tmp_path, text)
    description = Description(path)
    assert description.names(variability=("tunable",)) == ["k", "r"]
    with fmu_instance(path) as instance:
        instance.exitInitializationMode()
        for n, k in enumerate((1, 1, 3, 3, 0.5)):
            instance.set(["k"], [k])
            instance.doStep(n * 0.2, 0.2)
        assert instance.get(["x"])[0] == pytest.approx(math.exp(-2 * 0.2 * (1 + 1 + 3 + 3 + 0.5)), rel=1e-14)
        assert instance.get(["r", "n"]) == [1.0, 10.0]
        for fixed in ("h", "z"):
            with pytest.raises(FMICallException):
                instance.set([fixed], [0.2])


def test_tuning_that_makes_the_model_singular_is_an_error_that_can_be_mended():
    with fmu_instance(archive("Plant", "3.0"), F_noise_x_sc=1e-9) as instance:
        instance.exitInitializationMode()
        instance.doStep(0.0, 0.1)
        instance.set(["m_sc"], [0.0])
        with pytest.raises(FMICallException):
            instance.doStep(0.1, 0.1)
        instance.set(["m_sc"], [422.7])
        instance.doStep(0.1, 0.1)
        assert math.isfinite(instance.get(["x_1"])[0])
