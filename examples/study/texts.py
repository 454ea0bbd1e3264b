"""The hand-written words of the study; every number comes from the measurements. Names in braces are filled in by tables.py."""

HEAD = """# Methods of time integration on beams with sliding contact

The conserving step of fastbeam beside the methods in common use, on the same semi-discrete equations, with the same sliders, the
same initial states and the same {iterations} Newton iterations a step: the implicit midpoint rule, the trapezoidal rule
(Newmark, beta = 1/4, gamma = 1/2), and generalised-alpha with several rho_inf. Scenes are in `examples/study/scenes.py`; all of
them run in space, also where a planar form of the conserving step would be faster. Runs that fail are listed with step and
reason.

Everything below is measured and written by `python examples/study/run.py`, one thread per run (measurements of {minutes:.0f}
minutes in all); {cpu}, {cores} cores, {system}, Python {python}, NumPy {numpy}, numba {numba}.{quick}
Numbers as JSON: [data.json](study/data.json).

![The scenes](study/scenes.png)"""

FINDINGS = """## What the numbers say

- Only the conserving step keeps energy, momenta and gap at round-off, at every step at which it converges, and up to the step
  in which a run fails. The midpoint rule keeps the momenta of a beam alone but, with a slider, only the linear one; the
  trapezoidal rule and generalised-alpha keep the linear momentum. None of them keeps the energy, and damping takes the more of
  it the stronger it is.
- Accuracy is another matter: at small steps the conserving step of order 2, the midpoint rule and the trapezoidal rule have
  nearly the same errors, strong damping a few times larger ones. The step of order 4 is ahead by orders of magnitude once the
  step resolves the fast waves; before that its order does not show. On the stiff scenes (g) no affordable step resolves them.
- The trapezoidal rule with sliders is weakly unstable: its contact force grows (picture of the forces), the sooner the smaller
  the step, until Newton's method fails. On the cables none of the steps tried is free of it; free flights are too short for it
  to show.
- The conserving step does not become unstable. What ends its runs is Newton's method, which has no line search and, from its
  first guess (the mean rates of the last steps), misses the solution of a step that is too long for a whipping cable. On free
  flights and whipping cables strong damping gets further, because it removes the waves that spoil the first guess; it pays with
  the energy: where that may be off by 10 %, strong damping is ahead on the stiff cable (g) alone.
- Unit directors at the control points of a spline cap the order in the mesh at 2. With triads at the Greville abscissae the
  same splines reach 4, and cubic Lagrange elements are more accurate still at equal numbers of nodes. On scenes with sliders
  all of them end at the kink under the contact, whose error the fine mesh has, too: the last digits there say no more than
  that.
- Splines lock on the stiff cable: their errors stay far above those of Lagrange elements.
- Step control keeps all invariants. The true local errors of order 2 are about those asked for, except on the stiff scenes (g).
  Those of order 4 are a few times larger, because the estimate trusts an order that the fast waves do not have at such steps.
"""

LARGEST = """## The largest step

Largest step, s, with which a run completes its whole span with an energy within {blown:g} times its scale; in brackets the
largest with an energy error of at most {strict:.0%}. Steps are tried from a fifth of the span downwards, halving until two
neighbours pass (a single step that passes between failing ones does not count), then refined to 10 % (not on the large scene).
`>=`: the largest tried passes; `none >=`: no step from there on passes.

![Largest steps](study/largest_step.png)

"""

DRIFT = """## Drift at the usual step

Largest relative deviation from the start over the whole span. Zigzag: the part of the contact force of the first slider that
alternates from step to step, root mean square over that of the force.

![Energy over time](study/energy.png)

"""

ORDERS = """## Order in the step

Errors against the run of order 4 with the smallest step on the same mesh: positions of the observed points over the length of the
scene (largest of ten times), the sliding coordinate, the contact force over its largest value. The last columns are medians of
the last three observed orders. The meshes are coarse and the curves are splines: a path over the kinks of a Lagrange curve has no
fourth derivative, and fast waves hide the order until a step resolves them. Forces are second derivatives of the path and show
the fast waves most.

![Orders in the step](study/orders.png)

"""

MESH = """## Order in the mesh

The discretisation of the reference paper is `bspline` with orthonormal triads at the `control` points and Green-Lagrange strains.
Beside it: triads at the Greville abscissae, and Lagrange elements. Errors of the observed points over the length against a fine
mesh of Lagrange elements of degree 5 with the same strains, all with the conserving step of order 4 and the same step size. A
sliding mass kinks the exact curve under it, wherever in an element it is: that limits the order of every smooth interpolation on
scenes with sliders.

![Orders in the mesh](study/mesh.png)

"""

NEWTON = """## Newton iterations

Mean number of Newton iterations of a step, at the usual step / at the largest step survived. A step of order 4 consists of five
substeps.

"""

CONTROL = """## Step control

The conserving step with `tolerance=`, the allowed local error of a position per step over the size of the scene. The true local
error of up to twelve steps of each run comes from repeating them from the same state with sixteen steps of order 4. Drift is the
worst of all invariants of the scene.

![Step control](study/step_control.png)

"""

LEADS = {
    "spaghetti2d":
        "The flying spaghetti of Simo and Vu-Quoc, thrown by a smooth field of initial velocities instead of a load, so that "
        "energy and momenta are invariants from the start.",
    "spaghetti3d":
        "The same section as in the plane. Its shear waves are slow (31 rad/s), its axial waves fast.",
    "pendulum":
        "Released from rest. The cable whips when its end turns round, which sends waves along it that no method resolves with "
        "large steps.",
    "mass_on_cable":
        "A cable of 2.38 m and 2.0 kg between two pins 2 m apart, a ring of 0.3 kg. The cable swings about the line between the "
        "pins while the ring runs through its lowest point and back.",
    "mass_on_cantilever":
        "The cantilever is an arc that first falls and then rises, so that the mass turns back before the tip and the run can be "
        "as long as one likes.",
    "body_on_beam":
        "The body touches the rod with a point 0.4 m off its centre, so that the contact force turns it. Nothing acts from "
        "outside: all invariants can be watched.",
    "beam_on_beam":
        "The slider is the first node of a second flexible beam. Nothing acts from outside.",
    "large":
        "The platforms turn against each other and twist the bundle of cables; the rings run from one platform to the other. "
        "Nothing acts from outside.",
    "stiff":
        "The ratio EA/EI of scene (c, cable), with the shear stiffness, is raised by 1e4: the axial waves are a hundred times "
        "faster, the motion is hardly changed.",
    "stiff_cantilever":
        "All stiffnesses of scene (c, cantilever) are raised by 1e4."}
