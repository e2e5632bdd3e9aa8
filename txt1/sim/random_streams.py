"""Streams of random numbers for a simulation, from the standard library: independent, named and repeatable."""

from random import Random


def random_stream(seed: int, *name: str) -> Random:
    """Return the stream of this seed and name.

    The same seed and name give the same numbers, on every computer and in every process. Two streams whose seeds or
    names differ have nothing in common: `Random` takes the whole SHA-512 of its text. So a further stream changes no
    other stream. For arrays of random numbers, ``numpy.random.default_rng(stream.getrandbits(128))`` goes on from here.
    Forms of the simulation for many robots at once draw all their numbers from such a generator: of the same
    distributions, but not the same numbers.
    """
    return Random(repr((seed, *name)))
