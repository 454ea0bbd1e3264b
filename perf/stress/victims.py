"""What the stress tests do in processes of their own, because it may end badly: python victims.py NAME ARGUMENTS"""
from __future__ import annotations

import json
import signal
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "src"), str(HERE.parents[1] / "tests")]

import numpy as np  # noqa: E402
from small_scenes import bead, bent, cantilever, free_beam, straight  # noqa: E402

import fastbeam as fb  # noqa: E402


def long_rail() -> fb.Scene:
    """A mass on a rail so long that a run ends for other reasons."""
    rail, mass = straight("rail", (0, 0, 0), (300, 0, 0)), fb.PointMass("bead", mass=0.5)
    return fb.Scene(rail, mass, fb.Slider("run", mass, rail, at=140.0, rate=0.5), bent(rail), name="long rail")


SCENES = {"free_beam": free_beam, "bead": bead, "cantilever": cantilever}
# long enough to be killed in
RUN: dict[str, Any] = {"t_end": 400.0, "step": 2e-3, "every": 5}
SHAPES = 4000


def say(*what: Any) -> None:
    """One line of JSON that arrives at once."""
    print(json.dumps(what), flush=True)


def run(path: str, order: str) -> None:
    """Runs with a result file and a checkpoint and tells the time of every row."""
    output = fb.Output(path, snapshots=SHAPES, checkpoint=path + ".checkpoint", checkpoint_every=0.0)
    fb.simulate(fb.compile_scene(long_rail()), output=output,
                order=int(order), callback=lambda t, state: say(t, time.monotonic()), progress=False, **RUN)


def fill(path: str, limit: str) -> None:
    """Runs with files that may not grow beyond a limit (0: none)."""
    from fastbeam.results import hdf5_writer as store
    store.FLUSH_TIME = 0.02
    model = fb.compile_scene(long_rail())
    if int(limit):
        import resource
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
    try:
        result = fb.simulate(model, output=fb.Output(path, snapshots=SHAPES), progress=False, **RUN)
    except fb.ResultFileError as error:
        result = error.result
        say("refused", str(error), 0 if result is None else len(result.t),
            bool(result is not None and result.checkpoint.t == result.t[-1]))
        return
    say("done", "", len(result.t), True)


def read(path: str, original: str, kind: str, first: str, last: str) -> None:
    """Reads damaged copies of a result file: numbers of those refused, unchanged, and changed without a word."""
    from fastbeam.interface.errors import ResultFileError
    data = Path(original).read_bytes()
    good = fingerprint(fb.load_result(original))
    counts = {"refused": 0, "unchanged": 0, "WRONG": 0, "other error": 0}
    for seed in range(int(first), int(last)):
        say("seed", seed)
        generator = np.random.default_rng(seed)
        Path(path).write_bytes(damage(data, kind, generator))
        try:
            same = fingerprint(fb.load_result(path)) == good
            counts["unchanged" if same else "WRONG"] += 1
        except ResultFileError:
            counts["refused"] += 1
        except Exception as error:
            counts["other error"] += 1
            say("error", seed, repr(error))
    say("counts", counts)


def damage(data: bytes, kind: str, generator: np.random.Generator) -> bytes:
    """One bit, a run of random bytes, or a cut."""
    broken = bytearray(data)
    # every second time where something is stored: a file of a killed run is mostly room for more
    stored = np.flatnonzero(np.frombuffer(data, np.uint8))
    at = int(generator.choice(stored) if generator.integers(2) else generator.integers(len(data)))
    if kind == "bit":
        broken[at] ^= 1 << int(generator.integers(8))
    elif kind == "bytes":
        size = int(generator.integers(2, 200))
        broken[at:at + size] = generator.bytes(min(size, len(data) - at))
    elif kind == "zeros":
        size = int(generator.integers(2, 5000))
        broken[at:at + size] = bytes(min(size, len(data) - at))
    else:
        del broken[at:]
    return bytes(broken)


def fingerprint(result: fb.Result) -> str:
    """Everything in a result."""
    import hashlib
    digest = hashlib.sha256()
    for x in (result.t, *(result.series[name] for name in sorted(result.series)), result.t_snap, result.phi, result.directors):
        digest.update(np.ascontiguousarray(x).tobytes())
    digest.update(json.dumps([result.model_text, result.info, result.names, result.events, sorted(result.series)]).encode())
    return digest.hexdigest()


def start(name: str, at: str) -> None:
    """Compiles and runs a scene at an agreed moment; tells a hash of the state."""
    import hashlib

    from fastbeam.kernels.jit import decorators as _jit
    time.sleep(max(0.0, float(at) - time.time()))
    result = fb.simulate(fb.compile_scene(SCENES[name]()), t_end=0.5, step=0.01, progress=False)
    say(hashlib.sha256(b"".join(x.tobytes() for x in result.state)).hexdigest(), *_jit.compile_counts(), _jit._FOLDER)


if __name__ == "__main__":
    {f.__name__: f for f in (run, fill, read, start)}[sys.argv[1]](*sys.argv[2:])
