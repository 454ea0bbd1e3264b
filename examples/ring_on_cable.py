"""A ring slides down a cable that falls under its own weight and under the ring's.

A cable of 2 m is clamped at its left end, straight and at rest. A ring of 0.2 kg, half the mass of the cable, sits on it
without friction at s = 0.5 m. Gravity bends the cable, the bent cable lets the ring slide, the ring's weight and its
inertia push the cable on: where the ring is follows from the motion, the motion depends on where it is. The sliding
coordinate s(t) is therefore an unknown of every time step, together with the shape of the cable and the contact force.

Three things can be checked. The total energy is conserved: gravity is the only force from outside that does work, so the
drift has to stay at round-off (the momenta change, because gravity and the clamp act). The ring stays on the discrete
cable: so does its gap. And the motion agrees with that of another program with another beam theory and another time
integration, whose numbers are below.
"""
from __future__ import annotations

import time
from pathlib import Path

import numpy as np

import fastbeam as fb

# Exudyn 1.13.6, extrapolated in the step: planar Euler-Bernoulli cable, no shear, no rotary inertia. Uncertainty 3e-5 m; the
# different strain model adds differences of about 1e-4 m.
COLUMNS = ("t", "s", "ring x", "ring y", "tip x", "tip y")
PUBLISHED = np.array([
    [0.1, 0.501877, 0.500374, -0.036387, 1.997870, -0.044944],
    [0.2, 0.518694, 0.509025, -0.091818, 1.978163, -0.208851],
    [0.3, 0.566173, 0.544402, -0.142481, 1.892700, -0.629672],
    [0.4, 0.653789, 0.611900, -0.204876, 1.599328, -1.115669],
    [0.5, 0.792197, 0.663343, -0.384191, 1.166768, -1.476844],
    [0.6, 1.028508, 0.647275, -0.710336, 0.749815, -1.674697]])


def build(elements: int = 32, degree: int = 3) -> fb.Scene:
    """The cable, its clamp, and the ring."""
    section = fb.Section.rectangle(height=0.01, width=0.02, E=1e9, rho=1000.0, nu=0.3)
    cable = fb.Beam.straight("cable", (0, 0, 0), (2, 0, 0), section=section, elements=elements, degree=degree)
    ring = fb.PointMass("ring", mass=0.2)
    return fb.Scene(cable, ring, fb.Clamp(cable.start), fb.Slider("contact", ring, cable, at=0.5), name="ring on a cable",
                    gravity=(0.0, -9.81, 0.0))


def compare(result: fb.Result) -> np.ndarray:
    """Rows (t, s, ring x, ring y, tip x, tip y) at the published times within the run, between the recorded rows linearly."""
    ring, tip = result.slider("contact"), result.point("tip")
    series = (ring["s"], ring["position"][:, 0], ring["position"][:, 1], tip[:, 0], tip[:, 1])
    t = PUBLISHED[PUBLISHED[:, 0] <= result.t[-1] + 1e-9, 0]
    columns: list[np.ndarray] = [np.interp(t, result.t, x) for x in series]
    return np.column_stack([t, *columns])


def comparison_text(rows: np.ndarray) -> str:
    """The computed rows, and in the last column the largest difference from the published ones, m."""
    lines = ["".join(f"{name:>11}" for name in COLUMNS) + f"{'difference':>13}"]
    for row, known in zip(rows, PUBLISHED):
        lines.append(f"{row[0]:11.1f}" + "".join(f"{x:11.6f}" for x in row[1:]) + f"{np.abs(row - known).max():13.1e}")
    return "\n".join(lines)


def main(out: str = "out", elements: int = 32, step: float = 5e-4, t_end: float = 0.6, order: int = 2) -> fb.Result:
    """Run, print the tables, write `out`/ring_on_cable.png and .h5.

    Parameters
    ----------
    out : str
        Folder for picture and result.
    elements : int
        Cubic elements of the cable.
    step, t_end : float
        Step size and end of the run, s.
    order : {2, 4}
        Of the time integration.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    scene = build(elements)
    model = fb.compile_scene(scene)
    print(model)

    # one step on its own: the first one loads or compiles the machine code
    begin = time.perf_counter()
    fb.simulate(model, t_end=step, step=step, order=order, progress=False)
    print(f"\nfirst step, with loading or compiling of the kernels: {time.perf_counter() - begin:.1f} s")

    result = fb.simulate(model, t_end=t_end, step=step, order=order, points={"tip": scene.beams[0].end},
                         output=fb.Output(folder / "ring_on_cable.h5", overwrite=True))
    info = result.info
    print(f"{info['steps']} steps in {info['wall_time']:.2f} s: {info['steps'] / info['wall_time']:.0f} steps per second with "
          f"recording, {info['iterations'] / info['steps']:.1f} Newton iterations a step")
    print(f"solver: {info['solver']}")
    print("events: " + ("; ".join(event["text"] for event in result.events) or "none"))
    print(f"\nconservation\n{result.table()}")
    print(f"\npositions in m; difference: largest from another program (Euler-Bernoulli, other time integration)\n"
          f"{comparison_text(compare(result))}")
    fb.plot_overview(result).savefig(folder / "ring_on_cable.png")
    print(f"\nwritten: {folder / 'ring_on_cable.png'}, {folder / 'ring_on_cable.h5'}")
    return result


if __name__ == "__main__":
    main()
