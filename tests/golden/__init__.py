"""Recordings that are verified bit for bit, in this folder, and the programs that made them.

A change of behaviour that is meant remakes those concerned, in a commit of its own that says why, and by how much they
differ: ``python -m tests.golden NAME...``.
"""
