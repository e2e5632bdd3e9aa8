"""Counts where our English has to be read twice: ``python -m docs.words [FILE ...]``. It shows where to read.

Two things are counted. Words that point at something that stands elsewhere: "what", "those", "one", "so many", "such",
"nobody", "the other". And sentences of more than 25 words. trio's and python-can's documentation is counted beside
ours; their source distributions come from the package index into build/words. No number is to be met by swapping words:
a file with a large one wants to be read.
"""

import argparse
import ast
import re
import subprocess
import sys
import tarfile
from collections.abc import Iterable, Iterator, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
PEERS: Final = {"trio": "trio==0.35.0", "python-can": "python-can==4.6.1"}
KEPT: Final = ROOT / "build" / "words"
LONG: Final = 25  # words
POINTING: Final = re.compile(r"\b(?:what|those|ones?|so many|such|nobody|the others?)\b", re.I)
WORD: Final = re.compile(r"[\w'’./+-]*\w[\w'’]*")
END: Final = re.compile(r"(?<=[.!?])[)\"'*_]*\s+(?=[\"'(*_`\[]*[A-Z0-9`])")
ABBREVIATED: Final = re.compile(r"\b(e\.g|i\.e|cf|vs|etc|Fig|Eq|approx)\.")


class Count(NamedTuple):
    """Of one text: its words, the pointing ones among them, its sentences, and the long ones among them."""

    words: int = 0
    pointing: int = 0
    sentences: int = 0
    long: int = 0

    def __add__(self, more: tuple[int, ...]) -> "Count":  # type: ignore[override]
        return Count(*(a + b for a, b in zip(self, more, strict=True)))

    @property
    def per_thousand(self) -> float:
        """Pointing words in 1000."""
        return 1000.0 * self.pointing / max(1, self.words)

    @property
    def share(self) -> float:
        """Long sentences in 100."""
        return 100.0 * self.long / max(1, self.sentences)


class Sentence(NamedTuple):
    """A sentence and its file; `weight` is its length in words, and eight more for each pointing word."""

    weight: int
    file: str
    text: str


def markdown(text: str) -> Iterator[str]:
    """Paragraphs, items, and cells of a page; no code, no pictures, no addresses."""
    text = re.sub(r"^---\n.*?\n---\n", "", text, flags=re.S)
    text = re.sub(r"^([ \t]*)(```|~~~).*?^\1\2", "\n\n", text, flags=re.S | re.M)
    text = re.sub(r"<!--.*?-->|<[^<>\n]+>", "", text, flags=re.S)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    for part in re.split(r"\n[ \t]*\n|\n(?=[ \t]*(?:[-*+]|\d+\.)[ \t])|\n(?=[#|])", text):
        if part.startswith("    "):
            continue
        for cell in part.split("|") if part.startswith("|") else [part]:
            yield re.sub(r"^[ \t#>*+-]*", "", cell)


def restructured(text: str) -> Iterator[str]:
    """The same of a page of Sphinx, or of a docstring: no directives, no literal blocks, no fields' names."""
    text = re.sub(r"^([ \t]*)\.\. .*\n(?:\1[ \t]+.*\n|\n)*", "\n\n", text + "\n", flags=re.M)
    text = re.sub(r"^([ \t]*)(.*)::[ \t]*\n(?:\n|\1[ \t]+.*\n)*", r"\1\2:\n\n", text, flags=re.M)
    text = re.sub(r"^[=~^\-`'\"#*+]{3,}$", "", text, flags=re.M)
    text = re.sub(r":\w+(?::\w+)*:`([^`<]*)(?:<[^`]*)?`", r"\1", text)
    text = re.sub(r"^[ \t]*:\w+[^:\n]*:", "", text, flags=re.M)
    for part in re.split(r"\n[ \t]*\n|\n(?=[ \t]*(?:[-*|]|\d+\.|\w+:)[ \t])", text):
        formula = part.startswith("    ") and not re.match(r"[ \t]+(?:\w+:|[-*] )", part)
        if not formula and not part.lstrip().startswith((">>>", "$ ")):
            yield part.strip(" \t*-|")


def docstrings(source: str) -> Iterator[str]:
    """Every docstring of a module, also those of attributes."""
    for node in ast.walk(ast.parse(source)):
        for each in getattr(node, "body", []) if not isinstance(node, ast.Lambda | ast.IfExp) else []:
            if (
                isinstance(each, ast.Expr)
                and isinstance(each.value, ast.Constant)
                and isinstance(each.value.value, str)
            ):
                yield cleandoc(each.value.value)


def sentences(parts: Iterable[str]) -> Iterator[str]:
    """The sentences of paragraphs; a piece of code within one counts as a word."""
    for part in parts:
        plain = re.sub(r"``.+?``|`[^`]*`", "CODE", part, flags=re.S)
        plain = " ".join(ABBREVIATED.sub(r"\1", plain).split())
        for sentence in END.split(plain):
            if len(WORD.findall(sentence)) > 2:
                yield sentence


def count(found: Sequence[str]) -> Count:
    """Count sentences."""
    lengths = [len(WORD.findall(each)) for each in found]
    pointing = sum(len(POINTING.findall(each)) for each in found)
    return Count(sum(lengths), pointing, len(found), sum(length > LONG for length in lengths))


def read(path: Path) -> list[str]:
    """The sentences of a file: a page, or the docstrings of a module."""
    text = path.read_text("utf-8", errors="replace")
    if path.suffix == ".md":
        return list(sentences(markdown(text)))
    if path.suffix == ".py":
        return list(sentences(part for each in docstrings(text) for part in restructured(each)))
    return list(sentences(restructured(text)))


def ours() -> dict[str, list[Path]]:
    """Our files by kind; the changelog of past versions is left out, as it is not rewritten."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return {"pages": pages, "docstrings": sorted((ROOT / "txt1").rglob("*.py"))}


def peer(name: str) -> dict[str, list[Path]]:
    """A peer's files by kind; none where its source distribution cannot be had."""
    folder = KEPT / name
    if not folder.exists():
        KEPT.mkdir(parents=True, exist_ok=True)
        words = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", ":all:"]
        before = set(KEPT.glob("*.tar.gz"))
        command = [*words, "--dest", str(KEPT), PEERS[name]]
        subprocess.run(command, check=False, capture_output=True)  # noqa: S603
        made = set(KEPT.glob("*.tar.gz")) - before
        if not made:
            return {}
        with tarfile.open(made.pop()) as archive:
            archive.extractall(folder, filter="data")
    source = next(path for path in folder.iterdir() if path.is_dir())
    docs, code = (next(source / each for each in names if (source / each).is_dir()) for names in PLACES)
    kept = [path for path in code.rglob("*.py") if not {"test", "tests", "_tests"} & set(path.parts)]
    return {"pages": sorted(path for path in docs.rglob("*.rst") if path.name != "history.rst"), "docstrings": kept}


PLACES: Final = (("docs", "doc"), ("src", "can"))  # of a peer's pages and of its package


def line(name: str, counted: Count) -> str:
    """One row of the report."""
    return f"{name:<44} {counted.words:>7} {counted.per_thousand:>9.1f} {counted.share:>8.1f}"


def worst(files: Iterable[Path], number: int) -> list[Sentence]:
    """The sentences of the largest weight."""
    found = [
        Sentence(len(WORD.findall(each)) + 8 * len(POINTING.findall(each)), str(path.relative_to(ROOT)), each)
        for path in files
        for each in read(path)
    ]
    return sorted(found, reverse=True)[:number]


def main() -> None:
    """Print the report."""
    parser = argparse.ArgumentParser(prog="docs.words", description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="pages or modules; all of ours by default")
    parser.add_argument("--files", dest="shown", type=int, default=25, metavar="N", help="the N files to read first")
    parser.add_argument("--worst", type=int, default=20, metavar="N", help="the N heaviest sentences")
    arguments = parser.parse_args()
    kinds = {"given": [path.resolve() for path in arguments.files]} if arguments.files else ours()
    print(f"{'':<44} {'words':>7} {'pointing':>9} {'over 25':>8}")
    print(f"{'':<44} {'':>7} {'in 1000':>9} {'in 100':>8}")
    for kind, paths in kinds.items():
        print(line(f"txt1: {kind}", sum((count(read(path)) for path in paths), Count())))
    for name in [] if arguments.files else PEERS:
        files = peer(name)
        for kind, paths in files.items():
            print(line(f"{name}: {kind}", sum((count(read(path)) for path in paths), Count())))
        if not files:
            print(f"{name}: its source distribution was not reachable")
    every = [path for paths in kinds.values() for path in paths]
    ranked = sorted(((count(read(path)), path) for path in every), key=lambda each: -(each[0].pointing + each[0].long))
    print("\nto read first: the files with most pointing words and long sentences")
    for counted, path in ranked[: arguments.shown]:
        print(line(str(path.relative_to(ROOT)), counted))
    print("\nthe heaviest sentences")
    for sentence in worst(every, arguments.worst):
        print(f"{sentence.weight:>4} {sentence.file}: {sentence.text}")


if __name__ == "__main__":
    main()
