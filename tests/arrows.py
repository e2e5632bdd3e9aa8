"""Which folder knows which: imports, and texts that name a module.

    python -m tests.arrows             # one line for each pair of folders
    python -m tests.arrows --places    # ... with the line of each import

The folders are the layers of the contract in pyproject.toml, the other packages of txt1/, and the folders beside it.
There are four kinds of arrow:

- import: at the top of a module;
- lazy: within a function, when it is called;
- typing: under `if TYPE_CHECKING`, for the type checker alone;
- text: "package.module:function"; in a module that calls import_module, and in a file addition.py, "package.module",
  too. A text with a variable part, such as f"txt1.cli.{name}", is an arrow to the part before it.

`lint-imports` judges the imports. The exit code here is 1 when a text does not resolve, or when a text of the spine
names an addition: any folder that holds an addition.py.
"""

import argparse
import ast
import re
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
TOPS: Final = ("txt1", "rigs", "benchmarks", "torture", "tests", "docs", "examples")
KINDS: Final = ("import", "lazy", "typing", "text")
_TEXT: Final = re.compile(rf"({'|'.join(TOPS)})(\.\w+)*(:\w+(\.\w+)*)?")
_BEGIN: Final = re.compile(rf"({'|'.join(TOPS)})(\.\w+)*\.")


class Arrow(NamedTuple):
    """One import, or one text that stands for an import."""

    file: str
    line: int
    kind: str  # one of KINDS
    target: str  # a module, or "module:name"


class Pair(NamedTuple):
    """Two folders of which the first knows the second."""

    source: str
    target: str


class _Reader(ast.NodeVisitor):
    """Collects the arrows of one file."""

    def __init__(self, file: str, tree: ast.Module, plain: bool) -> None:
        self.arrows: list[Arrow] = []
        self._file = file
        self._kind = "import"
        self._plain = plain
        self.visit(tree)

    def _add(self, node: ast.stmt | ast.expr, kind: str, target: str) -> None:
        if target.partition(".")[0].partition(":")[0] in TOPS:
            self.arrows.append(Arrow(self._file, node.lineno, kind, target))

    def _within(self, kind: str, nodes: list[ast.stmt]) -> None:
        before, self._kind = self._kind, "typing" if "typing" in (kind, self._kind) else kind
        for node in nodes:
            self.visit(node)
        self._kind = before

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for each in (*node.decorator_list, node.args):
            self.visit(each)
        self._within("lazy", node.body)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_If(self, node: ast.If) -> None:
        self.visit(node.test)
        typing = ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        self._within("typing" if typing else self._kind, node.body)
        self._within(self._kind, node.orelse)

    def visit_Import(self, node: ast.Import) -> None:
        for each in node.names:
            self._add(node, self._kind, each.name)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        above = self._file.split("/")[: -node.level] if node.level else []
        base = ".".join([*above, *filter(None, [node.module])])
        for target in sorted({f"{base}.{each.name}" if source(f"{base}.{each.name}") else base for each in node.names}):
            self._add(node, self._kind, target)

    def visit_Constant(self, node: ast.Constant) -> None:
        text = node.value
        if isinstance(text, str) and _TEXT.fullmatch(text) and (":" in text or (self._plain and "." in text)):
            self._add(node, "text", text)

    def visit_Dict(self, node: ast.Dict) -> None:
        for each in node.values:  # a key is a name in a table, such as the group of parts "txt1.ports"
            self.visit(each)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        self.visit(node.left)
        if not isinstance(node.op, ast.Div):  # a part of a path, such as "txt1.yaml", is no module
            self.visit(node.right)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        begin = node.values[0].value if isinstance(node.values[0], ast.Constant) else ""
        if isinstance(begin, str) and _BEGIN.fullmatch(begin):
            self._add(node, "text", begin.rstrip("."))
        self.generic_visit(node)


def source(module: str) -> Path | None:
    """Return the file or folder of a module of the repository; None: there is none."""
    path = ROOT.joinpath(*module.split("."))
    there = (path.with_suffix(".py"), path / "__init__.py", path)
    return next((each for each in there if each.exists()), None)


def arrows_of(file: str, code: str) -> list[Arrow]:
    """Return the arrows of one file; `file` is its path from the root of the repository."""
    tree = ast.parse(code)
    plain = file.endswith("/addition.py") or ("import_module" in code and "import_module" in _called(tree))
    return _Reader(file, tree, plain).arrows


def _called(tree: ast.AST) -> set[str]:
    functions = (node.func for node in ast.walk(tree) if isinstance(node, ast.Call))
    return {getattr(function, "attr", getattr(function, "id", "")) for function in functions}


def arrows() -> Iterator[Arrow]:
    """Every arrow in the repository's Python."""
    for top in TOPS:
        for path in sorted((ROOT / top).rglob("*.py")):
            yield from arrows_of(path.relative_to(ROOT).as_posix(), path.read_text("utf-8"))


def resolves(target: str) -> bool:
    """Return whether the module is there, and defines the name at its top level."""
    module, _, name = target.partition(":")
    path = source(module)
    if path is None or not name:
        return path is not None
    return path.is_file() and name.partition(".")[0] in _defined(ast.parse(path.read_bytes()).body)


def _defined(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield from (each.asname or each.name for each in node.names)
        elif isinstance(node, ast.If | ast.Try):
            yield from _defined([*node.body, *node.orelse])
        else:
            names = (each for each in ast.walk(node) if isinstance(each, ast.Name))
            yield from (each.id for each in names if isinstance(each.ctx, ast.Store))


def layers() -> dict[str, int]:
    """Return the layers of the contract, 0 at the bottom."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    (given,) = (contract["layers"] for contract in settings["contracts"] if contract["type"] == "layers")
    return {f"txt1.{name.strip()}": height for height, line in enumerate(reversed(given)) for name in line.split("|")}


def in_spine(package: str, of_layers: Mapping[str, int]) -> bool:
    """Return whether a folder is a part of the spine: in the layer of the robot, or below it."""
    return package in of_layers and of_layers[package] <= of_layers["txt1.robot"]


@cache
def additions() -> frozenset[str]:
    """Return the folders of additions, as packages."""
    files = (ROOT / "txt1").rglob("addition.py")
    return frozenset(".".join(file.parent.relative_to(ROOT).parts) for file in files)


def folder(module: str, of_layers: Mapping[str, int]) -> str:
    """Return the addition or the layer that a module is in, else its package in txt1/, else its folder beside txt1/."""
    parts = module.partition(":")[0].split(".")
    for end in range(len(parts), 0, -1):
        package = ".".join(parts[:end])
        if package in additions() or package in of_layers:
            return package
    return ".".join(parts[: 2 if parts[0] == "txt1" and len(parts) > 1 else 1])


def module_of(file: str) -> str:
    """Return the name under which a file is imported."""
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def told(pair: Pair, members: list[Arrow]) -> str:
    """Return the line of a pair."""
    count = Counter(each.kind for each in members)
    kinds = ", ".join(f"{count[kind]} {kind}" for kind in KINDS if count[kind])
    return f"{pair.source:>17} -> {pair.target:<17}{len(members):5}  {kinds}"


def main(words: Sequence[str]) -> int:
    """Print the arrows; return 1 on a text that does not resolve, or a text by which the spine names an addition."""
    parser = argparse.ArgumentParser(prog="tests.arrows", description=__doc__.partition("\n")[0])
    parser.add_argument("--places", action="store_true", help="the line of each import and text, too")
    places = parser.parse_args(words).places
    of_layers = layers()
    found: defaultdict[Pair, list[Arrow]] = defaultdict(list)
    broken, named = [], []
    for arrow in arrows():
        pair = Pair(folder(module_of(arrow.file), of_layers), folder(arrow.target, of_layers))
        if pair.source != pair.target:
            found[pair].append(arrow)
        if arrow.kind == "text" and not resolves(arrow.target):
            broken.append(arrow)
        elif arrow.kind == "text" and pair.target in additions() and in_spine(pair.source, of_layers):
            named.append(arrow)
    print(f"arrows between folders: {len(found)} pairs, {sum(map(len, found.values()))} arrows")
    for pair, members in sorted(found.items()):
        print(told(pair, members))
        for each in members if places else ():
            print(f"{'':24}{each.file}:{each.line}: {each.kind} {each.target}")
    print(f"\ntexts that do not resolve: {len(broken)}")
    for each in broken:
        print(f"  {each.file}:{each.line}: {each.target!r}")
    print(f"\nadditions that the spine names: {len(named)}")
    for each in named:
        print(f"  {each.file}:{each.line}: {each.target}")
    return 1 if broken or named else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
