"""Pictures: the right axes, and no display needed."""
from __future__ import annotations

import io
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.interface.errors import BackendError, SceneError
from fastbeam.results.plots.plots import plot_balance, plot_invariants, plot_overview, plot_shapes, plot_slider
from fastbeam.results.result import Result

matplotlib = pytest.importorskip("matplotlib")
mpl_toolkits = pytest.importorskip("mpl_toolkits.mplot3d") and pytest.importorskip("mpl_toolkits")
SOURCE = Path(__file__).resolve().parents[2] / "src"


def swing(axes: tuple[int, int] = (0, 1), sliders: tuple[str, ...] = ("ring",), spatial: bool = False) -> Result:
    """A rod of 7 nodes that swings in a plane, with point masses on it."""
    t, n = np.linspace(0.0, 1.0, 21), len(sliders)
    s = np.linspace(0.0, 1.2, 7)
    phi = np.zeros((21, 8, 3))
    phi[:, :7, axes[0]], phi[:, :7, axes[1]] = np.cos(t)[:, None] * s, np.sin(t)[:, None] * s
    if spatial:
        phi[:, :7, 2] = 0.4 * t[:, None] * s
    phi[:, 7] = phi[:, 3]
    series = {"kinetic": 1 + t, "potential": 1 - t, "total": np.full(21, 2.0), "lin_mom": np.ones((21, 3)),
              "ang_mom": np.ones((21, 3)), "gap": np.full((21, n), 1e-15), "s_slide": np.tile(0.5 + 0.1 * t[:, None], (1, n)),
              "contact_force": np.ones((21, n, 3)), "slider_position": np.repeat(phi[:, 7:], n, axis=1)}
    names = {"sliders": list(sliders), "beams": [{"name": "rod", "first": 0, "count": 7, "element_ends": [0, 3, 6]}],
             "masses": [{"name": "bead", "node": 7}]}
    return Result(t=t, series=series, names=names, info={"scene": "swing"}, t_snap=t, phi=phi,
                  directors=np.tile(np.eye(3), (21, 8, 1, 1)))


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)])
def test_flat_scene_is_drawn_in_its_plane_with_equal_aspect(axes: tuple[int, int]) -> None:
    picture = plot_shapes(swing(axes)).axes[0]
    assert (picture.get_xlabel(), picture.get_ylabel()) == (f"{'xyz'[axes[0]]} [m]", f"{'xyz'[axes[1]]} [m]")
    assert picture.get_aspect() == 1.0


def test_spatial_scene_is_drawn_in_space_unless_a_plane_is_asked_for() -> None:
    assert plot_shapes(swing(spatial=True)).axes[0].name == "3d"
    assert plot_shapes(swing(spatial=True), plane="xz").axes[0].get_ylabel() == "z [m]"


def test_shapes_are_spread_over_the_whole_run_and_hold_the_nodes_of_the_beam() -> None:
    run = swing(sliders=())
    rods = [line for line in plot_shapes(run, n=5).axes[0].get_lines() if len(line.get_xdata()) == 7]
    assert len(rods) == 5
    for line, k in zip(rods, (0, 5, 10, 15, 20), strict=True):
        np.testing.assert_array_equal(np.transpose(line.get_data()), run.phi[k, :7, :2])


def test_invariants_show_energies_and_deviations_above_the_floor() -> None:
    upper, lower = plot_invariants(swing()).axes
    assert [line.get_label() for line in upper.get_lines()] == ["kinetic", "potential", "total"]
    assert upper.get_ylabel() == "energy [J]" and lower.get_yscale() == "log"
    labels = [line.get_label() for line in lower.get_lines()]
    assert labels == ["total energy", "linear momentum", "angular momentum", "gap [m]", "machine epsilon"]
    assert min(np.min(line.get_ydata()) for line in lower.get_lines()) == 1e-17


def test_energies_that_are_drawn_add_up_to_the_total() -> None:
    run = swing()
    strain, gravity, loads = 0.5 * run.t, 2.0 * run.t**2, -3.0 * run.t
    run.series |= {"strain": strain, "gravity": gravity, "potential": strain + gravity + loads}
    run.series["total"] = run.series["kinetic"] + run.series["potential"]
    lines = {line.get_label(): line.get_ydata() for line in plot_invariants(run).axes[0].get_lines()}
    np.testing.assert_allclose(sum(y for name, y in lines.items() if name != "total"), lines["total"], rtol=1e-12)
    assert set(lines) == {"kinetic", "strain", "gravity", "loads", "total"}
    run.series["potential"] = strain + gravity
    assert "loads" not in [line.get_label() for line in plot_invariants(run).axes[0].get_lines()]


def test_energy_of_elastic_stops_has_a_curve_of_its_own() -> None:
    run = swing()
    strain, stops = 0.5 * run.t, 0.25 * run.t**2
    run.series |= {"strain": strain, "gravity": -run.t, "potential": strain - run.t + stops, "stop_energy": stops[:, None]}
    run.series["total"] = run.series["kinetic"] + run.series["potential"]
    lines = {line.get_label(): line.get_ydata() for line in plot_invariants(run).axes[0].get_lines()}
    np.testing.assert_allclose(sum(y for name, y in lines.items() if name != "total"), lines["total"], rtol=1e-12)
    assert set(lines) == {"kinetic", "strain", "gravity", "stops", "total"}


def test_balance_shows_every_part_and_their_sum() -> None:
    run = swing()
    strain, lost = 0.5 * run.t, 0.25 * run.t**2
    zero = np.zeros((21, 1))
    run.series |= {"kinetic": 2.0 - strain - lost, "strain": strain, "gravity": 0 * strain, "potential": strain,
                   "friction_loss": lost[:, None], "drive_work": zero, "stop_loss": zero, "stop_energy": zero}
    upper, lower = plot_balance(run).axes
    lines = {line.get_label(): line.get_ydata() for line in upper.get_lines()}
    np.testing.assert_array_equal(lines["friction of slider 'ring'"], lost)
    np.testing.assert_allclose(lines["kinetic"], -strain - lost, atol=1e-15)
    np.testing.assert_allclose(lines["sum"], 0.0, atol=1e-15)
    assert np.abs(lower.get_lines()[0].get_ydata()).max() < 1e-15
    with pytest.raises(SceneError, match="'kinetic' was not recorded"):
        plot_balance(Result(t=[0.0]))


def test_bodies_are_squares_with_their_axes() -> None:
    run = swing()
    run.names["bodies"] = [{"name": "block", "node": 6}]
    lines = plot_shapes(run, n=2).axes[0].get_lines()
    square, = [line for line in lines if line.get_marker() == "s"][-1:]
    np.testing.assert_array_equal(np.ravel(square.get_data()), run.phi[-1, 6, :2])
    # three lines of two points each, with gaps
    axes, = [line for line in lines if len(line.get_xdata()) == 9][-1:]
    tips = np.transpose(axes.get_data())[1::3] - run.phi[-1, 6, :2]
    np.testing.assert_allclose(np.linalg.norm(tips, axis=1) / np.linalg.norm(tips[0]), (1.0, 1.0, 0.0), atol=1e-12)


def test_series_that_are_not_conserved_have_no_deviation_curve() -> None:
    run = swing()
    run.info["conserved"] = ["total"]
    labels = [line.get_label() for line in plot_invariants(run).axes[1].get_lines()]
    assert labels == ["total energy", "gap [m]", "machine epsilon"]


def test_slider_picture_shows_coordinate_force_and_path() -> None:
    run = swing()
    coordinate, force, path = plot_slider(run).axes[:3]
    np.testing.assert_array_equal(coordinate.get_lines()[0].get_ydata(), run.series["s_slide"][:, 0])
    assert len(force.get_lines()) == 3 and force.get_ylabel() == "force [N]"
    np.testing.assert_array_equal(path.get_lines()[0].get_ydata(), run.phi[:, 7, 1])


def test_slider_path_falls_back_to_the_snapshots_of_its_node() -> None:
    run = swing()
    del run.series["slider_position"]
    assert plot_slider(run, "ring").axes[2].get_title() == "Path: not recorded"
    run.names["slider_nodes"] = [7]
    np.testing.assert_array_equal(plot_slider(run).axes[2].get_lines()[0].get_xdata(), run.phi[:, 7, 0])


@pytest.mark.parametrize(("sliders", "spatial", "titles"), [
    ((), False, 3), (("ring",), False, 5), (("a", "b", "c"), True, 5)])
def test_overview_holds_a_panel_for_everything_recorded(tmp_path: Path, sliders: tuple[str, ...], spatial: bool,
                                                        titles: int) -> None:
    figure = plot_overview(swing(sliders=sliders, spatial=spatial))
    assert len({axes.get_title() for axes in figure.axes if axes.get_title()}) == titles
    figure.savefig(tmp_path / "run.png", dpi=50)
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def shallow(sag: float) -> Result:
    """A wire of 120 m that sags, in three shapes."""
    x = np.linspace(-60.0, 60.0, 13)
    phi = np.zeros((3, 13, 3))
    phi[:, :, 0], phi[:, :, 2] = x, -sag * (1.0 - (x / 60.0) ** 2) * np.array([0.5, 0.7, 1.0])[:, None]
    return Result(t=[0.0, 1.0, 2.0], series={"total": np.ones(3)}, names={"beams": [{"name": "wire", "first": 0, "count": 13}]},
                  t_snap=[0, 1, 2], phi=phi, directors=np.tile(np.eye(3), (3, 13, 1, 1)))


@pytest.mark.parametrize(("sag", "equal"), [(1.2, False), (14.0, False), (16.0, True), (1e-6, True)])
def test_long_shallow_scenes_are_drawn_with_different_scales(sag: float, equal: bool) -> None:
    axes = plot_shapes(shallow(sag)).axes[0]
    assert (axes.get_aspect() == 1.0) is equal
    assert axes.get_ylabel() == ("z [m]" if equal else "z [m], other scale")
    low, high = axes.get_ylim()
    assert (sag / (high - low) > 0.8) is not equal


@pytest.mark.parametrize("n", [3, 9, 24, 60])
def test_every_slider_has_its_colour_and_a_legend_is_there(n: int) -> None:
    figure = plot_overview(swing(sliders=tuple(f"ring {k}" for k in range(n))))
    axes = next(axes for axes in figure.axes if axes.get_title() == "Sliding coordinate")
    assert len({tuple(np.round(matplotlib.colors.to_rgba(line.get_color()), 6)) for line in axes.lines}) == n
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    assert len(texts) == (n if n <= 24 else 8) and texts[0] == "ring 0" and texts[-1] == f"ring {n - 1}"
    assert axes.get_legend().get_title().get_text() == ("" if n <= 24 else "8 of 60, in order")
    # no curve behind the legend
    figure.draw_without_rendering()
    box = axes.get_legend().get_window_extent().transformed(axes.transData.inverted())
    assert box.y0 > max(line.get_ydata().max() for line in axes.lines)


@pytest.mark.parametrize("height", [0.4, 1.0, 4.0])
def test_titles_in_space_stand_above_the_shapes(height: float) -> None:
    run = swing(spatial=True)
    phi = run.phi * (1.0, 1.0, height / 0.48)
    tall = Result(t=run.t, series=run.series | {"slider_position": phi[:, 7:]}, names=run.names, t_snap=run.t_snap, phi=phi,
                  directors=run.directors)
    figure = plot_shapes(tall)
    figure.draw_without_rendering()
    axes = figure.axes[0]
    title = axes.title.get_window_extent()
    for line in axes.lines:
        x, y, _ = mpl_toolkits.mplot3d.proj3d.proj_transform(*line.get_data_3d(), axes.get_proj())
        assert axes.transData.transform(np.column_stack((x, y)))[:, 1].max() < title.y0


def test_requests_that_the_result_cannot_meet_are_refused() -> None:
    empty = Result(t=[0.0])
    with pytest.raises(SceneError, match="has no snapshots"):
        plot_shapes(empty)
    with pytest.raises(SceneError, match="plot_shapes, plane: 'yx' does not exist: choose 'auto', 'xy', 'xz', 'yz' or '3d'"):
        plot_shapes(swing(), plane="yx")
    with pytest.raises(SceneError, match="holds no slider"):
        plot_slider(empty)
    with pytest.raises(SceneError, match="slider 'cart' is not in this result: choose from 'ring'"):
        plot_slider(swing(), "cart")
    with pytest.raises(SceneError, match="no energies and momenta"):
        plot_invariants(empty)


def test_missing_matplotlib_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(BackendError, match="pip install matplotlib"):
        plot_shapes(swing())


def test_pictures_need_no_display_and_import_no_pyplot(tmp_path: Path) -> None:
    code = ("import sys, test_plot as tp; tp.plot_overview(tp.swing()).savefig(sys.argv[1], dpi=40); "
            "sys.exit('matplotlib.pyplot' in sys.modules)")
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    path = os.pathsep.join((str(SOURCE), str(Path(__file__).parent)))
    target = tmp_path / "run.png"
    environment |= {"PYTHONPATH": path, "MPLBACKEND": "TkAgg"}
    done = subprocess.run([sys.executable, "-c", code, str(target)], env=environment, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    assert target.exists()


def test_names_stand_in_pictures_letter_by_letter() -> None:
    rows = np.linspace(0.0, 1.0, 5)
    names = {"sliders": ["$\\frac{$", "_hidden"], "points": ["$x_{$"]}
    shapes = np.random.default_rng(1).random((2, 2, 3))
    run = fb.Result(t=rows, names=names, info={"scene": "$\\evil{"}, t_snap=rows[:2], phi=shapes,
                    series={"total": rows, "kinetic": rows, "s_slide": np.ones((5, 2)), "gap": np.zeros((5, 2)),
                            "contact_force": np.zeros((5, 2, 3)), "points": np.zeros((5, 1, 3))})
    figure = fb.plot_overview(run)
    figure.savefig(io.BytesIO(), format="png")
    shown = [text.get_text() for axes in figure.axes if axes.get_legend() for text in axes.get_legend().get_texts()]
    assert r"\$\frac{\$" in shown and " _hidden" in shown
    fb.plot_slider(run, "$\\frac{$").savefig(io.BytesIO(), format="png")


def test_notebooks_show_figures_and_figures_travel() -> None:
    rows = np.linspace(0.0, 1.0, 5)
    figure = fb.plot_invariants(fb.Result(t=rows, series={"total": rows, "kinetic": rows}))
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert pickle.loads(pickle.dumps(figure)).axes[0].get_title() == "Energies"
