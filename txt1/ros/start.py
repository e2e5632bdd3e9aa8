"""Starts a node under another Python: only modules of this package that need just the standard library are imported.

The package comes last in the other Python's search path, and after it the folder of the node's own package, which is
the first word.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    here = Path(__file__).resolve().parent
    sys.path[:] = [place for place in sys.path if Path(place).resolve() != here]
    sys.path.append(str(here.parents[1]))
    sys.path.append(sys.argv[1])
    from txt1.sidecar import main

    main(*sys.argv[2:])
