"""Files for ParaView: what stands in them, read back by h5py and by VTK itself."""
from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from small_scenes import SECTION, bead

import fastbeam as fb
from fastbeam.results.lines import Lines
from fastbeam.results.mode_shapes import DampedModes
from fastbeam.results.result import Result

SOURCE = Path(__file__).resolve().parents[2] / "src"


@cache
def flight() -> Result:
    """A mass slides on a beam that flies; shapes and points between nodes at every row."""
    scene = bead()
    rail = scene.beams[0]
    points = {f"{s:.9f}": (rail, float(s)) for s in Lines(fb.compile_scene(scene).names, 8, refine=3).s}
    return fb.simulate(fb.compile_scene(scene), t_end=0.2, step=0.02, every=1, output=fb.Output(snapshots=11), points=points,
                       progress=False)


def steps_of(path: Path, name: str) -> np.ndarray:
    """An array of the file [steps, points, ...], by its offsets."""
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        n = int(root["NumberOfPoints"][0])
        offsets = root["Steps/PointOffsets" if name == "Points" else f"Steps/PointDataOffsets/{name}"][:]
        data = root["Points" if name == "Points" else f"PointData/{name}"][:]
        return np.stack([data[k:k + n] for k in offsets])


def test_points_are_the_nodes_and_directors_theirs(tmp_path: Path) -> None:
    run = flight()
    run.to_vtk(tmp_path / "run.vtkhdf", refine=1, double=True)
    # the mass and the slider's point, then the nodes of the beam
    nodes = [run.names["masses"][0]["node"], run.names["slider_nodes"][0], *range(7)]
    np.testing.assert_array_equal(steps_of(tmp_path / "run.vtkhdf", "Points"), run.phi[:, nodes])
    for i in range(3):
        np.testing.assert_array_equal(steps_of(tmp_path / "run.vtkhdf", f"d{i + 1}"), run.directors[:, nodes, i])
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        np.testing.assert_array_equal(file["VTKHDF/Steps/Values"][:], run.t_snap)
        assert file["names/beam"][:].tolist() == [b"rail"] and file["names/slider"][:].tolist() == [b"run"]
        assert file["VTKHDF/PointData/kind"][:].tolist() == [2, 3] + 7 * [0]


def test_a_mode_is_a_time_series_of_its_period(tmp_path: Path) -> None:
    n = 3
    still, x = np.column_stack((np.arange(3.0), np.zeros((n, 2)))), np.array([[[0, 0, 0], [0, 0.6, 0], [0, 0, 1j]]])
    found = DampedModes(np.array([-0.3 + 5.0j]), x, np.zeros_like(x), np.zeros((1, 0)), np.zeros(1), None, {"scene": "rod"},
                        {"beams": [{"name": "rod", "first": 0, "count": n}]}, still, np.tile(np.eye(3), (n, 1, 1)))
    found.motion(0, amplitude=0.25, frames=4).to_vtk(tmp_path / "mode.vtkhdf", refine=1, double=True)
    parts = 0.5 * np.array([x[0].real, -x[0].imag, -x[0].real, x[0].imag])
    np.testing.assert_allclose(steps_of(tmp_path / "mode.vtkhdf", "Points"), still + parts, atol=1e-15)
    # a period without decay
    np.testing.assert_allclose(steps_of(tmp_path / "mode.vtkhdf", "velocity"), 5.0 * np.roll(parts, -1, axis=0), atol=1e-14)
    with h5py.File(tmp_path / "mode.vtkhdf") as file:
        np.testing.assert_allclose(file["VTKHDF/Steps/Values"][:], 0.1 * np.pi * np.arange(4), rtol=1e-14)


def test_points_between_nodes_lie_on_the_curve_that_the_beam_is(tmp_path: Path) -> None:
    run = flight()
    run.to_vtk(tmp_path / "run.vtkhdf", refine=3, double=True)
    found = steps_of(tmp_path / "run.vtkhdf", "Points")[:, 2:]
    assert found.shape[1] == 19
    # what the run recorded there
    np.testing.assert_allclose(found, run.series["points"], atol=1e-14)


@pytest.mark.parametrize("degree", [2, 3])
def test_splines_are_drawn_as_curves_and_not_by_their_control_points(degree: int) -> None:
    beam = fb.Beam.arc("arc", (1, 0, 0), (0, 1, 0), (-1, 0, 0), radius=1.0, angle=3.0, section=SECTION, elements=8, degree=degree,
                       interpolation="bspline")
    model = fb.compile_scene(fb.Scene(beam))
    lines = Lines(model.names, model.n_nodes, refine=2)
    x = lines.points(model.state().q.reshape(-1, 4, 3)[:, 0])
    control = model.q0.reshape(-1, 12)[:, :3]
    assert np.abs(np.linalg.norm(x, axis=1) - 1.0).max() < 2e-3 < np.abs(np.linalg.norm(control, axis=1) - 1.0).max()


def test_forces_on_sliders_are_those_of_the_rows(tmp_path: Path) -> None:
    run = flight()
    run.to_vtk(tmp_path / "run.vtkhdf", double=True)
    force = steps_of(tmp_path / "run.vtkhdf", "force")
    np.testing.assert_array_equal(force[:, 1], run.slider("run")["force"])
    assert not force[:, 0].any() and not force[:, 2:].any() and np.abs(force[:, 1]).max() > 0.0


@cache
def watched() -> Result:
    """The flight once more, with velocities and points between nodes."""
    scene = bead()
    rail = scene.beams[0]
    model = fb.compile_scene(scene)
    points = {f"{s:.9f}": (rail, float(s)) for s in Lines(model.names, 8, refine=3).s}
    return fb.simulate(model, t_end=0.2, step=0.02, every=1, output=fb.Output(snapshots=11), points=points,
                       observe=("velocity", "slider"),
                       progress=False)


@pytest.mark.parametrize("surface", [False, True])
def test_velocities_are_those_of_the_run_also_after_a_file(surface: bool, tmp_path: Path) -> None:
    run = watched()
    run.save(tmp_path / "run.h5")
    fb.load_result(tmp_path / "run.h5").to_vtk(tmp_path / "run.vtkhdf", refine=3, double=True, surface=surface)
    found = steps_of(tmp_path / "run.vtkhdf", "velocity")
    nodes = [run.names["masses"][0]["node"], run.names["slider_nodes"][0]]
    np.testing.assert_array_equal(found[:, :2], run.velocities[:, nodes])
    along = found[:, 2:].reshape(11, 19, -1, 3)
    # what the run recorded at these points; all corners of a section move like its axis
    np.testing.assert_allclose(along, np.broadcast_to(run.series["point_velocity"][:, :, None], along.shape), atol=1e-13)
    assert np.abs(run.velocities).max() > 0.1


def test_without_velocities_shapes_tell_them_and_the_name_says_so(tmp_path: Path) -> None:
    t = np.array([0.0, 0.1, 0.3, 0.35])
    path = np.stack((2.0 + 3.0 * t - 4.0 * t**2, 0 * t, t), axis=1)[:, None, :]
    run = Result(t=t, t_snap=t, phi=np.repeat(path, 2, axis=1), directors=np.tile(np.eye(3), (4, 2, 1, 1)),
                 names={"beams": [{"name": "b", "first": 0, "count": 2, "element_ends": [0, 1]}]})
    run.to_vtk(tmp_path / "run.vtkhdf", double=True)
    # exact for motions with constant acceleration, whatever the distances of the shapes
    found = steps_of(tmp_path / "run.vtkhdf", "velocity_from_shapes")
    np.testing.assert_allclose(found[:, 0], np.stack((3.0 - 8.0 * t, 0 * t, 1.0 + 0 * t), axis=1), atol=1e-13)
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        assert "velocity" not in file["VTKHDF/PointData"]


def test_equilibria_have_no_velocities(tmp_path: Path) -> None:
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 1e-3))))
    rest = fb.solve_static(model, levels=(0.3, 0.6, 1.0), observe=("velocity",))
    assert rest.velocities is None and len(rest.t_snap) > 3
    rest.to_vtk(tmp_path / "rest.vtkhdf")
    with h5py.File(tmp_path / "rest.vtkhdf") as file:
        assert not [name for name in file["VTKHDF/PointData"] if "velocity" in name]


@pytest.mark.parametrize("surface", [False, True])
def test_section_forces_stand_at_the_points_of_their_beam(surface: bool, tmp_path: Path) -> None:
    scene = bead()
    model, rail = fb.compile_scene(scene), scene.beams[0]
    run = fb.simulate(model, t_end=0.2, step=0.02, every=1, output=fb.Output(snapshots=5), progress=False)
    s = Lines(model.names, 8, refine=3).s
    sections = fb.section_forces(model, run, rail, s[::-1])
    run.to_vtk(tmp_path / "run.vtkhdf", refine=3, double=True, surface=surface, sections={"rail": sections})
    for name, parts in (("section_force", "N Q2 Q3"), ("section_moment", "T M2 M3")):
        found = steps_of(tmp_path / "run.vtkhdf", name)
        assert np.isnan(found[:, :2]).all()
        expected = np.stack([getattr(sections, x)[:, ::-1] for x in parts.split()], axis=-1)
        along = found[:, 2:].reshape(len(run.t_snap), 19, -1, 3)
        np.testing.assert_array_equal(along, np.broadcast_to(expected[:, :, None], along.shape))
    for wrong, message in (({"rial": sections}, "'rial' is not a beam"), ({"rail": 3}, "must be a dict of "
                                                                                       "names"), ([1], "a dict"),
                           ({"rail": fb.section_forces(model, run.state, rail)}, "1 other shapes than the 5")):
        with pytest.raises(fb.SceneError, match=message):
            run.to_vtk(tmp_path / "wrong.vtkhdf", sections=wrong)
    assert not (tmp_path / "wrong.vtkhdf").exists()


def sized(section: fb.Section) -> Result:
    """One bent beam of this section, at rest."""
    beam = fb.Beam.arc("arc", (1, 0, 0), (0, 1, 0), (-1, 0, 0), radius=1.0, angle=1.0, section=section, elements=2)
    model = fb.compile_scene(fb.Scene(beam))
    q = model.q0.reshape(-1, 4, 3)
    return Result(t=[0.0], names=model.names, t_snap=[0.0], phi=q[None, :, 0], directors=q[None, :, 1:])


@pytest.mark.parametrize(("section", "half"), [
    (fb.Section.circle(radius=0.05, E=1e6, rho=1e3), (0.05, 0.05)),
    (fb.Section.tube(radius=0.05, thickness=0.01, E=1e6, rho=1e3), (0.05, 0.05)),
    (fb.Section.rectangle(height=0.08, width=0.02, E=1e6, rho=1e3), (0.04, 0.01)),
    # solid circle of radius 0.1, by its stiffness
    (fb.Section(EA=4.0, GA2=1, GA3=1, GJ=1, EI2=0.01, EI3=0.01, rhoA=1, rhoI2=0, rhoI3=0), (0.1, 0.1))])
def test_skins_have_the_size_of_the_section_and_are_closed(section: fb.Section, half: tuple[float, float],
                                                           tmp_path: Path) -> None:
    run = sized(section)
    run.to_vtk(tmp_path / "run.vtkhdf", surface=True, refine=1, double=True)
    corners = steps_of(tmp_path / "run.vtkhdf", "Points")[0].reshape(7, -1, 3)
    arms = np.einsum("nkc,nic->nki", corners - run.phi[0, :, None], run.directors[0])
    np.testing.assert_allclose(np.abs(arms).max(axis=(0, 1)), (0.0, *half), atol=1e-14)
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        faces = np.split(file["VTKHDF/Polygons/Connectivity"][:], file["VTKHDF/Polygons/Offsets"][1:-1])
        assert file["VTKHDF/Polygons/NumberOfCells"][0] == len(faces) == len(file["VTKHDF/CellData/part"])
        assert file["VTKHDF/PointData/radius"][0] == pytest.approx(np.sqrt(half[0] * half[1]))
    edges = {}
    for face in faces:
        for a, b in zip(face, np.roll(face, -1)):
            edges[a, b] = edges.get((a, b), 0) + 1
    # every edge is met once in each direction: closed, and all faces look to the same side
    assert all(n == 1 and edges.get((b, a)) == 1 for (a, b), n in edges.items())
    volume = sum(np.linalg.det(corners.reshape(-1, 3)[[face[0], face[i], face[i + 1]]]) for face in faces
                 for i in range(1, len(face) - 1)) / 6.0
    assert volume > 0.0


def test_nets_are_one_line_a_beam_with_the_sections_of_its_beams(tmp_path: Path) -> None:
    thin, thick = (fb.Section.circle(radius=r, E=1e6, rho=1e3) for r in (0.01, 0.02))
    net = fb.Net("net", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1), (1, 2), (2, 0)], section=[thin, thick],
                 section_of=[0, 1, 0], elements=2, degree=2)
    model = fb.compile_scene(fb.Scene(net))
    q = model.q0.reshape(-1, 4, 3)
    run = Result(t=[0.0], names=model.names, t_snap=[0.0, 1.0], phi=[q[:, 0], q[:, 0] + 1.0], directors=[q[:, 1:]] * 2)
    run.to_vtk(tmp_path / "run.vtkhdf", double=True)
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        assert file["VTKHDF/Lines/Offsets"][:].tolist() == [0, 5, 10, 15]
        assert file["VTKHDF/CellData/part"][:].tolist() == [0, 0, 0]
        assert file["VTKHDF/PointData/radius"][::5].tolist() == [0.01, 0.02, 0.01]
    np.testing.assert_array_equal(steps_of(tmp_path / "run.vtkhdf", "Points"), run.phi)


def test_bad_places_and_results_without_shapes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = flight()
    with pytest.raises(fb.SceneError, match=r"must end in .vtkhdf, got 'run.pvd'; .pvd and .vtu are older"):
        run.to_vtk(tmp_path / "run.pvd")
    with pytest.raises(fb.SceneError, match=r"no snapshots; record some with simulate\(..., output=Output\(snapshots=100\)\)"):
        Result(t=[0.0]).to_vtk(tmp_path / "run.vtkhdf")
    with pytest.raises(fb.ResultFileError, match="create it first"):
        run.to_vtk(tmp_path / "none" / "run.vtkhdf")
    run.to_vtk(tmp_path / "run.vtkhdf")
    before = (tmp_path / "run.vtkhdf").read_bytes()
    with pytest.raises(fb.ResultFileError, match="exists already; pass overwrite=True"):
        run.to_vtk(tmp_path / "run.vtkhdf")
    monkeypatch.setattr("shutil.disk_usage", lambda place: type("Free", (), {"free": 1000})())
    with pytest.raises(fb.ResultFileError, match="needs 1 MB, but only 0 MB are free"):
        run.to_vtk(tmp_path / "run.vtkhdf", overwrite=True)
    # nothing is left behind, and the file is as it was
    assert [path.name for path in tmp_path.iterdir()] == ["run.vtkhdf"] and (tmp_path / "run.vtkhdf").read_bytes() == before


@pytest.mark.parametrize("change", [
    {"s": [0.0]}, {"s": "words!!"}, {"element_ends": [0, 6]}, {"degree": 10**9}, {"degree": "x"}, {"spline_ends": [0, 1, 1]},
    {"spline_ends": list(range(99))}, {"half_2": -1.0}, {"half_2": float("nan")}, {"half_3": "wide"}, {"round": [1]}])
def test_names_of_foreign_files_never_do_harm(change: dict[str, Any], tmp_path: Path) -> None:
    run = flight()
    names = {**run.names, "beams": [{**run.names["beams"][0], **change}]}
    strange = Result(t=run.t, names=names, series=run.series, t_snap=run.t_snap, phi=run.phi, directors=run.directors)
    strange.to_vtk(tmp_path / "run.vtkhdf", surface=True)
    assert np.isfinite(steps_of(tmp_path / "run.vtkhdf", "Points")).all()


# --- read by the library that owns the format --------------------------------------------------------------------------------
def reader(path: Path) -> tuple[Any, Any]:
    vtk = pytest.importorskip("vtk")
    found = vtk.vtkHDFReader()
    assert found.CanReadFile(str(path))
    found.SetFileName(str(path))
    found.UpdateInformation()
    return found, found.GetOutputInformation(0).Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())


@pytest.mark.parametrize("surface", [False, True])
def test_vtk_plays_the_series(surface: bool, tmp_path: Path) -> None:
    support = pytest.importorskip("vtk.util.numpy_support")
    run = flight()
    run.to_vtk(tmp_path / "run.vtkhdf", surface=surface)
    found, times = reader(tmp_path / "run.vtkhdf")
    assert list(times) == run.t_snap.tolist()
    for k in (0, 10, 4):
        found.UpdateTimeStep(times[k])
        data = found.GetOutputDataObject(0)
        assert data.GetClassName() == "vtkPolyData" and data.GetNumberOfVerts() == 2
        assert (data.GetNumberOfLines(), data.GetNumberOfPolys() > 50) == ((0, True) if surface else (1, False))
        expected = steps_of(tmp_path / "run.vtkhdf", "Points")[k]
        np.testing.assert_array_equal(support.vtk_to_numpy(data.GetPoints().GetData()), expected)
        np.testing.assert_allclose(expected[0], run.phi[k, 7], rtol=1e-6)
        velocity = support.vtk_to_numpy(data.GetPointData().GetArray("velocity_from_shapes"))
        np.testing.assert_array_equal(velocity, steps_of(tmp_path / "run.vtkhdf", "velocity_from_shapes")[k])
        force = support.vtk_to_numpy(data.GetPointData().GetArray("force"))[1]
        np.testing.assert_allclose(force, run.slider("run")["force"][k], rtol=1e-6)
        assert support.vtk_to_numpy(data.GetCellData().GetArray("kind"))[:3].tolist() == [2, 3, 0]


DRAW = """
import sys, vtk
found = vtk.vtkHDFReader(); found.SetFileName(sys.argv[1]); found.UpdateInformation(); found.UpdateTimeStep(0.1)
mapper, actor, scene, window = vtk.vtkPolyDataMapper(), vtk.vtkActor(), vtk.vtkRenderer(), vtk.vtkRenderWindow()
mapper.SetInputConnection(found.GetOutputPort()); mapper.ScalarVisibilityOff(); actor.SetMapper(mapper)
actor.GetProperty().SetColor(0.1, 0.3, 0.8); scene.AddActor(actor); scene.SetBackground(1, 1, 1)
window.SetOffScreenRendering(1); window.SetSize(320, 240); window.AddRenderer(scene); scene.ResetCamera(); window.Render()
grab, png = vtk.vtkWindowToImageFilter(), vtk.vtkPNGWriter()
grab.SetInput(window); png.SetFileName(sys.argv[2]); png.SetInputConnection(grab.GetOutputPort()); png.Write()
"""


def test_vtk_draws_the_skins(tmp_path: Path) -> None:
    pytest.importorskip("vtk")
    from matplotlib.image import imread
    flight().to_vtk(tmp_path / "run.vtkhdf", surface=True)
    done = subprocess.run([sys.executable, "-c", DRAW, str(tmp_path / "run.vtkhdf"), str(tmp_path / "run.png")],
                          capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(SOURCE)})
    if done.returncode:
        pytest.skip("vtk cannot draw without a display here")
    picture = imread(tmp_path / "run.png")[..., :3]
    drawn = picture.min(axis=2) < 0.9
    # a beam of 3 m with half sizes of 0.45 and 0.49 m: a wide band across the picture
    assert 0.05 < drawn.mean() < 0.7 and picture[drawn][:, 2].mean() > picture[drawn][:, 0].mean() + 0.2


# --- tables ------------------------------------------------------------------------------------------------------------------
def test_tables_have_a_column_for_every_number_of_a_row() -> None:
    pandas = pytest.importorskip("pandas")
    run = flight()
    table = run.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and len(table) == len(run.t) and table.index.name == "t"
    assert len(table.columns) == sum(x[0].size for x in run.series.values()) and len(set(table.columns)) == len(table.columns)
    np.testing.assert_array_equal(table["total"], run.series["total"])
    np.testing.assert_array_equal(table["lin_mom.y"], run.series["lin_mom"][:, 1])
    np.testing.assert_array_equal(table["s_slide[run]"], run.slider("run")["s"])
    np.testing.assert_array_equal(table["contact_force[run].z"], run.slider("run")["force"][:, 2])
    np.testing.assert_array_equal(table["points[0.000000000].x"], run.point("0.000000000")[:, 0])
    assert table.attrs["scene"] == "bead"


def test_three_sliders_are_not_three_components() -> None:
    from fastbeam.results.exports import columns_of
    names = {"sliders": ["a", "b", "c"]}
    columns = columns_of({"gap": np.zeros((2, 3)), "lin_mom": np.ones((2, 3)), "contact_force": np.zeros((2, 3, 3))}, names)
    assert list(columns)[:6] == ["gap[a]", "gap[b]", "gap[c]", "lin_mom.x", "lin_mom.y", "lin_mom.z"]
    assert list(columns)[-1] == "contact_force[c].z" and len(columns) == 15


def test_columns_are_named_after_what_they_belong_to() -> None:
    from fastbeam.results.exports import columns_of
    names = {"points": ["tip"], "reactions": ["wall"], "joints": ["hinge", "hinge"], "sliders": ["a"]}
    columns = columns_of({"point_velocity": np.zeros((2, 1, 3)), "section_moment": np.zeros((2, 1, 3)),
                          "reaction": np.arange(12.0).reshape(2, 1, 2, 3), "joint_value": np.zeros((2, 2))}, names)
    assert list(columns) == ["point_velocity[tip].x", "point_velocity[tip].y", "point_velocity[tip].z", "section_moment[tip].T",
                             "section_moment[tip].M2", "section_moment[tip].M3", "reaction[wall].force.x",
                             "reaction[wall].force.y", "reaction[wall].force.z", "reaction[wall].moment.x",
                             "reaction[wall].moment.y", "reaction[wall].moment.z", "joint_value[0]", "joint_value[1]"]
    assert columns["reaction[wall].moment.y"].tolist() == [4.0, 10.0]


def test_without_pandas_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(fb.BackendError, match="pip install pandas"):
        flight().to_dataframe()
