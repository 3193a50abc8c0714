"""Threads: several for work that falls into parts, one for the linear algebra within."""

from fit.threads.parts import alone, each
from fit.threads.single import one_thread

__all__ = ["alone", "each", "one_thread"]
