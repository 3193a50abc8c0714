"""Quantities: many spellings, one value."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpfcosim.campaign.units import Quantity

LENGTH = Quantity("a length", "m", "10 nm")
ACCELERATION_NOISE = Quantity("an acceleration noise", "m s^-2 Hz^-0.5", "5.6 fm s^-2 Hz^-0.5")


@given(st.floats(-1e6, 1e6), st.sampled_from([("nm", -9), ("um", -6), ("pm", -12), ("m", 0), ("km", 3)]))
@settings(max_examples=50)
def test_prefixes_scale_by_powers_of_ten(value, unit):
    name, power = unit
    assert LENGTH.to_si(f"{value!r} {name}") == pytest.approx(value * 10.0**power, rel=1e-15)


@pytest.mark.parametrize(
    "text", ["10 nm", "10nm", " 1e-8 m ", "0.01 um", "+10. nm", "1e4 pm", "10 nanometer"]
)
def test_one_length_many_spellings(text):
    assert LENGTH.to_si(text) == 1e-8


@pytest.mark.parametrize(
    "text",
    ["5.6 fm s^-2 Hz^-0.5", "5.6 fm/s^2/Hz^0.5", "5.6e-15 m s**-2 / Hz**0.5", "0.0056 pm s^-2 / Hz^(1/2)"],
)
def test_one_density_many_spellings(text):
    assert ACCELERATION_NOISE.to_si(text) == 5.6e-15
