"""A policy taught by driving: from recordings to a network, and a car that it drives."""
