"""What a release has beside its wheels: constraints, which pip takes, checksums, and the text of its changelog."""

import subprocess
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from rigs.release import OURS, commit, constraints, imports_of, main, notes, set_version, versions
from txt1.version import __version__

ROOT = Path(__file__).parents[2]
with_plugins = pytest.mark.skipif(
    find_spec("txt1_browser") is None, reason="a release is made where the plug-ins are: not installed"
)


@with_plugins
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
        one = Requirement(line.partition("  #")[0])
        # pip takes no others as constraints
        assert one.url is None and not one.extras
    assert f"Python {'.'.join(map(str, sys.version_info[:3]))}," in lines[1]


@with_plugins
def test_what_only_a_users_environment_has_is_named_with_what_was_tried_of_it() -> None:
    _, missing = versions()
    others = dict.fromkeys(missing, "1.2.3")
    lines = constraints(others | {"numpy": "0.0.1"}).splitlines()
    assert f"numpy=={version('numpy')}" in lines, "what the tests had goes before"
    assert not any("not tested" in line for line in lines)
    for name in missing:
        (line,) = (line for line in lines if line.startswith(f"{name}=="))
        assert line.partition("#")[0].strip() == f"{name}==1.2.3" and "imports" in line


def test_what_our_modules_import_of_a_package_is_found() -> None:
    found = imports_of(["pettingzoo", "Phidget22"])
    assert "from pettingzoo import ParallelEnv" in found
    assert any(line.startswith("from Phidget22.Devices.VoltageRatioInput import") for line in found)
    assert not any("numpy" in line or "txt1" in line for line in found)


def root_with(folder: Path, *fragments: str) -> Path:
    """A folder with the files that name the version, and fragments of a changelog."""
    names = ["pyproject.toml", "txt1/version.py", "CITATION.cff", "CHANGELOG.md"]
    names += [str(each.relative_to(ROOT)) for each in ROOT.glob("plugins/*/pyproject.toml")]
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text((ROOT / name).read_text("utf-8"), "utf-8")
    log = folder / "CHANGELOG.md"
    if "\n## Unreleased\n" not in log.read_text("utf-8"):
        log.write_text("## Unreleased\n\n- new\n\n" + log.read_text("utf-8"), "utf-8")
    (folder / "changes").mkdir()
    for name in ("README.md", *fragments):
        (folder / "changes" / name).write_text("New.\n", "utf-8")
    return folder


def test_a_version_is_written_wherever_it_is_named(tmp_path: Path) -> None:
    folder = root_with(tmp_path)
    set_version(folder, "7.8.9", "2031-02-03")
    read = {each.relative_to(folder): each.read_text("utf-8") for each in folder.rglob("*") if each.is_file()}
    log = read.pop(Path("CHANGELOG.md"))
    assert "## 7.8.9 (2031-02-03)\n" in log and "## Unreleased" not in log and notes(log, "7.8.9").strip()
    assert not any(__version__ in text for text in read.values())
    assert "version: 7.8.9\ndate-released: 2031-02-03\n" in read[Path("CITATION.cff")]
    plugins = [text for name, text in read.items() if name.match("plugins/*/pyproject.toml")]
    assert len(plugins) == len(OURS) - 1
    assert all('version = "7.8.9"' in text and '"txt1==7.8.9"' in text for text in plugins)


@pytest.mark.parametrize(
    ("fragments", "version", "told"),
    [(["pad-lost.fixed.md"], "7.8.9", "pad-lost"), ([], "next", "'next' is no version")],
)
def test_a_version_is_refused_and_nothing_written(
    fragments: list[str], version: str, told: str, tmp_path: Path
) -> None:
    folder = root_with(tmp_path, *fragments)
    with pytest.raises(ValueError, match=told):
        set_version(folder, version, "2031-02-03")
    assert (folder / "CITATION.cff").read_text("utf-8") == (ROOT / "CITATION.cff").read_text("utf-8")


@with_plugins
def test_without_git_the_constraints_name_no_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert commit() == "unknown"
    assert "unknown" in constraints()


@with_plugins
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
