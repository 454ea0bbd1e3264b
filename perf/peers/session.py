"""Runs programs as child processes, one at a time, in mixed order, and keeps what they say."""
from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from perf.peers.cases import Settings
from perf.peers.environments import environment, interpreter

PROGRAMS = Path(__file__).resolve().parent / "programs"
TIMEOUT = 900.0  # s


def key(settings: Settings) -> str:
    """Name of a run: its settings, sorted."""
    return json.dumps(settings, sort_keys=True)


def run(program: str, scene: str, settings: Settings) -> dict[str, Any]:
    """One child process; its line with scene, settings and the time of the whole process."""
    begin, load = time.perf_counter(), os.getloadavg()[0]
    line: dict[str, Any] = {"program": program, "ok": False, "points": []}
    try:
        done = subprocess.run([interpreter(program), PROGRAMS / f"{program}_run.py", json.dumps({"scene": scene, **settings})],
                              capture_output=True, text=True, timeout=TIMEOUT, env=environment(program))
        answers = [text for text in done.stdout.splitlines() if text.startswith("{")]
        if answers:
            line = json.loads(answers[-1])
        else:
            line["message"] = (done.stderr.strip().splitlines() or ["said nothing"])[-1]
    except subprocess.TimeoutExpired:
        line["message"] = f"stopped after {TIMEOUT:g} s"
    return {**line, "scene": scene, "settings": settings, "process": time.perf_counter() - begin, "load": load}


def mixed(queues: Sequence[Sequence[Any]]) -> list[Any]:
    """All entries of the queues, each spread evenly over the whole: no program gets the quiet half of a session."""
    placed = [((k + 0.5) / len(queue), number, entry) for number, queue in enumerate(queues) for k, entry in enumerate(queue)]
    return [entry for _, _, entry in sorted(placed, key=lambda item: item[:2])]


def short(settings: Settings) -> str:
    """Settings as text."""
    return " ".join(f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in settings.items())
