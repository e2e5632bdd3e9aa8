"""A process beside the loop: what it is sent, what it may ask for, and that nothing it does delays the loop."""

from __future__ import annotations

import asyncio
import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.patience import LIMIT, S, until
from txt1.sidecar import MESSAGES, READ_PAUSE, START_WORK, TELEMETRY_PERIOD, Request, Restart, Sidecar, stop_in


@pytest.fixture(autouse=True)
def time_to_begin_and_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of low priority may be slow to do so."""
    monkeypatch.setattr("txt1.sidecar.START", LIMIT)
    monkeypatch.setattr("txt1.sidecar.END_PATIENCE", LIMIT)


@pytest.fixture
def no_time_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("txt1.sidecar.END_PATIENCE", 0.1)


class Owner:
    """Whoever started the process: writes down what it asks for."""

    def __init__(self, *lines: dict[str, Any]) -> None:
        self.lines = list(lines)
        self.requests: list[Request] = []
        self.told: list[str] = []
        self.lost = 0

    def telemetry(self) -> bytes | None:
        return json.dumps(self.lines.pop(0)).encode() + b"\n" if self.lines else None

    def request(self, request: Request) -> None:
        if request.name:
            self.requests.append(request)

    def of(self, name: str) -> list[Request]:
        return [request for request in self.requests if request.name == name]

    def gone(self) -> None:
        self.lost += 1

    def beside(self, target: str, **more: Any) -> Sidecar:
        where = f"beside_targets:{target}"
        return Sidecar(where, self.telemetry, self.request, tell=self.told.append, lost=self.gone, **more)


async def test_telemetry_goes_in_requests_come_out_and_the_process_ends_by_itself() -> None:
    owner = Owner({"x": 1.5}, {"end": True})
    async with owner.beside("echo", options={"rate": 10}) as beside:
        assert await asyncio.wait_for(beside.ended(), LIMIT) == "ended"
    began, first, second = owner.requests
    assert (began.name, began.fields) == ("began", {"rate": 10})
    assert (first.fields, second.fields) == ({"telemetry": {"x": 1.5}}, {"telemetry": {"end": True}})
    assert 0.0 <= began.age < LIMIT
    assert beside.returncode == 0
    assert beside.counts["malformed"] == beside.counts["dropped"] == 0


async def test_leaving_the_block_ends_the_process() -> None:
    owner = Owner()
    async with owner.beside("echo") as beside:
        await until(lambda: owner.requests)
        pid = beside.pid
        assert pid is not None
    assert (beside.returncode, beside.pid) == (0, None)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.usefixtures("no_time_to_end")
async def test_a_process_that_hangs_is_killed_when_the_block_is_left() -> None:
    owner = Owner()
    async with owner.beside("hang") as beside:
        await until(lambda: owner.requests)
    assert beside.returncode == -signal.SIGKILL


async def test_one_that_fails_is_started_again_so_often_and_no_more() -> None:
    owner = Owner()
    async with owner.beside("fail", restart=Restart(limit=2, pause=0.02)) as beside:
        assert await asyncio.wait_for(beside.ended(), LIMIT) == "failed"
    assert len(owner.of("began")) == owner.lost == 3
    assert beside.counts["restarts"] == 2
    assert owner.told == [
        "ended with 3 and is started again in 0.02 s",
        "ended with 3 and is not started again",
    ]


@pytest.mark.long
async def test_one_that_fails_is_started_again_for_ever_after_pauses_that_grow_to_a_limit() -> None:
    owner = Owner()
    forever = Restart(limit=math.inf, pause=0.01, longest=0.04)
    troubles: list[str] = []
    async with owner.beside("fail", restart=forever) as beside:
        while beside.counts["restarts"] < 12:
            await until(lambda: beside.trouble and beside.counts["restarts"] > len(troubles))
            troubles.append(beside.trouble)
    pauses = [float(text.split(" in ")[1].removesuffix(" s")) for text in troubles]
    assert [text.partition("(")[2] for text in owner.told] == ["", "10 times so far)"], "one line, then a count"
    # a busy machine may let it live for longer than the longest pause, and the pauses begin anew
    assert pauses[0] == 0.01 and max(pauses) <= 0.04 and set(pauses) <= {0.01, 0.02, 0.04}


async def test_one_that_is_at_work_again_is_no_trouble() -> None:
    owner = Owner()
    async with owner.beside("beat_then_fail", restart=Restart(limit=math.inf, pause=0.01, longest=0.01)) as beside:
        await until(lambda: beside.trouble == "ended with 3 and is started again in 0.01 s")
        await until(lambda: not beside.trouble)


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], list[float]]:
    """Gives the starting process so many s of processor time between two looks; returns all that it has used."""

    def give(each: float) -> list[float]:
        used: list[float] = []

        def process_time(process: int) -> float:
            used.append(used[-1] + each if used else 0.0)
            return used[-1]

        monkeypatch.setattr("txt1.sidecar.process_time", process_time)
        return used

    monkeypatch.setattr("txt1.sidecar.START_LOOK", 0.0)
    return give


async def test_one_that_starts_slowly_is_not_ended(
    work: Callable[[float], list[float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("txt1.sidecar.START", 0.5)
    monkeypatch.setattr("txt1.sidecar.START_SLOW", 0.0)
    used, owner = work(START_WORK), Owner()
    forever = Restart(limit=math.inf, pause=0.01)
    async with owner.beside("late", restart=forever, silence=0.0) as beside:
        serving = asyncio.ensure_future(serve(beside))
        await until(lambda: len(used) > 60)
        beside.silence = None
        owner.lines.append({})
        await until(lambda: owner.of("began"))
        serving.cancel()
    assert owner.told[0] == "is still starting: this computer is busy"
    assert beside.counts["restarts"] == 0


@pytest.mark.parametrize("each", [0.0, 0.1], ids=["stands still", "works in vain"])
async def test_one_that_hangs_as_it_starts_is_ended_and_has_more_time_then(
    each: float, work: Callable[[float], list[float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("txt1.sidecar.START", 0.25)
    work(each)
    owner, lives = Owner(), []
    forever = Restart(limit=2, pause=0.001)
    async with owner.beside("late", restart=forever, silence=LIMIT) as beside:
        serving = asyncio.ensure_future(serve(beside))
        for life in (1, 2):
            used, began = work(each), time.monotonic()
            await until(lambda number=life: beside.counts["restarts"] == number)
            lives.append(used[-1] if each else time.monotonic() - began)
        serving.cancel()
    first, second = lives
    assert first > 0.25 and second > 0.5
    assert owner.told[0].startswith("did not start within ")


async def test_its_priority_is_ordinary_until_it_is_ready() -> None:
    owner = Owner()
    async with owner.beside("late", niceness=7) as beside:
        assert beside.pid is not None
        assert os.getpriority(os.PRIO_PROCESS, beside.pid) == os.getpriority(os.PRIO_PROCESS, 0)
        serving = asyncio.ensure_future(serve(beside))
        owner.lines.append({})
        await until(lambda: owner.of("began"))
        threads = [int(each.name) for each in Path(f"/proc/{beside.pid}/task").glob("*")] or [beside.pid]
        niceness = max(7, os.getpriority(os.PRIO_PROCESS, 0))  # a process that is nice already becomes no less so
        assert {os.getpriority(os.PRIO_PROCESS, each) for each in threads} == {niceness}
        assert len(threads) == 2 or sys.platform != "linux"
        serving.cancel()


async def test_one_that_ends_by_itself_says_so() -> None:
    owner = Owner({"end": True})
    async with owner.beside("echo") as beside:
        assert await asyncio.wait_for(beside.ended(), LIMIT) == "ended"
    assert owner.told == ["has ended"]


async def test_an_error_of_the_owner_is_a_failure_of_one_that_is_started_again() -> None:
    told: list[str] = []

    def bug(request: Request) -> None:
        raise ZeroDivisionError("bug")

    forever = Restart(limit=math.inf, pause=0.01)
    async with Sidecar("beside_targets:echo", lambda: None, bug, restart=forever, tell=told.append) as beside:
        await until(lambda: beside.counts["restarts"] > 1)
    assert told[0] == "is at fault here: ZeroDivisionError: bug and is started again in 0.01 s"


async def test_leaving_the_block_does_not_wait_for_a_restart() -> None:
    owner = Owner()
    async with asyncio.timeout(LIMIT), owner.beside("fail", restart=Restart(limit=1, pause=1000.0)) as beside:
        await until(lambda: owner.told)
    assert beside.pid is None


async def test_silence_is_told_and_ends_a_hung_process() -> None:
    owner = Owner()
    async with owner.beside("echo", silence=1.0 * S) as beside:
        await until(lambda: owner.requests)
        assert beside.pid is not None
        os.kill(beside.pid, signal.SIGSTOP)
        serving = asyncio.ensure_future(serve(beside))
        assert await asyncio.wait_for(beside.ended(), LIMIT) == "failed"
        serving.cancel()
    assert owner.told[0].startswith("is silent: ") and "start txt1 again" in owner.told[0], "cause and remedy"
    assert owner.told[1].startswith("was silent for")
    assert (beside.returncode, owner.lost) == (-signal.SIGKILL, 1)


class RealTicks:
    """Ticks of the real clock, for a task without a scheduler."""

    def __aiter__(self) -> RealTicks:
        return self

    async def __anext__(self) -> float:
        await asyncio.sleep(TELEMETRY_PERIOD)
        return 0.0


async def serve(beside: Sidecar) -> None:
    await beside.serve(RealTicks())  # type: ignore[arg-type]


class Given:
    """Ticks at times of the test's choice."""

    def __init__(self) -> None:
        self.times: asyncio.Queue[float] = asyncio.Queue()

    def __aiter__(self) -> Given:
        return self

    async def __anext__(self) -> float:
        return await self.times.get()


async def test_a_prompt_one_is_read_as_it_writes_but_not_just_before_a_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    period = 10.0 * LIMIT  # its process may need long to start, and no tick is due meanwhile
    monkeypatch.setattr("txt1.sidecar.TELEMETRY_PERIOD", period)
    owner, ticks = Owner(), Given()
    async with owner.beside("drive", prompt=True) as beside:
        serving = asyncio.ensure_future(beside.serve(ticks))  # type: ignore[arg-type]
        ticks.times.put_nowait(0.0)
        await until(lambda: len(owner.requests) > 2)
        ticks.times.put_nowait(period - 0.5 * READ_PAUSE)
        await until(ticks.times.empty)
        await asyncio.sleep(0.1 * S)
        read = len(owner.requests)
        await asyncio.sleep(0.2 * S)
        assert len(owner.requests) == read
        ticks.times.put_nowait(period)
        await until(lambda: len(owner.requests) > read + 2)
        serving.cancel()


@pytest.mark.parametrize("prompt", [False, True])
async def test_a_flood_is_read_a_few_messages_at_a_time_and_the_rest_is_counted(prompt: bool) -> None:
    owner = Owner()
    async with owner.beside("flood", prompt=prompt) as beside:
        serving = asyncio.ensure_future(serve(beside))
        await until(lambda: beside.counts["dropped"])
        taken, began = beside.counts["taken"], asyncio.get_running_loop().time()
        await asyncio.sleep(0.3)
        turns = (asyncio.get_running_loop().time() - began) / TELEMETRY_PERIOD + 2
        assert beside.counts["taken"] - taken <= turns * MESSAGES
        await until(lambda: beside.counts["dropped"] > 1000)
        serving.cancel()
    assert min(request.age for request in owner.of("drive")[-5:]) < 0.5, "the newest are taken, not the oldest"


async def test_an_emergency_stop_is_never_dropped() -> None:
    owner = Owner()
    async with owner.beside("flood_with_a_stop") as beside:
        serving = asyncio.ensure_future(serve(beside))
        await until(lambda: owner.of("stop"))
        serving.cancel()


async def test_the_word_stop_in_other_messages_of_a_flood_stops_nothing() -> None:
    owner = Owner()
    async with owner.beside("flood_with_the_word") as beside:
        serving = asyncio.ensure_future(serve(beside))
        await until(lambda: beside.counts["dropped"] > 1000)
        serving.cancel()
    assert owner.of("began") or owner.of("drive")
    assert not owner.of("stop") and not owner.of("tell")


async def test_a_stop_that_a_node_calls_for_is_never_dropped_and_obeyed_once() -> None:
    owner = Owner()
    async with owner.beside("flood_with_a_call") as beside:
        serving = asyncio.ensure_future(serve(beside))
        await until(lambda: owner.of("call"))
        serving.cancel()
    assert [call.fields for call in owner.of("call")] == [{"id": 7, "name": "stop", "fields": {}}]


async def test_a_stop_of_a_time_that_cannot_be_is_obeyed() -> None:
    owner = Owner()
    async with owner.beside("stop_at_no_time") as beside:
        await until(lambda: owner.of("stop"))
    assert beside.counts["malformed"] == 1


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just("stop"),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@given(st.binary(max_size=60) | JSON.map(lambda value: json.dumps(value).encode()))
def test_no_other_message_is_a_stop(line: bytes) -> None:
    assert stop_in(line) is None


@given(st.dictionaries(st.text(max_size=8), JSON, max_size=4))
def test_a_stop_is_one_whatever_else_it_says(more: dict[str, Any]) -> None:
    stop = stop_in(json.dumps({**more, "request": "stop"}).encode())
    assert stop is not None and stop.name == "stop"


async def test_a_message_without_end_ends_the_process() -> None:
    owner = Owner()
    async with owner.beside("endless") as beside:
        assert await asyncio.wait_for(beside.ended(), LIMIT) == "failed"
    assert "more than 32768 bytes" in owner.told[-1]
    assert not owner.requests


async def test_malformed_messages_are_counted_and_harm_nobody() -> None:
    owner = Owner()
    async with owner.beside("garbage") as beside:
        await until(lambda: owner.of("proper"))
    assert beside.counts["malformed"] == 8
    assert len(owner.requests) == 1


@pytest.mark.usefixtures("no_time_to_end")
async def test_never_more_than_one_piece_of_telemetry_is_under_way() -> None:
    owner = Owner(*({"n": n} for n in range(100)))
    async with owner.beside("hang") as beside:
        await until(lambda: owner.requests)
        serving = asyncio.ensure_future(serve(beside))
        await asyncio.sleep(5 * TELEMETRY_PERIOD)
        serving.cancel()
    assert len(owner.lines) == 99


async def test_an_error_of_the_owner_is_handed_on() -> None:
    def bug(request: Request) -> None:
        raise ZeroDivisionError("bug")

    async with Sidecar("beside_targets:echo", lambda: None, bug) as beside:
        with pytest.raises(ZeroDivisionError, match="bug"):
            await asyncio.wait_for(beside.ended(), LIMIT)


async def test_a_loop_that_cancels_everything_leaves_no_process_behind() -> None:
    owner = Owner()
    made: list[Sidecar] = []

    async def work() -> None:
        async with owner.beside("echo") as beside:
            made.append(beside)
            await asyncio.sleep(3600.0)

    working = asyncio.ensure_future(work())
    await until(lambda: owner.requests)
    for task in asyncio.all_tasks() - {asyncio.current_task()}:
        task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await working
    assert (made[0].returncode, made[0].pid) == (0, None)
