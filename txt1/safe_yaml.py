"""YAML from files, variables and the command line: no code, no duplicate keys, and a limit on its size.

A simulated robot without settings does not load the YAML library.
"""

from typing import Any, Final

import yaml

from txt1.errors import ConfigError

# levels of lists and mappings in a value
DEPTH_MAX: Final = 20
# values in a text; an alias counts as all values that it stands for
VALUES_MAX: Final = 100_000


def parse(text: str, origin: str, problem: str = "not a valid value") -> Any:
    """Return a value from text, by YAML's rules: numbers, true/false, null, [lists]."""
    try:
        return read_yaml(text)
    except yaml.YAMLError as error:
        mark, what = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error)
        place = f":{mark.line + 1}:{mark.column + 1}" if mark is not None else ""
        raise ConfigError(f"{origin}{place}: {problem}: {what.splitlines()[0]}") from None


class _Loader(yaml.SafeLoader):
    """YAML's safe loader without duplicate keys: the first value would be lost without a word.

    Aliases of aliases make a few lines stand for more values than a computer has time for, so values are counted first.
    """

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            count, depth = _size(node, {})
            if depth > DEPTH_MAX:
                raise RecursionError
            if count > VALUES_MAX:
                raise yaml.YAMLError(f"stands for more than {VALUES_MAX} values: use fewer aliases")
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        assert isinstance(node, yaml.MappingNode)
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    problem = f"'{key.value}' is there twice: put both in one, or take one out"
                    raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
                seen.add(key.value)
        return node


def read_yaml(text: str) -> Any:
    """Return the value of a text, by YAML's rules; raises yaml.YAMLError, also for a duplicate key."""
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506 - a SafeLoader
    except RecursionError:
        # includes YAML's own errors, and the error of a value that contains itself
        raise yaml.YAMLError(f"nested more than {DEPTH_MAX} deep") from None
    except (ValueError, LookupError, AttributeError) as error:
        # from YAML's constructors, for "!!int x" and the like
        raise yaml.YAMLError(str(error)) from None


def _size(node: yaml.Node, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Return the number of values that a node stands for, and their depth.

    `known` has the results for lists and mappings already counted.
    """
    if isinstance(node, yaml.ScalarNode):
        return 1, 0
    if id(node) not in known:
        inner = node.value if isinstance(node, yaml.SequenceNode) else [each for pair in node.value for each in pair]
        sizes = [_size(each, known) for each in inner]
        known[id(node)] = 1 + sum(count for count, _ in sizes), 1 + max((depth for _, depth in sizes), default=0)
    return known[id(node)]
