"""Mutants of a module: its source with one small mistake each, made in the syntax tree.

A comparison is turned or loosened, an operator exchanged for its neighbour, a condition negated, a number raised by
one, a truth value flipped, a statement left out. Left alone are annotations, texts, and the words of raised errors.
"""

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Final, NamedTuple

OTHER_COMPARISON: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
OTHER_OPERATOR: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}


class Change(NamedTuple):
    """One mistake: what stands in a field of a node of the tree, and what is to stand there."""

    parent: ast.AST
    field: str
    index: int | None  # in the field's list
    old: ast.AST
    new: ast.AST
    owner: str  # the outermost function around it, such as "Gate.arm"; "" for what runs when it is imported
    statement: ast.stmt | None  # around it; None when it is one itself
    lines: tuple[int, int]  # of the statement, or of a compound statement's head


@dataclass(frozen=True)
class Mutant:
    """A module with one mistake."""

    name: str  # file, function and mistake: the same as long as these are
    file: Path
    owner: str
    lines: tuple[int, int]
    compiled: Callable[[], CodeType]


def mutants(file: Path, root: Path) -> list[Mutant]:
    """All mutants of a source file, named by its path below `root`."""
    tree = ast.parse(file.read_text())
    seen: Counter[str] = Counter()
    made = []
    for change in list(_changes(tree, "", "", None)):
        before, after = ast.unparse(change.old), ast.unparse(change.new)
        context = "" if change.statement is None else f" in `{ast.unparse(change.statement).splitlines()[0]}`"
        name = f"{file.relative_to(root)} {change.owner or '-'}: `{before}` -> `{after}`{context}"
        seen[name] += 1
        if seen[name] > 1:
            name = f"{name} #{seen[name]}"

        def compiled(change: Change = change) -> CodeType:
            _put(change, change.new)
            try:
                return compile(ast.fix_missing_locations(tree), str(file), "exec")
            finally:
                _put(change, change.old)

        made.append(Mutant(name, file, change.owner, change.lines, compiled))
    return made


def _put(change: Change, node: ast.AST) -> None:
    if change.index is None:
        setattr(change.parent, change.field, node)
    else:
        getattr(change.parent, change.field)[change.index] = node


def _changes(node: ast.AST, owner: str, path: str, statement: ast.stmt | None) -> Iterator[Change]:
    """Every change below a node; `path` leads through the classes around it."""
    if isinstance(node, ast.Raise | ast.JoinedStr):
        return
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for index, child in list(enumerate(value)) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
                continue  # a docstring
            if isinstance(child, ast.stmt):
                if owner and _may_be_left_out(child):
                    left_out = ast.copy_location(ast.Pass(), child)
                    yield Change(node, field, index, child, left_out, owner, None, _lines(child))
                if isinstance(child, ast.ClassDef):
                    yield from _changes(child, owner, f"{path}{child.name}.", child)
                elif isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
                    yield from _changes(child.args, owner, path, child)
                    body = ast.Module(child.body, [])
                    yield from _changes(body, owner or f"{path}{child.name}", path, child)
                else:
                    yield from _changes(child, owner, path, child)
            elif isinstance(child, ast.AST):
                if statement is not None:
                    for other in _others(child, field):
                        new = ast.copy_location(other, child)
                        yield Change(node, field, index, child, new, owner, statement, _lines(statement))
                yield from _changes(child, owner, path, statement)


def _may_be_left_out(statement: ast.stmt) -> bool:
    if isinstance(statement, ast.AnnAssign):
        return statement.value is not None
    return isinstance(statement, ast.Expr | ast.Assign | ast.AugAssign | ast.Raise | ast.Continue | ast.Break)


def _lines(statement: ast.stmt) -> tuple[int, int]:
    body = getattr(statement, "body", None)
    if isinstance(body, list) and body and not isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
        return statement.lineno, max(statement.lineno, body[0].lineno - 1)
    return statement.lineno, statement.end_lineno or statement.lineno


def _others(node: ast.AST, field: str) -> Iterator[ast.expr]:
    """What could stand in place of an expression by mistake."""
    match node:
        case ast.Compare(left, ops, comparators):
            for k, operator in enumerate(ops):
                turned = [*ops[:k], OTHER_COMPARISON[type(operator)](), *ops[k + 1 :]]
                yield ast.Compare(left, turned, comparators)
        case ast.BinOp(left, operator, right) if not _is_text(left) and not _is_text(right):
            yield ast.BinOp(left, OTHER_OPERATOR[type(operator)](), right)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield deepcopy(operand)
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
    if field == "test" and not isinstance(node, ast.Compare | ast.UnaryOp | ast.BoolOp | ast.Constant):
        assert isinstance(node, ast.expr)
        yield ast.UnaryOp(ast.Not(), node)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
