"""Gymnasium environments in which grippers fold a sheet in half.

`import selvedge.gym` registers `selvedge/ClothFold-v0` and `selvedge/ClothFoldBimanual-v0`. An action
is, for each gripper, a translation [5 mm], a rotation vector [0.05 rad, world] and the jaw (closed
above 0), all in [-1, 1]. An observation holds keypoints of the cloth (K, 3) [m] and, for each gripper,
position, quaternion x y z w and jaw (G, 8). The reward is how much the folding error against the ideal
half fold has fallen, in per cent of the sheet's diagonal; `info` has `error` and `strain`. An episode ends
when the sheet cannot do what the grippers want.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._extra import extra

with extra("gym"):
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv

from . import BoxVolume, Gripper, Grippers, Mesh, Recording, Squeeze, Worlds, half_fold

Array = NDArray[np.float64]

NODES, SIDES = (12, 14), (0.42, 0.59)
DT = 1 / 60
REACH = 1.0  # [m] from the origin; grippers stay within, and above the table
MOVE, TURN = 0.005, 0.05  # [m], [rad] a step at most
THICKNESS = 1e-3
STEPS = 400
GRASP = (0.05, 0.05, 0.05)  # [m]


def spaces(grippers: int, keypoints: int) -> tuple[Any, Any]:
    """Actions and observations of one environment."""
    box = gymnasium.spaces.Box
    observation = gymnasium.spaces.Dict(
        {
            "keypoints": box(-10.0, 10.0, (keypoints, 3), np.float64),
            "grippers": box(-2.0, 2.0, (grippers, 8), np.float64),
        }
    )
    return box(-1.0, 1.0, (grippers, 7), np.float32), observation


def turned(quaternions: Array, rotations: Array) -> Array:
    """Quaternions (..., 4) x y z w, turned by rotation vectors (..., 3) [rad] in the world."""
    angle = np.linalg.norm(rotations, axis=-1, keepdims=True)
    v = rotations * np.sinc(angle / (2 * np.pi)) / 2
    w = np.cos(angle / 2)
    u, s = quaternions[..., :3], quaternions[..., 3:]
    product = np.concatenate(
        [w * u + s * v + np.cross(v, u), w * s - (v * u).sum(-1, keepdims=True)], axis=-1
    )
    result: Array = product / np.linalg.norm(product, axis=-1, keepdims=True)
    return result


def checked_mode(mode: str | None) -> str | None:
    """The render mode; raises `ValueError` for one that there is not."""
    if mode not in (None, "rgb_array"):
        raise ValueError(f'render_mode: {mode}, must be "rgb_array" or None')
    return mode


class Folds:
    """What both environments share: W sheets, each with G grippers."""

    def __init__(self, worlds: int, grippers: int, threads: int) -> None:
        self.mesh = Mesh.grid(NODES, SIDES)
        # Two that squeezed along x would pull at the taut row between them.
        squeeze = Squeeze(0.5 if grippers == 1 else 0.0, 2e-4, 10)
        jaws = [Gripper(BoxVolume(GRASP), squeeze) for _ in range(grippers)]
        settings = {"gravity": 9.8}
        self.worlds = Worlds(worlds, self.mesh, Grippers(jaws), {"thickness": THICKNESS}, settings, threads)
        self.ideal = half_fold(self.mesh, THICKNESS)
        columns, rows = np.arange(0, NODES[0], 3), np.arange(0, NODES[1], 3)
        self.keypoints = np.unique(
            (np.append(rows, NODES[1] - 1)[:, None] * NODES[0] + np.append(columns, NODES[0] - 1)).ravel()
        )
        self.poses = np.zeros((worlds, grippers, 7))
        self.closed = np.zeros((worlds, grippers), bool)
        self.positions = self.worlds.positions
        self.errors = np.zeros(worlds)
        self.failed = np.zeros(worlds, bool)

    def reset(self, world: int, noise: NDArray[np.float64]) -> None:
        """A sheet at rest and open grippers above its far corners, moved by `noise` (G, 2) [m]."""
        self.worlds.reset(world)
        corners = self.mesh.rest[[-1, -NODES[0]]][: len(noise)]
        self.poses[world] = [0, 0, 0, 0, 0, 0, 1]
        self.poses[world, :, :3] = corners
        self.poses[world, :, :2] += noise
        self.closed[world] = False
        self.positions[world] = self.mesh.rest
        self.errors[world] = self.error()[world]

    def step(self, actions: Array) -> Array:
        """Rewards (W) of actions (W, G, 7)."""
        actions = np.clip(np.asarray(actions, np.float64), -1, 1)
        place = self.poses[..., :3] + MOVE * actions[..., :3]
        self.poses[..., :3] = np.clip(place, [-REACH, -REACH, 0], REACH)
        self.poses[..., 3:] = turned(self.poses[..., 3:], TURN * actions[..., 3:6])
        self.closed = actions[..., 6] > 0
        self.worlds.step(self.poses, self.closed, DT)
        self.positions = self.worlds.positions
        before, self.errors = self.errors, self.error()
        rewards: Array = 100 * (before - self.errors)
        self.failed = np.array([failure is not None for failure in self.worlds.failures])
        return rewards

    def error(self) -> Array:
        """The folding error of each world, as `selvedge.fold_error` computes it."""
        squares = ((self.positions - self.ideal) ** 2).sum(axis=2)
        errors: Array = np.sqrt(squares.mean(axis=1)) / self.mesh.diagonal
        return errors

    def picture(self, world: int) -> NDArray[np.uint8]:
        """A sheet and its grippers as they are now, (H, W, 3)."""
        grippers = self.closed.shape[1]
        recording = Recording(self.mesh, grippers)
        holders = [0] * self.mesh.node_count
        recording.push(
            0.0, self.positions[world], self.poses[world], self.closed[world], [0.0] * grippers, holders
        )
        return recording.picture()

    def observations(self) -> dict[str, Array]:
        """Of all worlds."""
        jaws = self.closed[..., None].astype(np.float64)
        grippers = np.concatenate([self.poses, jaws], axis=2)
        return {"keypoints": self.positions[:, self.keypoints], "grippers": grippers}


class ClothFold(gymnasium.Env[dict[str, Array], NDArray[np.float32]]):
    """One sheet. An episode is cut off after 400 steps of 1/60 s."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 60}

    def __init__(self, grippers: int = 1, render_mode: str | None = None, noise: float = 0.005) -> None:
        self.folds, self.noise = Folds(1, grippers, 1), noise
        self.render_mode = checked_mode(render_mode)
        self.action_space, self.observation_space = spaces(grippers, len(self.folds.keypoints))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        super().reset(seed=seed)
        grippers = self.folds.closed.shape[1]
        self.folds.reset(0, self.np_random.uniform(-self.noise, self.noise, (grippers, 2)))
        return self.observation(), self.info()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        reward = float(self.folds.step(np.asarray(action, np.float64)[None])[0])
        return self.observation(), reward, bool(self.folds.failed[0]), False, self.info()

    def observation(self) -> dict[str, Array]:
        return {name: value[0] for name, value in self.folds.observations().items()}

    def info(self) -> dict[str, Any]:
        worlds = self.folds.worlds
        return {
            "error": float(self.folds.errors[0]),
            "strain": float(worlds.strains[0]),
            "held": worlds.held_counts[0].astype(np.int64),
        }

    def render(self) -> NDArray[np.uint8] | None:
        return self.folds.picture(0) if self.render_mode == "rgb_array" else None


class ClothFoldVector(VectorEnv[dict[str, Array], NDArray[np.float32], Any]):
    """Many sheets, stepped on Rust threads. The same trajectories with any number of threads."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 60}

    def __init__(
        self,
        num_envs: int = 1,
        grippers: int = 1,
        threads: int = 1,
        noise: float = 0.005,
        max_episode_steps: int = STEPS,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = checked_mode(render_mode)
        self.num_envs, self.noise, self.limit = num_envs, noise, max_episode_steps
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.folds = Folds(num_envs, grippers, threads)
        self.single_action_space, self.single_observation_space = spaces(grippers, len(self.folds.keypoints))
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.generators = [np.random.default_rng() for _ in range(num_envs)]
        self.ages = np.zeros(num_envs, int)
        self.over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """All, or those of `options["reset_mask"]`; environment k has the seed `seed + k`."""
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        if np.shape(mask) != (self.num_envs,):
            raise ValueError(f"reset_mask: shape is {np.shape(mask)}, must be ({self.num_envs},)")
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        for world in np.flatnonzero(mask):
            own = None if seeds is None else seeds[int(world)]
            if own is not None:
                self.generators[world] = np.random.default_rng(own)
        self.restart(np.asarray(mask, bool))
        return self.folds.observations(), self.infos()

    def restart(self, mask: NDArray[np.bool_]) -> None:
        shape = (self.folds.closed.shape[1], 2)
        for world in np.flatnonzero(mask):
            noise = self.generators[world].uniform(-self.noise, self.noise, shape)
            self.folds.reset(int(world), noise)
        self.ages[mask] = 0
        self.over[mask] = False

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[dict[str, Array], Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        restarted = self.over.copy()
        if restarted.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            raise ValueError(f"environments {np.flatnonzero(restarted)} are over, must be reset")
        rewards = self.folds.step(np.asarray(actions, np.float64))
        self.ages += 1
        if restarted.any():  # NEXT_STEP: their action has no effect
            self.restart(restarted)
            rewards[restarted] = 0
        terminated = self.folds.failed & ~restarted
        truncated = (self.ages >= self.limit) & ~terminated
        self.over = terminated | truncated
        infos: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self.over.any():
            over = self.over.copy()
            final = {name: value.copy() for name, value in self.folds.observations().items()}
            ends = np.full(self.num_envs, None, object)
            for world in np.flatnonzero(over):
                ends[world] = {name: value[world] for name, value in final.items()}
            infos = {"final_obs": ends, "_final_obs": over, "final_info": self.infos()}
            infos["_final_info"] = over
            self.restart(over)
        infos.update(self.infos())
        return self.folds.observations(), rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture a sheet, as they are now: those that have ended and are to be reset show their end."""
        if self.render_mode is None:
            return None
        return tuple(self.folds.picture(world) for world in range(self.num_envs))

    def infos(self) -> dict[str, Any]:
        every = np.ones(self.num_envs, bool)
        infos = {"error": self.folds.errors.copy(), "strain": self.folds.worlds.strains}
        return {**infos, **{f"_{name}": every.copy() for name in infos}}


for name, count in (("ClothFold", 1), ("ClothFoldBimanual", 2)):
    gymnasium.register(
        f"selvedge/{name}-v0",
        entry_point="selvedge.gym:ClothFold",
        vector_entry_point="selvedge.gym:ClothFoldVector",
        max_episode_steps=STEPS,
        kwargs={"grippers": count},
    )
