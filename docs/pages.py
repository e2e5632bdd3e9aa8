"""What MkDocs cannot know: pages made from the program, and files beside docs/ that pages link to.

`mkdocs.yml` names this module as a hook. Commands come from the parsers, the configuration from its schema and
config/txt1.yaml, topics from the table.
"""

import argparse
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path, PurePosixPath
from pkgutil import walk_packages
from typing import Any, Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import txt1
from txt1.cli import COMMANDS, parsers
from txt1.config import Config
from txt1.errors import Txt1Error
from txt1.telemetry.topics import TOPICS

ROOT: Final = Path(__file__).parents[1]
PAGES: Final = {  # files of the repository that are pages of the site, too
    name: f"{name.lower().replace('_', '-')}.md"
    for name in ("CHANGELOG", "CONTRIBUTING", "SECURITY", "CODE_OF_CONDUCT")
}
COPIED: Final = (
    "examples/**/*.py",
    "tests/plugins/site/*.py",
    "config/**/*.yaml",
    "plugins/*/README.md",
)  # files that pages link to
DRIVES: Final = ROOT / "build" / "drive"  # the robot in the browser, which `make docs` made unless it could not
DOOR: Final = "../plugins/browser/README.md#drive-now"  # leads to how to make it, and on the site to the robot itself


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put pages that the navigation does not name at the end of its "How-to"."""
    named = set(re.findall(r"[\w/-]+\.md", str(config.nav)))
    there = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    how_to = next(each["How-to"] for each in config.nav or [] if "How-to" in each)
    how_to.extend(sorted(there - named))
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is made from the program, and what lies beside docs/."""
    made = {
        "reference/commands.md": commands(),
        "reference/configuration.md": settings(),
        "reference/topics.md": topics(),
    }
    made |= {page: (ROOT / f"{name}.md").read_text("utf-8") for name, page in PAGES.items()}
    for where, text in made.items():
        files.append(File.generated(config, where, content=text))
    for path in (each for pattern in COPIED for each in ROOT.glob(pattern)):
        files.append(File.generated(config, f"tree/{path.relative_to(ROOT)}", content=path.read_text("utf-8")))
    for path in (each for each in DRIVES.rglob("*") if each.is_file()):
        files.append(File.generated(config, f"drive/{path.relative_to(DRIVES)}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Let links that leave docs/ lead to the site's copies."""
    here = PurePosixPath(page.file.src_uri).parent
    if DRIVES.exists():
        markdown = markdown.replace(f"({DOOR})", "(drive/index.html)")
    of_root = page.file.src_uri in PAGES.values()

    def moved(found: re.Match[str]) -> str:
        inside = found[1]
        if of_root:  # such a page was written for the root of the repository
            inside = inside.removeprefix("docs/") if inside.startswith("docs/") else f"../{inside}"
        if here.is_relative_to("tree/plugins"):  # a plug-in's page lies one folder higher in the repository
            inside = inside.replace("../../docs/", "../../../")
        path, _, anchor = inside.partition("#")
        up = "../" * len(here.parts)
        if path.startswith(f"{up}../"):
            outside = path.removeprefix(f"{up}../")
            name = PurePosixPath(outside).stem
            path = up + PAGES.get(name, f"tree/{outside}")
        return f"]({path}#{anchor})" if anchor else f"]({path})"

    return re.sub(r"\]\((?!https?:|mailto:|#)([^)\s]+)\)", moved, markdown)


def commands() -> str:
    """The options of every command, as tables; `txt1 COMMAND --help` prints the same."""
    lines = ["# Commands", "", "`txt1 COMMAND --help` prints the same in a terminal.", ""]
    for name, parser in parsers():
        lines += [f"{'##' if name in COMMANDS else '###'} txt1 {name}", ""]
        lines += [_cell(parser.description or ""), ""]
        for group in parser._action_groups:  # noqa: SLF001 -- argparse tells its groups nowhere else
            rows = [each for each in group._group_actions if each.help and "-h" not in each.option_strings]  # noqa: SLF001
            if not rows:
                continue
            title = (group.title or "options").replace("positional arguments", "words")
            lines += [f"| {title} | |", "|---|---|"]
            lines += [f"| `{_said(each)}` | {_cell(each.help % _values(each))} |" for each in rows]
            lines.append("")
    return "\n".join(lines)


def _said(action: argparse.Action) -> str:
    """An option or word as it is typed."""
    shown = action.metavar if action.metavar is not None else "\\|".join(map(str, action.choices or ()))
    value = " ".join(shown) if isinstance(shown, tuple) else shown
    if not action.option_strings:
        return value or action.dest
    value = "" if action.nargs == 0 else value or action.dest.upper()
    return f"{action.option_strings[-1]} {f'[{value}]' if action.nargs == '?' else value}".rstrip()


def _values(action: argparse.Action) -> dict[str, Any]:
    return {name: value for name, value in vars(action).items() if name != "help"} | {"prog": "txt1"}


def _cell(text: str) -> str:
    """A help text within a table."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def settings() -> str:
    """Every default with unit and source, section by section, and the limits of each."""
    text = (ROOT / "config" / "txt1.yaml").read_text("utf-8")
    head, *sections = re.split(r"(?m)^(?=[a-z_]+:)", text)
    about = "\n".join(line.removeprefix("#").strip() for line in head.splitlines() if "    " not in line).strip()
    lines = ["# Settings", "", about, "", "How to set them: [configuration](../configuration.md).", ""]
    for section in sections:
        lines += [f"## {section.partition(':')[0]}", "", "```yaml", section.rstrip(), "```", ""]
    lines += ["## Types and limits", "", "| key | type | limits |", "|---|---|---|"]
    schema = Config.model_json_schema()
    lines += [f"| `{key}` | {kind} | {limits} |" for key, kind, limits in _limits(schema, schema, "")]
    return "\n".join(lines) + "\n"


BOUNDS: Final = {
    "exclusiveMinimum": "> ", "minimum": "≥ ", "exclusiveMaximum": "< ", "maximum": "≤ ", "minItems": "at least ",
    "maxItems": "at most ", "pattern": "",
}  # fmt: skip


def _limits(schema: dict[str, Any], whole: dict[str, Any], key: str) -> Iterator[tuple[str, str, str]]:
    if "$ref" in schema:
        schema = whole["$defs"][schema["$ref"].rpartition("/")[2]]
    if "properties" in schema:
        for name, each in schema["properties"].items():
            yield from _limits(each, whole, f"{key}.{name}" if key else name)
        return
    kinds = schema.get("anyOf", [schema])
    bounds = [f"{sign}{each[name]}" for each in kinds for name, sign in BOUNDS.items() if name in each]
    names = [
        " or ".join(map(repr, each.get("enum", [each.get("const")])))
        if "enum" in each or "const" in each
        else str(each.get("type", each.get("$ref", "any").rpartition("/")[2]))
        for each in kinds
    ]
    yield (
        key,
        " or ".join(dict.fromkeys(names)).replace("|", "\\|"),
        " ".join(f"`{each}`" for each in bounds).replace("|", "\\|"),
    )


def topics() -> str:
    """The table of topics."""
    for module in walk_packages(txt1.__path__, "txt1."):
        try:
            import_module(module.name)
        except (ImportError, Txt1Error):  # needs an extra that is not here
            continue
    lines = [
        "# Topics",
        "",
        "Everything that the robot tells, recorded and shown from one table.",
        "A sensor adds `/sensors/NAME`; with a robot's name configured it stands before each.",
        "",
        "| topic | tells | units | told | message |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| `{name}` | {each.about} | {each.units or '–'} | {each.rule} | `{each.message}` |"
        for name, each in sorted(TOPICS.items())
    ]
    return "\n".join(lines) + "\n"
