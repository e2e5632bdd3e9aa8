"""A policy taught by driving: made from recordings, a network that drives a car."""
