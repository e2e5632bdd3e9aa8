"""Robots of txt1 in a web browser."""
