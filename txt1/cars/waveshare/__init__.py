"""Waveshare's rover boards: their HAL and a virtual board."""
