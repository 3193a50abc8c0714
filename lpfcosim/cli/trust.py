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
        raise InputError("--remove: missing what to remove, expected files or digests")
    if remove:
        for approval in trust_store.revoke(files):
            console.say(f"no longer approved: {_told(approval)}")
    elif files:
        for approval in trust_store.approve([Path(file) for file in files]):
            console.say(f"approved: {_told(approval)}")
        console.say(f"kept in {trust_store.location()}")
    else:
        found = trust_store.approvals()
        for approval in found:
            console.say(_told(approval))
        if not found:
            console.say("no FMU of others is approved")


def _told(approval: trust_store.Approval) -> str:
    name = approval.name if approval.name.isprintable() else quote(approval.name)
    return f"{approval.date}  {approval.sha256}  {name}"
