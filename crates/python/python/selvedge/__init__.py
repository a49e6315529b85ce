"""Selvedge: a gripper for any cloth simulator, an inextensible cloth, and the folding experiment.

Lengths are metres, times seconds, quaternions x y z w, z is up. A gripper needs node positions only::

    gripper = selvedge.Gripper(selvedge.BoxVolume((0.03, 0.03, 0.03)))
    nodes, targets, velocities = gripper.step(pose, closed, positions, faces, edges, dt)
    # now make those nodes be there at the end of the step

`selvedge.adapters` does that last line in MuJoCo, Newton and plain numpy, `selvedge.gym` makes an
environment of it, and `python -m selvedge.fold` runs a scenario file on any of them.
"""

from ._native import (
    BoxVolume,
    Cloth,
    Gripper,
    Grippers,
    Mesh,
    Pose,
    PyramidVolume,
    Recording,
    Scenario,
    Schedule,
    Squeeze,
    Sweep,
    Worlds,
    __version__,
    fold_error,
    half_fold,
    reach,
    read_log,
    step_all,
    write_log,
    write_page,
)
from .lerobot import to_lerobot

__all__ = [
    "BoxVolume",
    "Cloth",
    "Gripper",
    "Grippers",
    "Mesh",
    "Pose",
    "PyramidVolume",
    "Recording",
    "Scenario",
    "Schedule",
    "Squeeze",
    "Sweep",
    "Worlds",
    "__version__",
    "fold_error",
    "half_fold",
    "reach",
    "read_log",
    "step_all",
    "to_lerobot",
    "write_log",
    "write_page",
]
