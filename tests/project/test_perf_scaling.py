"""Scaling, roofline and goals of perf/limits: counted operations and bytes against sums by hand, verdicts on made-up numbers, and
quick forms for real."""
from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.algebra.dimensions import PLANE, SPACE
from fastbeam.kernels.beams import element_loop as beam
from fastbeam.kernels.beams import green_lagrange, simo_reissner, strains
from fastbeam.kernels.beams import strain_measures as strain_sets
from fastbeam.kernels.beams.motions import OverStep
from fastbeam.kernels.layout import layout_of
from fastbeam.kernels.linalg import chain
from fastbeam.kernels.terms import Conserving
from fastbeam.model.model import Model
from fastbeam.model.workspace import work_of
from fastbeam.stepping.stepper import Stepper
from perf import printing
from perf.cases import net_step
from perf.limits import ceilings, counting, goals, parts, roofline, scaling, traffic

ROOT = Path(__file__).resolve().parents[2]
STEP = 1e-3


def compiled(elements: int, degree: int, **options: Any) -> Model:
    return fb.compile_scene(scaling.chain_scene(elements, degree), planar=False, **options)


def run(model: Model, **options: Any) -> tuple[Stepper, float, float]:
    """(stepper, iterations a step, share of mixed iterations) of two steps."""
    stepper = Stepper(model, np.ones(1), **options)
    outcome = stepper.advance(0.0, STEP, 2)
    assert outcome.steps == 2
    return stepper, outcome.iterations / 2, traffic.mixed_share(stepper, outcome)


# --- operations -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_operations_of_blocks_are_those_of_the_textbook(n: int) -> None:
    assert counting.lu(n) == n + sum(m + 2 * m * m for m in range(n))
    assert counting.triangular(n) == 2 * n * (n - 1) + n
    assert counting.product(n) == 2 * n * n


def test_operations_of_short_kernels_are_those_counted_by_hand() -> None:
    x = np.zeros(1000)
    # weight (C e) for six strains: a product, a sum to zero, the weight; coupled six products and sums
    simo, green = strain_sets.SIMO_REISSNER, strain_sets.GREEN_LAGRANGE
    assert counting.count(strains.stresses, green.law, green, x, 0, False, x, 0, 0, 0) == 6 * 3
    assert counting.count(strains.stresses, green.law, green, x, 0, True, x, 0, 0, 0) == 6 * (6 * 2 + 1)
    # (4.7): a product; two products and differences; three sums of products and products, a factor
    assert counting.count(strains.stresses, simo.law, simo, x, 0, False, x, 0, 0, 0) == 6 * 3 + 1 + 2 * 2 + 3 * 3 + 1
    # position: factor and sum of a vector; three directors and their derivatives
    assert counting.count(strains.interpolate, x, 0, 2, 192, x, 0, 0) == 2 * (6 + 3 * 12)
    # (2.2): twelve products of vectors, a half, three differences and halves, two sums and a factor; (2.1): seven, a half, one
    # difference and half, a sign
    assert counting.count(simo_reissner.forms, simo, x, 0, 0) == 12 * 5 + 1 + 3 * 2 + 3
    assert counting.count(green_lagrange.forms, green, x, 0, 0) == 7 * 5 + 1 + 2 + 1
    at = layout_of(SPACE, 2, 1)
    assert counting.count(beam.add_inertia_forces, Conserving(), x, x, at, SPACE) == 2 * (2 * 3 * 6 + 3 * (3 + 3))
    # (2.1): two weighted differences of vectors, four cross products with what goes around them
    assert counting.count(green_lagrange.strain_rows, x, 0, 0, 0.5, 0.5, 0) == 2 * 9 + (2 * 9 + 3) + 2 * 9 + 3 * 3 + 2 * 3
    # (2.2): three weighted differences, a factor and two cross products, three differences of two, a sum of three
    rows = 3 * 9 + 3 + 2 * 9 + 3 * (2 * 9 + 3) + 3 * 9 + 2 * 3 + 3
    assert counting.count(simo_reissner.form_rows, x, 0, 0, 0.5, 0.5, 0) == rows
    # the same from cross products of pairs: a factor and two cross products; of another node a factor of two products and a
    # difference, one of a product, four vectors times these and their sums
    assert counting.count(simo_reissner.rows_of_pairs, x, 0, 2, 0, x, 0, 0, 0, 0) == 2 + 3 + 2 * 9 + (3 + 1) + 4 * 6
    # of three directors: moment, a sum of forces, a dyad; then the trace, less it, a half, and the sum
    assert counting.count(beam.project_node, x, at, 0, SPACE) == 3 * ((9 + 3) + 3 + (9 + 9)) + (2 + 3 + 9 + 9)


def test_an_operation_without_a_counter_is_named() -> None:
    model = compiled(8, 1)
    work = work_of(model)
    with pytest.raises(LookupError, match="'perp' has no counter"):
        motion = OverStep(Conserving(), model.q0, work.dphi, model.v0, work.increment, work.reference_strains, 1.0, 1.0)
        counting.count(beam.evaluate_group, model.simo, 0, layout_of(PLANE, 2, 1), strain_sets.SIMO_REISSNER, motion,
                       work.scratch, PLANE)


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_formulas_of_the_elimination_agree_with_its_source(degree: int) -> None:
    model = compiled(9, degree)
    assert counting.inner_elimination(model) == (counting.inner_elimination_formula(degree + 1) if degree > 1 else 0)
    for options in ({}, {"eliminate_inner": False}):
        model = compiled(9, degree, **options)
        work, plan = work_of(model), model.pattern.plan
        found = counting.count(chain.factor, plan, work.blocks, work.pivots, chain.OneSide(work.panel), model.dofs)
        found += counting.count(chain.back_substitute, plan, work.blocks, chain.OneSide(work.panel), model.dofs)
        # the right-hand side goes along in the columns that pad a block, but for sums with what is known of it, the rows that
        # have no other block, and what reaches blocks behind the first
        others = np.diff(plan.start)
        beside = np.sum(others > 0) * 6 + np.sum(others == 0) * counting.triangular(6)
        beside += np.sum(others + np.maximum(others - 1, 0)) * counting.product(6)
        assert counting.elimination(plan, 6, 8, 0) + beside == found
        assert counting.elimination(plan, 6) < found


def test_what_follows_the_kernel_is_elimination_and_sums() -> None:
    model = compiled(9, 3)
    # rows and blocks of the two end nodes are added up
    assert counting.after_kernel(model) == counting.inner_elimination(model) + 2 * 6 + 4 * 36
    assert counting.element_kernel(model, 0.0) < counting.element_kernel(model, 0.5) < counting.element_kernel(model, 1.0)


def test_operations_of_condensed_beams_contain_those_of_their_elements() -> None:
    model = fb.compile_scene(net_step.square_net(2, 3, 2, "rigid"), planar=False, condense=True)
    stepper = Stepper(model, np.ones(1), threads=1)
    assert model.condensed_elements == 24
    whole, recovery = counting.condensed_beams(stepper, 1.0), counting.recovery_of_beams(stepper)
    inner = counting.inner_elimination_formula(3)
    # two nodes a beam: factors, three triangular solutions of 13 columns in all, six products of blocks and two of columns
    node = counting.lu(6) + 13 * counting.triangular(6) + 4 * 6 * counting.product(6) + 2 * counting.product(6)
    assert whole - recovery > 24 * (counting.element_kernel(compiled(8, 2), 1.0) + inner) + 8 * 2 * node
    # y of a node is taken over with a factor; products with its two neighbours; inner nodes the same with theirs
    assert recovery == 8 * (2 * (6 + 2 * counting.product(6)) + 3 * counting.inner_recovery(3))


# --- bytes ------------------------------------------------------------------------------------------------------------
def arrays(x: Any) -> int:
    """Bytes of all arrays below x."""
    return x.nbytes if isinstance(x, np.ndarray) else sum(map(arrays, x)) if isinstance(x, tuple) else 0


def test_bytes_of_the_passes_of_a_chain() -> None:
    elements = 12
    model = compiled(elements, 1)
    stepper, iterations, mixed = run(model)
    assert mixed == 1.0
    by_name = {p.name: p for p in traffic.passes(stepper, iterations, mixed)}
    nodes = elements + 1
    q, blocks, rows = 96 * nodes, 384 * (3 * nodes - 2 + 1), 64 * (nodes + 1)
    found = by_name["elements"]
    assert found.written == rows + blocks
    # coordinates, velocities, increments and Cayley vectors, the residual; for the line rows of increments
    assert found.read == arrays(model.simo) + model.reference_strains.nbytes + 2 * q + 48 * nodes + 2 * rows + blocks
    assert by_name["factors"].written == blocks - 384 + 48 * nodes + 48 * nodes
    assert by_name["back substitution"].written == 48 * nodes
    assert by_name["increments"].read == 8 * nodes + 48 * nodes + rows
    assert by_name["accept"].often == pytest.approx(1.0 / iterations)
    assert by_name["accept"].moved == pytest.approx((4 * q + 48 * nodes) / iterations)
    assert "recover the inner nodes" not in by_name


def every_array(x: Any) -> list[np.ndarray]:
    """All arrays below x."""
    return [x] if isinstance(x, np.ndarray) else sum(map(every_array, x), []) if isinstance(x, tuple) else []


def place(x: np.ndarray) -> int:
    """Where an array begins in memory."""
    return int(x.__array_interface__["data"][0])


@pytest.mark.parametrize("case", ["chain", "inner nodes", "joints", "net"])
def test_passes_write_what_changes(case: str) -> None:
    """All arrays of a run whose values change in a step are written by a pass."""
    if case in ("chain", "inner nodes"):
        model, options = compiled(12, 1 if case == "chain" else 3), {}
    else:
        scene = net_step.square_net(4, 3, 2, "rigid")
        model = fb.compile_scene(scene, planar=False, condense=case == "net", solver="sparse")
        options = {"threads": 1}
    stepper, *rest = run(model, **options)
    held = [stepper.core_state, stepper.work, stepper.inner, getattr(stepper.parts, "subs", None)]
    if stepper.linear.tables is not None:
        t = stepper.linear.tables
        held.append((t.data, t.b, t.x, t.r, t.y))
    # scratch stays in a cache, and there are arrays of a few numbers
    small = {place(x) for x in (stepper.work.scratch, stepper.work.increment.control)}
    arrays_of_run = {place(x): x for x in every_array(tuple(held)) if place(x) not in small and x.size > 4}
    before = {key: x.copy() for key, x in arrays_of_run.items()}
    assert stepper.advance(0.0, STEP, 1).steps == 1
    changed = {key for key, x in arrays_of_run.items() if not np.array_equal(x, before[key])}
    written = {place(x) for p in traffic.passes(stepper, *rest) for x in every_array(p.writes)}
    assert changed <= written and len(changed) > 8


def test_bytes_grow_with_the_elements_only() -> None:
    """Of the sum of all passes, from 800 to 1600 elements of degree 2, with inner nodes."""
    moved = []
    for elements in (800, 1600):
        stepper, *rest = run(compiled(elements, 2))
        moved.append(sum(p.moved for p in traffic.passes(stepper, *rest)) / elements)
    assert moved[1] == pytest.approx(moved[0], rel=0.01)


@pytest.mark.parametrize("condense", [False, True])
def test_kept_bytes_are_those_of_all_arrays(condense: bool) -> None:
    scene = net_step.square_net(4, 3, 2, "rigid")
    stepper, *rest = run(fb.compile_scene(scene, planar=False, condense=condense), threads=1)
    kept, work = traffic.kept(stepper), stepper.work
    # theta counts once, and loads and reference strains with the tables
    assert work.increment.theta is work.theta and np.shares_memory(work.f_ext, stepper.core.loads.first)
    assert work.reference_strains is stepper.core.reference_strains
    found = sum(map(arrays, (stepper.core_state, work, stepper.inner))) - work.theta.nbytes - work.f_ext.nbytes
    found -= work.reference_strains.nbytes
    if condense:
        assert kept["factors"] > arrays(stepper.parts.subs.store) + arrays(stepper.parts.subs.ends)
        found += sum(map(arrays, (stepper.parts.subs.store, stepper.parts.subs.ends)))
        # residuals between the ends stay as they were made
        ends = 8 * stepper.core.pattern.n
        assert work.r[:ends].any() and not work.r[ends:].any()
        found -= work.r[ends:].nbytes
    if stepper.inner is not None:
        # counted with the tables
        found -= sum(map(arrays, (stepper.inner.where, stepper.inner.rows, stepper.inner.element, stepper.inner.first,
                                  stepper.inner.state)))
    assert sum(kept.values()) - kept["tables"] == found
    assert kept["tables"] > arrays(stepper.core.simo) + work.reference_strains.nbytes
    names = {p.name for p in traffic.passes(stepper, *rest)}
    assert ("elements, condensed" in names, "elements" in names) == (condense, not condense)


def test_scenes_with_sliders_are_not_counted() -> None:
    rail = fb.Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=net_step.SECTION, elements=2)
    mass = fb.PointMass("mass", mass=0.1)
    model = fb.compile_scene(fb.Scene(rail, mass, fb.Slider("run", mass, rail, at=0.4)), planar=False)
    with pytest.raises(ValueError, match="without sliders"):
        traffic.passes(Stepper(model, np.ones(1)), 3.0, 1.0)


def test_counts_in_the_documentation_are_those_of_the_source() -> None:
    lines = (ROOT / "docs" / "reports" / "performance.md").read_text(encoding="utf-8").splitlines()
    said = {cells[1]: [float(x) for x in cells[2:5]] for cells in ([x.strip() for x in line.split("|")] for line in lines)
            if len(cells) == 6 and all(x[:1].isdigit() and " " not in x for x in cells[2:5])}
    found: dict[str, list[float]] = {}
    elements = 2000
    for degree in (1, 2, 3):
        small, (stepper, _, _) = compiled(8, degree), run(compiled(elements, degree))
        moved = sum(p.moved for p in traffic.passes(stepper, 2.0, 1.0)) / elements
        ends = counting.lu(6) + 7 * counting.triangular(6) + 8 * counting.product(6)
        parts_of = [counting.element_kernel(small, 1.0), counting.inner_elimination(small),
                    counting.after_kernel(small) - counting.inner_elimination(small), ends,
                    counting.inner_recovery(degree + 1) + degree * counting.node_loops(small)]
        values = [parts_of[0], counting.element_kernel(small, 0.0), *parts_of[1:], moved, sum(parts_of) / moved,
                  1e-3 * traffic.kept(stepper)["factors"] / elements]
        for name, value in zip(said, values, strict=True):
            found.setdefault(name, []).append(value)
    for name, values in found.items():
        rounded = max(said[name]) < 10.0 or "bytes" in name
        np.testing.assert_allclose(said[name], values, rtol=0.01 if rounded else 0.0, err_msg=name)


# --- the machine ------------------------------------------------------------------------------------------------------
def test_loops_that_measure_the_machine_do_their_work() -> None:
    x = np.full(112, 0.5)
    x[16:] = np.arange(96) / 10.0
    # a -> (a + 1) / 2 goes to 1
    assert ceilings.six_chains(x, 100) == pytest.approx(48.0, abs=1e-12)
    assert ceilings.twelve_chains(x, 100) == pytest.approx(96.0, abs=1e-12)
    assert ceilings.six_chains(x, 1) == pytest.approx(0.5 * (x[16:64].sum() + 48.0))
    out, a, b = np.zeros(64), np.arange(64.0), np.ones(64)
    ceilings.triad(out, a, b, 8, 48, 2)
    assert np.array_equal(out[8:48], a[8:48] + 0.5) and not out[:8].any() and not out[48:].any()


def test_the_machine_has_a_peak_and_a_bandwidth() -> None:
    c = ceilings.Ceilings(2.0**20)
    assert c.peak() > 0.5 and c.bandwidth(30_000.0) > 0.5
    # memory is what is larger than all that counts as caches
    assert c.bandwidth() == c.bandwidth(1e12)
    assert len(c.facts()["bandwidth, GB/s"]) == 2


# --- the commands -----------------------------------------------------------------------------------------------------
def test_elements_are_counted_without_idle_lanes() -> None:
    assert scaling.number_of_elements(compiled(13, 2)) == 13
    assert scaling.number_of_elements(fb.compile_scene(scaling.net_scene(100, 1), planar=False, condense=True)) == 120


def made_up(elements: int, threads: int, us: float) -> dict[str, Any]:
    return {"kind": "chain", "degree": 2, "elements": elements, "threads": threads, "us": us, "limit": 0.5 * us, "bytes": 1e4,
            "iterations a step": 2.0, "peak": 9e3, "resident": 8e3,
            "kept": {"tables": 1e3, "state": 2e3, "work": 3e3, "factors": 1.5e3}}


def test_the_largest_ratio_is_that_of_long_chains_on_one_thread() -> None:
    rows = [made_up(100, 1, 9.0), made_up(1000, 1, 1.0), made_up(10_000, 1, 1.5), made_up(10_000, 2, 0.1)]
    assert scaling.ratio(rows) == pytest.approx(1.5)
    assert scaling.ratio(rows[:2]) is None


def test_a_table_and_a_picture_come_from_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    skipped = {"kind": "chain", "degree": 2, "elements": 100, "threads": 2, "skipped": "no condensed beams: one thread"}
    rows = [made_up(100, 1, 2.0), skipped, made_up(3000, 1, 2.5)]
    (tmp_path / "x.json").write_text(json.dumps({"rows": rows, "largest ratio": 1.25}))
    monkeypatch.setattr(sys, "argv", ["scaling.py", "--from", str(tmp_path / "x.json"), "--picture", str(tmp_path / "x.png"),
                                      "--markdown"])
    scaling.main()
    out = capsys.readouterr().out
    lines = [line for line in out.splitlines() if line.startswith("|")]
    assert len(lines) == 5 and {line.count("|") for line in lines} == {len(scaling.HEADER) + 1}
    assert "no condensed beams" in lines[3] and "smallest 1.25" in out
    assert (tmp_path / "x.png").stat().st_size > 10_000


def command(name: str, tmp_path: Path, *options: str) -> dict[str, Any]:
    """What a command of perf/limits writes to its JSON file."""
    file = tmp_path / "out.json"
    done = subprocess.run([sys.executable, str(ROOT / "perf" / "limits" / name), "--quick", "--json", str(file), *options],
                          capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(file.read_text())
    assert found["machine"]["cores"] >= 1
    return found


def test_tables_are_as_wide_as_their_texts_but_for_remarks() -> None:
    lines = [["a", "10", "x"], ["bcd", "no reason at all"]]
    assert printing.table(["k", "number", "z"], lines) == "k    number  z\na        10  x\nbcd  no reason at all"
    assert printing.table(["k", "number", "z"], lines, left=(0, 1)).splitlines()[1] == "a    10      x"
    assert printing.table(["k", "number", "z"], lines, True).splitlines()[3] == "| bcd | no reason at all |  |"


def test_scaling_measures_a_size_in_its_own_process(tmp_path: Path) -> None:
    row, = command("scaling.py", tmp_path, "--kinds", "chain", "--sizes", "300", "--threads", "1")["rows"]
    assert (row["kind"], row["elements"], row["degree"], row["threads"]) == ("chain", 300, 2, 1)
    assert row["us"] > 0.0 and row["limit"] > 0.0 and row["iterations a step"] >= 1.0
    assert row["bytes"] == pytest.approx(sum(row["passes"].values()))
    # the arrays are in memory, next to what the compiler of the scene needs; a MB of other things
    assert row["peak"] * 300 > 0.5 * sum(row["kept"].values()) * 300 - 1e6


def test_two_threads_are_for_condensed_beams() -> None:
    row = scaling.run_case("chain", 20, 1, 2, 0.01)
    assert row["skipped"] and "us" not in row


def test_a_part_is_bound_by_the_larger_limit_or_by_neither() -> None:
    part = roofline.Part("case", "part", 1, 1.0, 6000.0, 10_000.0, 10.0, 20.0)
    assert (part.at_peak, part.at_bandwidth) == pytest.approx((0.6, 0.5))
    assert (part.binds, part.share) == ("arithmetic", pytest.approx(0.6))
    part.peak = 20.0
    assert part.binds == "bandwidth"
    part.time = 1.1
    assert part.binds == "neither"


def test_roofline_of_a_small_chain_and_net(tmp_path: Path) -> None:
    rows = command("roofline.py", tmp_path)["parts"]
    for case in {row["case"] for row in rows}:
        whole, *rest = [row for row in rows if row["case"] == case]
        for name in ("operations", "moved"):
            assert sum(row[name] for row in rest) == pytest.approx(whole[name])
        # a time is a difference of others, in which a short one may be lost
        assert len(rest) == 3 and all(row["time"] >= 0.0 for row in rest)
        # nothing is faster than the machine
        assert 1e-3 * whole["operations"] / whole["time"] < whole["peak"]
    assert {row["case"].split(",")[0] for row in rows} == {"chain", "net"}


@pytest.mark.parametrize(("bound", "found", "at_most", "word"), [
    (0.3, 0.3, True, "met"), (0.3, 0.31, True, "missed"), (0.6, 0.7, False, "met"), (0.6, 0.5, False, "missed"),
    (None, None, True, "-"), (0.3, None, True, "-")])
def test_verdicts_on_goals(bound: float | None, found: float | None, at_most: bool, word: str) -> None:
    assert goals.Verdict("goal", bound, found, at_most=at_most).word == word


def test_blocks_in_band_storage_are_the_same_matrix() -> None:
    rng = np.random.default_rng(0)
    rows, columns = np.array([0, 0, 1, 1, 1, 2, 2]), np.array([0, 1, 0, 1, 2, 1, 2])
    blocks = rng.standard_normal((7, 2, 2)) + 4.0 * (rows == columns)[:, None, None] * np.eye(2)
    dense = np.zeros((6, 6))
    for block, i, j in zip(blocks, rows, columns):
        dense[2 * i:2 * i + 2, 2 * j:2 * j + 2] = block
    storage, k = goals.band(blocks, rows, columns, 3)
    assert k == 3
    right = rng.standard_normal(6)
    _, x = goals.dgbsv_time(storage, k, right, 0.0)
    np.testing.assert_allclose(x, np.linalg.solve(dense, right), rtol=1e-12)


def test_parts_of_an_iteration_solve_the_system_of_the_run() -> None:
    """Against a dense solution of the blocks that they assembled."""
    model = compiled(5, 2, eliminate_inner=False)
    p, pattern = parts.ChainParts(model, STEP), model.pattern
    dense = np.zeros((6 * pattern.n, 6 * pattern.n))
    for block, i, j in zip(p.matrix(), pattern.rows, pattern.columns):
        dense[6 * i:6 * i + 6, 6 * j:6 * j + 6] = block
    np.testing.assert_allclose(p.solution(), np.linalg.solve(dense, p.right()), rtol=1e-8, atol=1e-12 * abs(p.solution()).max())


def test_solutions_that_differ_are_not_compared() -> None:
    with pytest.raises(SystemExit, match="dgbsv differ"):
        goals.same(np.ones(3), np.array([1.0, 1.0, 1.1]), "dgbsv")


def test_goals_that_are_chosen_are_measured(tmp_path: Path) -> None:
    found = command("goals.py", tmp_path, "--only", "dgbsv", "memory", "lanes")["goals"]
    assert len([g for g in found if "dgbsv" in g["goal"]]) == 3
    assert all(g["found"] > 0.0 and g["verdict"] in ("met", "missed") for g in found if g["bound"] is not None)
    # degree 1: three blocks and exchanges of a row, to which half a per cent is added by the ends
    memory = next(g["found"] for g in found if g["goal"].endswith("factors, degree 1"))
    assert memory == pytest.approx(1e-3 * (3 * 384 + 48), rel=0.005)
    assert next(g for g in found if "eight lanes" in g["goal"])["note"].startswith("does not apply")


def test_a_goal_that_does_not_exist_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["goals.py", "--only", "speed"])
    with pytest.raises(SystemExit, match="no goal contains .'speed'.: choose from dgbsv, "):
        goals.main()


def test_shortest_times_leave_out_calls_on_nothing() -> None:
    calls: list[str] = []
    found = parts.shortest(lambda: calls.append("work"), 0.0, lambda: calls.append("prepare"), lambda: calls.append("empty"), 2)
    assert calls == 2 * ["prepare", "empty", "work"] and found >= 0.0


def test_mixed_iterations_follow_increments_that_are_too_long() -> None:
    stepper = SimpleNamespace(work=SimpleNamespace(increment=SimpleNamespace(control=np.array([0.0, 1e-6, -1.0]))))
    outcome = SimpleNamespace(sizes=np.array([1e-3, 1e-5, 1e-9, 0.0]))
    # the first guess counts like the first increment
    assert traffic.mixed_share(stepper, outcome) == pytest.approx(1.0)  # type: ignore[arg-type]
    outcome.sizes = np.array([1e-3, 1e-8, 1e-9, 0.0])
    assert traffic.mixed_share(stepper, outcome) == pytest.approx(2.0 / 3.0)  # type: ignore[arg-type]
