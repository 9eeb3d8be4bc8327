"""Many independent calls at once, on this machine or a cluster; results as they come."""

import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any

from joblib import Parallel, delayed, effective_n_jobs, parallel_config

BACKENDS = ("loky", "ray", "dask")
BATCH = 4  # calls per process between two looks at what has come, where a backend gives no stream of results

# Ctrl-C reaches every process of a terminal; the first ends the others, who need not complain
DEAF = {"initializer": signal.signal, "initargs": (signal.SIGINT, signal.SIG_IGN)}


def in_parallel(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], jobs: int = 1, backend: str = "loky"
) -> Generator[Any, None, None]:
    """What ``function`` gives for each tuple of arguments, in no order; to be closed by who stops before the end.

    Args:
        function: Can be pickled, as its arguments and results can.
        calls: Arguments of each call.
        jobs: Processes; -1: all cores.
        backend: "loky": processes of this machine. "ray", "dask": a cluster that is connected already, or a local
            one; needs the extra [cluster].

    Raises:
        ValueError: If there is no such backend.
        ModuleNotFoundError: If its library is not installed.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend must be one of {', '.join(BACKENDS)}, not {backend!r}")
    if backend == "loky" and jobs == 1:  # no process needs be started, none pickled to
        yield from (function(*call) for call in calls)
        return
    settings: dict[str, Any] = DEAF if backend == "loky" else {}
    with _connected(backend, jobs), parallel_config(backend=backend, n_jobs=jobs, **settings):
        if backend != "ray":
            yield from Parallel(return_as="generator_unordered")(delayed(function)(*call) for call in calls)
            return
        waiting = iter(calls)  # joblib over Ray gives lists alone
        with Parallel() as work:
            while batch := list(islice(waiting, BATCH * max(1, effective_n_jobs(jobs)))):
                yield from work(delayed(function)(*call) for call in batch)


@contextmanager
def _connected(backend: str, jobs: int) -> Iterator[None]:
    """A cluster that joblib knows: the one that is connected, else one of this machine for as long as it lasts."""
    try:
        if backend == "ray":
            import ray
            from ray.util.joblib import register_ray

            register_ray()
            own = not ray.is_initialized()
            try:
                yield
            finally:
                if own:
                    ray.shutdown()
        elif backend == "dask":
            from distributed import Client, get_client

            try:
                get_client()
            except ValueError:  # there is none
                with Client(n_workers=None if jobs < 0 else jobs, threads_per_worker=1, dashboard_address=None):
                    yield
            else:
                yield
        else:
            yield
    except ModuleNotFoundError as error:
        if error.name not in ("ray", "distributed"):
            raise
        raise ModuleNotFoundError(f"backend {backend!r} needs {error.name}: pip install 'vse-gym[cluster]'") from None
