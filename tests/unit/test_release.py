"""What a release has beside its wheels: constraints, which pip takes, checksums, and the text of its changelog."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from rigs.release import commit, constraints, main, notes, versions

ROOT = Path(__file__).parents[2]


def test_the_constraints_name_the_installed_versions_and_the_untested_packages() -> None:
    lines = constraints().splitlines()
    pinned = {line for line in lines if not line.startswith("#")}
    assert f"numpy=={version('numpy')}" in pinned
    assert f"pydantic-core=={version('pydantic-core')}" in pinned, "what a requirement requires itself"
    assert f"aiohttp=={version('aiohttp')}" in pinned, "of an extra"
    assert f"rosbags=={version('rosbags')}" in pinned, "of a plug-in"
    assert not any(line.startswith(("txt1==", "pytest==", "mkdocs==")) for line in pinned)
    _, missing = versions()
    assert [line.rpartition(" ")[2] for line in lines if "not tested" in line] == missing
    for line in pinned:
        one = Requirement(line)
        # pip takes no others as constraints
        assert one.url is None and not one.extras
    assert f"Python {'.'.join(map(str, sys.version_info[:3]))}," in lines[1]


def test_without_git_the_constraints_name_no_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert commit() == "unknown"
    assert "unknown" in constraints()


@pytest.mark.long  # pip runs twice
def test_pip_obeys_the_constraints(tmp_path: Path) -> None:
    file = tmp_path / "constraints.txt"
    main(["constraints", str(file)])
    words = [sys.executable, "-m", "pip", "install", "--dry-run", "--no-index", "--no-deps", "-c", str(file)]
    kept = subprocess.run([*words, "numpy"], capture_output=True, text=True, check=False)
    assert kept.returncode == 0, kept.stderr
    other = subprocess.run([*words, "numpy!=" + version("numpy")], capture_output=True, text=True, check=False)
    assert other.returncode != 0


def test_sha256sum_reads_the_checksums(tmp_path: Path) -> None:
    (tmp_path / "a.whl").write_bytes(b"a")
    (tmp_path / "constraints.txt").write_bytes(b"numpy==1\n")
    # the second time, the sums are there already
    for _ in range(2):
        main(["sums", str(tmp_path)])
    lines = (tmp_path / "SHA256SUMS").read_text().splitlines()
    assert [line[64:] for line in lines] == ["  a.whl", "  constraints.txt"]
    assert lines[0].startswith("ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb")


def test_the_notes_of_a_release_are_its_section_of_the_changelog() -> None:
    text = "## Unreleased\n\n- new\n\n## 0.2.0 (2026-11-22)\n\nA summary.\n\n### Words\n\n- b\n\n## 0.1.0\n\n- c\n"
    assert notes(text, "0.2.0") == "A summary.\n\n### Words\n\n- b\n"
    with pytest.raises(ValueError, match=r"no section '## 0\.3\.0'"):
        notes(text, "0.3.0")


def test_every_job_of_the_release_needs_jobs_that_are_there() -> None:
    jobs = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text())["jobs"]
    for job in jobs.values():
        needs = job.get("needs", [])
        assert set([needs] if isinstance(needs, str) else needs) <= set(jobs)
    assert "PUBLISH_TO_INDEX" in jobs["publish"]["if"], "nobody owns the name on the index yet"
