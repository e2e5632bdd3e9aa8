"""The options for driving by a policy: ``txt1 run --source FILE.onnx``, and ``--card`` for one from elsewhere."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.commands import existing, takes
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.teaching.foreign_policy import ForeignPolicy
    from txt1.teaching.policy import Policy

SUFFIX: Final = ".onnx"


def asked(arguments: Namespace, config: Config) -> Policy | ForeignPolicy | None:
    """Return the policy that --source names; None if it names no policy.

    Raises ConfigError: there is no such file; PolicyError, MissingExtra.
    """
    source = getattr(arguments, "source", None)
    if source is None or not source.endswith(SUFFIX):
        if source is not None and Path(source).suffix and Path(source).is_file():
            raise ConfigError(f"--source {source}: a file that drives is a policy, FILE.onnx, as txt1 teach makes it")
        if arguments.card is not None:
            raise ConfigError("--card: it describes a policy; add --source FILE.onnx")
        return None
    if not Path(source).exists():
        raise ConfigError(f"--source: there is no file '{source}'; check the name")
    from txt1.commands import need
    from txt1.teaching import foreign_policy, policy

    need("driving by a policy", "teach", "onnxruntime")
    arguments.source = None
    if arguments.card is not None:
        return foreign_policy.load(Path(source), arguments.card, config)
    return policy.load(Path(source))


OPTIONS: Final = Options(
    "taught policies",
    {"--card": takes("FILE", "with --source FILE.onnx: a policy from elsewhere, and what it sees and says", existing)},
    asked,
)
