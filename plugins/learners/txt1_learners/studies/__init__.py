"""Learners beside each other: in a suite of worlds, per seconds driven, and against the best time that is possible."""
