"""Tasks on a Ray cluster. Ray does those again whose worker or machine died."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from imgtransfer.running.task import WORKER_VARIABLE, Outcome, attempt, call_packed, pack
from render import InputError, Option
from render.extras import optional

T = TypeVar("T")
R = TypeVar("R")
_IN_FLIGHT = (
    4  # tasks that are handed in for each core, so that no core waits and Ctrl-C has few to take back
)
_POLL = 1.0  # seconds
_PATIENCE = 10.0  # seconds that a cluster has to answer


@dataclass(frozen=True)
class Cluster:
    """Tasks over the machines of a Ray cluster, one core each. All of them must see the data at the same path or URL,
    and have this package installed.

    Args:
        address: of the cluster: "HOST:PORT", "ray://HOST:PORT", "auto" for the one that this machine belongs to, or
            "local" for a new one of this machine alone.
        retries: how often a task is done again whose worker died.
    """

    address: str
    retries: int = 2

    def outcomes(self, function: Callable[[T], R], tasks: Sequence[T]) -> Generator[Outcome[R], None, None]:
        ray = _ray()
        ours = not ray.is_initialized()
        if ours:
            self._check_listening()
            at_sigterm = signal.getsignal(signal.SIGTERM)
            try:
                ray.init(address=self.address, log_to_driver=False, logging_level="warning")
            except (ConnectionError, ValueError, RuntimeError, OSError) as error:
                reason = " ".join(str(error).split())
                raise InputError(
                    f"{Option('ray')} {self.address}: no Ray cluster answers there ({reason})"
                ) from error
            if threading.current_thread() is threading.main_thread():
                signal.signal(
                    signal.SIGTERM, at_sigterm
                )  # Ray has set its own, which ends without cleaning up
        pending: dict[Any, int] = {}
        try:
            limit = _IN_FLIGHT * max(1, int(ray.cluster_resources().get("CPU", 1)))
            remote = ray.remote(_attempt).options(
                num_cpus=1, max_retries=self.retries, scheduling_strategy="SPREAD"
            )
            coming = iter(enumerate(tasks))
            while True:
                while len(pending) < limit and (following := next(coming, None)) is not None:
                    index, task = following
                    pending[remote.remote(pack(function, task), index)] = index
                if not pending:
                    return
                done, _ = ray.wait(list(pending), num_returns=1, timeout=_POLL)
                for reference in done:
                    yield _outcome(ray, reference, pending.pop(reference))
        finally:
            for reference in pending:
                ray.cancel(reference, force=True)
            if ours:
                ray.shutdown()

    def _check_listening(self) -> None:
        """Raise InputError where nothing listens at the address: Ray itself would try for many minutes."""
        host, colon, port = self.address.removeprefix("ray://").rpartition(":")
        if not colon:
            return  # auto, local
        try:
            socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE).close()
        except (OSError, ValueError, OverflowError) as error:
            raise InputError(
                f"{Option('ray')} {self.address}: no Ray cluster answers there ({error})"
            ) from error


def _ray() -> Any:
    return optional("ray", "cluster", str(Option("ray")))


def _attempt(packed: bytes, index: int) -> Outcome[Any]:
    os.environ[WORKER_VARIABLE] = "ray"
    return attempt(call_packed, packed, index)


def _outcome(ray: Any, reference: Any, index: int) -> Outcome[Any]:
    try:
        return ray.get(reference)
    except ray.exceptions.RayError as error:
        first = str(error).strip().splitlines() or [""]
        return Outcome(index, reason=f"{type(error).__name__}: {first[0]}")
