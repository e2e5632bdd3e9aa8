"""Control: the PID equation, the gain schedule, and the safety gate. No input, no output, no clock."""
