"""Errors of the input are one class for who catches them, and keep their kind."""

import pytest

import fit.errors
from lpfcosim.errors import InputError, UnavailableError, ours


def test_an_error_of_the_input_is_one_of_fit_as_well():
    assert issubclass(InputError, fit.errors.InputError)


def test_errors_of_this_package_pass_unchanged():
    error = UnavailableError("no forecast")
    with pytest.raises(UnavailableError) as caught, ours("A: "):
        raise error
    assert caught.value is error
