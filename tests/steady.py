"""Repeat the tests to find any that sometimes fail: `make steady`, 90 minutes. If it is interrupted, it resumes.

The whole suite runs once; this also compiles numba's loops on a new machine. Tests that wait in real time run 20
times, the first five of these runs beside four busy loops, because these find most. Then the whole suite runs four
more times. The page's tests in chromium run beside the busy runs and the whole suite. Last, the tests that wait and the
conformance suites run beside 30 busy loops; `--short` has some of these alone, for half an hour.
build/steady.json holds the finished runs and their failures; the output of a failed run is beside it. After a new
commit or other changes it starts from the beginning.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
KEPT: Final = ROOT / "build" / "steady.json"
PYTEST: Final = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider")
SUITE: Final = ("--numprocesses=6", "--dist=worksteal")
WAITING: Final = (*SUITE, "-m", "waits and not long and not browser")
CONFORMANCE: Final = ("-n", "0", "tests/conformance")
BROWSER: Final = ("-m", "browser", "tests/browser")
PROMPT: Final = "prompt or flood or busy"
FOLDERS: Final = ("conformance", "e2e", "unit")
# files with such a test: to collect all others takes minutes beside 30 busy loops
WITH_PROMPT: Final = tuple(
    str(each.relative_to(ROOT))
    for folder in FOLDERS
    for each in sorted((ROOT / "tests" / folder).rglob("test_*.py"))
    if re.search(rf"def test_\w*({PROMPT.replace(' or ', '|')})", each.read_text("utf-8"))
)
# a newcomer's first minute, and what is prompt or holds out against a flood
SHORT: Final = (
    # one after the other, as two that start at once find the same port free
    ("-n", "0", "tests/e2e/test_first_minute.py", "tests/e2e/test_paths.py"),
    ("-n", "0", *WITH_PROMPT, "-k", PROMPT),
)
HUNG: Final = 1800.0  # s that one pytest may take
NOTHING: Final = 5  # pytest's exit code where all tests are skipped or none is chosen


class Round(NamedTuple):
    """Tests that run at the same time: their name, what each pytest is told, and beside how many busy loops."""

    name: str
    words: tuple[tuple[str, ...], ...]
    busy: int = 0


ROUNDS: Final = (
    Round("the whole suite, 1 of 5", (SUITE, BROWSER)),
    *(Round(f"the tests that wait, {n} of 20", (WAITING, BROWSER), 4) for n in range(1, 6)),
    *(Round(f"the tests that wait, {n} of 20", (WAITING,)) for n in range(6, 21)),
    *(Round(f"the whole suite, {n} of 5", (SUITE, BROWSER)) for n in range(2, 6)),
    Round("the tests that wait, and the conformance suites, at a load of 30", (WAITING, CONFORMANCE), 30),
)
LOADED: Final = Round("the first minute, and what is prompt, at a load of 30", SHORT, 30)


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """Keep processors busy with so many loops, which end with this program though it is killed."""
    loop = "import os; parent = os.getppid()\nwhile os.getppid() == parent: pass"
    processes = [subprocess.Popen([sys.executable, "-c", loop]) for _ in range(loops)]
    try:
        yield
    finally:
        for each in processes:
            each.kill()
            each.wait()


def state() -> str:
    """What tells this state of the files from any other."""
    said = [
        subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True).stdout
        for words in (("rev-parse", "HEAD"), ("diff", "HEAD"), ("status", "--porcelain"))
    ]
    return sha256(b"".join(said)).hexdigest()[:16]


def kept() -> dict[str, Any]:
    """What ran so far with these files, by the round's name."""
    now = state()
    if KEPT.exists():
        found: dict[str, Any] = json.loads(KEPT.read_text("utf-8"))
        if found["state"] == now:
            return found
    return {"state": now, "rounds": {}}


def pytest(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """One pytest, to its end; one that hangs has failed."""
    try:
        return subprocess.run([*PYTEST, *words], cwd=ROOT, capture_output=True, text=True, check=False, timeout=HUNG)
    except subprocess.TimeoutExpired as hung:
        said = (hung.stdout or b"").decode(errors="replace")
        return subprocess.CompletedProcess(hung.args, 1, said, f"pytest hung for {HUNG:g} s")


def ran(one: Round) -> dict[str, Any]:
    """Run it: the time it took, s, how many passed, and the names of those that failed."""
    began, passed, failed = time.monotonic(), 0, list[str]()
    with busy(one.busy), ThreadPoolExecutor() as beside:
        ended = list(beside.map(pytest, one.words))
    for done in ended:
        said = done.stdout + done.stderr
        passed += sum(map(int, re.findall(r"(\d+) passed", said)))
        found = re.findall(r"(?m)^(?:FAILED|ERROR) (.+?)(?: - .*)?$", said)
        if done.returncode not in (0, NOTHING) and not found:
            found = [f"pytest ended with {done.returncode}"]
        if found:
            number = ROUNDS.index(one) + 1 if one in ROUNDS else "short"
            log = KEPT.with_name(f"steady-{number}.log")
            log.write_text(f"{log.read_text('utf-8') if failed else ''}{said}", "utf-8")
        failed += found
    return {"seconds": round(time.monotonic() - began), "passed": passed, "failed": failed}


def told(one: Round, result: dict[str, Any]) -> str:
    """A round in a line."""
    beside = f" beside {one.busy} busy loops" if one.busy else ""
    verdict = f"failed: {', '.join(result['failed'])}" if result["failed"] else f"{result['passed']} passed"
    return f"{one.name}{beside}: {result['seconds']} s, {verdict}"


def main() -> int:
    """Run what has not run yet; 1 when a test has failed in any round."""
    parser = argparse.ArgumentParser(prog="tests.steady", description=__doc__)
    parser.add_argument("--anew", action="store_true", help="forget what ran before")
    parser.add_argument(
        "--short", action="store_true", help="only a few tests at a load of 30; half an hour, kept nowhere"
    )
    given = parser.parse_args()
    KEPT.parent.mkdir(exist_ok=True)
    if given.short:
        result = ran(LOADED)
        print(told(LOADED, result))
        return 1 if result["failed"] else 0
    if given.anew:
        KEPT.unlink(missing_ok=True)
    progress = kept()
    for one in ROUNDS:
        if one.name not in progress["rounds"]:
            progress["rounds"][one.name] = ran(one)
            new = KEPT.with_suffix(".new")
            new.write_text(json.dumps(progress, indent=1), "utf-8")
            new.replace(KEPT)
        print(told(one, progress["rounds"][one.name]), flush=True)
    failures = [name for result in progress["rounds"].values() for name in result["failed"]]
    print(f"{len(failures)} failures: {', '.join(sorted(set(failures)))}" if failures else "steady: no failure")
    return 1 if failures else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("ended; the same command goes on there")
