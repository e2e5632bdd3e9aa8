"""The program of the Pico: hardware and core, neutral outputs on every way out."""

import gc
import sys
import time

import machine
import micropython
from txt1pico import VERSION, store
from txt1pico.core import FAULT, Core
from txt1pico.hardware import Hardware
from txt1pico.odometry import Odometry
from txt1pico.radio import Radio
from txt1pico.screens import Panel

LOG = "fault.log"


def build(settings):
    """Return hardware, core, and display (None without one)."""
    odometry = Odometry(settings["circumference"], settings["track_width"])
    hand = None
    if settings["receiver"] is not None:
        hand = Radio(settings["receiver"])
    identity = "txt1pico %s %s" % (VERSION, settings["name"])
    core = Core(odometry, identity.encode(), hand)
    if settings["gains"] is not None:
        core.keep_gains(settings["gains"])
    hardware = Hardware(settings)
    display = None
    if settings["display_sda_pin"] is not None:
        from txt1pico.display import Display

        display = Display(settings["display_sda_pin"], settings["display_scl_pin"])
    if settings["wifi"] is not None:
        from txt1pico import wifi

        hardware.wireless = wifi.connect(settings["wifi"])
    return hardware, core, display


def loop(hardware, core, display):
    """Run until the host releases the board; whatever is raised leaves the outputs neutral."""
    panel = Panel()
    micropython.kbd_intr(-1)  # on the line to the host a byte 3 is a number
    try:
        hardware.start()
        while not core.released:
            hardware.receive(core)
            hardware.send(core)
            if hardware.due:
                hardware.due = False
                periods, hardware.periods = hardware.periods, 0
                core.step(
                    hardware.right.counts(),
                    hardware.left.counts(),
                    hardware.voltage(0),
                    hardware.voltage(1),
                    hardware.buttons(),
                    max(periods, 1),
                )
                hardware.put(core)
                hardware.alive()
                if display is not None:
                    panel.draw(core)
                    display.draw(panel)
    finally:
        core.disarm(FAULT)
        hardware.stop()
        micropython.kbd_intr(3)


def note(error):
    """Keep what went wrong for `txt1 firmware log`; a full flash keeps nothing."""
    try:
        with open(LOG, "w") as file:
            file.write("%d ms\n" % time.ticks_ms())
            sys.print_exception(error, file)
    except OSError:
        pass


def main():
    """Run the board; after a fault restart the chip, which leaves every pin low and then neutral."""
    settings, problem = store.load()
    if problem:
        note(ValueError(problem))
    hardware, core, display = build(settings)
    gc.collect()
    try:
        loop(hardware, core, display)
    except Exception as error:
        note(error)
        machine.reset()


if __name__ == "__main__":
    main()
