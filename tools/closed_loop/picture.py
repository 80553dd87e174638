"""The picture of a run: speeds of all drivers over the reference, a panel a course, and the command of one."""

from pathlib import Path

from cruise.report.colours import GREY

from .drivers import DRIVERS
from .trial import BEST, Run


def draw(run: Run, path: Path) -> Path:
    """Two panels a course: the error of the speed to the reference, and setpoint and speed; returns the path."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    count = len(run.courses)
    figure, axes = plt.subplots(count, 2, figsize=(15, 2.2 * count), squeeze=False, layout="constrained")
    for (left, right), course in zip(axes, run.courses, strict=True):
        first = next(iter(run.drives.values()))[course.name]
        left.plot(first.time_s, first.setpoint_mps, color=GREY, lw=0.8, ls="--")
        left.plot(first.time_s, first.reference_mps, color="black", lw=0.8, label="reference")
        if BEST in run.drives:
            mine = run.drives[BEST][course.name]
            left.plot(mine.time_s, mine.speed_mps, color=DRIVERS[BEST].colour, lw=1.0, label=BEST)
        for name, drives in run.drives.items():
            one = drives[course.name]
            right.plot(
                one.time_s, 100.0 * (one.speed_mps - one.reference_mps), color=DRIVERS[name].colour, lw=0.8, label=name
            )
        left.set_title(course.name, loc="left", fontsize=9)
        left.set_ylabel("m/s")
        right.set_ylabel("error, cm/s")
        right.set_ylim(-12.0, 12.0)
    axes[0][1].legend(ncols=5, fontsize=8)
    figure.suptitle(f"closed loop, machine {run.machine}, seed {run.seed}", x=0.01, ha="left")
    figure.savefig(path, dpi=80)
    plt.close(figure)
    return path
