"""Cloth by extended position based dynamics in some 50 lines of numpy: the tutorial of an adapter.

A cloth is springs without give along its edges and soft ones across its faces. A substep moves all
nodes as if they were free, corrects pairs of nodes that are too near or too far, and takes as
velocities what came of it (Macklin, Mueller and Chentanez 2016; a substep has one pass, Macklin et al.
2019). Pairs without a common node are corrected at once, by arrays.

What a gripper asks of a simulator is in three places of `step`, and of any other that you adapt:

1. Held nodes have no weight: nobody pushes them away.
2. In each substep they are set on the straight line to their targets, so that the cloth follows.
3. At the end they are at their targets with the velocities given, which a release leaves to them.

Left out, for shortness: layers do not collide, and nothing resists bending.
"""

from collections.abc import Mapping
from itertools import count

import numpy as np
from numpy.typing import NDArray

from .._native import Mesh
from . import Held, Points, node_areas


class XPBD:
    """A cloth of distance constraints on the table z = 0."""

    def __init__(
        self, mesh: Mesh, material: Mapping[str, float], gravity: float = 9.8, substep: float = 1 / 1200
    ) -> None:
        diagonals = np.concatenate([mesh.quads[:, [0, 2]], mesh.quads[:, [1, 3]]])
        pairs = np.concatenate([mesh.edges, diagonals]).astype(np.int64)
        lengths = np.linalg.norm(mesh.rest[pairs[:, 0]] - mesh.rest[pairs[:, 1]], axis=1)
        compliances = np.repeat([0, 1 / material["shear"]], [len(mesh.edges), len(diagonals)])
        colour = colours(pairs)
        groups = [np.flatnonzero(colour == number) for number in range(colour.max() + 1)]
        self.groups = [(*pairs[rows].T, lengths[rows], compliances[rows]) for rows in groups]
        self.weight = 1 / (material["density"] * node_areas(mesh))
        self.fall = np.array([0, 0, -gravity * material["gravitational_density"] / material["density"]])
        self.decay = material["damping"] / material["density"]
        self.friction, self.substep = material["friction_table"], substep
        self.reset(mesh.rest)

    def reset(self, positions: Points, velocities: Points | None = None) -> None:
        self.positions = positions.copy()
        self.velocities = np.zeros_like(positions) if velocities is None else velocities.copy()

    def step(self, held: Held, dt: float) -> None:
        nodes, targets, velocities = held
        start, weight = self.positions[nodes], self.weight.copy()
        weight[nodes] = 0  # 1.
        substeps = int(np.ceil(dt / self.substep - 1e-9))
        h = dt / substeps
        for k in range(1, substeps + 1):
            before = self.positions
            x = before + h * (self.velocities + h * self.fall) * np.exp(-self.decay * h)
            x[nodes] = start + (targets - start) * (k / substeps)  # 2.
            for i, j, length, compliance in self.groups:
                way = x[i] - x[j]
                distance = np.linalg.norm(way, axis=1)
                yielding = weight[i] + weight[j] + compliance / h**2
                push = ((distance - length) / (distance * yielding + 1e-30))[:, None] * way
                x[i] -= weight[i, None] * push
                x[j] += weight[j, None] * push
            depth = np.where(weight > 0, np.maximum(-x[:, 2], 0), 0)  # below the table
            slide = (x - before)[:, :2]
            grip = self.friction * depth / np.maximum(np.linalg.norm(slide, axis=1), 1e-30)
            x[:, :2] -= np.minimum(grip, 1)[:, None] * slide
            x[:, 2] += depth
            self.positions, self.velocities = x, (x - before) / h
        self.positions[nodes], self.velocities[nodes] = targets, velocities  # 3.


def colours(pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number for each pair; no node is in two pairs of the same number."""
    taken: list[set[int]] = [set() for _ in range(pairs.max() + 1)]
    result = np.zeros(len(pairs), np.int64)
    for row, (i, j) in enumerate(pairs.tolist()):
        result[row] = next(number for number in count() if number not in taken[i] | taken[j])
        taken[i].add(result[row])
        taken[j].add(result[row])
    return result
