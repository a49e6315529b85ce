"""Types of the compiled part. Arrays that go in are float64 or float32 in C order; those that come
out are copies. What is wrong with an argument raises a `ValueError` or `TypeError` that names it."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64] | NDArray[np.float32]
Indices: TypeAlias = NDArray[np.uint32] | NDArray[np.int32] | NDArray[np.int64] | NDArray[np.uint64]
Held: TypeAlias = tuple[NDArray[np.uint32], NDArray[np.float64], NDArray[np.float64]]
Vector: TypeAlias = Sequence[float] | Floats
Rows: TypeAlias = Sequence[Vector] | Floats
Jaws: TypeAlias = Sequence[bool] | NDArray[np.bool_]
File: TypeAlias = str | PathLike[str]
Solver: TypeAlias = Literal["default", "published"]
Clip: TypeAlias = tuple[str, str, Recording, Floats | None, Sequence[tuple[float, float]]]
Table: TypeAlias = tuple[str, Sequence[tuple[str, bool, Sequence[str]]]]

__version__: str

class Pose:
    """A position [m] and a rotation x y z w, normalised; p_w = position + R p_g."""

    def __init__(
        self, position: Vector = ..., quaternion_xyzw: Vector = ...
    ) -> None: ...
    @property
    def position(self) -> list[float]:
        """[m]"""
    @property
    def quaternion_xyzw(self) -> list[float]:
        """x y z w, of length 1."""
    def inverse(self) -> Pose:
        """The inverse transform."""
    def transform(self, points: Floats) -> NDArray[np.float64]:
        """Points (N, 3) from the frame of the pose to the world."""
    def __mul__(self, other: Pose) -> Pose: ...

class BoxVolume:
    """The pinch grasp: a box of sides `size` [m], its middle at `offset` [m, gripper frame]."""

    def __init__(self, size: Vector, offset: Vector = ...) -> None: ...
    def contains(self, points: Floats) -> list[bool]:
        """Whether each of the points (N, 3) [m, gripper frame] is inside; the boundary is."""

class PyramidVolume:
    """The point grasp: a square pyramid, the base's side and the height (signed) [m]."""

    def __init__(self, side: float, height: float, offset: Vector = ...) -> None: ...
    def contains(self, points: Floats) -> list[bool]:
        """Whether each of the points (N, 3) [m, gripper frame] is inside; the boundary is."""

class Squeeze:
    """How closed jaws pull what they hold to their middle over `steps` steps."""

    def __init__(self, amount: float = 0.5, lift: float = 2e-4, steps: int = 10) -> None: ...

class Gripper:
    """A gripper with a grasping volume, and what it holds. It starts open."""

    def __init__(self, volume: BoxVolume | PyramidVolume, squeeze: Squeeze | None = None) -> None: ...
    def step(
        self,
        pose: Pose,
        closed: bool,
        positions: Floats,
        faces: Indices | None = None,
        edges: Indices | None = None,
        dt: float = ...,
        alpha: float | None = None,
    ) -> Held:
        """One step of `dt` [s]: nodes (K), targets (K, 3) [m], velocities (K, 3) [m/s] at its end."""
    def reset(self) -> None:
        """Opens the jaws and forgets what was held."""
    @property
    def nodes(self) -> NDArray[np.uint32]:
        """The held nodes, ascending."""
    @property
    def closed(self) -> bool:
        """Whether the jaws are closed."""
    @property
    def alpha(self) -> float:
        """How much of the squeeze is done, 0 to 1."""
    @property
    def event(self) -> Literal["none", "captured", "empty", "opened", "reset"]:
        """What happened in the last step."""

class Grippers:
    """Several grippers on one cloth: no node is held by two."""

    def __init__(self, grippers: Sequence[Gripper]) -> None: ...
    def step(
        self,
        poses: Rows,
        closed: Jaws,
        positions: Floats,
        faces: Indices | None = None,
        edges: Indices | None = None,
        dt: float = ...,
        anchors: Floats | None = None,
    ) -> Held:
        """One step of all: `poses` (G, 7) px py pz qx qy qz qw and `closed` (G) at its end."""
    def reset(self) -> None:
        """Opens all jaws and forgets what was held."""
    def holders(self, node_count: int) -> NDArray[np.uint8]:
        """For each node the number of the gripper that holds it, from 1, or 0."""
    @property
    def alphas(self) -> list[float]:
        """How much of each squeeze is done, 0 to 1."""

class Mesh:
    """A cloth at rest: nodes (N, 3) [m], edges and faces (F, 3) or (F, 4)."""

    def __init__(self, rest: Floats, face_array: Indices) -> None: ...
    @staticmethod
    def grid(nodes: Sequence[int], sides: Sequence[float]) -> Mesh:
        """A rectangle of `nodes` (along x and y) and `sides` [m] around the origin, at z = 0."""
    @staticmethod
    def from_obj(path: File) -> Mesh:
        """The mesh of a Wavefront OBJ file."""
    @property
    def rest(self) -> NDArray[np.float64]:
        """(N, 3) [m]"""
    @property
    def edges(self) -> NDArray[np.uint32]:
        """(E, 2)"""
    @property
    def quads(self) -> NDArray[np.uint32]:
        """(F, 4)"""
    @property
    def triangles(self) -> NDArray[np.uint32]:
        """(F, 3)"""
    @property
    def diagonal(self) -> float:
        """The scale of the folding error [m]."""
    @property
    def node_count(self) -> int:
        """N"""

class Cloth:
    """The inextensible cloth; `material` and `settings` hold what differs from the default."""

    def __init__(
        self,
        mesh: Mesh,
        material: Mapping[str, float] | None = None,
        settings: Mapping[str, float] | None = None,
        threads: int = 1,
    ) -> None: ...
    @property
    def positions(self) -> NDArray[np.float64]:
        """(N, 3) [m], a copy."""
    @property
    def velocities(self) -> NDArray[np.float64]:
        """(N, 3) [m/s], a copy."""
    def step(self, held: Held | None = None, dt: float = ...) -> dict[str, Any]:
        """Advances by `dt` [s] with the held nodes. Returns what was measured."""
    def reset(self, positions: Floats, velocities: Floats | None = None) -> None:
        """Starts anew from positions [m] and velocities [m/s] (N, 3)."""

def step_all(
    cloths: Sequence[Cloth], held: Sequence[Held | None], dt: float = ..., threads: int = 1
) -> list[dict[str, Any]]:
    """Steps several cloths on threads; the same bits with any number."""

class Worlds:
    """W worlds with the same cloth and grippers, stepped on threads."""

    def __init__(
        self,
        count: int,
        mesh: Mesh,
        grippers: Grippers,
        material: Mapping[str, float] | None = None,
        settings: Mapping[str, float] | None = None,
        threads: int = 1,
    ) -> None: ...
    def step(
        self,
        poses: Sequence[Rows] | Floats,
        closed: Sequence[Jaws] | NDArray[np.bool_],
        dt: float = ...,
    ) -> None:
        """One step of `dt` [s] with poses (W, G, 7) and closed (W, G)."""
    def reset(self, world: int, positions: Floats | None = None) -> None:
        """Starts a world anew: its cloth at rest, its grippers open."""
    @property
    def positions(self) -> NDArray[np.float64]:
        """(W, N, 3) [m], a copy."""
    @property
    def strains(self) -> NDArray[np.float64]:
        """Largest edge strain of the last step of each world (W)."""
    @property
    def failures(self) -> list[str | None]:
        """Why the last step of each world failed, or None. A cloth that failed stays as it was."""
    @property
    def held_counts(self) -> NDArray[np.uint32]:
        """How many nodes each gripper of each world holds (W, G)."""

class Sweep:
    """A way of the gripper: its tip along a quadratic Bezier curve, its orientation slerped."""

    def __init__(
        self,
        start: Vector,
        mid: Vector,
        end: Vector,
        start_xyzw: Vector,
        end_xyzw: Vector,
        orientation: Literal["slerp", "nlerp"] = "slerp",
        tip: Vector = ...,
    ) -> None: ...
    def pose(self, s: float) -> Pose:
        """The pose at `s` in [0, 1]."""

class Schedule:
    """Commands over time."""

    @staticmethod
    def fold(
        sweep: Sweep,
        close: float,
        start: float,
        open: float,
        end: float,
        law: Literal["linear", "cubic", "quintic"] = "quintic",
    ) -> Schedule:
        """Open until `close`, held until `start`, moved until `open`, open until `end` [s]."""
    @property
    def duration(self) -> float:
        """[s]"""
    def command(self, time: float) -> tuple[Pose, bool]:
        """The pose at a time [s], and whether the jaws are closed."""

class Scenario:
    """A folding experiment: one cloth, one timeline, several cases."""

    @staticmethod
    def load(path: File) -> Scenario:
        """Loads and checks a scenario file."""
    @property
    def name(self) -> str: ...
    @property
    def cases(self) -> list[str]:
        """The names of the cases."""
    @property
    def mesh(self) -> Mesh: ...
    @property
    def dt(self) -> float:
        """The period of the commands [s]."""
    def time(self, steps: int) -> float:
        """The time [s] after a number of steps."""
    @property
    def steps(self) -> int: ...
    @property
    def material(self) -> dict[str, float]:
        """SI units."""
    @property
    def gravity(self) -> float:
        """Gravitational acceleration [m/s^2]."""
    def reference(self, case: str) -> str | None:
        """The case whose end is the ideal fold of this one; None for the analytic half fold."""
    def commands(
        self, case: str
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """t (T) [s], poses (T, G, 7) px py pz qx qy qz qw, closed (T, G)."""
    def grippers(self, case: str) -> Grippers:
        """The open grippers of a case."""
    def gripper(self, case: str) -> Gripper:
        """The open gripper of a case that has one."""
    def tip_offsets(self, case: str) -> list[list[float]]:
        """Where the tip of each gripper of a case is in its frame [m]."""
    def volumes(self, case: str) -> list[dict[str, Any]]:
        """The description of a case's grasping volumes for `Recording`."""
    def cloth(self, solver: Solver = "default") -> Cloth:
        """The cloth at rest, with the settings of the file."""
    def anchors(self, solver: Solver, positions: Floats) -> NDArray[np.float64] | None:
        """What a closing gripper stores in place of the positions on that solver."""
    def run(self, case: str, solver: Solver) -> Recording:
        """Runs a case in compiled code."""

class Recording:
    """A run, frame by frame; `numpy.load` reads the files it writes."""

    def __init__(self, mesh: Mesh, grippers: int = 1, meta: str = "{}") -> None: ...
    @staticmethod
    def read(path: File) -> Recording: ...
    def push(
        self,
        time: float,
        positions: Floats,
        poses: Rows,
        closed: Jaws,
        alphas: Vector,
        holders: Sequence[int] | NDArray[np.uint8],
    ) -> None:
        """Adds the state at `time` [s]."""
    def write(self, path: File) -> None: ...
    def write_mcap(self, path: File) -> None:
        """For Foxglove and other robot tools."""
    @property
    def times(self) -> NDArray[np.float64]:
        """[s]"""
    @property
    def meta(self) -> str:
        """The description, a JSON object."""
    def positions(self, frame: int = -1) -> NDArray[np.float64]:
        """The positions (N, 3) [m] of a frame, negative from the end."""
    def picture(self, frame: int = -1, width: int = 640, height: int = 480) -> NDArray[np.uint8]:
        """A picture (height, width, 3) of a frame, drawn without a display."""
    def __len__(self) -> int: ...

def fold_error(positions: Floats, reference: Floats, diagonal: float) -> float:
    """Root mean square distance to a reference (N, 3), as a share of `diagonal` [m]."""

def half_fold(mesh: Mesh, thickness: float) -> NDArray[np.float64]:
    """The ideal half fold (N, 3) [m]: nodes with y > 0 mirrored to -y at `thickness` [m]."""

def reach(
    path: File,
    robot: Literal["fr3", "fer"] = "fr3",
    base: Vector | None = None,
    table: float = 0.0,
) -> dict[str, Any]:
    """Whether a robot can follow a command log: `feasible`, `base`, `flip`, `joints`, `blocked`, `offers`.

    `base` is x y z [m] and yaw [rad] in the frame of the log; without it the best one is searched."""

def read_log(path: File) -> dict[str, Any]:
    """A command log: `t`, `pose`, `closed`, `tip_offset`, `frame` and `source`."""

def write_log(
    path: File,
    t: Vector,
    pose: Rows,
    closed: Jaws,
    tip_offset: Vector = ...,
    source: str = "python",
) -> None:
    """Writes a command log that a robot can follow."""

def write_page(
    path: File,
    title: str,
    clips: Sequence[Clip],
    lead: str = "",
    curves: tuple[str, str] = ...,
    table: Table | None = None,
    facts: Sequence[tuple[str, str]] = ...,
    command: str = "",
) -> None:
    """Writes a page with a 3D player of clips (case, solver, recording, ideal or None, curve)."""
