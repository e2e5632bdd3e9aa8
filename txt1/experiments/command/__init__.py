"""Commands for measuring, calibrating and tuning."""
