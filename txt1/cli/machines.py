"""Trials on many processors: processes of this computer, or the workers of a Dask cluster.

A trial is a command of txt1 as words, and what comes back is JSON: nothing of ours is pickled. Dask itself pickles what
it sends about, so beyond loopback it is asked for TLS. A trial whose process is killed is done again.
"""

import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import redirect_stdout, suppress
from importlib import import_module
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

from txt1.cli import SIGNALS, execute
from txt1.errors import ConfigError, MissingExtra, Txt1Error
from txt1.learning.provenance import code_hash

OUT: Final = "{out}"  # among a trial's words: a folder of its own, whose metrics.json is its result
AGAIN: Final = 5  # times that a pool is made anew because one of its processes was killed
LOOPBACK: Final = ("127.0.0.1", "localhost", "[::1]")


class Cluster(NamedTuple):
    """A Dask cluster: the scheduler's address, and the files of its TLS."""

    address: str
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None


def trial(words: Sequence[str]) -> str:
    """Do a command and return its exit code and what it printed or measured, as JSON."""
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()) as printed:
        out = Path(folder, "out")
        code = execute([word.replace(OUT, str(out)) for word in words])
        measured = out / "metrics.json"
        text = measured.read_text(encoding="utf-8") if measured.exists() else printed.getvalue()
    try:
        result = json.loads(text)
    except ValueError:
        result = None
    return json.dumps({"code": code, "result": result})


def on_processes(
    trials: Mapping[int, Sequence[str]], jobs: int, ended: Callable[[], bool]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Each trial's number and result as it comes, from processes; Txt1Error: they are killed again and again."""
    left = dict(trials)
    for _ in range(AGAIN):
        with suppress(BrokenProcessPool):
            yield from _pooled(left, jobs, ended)
            return
    raise Txt1Error("processes that do trials are killed again and again, perhaps for lack of memory; use fewer --jobs")


def _pooled(
    left: dict[int, Sequence[str]], jobs: int, ended: Callable[[], bool]
) -> Iterator[tuple[int, dict[str, Any]]]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, _deaf) as pool:
        futures = {pool.submit(trial, list(words)): number for number, words in left.items()}
        try:
            while futures:
                done, _ = wait(futures, timeout=0.1, return_when=FIRST_COMPLETED)
                for future in done:
                    result = json.loads(future.result())
                    number = futures.pop(future)
                    del left[number]
                    yield number, result
                if ended():
                    return
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _deaf() -> None:
    """Ctrl-C goes to the whole foreground group; what is begun is finished, and the parent decides."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)


def on_dask(
    trials: Mapping[int, Sequence[str]], cluster: Cluster, ended: Callable[[], bool]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Each trial's number and result as it comes, from a Dask cluster.

    Raises ConfigError: the cluster is not there, unsafe, or has other code than ours; MissingExtra.
    """
    try:
        dask: Any = import_module("distributed")
    except ImportError:
        raise MissingExtra("--dask", "dask") from None
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
        futures = {client.submit(trial, list(words), pure=False): number for number, words in trials.items()}
        for future in dask.as_completed(futures):
            yield futures[future], json.loads(future.result())
            if ended():
                client.cancel(list(futures))
                return


def processors() -> int:
    """How many processors there are for us."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
