"""Lets nobody wait: every test of a link fails that blocks the loop."""

from __future__ import annotations

import termios
from collections.abc import Iterator
from importlib.util import find_spec

import pytest
from blockbuster import blockbuster_ctx


@pytest.fixture(autouse=True)
def nothing_blocks() -> Iterator[None]:
    """A call that blocks the loop fails, and so does one that would wait until a device has taken everything."""

    def drain(fd: int) -> None:
        raise AssertionError("tcdrain waits for ever when nobody reads")

    with pytest.MonkeyPatch.context() as patched, blockbuster_ctx("txt1") as blockbuster:
        patched.setattr(termios, "tcdrain", drain)
        for name in ("os.path.islink", "os.readlink", "os.unlink", "os.symlink"):  # of listen_pty, and its close
            blockbuster.functions[name].can_block_in("txt1/link/pty.py", {"listen_pty", "_let_go"})
        yield


@pytest.fixture(params=["pyserial-asyncio", "serialx"])
def transport(request: pytest.FixtureRequest) -> str:
    """A library that serves serial devices."""
    if request.param == "serialx" and find_spec("serialx") is None:
        pytest.skip("serialx is not installed")
    return str(request.param)
