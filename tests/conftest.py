"""What holds for all tests: random ones repeat."""

from __future__ import annotations

import hypothesis

# No example has a deadline, and none is drawn too slowly, as both say how busy the machine is. A change is judged by
# the same examples each time, so what fails is the change's; `make test-long` looks for others.
BUSY = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("same", **BUSY, derandomize=True)
hypothesis.settings.register_profile("others", **BUSY, print_blob=True)
hypothesis.settings.load_profile("same")
