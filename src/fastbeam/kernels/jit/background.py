"""Second process that compiles part of the entries of a table, while the first compiles the rest.

Both processes share the folder of compiled kernels. Nothing depends on the second: the first compiles itself any entry that the
second does not deliver.
"""
from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from fastbeam.kernels.jit import sources as _outside

# (kernel, types of its arguments)
Job = tuple[Any, tuple[Any, ...]]
# s; longer than any part takes, even on a busy machine
PATIENCE = 60.0
PROGRAM = ("import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
           "from fastbeam.kernels.jit.decorators import work; work(sys.stdin.buffer)")
# events of each part: it is there, it is begun
_COMING: dict[Any, tuple[threading.Event, threading.Event | None]] = {}


def missing(jobs: list[Job]) -> list[Job]:
    """Return the jobs that are not on the disk yet, nor being compiled."""
    return [(kernel, some) for kernel, some in jobs if (kernel.py_func, some) not in _COMING and not kernel.part.is_kept(some)]


def start(jobs: list[Job], folder: str) -> None:
    """Start the second process if there is a processor for it."""
    if _processors() < 2 or not os.path.basename(sys.executable or "").lower().startswith("python"):
        return
    modules = _outside.modules([x for _, some in jobs for x in some])
    if "__main__" in modules:
        return  # the program itself is not run a second time
    names = [(kernel.py_func.__module__, kernel.py_func.__qualname__, some) for kernel, some in jobs]
    path = [str(Path(__file__).resolve().parents[3]), *sys.path]
    try:
        message = pickle.dumps(path) + pickle.dumps((folder, modules)) + pickle.dumps(names)
        process = subprocess.Popen([sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        assert process.stdin is not None
        with process.stdin as pipe:
            pipe.write(message)
    except (OSError, TypeError, AttributeError, pickle.PicklingError):
        return  # no process, or kernels that another process cannot name
    events = [threading.Event() for _ in jobs]
    _COMING.update(((kernel.py_func, some), (event, before)) for (kernel, some), event, before
                   in zip(jobs, events, [None, *events]))
    threading.Thread(target=_follow, args=(process, events), daemon=True).start()


def wait(function: Any, arguments: tuple[Any, ...]) -> None:
    """Wait until a part that the second process compiles is on the disk, or has failed; return at once if it has not begun the
    part."""
    event, before = _COMING.pop((function, arguments), (None, None))
    if event is not None and (before is None or before.is_set()):
        event.wait(PATIENCE)


def _follow(process: subprocess.Popen[bytes], events: list[threading.Event]) -> None:
    assert process.stdout is not None
    with process.stdout as lines:
        for event, _ in zip(events, lines):
            event.set()
    for event in events:
        event.set()
    process.wait()


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
