"""Begins a node under another Python: of this package only modules are imported that need the standard library alone.

The package is found behind everything that the other Python has of its own.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    here = Path(__file__).resolve().parent
    sys.path[:] = [place for place in sys.path if Path(place).resolve() != here]
    sys.path.append(str(here.parents[1]))
    from txt1.sidecar import main

    main(*sys.argv[1:])
