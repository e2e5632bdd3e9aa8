"""How long tests wait in real time: one unit, scaled by `TXT_PATIENCE`; see `rigs.patience`."""

from rigs.patience import LIMIT, LOOK, MISSED, PATIENT, STALLED, TXT1, S, lateness, surviving, until, wait_until

__all__ = [
    "LIMIT",
    "LOOK",
    "MISSED",
    "PATIENT",
    "STALLED",
    "TXT1",
    "S",
    "lateness",
    "surviving",
    "until",
    "wait_until",
]
