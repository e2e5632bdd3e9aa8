"""The numbers that board and computer share. Made by firmware/make_facts.py: do not edit."""

try:
    from micropython import const
except ImportError:  # under CPython

    def const(value):
        """Return the value."""
        return value


VELOCITY = const(103)
ENCODER_ODOMETRY = const(104)
COMBINED_ODOMETRY = const(105)
BATTERY_LEVELS = const(106)
PWM_TEST = const(108)
POWER_CONTROL = const(110)
PWM_COMMAND = const(111)
PID_SET = const(112)
RC_REPORT = const(113)
RC_PERMIT = const(114)
IDENTITY = const(127)
RELEASE = b"REPL"
ACCEPTED = const(60)
REJECTED = const(85)
SETS_MAX = const(14)
HOST_FRAMES = (103, 4, 105, 20, 108, 20, 110, 2, 111, 8, 114, 2, 127, 0, 127, 4)
PWM_MAX = const(24000)
STEERING_MAX = const(18000)
MOTOR_MAX = const(8000)
V_MAX = const(1500)
RADIUS_MIN = const(560)
COMMAND_TIMEOUT = const(250)
COMBINED_TIMEOUT = const(100)
VELOCITY_MIN = const(1)
COMBINED_MIN = const(2)
MISSED_MAX = const(5)
LET_GO = const(1000)
MEASURED_MAX = const(3000)
RUNAWAY_MOTOR = const(2000)
RUNAWAY_TIME = const(300)
RUNAWAY_COUNTS = const(150)
RUNAWAY_SPEED = const(2000)
PERSISTS = const(100)
NOISE_COUNTS = const(3)
DISAGREEMENT = const(500)
CIRCUMFERENCE = const(5125)
TRACK_WIDTH = const(250)
COUNTS_PER_REV = const(1600)
FITTED = const(1000)
GOOD = const(9500)
WARNING = const(9000)
BAD_TIME = const(5000)
BEEP_LOW = const(2000)
BEEP_EMPTY = const(1000)
CUT_OFF = const(9250)
FULL = const(12166)
SLOPE = const(33691)
SAFE_END = const(2760)
