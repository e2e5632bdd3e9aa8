"""Trials on many processors: processes of this computer, or the workers of a Dask cluster.

A trial is a function of a module, from JSON values to JSON values. The values travel as text; txt1 pickles nothing.
Dask itself pickles its messages, so beyond loopback TLS is required. A trial whose process or worker is killed is done
again.

Processes are spawned and ignore signals: a Ctrl-C goes to all of a terminal's processes, and only their parent acts on
it. The parent then sets an event. A trial that checks it (`stopped`) ends by itself; any other trial is killed after
`END_TIME`. A process whose parent is gone ends at once.
"""

import argparse
import json
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from txt1.commands import SIGNALS, count, existing, takes
from txt1.errors import ConfigError, MissingExtra, Txt1Error
from txt1.kernel.processors import processors
from txt1.trials.provenance import code_hash

# number of times that a pool is made again because a process of it was killed
POOLS_MADE_AGAIN: Final = 5
# s of real time between two checks whether it has to end
POLL: Final = 0.1
# s that trials have to notice the end; others are killed, and their results are lost
END_TIME: Final = 1.0
LOOPBACK: Final = ("127.0.0.1", "localhost", "[::1]")
OPTIONS: Final = {
    "--jobs": takes("N", "number of processes; in simulation one for each processor by default", count),
    "--dask": takes("ADDRESS", "on a Dask cluster: tcp://127.0.0.1:8786, or tls://HOST:PORT"),
    "--dask-ca": takes("FILE", "certificate of the authority", existing),
    "--dask-cert": takes("FILE", "certificate of this program", existing),
    "--dask-key": takes("FILE", "private key of --dask-cert", existing),
}

K = TypeVar("K")
Work = Callable[[Any], Any]
# set when the process has to end
Ended = Callable[[], bool]


class Cluster(NamedTuple):
    """A Dask cluster: the scheduler's address, and the files of its TLS."""

    address: str
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None


class Workers(NamedTuple):
    """The place of the trials: a number of processes, or a cluster."""

    jobs: int = 1
    cluster: Cluster | None = None

    @property
    def many(self) -> bool:
        """Whether trials are done anywhere but in this process."""
        return self.jobs > 1 or self.cluster is not None

    def each(self, work: Work, trials: Mapping[K, Any], ended: Ended) -> Iterator[tuple[K, Any]]:
        """Yield (key, result) as trials finish. Once `ended()` is true, unfinished trials are dropped.

        Raises the error of a trial; Txt1Error: processes are killed again and again; ConfigError: the cluster is
        missing, unsafe, or has other code than this process; MissingExtra.
        """
        texts = {key: json.dumps(told) for key, told in trials.items()}
        if self.cluster is None:
            return on_processes(work, texts, self.jobs, ended)
        return on_dask(work, texts, self.cluster, ended)


def workers_of(arguments: argparse.Namespace, *, alone: bool = False) -> Workers:
    """Return the workers chosen by `OPTIONS`; a robot that is `alone` must be in this process."""
    if arguments.dask is None:
        return Workers(1 if alone else arguments.jobs or processors())
    if alone:
        raise ConfigError("--dask: this robot is not simulated as fast as possible, so it cannot be in many places")
    return Workers(1, Cluster(arguments.dask, arguments.dask_ca, arguments.dask_cert, arguments.dask_key))


def stopped() -> bool:
    """Return whether the result of this process's present trial is no longer needed."""
    return _stop is not None and bool(_stop.is_set())


_stop: Any = None


def on_processes(work: Work, trials: Mapping[K, str], jobs: int, ended: Ended) -> Iterator[tuple[K, Any]]:
    """Yield as `Workers.each`; the arguments of the trials are text."""
    left = dict(trials)
    for _ in range(POOLS_MADE_AGAIN):
        with suppress(BrokenProcessPool):
            yield from _pooled(work, left, jobs, ended)
            return
    raise Txt1Error("processes that do trials are killed again and again, perhaps for lack of memory; use fewer --jobs")


def _pooled(work: Work, left: dict[K, str], jobs: int, ended: Ended) -> Iterator[tuple[K, Any]]:
    context = multiprocessing.get_context("spawn")
    # here the process starts that cleans up after the others
    with _deaf():
        stop = context.Event()
    pool = ProcessPoolExecutor(min(jobs, max(1, len(left))), context, _enter, (stop,))
    futures: dict[Any, K] = {}
    try:
        with _deaf():
            futures |= {pool.submit(_done, work, text): key for key, text in left.items()}
        for key, result in _as_they_come(futures, ended):
            del left[key]
            yield key, result
    except BrokenProcessPool:
        _kill()
        raise
    finally:
        stop.set()
        stuck = ended() and wait([each for each in futures if each.running()], END_TIME).not_done
        if stuck:
            _kill()
        pool.shutdown(wait=True, cancel_futures=not stuck)


def _kill() -> None:
    """Kill the processes of a pool; the pool's own way is a signal, which they ignore."""
    for child in multiprocessing.active_children():
        child.kill()


def _done(work: Work, text: str) -> str:
    return json.dumps(work(json.loads(text)))


def _as_they_come(futures: dict[Any, K], ended: Ended) -> Iterator[tuple[K, Any]]:
    # a signal at the end of its timeout lets SimpleQueue of Python 3.11 wait for ever
    done: queue.Queue[Any] = queue.Queue()
    for future in list(futures):
        future.add_done_callback(done.put)
    while futures and not ended():
        with suppress(queue.Empty):
            future = done.get(timeout=POLL)
            yield futures.pop(future), json.loads(future.result())


@contextmanager
def _deaf() -> Iterator[None]:
    """Let processes that are started within the block ignore signals, which are their parent's business."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _enter(stop: Any) -> None:
    """Prepare a process for work; it ends with its parent."""
    global _stop
    _stop = stop

    def end_with_parent() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def on_dask(work: Work, trials: Mapping[K, str], cluster: Cluster, ended: Ended) -> Iterator[tuple[K, Any]]:
    """Yield as `Workers.each`; the arguments of the trials are text."""
    try:
        dask: Any = import_module("distributed")
    except ImportError:
        raise MissingExtra("--dask", "dask", "learners") from None
    host = cluster.address.partition("://")[2].rpartition(":")[0]
    if not cluster.address.startswith("tls://") and host not in LOOPBACK:
        raise ConfigError(f"--dask {cluster.address}: Dask pickles, so beyond loopback over TLS only: tls://HOST:PORT")
    security: Any = None
    if cluster.address.startswith("tls://"):
        paths = (cluster.ca, cluster.certificate, cluster.key)
        if None in paths:
            raise ConfigError("--dask tls://...: add --dask-ca, --dask-cert and --dask-key")
        ca, certificate, key = map(str, paths)
        files = {"tls_ca_file": ca, "tls_client_cert": certificate, "tls_client_key": key}
        security = dask.Security(**files, require_encryption=True)
    try:
        client = dask.Client(cluster.address, security=security, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"--dask {cluster.address}: no cluster there: {error}") from None
    with client:
        others = {worker for worker, code in client.run(code_hash).items() if code != code_hash()}
        if others:
            raise ConfigError(f"--dask: other code than here on {', '.join(sorted(others))}; install the same version")
        if any(threads > 1 for threads in client.nthreads().values()):
            raise ConfigError("--dask: a trial needs a process of its own; start the workers with --nthreads 1")
        futures = {client.submit(_done, work, text, pure=False): key for key, text in trials.items()}
        left = list(futures)
        try:
            yield from _as_they_come(futures, ended)
        finally:
            client.cancel(left)
