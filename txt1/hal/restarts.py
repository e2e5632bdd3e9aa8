"""Detects from two consecutive messages of a board that the board has restarted; no message reports it.

A board that restarts loses its gains and the state of its power switches, and its odometry starts again at 0. A host
that did not notice would drive with dead loops, and its own pose would jump. So four rules examine the messages: three
for poses, one for battery levels. Each rule looks for a change that driving cannot explain.

Let a pose (x0, y0, theta0) with speeds v0 and omega0 be followed by (x1, y1, theta1) with v1 and omega1, and let dt be
the time between their arrivals. A line may hold back what it carries, and then it brings several messages in a bunch.
So the motion between two poses may have lasted longer than dt, by up to JUMP_TIME.

1. **A leap.** A pose farther away than (speed + JUMP_SPEED) (dt + JUMP_TIME) means that the board restarted:

       hypot(x1 - x0, y1 - y0) > (max(|v0|, |v1|) + JUMP_SPEED) (dt + JUMP_TIME)           or
       |theta1 - theta0|       > max(|omega0|, |omega1|) (dt + JUMP_TIME) + JUMP_ANGLE

   The speed is the larger of the two that were reported. JUMP_SPEED and JUMP_ANGLE allow for a speed in between.
2. **Exactly 0, 0, 0, and at rest.** A board begins with this pose. A vehicle reaches it by driving only from close by:
within ROUNDING, the rounding, or as far as its speed carries it in dt and the period of its loops, AT_ONCE. Otherwise,

       hypot(x0, y0) > |v0| (dt + AT_ONCE) + ROUNDING       or       |theta0| > |omega0| (dt + AT_ONCE) + ROUNDING,

   it has restarted. This is much narrower than the first rule: it tells also of a board that had driven half a metre.
3. **Exactly 0, 0, 0 after a gap** of PAUSE or more may mean a restart. A vehicle that never left the origin shows no
leap, and a restart takes this long. The messages of a restart and of a mere gap are the same, so it counts as a
restart.
4. **A battery filter that begins anew.** Boards smooth a voltage u by y(k) = 0.6 y(k-1) + 0.4 u, from y = 0 at
   power-up. So the first level is 0.4 u, while the level before was u. A pack that is pulled out leaves 0.6 of its
   level. Hence STARTS_AGAIN lies around 0.4, and all packs have to agree.

All functions depend on their arguments only; the caller (`txt1.hal.serial`) has the clock.
"""

from math import hypot
from typing import Final

from txt1.model.kinematics import wrap_angle
from txt1.protocol.messages import EncoderOdometry

JUMP_TIME: Final = 0.5  # s
JUMP_SPEED: Final = 0.3  # m/s
JUMP_ANGLE: Final = 1.5  # rad
AT_ONCE: Final = 0.1  # s
# m, and rad
ROUNDING: Final = 0.003
PAUSE: Final = 0.205  # s
STARTS_AGAIN: Final = (0.3, 0.5)
# V: below this level a pack is not connected, and its level means nothing
FITTED: Final = 1.0


def restarted(before: EncoderOdometry, after: EncoderOdometry, dt: float) -> str:
    """Return why a board has restarted between two poses that arrived `dt` s apart (rules 1 to 3); "" if it has not."""
    if jumped(before, after, dt):
        return "the board restarted: its odometry jumped"
    if dt >= PAUSE and at_origin(after):
        return f"the board paused for {dt:.2f} s, and may have restarted"
    return ""


def jumped(before: EncoderOdometry, after: EncoderOdometry, dt: float) -> bool:
    """Return whether no motion leads from one pose to the other within dt s of arrival (rules 1 and 2)."""
    if at_origin(after):
        near = hypot(before.x, before.y) <= abs(before.v) * (dt + AT_ONCE) + ROUNDING
        straight = abs(wrap_angle(before.theta)) <= abs(before.omega) * (dt + AT_ONCE) + ROUNDING
        return not (near and straight)
    reach = (max(abs(before.v), abs(after.v)) + JUMP_SPEED) * (dt + JUMP_TIME)
    turn = max(abs(before.omega), abs(after.omega)) * (dt + JUMP_TIME) + JUMP_ANGLE
    return hypot(after.x - before.x, after.y - before.y) > reach or abs(wrap_angle(after.theta - before.theta)) > turn


def at_origin(pose: EncoderOdometry) -> bool:
    """Return whether the pose is exactly the pose at power-up."""
    return pose.x == pose.y == pose.theta == pose.v == pose.omega == 0.0


def started_again(before: tuple[float, float], after: tuple[float, float]) -> bool:
    """Return whether the battery filter has started again at 0 V between two messages, levels in V (rule 4)."""
    low, high = STARTS_AGAIN
    fitted = [(old, new) for old, new in zip(before, after, strict=True) if old > FITTED]
    return bool(fitted) and all(low * old < new < high * old for old, new in fitted)
