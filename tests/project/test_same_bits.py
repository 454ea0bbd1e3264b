"""Comparison of bits: hashes see the last bit, verdicts count what both have, and private modules are found where they are."""
from __future__ import annotations

import numpy as np
import pytest

from perf import places
from perf.suite import same_bits, same_bits_cases


def test_hashes_see_the_last_bit_and_no_clock() -> None:
    of = same_bits_cases.found_in
    x = np.array([0.1, 0.2])
    one = {"run": {"x": x, "wall_time": 1.0}, "word": "text", "n": 3}
    assert of(one) == of({"run": {"x": x.copy(), "wall_time": 2.0}, "word": "other", "n": 3}) and set(of(one)) == {"run/x", "n"}
    near = of({**one, "run": {"x": np.nextafter(x, 1.0)}})
    assert near["run/x"] != of(one)["run/x"] and near["n"] == of(one)["n"]
    assert of({"x": x}) != of({"x": x.reshape(2, 1)})


@pytest.mark.parametrize(("base", "here", "verdict", "why"), [
    ({"a": "1"}, {"a": "1"}, "same", "1 numbers"), ({"a": "1", "b": "2"}, {"a": "1", "b": "3"}, "DIFFERENT", "b"),
    ({"a": "1"}, {"a": "1", "c": "2"}, "same", "1 numbers; in one of both only: c"),
    ({"a": "1"}, {"b": "1"}, "DIFFERENT", "common"),
    (None, {"a": "1"}, "not there", "no such case"), ("not there: no attribute", {"a": "1"}, "not there", "no attribute"),
    ("SceneError: x", "SceneError: x", "same", "SceneError"),
    ("SceneError: x", {"a": "1"}, "DIFFERENT", "SceneError: x / 1 numbers")])
def test_verdicts(base: same_bits.Found | None, here: same_bits.Found, verdict: str, why: str) -> None:
    found, told = same_bits.judge(base, here)
    assert found == verdict and why in told


def test_cases_have_names_of_their_own() -> None:
    assert len(same_bits_cases.CASES) > 80


def test_private_modules_are_found() -> None:
    for name in places.PACKAGED:
        assert places.module(name).__name__ in (f"fastbeam.{name}", f"fastbeam.{places.PACKAGED[name]}")
    with pytest.raises(KeyError):
        places.module("nowhere")
