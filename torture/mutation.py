"""Mutation: small mistakes in the modules that keep the robot safe, and the tests that have to notice them.

The tests are collected once, in one process. First they run as they are, and it is noted which lines each of them runs.
Then a process is forked for every mutant, one at a time for each processor. There the function with the mistake takes
the place of the right one, and the tests that run its lines follow, the quickest first, up to the first that fails. A
mistake in what runs at the import needs an interpreter of its own. A mutant that no test notices survives, and has to
stand in `EQUIVALENT` with a reason.

What came out is kept in a file, by mutant and by what the module and its tests are: a run that was ended goes on there.
"""

import argparse
import hashlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import resource
import signal
import subprocess
import sys
import threading
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import accumulate, chain, islice
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, Final, NamedTuple

import pytest
import yaml

from torture import page
from torture.mutants import Mutant, mutants
from txt1.kernel.clock import NS_PER_S, stopwatch_ns

ROOT: Final = Path(__file__).parents[1]
MODULES: Final = (
    "txt1/control",
    "txt1/protocol",
    "txt1/tasks/arming.py",
    "txt1/tasks/controller.py",
    "txt1/tasks/mode.py",
    "txt1/hal/serial.py",
    "txt1/hal/line.py",
    "txt1/hal/restarts.py",
    "txt1/hal/acknowledged_gains.py",
    "txt1/hal/sim.py",
    "txt1/hal/plain_hal.py",
    "txt1/hal/recorded_hal.py",
    "txt1/hal/channels.py",
    "txt1/hal/languages.py",
    "txt1/cars/pi/driver.py",
    "txt1/cars/pi/guard.py",
    "txt1/cars/vesc/driver.py",
    "txt1/cars/waveshare/driver.py",
    "txt1/tasks/standstill.py",
    "txt1/guards/obstacle_stop/free_distance.py",
    "txt1/guards/obstacle_stop/guard.py",
    "txt1/guards/roll_guard/guard.py",
    "txt1/web/admission.py",
    "txt1/web/auth.py",
    "txt1/web/budgets.py",
    "txt1/web/connections.py",
    "txt1/web/files.py",
    "txt1/web/requests.py",
    "txt1/web/routes.py",
    "txt1/web/server.py",
    "txt1/web/troubles.py",
    "txt1/web/wheel.py",
    "txt1/fleet/key.py",
    "txt1/fleet/members.py",
    "txt1/fleet/messages.py",
    "txt1/fleet/network.py",
    "txt1/fleet/stopping.py",
    "txt1/record/recovery.py",
)
TESTS: Final = (
    "tests/unit/control",
    "tests/unit/guards",
    "tests/unit/protocol",
    "tests/unit/tasks",
    "tests/unit/hal",
    "tests/unit/web",
    "tests/unit/fleet",
    "tests/unit/record",
    "tests/unit/test_every_request.py",
    "tests/conformance/test_hals.py",
    "tests/e2e/test_safety.py",
    "tests/e2e/test_commander.py",
    "tests/e2e/test_board.py",
    "tests/e2e/test_wire.py",
    "tests/e2e/test_robot.py",
    "tests/e2e/test_closed_loop.py",
    "tests/e2e/test_bridges.py",
    "tests/e2e/test_record.py",
    "tests/e2e/test_stops.py",
)
EQUIVALENT: Final = ROOT / "torture" / "equivalent.yaml"
SLOW: Final = 8.0  # s: tests that take longer are not asked
ENOUGH: Final = 30.0  # s that the tests may take that one mutant is shown, the quickest that run its lines
FEW: Final = 250  # tests that are asked in an interpreter of its own
EXTRA: Final = 10.0  # s beside three times what a test takes, after which a mutant counts as hanging
SIZE: Final = 4  # bytes of a number in a pipe
SURVIVED, KILLED, HANGING, BROKEN = "survived", "killed", "hanging", "broken"
REASON: Final = "with a reason"  # of those that survived


class Known(NamedTuple):
    """What a test runs: lines of the modules in question, and how long it takes, s."""

    lines: frozenset[tuple[str, int]]
    took: float


# -- in the process that has the tests ---------------------------------------------------------------------------------


class Warm:
    """A pytest plugin: in place of running the tests once it runs them for every mutant."""

    def __init__(
        self, wanted: Callable[[dict[str, Known]], Iterator[tuple[Mutant, Sequence[str]]]], kept: Path
    ) -> None:
        self._wanted = wanted
        self._kept = kept
        self.told: Callable[[Mutant, str, Sequence[str]], None] = lambda mutant, result, tests: None

    def pytest_configure(self) -> None:
        """Let random tests be the same each time."""
        _repeat_hypothesis()

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Take the place of pytest's own loop."""
        items = {item.nodeid: item for item in session.items}
        known = self._watch(session, files_of(MODULES))
        left = list(self._wanted(known))

        def result_of(number: int) -> str:
            mutant, tests = left[number]
            chosen = [(items[name], 3.0 * known[name].took + EXTRA) for name in tests]
            limit = 3.0 * sum(known[name].took for name in tests) + EXTRA
            result = _in_child(partial(_try, session, chosen, mutant), limit)
            ran = {line for name in tests for _, line in known[name].lines}
            at_import = not mutant.owner or ran.isdisjoint(range(mutant.lines[0], mutant.lines[1] + 1))
            # others have made something of it before, or it does not fit into a function that there is
            if result == BROKEN or (at_import and result == SURVIVED):
                result = _anew(mutant, tests[:FEW], limit)
            return result

        for number, result in _shared(result_of, len(left)):
            mutant, tests = left[number]
            self.told(mutant, result, tests)
        return True

    def _watch(self, session: pytest.Session, files: list[Path]) -> dict[str, Known]:
        """What each test runs, of those that pass and are quick; remembered while test and modules are the same."""
        modules = digest(files)
        keys = {item.nodeid: f"{modules} {digest([item.path])}" for item in session.items}
        kept: dict[str, Any] = json.loads(self._kept.read_text()) if self._kept.exists() else {}
        kept = {name: row for name, row in kept.items() if keys.get(name) == row["key"]}
        new = [item for item in session.items if item.nodeid not in kept]
        self._kept.parent.mkdir(parents=True, exist_ok=True)
        try:
            for name, fine, took, lines in _run_traced(session, new, files):
                kept[name] = {"key": keys[name], "fine": fine, "took": took, "lines": lines}
        finally:  # whoever ends it here goes on here
            self._kept.write_text(json.dumps(kept))
        known = {}
        for name, row in kept.items():
            if not row["fine"]:
                print(f"fails as it is, and is not asked: {name}", file=sys.stderr)
            elif row["took"] < SLOW:
                known[name] = Known(frozenset(map(tuple, row["lines"])), row["took"])
        print(f"{len(known)} tests of {len(session.items)} are asked", file=sys.stderr, flush=True)
        return known


def _run_traced(session: pytest.Session, items: list[pytest.Item], files: list[Path]) -> Iterator[list[Any]]:
    """Run tests in a child: their names, whether they pass, how long they take (s), the lines they run."""
    watched = {str(file): str(file.relative_to(ROOT)) for file in files}
    reader, writer = os.pipe()

    def watch() -> int:
        # so that it ends with whoever reads what it tells
        os.close(reader)
        with os.fdopen(writer, "w") as told:
            for item, after in zip(items, [*items[1:], None], strict=True):
                lines: set[tuple[str, int]] = set()
                failed = session.testsfailed
                began = os.times()
                with _Tracing(watched, lines):
                    item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
                ended = os.times()
                worked = ended.user - began.user + ended.system - began.system
                took = max(worked, ended.elapsed - began.elapsed)  # tests of processes mostly wait
                row = [item.nodeid, session.testsfailed == failed, took, sorted(lines)]
                print(json.dumps(row), file=told, flush=True)
        return 0

    child = _fork(watch)
    os.close(writer)
    try:
        with os.fdopen(reader) as told:
            yield from map(json.loads, told)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)


class _Tracing:
    """Note the lines of some files that run meanwhile, in any thread."""

    def __init__(self, files: dict[str, str], lines: set[tuple[str, int]]) -> None:
        def local(frame: FrameType, event: str, argument: Any) -> Any:
            lines.add((files[frame.f_code.co_filename], frame.f_lineno))
            return local

        def trace(frame: FrameType, event: str, argument: Any) -> Any:
            return local if frame.f_code.co_filename in files else None

        self._trace = trace

    def __enter__(self) -> None:
        threading.settrace(self._trace)
        sys.settrace(self._trace)

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]


def _fork(work: Callable[[], int]) -> int:
    """Do something in a child that says nothing; its process id."""
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child:
        return child
    os.setpgid(0, 0)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)
    code = 1
    try:
        code = work()
    finally:
        os._exit(code)


def _shared(work: Callable[[int], str], count: int) -> Iterator[tuple[int, str]]:
    """Do the work of each number below `count`, in as many children as there are processors; numbers and results."""
    numbers, to_do = os.pipe()
    reader, writer = os.pipe()

    def share() -> int:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        # so that it ends with whoever reads what it tells, whatever number waits
        for end in (to_do, reader):
            os.close(end)
        while number := os.read(numbers, SIZE):
            row = int.from_bytes(number), work(int.from_bytes(number))
            os.write(writer, f"{json.dumps(row)}\n".encode())
        return 0

    children = [_fork(share) for _ in os.sched_getaffinity(0)]
    for end in (numbers, writer):
        os.close(end)
    try:
        threading.Thread(target=_put_numbers, args=(to_do, count), daemon=True).start()
        with os.fdopen(reader) as told:
            for line in islice(told, count):
                number, result = json.loads(line)
                yield number, result
    finally:
        for child in children:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGTERM)
            os.waitpid(child, 0)


def _put_numbers(to_do: int, count: int) -> None:
    with suppress(BrokenPipeError):
        for number in range(count):
            os.write(to_do, number.to_bytes(SIZE))
    os.close(to_do)


def _in_child(work: Callable[[], int], limit: float) -> str:
    """What came out, of a child that may take `limit` s of processor and three times that in all."""

    def limited() -> int:
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 2))
        resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(3 * int(limit) + 20)
        return work()

    child = _fork(limited)
    try:
        _, status = os.waitpid(child, 0)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what its tests have started
    if os.WIFSIGNALED(status):
        return HANGING
    return {0: SURVIVED, 1: KILLED}.get(os.waitstatus_to_exitcode(status), BROKEN)


def _try(session: pytest.Session, items: list[tuple[pytest.Item, float]], mutant: Mutant) -> int:
    """Put the mistake in and run these tests, each for so many s at most, up to the first that fails; 1 if one did."""
    try:
        put_in(mutant)
    except BaseException:
        return 3
    for (item, patience), (after, _) in zip(items, [*items[1:], (None, 0.0)], strict=True):
        signal.alarm(int(patience) + 1)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
        if session.testsfailed:
            return 1
    return 0


def put_in(mutant: Mutant) -> None:
    """Let the function with the mistake take the place of the right one, wherever that is known; a constant as well."""
    module = importlib.import_module(_module_name(mutant.file))
    if not mutant.owner:
        _put_in_constants(module, mutant.compiled())
        return
    place: Any = module
    for name in mutant.owner.split("."):
        place = vars(place)[name]
    place = getattr(place, "__func__", getattr(place, "fget", place))
    while hasattr(place, "__wrapped__"):
        place = place.__wrapped__
    assert isinstance(place, FunctionType)
    place.__code__ = _code_of(mutant.compiled(), mutant.owner)


def _put_in_constants(module: ModuleType, code: CodeType) -> None:
    wrong = ModuleType(module.__name__)
    wrong.__file__ = module.__file__
    exec(code, vars(wrong))
    changed = False
    for name, value in vars(wrong).items():
        right = vars(module).get(name)
        if name.startswith("__") or not _is_plain(value) or value == right:
            continue
        for other in list(sys.modules.values()):
            if getattr(other, "__dict__", {}).get(name) is right:
                setattr(other, name, value)
                changed = True
    assert changed


def _is_plain(value: object) -> bool:
    """Return whether a value holds no function and no class, which would be another module's.

    Tests that put a clock or a limit into the right module would not reach these, and fail whatever the mistake is.
    """
    if isinstance(value, Mapping):
        return all(map(_is_plain, chain(value, value.values())))
    if isinstance(value, tuple | list | set | frozenset):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, int | float | str | bytes)


def _code_of(code: CodeType, name: str) -> CodeType:
    inside = [each for each in code.co_consts if isinstance(each, CodeType)]
    for each in inside:
        if each.co_qualname == name:
            return each
    return next(_code_of(each, name) for each in inside if name.startswith(f"{each.co_qualname}."))


def _module_name(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts)


# -- an interpreter of its own, for what runs at the import ------------------------------------------------------------


def _anew(mutant: Mutant, tests: Sequence[str], limit: float) -> str:
    command = [sys.executable, "-m", "torture.mutation", "--one", mutant.name, *tests]

    def work() -> int:
        return subprocess.run(command, cwd=ROOT, check=False).returncode

    return _in_child(work, limit + 20.0)


class Repeating:
    """A pytest plugin: random tests are the same each time."""

    def pytest_configure(self) -> None:
        """Say so before they are collected."""
        _repeat_hypothesis()


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module with the mistake in it."""

    def __init__(self, mutant: Mutant) -> None:
        self._name = _module_name(mutant.file)
        self._mutant = mutant

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find it."""
        if fullname != self._name:
            return None
        return importlib.util.spec_from_loader(fullname, self, origin=str(self._mutant.file))

    def exec_module(self, module: ModuleType) -> None:
        """Run it."""
        module.__file__ = str(self._mutant.file)
        exec(self._mutant.compiled(), vars(module))


def _one(name: str, tests: Sequence[str]) -> int:
    mutant = next((each for each in all_mutants() if each.name == name), None)
    if mutant is None:
        return 3  # the source has been changed meanwhile
    for module in [each for each in sys.modules if each.startswith("txt1")]:
        del sys.modules[module]
    sys.meta_path.insert(0, _Finder(mutant))
    return 1 if _pytest(["-x", *tests], [Repeating()]) else 0


# -- the whole ---------------------------------------------------------------------------------------------------------


def _pytest(tests: Sequence[str], plugins: list[object]) -> int:
    return int(pytest.main(["-q", "-p", "no:xdist", "-p", "no:cacheprovider", "--capture=no", *tests], plugins))


def _repeat_hypothesis() -> None:
    import hypothesis  # pytest wants to be the first to import it

    phases = hypothesis.Phase.explicit, hypothesis.Phase.generate
    hypothesis.settings.register_profile(
        "mutation",
        derandomize=True,
        deadline=None,
        database=None,
        max_examples=60,
        phases=phases,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    hypothesis.settings.load_profile("mutation")


def files_of(places: Sequence[str]) -> list[Path]:
    """The source files in these files and folders."""
    found: list[Path] = []
    for place in map(ROOT.joinpath, places):
        found += sorted(place.rglob("*.py")) if place.is_dir() else [place]
    return found


def all_mutants() -> list[Mutant]:
    """The mutants of all modules in question."""
    return [mutant for file in files_of(MODULES) for mutant in mutants(file, ROOT)]


def concerned(mutant: Mutant, known: dict[str, Known]) -> list[str]:
    """The tests that run a mutant's lines; of what runs at import those of its package, and all that run its module.

    The module's own come first, then the quickest.
    """
    file = str(mutant.file.relative_to(ROOT))
    lines = {(file, line) for line in range(mutant.lines[0], mutant.lines[1] + 1)}
    chosen = [name for name, (ran, _) in known.items() if ran & lines] if mutant.owner else []
    if not chosen:
        beside = f"tests/unit/{mutant.file.parent.name}/"
        chosen = [name for name, (ran, _) in known.items() if beside in name or any(each[0] == file for each in ran)]
    stem, folder = mutant.file.stem, mutant.file.parent.name
    chosen.sort(
        key=lambda name: (f"/test_{stem}" not in name and f"/test_{folder}_{stem}" not in name, known[name].took)
    )
    took = list(accumulate(known[name].took for name in chosen))
    return chosen[: bisect_right(took, ENOUGH)]


def equivalent() -> dict[str, str]:
    """The mutants that change nothing that a test should notice, with the reason why."""
    if not EQUIVALENT.exists():
        return {}
    return {name: why for each in yaml.safe_load(EQUIVALENT.read_text()) for name, why in each.items()}


def digest(files: Sequence[Path]) -> str:
    """A short text that is another when one of the files is."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def main(words: Sequence[str] | None = None) -> int:
    """Run the mutants; 1 if one survives that is not known to be equivalent, or if one of these does not any more."""
    parser = argparse.ArgumentParser(prog="torture mutation", description=__doc__)
    parser.add_argument("only", nargs="*", help="those of which the name has one of these words in it")
    parser.add_argument("--kept", type=Path, default=Path("out/torture/mutation.jsonl"), help="what came out so far")
    parser.add_argument("--again", action="store_true", help="try the survivors again: the tests are others now")
    parser.add_argument("--tests", nargs="+", default=TESTS, help="ask only these, as a quick look at new ones")
    parser.add_argument("--page", action="store_true", help="write the table into docs/results/reliability.md")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args(words)
    if options.one is not None:
        return _one(options.one, options.only)
    # ends the children, as ^C does
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    kept: Path = options.kept
    kept.parent.mkdir(parents=True, exist_ok=True)
    results: dict[str, str] = {}
    modules = {str(file): digest([file]) for file in files_of(MODULES)}
    if kept.exists():
        for line in kept.read_text().splitlines():
            each = json.loads(line)
            if modules.get(str(ROOT / each["file"])) == each["digest"]:
                results[each["mutant"]] = each["result"]
    everyone = [each for each in all_mutants() if not options.only or any(word in each.name for word in options.only)]
    ask_again = {SURVIVED, BROKEN} if options.again else set()
    left = [each for each in everyone if results.get(each.name) in {None} | ask_again]
    fine = equivalent()
    if options.again:
        left = [each for each in left if each.name not in fine or each.name not in results]

    def wanted(known: dict[str, Known]) -> Iterator[tuple[Mutant, Sequence[str]]]:
        for mutant in left:
            tests = concerned(mutant, known)
            if tests:
                yield mutant, tests
            else:
                told(mutant, SURVIVED, tests)

    began = stopwatch_ns()
    done = 0

    def told(mutant: Mutant, result: str, tests: Sequence[str]) -> None:
        nonlocal done
        done += 1
        results[mutant.name] = result
        file = str(mutant.file.relative_to(ROOT))
        line = {"mutant": mutant.name, "file": file, "digest": modules[str(mutant.file)], "result": result}
        with kept.open("a") as lines:
            print(json.dumps(line), file=lines)
        if result in (SURVIVED, BROKEN) and mutant.name not in fine:
            print(f"{result}: line {mutant.lines[0]}, {len(tests)} tests: {mutant.name}", flush=True)
        if done % 50 == 0:
            print(f"{done} of {len(left)}, {(stopwatch_ns() - began) / NS_PER_S:.0f} s", file=sys.stderr, flush=True)

    if left:
        warm = Warm(wanted, kept.with_name("concerned.json"))
        warm.told = told
        _pytest(options.tests, [warm])
    wrong, text = report(everyone, results, fine)
    print(text)
    if options.page:
        page.write("mutation", text)
    return 1 if wrong else 0


def report(everyone: Sequence[Mutant], results: dict[str, str], fine: dict[str, str]) -> tuple[int, str]:
    """How many survivors have no reason, and reasons no survivor; and a table."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    wrong = 0
    for mutant in everyone:
        result = results.get(mutant.name, "not run")
        if mutant.name in fine:
            if result in (SURVIVED, BROKEN):
                result = REASON
            elif result != "not run":
                print(f"is noticed, so it is not equivalent: {mutant.name}")
                wrong += 1
        counts["/".join(mutant.file.relative_to(ROOT).parts[:2])][result] += 1
    for name in sorted(fine.keys() - {each.name for each in all_mutants()}):
        print(f"there is no such mutant any more: {name}")
        wrong += 1
    total = sum(counts.values(), Counter())
    every = KILLED, HANGING, REASON, SURVIVED, BROKEN, "not run"
    columns = [each for each in every if each == SURVIVED or total[each]]
    lines = [f"| folder | mutants | {' | '.join(columns)} |", f"|---|--:{'|--:' * len(columns)}|"]
    for file, count in [*counts.items(), ("all", total)]:
        lines.append(f"| {file} | {count.total()} | {' | '.join(str(count[column]) for column in columns)} |")
    return wrong + total[SURVIVED] + total[BROKEN], "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
