"""Test of whether the equations of a run agree on the parameters that they share.

An equation with coefficients of its own fits what no parameters of all equations do: where the geometry is
not what is stated, the equations contradict each other. Linearised, that is the test of `consistency_test`
for a single run, which has more rows than parameters.
"""

from collections.abc import Sequence

from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.statistics import ConsistencyTest
from fit.whitening import Experiment


def equation_warnings(test: ConsistencyTest, experiments: Sequence[Experiment]) -> list[Finding]:
    """Return the warning that equations of the same run contradict each other."""
    names = [equation.name for equation in experiments[0].sysid.equations]
    if len(names) < 2:
        return []
    singles = [test.without({*range(len(test.runs))} - {i}).total for i in range(len(test.runs))]
    limit = p_limit(len(singles))
    found = [
        f"{run.name} (chi2 {single.value:.4g} for {single.dof} degrees of freedom)"
        for run, single in zip(test.runs, singles, strict=True)
        if single.p < limit
    ]
    if not found:
        return []
    message = (
        f"{' and '.join(names)} contradict each other in {', '.join(found)}: the geometry or a read-out is "
        "not what the equations take as exact, or channels are exchanged; the uncertainties are not valid"
    )
    return [Finding("model_misfit", message)]
