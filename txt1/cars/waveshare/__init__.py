"""Waveshare's rover boards: their HAL and their double."""
