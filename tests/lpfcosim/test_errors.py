"""Errors of the input are one class in both packages, and name the file that they are about."""

import pickle

import pytest

import fit
import lpfcosim
from lpfcosim.errors import InputError, RunError, UnavailableError, as_run_error, prefix_errors


def test_errors_name_their_file_and_keep_their_kind():
    assert lpfcosim.InputError is fit.InputError
    for error in (UnavailableError("no forecast"), InputError("no forecast")):
        with pytest.raises(type(error), match=r"^a\.toml: no forecast$"), prefix_errors("a.toml"):
            raise error
    unavailable = pickle.loads(pickle.dumps(UnavailableError("no forecast", "a.toml")))
    assert (str(unavailable), unavailable.reason) == ("a.toml: no forecast", "no forecast")


def test_what_cannot_be_written_is_a_run_that_failed():
    with pytest.raises(RunError, match=r"^A: disk full$"), as_run_error("A: "):
        raise fit.FitError("disk full")
