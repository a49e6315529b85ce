"""MuJoCo's flex cloth (its package `mujoco`, 4.0 or later).

The grasp is found at closing time; nothing is compiled anew. Each node is a body on three slides. A
held one gets the velocity that takes it to its target, and an inertia so large that no force of the
cloth changes it. (MuJoCo reads the inertia of such bodies from `dof_M0`, and not from `dof_armature`.)

A weave shears easily; MuJoCo's membrane does not, so that a squeeze would stretch it. The matrices
made of `young` are set to those of threads along x and y with the shear stiffness of the material.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from .._native import Mesh
from . import Held, Points, node_areas, triangles

HEAVY = 1e4  # [kg], some 10^8 nodes


class MuJoCo:
    """A flex with a `stiffness` [N/m] along its threads, integrated implicitly, on the plane z = 0."""

    def __init__(
        self,
        mesh: Mesh,
        material: Mapping[str, float],
        gravity: float = 9.8,
        substep: float = 1 / 240,
        stiffness: float = 1e5,
    ) -> None:
        rest, faces = mesh.rest, triangles(mesh)
        fall = gravity * material["gravitational_density"] / material["density"]
        radius = material["thickness"] / 2
        shell = np.sqrt(12 * max(material["bending"], 1e-12) / stiffness)  # [m], bends as the material
        self.model = mujoco.MjModel.from_xml_string(f"""
            <mujoco><option gravity="0 0 {-fall}" integrator="discrete" iterations="20" tolerance="1e-6"/>
            <size memory="1G"/>
            <worldbody><geom type="plane" size="0 0 1" pos="0 0 {-radius}" friction="{material["friction_table"]}"/>
            <flexcomp name="cloth" type="direct" dim="2" radius="{radius}" mass="1"
                point="{" ".join(map(repr, rest.ravel().tolist()))}"
                element="{" ".join(map(str, faces.ravel().tolist()))}">
            <elasticity young="{stiffness / shell}" thickness="{shell}" elastic2d="both" damping="{material["internal_damping"]}"/>
            <contact condim="3" friction="{material["friction_cloth"]}" solref="0.005 1"/>
            </flexcomp></worldbody></mujoco>""")
        weave = np.diag([stiffness, stiffness, 4 * material["shear"]])
        matrices = self.model.flex_stiffness.reshape(len(faces), -1)
        matrices[:, :6] = membrane(self.model, rest, weave)[:, *np.triu_indices(3)]
        bodies = self.model.flex_vertbodyid
        self.dofs = self.model.body_dofadr[bodies][:, None] + np.arange(3)
        mass = material["density"] * node_areas(mesh)
        self.model.body_mass[bodies] = mass
        self.model.dof_damping[self.dofs] = (mass * material["damping"] / material["density"])[:, None]
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        self.inertia = self.model.dof_M0.copy()
        self.rest, self.substep = rest, substep

    @property
    def positions(self) -> Points:
        positions: Points = self.rest + self.data.qpos[self.dofs]
        return positions

    @property
    def velocities(self) -> Points:
        velocities: Points = self.data.qvel[self.dofs]
        return velocities

    def reset(self, positions: Points, velocities: Points | None = None) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self.dofs] = positions - self.rest
        self.data.qvel[self.dofs] = 0 if velocities is None else velocities

    def step(self, held: Held, dt: float) -> None:
        nodes, targets, velocities = held
        dofs, goal = self.dofs[nodes], targets - self.rest[nodes]
        count = int(np.ceil(dt / self.substep - 1e-9))
        self.model.opt.timestep = dt / count
        self.model.dof_M0[:] = self.inertia
        self.model.dof_M0[dofs] = HEAVY
        for left in range(count, 0, -1):
            self.data.qvel[dofs] = (goal - self.data.qpos[dofs]) * (count / (left * dt))
            mujoco.mj_step(self.model, self.data)
        self.data.qpos[dofs], self.data.qvel[dofs] = goal, velocities


def membrane(model: mujoco.MjModel, rest: Points, weave: Points) -> Points:
    """Matrices K (F, 3, 3) of the energy q K q / 4, q the changes of an element's squared edges, for
    the energy e C e / 2 per area, C the `weave`, e Green's strains xx, yy, xy: q = 2 A e = B^-1 e."""
    ends = rest[model.flex_edge[model.flex_elemedge.reshape(-1, 3)]]
    x, y, _ = np.moveaxis(ends[..., 1, :] - ends[..., 0, :], -1, 0)
    b = np.linalg.inv(2 * np.stack([x * x, y * y, 2 * x * y], -1))
    area = np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]) / 2
    matrices: Points = 2 * area[:, None, None] * np.swapaxes(b, 1, 2) @ weave @ b
    return matrices
