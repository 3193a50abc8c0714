"""The equations of the paper: they are named by their labels only, and what is implemented is found."""

import re

import pytest

from tests import ROOT

#: Labels of the paper's equations, in its order.
PAPER = [
    "deltagfull",
    "fx2",
    "bump",
    "deltagfull2",
    "deltaglinear",
    "delaylin",
    "irls",
    "stiff_model",
    "alphax",
    "alphaphi",
    "deltagjointfit",
    "deltastiff_model",
    "inprod",
    "llhgaussian",
    "jointlh",
    "inertialacc",
    "x12",
    "centrifugal",
    "gomega",
    "gomegafinal",
]
#: Where to look first for what is implemented.
HOMES = {
    "alphaphi": "fit/parameters.py",
    "alphax": "fit/parameters.py",
    "bump": "fit/model/dynamics.py",
    "centrifugal": "fit/model/inertial_forces.py",
    "deltagjointfit": "fit/model/dynamics.py",
    "deltastiff_model": "fit/model/sharing.py",
    "fx2": "fit/model/dynamics.py",
    "gomegafinal": "fit/model/inertial_forces.py",
    "inprod": "fit/whitening/whitened_run.py",
    "irls": "fit/fitting/irls.py",
    "jointlh": "fit/fitting/joint_model.py",
    "llhgaussian": "fit/whitening/likelihoods.py",
    "stiff_model": "fit/parameters.py",
}
FOLDERS = ("fit", "lpfcosim", "fmus", "docs")
SUFFIXES = (".py", ".mo", ".md", ".jinja")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.suffix in SUFFIXES]
MENTION = re.compile(r"\beq\.\s+(\w+)|\beqs\s+(\w+(?:,\s+(?!and\b)\w+)*(?:,?\s+and\s+\w+)?)")


def labels(text: str) -> set[str]:
    """Return the labels that a text mentions as ``eq. label`` or ``eqs label, label and label``."""
    found = set()
    for one, several in MENTION.findall(text):
        found |= {one} if one else set(re.findall(r"\w+", several)) - {"and"}
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_labels_are_those_of_the_paper(path):
    assert labels(path.read_text(encoding="utf-8")) <= set(PAPER)


@pytest.mark.parametrize("label", HOMES)
def test_a_label_leads_to_where_it_is_implemented(label):
    assert label in labels((ROOT / HOMES[label]).read_text(encoding="utf-8"))
