"""MuJoCo's flex cloth (its package `mujoco`, 3.3 or later).

The grasp is found at closing time; nothing is compiled anew. Each node is a body on three slides. A
held one gets the velocity that takes it to its target, and an inertia so large that no force of the
cloth changes it. (MuJoCo reads the inertia of such bodies from `dof_M0`, and not from `dof_armature`.)
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from .._native import Mesh
from . import Held, Points, node_areas, triangles

HEAVY = 1e4  # [kg], some 10^8 nodes


class MuJoCo:
    """A flex whose edges keep their length by equality constraints, on the plane z = 0."""

    def __init__(
        self, mesh: Mesh, material: Mapping[str, float], gravity: float = 9.8, substep: float = 1 / 480
    ) -> None:
        rest, faces = mesh.rest, triangles(mesh)
        fall = gravity * material["gravitational_density"] / material["density"]
        radius = material["thickness"] / 2
        self.model = mujoco.MjModel.from_xml_string(f"""
            <mujoco><option gravity="0 0 {-fall}" solver="Newton" iterations="10" tolerance="1e-6"/>
            <size memory="1G"/>
            <worldbody><geom type="plane" size="0 0 1" pos="0 0 {-radius}" friction="{material["friction_table"]}"/>
            <flexcomp name="cloth" type="direct" dim="2" radius="{radius}" mass="1"
                point="{" ".join(map(repr, rest.ravel().tolist()))}"
                element="{" ".join(map(str, faces.ravel().tolist()))}">
            <edge equality="true" solref="{2 * substep} 1" solimp="0.99 0.9999 0.001"/><contact selfcollide="auto" condim="3" friction="{material["friction_cloth"]}"/>
            </flexcomp></worldbody></mujoco>""")
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
