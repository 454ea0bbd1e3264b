"""Draws error against time."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

from perf.peers.cases import ERRORS  # noqa: E402
from perf.peers.judge import TITLE, Verdict  # noqa: E402

COLOR = {"fastbeam": "#c8102e", "exudyn": "#1f5fa8", "pyelastica": "#2e8b57", "opensees": "#8a6d3b"}
MARK = {"fastbeam": "o", "exudyn": "s", "pyelastica": "^", "opensees": "D"}
NAME = {"spaghetti3d": "flying spaghetti, 3D", "sliding": "mass slides on a pinned beam"}


def draw(all_verdicts: Mapping[str, Mapping[str, Verdict]], clock: str, file: Path) -> None:
    """One panel a scene: all runs faint, the envelope as a line, what is extrapolated dashed."""
    figure, panels = plt.subplots(1, len(all_verdicts), figsize=(5.2 * len(all_verdicts), 4.4), squeeze=False,
                                  layout="constrained")
    for axes, (scene, verdicts) in zip(panels[0], all_verdicts.items()):
        for error in ERRORS:
            axes.axhline(error, color="0.8", linewidth=0.8, zorder=0)
        for name, v in verdicts.items():
            if not v.front:
                continue
            axes.plot([r.time for r in v.runs], [r.error for r in v.runs], MARK[name], color=COLOR[name], alpha=0.25,
                      markersize=4)
            axes.plot([r.time for r in v.front], [r.error for r in v.front], f"{MARK[name]}-", color=COLOR[name], markersize=5,
                      label=TITLE[name])
            far = [(c.time, e) for e, c in v.crossings.items() if c.kind == "extrapolated"]
            if far:
                axes.plot([v.front[-1].time, *(t for t, _ in far)], [v.front[-1].error, *(e for _, e in far)], ":",
                          color=COLOR[name])
        axes.set(xscale="log", yscale="log", title=NAME[scene], xlabel=f"{clock} time of the solve, s, one thread")
        axes.grid(True, which="major", color="0.93")
        axes.set_axisbelow(True)
    panels[0][0].set_ylabel("largest position error / length")
    panels[0][0].legend(frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)
