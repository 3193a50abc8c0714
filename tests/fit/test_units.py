"""Units: many spellings of one, and none that takes for ever."""

import itertools
import time

import pytest

from fit import units
from fit.units import UnknownUnitError, factor, same_unit, split


@pytest.mark.parametrize("text", ["m s-2", "m s^-2", "m/s^2", "m/s2", "m s**-2", "m·s^-2", "m / s / s"])
def test_spellings_of_the_contract(text):
    assert same_unit(text, "m s-2")


@pytest.mark.parametrize("text", ["nm s-2", "m s-1", "rad s-2", "", "m s-", "metres per second"])
def test_others(text):
    assert not same_unit(text, "m s-2")


def test_the_spelling_of_the_contract_needs_no_registry(monkeypatch):
    monkeypatch.setattr("fit.units.factor", lambda *_: pytest.fail("asked"))
    assert same_unit("m s-2", "m s-2")


PLAIN = ["m", "s", "g", "rad", "K", "N", "Hz", "min", "h", "d", "day"]
PLAIN += [prefix + symbol for prefix, symbol in itertools.product("fpnumk", PLAIN[:7])]
PRODUCTS = [
    "pN m",
    "m s^-2",
    "fm s^-2 Hz^-0.5",
    "um rad^-1 d^-1",
    "kg^-1 m^-2",
    "m/rad",
    "rad/s",
    "1/s",
    "/s",
]
PRODUCTS += [
    "mrad Hz^-0.5",
    "uN m Hz^-0.5",
    "m·s-2",
    "m / s2",
    "N kg^-1",
    "",
    "day^-0.5",
    "mHz^-0.5",
    "m s / s",
]
PRODUCTS += ["1 m/s", "s/", "m//s", "m/s/s", "m/s s", "m * s", "m^-1.5", "Hz^1.5", "1", "mm m", "10 m", "kd"]


def told(unit, si):
    try:
        return factor(unit, si)
    except ValueError as error:
        return str(error)


def test_what_is_read_without_pint_is_what_pint_reads(monkeypatch):
    powers = ("", "^2", "-1", "^-3")
    pairs = [(a + p, b + p) for a, b, p in itertools.product(PLAIN, PLAIN, powers)]
    pairs += itertools.product(PRODUCTS, PRODUCTS)
    plainly = [told(*pair) for pair in pairs]
    units._root.cache_clear()
    monkeypatch.setattr(units, "_plain", lambda _: None)
    assert plainly == [told(*pair) for pair in pairs]


def test_pint_reads_the_rest_beside_it():
    assert factor("micrometer/s**2", "m s^-2") == 1e-6
    assert factor("deg", "rad") == 0.0174532925199433
    assert factor("m/s^2/Hz^0.5", "m s^-2 Hz^-0.5") == 1


@pytest.mark.parametrize("text", ["m^9^9^9^9", "((9 m)**(999))**(999)", "m^99999999", 81 * "m"])
def test_no_unit_takes_for_ever(text):
    begun = time.monotonic()
    with pytest.raises(UnknownUnitError):
        factor(text, "m")
    assert time.monotonic() - begun < 1


def test_a_quantity_may_begin_its_unit_with_one_over():
    assert split("2e-7 1/s") == ("2e-7", "1/s")
    assert factor("1/s", "s-1") == factor("/s", "s-1") == 1
