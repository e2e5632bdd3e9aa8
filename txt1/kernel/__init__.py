"""Time: clocks, event loops in real and virtual time, and the scheduler of periodic tasks."""
