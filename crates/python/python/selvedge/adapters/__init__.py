"""The same gripper on simulators that know nothing of it.

An adapter is a class with `positions`, `velocities`, `step(held, dt)` and `reset()`; it makes the
nodes of `held` be at their targets at the end of the step, with their velocities. All adapters take
the same arguments, so that a scenario runs on any of them.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .._extra import extra
from .._native import Cloth, Mesh

Points: TypeAlias = NDArray[np.float64]
Held: TypeAlias = tuple[NDArray[np.uint32], Points, Points]

NAMES = {"xpbd": "XPBD", "mujoco": "MuJoCo", "newton": "Newton"}


class Simulator(Protocol):
    """What a gripper needs of a cloth simulator."""

    @property
    def positions(self) -> Points:
        """(N, 3) [m], world."""

    @property
    def velocities(self) -> Points:
        """(N, 3) [m/s]."""

    def step(self, held: Held, dt: float) -> object:
        """Advances by `dt` [s]; held nodes are at their targets at its end."""

    def reset(self, positions: Points, velocities: Points | None = None) -> None:
        """Starts anew, with nothing held."""


def make(name: str, mesh: Mesh, material: Mapping[str, float], gravity: float = 9.8) -> Simulator:
    """A simulator by name: "default" or a key of `NAMES`. Raises `ImportError` that names what to
    install where its package is missing."""
    if name == "default":
        return Cloth(mesh, material, {"gravity": gravity})
    if name not in NAMES:
        raise ValueError(f"name: {name}, must be one of {['default', *NAMES]}")
    with extra(name):
        module = import_module(f".{name}", __package__)
    simulator: Simulator = getattr(module, NAMES[name])(mesh, material, gravity)
    return simulator


def triangles(mesh: Mesh) -> NDArray[np.int64]:
    """Triangles (F, 3); quads are cut along the diagonal of their first corner."""
    quads = mesh.quads.astype(np.int64)
    halves = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return np.concatenate([mesh.triangles.astype(np.int64), halves])


def node_areas(mesh: Mesh) -> NDArray[np.float64]:
    """A third of the area [m^2] of the triangles around each node."""
    faces, rest = triangles(mesh), mesh.rest
    a, b, c = (rest[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    areas = np.zeros(mesh.node_count)
    np.add.at(areas, faces, area[:, None])
    return areas
