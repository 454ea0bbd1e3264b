"""A trolley runs out on a flexible boom and carries a swinging load on a rope.

The boom, a steel tube of 6 m, is clamped to a wall. The trolley, 10 kg, starts near the wall with 1 m/s and rolls without
friction. From it hangs a rope of 1.5 m, a beam with little bending stiffness, and at its end a load of 40 kg that swings to
the side at first. The boom sags and springs under the moving weight, the sagging boom lets the trolley run downhill, the
swinging load pulls it along and bends the boom sideways.

What slides is a node of one beam, the top of the rope, on another beam. Trolley and load hang on the end nodes of the rope
by a ball joint and by a rigid connection; both add no equations, they take unknowns away. Gravity is the only force from
outside that does work, so the total energy stays at round-off until the trolley arrives at the end of the boom, where the
run stops by itself.
"""
from __future__ import annotations

from pathlib import Path

import fastbeam as fb

SPAN, ROPE, START = 6.0, 1.5, 0.6


def build(boom_elements: int = 12, rope_elements: int = 6) -> fb.Scene:
    """Boom, trolley, rope and load; z points up."""
    tube = fb.Section.tube(radius=0.04, thickness=0.003, E=210e9, rho=7850.0, name="tube")
    wire = fb.Section.circle(radius=0.006, E=5e9, rho=2000.0, name="wire")
    boom = fb.Beam.straight("boom", (0, 0, 0), (SPAN, 0, 0), section=tube, elements=boom_elements)
    rope = fb.Beam.straight("rope", (START, 0, 0), (START, 0, -ROPE), section=wire, elements=rope_elements)
    trolley = fb.PointMass("trolley", mass=10.0, position=(START, 0, 0))
    load = fb.RigidBody("load", mass=40.0, inertia=(2.0, 1.2, 1.6), position=(START, 0, -ROPE))
    return fb.Scene(
        boom, rope, trolley, load, fb.Clamp(boom.start),
        fb.Slider("trolley on boom", rope.start, boom, at=START),
        fb.BallJoint(rope.start, trolley), fb.RigidConnection(load, rope.end),
        # all that hangs moves on with the trolley; rope and load swing about the boom's axis like a rigid pendulum
        fb.RigidMotion((rope, trolley, load), velocity=(1.0, 0, 0)),
        fb.RigidMotion((rope, load), spin=(0.8, 0, 0), about=(START, 0, 0)),
        name="crane", gravity=(0, 0, -9.81))


def main(out: str = "out", boom_elements: int = 12, rope_elements: int = 6, step: float = 2e-3,
         t_end: float = 6.0) -> fb.Result:
    """Run until the trolley reaches an end of the boom or `t_end`, write `out`/crane.png.

    Parameters
    ----------
    out : str
        Folder for the picture.
    boom_elements, rope_elements : int
        Cubic elements of the two beams.
    step, t_end : float
        Step size and latest end of the run, s.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    scene = build(boom_elements, rope_elements)
    model = fb.compile_scene(scene)
    print(model)
    result = fb.simulate(model, t_end=t_end, step=step, points={"load": scene.bodies[0], "tip": scene.beams[0].end})
    info, s = result.info, result.slider("trolley on boom")["s"]
    tip, load = result.point("tip"), result.point("load")
    print(f"\n{info['steps']} steps in {info['wall_time']:.2f} s, "
          f"{info['iterations'] / info['steps']:.1f} Newton iterations a step")
    print("events: " + ("; ".join(event["text"] for event in result.events) or "none"))
    print(f"trolley from s = {s[0]:.3f} m to {s[-1]:.3f} m; the tip sags to {tip[:, 2].min():.3f} m and "
          f"bends {abs(tip[:, 1]).max():.3f} m to the side; the load sways {abs(load[:, 1]).max():.3f} m")
    print(f"\n{result.table()}")
    fb.plot_overview(result).savefig(folder / "crane.png")
    print(f"\nwritten: {folder / 'crane.png'}")
    return result


if __name__ == "__main__":
    main()
