"""Settings in flash: pins, directions, trims, dimensions, written to a new file that takes the old one's place."""

import json
import os

FILE = "settings.json"

DEFAULTS = {
    "name": "pico",
    "uart": None,  # number of the UART the host is on, besides USB; None: USB alone
    "baud": 57600,
    "motor_pin": 2, "front_pin": 3, "rear_pin": 4, "pwm4_pin": 5, "pwm5_pin": 6,
    "motor_direction": 1, "front_direction": 1, "rear_direction": 1,
    "motor_trim": 0, "front_trim": 0, "rear_trim": 0,  # PWM counts
    "right_pin": 10, "left_pin": 12, "right_direction": 1, "left_direction": 1,
    "circumference": 5125,  # of a tyre, 0.1 mm, a multiple of 5
    "track_width": 250,  # mm
    "battery1_pin": 26, "battery2_pin": None,
    "divider": 4800,  # mV at the battery for 1000 mV at the pin
    "atx_pin": 14, "esc_pin": 15,
    "buzzer_pin": 16, "receive_led_pin": 17, "transmit_led_pin": 18,
    "button_pins": None,  # of left, right, up, down, centre; None: no joystick
    "display_sda_pin": None, "display_scl_pin": None,  # of an SSD1306; None: no display
    "wifi": None,  # or {"ssid": ..., "password": ..., "secret": ..., "port": 5701}; a Pico W only
    "receiver": None,  # of a radio control, as docs/rc.md says; None: no hand takes over here
    "gains": None,  # at power-up, in thousandths: [[kp, ki, kd], [v_max, kp, ki, kd], ...]; None: 0 until a host comes
}  # fmt: skip
"""Every setting and what it is on a board as docs/firmware.md draws it."""


class SettingsError(ValueError):
    """A setting is unknown or of the wrong kind; the message names it."""


def check(settings):
    """Return the settings with the defaults of those that are not there; raise SettingsError."""
    whole = dict(DEFAULTS)
    for name, value in settings.items():
        if name not in DEFAULTS:
            raise SettingsError("unknown setting " + name)
        default = DEFAULTS[name]
        if default is not None and value is not None and type(value) is not type(default):
            raise SettingsError("%s: %r is no %s" % (name, value, type(default).__name__))
        whole[name] = value
    if whole["circumference"] % 5 or not 500 <= whole["circumference"] <= 50000:
        raise SettingsError(
            "circumference: %r is not a multiple of 5 from 500 to 50000 (0.1 mm)" % whole["circumference"]
        )
    if not 50 <= whole["track_width"] <= 2000:
        raise SettingsError("track_width: %r is not from 50 to 2000 (mm)" % whole["track_width"])
    wifi = whole["wifi"]
    if wifi is not None and (not {"ssid", "password", "secret"} <= set(wifi) or len(wifi["secret"]) < 8):
        raise SettingsError("wifi: it takes ssid, password, and a secret of at least 8 characters")
    if whole["receiver"] is not None:
        check_receiver(whole["receiver"])
    gains = whole["gains"]
    if gains is not None and [len(row) for row in gains] != [3] + [4] * (len(gains) - 1):
        raise SettingsError("gains: the first row has three numbers, every other four")
    for name in ("motor_direction", "front_direction", "rear_direction", "right_direction", "left_direction"):
        if whole[name] not in (1, -1):
            raise SettingsError("%s: %r is neither 1 nor -1" % (name, whole[name]))
    return whole


def check_receiver(given):
    """Raise SettingsError if a receiver's settings are not whole: protocol, lines, and the pulses of three channels."""
    protocol = given.get("protocol")
    if protocol not in ("pwm", "sbus", "crsf"):
        raise SettingsError("receiver: protocol is one of pwm, sbus, crsf, not %r" % (protocol,))
    lines = ("pins",) if protocol == "pwm" else ("uart", "rx_pin", "tx_pin")
    for name in lines + ("throttle", "steering", "switch"):
        if name not in given:
            raise SettingsError("receiver: it takes %s; see docs/rc.md" % name)
    for name in given:
        if name not in lines + ("protocol", "throttle", "steering", "switch", "speed"):
            raise SettingsError("receiver: unknown setting %s" % name)
    if protocol == "pwm" and len(given["pins"]) != 3:
        raise SettingsError("receiver: pins takes three, of throttle, steering and switch")
    channels = []
    for name, size in (("throttle", 4), ("steering", 4), ("switch", 3)):
        row = given[name]
        if len(row) != size or not 1 <= row[0] <= 16:
            raise SettingsError("receiver: %s takes a channel from 1 to 16 and %d pulses (us)" % (name, size - 1))
        channels.append(row[0])
        ways = [row[k + 1] - row[k] for k in range(1, size - 1)]
        least = 200 if size == 4 else 400
        if min(ways) < least and max(ways) > -least:
            raise SettingsError("receiver: the pulses of %s do not rise or fall by %d us" % (name, least))
    if len(set(channels)) < 3:
        raise SettingsError("receiver: throttle, steering and switch need three different channels")


def load(file=FILE):
    """Return the settings and, in words, what was wrong with the file; a bad one leaves the defaults in force."""
    try:
        with open(file) as stored:
            return check(json.load(stored)), ""
    except OSError:
        return dict(DEFAULTS), ""  # there is none yet
    except (ValueError, AttributeError) as error:
        return dict(DEFAULTS), "%s: %s" % (file, error)


def save(settings, file=FILE):
    """Write settings; a power cut at any moment leaves the old file or the new one, never half of one.

    Raises SettingsError, and OSError when the flash is full; then the old file stays.
    """
    check(settings)
    fresh = file + ".new"
    try:
        with open(fresh, "w") as stored:
            json.dump(settings, stored)
            stored.flush()
    except OSError:
        try:
            os.remove(fresh)
        except OSError:
            pass
        raise
    if hasattr(os, "sync"):
        os.sync()
    os.rename(fresh, file)
