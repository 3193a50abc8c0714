"""The tests: folders like the rooms of the packages, and what they share."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
