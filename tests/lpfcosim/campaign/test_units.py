"""Quantities: many spellings, one value."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fit import units
from lpfcosim.campaign import loading
from lpfcosim.campaign.units import Quantity
from tests import ROOT

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


@pytest.mark.parametrize("path", sorted((ROOT / "campaigns").glob("*.toml")), ids=lambda path: path.stem)
def test_our_campaigns_are_read_without_pint_as_with_it(path, monkeypatch):
    units._root.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(units, "registry", lambda: pytest.fail("asked"))
        plainly = loading.load(path)
    units._root.cache_clear()
    monkeypatch.setattr(units, "_plain", lambda _: None)
    assert loading.load(path) == plainly
