"""Real-time scheduling: for the loop's thread alone, told as it was granted, and given back whatever happens."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from txt1.kernel.realtime import Granted, grantable, realtime

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has these calls")

Scheduling = tuple[int, int, frozenset[int]]
granted = pytest.mark.skipif(
    sys.platform != "linux" or grantable().fifo is None, reason="SCHED_FIFO is not granted to this user"
)


def scheduling(thread: int = 0) -> Scheduling:
    return (
        os.sched_getscheduler(thread),
        os.sched_getparam(thread).sched_priority,
        frozenset(os.sched_getaffinity(thread)),
    )


@granted
def test_the_thread_of_the_loop_alone_is_put_before_all_others() -> None:
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    assert other.native_id is not None
    niceness = os.getpriority(os.PRIO_PROCESS, other.native_id)
    before, other_before = scheduling(), scheduling(other.native_id)
    try:
        with realtime() as rights:
            policy, priority, processors = scheduling()
            if rights.granted.fifo is None:
                pytest.skip("a control group has no share of real time")
            assert policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
            assert priority == rights.granted.fifo
            others = scheduling(other.native_id)
            assert others[0] & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
            own = rights.granted.processor
            if own is not None:
                assert processors == {own}
                assert own not in others[2]
            child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
            rights.sweep()
            assert os.sched_getscheduler(child.pid) == os.SCHED_OTHER
            assert own is None or own not in os.sched_getaffinity(child.pid)
            child.communicate(b"\n")
        assert scheduling() == before
        assert scheduling(other.native_id)[1:] == other_before[1:]
        assert os.getpriority(os.PRIO_PROCESS, other.native_id) == niceness
    finally:
        done.set()
        other.join()


@granted
def test_a_thread_of_ours_is_not_kept_from_giving_the_interpreter_back() -> None:
    """The loop waits for the interpreter while another program keeps its holder from the processor."""
    done = threading.Event()
    ours = threading.Thread(target=done.wait, name="txt1 recorder_0")
    ours.start()
    assert ours.native_id is not None
    try:
        with realtime() as rights:
            if rights.granted.fifo is None or rights.granted.processor is None:
                pytest.skip("a control group has no share of real time, or there is one processor only")
            policy, priority, processors = scheduling(ours.native_id)
            assert policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
            assert 0 < priority < rights.granted.fifo
            assert rights.granted.processor not in processors
        assert scheduling(ours.native_id)[0] & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
    finally:
        done.set()
        ours.join()


@granted
def test_everything_is_given_back_after_an_error() -> None:
    before = scheduling()
    with pytest.raises(RuntimeError, match="the robot failed"), realtime():
        raise RuntimeError("the robot failed")
    assert scheduling() == before
    with open("/proc/self/status", encoding="ascii") as status:
        assert "VmLck:\t       0 kB\n" in status.readlines()


def test_a_refusal_is_told_and_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    before = scheduling()
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with realtime() as rights:
        assert rights.granted.fifo is None
        assert rights.granted.missing
    assert scheduling() == before


def test_the_answer_is_one_line() -> None:
    assert str(Granted(50, True, 3)) == "SCHED_FIFO 50, memory locked, processor 3 of its own"
    assert str(Granted()) == "no SCHED_FIFO, memory not locked, no processor of its own"
