"""The command ``trust``: which FMUs of others may run."""

from collections.abc import Sequence
from pathlib import Path

from fit.errors import quote
from lpfcosim.cli.console import Console
from lpfcosim.errors import InputError
from lpfcosim.execution import trust_store


def trust(files: Sequence[str], console: Console, *, remove: bool) -> None:
    """Approve FMUs, withdraw approvals, or list them."""
    if remove and not files:
        raise InputError("--remove: no argument, expected files or digests")
    if remove:
        for approval in trust_store.revoke(files):
            console.print_line(f"no longer approved: {_describe(approval)}")
    elif files:
        for approval in trust_store.approve([Path(file) for file in files]):
            console.print_line(f"approved: {_describe(approval)}")
        console.print_line(f"stored in {trust_store.location()}")
    else:
        approvals = trust_store.approvals()
        for approval in approvals:
            console.print_line(_describe(approval))
        if not approvals:
            console.print_line("no third-party FMU is approved")


def _describe(approval: trust_store.Approval) -> str:
    name = approval.name if approval.name.isprintable() else quote(approval.name)
    return f"{approval.date}  {approval.sha256}  {name}"
