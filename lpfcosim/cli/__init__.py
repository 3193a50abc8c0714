"""The command line, one file a command; the only room that knows both packages."""

from lpfcosim.cli.start import main

__all__ = ["main"]
