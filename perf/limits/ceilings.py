"""What the machine allows: multiply-adds in registers, and the bandwidth of memory and caches, measured when asked for.

Bytes count as in the STREAM benchmark: what is read once and what is written once. One thread is timed by its processor time,
several by the clock on the wall, so only the latter need a quiet machine.
"""
from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from perf.places import private

kernel = private("_jit", "kernel")
total, vld, vst = private("kernels.algebra", "total", "vld", "vst")
# bytes of the three arrays of a triad that no cache holds
MEMORY = 600_000_000


@kernel
def six_chains(x, n):
    """n times 6 multiply-adds of 8 lanes that do not wait for each other: fits 16 registers of 4 lanes."""
    f = vld(x, 0, 0); g = vld(x, 8, 0)
    a = vld(x, 16, 0); b = vld(x, 24, 0); c = vld(x, 32, 0); d = vld(x, 40, 0); e = vld(x, 48, 0); h = vld(x, 56, 0)
    for _ in range(n):
        a = a * f + g; b = b * f + g; c = c * f + g; d = d * f + g; e = e * f + g; h = h * f + g
    return total(a + b + c + d + e + h)


@kernel
def twelve_chains(x, n):
    """The same with 12, for registers of 8 lanes."""
    f = vld(x, 0, 0); g = vld(x, 8, 0)
    a = vld(x, 16, 0); b = vld(x, 24, 0); c = vld(x, 32, 0); d = vld(x, 40, 0); e = vld(x, 48, 0); h = vld(x, 56, 0)
    k = vld(x, 64, 0); l = vld(x, 72, 0); m = vld(x, 80, 0); o = vld(x, 88, 0); p = vld(x, 96, 0); q = vld(x, 104, 0)
    for _ in range(n):
        a = a * f + g; b = b * f + g; c = c * f + g; d = d * f + g; e = e * f + g; h = h * f + g
        k = k * f + g; l = l * f + g; m = m * f + g; o = o * f + g; p = p * f + g; q = q * f + g
    return total(a + b + c + d + e + h) + total(k + l + m + o + p + q)


@kernel
def triad(out, x, y, first, last, repeats):
    """out = x + 0.5 y from `first` to before `last`, multiples of 8."""
    for _ in range(repeats):
        for i in range(first, last, 8):
            vst(out, i, 0, vld(x, i, 0) + 0.5 * vld(y, i, 0))


def clock(threads: int) -> Callable[[], float]:
    """Seconds of the work of so many threads."""
    return time.thread_time if threads == 1 else time.perf_counter


def best(work: Callable[[], Any], threads: int = 1, repeats: int = 5, least: float = 0.0) -> float:
    """Smallest time of `repeats` runs of some work, s; more repeats until it has run for `least` seconds."""
    now = clock(threads)
    found, spent, k = np.inf, 0.0, 0
    while k < repeats or spent < least:
        begin = now()
        work()
        seconds = now() - begin
        found, spent, k = min(found, seconds), spent + seconds, k + 1
    return found


def together(pool: ThreadPoolExecutor | None, work: Callable[[int], Any], threads: int) -> None:
    """work(k) on all threads, the last on the calling one."""
    others = [pool.submit(work, k) for k in range(threads - 1)] if pool else []
    work(threads - 1)
    for other in others:
        other.result()


def peak(threads: int = 1, repeats: int = 7, seconds: float = 0.02) -> float:
    """Multiplications and additions per second in registers, GF/s."""
    x = np.full(112, 0.5)
    fastest = 0.0
    with ThreadPoolExecutor(max(threads - 1, 1)) as pool:
        for chains, work in ((6, six_chains), (12, twelve_chains)):
            work(x, 1)
            n = 10_000
            n = max(n, int(n * seconds / max(best(lambda: work(x, n)), 1e-9)))
            spent = best(lambda: together(pool, lambda _: work(x, n), threads), threads, repeats)
            fastest = max(fastest, threads * n * chains * 16.0 / spent)
    return 1e-9 * fastest


def bandwidth(size: float = MEMORY, threads: int = 1, repeats: int = 5, seconds: float = 0.02) -> float:
    """Triad on arrays of so many bytes in all, GB/s."""
    part = max(8, int(size) // (24 * 8 * threads) * 8)
    out, x, y = (np.full(part * threads, value) for value in (0.0, 1.0, 2.0))
    moved = 24.0 * part * threads
    triad(out, x, y, 0, 8, 1)
    once = best(lambda: triad(out, x, y, 0, part * threads, 1), 1, 2)
    # long enough for the threads to run side by side
    n = max(1, int(np.ceil(seconds / max(once, 1e-7))))
    with ThreadPoolExecutor(max(threads - 1, 1)) as pool:
        spent = best(lambda: together(pool, lambda k: triad(out, x, y, part * k, part * (k + 1), n), threads), threads, repeats)
    return 1e-9 * n * moved / spent


@dataclass
class Ceilings:
    """Peak and bandwidth for numbers of threads, each measured when first asked for.

    Attributes
    ----------
    memory_size : float
        Bytes that count as memory; smaller in quick runs.
    """

    memory_size: float = MEMORY

    def __post_init__(self) -> None:
        self._peaks: dict[int, float] = {}
        self._bandwidths: dict[tuple[int, int], float] = {}

    def peak(self, threads: int = 1) -> float:
        """GF/s."""
        if threads not in self._peaks:
            self._peaks[threads] = peak(threads)
        return self._peaks[threads]

    def bandwidth(self, size: float = np.inf, threads: int = 1) -> float:
        """GB/s of work on so many bytes, of the cache or memory that holds them; sizes count up to the next power of two."""
        size = min(size, self.memory_size)
        step = int(np.ceil(np.log2(max(size, 1024.0))))
        if (step, threads) not in self._bandwidths:
            self._bandwidths[step, threads] = bandwidth(min(2.0**step, self.memory_size), threads)
        return self._bandwidths[step, threads]

    def facts(self) -> dict[str, Any]:
        """Everything that was measured."""
        return {"peak, GF/s": {str(k): v for k, v in self._peaks.items()},
                "bandwidth, GB/s": {f"{2**step} bytes, {k} threads": v for (step, k), v in self._bandwidths.items()}}
