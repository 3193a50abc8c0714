"""``python -m lpfcosim``."""

from lpfcosim.cli import main

main()
