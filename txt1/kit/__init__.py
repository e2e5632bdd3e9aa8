"""What commands stand on, the front's own and those of additions: starting a robot, options, remarks, verdicts."""
