"""Parameters that scatter between the experiments."""

from collections.abc import Sequence

from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.units import concise_value
from fit.whitening import Experiment

SIGNIFICANT = 2.0  # sigma, of a width from which a parameter is said to scatter


def find(outcome: IRLSResult, _: Sequence[Experiment], *__: object) -> list[Finding]:
    """Say by how much parameters differ between the experiments."""
    chosen = ", as the data require" if outcome.data_driven else ""
    warnings = []
    determined = outcome.determined
    for name, (width, sigma) in outcome.scatter.items():
        if name not in determined:
            continue
        verb = "scatters" if width > SIGNIFICANT * sigma else "may scatter"
        text = (
            f"{name} {verb} between the experiments by {concise_value(width, sigma)} beyond noise{chosen}; "
            "its sigma is that of the mean over such experiments"
        )
        warnings.append(Finding("random_effects", text, parameters=(name,)))
    return warnings
