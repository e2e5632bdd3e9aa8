"""The battery's discharge line (thesis 3.6.3, figure 3.13)."""

from typing import Final

# voltage of a full pack under full load, V
INTERCEPT_V: Final = 12.165769
# fall of the voltage under full load, V/min
SLOPE_V_PER_MIN: Final = 0.033691
# minutes under full load after which a pack is empty as far as the robot is concerned
SAFE_END_MIN: Final = 46.0
# minutes under full load after which the cut-off circuit opens
CUT_OFF_MIN: Final = 50.0
# below this the hardware cuts the power
CUT_OFF_V: Final = 9.25
# and above this
OVERVOLTAGE_V: Final = 14.0
# 6500 mAh of 11.4 V on average in 50 min: what the robot draws under full load, W
FULL_LOAD_W: Final = 89.0
# m/s at which that was measured
FULL_LOAD_SPEED: Final = 0.5
SAFE_END_V: Final = INTERCEPT_V - SLOPE_V_PER_MIN * SAFE_END_MIN


def pack_voltage(used_min: float) -> float:
    """Voltage of a pack, V, after `used_min` minutes under full load.

    The fitted line up to the safe end; from there straight to the cut-off (assumed).
    """
    if used_min <= SAFE_END_MIN:
        return INTERCEPT_V - SLOPE_V_PER_MIN * used_min
    fall = (SAFE_END_V - CUT_OFF_V) / (CUT_OFF_MIN - SAFE_END_MIN)
    return max(SAFE_END_V - fall * (used_min - SAFE_END_MIN), CUT_OFF_V)


def remaining_time(voltage: float, end_min: float = SAFE_END_MIN) -> float:
    """Seconds left under full load at a pack voltage in V: clamp(end - t(V), 0, end)."""
    used_min = (INTERCEPT_V - voltage) / SLOPE_V_PER_MIN
    return 60.0 * min(max(end_min - used_min, 0.0), end_min)
