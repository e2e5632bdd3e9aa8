"""What a test has installed, the next one does not know of."""

from collections.abc import Iterator

import pytest

from txt1 import additions
from txt1.learning import modelled_settings
from txt1.ui import screens


@pytest.fixture(autouse=True)
def nothing_is_found_yet() -> Iterator[None]:
    screens.installed.cache_clear()
    additions.strangers.cache_clear()
    modelled_settings.usual_values.cache_clear()
    yield
    screens.installed.cache_clear()
    additions.strangers.cache_clear()
    modelled_settings.usual_values.cache_clear()
