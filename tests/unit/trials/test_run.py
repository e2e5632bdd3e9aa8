"""The runner of many trials: how they end, what is kept, how they are carried on, and the bar."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.patience import LIMIT, wait_until
from txt1.errors import ConfigError
from txt1.trials.run import Rows, run
from txt1.trials.workers import END_TIME, Cluster, Workers

ONE = Workers(1)


def doubled(value: int) -> int:
    """A trial."""
    return 2 * value


def killed_at_first(mark: str) -> str:
    """A trial whose process is killed the first time that it is done."""
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Path(mark).name


def hours(mark: str) -> None:
    """A trial that looks at nothing while it computes: says in a file that it has begun, and goes on for an hour."""
    Path(mark).touch()
    threading.Event().wait()


@pytest.mark.parametrize("workers", [None, ONE])
def test_each_trial_is_done_once_wherever_and_its_result_comes_by_its_key(workers: Workers | None) -> None:
    found: dict[str, int] = {}
    assert run(doubled, {"a": 1, "b": 2}, workers, found.__setitem__) == 0
    assert found == {"a": 2, "b": 4}


def test_a_trial_whose_process_is_killed_is_done_again(tmp_path: Path) -> None:
    found: dict[int, str] = {}
    trials = {number: str(tmp_path / f"trial{number}") for number in range(2)}
    assert run(killed_at_first, trials, ONE, found.__setitem__) == 0
    assert found == {0: "trial0", 1: "trial1"}


def test_no_trial_is_begun_once_it_is_to_end() -> None:
    found: dict[int, int] = {}
    assert run(doubled, {1: 1, 2: 2, 3: 3}, None, found.__setitem__, until=lambda: len(found) == 2) == 0
    assert found == {1: 2, 2: 4}


def test_a_signal_ends_it_by_its_number_and_what_was_kept_stays() -> None:
    found: dict[int, int] = {}

    def keep(key: int, result: int) -> None:
        found[key] = result
        signal.raise_signal(signal.SIGTERM)

    assert run(doubled, {1: 1, 2: 2}, None, keep) == 128 + signal.SIGTERM
    assert found == {1: 2}


def test_a_trial_that_never_checks_for_the_end_does_not_delay_it(tmp_path: Path) -> None:
    begun = [tmp_path / str(number) for number in (1, 2, 3)]
    trials = {number: str(file) for number, file in enumerate(begun)}
    assert run(hours, trials, ONE, lambda *_: None, until=begun[0].exists) == 0
    assert not begun[2].exists()


PROGRAM = """
import sys
from tests.unit.trials import test_run
from txt1.trials.run import run
from txt1.trials.workers import Workers
sys.exit(run(test_run.hours, {1: sys.argv[1]}, Workers(1), print))
"""


def test_ctrl_c_to_all_its_processes_ends_it_within_the_grace(tmp_path: Path) -> None:
    mark = tmp_path / "begun"
    words = [sys.executable, "-c", PROGRAM, str(mark)]
    with subprocess.Popen(words, stderr=subprocess.PIPE, start_new_session=True, text=True) as runner:
        try:
            wait_until(mark.exists)
            os.killpg(runner.pid, signal.SIGINT)
            _, said = runner.communicate(timeout=LIMIT)
        finally:
            runner.kill()
    assert runner.returncode == 128 + signal.SIGINT and not said
    assert END_TIME <= 1.0, "s until one that does not look is killed: all of it within 2 s"


SIGNALLED = """
import signal
import sys
from itertools import count
from tests.unit.trials import test_run
from txt1.trials import workers
signal.signal(signal.SIGALRM, lambda *_: None)
signal.setitimer(signal.ITIMER_REAL, 0.0007, 0.0007)
workers.POLL, workers.END_TIME, asked = 0.001, 0.1, count()
assert not list(workers.Workers(1).each(test_run.hours, {1: sys.argv[1]}, lambda: next(asked) > 500))
signal.setitimer(signal.ITIMER_REAL, 0)
"""


def test_a_signal_between_two_looks_never_keeps_them_from_being_done(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", SIGNALLED, str(tmp_path / "begun")], check=True, timeout=LIMIT)


def test_rows_are_read_again_and_one_that_was_cut_off_is_told_and_done_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = Rows(tmp_path / "new" / "rows.jsonl")
    assert rows.read() == []
    rows.add({"trial": 1})
    rows.add({"trial": 2})
    rows.file.write_text(rows.file.read_text() + '{"trial": 3, "tim')
    assert Rows(rows.file).read() == [{"trial": 1}, {"trial": 2}]
    assert "line 3 is cut off or damaged; its trial is done again" in capsys.readouterr().err
    rows.add({"trial": 3})
    assert Rows(rows.file).read() == [{"trial": 1}, {"trial": 2}, {"trial": 3}]
    assert json.loads(rows.file.read_text().splitlines()[-1]) == {"trial": 3}


BAR = """
from txt1.trials.run import run
run(abs, {1: -1, 2: -2}, None, lambda *_: None, bar="numbers")
"""


def test_on_a_terminal_there_is_a_bar_and_elsewhere_nothing() -> None:
    pexpect = pytest.importorskip("pexpect")
    shown = pexpect.spawn(sys.executable, ["-c", BAR], timeout=LIMIT, encoding="utf-8")
    shown.expect("numbers")
    shown.expect("2/2")
    shown.expect(pexpect.EOF)
    words = [sys.executable, "-c", BAR]
    assert subprocess.run(words, capture_output=True, check=True, timeout=LIMIT).stderr == b""


def test_beyond_loopback_a_cluster_has_tls() -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: the extra 'dask'")
    for place, told in (("tcp://10.0.0.1:8786", "over TLS only"), ("tls://10.0.0.1:8786", "add --dask-ca")):
        with pytest.raises(ConfigError, match=told):
            run(doubled, {1: 1}, Workers(1, Cluster(place)), lambda *_: None)
