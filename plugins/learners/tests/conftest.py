"""Without the plug-in its tests are left out; `make test` installs it."""

from importlib.util import find_spec

import tests.conftest  # noqa: F401 - random tests repeat here, too

collect_ignore_glob = [] if find_spec("txt1_learners") else ["test_*.py"]
