"""Findings: what is wrong with telemetry, the model or a fit, each as a record, and the table of their kinds.

A finding has a code, which is a key of `KINDS`: the kind states how severe it is, whether the sigmas are
invalid, whether the run is left out of the joint fit, and what to do. Messages are for the user alone and
never parsed.
"""

from fit.findings.finding import (
    UNDETERMINED,
    Amount,
    Finding,
    distinct_messages,
    either,
    joint_message,
    masked_spans,
    undetermined,
)
from fit.findings.kinds import KINDS, Severity
