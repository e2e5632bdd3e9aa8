"""What the thesis's robot had learned after 30 episodes (table 5.3)."""

from __future__ import annotations

from typing import Final

TABLE_5_3: Final = (
    (0.9494, -0.6495, -0.5848),
    (0.7950, -0.0449, -0.2863),
    (0.7120, 0.1365, -0.3091),
    (0.4466, 0.1255, -0.0286),
    (0.8803, 1.4476, 1.1834),
    (0.3014, 0.3008, 0.8993),
    (-0.5585, -0.0546, 1.1205),
    (-0.3775, 0.0077, 0.8443),
)
"""Q-values; rows by state, columns by action."""
