"""Old names and arguments work for two minor versions, and say what they are called now; shown on made-up renames."""
from __future__ import annotations

import inspect
import warnings
from typing import Any

import pytest

import fastbeam as fb
from fastbeam.interface import deprecation
from fastbeam.interface.arguments import Number, checked
from fastbeam.interface.deprecation import RENAMED, Renamed, deprecated, gone


@deprecated("0.1", dt="step")
@checked(step=Number(above=0.0, unit="s"))
def walk(step: float, *, times: int = 1) -> float:
    """Made up."""
    return step * times


@deprecated("0.1", r="radius")
@checked(radius=Number(above=0.0, unit="m"))
class Ball:
    """Made up."""

    def __init__(self, *, radius: float) -> None:
        self.radius = radius


@deprecated("0.1", instead="walk()")
def stroll() -> str:
    """Made up."""
    return "there"


def test_an_old_public_name_is_the_new_one_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RENAMED, "Bead", Renamed("Slider", "0.1"))
    for _ in range(2):
        with pytest.warns(FutureWarning, match=r"\.Bead is called fastbeam\.Slider now; the old name works until 0\.3") as said:
            assert fb.Bead is fb.Slider
        assert said[0].filename == __file__
    with pytest.warns(FutureWarning, match="Slider"):
        from fastbeam import Bead
    assert Bead is fb.Slider and "Bead" not in fb.__all__ and "Bead" not in vars(fb)


def test_classes_of_old_modules_are_names_of_the_package() -> None:
    with pytest.warns(FutureWarning, match=r"fastbeam\.mode_shapes\.Modes is called fastbeam\.Modes now; .* until 0\.4") as said:
        from fastbeam.mode_shapes import Modes  # type: ignore[import-not-found]
    assert Modes is fb.Modes and said[0].filename == __file__
    with pytest.raises(ImportError):
        from fastbeam.errors import Modus  # type: ignore[import-not-found]  # noqa: F401
    with pytest.raises(ModuleNotFoundError):
        import fastbeam.newton  # type: ignore[import-not-found]  # noqa: F401


def test_a_name_that_never_was_is_no_old_name() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Bead'"):
        fb.Bead  # noqa: B018


def test_an_old_argument_is_handed_on_by_its_new_name() -> None:
    with pytest.warns(FutureWarning, match="walk: the argument dt is called step now; the old name works until 0.3") as said:
        assert walk(dt=0.5, times=4) == 2.0
    assert said[0].filename == __file__
    with pytest.warns(FutureWarning, match="Ball: the argument r is called radius now"):
        assert Ball(r=2.0).radius == 2.0


def test_an_old_argument_is_checked_as_the_new_one() -> None:
    with pytest.warns(FutureWarning), pytest.raises(fb.SceneError, match="step"):
        walk(dt=-1.0)
    with pytest.raises(TypeError, match="dt is the old name of step; give step alone"):
        walk(step=1.0, dt=1.0)


def test_new_names_say_nothing_and_signatures_know_them_alone() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert walk(2.0) == walk(step=2.0) == 2.0 and Ball(radius=1.0).radius == 1.0
    assert list(inspect.signature(walk).parameters) == ["step", "times"]
    assert list(inspect.signature(Ball).parameters) == ["radius"]


def test_a_call_that_goes_says_what_to_write() -> None:
    with pytest.warns(FutureWarning, match=r"stroll is deprecated; write walk\(\); the old name works until 0\.3"):
        assert stroll() == "there"


@pytest.mark.parametrize(("since", "until"), [("0.1", "0.3"), ("0.9", "0.11"), ("1.4", "1.6")])
def test_old_names_work_for_two_minor_versions(since: str, until: str) -> None:
    assert gone(since) == until


@pytest.mark.parametrize("since", ["", "1", "0.1.0", "0.x", "v0.1"])
def test_what_is_no_minor_version_is_refused(since: str) -> None:
    with pytest.raises(ValueError, match="minor version"):
        deprecated(since, old="new")


@pytest.mark.parametrize("more", [{}, {"instead": "walk", "dt": "step"}])
def test_a_decorator_renames_arguments_or_a_call(more: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="instead, or renamed"):
        deprecated("0.1", **more)


def test_no_entry_is_overdue_and_all_lead_somewhere() -> None:
    now = tuple(int(x) for x in fb.__version__.split(".")[:2])
    for old, (new, since) in {**RENAMED, "made up": Renamed("Slider", "0.1")}.items():
        assert now < tuple(int(x) for x in gone(since).split(".")), f"{old} is to be taken out of deprecation.RENAMED"
        assert new in fb.__all__ and old not in fb.__all__
    assert deprecation.KEPT == 2
