"""``python -m torture NAME [OPTIONS]``: campaign, mutation, processes, fuzz or soak; NAME --help tells more."""

import sys
from importlib import import_module
from typing import Final

NAMES: Final = ("campaign", "mutation", "processes", "fuzz", "soak")


def main() -> int:
    """Run one of them."""
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        print(__doc__, file=sys.stderr)
        return 0 if sys.argv[1:] in (["-h"], ["--help"]) else 2
    result: int = import_module(f"torture.{sys.argv[1]}").main(sys.argv[2:])
    return result


if __name__ == "__main__":
    sys.exit(main())
