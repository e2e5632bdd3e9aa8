"""`txt1 service`: lets systemd start a robot at boot, watch it, and start it again, disarmed, when it fails."""

import argparse
import grp
import os
import pwd
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from txt1 import commands
from txt1.cli import parsed
from txt1.commands import OK, flag, say, takes
from txt1.errors import ConfigError
from txt1.kernel.realtime import FIFO, OTHERS_NICENESS
from txt1.kit import options

# s without a cycle of the controller after which the robot counts as hung
WATCHDOG: Final = 2.0
HEADER: Final = "# made by 'txt1 service install'"

UNIT: Final = """\
{header}; 'txt1 service remove' takes it away
[Unit]
Description=TXT-1 robot ({name})
StartLimitIntervalSec=60
StartLimitBurst=10

[Service]
Type=notify
NotifyAccess=main
WorkingDirectory={directory}
ExecStart={command}
{user}# a restarted robot is disarmed; a mistake in the command line or the configuration is not mended by a restart
Restart=on-failure
RestartSec=2
RestartPreventExitStatus=2
# how it leaves when a signal ends it
SuccessExitStatus=129 130 143
WatchdogSec={watchdog:g}
WatchdogSignal=SIGKILL
TimeoutStopSec=15
# only the robot's own process is killed: a guard of outputs sets neutral then, and the others end by themselves
KillMode=process
# for --realtime
LimitRTPRIO={fifo}
LimitMEMLOCK=infinity
LimitNICE={niceness}
StandardOutput=journal
StandardError=journal
SyslogIdentifier={name}
{sandbox}
[Install]
WantedBy={target}
"""


SANDBOX: Final = """\
# it gains no rights, and uses no network but IP
NoNewPrivileges=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
RestrictSUIDSGID=yes
LockPersonality=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallErrorNumber=EPERM
UMask=0077
"""
"""For every unit. A process may write and run memory, as numba does, and may have priority, for --realtime."""

SYSTEM_SANDBOX: Final = """\
CapabilityBoundingSet=
# all files are read-only but for the folder that it runs in, and those that systemd makes for it
ProtectSystem=strict
ProtectHome=read-only
ReadWritePaths={directory}
PrivateTmp=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
ProtectProc=invisible
RestrictNamespaces=yes
RemoveIPC=yes
# of the devices it has serial ports, the I2C bus, GPIO pins, gamepads and cameras
DevicePolicy=closed
{devices}
"""
"""For units of the computer's: a user's service manager may do none of it."""

DEVICES: Final = ("ttyUSB", "ttyACM", "ttyAMA", "ttyS", "rfcomm", "i2c", "gpiochip", "input", "video4linux", "pts")
"""Kinds of devices, as /proc/devices has them."""

GROUPS: Final = ("dialout", "i2c", "gpio", "input", "video")
"""They own these devices, on Debian and Raspberry Pi OS, as far as a computer has them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions of `service`."""
    where = {
        "--user": flag("a service of this user's; the default, but for root"),
        "--system": flag("a service of the computer's; the default for root"),
        "--name": takes("NAME", "of the unit, txt1 by default", unit_name, default="txt1"),
    }
    runs_as = {"--as": takes("NAME", "the user of a --system service; by default who used sudo", str, dest="as_user")}
    command = {"run": {"nargs": argparse.REMAINDER, "metavar": "run ...", "help": "what to run: run and its options"}}
    commands.add_actions(parser, {"install": (install, where | runs_as | command), "remove": (remove, where)})


def unit_name(text: str) -> str:
    """Return the name of a unit that a word is; raises ArgumentTypeError."""
    if not text or not all(character.isascii() and (character.isalnum() or character in "-_") for character in text):
        raise argparse.ArgumentTypeError(f"'{text}' is no name of a unit: letters, digits, - and _")
    return text


def install(arguments: argparse.Namespace) -> int:
    """Write the unit and have it started at boot."""
    system = _system(arguments)
    path = unit_path(arguments.name, system=system)
    user = _user(arguments.as_user) if system else ""
    text = unit(arguments.name, run_options(arguments.run), user=user)
    if path.exists() and not path.read_text(encoding="utf-8").startswith(HEADER):
        raise ConfigError(f"{path} is not of our making; choose another --name")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    say(f"{path} is written")
    scope = "" if system else " --user"
    if _systemctl(system, "daemon-reload") and _systemctl(system, "enable", arguments.name):
        lingering = "" if system else "; 'loginctl enable-linger' has it started without a log-in"
        say(f"it starts at boot{lingering}; now: systemctl{scope} start {arguments.name}")
    else:
        say(f"then: systemctl{scope} daemon-reload && systemctl{scope} enable --now {arguments.name}")
    say(f"its log: journalctl{scope} --unit {arguments.name} --follow")
    return OK


def remove(arguments: argparse.Namespace) -> int:
    """Stop the service and take its unit away."""
    system = _system(arguments)
    path = unit_path(arguments.name, system=system)
    if not path.exists():
        raise ConfigError(f"there is no {path}; was it installed with {'--user' if system else '--system'}?")
    if not path.read_text(encoding="utf-8").startswith(HEADER):
        raise ConfigError(f"{path} is not of our making")
    _systemctl(system, "disable", "--now", arguments.name)
    path.unlink()
    _systemctl(system, "daemon-reload")
    say(f"{path} is removed")
    return OK


def _system(arguments: argparse.Namespace) -> bool:
    if arguments.user and arguments.system:
        raise ConfigError("--user, --system: choose one of them")
    return bool(arguments.system or (os.geteuid() == 0 and not arguments.user))


def unit_path(name: str, *, system: bool) -> Path:
    """Return where systemd looks for the unit."""
    if system:
        return Path("/etc/systemd/system", f"{name}.service")
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(home, "systemd", "user", f"{name}.service")


def run_options(words: Sequence[str]) -> list[str]:
    """Return the options of `run` for a service, without screens and never armed; ConfigError for wrong ones."""
    given = list(words[1:] if words[:1] in (["run"], ["--"]) else words)
    told = parsed(["run", *given])
    # a setting that is wrong is told now, and not in a journal after the next boot
    options.loaded(told)
    if told.arm:
        raise ConfigError(
            "--arm: a service comes up by itself, so it never arms; leave it out, and arm when you see it"
        )
    if getattr(told, "log", None) and not any("{time}" in word for word in given):
        raise ConfigError(
            "--log: a service that starts again would find this file there, and end; put {time} into its name, such as "
            "--log 'drive-{time}.mcap'"
        )
    return [*given, *(["--headless"] * (not told.headless and not told.json)), *(["--no-arm"] * (told.arm is None))]


def _user(given: str | None) -> str:
    """Return the name of the user that a service of the computer's runs as; raises ConfigError: it would be root."""
    name = given or os.environ.get("SUDO_USER") or pwd.getpwuid(Path.cwd().stat().st_uid).pw_name
    try:
        number = pwd.getpwnam(name).pw_uid
    except KeyError:
        raise ConfigError(f"--as: there is no user '{name}'") from None
    if number == 0:
        raise ConfigError("--as: a robot does not run as root; name another user, such as --as robot")
    return name


def unit(name: str, words: Sequence[str], *, user: str) -> str:
    """Return the text of the unit that runs ``txt1 run`` with these options in the present directory.

    `user` is who it runs as; "": it is a unit of a user's own service manager.
    """
    directory = Path.cwd().as_posix().replace("%", "%%")
    sandbox = SANDBOX
    if user:
        there = {group.gr_name for group in grp.getgrall()}
        groups = " ".join(group for group in GROUPS if group in there)
        devices = "\n".join(f"DeviceAllow=char-{kind} rw" for kind in DEVICES)
        sandbox += SYSTEM_SANDBOX.format(directory=quoted(Path.cwd().as_posix()), devices=devices)
    return UNIT.format(
        header=HEADER,
        name=name,
        directory=directory,
        command=" ".join(map(quoted, [sys.executable, "-m", "txt1", "run", *words])),
        user=f"User={user}\nSupplementaryGroups={groups}\n" if user else "",
        watchdog=WATCHDOG,
        fifo=FIFO,
        niceness=OTHERS_NICENESS,
        sandbox=sandbox,
        target="multi-user.target" if user else "default.target",
    )


def quoted(word: str) -> str:
    """Return a word of a command line as systemd reads it; ConfigError for one with control characters."""
    if not word.isprintable():
        raise ConfigError(f"{word!r} cannot stand in a unit")
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if not word or set(word) & set(" '\";#\\") else escaped


def _systemctl(system: bool, *words: str) -> bool:
    """Return whether systemd obeyed. It cannot if it does not run, or the user is not logged in."""
    program = shutil.which("systemctl")
    if program is None:
        return False
    done = subprocess.run([program, *([] if system else ["--user"]), *words], capture_output=True, text=True)  # noqa: S603
    if done.returncode != 0:
        say(f"systemctl {words[0]}: {done.stderr.strip() or f'exit code {done.returncode}'}")
    return done.returncode == 0
