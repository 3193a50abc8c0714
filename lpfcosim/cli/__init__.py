"""The command line: it parses arguments, calls a workflow, and prints its result."""

from lpfcosim.cli.entry_point import main
