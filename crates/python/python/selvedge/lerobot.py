"""Recordings as a data set in the layout of LeRobot v3 (`meta/info.json`, Parquet chunks).

Needs the package `pyarrow`. Rows are the steps of a recording: `observation.state` holds all node
positions before the step [m], `action` the pose px py pz qx qy qz qw and the jaw of each gripper in it.
Statistics, which LeRobot computes itself, are those of the whole set.
"""

import json
import tempfile
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ._extra import extra
from ._native import Recording

VERSION = "v3.0"
FILE = "chunk-000/file-000.parquet"


def arrays(recording: Recording) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]:
    """States (T, 3 N), actions (T, 8 G) and times (T) of the steps."""
    with tempfile.TemporaryDirectory() as folder:
        recording.write(Path(folder) / "r.npz")
        with np.load(Path(folder) / "r.npz") as file:
            times, positions = file["t"][:-1], file["positions"][:-1]
            count = len(times)
            pose = file["pose"][1:].reshape(count, -1, 7)
            jaw = file["jaw"][1:].reshape(count, -1, 1)
    action = np.concatenate([pose, jaw], axis=2).reshape(count, -1)
    return positions.reshape(count, -1).astype(np.float32), action.astype(np.float32), times


def statistics(values: NDArray[np.float32]) -> dict[str, list[float]]:
    """Of each column."""
    found = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(values)]}


def to_lerobot(
    folder: str | PathLike[str], recordings: Sequence[Recording], task: str = "fold the cloth"
) -> None:
    """Writes recordings of the same cloth and grippers, one an episode, into a new folder."""
    with extra("lerobot"):
        import pyarrow as pa
        from pyarrow import parquet

    root = Path(folder)
    if root.exists():
        raise ValueError(f"folder: {root} exists, must be a new one")
    if not recordings:
        raise ValueError("recordings: none, must be one at least")
    episodes = [arrays(recording) for recording in recordings]
    if len({(state.shape[1], action.shape[1]) for state, action, _ in episodes}) != 1:
        raise ValueError("recordings: must have as many nodes and grippers each")
    lengths = [len(times) for _, _, times in episodes]
    state = np.concatenate([state for state, _, _ in episodes])
    action = np.concatenate([action for _, action, _ in episodes])
    time = np.concatenate([times for _, _, times in episodes])
    total = len(time)

    def rows(values: NDArray[np.float32]) -> "pa.FixedSizeListArray":
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])

    data = {
        "observation.state": rows(state),
        "action": rows(action),
        "timestamp": pa.array(time.astype(np.float32)),
        "frame_index": pa.array(np.concatenate([np.arange(length) for length in lengths])),
        "episode_index": pa.array(np.repeat(np.arange(len(lengths)), lengths)),
        "index": pa.array(np.arange(total)),
        "task_index": pa.array(np.zeros(total, np.int64)),
    }
    ends = np.cumsum(lengths)
    index = {
        "episode_index": list(range(len(lengths))),
        "tasks": [[task]] * len(lengths),
        "length": lengths,
        "data/chunk_index": [0] * len(lengths),
        "data/file_index": [0] * len(lengths),
        "dataset_from_index": (ends - lengths).tolist(),
        "dataset_to_index": ends.tolist(),
    }
    tasks = {"task_index": [0], "task": [task]}
    tables = {f"data/{FILE}": data, f"meta/episodes/{FILE}": index, "meta/tasks.parquet": tasks}
    for name, columns in tables.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pa.table(columns), root / name)

    def feature(dtype: str, size: int) -> dict[str, object]:
        return {"dtype": dtype, "shape": [size], "names": None}

    fps = round((len(episodes[0][2]) - 1) / (episodes[0][2][-1] - episodes[0][2][0]))
    info = {
        "codebase_version": VERSION,
        "robot_type": "gripper",
        "total_episodes": len(lengths),
        "total_frames": total,
        "total_tasks": 1,
        "fps": fps,
        "splits": {"train": f"0:{len(lengths)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {
            "observation.state": feature("float32", state.shape[1]),
            "action": feature("float32", action.shape[1]),
            "timestamp": feature("float32", 1),
            **{name: feature("int64", 1) for name in list(data)[3:]},
        },
    }
    (root / "meta/info.json").write_text(json.dumps(info, indent=4))
    stats = {"observation.state": statistics(state), "action": statistics(action)}
    (root / "meta/stats.json").write_text(json.dumps(stats))
