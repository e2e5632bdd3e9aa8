"""A sweep: every combination of some settings on many processors, into one table, the same wherever it is made."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.patience import wait_until
from torture.campaign import main as campaign
from txt1.cli import execute
from txt1.cli.sweep import combinations, write_table

RUN = ["--", "run", "--json", "--speed", "max", "--drive", "0.4,0.2", "--duration", "3"]
SETTINGS = ["seed=1..2", "control.linear.kp=9,11"]


@pytest.fixture(autouse=True)
def sweeps_may_block(blocking_calls_fail: object) -> None:
    """There is no event loop of ours about."""


def test_all_combinations_come_the_last_setting_fastest() -> None:
    found = list(combinations({"a": ["1", "2"], "b": ["x", "y"]}))
    assert found == [{"a": "1", "b": "x"}, {"a": "1", "b": "y"}, {"a": "2", "b": "x"}, {"a": "2", "b": "y"}]


def test_a_table_tells_what_repeats_in_the_order_of_the_trials(tmp_path: Path) -> None:
    done = {
        1: {"code": 0, "result": {"v": 0.2, "wall_time_s": 3.0, "tasks": {"a": {"cycles": 1}}}},
        0: {"code": 3, "result": None},
    }
    write_table(tmp_path / "t.csv", {0: {"seed": "1"}, 1: {"seed": "2"}}, done)
    assert (tmp_path / "t.csv").read_text().split() == ["trial,seed,code,v", "0,1,3,", "1,2,0,0.2"]


def test_a_sweep_goes_on_where_it_was_and_the_table_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert execute(["sweep", "--jobs", "1", "--out", str(whole), *SETTINGS, *RUN]) == 0
    table = (whole / "table.csv").read_text()
    rows = table.splitlines()
    assert len(rows) == 5 and rows[0].startswith("trial,seed,control.linear.kp,code,sim_time_s")
    assert execute(["sweep", "--jobs", "1", "--out", str(whole), *SETTINGS, *RUN]) == 2
    assert "--resume carries it on" in capsys.readouterr().err
    broken.mkdir()
    (broken / "sweep.json").write_text((whole / "sweep.json").read_text())
    lines = [line for line in (whole / "rows.jsonl").read_text().splitlines(keepends=True) if line.strip()]
    (broken / "rows.jsonl").write_text("".join(lines[1:]) + lines[0][:40])  # and one that was being written
    assert execute(["sweep", "--resume", "--jobs", "1", "--out", str(broken), *SETTINGS, *RUN]) == 0
    assert (broken / "table.csv").read_text() == table
    assert "4 of 4 trials, 1 asked for" in capsys.readouterr().err
    assert execute(["sweep", "--resume", "--out", str(broken), "seed=1..9", *RUN]) == 2
    assert "another sweep" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["seed=", *RUN], ["seed=1..2"], RUN])
def test_a_sweep_of_nothing_is_refused(words: list[str], tmp_path: Path) -> None:
    assert execute(["sweep", "--out", str(tmp_path), *words]) == 2


def listens() -> bool:
    """Whether the scheduler of the cluster is there."""
    with socket.socket() as knock:
        return knock.connect_ex(("127.0.0.1", 18786)) == 0


@pytest.fixture
def cluster() -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    pytest.importorskip("distributed", reason="Dask is not installed: the extra 'dask'")
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    place = "tcp://127.0.0.1:18786"
    scheduler = subprocess.Popen([*dask, "--host", "127.0.0.1", "--port", "18786", "--no-dashboard"])
    wait_until(listens)
    worker = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        place,
        "--nthreads",
        "1",
        "--no-dashboard",
        "--no-nanny",
    ]
    workers = [subprocess.Popen(worker) for _ in range(2)]
    yield place, workers
    for each in (*workers, scheduler):
        each.kill()
        each.wait()


@pytest.mark.long
def test_a_cluster_makes_the_same_table_though_a_worker_is_killed(
    tmp_path: Path, cluster: tuple[str, list["subprocess.Popen[bytes]"]]
) -> None:
    place, workers = cluster
    here, there = tmp_path / "here", tmp_path / "there"
    settings = ["seed=1..30"]
    assert execute(["sweep", "--out", str(here), *settings, *RUN]) == 0
    words = [sys.executable, "-m", "txt1", "sweep", "--dask", place, "--out", str(there), *settings, *RUN]
    with subprocess.Popen(words) as sweep:
        rows = there / "rows.jsonl"
        wait_until(lambda: rows.exists() and len(rows.read_text().splitlines()) >= 5)
        workers[0].kill()
        assert sweep.wait() == 0
    assert json.loads((there / "sweep.json").read_text())["settings"] == settings
    assert (there / "table.csv").read_text() == (here / "table.csv").read_text()


@pytest.mark.long
def test_learn_experiment_tune_and_campaigns_come_to_the_same_on_a_cluster(
    tmp_path: Path, cluster: tuple[str, list["subprocess.Popen[bytes]"]], capsys: pytest.CaptureFixture[str]
) -> None:
    place, _ = cluster
    found = []
    for where in (["--jobs", "1"], ["--jobs", "2"], ["--dask", place]):
        out = tmp_path / where[1].replace(":", "").replace("/", "")
        assert execute(["learn", "--trials", "3", "--episodes", "3", "--no-pictures", "--out", str(out), *where]) == 0
        trials = [file.read_bytes() for file in sorted((out / "trials").glob("*"))]
        capsys.readouterr()
        words = ["experiment", "circle-slow", "--repeats", "2", "--no-figure", "--json", "--out", str(out / "circle")]
        assert execute([*words, *where]) == 0
        experiment = capsys.readouterr().out
        assert execute(["tune", "--repeats", "2", *where]) == 0
        tuned = capsys.readouterr().out
        kept = out / "campaign.jsonl"
        assert campaign(["--runs", "4", "--duration", "5", "--kept", str(kept), *where]) == 0
        rows = sorted(kept.read_text().splitlines())
        found.append((trials, experiment, tuned, rows))
    assert found[0] == found[1] == found[2]


def test_what_cannot_be_elsewhere_is_refused_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dask = ["--dask", "tcp://127.0.0.1:1"]
    assert execute(["learn", "--hal", "serial", "--port", "virtual", "--out", str(tmp_path / "a"), *dask]) == 2
    assert execute(["learn", "--log", str(tmp_path / "b.mcap"), "--out", str(tmp_path / "b"), *dask]) == 2
    assert execute(["tune", "--speed", "20", *dask]) == 2
    told = capsys.readouterr().err
    assert "--dask: this robot is not simulated" in told and "recordings would stay on the cluster's" in told
