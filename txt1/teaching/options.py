"""The option for driving by a policy: ``txt1 run --source FILE.onnx``."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.teaching.policy import Policy

SUFFIX: Final = ".onnx"


def asked(arguments: Namespace, config: Config) -> Policy | None:
    """Return the policy that --source names; None if it names no policy.

    Raises ConfigError: there is no such file; PolicyError, MissingExtra.
    """
    source = getattr(arguments, "source", None)
    if source is None or not source.endswith(SUFFIX):
        return None
    if not Path(source).exists():
        raise ConfigError(f"--source: there is no file '{source}'; check the name")
    from txt1.commands import need
    from txt1.teaching.policy import load

    need("driving by a policy", "teach", "onnxruntime")
    arguments.source = None
    return load(Path(source))


OPTIONS: Final = Options("taught policies", {}, asked)
