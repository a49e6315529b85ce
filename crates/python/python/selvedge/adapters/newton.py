"""Newton's VBD cloth on the processor (its packages `newton` and `warp-lang`).

A held particle is not ACTIVE, so that the solver leaves it where it is; in each substep it is set on
its way. On the processor `numpy()` of a warp array is a view of it.
"""

from collections.abc import Mapping

import newton
import numpy as np
import warp as wp

from .._native import Mesh
from . import Held, Points, triangles


class Newton:
    """A cloth of triangles and bending edges on the plane z = 0, its layers in contact."""

    def __init__(
        self,
        mesh: Mesh,
        material: Mapping[str, float],
        gravity: float = 9.8,
        substep: float = 1 / 600,
        iterations: int = 10,
        stiffness: float = 1e4,
    ) -> None:
        wp.config.log_level = wp.LOG_WARNING
        thickness, density = material["thickness"], material["density"]
        fall = gravity * material["gravitational_density"] / density
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, -fall))
        builder.add_ground_plane(height=-thickness / 2)
        builder.add_cloth_mesh(
            pos=wp.vec3(0, 0, 0), rot=wp.quat_identity(), vel=wp.vec3(0, 0, 0), scale=1.0,
            vertices=[wp.vec3(*p) for p in mesh.rest.tolist()],
            indices=triangles(mesh).ravel().tolist(),
            density=density, particle_radius=thickness / 2,
            tri_ke=material["shear"], tri_ka=0.0, tri_kd=0.0, edge_ke=material["bending"], edge_kd=0.0,
        )  # fmt: skip
        for i, j in mesh.edges.tolist():
            builder.add_spring(i, j, ke=stiffness, kd=0.0, control=0.0)
        builder.color(include_bending=True)
        self.model = builder.finalize(device="cpu")
        self.model.soft_contact_ke, self.model.soft_contact_kd = 1e3, 0.0
        self.model.soft_contact_mu = material["friction_cloth"]
        self.solver = newton.solvers.SolverVBD(
            self.model, iterations=iterations, particle_enable_self_contact=True,
            particle_self_contact_margin=thickness, particle_self_contact_gap=thickness,
        )  # fmt: skip
        self.collisions = newton.CollisionPipeline(self.model)
        self.contacts = self.collisions.contacts()
        self.states = [self.model.state(), self.model.state()]
        self.flags = self.model.particle_flags.numpy()
        self.captured = 0.0  # the substep of the recorded graph
        self.decay, self.substep = material["damping"] / density, substep

    @property
    def positions(self) -> Points:
        return np.array(self.states[0].particle_q.numpy(), np.float64)

    @property
    def velocities(self) -> Points:
        return np.array(self.states[0].particle_qd.numpy(), np.float64)

    def reset(self, positions: Points, velocities: Points | None = None) -> None:
        self.states[0].particle_q.numpy()[:] = positions
        self.states[0].particle_qd.numpy()[:] = 0 if velocities is None else velocities

    def step(self, held: Held, dt: float) -> None:
        nodes, targets, velocities = held
        self.flags[:] = int(newton.ParticleFlags.ACTIVE)
        self.flags[nodes] = 0
        start = self.positions[nodes]
        count = int(np.ceil(dt / self.substep - 1e-9))
        if self.captured != dt / count:
            with wp.ScopedCapture(device="cpu") as capture:
                self.simulate(dt / count)
            self.graph, self.captured = capture.graph, dt / count
        state = self.states[0]
        for k in range(count):
            state.particle_q.numpy()[nodes] = start + (targets - start) * ((k + 1) / count)
            wp.capture_launch(self.graph)
            state.particle_qd.numpy()[:] *= np.exp(-self.decay * dt / count)
            state.particle_qd.numpy()[nodes] = velocities

    def simulate(self, h: float) -> None:
        """A substep of `h` [s], which is recorded once: calls from Python take longer than it."""
        now, after = self.states
        now.clear_forces()
        self.collisions.collide(now, self.contacts)
        self.solver.step(now, after, None, self.contacts, h)
        wp.copy(now.particle_q, after.particle_q)
        wp.copy(now.particle_qd, after.particle_qd)
