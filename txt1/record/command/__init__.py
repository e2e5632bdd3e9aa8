"""The commands of recordings."""
