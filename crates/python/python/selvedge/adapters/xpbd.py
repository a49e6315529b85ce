"""Cloth by extended position based dynamics with small steps: the tutorial of an adapter.

Macklin, Mueller and Chentanez 2016 (compliance), Macklin et al. 2019 (one pass a small step). Lengths
of edges are constraints, diagonals of faces soft ones. Layers do not collide.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._native import Mesh
from . import Held, Points, node_areas


class XPBD:
    """A cloth of distance constraints on the table z = 0."""

    def __init__(
        self, mesh: Mesh, material: Mapping[str, float], gravity: float = 9.8, substep: float = 1 / 1200
    ) -> None:
        quads, edges = mesh.quads, mesh.edges
        pairs = np.concatenate([edges, quads[:, [0, 2]], quads[:, [1, 3]]]).astype(np.int64)
        compliance = np.where(np.arange(len(pairs)) < len(edges), 0.0, 1 / material["shear"])
        lengths = np.linalg.norm(mesh.rest[pairs[:, 0]] - mesh.rest[pairs[:, 1]], axis=1)
        self.batches = [
            (pairs[rows, 0], pairs[rows, 1], lengths[rows], compliance[rows]) for rows in colours(pairs)
        ]
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
        start = self.positions[nodes]
        weight = self.weight.copy()
        weight[nodes] = 0  # held nodes do not yield
        count = int(np.ceil(dt / self.substep - 1e-9))
        h = dt / count
        for k in range(count):
            before = self.positions
            v = (self.velocities + h * self.fall) * np.exp(-self.decay * h)
            x = before + h * v
            x[nodes] = start + (targets - start) * ((k + 1) / count)
            for i, j, length, compliance in self.batches:
                d = x[i] - x[j]
                now = np.sqrt(np.einsum("ij,ij->i", d, d))
                give = weight[i] + weight[j] + compliance / h**2
                push = ((now - length) / np.maximum(now * give, 1e-30))[:, None] * d
                push[weight[i] + weight[j] == 0] = 0
                x[i] -= weight[i, None] * push
                x[j] += weight[j, None] * push
            free = weight > 0
            depth = np.where(free, np.maximum(-x[:, 2], 0), 0)
            x[:, 2] += depth
            slide = (x - before)[:, :2]
            far = np.linalg.norm(slide, axis=1)
            x[:, :2] -= slide * np.minimum(self.friction * depth / np.maximum(far, 1e-30), 1)[:, None]
            self.positions, self.velocities = x, (x - before) / h
        self.positions[nodes], self.velocities[nodes] = targets, velocities


def colours(pairs: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rows of `pairs` in groups in which no node comes twice."""
    used: list[set[int]] = []
    groups: list[list[int]] = []
    for row, (i, j) in enumerate(pairs.tolist()):
        for colour in range(len(used) + 1):
            if colour == len(used):
                used.append(set())
                groups.append([])
            if i not in used[colour] and j not in used[colour]:
                used[colour] |= {i, j}
                groups[colour].append(row)
                break
    return [np.array(group) for group in groups]
