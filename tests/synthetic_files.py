"""Telemetry files of synthetic runs, for tests of what commands make of files."""

from tests.oracles.contract_file import write_contract_file

ATTRIBUTES = (
    "run", "experiment", "kind", "fs", "t0", "F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch",
    "m_tm",
)  # fmt: skip


def write_run(run, path, changes=None):
    """Write a run; changes replace attributes of it."""
    channels = {name: (values, "m" if "o_" in name else "m s-2") for name, values in run.channels.items()}
    attributes = {name: getattr(run, name) for name in ATTRIBUTES} | (changes or {})
    return write_contract_file(path, samples=run.time.size, channels=channels, **attributes)
