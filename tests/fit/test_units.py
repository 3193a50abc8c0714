"""Units: many spellings of one, and none that takes for ever."""

import pytest

from fit.units import concise_value, factor, in_base_units, same_unit


@pytest.mark.parametrize(
    "text",
    ["m s-2", "m s^-2", "m/s^2", "m/s2", "m s**-2", "m / s**2", "m*s^-2", "m·s^-2", "s-2 m", " m / s / s"],
)
def test_spellings_of_the_contract(text):
    assert same_unit(text, "m s-2")


@pytest.mark.parametrize(
    "text",
    ["nm s-2", "m", "m s2", "m/s", "ms-2", "m s-2 rad", "", "m s-", "m s−2", "metres per second", "$m s-2$"],
)
def test_others(text):
    assert not same_unit(text, "m s-2")


def test_factors_of_units():
    assert factor("pN m", "N m") == 1e-12
    assert factor("fm s^-2 Hz^-0.5", "m s^-2 Hz^-0.5") == 1e-15
    assert factor("d", "s") == 86400.0
    assert factor("um rad^-1 d^-1", "m rad^-1 s^-1") == pytest.approx(1e-6 / 86400, rel=1e-14)
    assert factor("micrometer/s**2", "m s^-2") == 1e-6
    assert factor("deg", "rad") == 0.0174532925199433
    assert factor("m/s^2/Hz^0.5", "m s^-2 Hz^-0.5") == 1


@pytest.mark.parametrize(
    ("unit", "powers", "size"),
    [
        ("m/s2", {"m": 1, "s": -2}, 1.0),
        ("1/(kg.m)", {"kg": -1, "m": -1}, 1.0),
        ("N", {"kg": 1, "m": 1, "s": -2}, 1.0),
        ("rad/s", {"rad": 1, "s": -1}, 1.0),
        ("nm", {"m": 1}, 1e-9),
        ("1", {}, 1.0),
    ],
)
def test_base_units_of_modelica(unit, powers, size):
    assert in_base_units(unit) == (powers, pytest.approx(size, rel=1e-14), 0.0)


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (1.0775874, 3.395e-5, "1.077587(34)"),
        (-3.983e-7, 5.3e-9, "-3.983(53)e-07"),
        (-26860.0, 930.0, "-2.686(93)e+04"),
        (0.186, 0.001, "0.186(1)"),
        (1e-9, 2.5e-3, "0.0000(25)"),
        (4.83, 0.0, "4.83"),
        (0.5, 0.0996, "0.50(10)"),
        (1.0, 3e-12, "1.000000000000(3)"),
        (float("nan"), 1.0, "nan"),
    ],
)
def test_a_value_is_written_with_its_sigma_in_the_last_digits(value, sigma, text):
    assert concise_value(value, sigma) == text
