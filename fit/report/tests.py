"""The section of the report on the consistency of the experiments."""

from collections.abc import Mapping

from markupsafe import escape

from fit.report.section import Section
from fit.results import Results
from fit.tables import Table


def sections(results: Results) -> list[Section]:
    """Return the section, where the results state the tests of the consistency of their experiments."""
    agreement = results.provenance.extra.get("agreement")
    if not isinstance(agreement, Mapping):
        return []
    rows = tuple(
        (escape(name) if name else "all", f"{test['chi2']:.4g}", f"{test['dof']}", f"{test['p']:.2g}")
        for name, test in agreement.items()
        if isinstance(test, Mapping) and {"chi2", "dof", "p"} <= test.keys()
    )
    caption = "χ² of each experiment with the others, and of all, with its p-value."
    table = Table(("Experiment", "χ²", "Degrees of freedom", "p"), rows, caption)
    return [Section("agreement", "Consistency of the experiments", tables=(table,), summary=caption)]
