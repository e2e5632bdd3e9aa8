"""The obstacle stop: a guard of the safety gate with a laser scanner."""
