"""The board's tasks and its safety gate, as one step every 20 ms (thesis 3.3.3): no hardware, no clock, no memory.

The owner of the hardware hands in bytes (`receive`), wheel counts, voltages and buttons (`step`), and puts out
`outputs`, `switches`, `buzzer` and the bytes in `transmitter`. Ages are counted in ms and stop counting at AGE_MAX, so
nothing old ever becomes new.

Units: mm/s and mrad/s, PWM counts, mV; measured speeds in 1/128 mm/s and yaw rates in 1/16 mrad/s.
"""

from array import array

from txt1pico import facts, frame, radio
from txt1pico.fixed import KD_MAX, KI_MAX, KP_MAX, Pid
from txt1pico.odometry import Odometry
from txt1pico.runaway import NOTHING, RunawayWatch

PERIOD = 20
"""ms between two steps."""
AGE_MAX = 1 << 20
STANDS = 300
"""ms without a count after which the vehicle was seen to stand."""
SILENCE = 60
"""ms without a byte after which a half frame is given up: more than 50, and whole steps."""
PERMITS = 1000
"""ms for which a host that permits the hand to drive is known to hear it."""

STATUS, PWM, ENCODERS, GAINS = range(4)
EXTERNAL, GOOD, WARNING, BAD = range(4)
LEFT, RIGHT, UP, DOWN, CENTRE = 1, 2, 4, 8, 16

REASONS = (
    "armed",
    "not armed yet",
    "link lost",
    "runaway",
    "batteries bad",
    "batteries cut off",
    "missed cycles",
    "ATX off",
    "fault",
    "released",
)
ARMED, NOT_YET, LINK_LOST, RUNAWAY, BATTERIES_BAD, CUT_OFF, MISSED, ATX_OFF, FAULT, RELEASED = range(10)


def clip(value, limit):
    """Return the value within +-limit."""
    return limit if value > limit else -limit if value < -limit else value


class Core:
    """The board.

    Args:
        odometry: with this car's dimensions.
        identity: told on request, bytes.
        hand: the `txt1pico.radio.Radio` of a radio control; None: there is none.

    Attributes:
        outputs: counts of motor, front, rear, and the two free servos.
        armed: the gate is open.
        reason: why it is closed, an index of REASONS.
        switches: bit 0 the ATX supply, bit 1 the ESC.

    """

    def __init__(self, odometry=None, identity=b"txt1pico", hand=None):
        self.odometry = Odometry() if odometry is None else odometry
        self.identity = identity
        self.receiver = frame.Receiver()
        self.transmitter = frame.Transmitter()
        self.outputs = array("i", (0, 0, 0, 0, 0))
        self.runaway = RunawayWatch()
        self.linear = Pid(128, facts.PWM_MAX)
        self.angular = Pid(16, facts.STEERING_MAX)
        self.linear_gains = array("i", (0, 0, 0))
        self.sets = array("i", (0,) * (4 * facts.SETS_MAX))
        self.set_count = 0
        self.gains_loaded = False
        self.switches = 3
        self.manual = False
        self.screen = self.scroll = 0
        self.armed = False
        self.reason = NOT_YET
        self.link_alive = self.combined_selected = False
        self.received = self.transmitted = self.late = 0
        self.voltage1 = self.voltage2 = 0
        self.battery_state = EXTERNAL
        self.remaining = -1
        self.buzzer = True
        self._beeps = 0  # ms into the buzzer's pattern
        self.released = False
        self.v = self.omega = 0  # set-point in force, mm/s and 1/16 mrad/s
        self.set_in_force = 0
        self.right = self.left = 0  # counts of the last cycle
        self._v = self._omega = 0  # what the host asked for
        self._age = self._manual_age = self._combined_age = self._wanted_age = self._byte_age = AGE_MAX
        self._manual_pwm = array("i", (0, 0, 0))
        self._servos = array("i", (0, 0))
        self._combined_v = self._combined_omega = 0
        self._still_age = 0  # since the last count of an encoder that has power
        self._velocities = self._combined = 0
        self._may_arm = True
        self._was_manual = False
        self._smoothed = False
        self._bad_age = 0
        self._pressed = 0
        self._to_mode = self._to_battery = self._to_odometry = self._to_button = 0
        self._epoch_ok = False  # whether the command came after the last arming or change of mode
        self._manual_ok = False
        self.hand = hand
        self._held = False  # whether the hand holds the wheel, or nobody may
        self._permitted = True  # whether the host lets the hand drive
        self._stopped = False  # whether somebody at a host has stopped it, which outlives the host
        self._permit_age = AGE_MAX
        self._must_rest = False  # whether the host has to ask for zero before it drives again

    def keep_gains(self, rows):
        """Start with these gains, in thousandths: three of the linear loop, then sets of v_max (mm/s) and three."""
        for k in range(3):
            self.linear_gains[k] = rows[0][k]
        sets = rows[1 : facts.SETS_MAX + 1]
        for k in range(len(sets)):
            for at in range(4):
                self.sets[4 * k + at] = sets[k][at]
        self.set_count = len(sets)
        self.gains_loaded = True

    # -- bytes of the host -----------------------------------------------------------------------------------------

    def receive(self, data, count):
        """Take `count` bytes that have come from the host, and obey the frames that they complete."""
        receiver = self.receiver
        self._byte_age = 0
        for at in range(count):
            receiver.put(data[at])
            if receiver.pending() >= 6:
                self._obey()
        self._obey()

    def _obey(self):
        receiver = self.receiver
        at = receiver.next()
        while at >= 0:
            self._take(receiver.buffer, at)
            at = receiver.next()
        if receiver.refused:
            receiver.refused = False
            self._answer(False)

    def _take(self, buffer, at):
        """Obey a frame."""
        command, data = buffer[at + 3], at + frame.DATA
        self.received += 1
        if command == facts.VELOCITY:
            self._velocities += 1
            self._take_velocity(frame.int16(buffer, data), frame.int16(buffer, data + 2))
        elif command == facts.PID_SET:
            self._answer(self._take_gains(buffer, data, buffer[at + 2]))
        elif command == facts.COMBINED_ODOMETRY:
            self._combined += 1
            self._combined_v = clip(frame.int32(buffer, data + 12), facts.MEASURED_MAX) * 128
            self._combined_omega = clip(frame.int32(buffer, data + 16), facts.MEASURED_MAX) * 16
            self._combined_age = 0
        elif command == facts.PWM_TEST:
            if self.manual:
                for channel in range(3):
                    self._manual_pwm[channel] = clip(frame.int32(buffer, data + 4 * channel), facts.PWM_MAX)
                self._take_servos(buffer, data + 12)
                self._manual_age, self._manual_ok = 0, True
                if self._manual_pwm[0]:
                    self._wanted_age = 0
        elif command == facts.PWM_COMMAND:
            self._take_servos(buffer, data)
        elif command == facts.POWER_CONTROL:
            self._switch(buffer[data], buffer[data + 1])
        elif command == facts.RC_PERMIT:
            self._permit(buffer[data], buffer[data + 1])
        elif command == facts.IDENTITY:
            if buffer[at + 2] == 0:
                self._identify()
            else:
                self._release(buffer, data)

    def _take_velocity(self, v, omega):
        """Keep a set-point, brought inside the limits: speed first, then yaw rate by (2.16)."""
        if not (v or omega):
            self._must_rest = False
        elif not self._held:
            self._wanted_age = 0
        if self._must_rest and not self._held:
            v = omega = 0
        self._v = v = clip(v, facts.V_MAX)
        self._omega = clip(16 * omega, abs(v) * 16000 // facts.RADIUS_MIN)
        self._age, self._epoch_ok = 0, True

    def _permit(self, on, stopped):
        """Let the hand drive, or not; a stop binds it until a host permits it, whatever other hosts tell meanwhile."""
        if on > 1 or stopped > 1 or self.hand is None:
            return
        self._stopped = not on and (self._stopped or stopped == 1)
        self._permit_age = 0
        if on and not self._permitted:
            self.hand.let_go()
        self._permitted = on == 1

    def _take_servos(self, buffer, data):
        self._servos[0] = clip(frame.int32(buffer, data), facts.PWM_MAX)
        self._servos[1] = clip(frame.int32(buffer, data + 4), facts.PWM_MAX)

    def _take_gains(self, buffer, data, length):
        """Load the gains of a PID set; False, and nothing changed, when they are not acceptable."""
        count = (length - 12) // 16
        before = -frame.INT_MAX
        for k in range(count):
            v_max = frame.int32(buffer, data + 12 + 16 * k)
            if v_max <= before or not self._fits(buffer, data + 16 + 16 * k):
                return False
            before = v_max
        if not self._fits(buffer, data):
            return False
        for k in range(3):
            self.linear_gains[k] = frame.int32(buffer, data + 4 * k)
        for k in range(4 * count):
            self.sets[k] = frame.int32(buffer, data + 12 + 4 * k)
        self.set_count = count
        self.gains_loaded = True
        return True

    def _fits(self, buffer, data):
        """Whether three gains are within what the loops have room for."""
        return (
            abs(frame.int32(buffer, data)) <= KP_MAX
            and abs(frame.int32(buffer, data + 4)) <= KI_MAX
            and abs(frame.int32(buffer, data + 8)) <= KD_MAX
        )

    def _switch(self, switch, state):
        """Turn a power supply on or off; the ATX supply, which feeds the encoders, only when they saw it stand."""
        if switch > 1 or state > 1:
            return
        if switch == 0 and not state:
            stands = self._still_age >= STANDS or not self.switches & 1
            if self.armed and self._wanted_age >= facts.LET_GO and stands:
                self.disarm(ATX_OFF)
            if self.armed or not stands:
                return
        bit = 1 << switch
        self.switches = self.switches | bit if state else self.switches & ~bit

    # -- bytes for the host ----------------------------------------------------------------------------------------

    def _answer(self, accepted):
        transmitter = self.transmitter
        if transmitter.begin(facts.PID_SET, 1):
            transmitter.byte(facts.ACCEPTED if accepted else facts.REJECTED)
            transmitter.finish()

    def _identify(self):
        transmitter, identity = self.transmitter, self.identity
        if transmitter.begin(facts.IDENTITY, len(identity)):
            for at in range(len(identity)):
                transmitter.byte(identity[at])
            transmitter.finish()

    def _release(self, buffer, data):
        """Have the program end, at rest and with the gate closed from then on."""
        for k in range(len(facts.RELEASE)):
            if buffer[data + k] != facts.RELEASE[k]:
                return
        if not self.link_alive and not self.odometry.v:
            self.released = True
            self.disarm(RELEASED)

    def _send_odometry(self):
        transmitter, odometry = self.transmitter, self.odometry
        if transmitter.begin(facts.ENCODER_ODOMETRY, 20):
            transmitter.int32(odometry.x)
            transmitter.int32(odometry.y)
            transmitter.int32(odometry.theta)
            transmitter.int32((odometry.v + 64) >> 7)
            transmitter.int32((odometry.omega + 8) >> 4)
            transmitter.finish()
            self.transmitted += 1

    def _send_hand(self):
        transmitter, hand = self.transmitter, self.hand
        if transmitter.begin(facts.RC_REPORT, 12):
            transmitter.int16(hand.state)
            transmitter.int16(hand.v)
            transmitter.int16((hand.omega + 8) >> 4)
            for k in range(3):
                transmitter.int16(hand.heard[k])
            transmitter.finish()

    def _send_battery(self):
        transmitter = self.transmitter
        if transmitter.begin(facts.BATTERY_LEVELS, 4):
            transmitter.int16(self.voltage1 >> 4)
            transmitter.int16(self.voltage2 >> 4)
            transmitter.finish()

    # -- the gate --------------------------------------------------------------------------------------------------

    def disarm(self, reason):
        """Close the gate: outputs neutral at once."""
        if self.armed:
            self.armed, self.reason = False, reason
        self.neutral()

    def neutral(self):
        """Motor off, steering straight; the free servos stay where they are."""
        outputs = self.outputs
        outputs[0] = outputs[1] = outputs[2] = 0
        self.v = self.omega = 0

    def _renew(self):
        """Let no command count that came before now."""
        self._epoch_ok = self._manual_ok = False

    def _arm(self):
        """Open the gate with the link, and after any other stop when the host has asked for nothing for a second."""
        holds = self.hand is not None and self.hand.holds
        if (not self.link_alive and not holds) or self._wanted_age >= facts.LET_GO:
            self._may_arm = True
        if self.armed:
            self._may_arm = False
        elif (
            self._may_arm
            and not self.released
            and (self.link_alive or holds)
            and self.switches & 1
            and self._bad_age < facts.BAD_TIME
        ):
            self.armed, self.reason = True, ARMED
            self._renew()
            self.runaway.clear()

    # -- one cycle -------------------------------------------------------------------------------------------------

    def step(self, right, left, voltage1, voltage2, buttons, periods=1):
        """Run the tasks whose time has come.

        Args:
            right: counts of the right encoder since the last step, forward positive.
            left: those of the left one.
            voltage1: reading of pack 1, mV; 0 where none is fitted.
            voltage2: of pack 2.
            buttons: the joystick's buttons that are held down.
            periods: of 20 ms since the last step; more than 1 where one was missed.

        """
        dt = PERIOD * periods
        self._grow_older(dt)
        if self.hand is not None:
            self._ask_hand(dt)
        if periods > 1:
            self.late += periods - 1
            if periods > facts.MISSED_MAX:
                self.disarm(MISSED)
        self._control(dt)
        self.right, self.left = right, left
        if right or left or not self.switches & 1:
            self._still_age = 0
        self.odometry.advance(right, left, periods)
        self._to_mode -= dt
        if self._to_mode <= 0:
            self._to_mode += 1000
            self._judge_link()
        self._to_odometry -= dt
        if self._to_odometry <= 0:
            self._to_odometry += 50
            if self.link_alive:
                self._send_odometry()
                if self.hand is not None:
                    self._send_hand()
        self._to_battery -= dt
        if self._to_battery <= 0:
            self._to_battery += 1000
            self._judge_batteries(voltage1, voltage2)
        self._to_button -= dt
        if self._to_button <= 0:
            self._to_button += 100
            self._arm()
            self._press(buttons)
        self._beeps = (self._beeps + dt) % (2 * facts.BEEP_LOW)
        self.buzzer = self._sounds()

    def _sounds(self):
        """Return whether the buzzer sounds: without a pause while nobody drives, else as low or empty packs have it."""
        if not (self.link_alive or (self.hand is not None and self.hand.holds)):
            return True
        if self.battery_state == WARNING:
            return self._beeps < facts.BEEP_LOW
        return self.battery_state == BAD and self._beeps % (2 * facts.BEEP_EMPTY) < facts.BEEP_EMPTY

    def _ask_hand(self, dt):
        """See who drives by the radio control; a host that drives again has to ask for zero first."""
        hand = self.hand
        hand.step(dt)
        if not (self._permitted or self._stopped or self.link_alive) and self._permit_age > PERMITS:
            # nobody stopped it, and its host is dead: as at power-up, it waits for the throttle's neutral
            self._permitted = True
            hand.lose()
        held = hand.state != radio.COMPUTER
        if held:
            self._must_rest = True
            if hand.v:
                self._wanted_age = 0
        elif self._held:
            self._renew()
        self._held = held
        hand.tell(dt, self.voltage1 >> 4, self.armed)

    def _grow_older(self, dt):
        self._age = min(self._age + dt, AGE_MAX)
        self._manual_age = min(self._manual_age + dt, AGE_MAX)
        self._combined_age = min(self._combined_age + dt, AGE_MAX)
        self._wanted_age = min(self._wanted_age + dt, AGE_MAX)
        self._byte_age = min(self._byte_age + dt, AGE_MAX)
        self._still_age = min(self._still_age + dt, AGE_MAX)
        self._permit_age = min(self._permit_age + dt, AGE_MAX)
        if self._byte_age >= SILENCE and self.receiver.pending():
            self.receiver.expire()
            self._obey()

    def _control(self, dt):
        """Both loops, through the gate to the outputs."""
        odometry = self.odometry
        combined = self.combined_selected and self._combined_age <= facts.COMBINED_TIMEOUT
        v_now = self._combined_v if combined else clip(odometry.v, facts.MEASURED_MAX * 128)
        omega_now = self._combined_omega if combined else clip(odometry.omega, facts.MEASURED_MAX * 16)
        if self.armed:
            wrong = self.runaway.check(
                self.outputs[0], self.right, self.left, odometry.v, v_now if combined else odometry.v, dt
            )
            if wrong != NOTHING:
                self.disarm(RUNAWAY)
        manual = self.manual and not self._held
        v, omega = self._v, self._omega
        if self._held:
            v, omega = self._hand_v(), self.hand.omega
            fresh = self._permitted and self.hand.state == radio.HAND
        elif manual:
            fresh = self._manual_ok and self._manual_age <= facts.COMMAND_TIMEOUT
        else:
            fresh = self._epoch_ok and self._age <= facts.COMMAND_TIMEOUT
        rests = not manual and v_now == 0 and v == 0
        if self.armed:
            self.outputs[3], self.outputs[4] = self._servos[0], self._servos[1]
        heard = self.link_alive or self._held
        if not (self.armed and fresh and heard and self.switches & 2) or manual != self._was_manual or rests:
            self.linear.clear()
            self.angular.clear()
            self.neutral()
        elif manual:
            self._put(self._manual_pwm[0], self._manual_pwm[1], self._manual_pwm[2])
        else:
            self.v, self.omega = v, clip(omega, abs(v) * 16000 // facts.RADIUS_MIN)
            self._step_loops(v_now, omega_now)
        self._was_manual = manual

    def _hand_v(self):
        """Return the speed of the sticks, mm/s; a host that is heard and permits the hand may lower it."""
        v = self.hand.v
        if self._permit_age > PERMITS or self._age > facts.COMMAND_TIMEOUT:
            return v
        limit = self._v if (self._v > 0) == (v > 0) else 0
        return v if abs(v) <= abs(limit) else limit

    def _step_loops(self, v_now, omega_now):
        gains, sets, last = self.linear_gains, self.sets, self.set_count - 1
        self.linear.step(128 * self.v - v_now, gains[0], gains[1], gains[2])
        which = 0
        while which < last and sets[4 * which] * 128 < v_now:
            which += 1
        self.set_in_force = which
        error = self.omega - omega_now
        if v_now < 0:  # in reverse the steering acts the other way round
            error = -error
        if last >= 0:
            self.angular.step(error, sets[4 * which + 1], sets[4 * which + 2], sets[4 * which + 3])
        steering = self.angular.output if last >= 0 else 0
        # u > 0 turns left: the front wheels to the left, the rear ones to the right
        self._put(self.linear.output, -steering, steering)

    def _put(self, motor, front, rear):
        outputs = self.outputs
        outputs[0] = clip(motor, facts.MOTOR_MAX)
        outputs[1] = clip(front, facts.STEERING_MAX)
        outputs[2] = clip(rear, facts.STEERING_MAX)

    def _judge_link(self):
        """Say whether the host is alive, and which odometry counts, by the messages of the last second."""
        alive = self._velocities > facts.VELOCITY_MIN
        self.combined_selected = self._combined > facts.COMBINED_MIN
        self._velocities = self._combined = 0
        if not alive and not (self.hand is not None and self.hand.holds):
            self.disarm(LINK_LOST)
        self.link_alive = alive

    def _judge_batteries(self, voltage1, voltage2):
        """Smooth the voltages (kept in 1/16 mV), judge them, send them."""
        if self._smoothed:
            self.voltage1 = (6 * self.voltage1 + 64 * voltage1) // 10
            self.voltage2 = (6 * self.voltage2 + 64 * voltage2) // 10
        else:
            self.voltage1, self.voltage2, self._smoothed = 16 * voltage1, 16 * voltage2, True
        best = max(self.voltage1, self.voltage2) >> 4
        if best < facts.FITTED:
            self.battery_state = EXTERNAL
        elif best > facts.GOOD:
            self.battery_state = GOOD
        else:
            self.battery_state = WARNING if best > facts.WARNING else BAD
        self.remaining = -1
        if best >= facts.FITTED:  # the line of thesis figure 3.13, s
            self.remaining = clip(max(facts.SAFE_END - (facts.FULL - best) * 1000 * 60 // facts.SLOPE, 0), 60 * 60)
        self._bad_age = min(self._bad_age + 1000, AGE_MAX) if self.battery_state == BAD else 0
        reading = max(voltage1, voltage2)
        if facts.FITTED <= reading <= facts.CUT_OFF:
            self.disarm(CUT_OFF)
            self._bad_age = AGE_MAX
        elif self._bad_age > facts.BAD_TIME:
            self.disarm(BATTERIES_BAD)
        self._send_battery()

    def _press(self, buttons):
        """Act on the joystick's edges."""
        edges, self._pressed = buttons & ~self._pressed, buttons
        if edges & LEFT:
            self.screen = (self.screen - 1) % 4
        if edges & RIGHT:
            self.screen = (self.screen + 1) % 4
        if edges & UP:
            self.scroll = max(self.scroll - 1, 0)
        if edges & DOWN:
            self.scroll = min(self.scroll + 1, max(self.set_count - 1, 0))
        if edges & CENTRE:
            self.manual = not self.manual
            self._renew()
