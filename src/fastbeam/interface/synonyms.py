"""Synonyms of arguments: names from elsewhere, and advice in the message about an argument that a call does not have."""
from __future__ import annotations

from collections.abc import Iterable

# argument: its names elsewhere. If a call has several of these arguments, the first one is suggested; a list of arguments is
# suggested if the call has all of them. Capitals and underscores do not count, unless the words differ by them alone
WORDS = {
    # when, how long, how finely
    "step": "dt h time_step timestep step_size stepsize load_step "
            "delta_t initial_step load_steps n_load_steps increments ds increment",
    "t_end": "tend end_time duration T tmax t_max t_final final_time stop_time end until time",
    "period": "dt sample_time sampling_time Ts sampling dt_sample interval frequency rate step",
    "time": "t time_function time_factor scaling f_of_t time_law amplitude history",
    "at_time": "t time t0 at_t",
    "load_step": "load_steps n_load_steps n_steps steps increments initial_step step",
    "largest_load_step": "max_load_step max_step largest_step",
    "smallest_step": "min_step min_load_step smallest_load_step",
    "largest_step": "max_step ds_max",
    "max_step": "dt_max largest_step",
    "min_step": "dt_min smallest_step",
    # groups of a run in time
    "t_end and start=Start(..., time=...)": "t0 start_time begin t_begin",
    "t_end and start=Start(..., mend=True)": "fix_start repair mend",
    "t_end and tolerance=StepControl(..., max_step=...)": "dt_max largest_step",
    "t_end and tolerance=StepControl(..., min_step=...)": "dt_min smallest_step",
    "t_end and method=Method(rho_inf=...)": "rho rho_infinity spectral_radius numerical_damping filter",
    "t_end and solver=Solver(max_iterations=...)": "iterations max_iter maxiter newton_iterations",
    "t_end and solver=Solver(threads=...)": "n_threads num_threads cores",
    "t_end and output=Output(snapshots=...)": "frames n_frames n_snapshots shapes",
    "t_end and output=Output(..., overwrite=True)": "force replace exist_ok clobber",
    "most_points": "steps n_steps num_steps max_steps max_points n_points n n_max",
    "most_steps": "steps n_steps max_steps t_end",
    "t_end and step": "steps n_steps num_steps max_steps nt",
    "max_iterations": "iterations max_iter maxiter newton_iterations",
    "tolerance": "tol rtol atol eps accuracy error",
    "to": "target final_load_factor max_load lambda_max load_factor_end end",
    "load_factor": "lambda lam factor load_level at",
    "levels": "load_factors stages load_levels load_factor",
    "rho_inf": "rho rho_infinity spectral_radius numerical_damping filter",
    "method": "integrator scheme time_integrator",
    "backend": "solver linear_solver",
    "start=Start(..., mend=True)": "fix_start repair mend",
    "keep_every": "every checkpoints keep",
    # start and results of a run
    "start": "restart initial_state initial x0 state y0 warm_start seed from p1 x1 first begin min lower minimum low",
    "state": "start equilibrium at about",
    "observe": "outputs record variables quantities",
    "points": "sensors probes monitors nodes vertices coordinates outputs inputs",
    "every": "output_every output_step save_every sample_every stride",
    "snapshots": "frames n_frames n_snapshots shapes",
    "file": "output save save_to filename file_name out path to_file",
    "output": "file save save_to filename file_name out path to_file",
    "path": "file filename file_name out output name",
    "overwrite": "force replace exist_ok clobber",
    "progress": "verbose quiet bar show_progress",
    "callback": "on_step hook event events",
    "threads": "n_threads num_threads cores",
    "planar": "plane two_d is_2d in_plane",
    "workers": "n_jobs jobs processes n_workers cores threads",
    "executor": "pool client",
    "retry": "rerun again",
    "cases": "parameters params grid args values",
    "build": "function func fun scene model make",
    "run": "simulate options kwargs t_end step",
    "measure": "post postprocess objective evaluate",
    "values": "parameters params args variables wrt design samples data y x",
    "scale": "sizes step_sizes delta",
    "plane": "view projection axes",
    "cmap": "colormap color colors",
    "fps": "frame_rate frames",
    "speed": "slow_motion slowdown time_scale",
    "n": "n_modes num_modes modes count number frames k",
    "first": "mode start",
    "k": "mode index n i number",
    "amplitude": "scale exaggeration factor",
    "surface": "surfaces skin tube",
    "refine": "subdivide subdivisions resolution n",
    "double": "precision dtype",
    "sections": "section_forces section forces",
    "component": "components direction axis",
    "log": "logscale logarithmic",
    "slider": "name slider_name sliders",
    "condense": "condensation static_condensation reduce",
    "eliminate_inner": "eliminate reduce",
    # sections and materials
    "section": "material cross_section profile sections",
    "E": "youngs_modulus young modulus Emod elastic_modulus Y",
    "section=fb.Section.circle(radius=..., E=..., rho=...)": "E rho density radius EA",
    "rho": "density rho_ material",
    "nu": "poisson poissons_ratio poisson_ratio v",
    "G": "shear_modulus mu",
    "radius": "r diameter d outer_radius R outer_diameter D",
    "thickness": "t wall wall_thickness inner_radius ri inner_diameter",
    "height": "h depth",
    "width": "b w breadth",
    "shear_factor": "k ks kappa shear_correction k_s",
    "EI2 and EI3": "EI I",
    "EI2": "EIy EI_y EIyy EI1",
    "EI3": "EIz EI_z EIzz",
    "GA2 and GA3": "GA GAs kGA",
    "GJ": "GIt GI GIp J",
    "EA": "A area",
    "rhoA": "mass_per_length linear_density mu rho m",
    "rhoI2 and rhoI3": "rhoI rhoJ I_rho",
    "C": "K stiffness_matrix matrix stiffness",
    "damping_ratio": "zeta xi damping modal_damping D",
    "loss_factor": "eta structural_damping damping",
    # beams and nets
    "elements": "n n_elements num_elements nel ne mesh mesh_size n_nodes nodes N segments",
    "degree": "p polynomial_degree order element_order",
    "interpolation": "basis shape_functions splines",
    "strain": "formulation theory strain_measure",
    "prestress": "pretension preload tension N",
    "prestrain": "initial_strain eps0",
    "end": "p2 x2 to last max upper maximum high",
    "d2": "up normal orientation y_axis reference_vector",
    "twist": "rotation pretwist",
    "frame": "triad directors orientation",
    "center": "centre origin position",
    "pitch": "lead rise",
    "turns": "n n_turns windings revolutions coils",
    "angle": "theta phi sweep arc_angle rotation position",
    "start_direction": "phase x_axis",
    "curve": "f function points path",
    "edges": "beams connectivity members lines elements_list",
    "clamps": "fixed clamped supports fixed_nodes",
    "pins": "pinned supports support anchors fixed",
    "joints": "hinges connections hinge",
    "densities": "q force_densities",
    "masses": "point_masses mass",
    "nodes": "points vertices coordinates positions",
    # parts, loads, supports
    "mass": "m weight density",
    "inertia": "I J moments_of_inertia inertia_tensor tensor Theta",
    "spin": "omega angular_velocity rotational_velocity w rotation_rate",
    "velocity": "v vel v0 initial_velocity linear_velocity speed",
    "directors": "orientation rotation R frame triad quaternion euler_angles basis matrix",
    "axes": "dof dofs directions fixed_axes direction axis components",
    "about": "pivot point center centre origin",
    "displacement": "velocity motion u displacements v",
    "rotation": "angle rotations theta",
    "at": "position location pos place s s0 node where arc_length arclength x body beam part on point start s_a",
    "on": "beam rail body part at path track node",
    "position": "x pos location place center_of_mass com center centre setpoint offset",
    "objects": "parts bodies part beams",
    "offset": "position point r x",
    "force": "F forces load value vector p q line_load pressure f",
    "moment": "M moments torque m",
    "loads": "load forces excitation",
    "base": "ground support_motion base_motion ground_motion",
    "follower": "following local body_fixed follow",
    "gravity": "g acceleration gravity_vector",
    "gravity_time": "time gravity_function",
    "each part without a name": "parts objects components bodies beams supports loads joints",
    "project_velocities": "consistent project consistent_velocities",
    "until": "release release_time release_at end t_end",
    "since": "start from_time t_start begin",
    # joints and links
    "axis_a and axis_b": "axis axes",
    "axis_a": "axis1 axis_1 first_axis",
    "axis_b": "axis2 axis_2 second_axis",
    "axis": "direction normal rotation_axis orientation x_axis",
    "normal": "axis direction Cd drag_coefficient Cm Ca drag added_mass coefficient quadratic",
    "along": "x_axis direction",
    "a": "body_a body1 body_1 parent master i node1 node_1 p1 first",
    "b": "body_b body2 body_2 child slave j node2 node_2 p2 second",
    "stops": "limits limit range bounds end_stops min max lower upper",
    "drive": "motor actuator controller control servo",
    "torque": "moment M force motor T actuator",
    "distance": "displacement position stroke travel x",
    "stiffness": "k K spring_constant spring_rate constant EA ea kp gain penalty contact_stiffness P",
    "damping": "c d damping_constant viscous_damping damper coefficient kd beta",
    "length": "l0 L0 L rest_length free_length natural_length unstretched_length sleeve_length bore",
    "rest": "rest_angle angle0 neutral offset",
    "cone": "cone_angle swing max_angle limits",
    "tension_only": "no_compression cable unilateral rope",
    "compression_only": "no_tension bumper",
    "table": "characteristic force_law data curve law",
    "coefficient": "mu friction friction_coefficient mu_k mu_s static kinetic coulomb",
    "friction": "mu friction_coefficient coulomb dry coefficient",
    "viscous": "damping c",
    "smoothing": "regularization regularisation v_reg stick_velocity eps",
    "restitution": "e bounce cor coefficient_of_restitution",
    "limit": "max_force force_limit saturation max_torque",
    # sliders, ropes, forces of one's own
    "rate": "slide_rate speed velocity v omega angular_velocity rpm",
    "beam": "rail track guide on rope",
    "lock": "brake locked latch",
    "release": "let_go released until",
    "one_sided": "one_way unilateral contact",
    "side": "normal direction axis",
    "closed": "loop periodic cyclic",
    "choose": "selector route switching",
    "tracks": "paths branches beams",
    "beam_a": "beam1 beam_1",
    "beam_b": "beam2 beam_2",
    "beams": "tracks parts path",
    "keyed": "key no_twist",
    "drum": "pulley reel winch a start",
    "load": "hook b end mass",
    "mass_per_length": "rho linear_density rhoA mu mass",
    "total": "rope_length total_length",
    "segments": "n elements n_elements",
    "law": "function func force callback feedback control",
    "parameters": "params constants args",
    "derivative": "jacobian jac gradient tangent",
    "memory": "state x0 initial",
    "tangential": "Ct axial tangent",
    "air": "flow fluid_velocity current wind_velocity wind_speed water",
    "linear": "viscous stokes c alpha",
    "times": "t x time",
    "direction": "axis",
    "speeds": "speed velocity v",
    # analyses
    "frequencies": "f freq frequency omegas omega w hz",
    "shapes": "shape result state q",
    "held": "fixed locked hold hold_sliders",
    "within": "interval bracket range",
    "steady": "rotating spinning steady_state spin",
    "damped": "complex with_damping damping",
    "stop": "event stop_when until criterion stop_event",
    "stop_at": "buckling bifurcation critical",
    "branch": "switch_branch mode",
    "moves": "motions supports displacement",
    "point": "about pivot center centre origin",
    "s": "at x arc_length arclength position",
    "index": "node i k n number",
    "i": "index node k n number",
    "owner": "beam body part",
    "name": "title label id point joint",
}
# words that differ in meaning from the argument, and the meaning of the argument
CONVERTED = {
    "radius": {"diameter d outer_diameter D": "half of the diameter"},
    "thickness": {"inner_radius ri": "the radius less the inner radius", "inner_diameter": "the radius less half of it"},
    "EA": {"A area": "E times the area"},
    "EI2 and EI3": {"I": "E times second moments of area"},
    "GJ": {"J": "G times the torsion constant"},
    "rhoA": {"rho": "the density times the area"},
    "mass_per_length": {"rho": "the density times the area"},
    "mass": {"weight": "the weight over g", "density": "the density times the volume"},
    "stiffness": {"EA ea": "EA itself of a rope on a winch, EA over the length of a spring"},
    "normal": {"Cd drag_coefficient": "half of rho Cd d, d the width", "Ca": "Ca times the mass of the fluid displaced",
               "Cm": "(Cm - 1) times the mass of the fluid displaced"},
    "gravity": {"g": "a vector, as (0, 0, -9.81)"},
    "force": {"pressure": "in N or N/m, the pressure times what it acts on"},
    "displacement": {"velocity": "the integral of the velocity"},
    "directors": {"rotation R matrix basis": "rows d1, d2, d3, the transpose of a matrix that rotates vectors",
                  "quaternion euler_angles": "three rows d1, d2, d3"},
    "period": {"frequency rate": "one over the frequency"},
    "rate": {"rpm": "2 pi/60 of it in rad/s"},
    "frequencies": {"omegas omega w": "in Hz, the angular frequency over 2 pi"},
    "step": {"load_steps n_load_steps increments": "the size of one, not their number"},
    "load_step": {"load_steps n_load_steps n_steps steps increments": "the size of one, one over their number"},
    "elements": {"n_nodes nodes": "the number of elements, not of nodes", "mesh_size": "the length over their size"},
    "rho_inf": {"numerical_damping": "1 without damping, 0 with the most"},
    "t_end": {"duration": "counted from t = 0 and not from the start"},
    "start_direction": {"phase": "a direction, not an angle"},
    "speed": {"slow_motion slowdown": "less than 1 for slow motion"},
    "progress": {"quiet": "the opposite"},
}
# words of features that do not exist: docs/limits.md
ABSENT = ("spring", "motor", "contact", "plasticity", "gpu", "dofs")
# least similarity of a word that is taken for a misspelt argument
CLOSE = 0.78


def instead(unknown: str, names: list[str]) -> str:
    """Return the advice for an argument that does not exist, from those of the call."""
    if unknown in ("radius", "height", "width", "thickness", "E") and "EA" in names:
        return "; Section.circle, Section.tube and Section.rectangle take sizes and material"
    meant = _meant(unknown, names)
    if meant:
        which = f"; use {meant}" if "=" in meant or meant in names else f"; give {meant}"
        return which + next((f", {what}" for words, what in CONVERTED.get(meant, {}).items() if _is_among(unknown, words)), "")
    if unknown.lower() in ABSENT:
        return "; fastbeam does not support this, docs/limits.md lists alternatives"
    close = nearest(unknown, names, CLOSE)
    return f"; did you mean {close}?" if close else f"; it takes {listed(names)}"


def nearest(unknown: object, names: Iterable[str], close: float = 0.6) -> str:
    """Return the name nearest to one that does not exist; '' if none is like it. Small letters and capitals do not count."""
    from difflib import get_close_matches
    of = {name.lower(): name for name in names}
    found = get_close_matches(str(unknown).lower(), of, 1, close)
    return of[found[0]] if found else ""


def known(names: Iterable[str], unknown: object = "", none: str = "none") -> str:
    """Return names that exist, for a message: the nearest to one that does not, and the first of all."""
    names = list(names)
    close = nearest(unknown, names) if len(names) > 1 else ""
    first = ", ".join(repr(name) for name in names[:12]) + ", ..." * (len(names) > 12)
    return (first or none) + (f"; did you mean {close!r}?" if close else "")


def its_sliders(names: list[str], unknown: str) -> str:
    """Return the sliders of a scene, which has none of this name, for a message."""
    return f"its sliders are {known(names, unknown)}" if names else "it has no sliders"


def _meant(unknown: str, names: list[str]) -> str:
    """Return the first argument, or all of some, that people call like that; '' if there is none."""
    for any_case in (False, True):
        word = unknown.lower().replace("_", "") if any_case else unknown
        for argument, words in WORDS.items():
            called = words.lower().replace("_", "") if any_case else words
            if word in called.split() and _has(argument, names):
                return argument.removeprefix("t_end and ") if "=" in argument else argument
    return ""


def _is_among(word: str, words: str) -> bool:
    """Return whether a word is one of some; capitals and underscores do not count."""
    return word.lower().replace("_", "") in words.lower().replace("_", "").split()


def _has(argument: str, names: list[str]) -> bool:
    if argument == "each part without a name":
        return "gravity" in names
    return all(word.split("=")[0] in names for word in argument.split(" and "))


def listed(names: list[str], tail: str = "") -> str:
    """Return names in a row, the first ten of them."""
    return ", ".join(f"{name}{tail}" for name in names[:10]) + (", ..." if len(names) > 10 else "") or "nothing"
