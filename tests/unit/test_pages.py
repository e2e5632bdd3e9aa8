"""What the pages tell to type: every command is one, and those of the first hour run as they stand, page by page.

What they name besides is there, too: settings, files, modules, targets of make; and their YAML is valid.
"""

import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from tests.patience import LIMIT
from txt1.cli import parsed
from txt1.config import Config, checked, flatten, load
from txt1.errors import MissingPlugin
from txt1.experiments.profile import Profile
from txt1.fleet.plan import FleetPlan

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
# a page may set what its plug-in alone reads
PAGES += [each for each in sorted(ROOT.glob("plugins/*/README.md")) if find_spec(f"txt1_{each.parent.name}")]
EACH = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
TEMPLATE = re.compile(r"\.\.\.|^\[|^[A-Z][A-Z0-9_]+([:=,].*)?$")  # a word that stands for others
MENTION = ("required", "expected one argument")  # a command that a sentence names without all that it takes
FILE = re.compile(r'```\w+ title="([\w.]+)"\n(.*?)```', re.DOTALL)  # one that the reader is to write
PART = re.compile(r"`((?:benchmarks|config|docs|examples|firmware|tests|torture|txt1)/[\w./-]+)`")  # of the tree
FOLDERS = ("benchmarks", "docs", "torture")  # whose modules are run with python -m
SUFFIXES = ("csv", "json", "png", "md", "py", "yaml")  # of files whose names are no settings
TUTORIALS = ("task", "light", "tune", "car", "sensor", "fleet")
ENDS_AT = 2.0  # s of the robot's time, at which an operator ends with Ctrl-C what runs for ever


def commands(page: Path) -> Iterator[list[str]]:
    """The words of each command in a page's blocks of code, without environment and comment."""
    for line in re.findall(r"(?m)^(?: {4,}|)((?:TXT1_\w+=\S+ )?(?:txt1|python) .*)$", page.read_text("utf-8")):
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # a sentence with an apostrophe
            continue
        yield words[1:] if "=" in words[0] else words


def told(page: Path, templates: bool = False) -> Iterator[list[str]]:
    """The words behind `txt1` of each command in a page, also within sentences.

    Those in which a word stands for others, or those in which none does.
    """
    inside = (shlex.split(each) for each in re.findall(r"`(txt1\s[^`]+)`", page.read_text("utf-8")))
    for words in (*commands(page), *inside):
        if words[0] == "txt1" and any(TEMPLATE.search(word) for word in words) is templates:
            yield words[1 : next((k for k, word in enumerate(words) if word in (">", "|")), None)]


@EACH
def test_every_command_that_a_page_names_is_one(
    page: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    for words in told(page):
        try:
            parsed(words)
        except MissingPlugin:
            # it says so itself, with the command that installs the plug-in
            continue
        except SystemExit as ended:
            said = capsys.readouterr().err
            allowed = ended.code == 0 or any(each in said for each in ("there is no file", *MENTION))
            assert allowed, f"{shlex.join(words)}: {said}"
        load(None, [value for option, value in pairwise(words) if option == "--set"])


@EACH
def test_every_option_beside_a_word_that_stands_for_others_is_one(
    page: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    for words in told(page, templates=True):
        if not any(re.search(r"\.\.\.|[][]", word) for word in words):
            try:
                parsed(words)
            except MissingPlugin:
                continue
            except SystemExit:
                assert "unrecognized arguments" not in (said := capsys.readouterr().err), f"{shlex.join(words)}: {said}"


@EACH
def test_every_setting_that_a_page_names_is_one(page: Path) -> None:
    known = dict(flatten(Config()))
    sections = {key.partition(".")[0] for key in known}
    for key in re.findall(r"`(?:--set )?([a-z_]+(?:\.[a-z0-9_]+)+)(?:[=:][^`]*)?`", page.read_text("utf-8")):
        if key.partition(".")[0] not in sections or key.rpartition(".")[2] in SUFFIXES:
            continue
        within = {name for name in known if f"{name}.".startswith(f"{key}.")}
        free = {name for name, value in known.items() if value == {} and key.startswith(f"{name}.")}
        assert within | free, key


@EACH
def test_every_file_module_and_target_that_a_page_names_is_there(page: Path) -> None:
    text = page.read_text("utf-8")
    assert [path for path in PART.findall(text) if not (ROOT / path).exists()] == []
    modules = {name.replace(".", "/") for name in re.findall(r"python\s+-m\s+([\w.]+)", text)}
    modules |= {f"benchmarks/{name}" for name in re.findall(r"python\s+-m\s+benchmarks\s+(\w+)", text)}
    own = {name for name in modules if name.partition("/")[0] in FOLDERS}
    assert [name for name in own if not ((ROOT / name).is_dir() or (ROOT / f"{name}.py").exists())] == []
    targets = set(re.findall(r"(?m)(?:`|^ {4,})make ([a-z-]+)", text))
    (phony,) = re.findall(r"(?m)^\.PHONY: (.*)$", (ROOT / "Makefile").read_text("utf-8"))
    assert targets <= set(phony.split())


@EACH
def test_every_block_of_yaml_on_a_page_is_valid(page: Path, tmp_path: Path) -> None:
    for text in re.findall(r"```yaml[^\n]*\n(.*?)```", page.read_text("utf-8"), re.DOTALL):
        tree = yaml.safe_load(text)
        if "title" in tree:
            Profile.model_validate(tree)
        elif "robots" in tree:
            FleetPlan.model_validate(tree)
        else:
            (tmp_path / "block.yaml").write_text(text, "utf-8")
            config = load(tmp_path / "block.yaml").config
            if config.hal_options:
                driver = import_module(f"txt1.cars.{config.hal}.driver")
                checked(getattr(driver, f"{config.hal.title()}Options"), config.hal_options, "hal_options")


def anchors(text: str) -> set[str]:
    """The ids of a page's headings, as sites make them, and those that it writes itself."""
    headings = re.findall(r"(?m)^#+ (.*)$", re.sub(r"(?ms)^```.*?^```", "", text))
    plain = (re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading) for heading in headings)
    made = {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in plain}
    return made | set(re.findall(r'<a id="([^"]+)">', text))


@EACH
def test_every_link_inside_the_repository_leads_to_a_place(page: Path) -> None:
    made = re.findall(r'"(reference/\w+\.md)": \w+\(\)', (ROOT / "docs/pages.py").read_text("utf-8"))
    text = re.sub(r"(?ms)^```.*?^```|`[^`\n]*`", "", page.read_text("utf-8"))
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        place, _, anchor = link.partition("#")
        file = (page.parent / place).resolve() if place else page
        if re.match(r"https?:|mailto:", link) or file in [ROOT / "docs" / each for each in made]:
            continue
        assert file.exists(), link
        assert not anchor or file.suffix != ".md" or anchor in anchors(file.read_text("utf-8")), link


def test_each_page_of_results_names_the_day_of_its_measuring() -> None:
    for page in sorted((ROOT / "docs/results").glob("*.md")):
        # a proof
        if page.name != "least_time.md":
            assert re.search(r"\b20\d\d-\d\d-\d\d\b", page.read_text("utf-8")), page.name


def test_each_picture_has_the_command_that_makes_it(tracked: list[str]) -> None:
    drawn = (".png", ".svg", ".gif", ".webp")
    pictures = [each for each in tracked if each.startswith("docs/") and Path(each).suffix in drawn]
    rows = re.findall(r"(?m)^\| ([^|`]+) \| .*`.*\|$", (ROOT / "docs/results/first-hour.md").read_text("utf-8"))
    named = [name.strip() for row in rows for name in row.split(",")]
    unmade = [each for each in pictures if not any(Path(each).match(name) for name in named)]
    assert pictures and unmade == []


def test_the_moving_picture_has_room_for_its_legends_and_loads_quickly() -> None:
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed: the extra 'camera'")
    file = ROOT / "docs" / "web" / "drive.webp"
    with image.open(file) as picture:
        assert picture.width >= 1100 and file.stat().st_size <= 1_500_000


def until(process: "subprocess.Popen[str]", time: float) -> None:
    """Read a robot's status lines until its time is so many s, or it has ended."""
    assert process.stdout is not None
    kill = threading.Timer(10.0 * LIMIT, process.kill)
    kill.start()
    for line in process.stdout:
        found = re.match(r"t= *(\S+) s", line)
        if found and float(found[1]) >= time:
            break
    kill.cancel()


def run_page(page: Path, folder: Path, without: tuple[str, ...] = ()) -> None:
    """Write the page's files, then run its commands there, one after the other, as a reader without a terminal does."""
    for name, text in FILE.findall(page.read_text("utf-8")):
        (folder / name).write_text(text)
    clean = {name: value for name, value in os.environ.items() if not name.startswith("TXT1_")}
    clean["PYTHONPATH"] = str(ROOT)
    for words in (each for each in commands(page) if each[1] not in without):
        program = [sys.executable, "-m", "txt1"] if words[0] == "txt1" else [sys.executable]
        output = None
        if ">" in words:
            words, output = words[: words.index(">")], folder / words[-1]
        with subprocess.Popen(
            [*program, *words[1:]],
            cwd=folder,
            env=clean,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            endless = words[:2] == ["txt1", "run"] and "--duration" not in words
            if endless:
                until(process, ENDS_AT)
                process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=10.0 * LIMIT)
        assert process.returncode == (130 if endless else 0), f"{shlex.join(words)}: {process.returncode}\n{out}\n{err}"
        if output is not None:
            output.write_text(out)


@pytest.mark.long
def test_the_start_page_runs_word_by_word(tmp_path: Path) -> None:
    run_page(ROOT / "docs" / "start.md", tmp_path, without=("demo", "replay"))
    assert (tmp_path / "first.html").stat().st_size > 10_000


@pytest.mark.long
def test_the_demo_and_a_replay_of_the_start_page_run_too(tmp_path: Path) -> None:
    run_page(ROOT / "docs" / "start.md", tmp_path)
    assert (tmp_path / "out" / "demo" / "demo.mcap").exists()


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    # that of maps compiles with numba first
    [*(f"tutorials/{name}" for name in TUTORIALS), "completion", pytest.param("tutorials/map", marks=pytest.mark.long)],
)
def test_a_tutorial_runs_as_it_stands(name: str, tmp_path: Path) -> None:
    run_page(ROOT / "docs" / f"{name}.md", tmp_path)
