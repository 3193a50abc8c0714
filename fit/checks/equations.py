"""Test of whether the equations of a run agree on the parameters that they share.

An equation with coefficients of its own fits what no parameters of all equations do: where the geometry is
not what is stated, the equations contradict each other. Linearised, that is the test of `consistency_test`
for a single run, which has more rows than parameters.
"""

from fit.agreement import Agreement
from fit.false_alarms import p_limit
from fit.findings import Finding


def find(agreed: Agreement) -> list[Finding]:
    """Return that equations of the same run contradict each other."""
    names, test = [equation.name for equation in agreed.experiments[0].sysid.equations], agreed.test
    if len(names) < 2 or test is None:
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
