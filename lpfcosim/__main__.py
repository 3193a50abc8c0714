"""``python -m lpfcosim``."""

from lpfcosim.cli.start import main

main()
