"""Imports without what is not asked for, in several threads, and what is left of what they leave out."""

import subprocess
import sys
from threading import Event, Thread

import pytest

from fit import lean


def test_threads_import_one_after_the_other():
    inside, other = Event(), "no_module_of_this_name"

    def imported():
        with lean.without([other], "no_package_of_this_name"):
            inside.set()

    thread = Thread(target=imported)
    with lean.without([other], "no_package_of_this_name"):
        assert other in sys.modules
        thread.start()
        assert not inside.wait(0.05)
    thread.join()
    assert inside.is_set()
    assert other not in sys.modules


def said(code):
    """What a fresh interpreter prints."""
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_what_is_for_later_is_there_when_it_is_used():
    code = """
import sys
import fit.api
fit.api.read_in()
print("scipy.stats" in sys.modules)
import lmfit
from scipy.signal import find_peaks_cwt
import scipy.stats
p = lmfit.Parameters()
p.add("a", 1.0)
found = lmfit.minimize(lambda p: [p["a"].value - k for k in (1.0, 2.0, 4.0)], p)
print(lmfit.confidence.f.cdf(1.0, 2, 3) == scipy.stats.f.cdf(1.0, 2, 3))
print(lmfit.minimizer.norm_dist.pdf(0.5) == scipy.stats.norm.pdf(0.5))
print(scipy.signal._peak_finding.scoreatpercentile([1.0, 2.0, 4.0], 50))
print(scipy.stats is sys.modules["scipy.stats"], scipy.stats.norm.__class__.__name__)
"""
    assert said(code).split() == ["False", "True", "True", "2.0", "True", "norm_gen"]


def test_what_is_there_is_not_for_later():
    before = sys.modules["pytest"]
    with lean.later("pytest"):
        assert sys.modules["pytest"] is before is pytest


def test_docstrings_without_notes_are_otherwise_the_same():
    of_some = """
import inspect
import scipy.signal
import scipy.special
for function in (scipy.signal.firwin, scipy.signal.welch, scipy.special.logsumexp, scipy.special.softmax):
    print(inspect.getdoc(function), end="\\0")
"""
    # twice is once, as where a command is run by another
    without = f"from fit import lean\nlean.lean_scipy()\nlean.lean_scipy(){of_some}"
    for noted, plain in zip(said(of_some).split("\0"), said(without).split("\0"), strict=True):
        assert plain.split("Returns")[0].split() == noted.split("Returns")[0].split()
        assert "Array API" not in plain
    assert "FIR filter design" in said(without)


def test_what_is_for_later_can_be_copied():
    code = """
import copy, pickle
import fit.api
fit.api.read_in()
import lmfit
for made in (copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))):
    print(made(lmfit.minimizer.norm_dist).pdf(0.0) == lmfit.minimizer.norm_dist.pdf(0.0))
"""
    assert said(code).split() == ["True"] * 3


def test_what_is_for_later_and_used_at_once_is_told(monkeypatch):
    monkeypatch.delitem(sys.modules, "json.tool", raising=False)
    with lean.later("json.tool"):
        from json.tool import main

        with pytest.raises(ImportError, match=r"json\.tool\.main is used while"):
            main()
    assert callable(main)
    assert main.__class__.__name__ == "_Name"


def test_parts_of_numpy_are_there_when_they_are_used():
    code = """
from fit import lean
lean.lean_scipy()
import sys
import scipy.linalg
print("numpy.testing" in sys.modules, "numpy.f2py" in sys.modules)
import numpy
numpy.testing.assert_array_equal([1.0], [1.0])
print(numpy.testing is sys.modules["numpy.testing"], numpy.f2py is sys.modules["numpy.f2py"])
"""
    assert said(code).split() == ["False", "False", "True", "True"]
