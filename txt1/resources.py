"""Files that come with the package but are no part of its code: beside it in the source tree, inside it in a wheel."""

from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).parent


def resource(folder: str) -> Path:
    """Where such a folder is, by its path in the source tree; setup.py names those that a wheel has."""
    packed = PACKAGE / "data" / folder
    return packed if packed.exists() else PACKAGE.parent / folder
