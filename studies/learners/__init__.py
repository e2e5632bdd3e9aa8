"""Learners beside each other: in a suite of worlds, per seconds driven, and against the best time that is possible."""

from pathlib import Path

OWN = tuple(sorted(Path(__file__).parent.glob("*.py")))
"""The files that make a study's results, beside those of txt1."""
