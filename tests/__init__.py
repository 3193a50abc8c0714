"""The tests: folders like the rooms of the packages, and what they share."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[1]

# Two workers on two processors: threads of the linear algebra would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
