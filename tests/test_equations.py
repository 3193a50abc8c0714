"""The equations of the paper: they are named by their numbers, and what is implemented is found."""

import re

import pytest

from tests import ROOT

#: Largest number of an equation in the paper.
LAST = 23
#: Where to look first for what is implemented.
HOMES = {
    1: "fit/deltag.py",
    2: "fit/model/dynamics.py",
    3: "fit/model/dynamics.py",
    4: "fit/deltag.py",
    5: "fit/fitting/experiment_and_joint_fit.py",
    6: "fit/model/dynamics.py",
    7: "fit/fitting/irls.py",
    8: "fit/parameters.py",
    11: "fit/model/dynamics.py",
    12: "fit/model/sharing.py",
    13: "fit/whitening/whitened_run.py",
    14: "fit/whitening/likelihoods.py",
    15: "fit/fitting/joint_model.py",
    20: "fit/model/inertial_forces.py",
    22: "fit/model/inertial_forces.py",
}
FOLDERS = ("fit", "lpfcosim", "fmus", "docs")
SUFFIXES = (".py", ".mo", ".md", ".jinja")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.suffix in SUFFIXES]
MENTION = re.compile(r"\bEqs?\.((?:[\s,]|and|to|\(\d+\))+)")
LABEL = re.compile(r"\b(?:eq|tab|fig|sec|app):[a-z]|\beqs?\.?\s+[a-z]*_?(?:delta|stiff|alpha|bump|irls|lh\b)")


def numbers(text: str) -> set[int]:
    """Return the numbers that a text mentions as ``Eq. (1)`` or ``Eqs. (1), (2) and (3)``."""
    return {int(n) for mention in MENTION.findall(text) for n in re.findall(r"\((\d+)\)", mention)}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_equations_are_named_by_the_numbers_of_the_paper(path):
    text = path.read_text(encoding="utf-8")
    assert not LABEL.search(text)
    assert numbers(text) <= set(range(1, LAST + 1))


@pytest.mark.parametrize("number", HOMES)
def test_a_number_leads_to_where_the_equation_is_implemented(number):
    assert number in numbers((ROOT / HOMES[number]).read_text(encoding="utf-8"))


def test_the_table_of_equations_names_their_homes():
    page = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8").split("## Equations of the paper")[1]
    rows = [line.split("|")[1:4] for line in page.splitlines() if line.startswith("| (")]
    places = {int(n): row[2] for row in rows for n in re.findall(r"\((\d+)\)", row[0])}
    assert set(places) == set(HOMES)
    assert all(HOMES[number] in place for number, place in places.items())
