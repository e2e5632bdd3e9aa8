"""The Pico's own hardware: pins, pulses, counters, voltages, the line to the host. Thin, as a desk has only fakes."""

import select
import sys
import time
from array import array

from machine import ADC, PWM, UART, WDT, Pin, Timer

from txt1pico.core import CENTRE, DOWN, LEFT, RIGHT, UP
from txt1pico.quadrature import Quadrature

PULSE_RATE = 50
NEUTRAL_NS = 1500000
WATCHDOG_MS = 500
GUARD_MS = 20
GUARD_PATIENCE = 5
"""Cycles without a sign of life from the loop after which the guard puts out neutral pulses: 0.1 s."""
BUTTONS = (LEFT, RIGHT, UP, DOWN, CENTRE)
CHUNK = 64


def nanoseconds(counts):
    """Return the length of the pulse for so many PWM counts: 1 ms at -24000, 1.5 ms at 0, 2 ms at 24000."""
    return NEUTRAL_NS + counts * 125 // 6


class Channel:
    """A servo output.

    Args:
        pin: its number.
        direction: 1, or -1 for one that is mounted the other way round.
        trim: added to the counts.

    """

    def __init__(self, pin, direction=1, trim=0):
        Pin(pin, Pin.OUT, value=0)  # low until the first pulse, as a servo that sees no pulse stays where it is
        self._direction, self._trim = direction, trim
        self._pwm = PWM(Pin(pin))
        self._pwm.freq(PULSE_RATE)
        self.put(0)

    def put(self, counts):
        """Put out so many counts."""
        counts = counts * self._direction + self._trim
        self._pwm.duty_ns(nanoseconds(max(-24000, min(24000, counts))))

    def neutral(self):
        """Put out the pulse at which nothing moves."""
        self._pwm.duty_ns(nanoseconds(self._trim))


class ServoInputs:
    """The pulses of a receiver's servo outputs at three pins, measured by interrupts that take no memory."""

    def __init__(self, pins):
        self._rose = array("i", (0, 0, 0))
        self.pulses = array("i", (0, 0, 0))  # us; 0: none since the last look
        self._pins = tuple(Pin(pin, Pin.IN) for pin in pins)
        for k in range(3):
            self._pins[k].irq(self._handler(k), Pin.IRQ_RISING | Pin.IRQ_FALLING, hard=True)

    def _handler(self, k):
        rose, pulses = self._rose, self.pulses

        def changed(pin):
            if pin.value():
                rose[k] = time.ticks_us()
            else:
                pulses[k] = time.ticks_diff(time.ticks_us(), rose[k])

        return changed

    def take(self, hand):
        """Hand over the pulses once each pin had one."""
        pulses = self.pulses
        if pulses[0] and pulses[1] and pulses[2]:
            hand.pulses(pulses[0], pulses[1], pulses[2])
            pulses[0] = pulses[1] = pulses[2] = 0


class Hardware:
    """Everything around the core.

    Args:
        settings: as `txt1pico.store.check` returns them.

    """

    def __init__(self, settings):
        s = settings
        self.motor = Channel(s["motor_pin"], s["motor_direction"], s["motor_trim"])
        self.channels = (
            self.motor,
            Channel(s["front_pin"], s["front_direction"], s["front_trim"]),
            Channel(s["rear_pin"], s["rear_direction"], s["rear_trim"]),
            Channel(s["pwm4_pin"]),
            Channel(s["pwm5_pin"]),
        )
        self.right = Quadrature(0, s["right_pin"], s["right_direction"])
        self.left = Quadrature(1, s["left_pin"], s["left_direction"])
        self._packs = tuple(None if s[name] is None else ADC(Pin(s[name])) for name in ("battery1_pin", "battery2_pin"))
        self._divider = s["divider"]
        self._switches = Pin(s["atx_pin"], Pin.OUT, value=1), Pin(s["esc_pin"], Pin.OUT, value=0)
        self._buzzer = Pin(s["buzzer_pin"], Pin.OUT, value=0)
        self._leds = Pin(s["receive_led_pin"], Pin.OUT, value=0), Pin(s["transmit_led_pin"], Pin.OUT, value=0)
        pins = s["button_pins"] or ()
        self._buttons = tuple(Pin(pin, Pin.IN, Pin.PULL_UP) for pin in pins)
        self._uart = None if s["uart"] is None else UART(s["uart"], s["baud"], timeout=0, rxbuf=512, txbuf=512)
        self._radio = self._inputs = None
        given = s["receiver"]
        if given is not None and given["protocol"] == "pwm":
            self._inputs = ServoInputs(given["pins"])
        elif given is not None:
            sbus = given["protocol"] == "sbus"
            lines = {"tx": Pin(given["tx_pin"]), "rx": Pin(given["rx_pin"]), "timeout": 0, "rxbuf": 256}
            if sbus:
                lines["parity"], lines["stop"], lines["invert"] = 0, 2, UART.INV_RX
            self._radio = UART(given["uart"], 100000 if sbus else 420000, **lines)
        self._usb = select.poll()
        self._usb.register(sys.stdin, select.POLLIN)
        self._chunk = bytearray(CHUNK)
        self._byte = memoryview(self._chunk)[:1]
        self.due = False
        self.periods = 0
        self.wireless = None
        self._silent = 0
        self._stopped = False
        self._watchdog = None
        self._cycle = Timer()
        self._guard = Timer()

    def start(self):
        """Start the cycle, the guard that watches the loop, and the watchdog that restarts the chip."""
        self._cycle.init(freq=PULSE_RATE, mode=Timer.PERIODIC, callback=self._tick)
        self._guard.init(period=GUARD_MS, mode=Timer.PERIODIC, hard=True, callback=self._watch)
        self._watchdog = WDT(timeout=WATCHDOG_MS)

    def _tick(self, _):
        """Say that a cycle is due."""
        self.periods += 1
        self.due = True

    def _watch(self, _):
        """Put out neutral pulses when the loop has shown no life; called from an interrupt, so it takes no memory."""
        self._silent += 1
        if self._silent > GUARD_PATIENCE:
            self.neutral()
        if self._stopped and self._watchdog is not None:
            self._watchdog.feed()

    def alive(self):
        """Show the loop's life; the loop alone calls this."""
        self._silent = 0
        if self._watchdog is not None:
            self._watchdog.feed()

    def stop(self):
        """End the cycle: neutral pulses, the ESC off. From here on the guard feeds the watchdog, which never ends."""
        self._cycle.deinit()
        self.neutral()
        self._switches[1].value(0)
        self._stopped = True

    def neutral(self):
        """Motor off and steering straight."""
        self.channels[0].neutral()
        self.channels[1].neutral()
        self.channels[2].neutral()

    def put(self, core):
        """Put out what the core says."""
        for channel in range(5):
            self.channels[channel].put(core.outputs[channel])
        self._switches[0].value(core.switches & 1)
        self._switches[1].value(core.switches >> 1)
        self._buzzer.value(core.buzzer)
        self._leds[0].value(core.received & 1)
        self._leds[1].value(core.transmitted & 1)

    def voltage(self, pack):
        """Return the reading of a pack, mV; 0 where there is none."""
        adc = self._packs[pack]
        return 0 if adc is None else (adc.read_u16() * 3300 >> 16) * self._divider // 1000

    def buttons(self):
        """Return the joystick's buttons that are held down."""
        held = 0
        for k in range(len(self._buttons)):
            if not self._buttons[k].value():
                held |= BUTTONS[k]
        return held

    def receive(self, core):
        """Hand the core what has come on either line, and from a radio control's receiver."""
        if self._inputs is not None:
            self._inputs.take(core.hand)
        if self._radio is not None:
            while self._radio.any():
                count = self._radio.readinto(self._chunk)
                if not count:
                    break
                core.hand.receive(self._chunk, count)
        if self._uart is not None:
            while self._uart.any():
                count = self._uart.readinto(self._chunk)
                if not count:
                    break
                core.receive(self._chunk, count)
        for _ in range(CHUNK):
            if not self._usb.poll(0):
                break
            sys.stdin.buffer.readinto(self._byte)
            core.receive(self._chunk, 1)
        if self.wireless is not None and self.due:
            self.wireless.poll(core, 20)

    def send(self, core):
        """Send what the core has for its host, and for the transmitter of a radio control."""
        hand = core.hand
        if self._radio is not None and hand.telemetry_length:
            self._radio.write(memoryview(hand.telemetry)[: hand.telemetry_length])
            hand.telemetry_length = 0
        transmitter = core.transmitter
        if transmitter.length:
            data = memoryview(transmitter.buffer)[: transmitter.length]
            if self._uart is not None:
                self._uart.write(data)
            sys.stdout.buffer.write(data)
            if self.wireless is not None:
                self.wireless.send(data)
            transmitter.length = 0
