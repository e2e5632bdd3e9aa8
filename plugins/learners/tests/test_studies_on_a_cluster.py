"""Studies come to the same on a Dask cluster as on the processes of one computer."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.e2e.test_sweep import cluster
from txt1_learners.studies.__main__ import main as study

__all__ = ["cluster"]


@pytest.mark.long
def test_learners_in_worlds_and_contenders_come_to_the_same_on_a_cluster(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    place, _ = cluster
    small = ["--trials", "2", "--episodes", "9"]
    worlds = ["worlds", "usual", "--world", "thesis,sensor-dead", "--agent", "thesis,pilot"]
    found = []
    for where in (["--jobs", "2"], ["--dask", place]):
        out = tmp_path / where[0].strip("-")
        assert study([*worlds, *small, "--out", str(out / "worlds"), *where]) == 0
        compared = ["compare", str(out / "compared"), "--agent", "thesis,sweeps,pilot"]
        assert study([*compared, *small, *where]) == 0
        files = sorted(path for path in out.rglob("*") if path.suffix in (".json", ".md"))
        lines = sorted((out / "compared.jsonl").read_text().splitlines())
        found.append(({str(path.relative_to(out)): path.read_text() for path in files}, lines))
    assert found[0] == found[1] and len(found[0][0]) == 4 + 2 and len(found[0][1]) == 1 + 6
