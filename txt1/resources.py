"""Files that come with the package and are no code. They are beside it in the source tree, and inside it in a wheel."""

from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).parent


def resource(folder: str) -> Path:
    """Return the path of a folder, given by its path in the source tree; setup.py lists the folders in a wheel."""
    packed = PACKAGE / "data" / folder
    return packed if packed.exists() else PACKAGE.parent / folder
