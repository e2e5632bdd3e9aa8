"""The first hour where nothing is installed: README's two commands and the Start page, typed word by word, and timed.

    make try-bare                                   # as root, with debootstrap and a network: a bare Debian root
    make try-bare BARE="--suite forky"              # ... of another Debian
    make try-bare BARE="--suite noble --mirror http://archive.ubuntu.com/ubuntu"  # ... of Ubuntu
    make try-bare BARE="--python /usr/bin/python3"  # this machine, in a new folder, with another Python: no root needed
    make try-bare BARE="--teach 600"                # instead: from nothing to a policy, by 600 s of driving

The Debian root is debootstrap's smallest, with nothing added but how this machine reaches its mirrors: names of
servers, certificates, pip's settings, and that they may be late. A user without rights types; root types `apt` alone.
The screens are read from a real pty of 80 x 24: a robot counts as driving once the screen shows the set-point that `w`
asked for, or its place on MAP more than 0.2 m from its start. Printed is a line for each command, with its seconds; the
end is 1 as soon as one ends otherwise than the page says.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pexpect
import pyte

ROOT: Final = Path(__file__).parents[1]
PROMPT: Final = re.compile(rb"<ended (\d+)>")
PLACE: Final = re.compile(r"(?:room|map) x +(-?[\d.]+)")
BARE: Final = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "TERM": "xterm-256color"}
ENTER: Final = 'mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev" && exec chroot "$@"'  # mounts of its own
RECIPES: Final = Path("/usr/share/debootstrap/scripts")
PATIENCE: Final = 900.0  # s for a command


class Shell:
    """Somebody at a terminal of 80 x 24."""

    def __init__(self, words: list[str], environment: dict[str, str], folder: str) -> None:
        words = [*words, "bash", "--norc", "--noprofile", "--noediting"]
        self.screen = pyte.Screen(80, 24)
        self._stream = pyte.ByteStream(self.screen)
        self._child = pexpect.spawn(words[0], words[1:], env=environment, dimensions=(24, 80), echo=False)
        self._told = b""
        self._child.sendline(f"PS1='<ended $?>'; PS2=''; cd {shlex.quote(folder)}")
        self._until(lambda: bool(PROMPT.search(self._told)))

    def _until(self, condition: Callable[[], bool], limit: float = PATIENCE) -> None:
        end = time.monotonic() + limit
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError("\n".join(self.screen.display))
            try:
                new = self._child.read_nonblocking(65536, timeout=0.05)
            except pexpect.TIMEOUT:
                continue
            self._told += new
            self._stream.feed(new)

    def type(self, line: str, *, drives: bool = False, until: str = "") -> tuple[int, float, float | None]:
        """Type a line and wait for its end: exit code, seconds, and seconds until the robot drove, if it did.

        `drives`: press w until the screen shows that it drives, then q. `until`: press q when the screen says so.
        """
        self.screen.reset()
        self._told = b""
        began, driving = time.monotonic(), None
        self._child.sendline(line)
        if drives:
            pressed = 0.0

            def moving() -> bool:
                nonlocal pressed
                text = "\n".join(self.screen.display)
                if PROMPT.search(self._told):
                    raise RuntimeError(f"it ended before it drove:\n{text}")
                if "ARMED" in text and time.monotonic() > pressed + 0.1:
                    pressed = time.monotonic()
                    self._child.send("w")
                at = PLACE.search(text)
                return re.search(r"set-point +0\.50 m/s", text) is not None or (at is not None and float(at[1]) > 0.2)

            self._until(moving)
            driving = time.monotonic() - began
            self._child.send("q")
        if until:
            self._until(lambda: until in "\n".join(self.screen.display))
            self._child.send("q")
        self._until(lambda: bool(PROMPT.search(self._told)))
        found = PROMPT.search(self._told)
        assert found is not None
        return int(found[1]), time.monotonic() - began, driving

    def told(self) -> str:
        """Everything that the last command wrote."""
        return self._told.decode(errors="replace")

    def leave(self) -> None:
        """Close the terminal."""
        self._child.close(force=True)


def bare_debian(root: Path, suite: str, mirror: str) -> tuple[Shell, Shell, str]:
    """Shells of root and of a user in a bare Debian, which is made where it is not yet, and the copy's folder there."""
    if not (root / "etc" / "debian_version").exists():
        recipe = RECIPES / suite
        if not recipe.exists():  # the suite is newer than debootstrap
            recipe = RECIPES / ("gutsy" if "ubuntu" in mirror else "sid")
        options = ["--variant=minbase", "--include=ca-certificates"]
        if "ubuntu" in mirror:
            options.append("--components=main,universe")
        subprocess.run(["debootstrap", *options, suite, root, mirror, recipe], check=True)
    for file in ("/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt"):
        if Path(file).exists():
            shutil.copyfile(file, root / file[1:])
    given = [Path("/etc/pip.conf"), Path.home() / ".config/pip/pip.conf"]
    lines = [line for file in given if file.exists() for line in file.read_text("utf-8").splitlines()]
    kept = [line for line in lines if line and not line.startswith(("[", "find-links"))]  # folders are not there
    (root / "etc/pip.conf").write_text("\n".join(["[global]", *kept, ""]), "utf-8")
    (root / "etc/pip.conf").chmod(0o644)
    (root / "etc/apt/apt.conf.d/99late").write_text('Acquire::Check-Valid-Until "false";\n', "utf-8")
    enter = ["unshare", "--mount", "--fork", "sh", "-c", ENTER, str(root)]
    subprocess.run(["chroot", root, "useradd", "--create-home", "somebody"], check=False, stderr=subprocess.DEVNULL)
    home = root / "home/somebody"
    for left in (each for each in home.iterdir() if each.is_dir()):
        shutil.rmtree(left)
    copied(home / "txt1")
    subprocess.run(["chroot", root, "chown", "--recursive", "somebody:", "/home/somebody"], check=True)
    certificate = {"SSL_CERT_FILE": "/etc/ssl/certs/ca-certificates.crt"}
    somebody = BARE | certificate | {"HOME": "/home/somebody", "USER": "somebody"}
    return (
        Shell([*enter, str(root)], BARE | {"HOME": "/root", "DEBIAN_FRONTEND": "noninteractive"}, "/root"),
        Shell([*enter, "--userspec=somebody:somebody", str(root)], somebody, "/home/somebody/txt1"),
        "/home/somebody/txt1",
    )


def copied(folder: Path) -> None:
    """Put a copy of the repository's last commit there."""
    folder.mkdir(parents=True)
    with subprocess.Popen(["git", "-C", ROOT, "archive", "HEAD"], stdout=subprocess.PIPE) as archive:
        subprocess.run(["tar", "--extract", "--directory", folder], stdin=archive.stdout, check=True)


def typed(page: Path) -> list[str]:
    """Every line of the page's blocks of code, in turn."""
    found = re.findall(r"(?m)^```bash\n((?s:.*?))^```|^ {4}(\S.*)$", page.read_text("utf-8"))
    return [line for block, indented in found for line in (block.splitlines() if block else [indented])]


def attempt(shell: Shell, line: str) -> None:
    """Type a line, and tell how long it took; end everything if it went wrong."""
    shows = line.startswith("txt1 replay") and "--verify" not in line  # stays at its end
    code, seconds, driving = shell.type(
        line, drives=line in ("txt1 run", "make run"), until="the run has ended" if shows else ""
    )
    print(f"{seconds:8.1f} s  {line}" + ("" if driving is None else f"   [drove after {driving:.1f} s]"), flush=True)
    counted = re.search(r"\d+ passed.*? in .*", "\n".join(shell.screen.display))
    if counted:
        print(f"{'':12}{counted[0].strip()}", flush=True)
    if code:
        print(f"ended with {code}:\n{shell.told()[-3000:]}", file=sys.stderr)
        raise SystemExit(1)


def lesson(file: Path, seconds: float) -> None:
    """Record the simulated human of the benchmarks on a track."""
    sys.path.insert(0, str(ROOT))
    from numpy.random import default_rng

    from benchmarks.teaching.takeovers import alone
    from benchmarks.teaching.track import Human, config_of, track_of
    from txt1.kernel.loop import run

    track = track_of("hairpins")
    run(alone(config_of(track, 1), Human(track, default_rng(1)), seconds, file), speed="max")


def teach(user: Shell, folder: Path, seconds: float) -> None:
    """Type what installs txt1, and teaches a first policy."""
    lesson(folder / "first.mcap", seconds)
    (folder / "first.mcap").chmod(0o644)
    print(f"From nothing to a policy taught by {seconds:g} s of driving:")
    began = time.monotonic()
    attempt(user, "python3 -m venv .venv")
    attempt(user, "PATH=$PWD/.venv/bin:$PATH")
    attempt(user, "pip install '.[teach,record,plots]'")
    attempt(user, "txt1 teach first.mcap -o track.onnx --see laser")
    print(f"{time.monotonic() - began:8.1f} s  in all")


def readme_and_start(user: Shell, folder: str, tests: bool) -> None:
    """Type README's commands, and the Start page."""
    print("README:")
    attempt(user, "make run")
    attempt(user, "make run")
    if tests:
        attempt(user, "make test")
    print("Start, in a copy of its own:")
    user.type(f"rm -rf .venv && cp -r {folder} {folder}-2 && cd {folder}-2")
    began = time.monotonic()
    for line in typed(ROOT / "docs" / "start.md"):
        attempt(user, line)
    print(f"{time.monotonic() - began:8.1f} s  the whole page")


def main() -> None:
    """Try what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", default="bookworm", help="Debian's name of the version to try it on")
    parser.add_argument("--mirror", default="http://deb.debian.org/debian", help="where to get that Debian, or Ubuntu")
    parser.add_argument("--root", type=Path, help="the folder of that Debian (default: a new one)")
    parser.add_argument("--python", type=Path, help="try this Python on this machine instead of a Debian root")
    parser.add_argument("--tests", action="store_true", help="README's second command, make test, too: minutes")
    parser.add_argument("--teach", type=float, metavar="SECONDS", help="a first policy, and no README: minutes")
    arguments = parser.parse_args()
    if arguments.python is None and (os.geteuid() or shutil.which("debootstrap") is None):
        parser.error("a Debian root needs debootstrap and the rights of root; or try this machine: --python python3")
    with tempfile.TemporaryDirectory(prefix="txt1-bare-") as scratch:
        root, place = None, Path("/")
        if arguments.python is None:
            place = arguments.root or Path(scratch, "debian")
            root, user, folder = bare_debian(place, arguments.suite, arguments.mirror)
            version = user.type("cat /etc/debian_version") and user.told().split()[0]
            print(f"Debian {version}, bare; from its first prompt on:")
            attempt(root, "apt-get update --quiet")
            attempt(root, "apt-get install --yes python3-venv make")
        else:
            folder = f"{scratch}/txt1"
            copied(Path(folder))
            Path(scratch, "bin").mkdir()
            for name in ("python3", "python3.11"):  # the names that make and the page use
                Path(scratch, "bin", name).symlink_to(arguments.python.absolute())
            kept = {name: value for name, value in os.environ.items() if not name.startswith(("TXT1_", "PYTHON"))}
            mine = {"HOME": scratch, "PATH": f"{scratch}/bin:{BARE['PATH']}", "TERM": BARE["TERM"]}
            user = Shell(["env"], kept | mine, folder)
        user.type("python3 --version")
        print(user.told().splitlines()[0].strip())
        if arguments.teach:
            teach(user, place / folder.lstrip("/"), arguments.teach)
        else:
            readme_and_start(user, folder, arguments.tests)
        user.leave()
        if root is not None:
            root.leave()


if __name__ == "__main__":
    main()
