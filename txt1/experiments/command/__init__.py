"""The commands of measuring, calibrating and tuning."""
