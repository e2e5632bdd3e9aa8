"""Torture: faults, mutants and random bytes in great numbers, and the invariants that have to hold all the same."""
