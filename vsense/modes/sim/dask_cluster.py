"""A Dask cluster that somebody has started: `dask scheduler`, and `dask worker` on every machine.

Dask, and what only it needs, is imported where a cluster is wanted: it is slow to load.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from vsense.base.errors import CutShort, VsenseError, require
from vsense.base.terminal import Console, Interruption
from vsense.modes.sim import fingerprint
from vsense.modes.sim.engine import Engine, Place

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S = 5.0
"""A scheduler must answer within this time."""


def require_dask() -> None:
    """Raises UsageError where Dask is not installed."""
    require("--on needs", "distributed")


class DaskPlace(Place):
    """A worker of Dask, in the thread that does a job."""

    def name(self) -> str:
        """Its address, as Dask's own pages show it, and its machine."""
        from distributed import get_worker

        return f"{get_worker().address} on {socket.gethostname()}"

    def is_wanted(self) -> bool:
        """Whether the scheduler still wants the job, and the worker is not about to end."""
        from distributed import get_worker
        from distributed.worker import WORKER_ANY_RUNNING

        worker = get_worker()
        if worker.status not in WORKER_ANY_RUNNING:
            return False
        task = worker.state.tasks.get(worker.get_current_task())
        return task is not None and task.state in ("executing", "long-running")


@contextmanager
def connected(address: str, console: Console, interrupted: Interruption) -> Iterator[Engine]:
    """Connects to a scheduler, and looks whether its workers can run what runs here.

    Raises:
        UsageError: Dask is not installed.
        VsenseError: no scheduler answers there, or a worker would give other results.
        CutShort: the user has ended it meanwhile.
    """
    require_dask()
    with interrupted.at_once():
        client = _connect(address)
    try:
        with interrupted.at_once():
            _tell(client, address, console)
        executor = client.get_executor(pure=False)
        yield Engine(f"the Dask cluster {address}", executor, DaskPlace())
    finally:
        client.close(timeout=1)


def _connect(address: str) -> Client:
    import asyncio

    from distributed import Client

    # What becomes of the connection is told in our words.
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        asyncio.run(_greet(address))
        return Client(address, timeout=CONNECT_S, set_as_default=False, name="vsense")
    except CutShort:
        raise
    except Exception as error:  # whatever is there may answer anything
        reason = str(error) or f"silence for {CONNECT_S:g} s"
        raise VsenseError(
            f"--on {address}: no Dask scheduler answers there: {reason};"
            " 'dask scheduler' starts one"
        ) from None


async def _greet(address: str) -> None:
    """Exchanges greetings with a scheduler; Dask's client would wait for a silent one for ever."""
    import asyncio

    from distributed import Security
    from distributed.comm.core import connect

    secured = Security().get_connection_args("client")
    connecting = connect(address, timeout=CONNECT_S, **secured)
    comm = await asyncio.wait_for(connecting, CONNECT_S + 1.0)
    comm.abort()


def _tell(client: Client, address: str, console: Console) -> None:
    """Says how large the cluster is; raises VsenseError where workers do not fit."""
    needs = fingerprint.of_machine()
    answers: dict[str, Any]
    answers = client.run(fingerprint.difference, needs, on_error="return")
    refused = []
    for worker, answer in answers.items():
        if isinstance(answer, Exception):
            answer = f"cannot load vsense {needs['vsense']}: {answer}"
        if answer:
            refused.append(f"worker {worker} {answer}")
    if refused:
        raise VsenseError("\n".join(refused))
    places = sum(client.nthreads().values())
    if answers:
        console.say(f"{address}: workers: {len(answers)}, runs at the same time: {places}")
    else:
        console.say(f"{address}: no worker is there; runs begin when one comes")
