"""Exploring: the robot maps a room by itself, by driving to the borders between free and unknown floor."""
