"""The four LCD screens as text: six lines of 16 characters in buffers that were made at the start (thesis 3.3.3)."""

from txt1pico import core as board

LINES = 6
WIDTH = 16
SPACE, MINUS, POINT, ZERO, DASH = 32, 45, 46, 48, 45

NAMES = (b"STATUS", b"PWM", b"ENCODERS", b"PID GAINS")
STATES = (b"EXTERNAL", b"GOOD", b"WARNING", b"BAD")
CHANNELS = (b"motor", b"front", b"rear", b"pwm4", b"pwm5")
GAIN_ROWS = LINES - 2


class Panel:
    """What the display shows.

    Attributes:
        lines: the text, `LINES` buffers of `WIDTH` characters.

    """

    def __init__(self):
        self.lines = tuple(bytearray(b" " * WIDTH) for _ in range(LINES))
        self._line = self.lines[0]

    def draw(self, core):
        """Write the core's present screen."""
        for line in self.lines:
            for at in range(WIDTH):
                line[at] = SPACE
        self._text(0, 0, NAMES[core.screen])
        if core.screen == board.STATUS:
            self._status(core)
        elif core.screen == board.PWM:
            self._pwm(core)
        elif core.screen == board.ENCODERS:
            self._encoders(core)
        else:
            self._gains(core)

    def _status(self, core):
        self._text(0, 9, b"ARMED" if core.armed else b"stop")
        self._text(1, 0, b"link" if core.link_alive else b"NO LINK")
        self._text(1, 9, b"comb" if core.combined_selected else b"enc")
        self._text(2, 0, STATES[core.battery_state])
        self._number(3, 0, core.voltage1 >> 4, 3)
        self._number(3, 9, core.voltage2 >> 4, 3)
        self._text(4, 0, b"v")
        self._number(4, 2, core.v, 3)
        self._text(5, 0, b"w")
        self._number(5, 2, core.omega >> 4, 3)

    def _pwm(self, core):
        self._text(0, 6, b"manual" if core.manual else b"control")
        for channel in range(5):
            self._text(1 + channel, 0, CHANNELS[channel])
            self._number(1 + channel, 8, core.outputs[channel], 0)

    def _encoders(self, core):
        self._text(1, 0, b"right")
        self._number(1, 8, core.right, 0)
        self._text(2, 0, b"left")
        self._number(2, 8, core.left, 0)
        self._text(3, 0, b"v")
        self._number(3, 8, core.odometry.v >> 7, 3)
        self._text(4, 0, b"w")
        self._number(4, 8, core.odometry.omega >> 4, 3)

    def _gains(self, core):
        for k in range(3):
            self._number(1, 5 * k, core.linear_gains[k] // 10, 2)
        for row in range(GAIN_ROWS):
            which = core.scroll + row
            if which < core.set_count:
                self._number(2 + row, 0, core.sets[4 * which] // 10, 2)
                self._number(2 + row, 6, core.sets[4 * which + 1] // 1000, 0)
                self._number(2 + row, 10, core.sets[4 * which + 2] // 1000, 0)

    def _text(self, row, column, text):
        line = self.lines[row]
        for at in range(len(text)):
            if column + at < WIDTH:
                line[column + at] = text[at]

    def _number(self, row, column, value, decimals):
        """Write a number of thousandths (3), hundredths (2) or ones (0), as it is read."""
        line = self.lines[row]
        if value < 0:
            line[column] = MINUS
            column += 1
            value = -value
        tens = 1
        digits = 1
        while value // tens >= 10 or digits <= decimals:
            tens *= 10
            digits += 1
        while digits:
            if column >= WIDTH:
                return
            if digits == decimals and decimals:
                line[column] = POINT
                column += 1
                if column >= WIDTH:
                    return
            line[column] = ZERO + value // tens % 10
            column += 1
            digits -= 1
            tens //= 10
