"""The environments."""

import time

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

import selvedge.gym  # noqa: E402
from selvedge import fold_error  # noqa: E402

IDS = ["selvedge/ClothFold-v0", "selvedge/ClothFoldBimanual-v0"]


@pytest.mark.parametrize("name", IDS)
@pytest.mark.filterwarnings("error")
def test_checker_is_content(name: str) -> None:
    check_env(gymnasium.make(name, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("name", IDS)
def test_same_seed_same_episode_alone_and_among_others(name: str) -> None:
    def alone(seed: int) -> list[np.ndarray]:
        env = gymnasium.make(name)
        env.reset(seed=seed)
        actions = np.random.default_rng(1).uniform(-1, 1, (30, *env.action_space.shape))
        return [env.step(action.astype(np.float32))[0]["keypoints"] for action in actions]

    first, again, other = alone(5), alone(5), alone(6)
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    for threads in (1, 2):
        envs = gymnasium.make_vec(name, num_envs=3, threads=threads)
        envs.reset(seed=4)
        shape = envs.single_action_space.shape
        actions = np.random.default_rng(1).uniform(-1, 1, (30, *shape)).astype(np.float32)
        many = [envs.step(np.tile(action, (3, 1, 1)))[0]["keypoints"][1] for action in actions]
        assert np.array_equal(first, many)


def test_reward_is_the_fall_of_the_error() -> None:
    env = gymnasium.make(IDS[0]).unwrapped
    _, info = env.reset(seed=0)
    start, total = info["error"], 0.0
    action = np.array([[0, -0.8, 0.4, 0, 0, 0, 1]], np.float32)
    for _ in range(60):
        _, reward, _, _, info = env.step(action)
        total += reward
    assert info["held"] == [4]  # two by two at the corner
    assert total == pytest.approx(100 * (start - info["error"]))
    assert abs(total) > 0.1
    folds = env.folds
    assert info["error"] == pytest.approx(fold_error(folds.positions[0], folds.ideal, folds.mesh.diagonal))
    assert 0 < info["strain"] < 1e-3


def test_two_grippers_lift_their_edge() -> None:
    env = gymnasium.make(IDS[1]).unwrapped
    env.reset(seed=0)
    for _ in range(60):
        _, _, _, _, info = env.step(np.tile(np.array([0, -0.8, 0.4, 0, 0, 0, 1], np.float32), (2, 1)))
    assert info["held"].tolist() == [4, 4]
    positions = env.folds.positions[0]
    assert positions[[-1, -12], 2] == pytest.approx([0.1182, 0.1182], abs=1e-6)  # 59 steps of 2 mm and the squeeze
    assert info["strain"] < 1e-3


def test_action_turns_and_moves() -> None:
    env = gymnasium.make(IDS[0]).unwrapped
    before, _ = env.reset(seed=0)
    for _ in range(10):
        after, *_ = env.step(np.array([[1, 0, 0.5, 0, 0, 1, -1]], np.float32))
    moved = after["grippers"][0] - before["grippers"][0]
    assert moved[:3] == pytest.approx([0.05, 0, 0.025])
    assert after["grippers"][0, 3:7] == pytest.approx([0, 0, np.sin(0.25), np.cos(0.25)])


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_autoreset(mode: AutoresetMode) -> None:
    envs = selvedge.gym.ClothFoldVector(2, max_episode_steps=3, autoreset_mode=mode, noise=0.0)
    assert envs.metadata["autoreset_mode"] is mode
    start, _ = envs.reset(seed=0)
    up = np.tile(np.array([0, 0, 1, 0, 0, 0, 1], np.float32), (2, 1, 1))
    for _ in range(2):
        _, _, _, truncated, _ = envs.step(up)
        assert not truncated.any()
    last, _, _, truncated, infos = envs.step(up)
    assert truncated.all()
    if mode is AutoresetMode.SAME_STEP:
        assert np.array_equal(last["keypoints"], start["keypoints"])
        assert infos["final_obs"][0]["keypoints"].max() > start["keypoints"].max()
        assert infos["final_obs"][1]["grippers"][0, 2] == pytest.approx(0.015)
        return
    assert last["grippers"][0, 0, 2] == pytest.approx(0.015)
    if mode is AutoresetMode.NEXT_STEP:
        after, rewards, _, truncated, _ = envs.step(up)
        assert np.array_equal(after["keypoints"], start["keypoints"])
        assert rewards.tolist() == [0, 0] and not truncated.any()
    else:
        with pytest.raises(ValueError, match="must be reset"):
            envs.step(up)
        after, _ = envs.reset(options={"reset_mask": np.array([True, False])})
        assert after["grippers"][:, 0, 2] == pytest.approx([0, 0.015])


def test_speed() -> None:
    """500 steps a second on a core; half of that is asked here, for machines with other work."""
    envs = selvedge.gym.ClothFoldVector(8)
    envs.reset(seed=0)
    actions = np.tile(np.array([0, -0.6, 0.3, 0, 0, 0, 1], np.float32), (8, 1, 1))
    start = time.process_time()
    for _ in range(100):
        envs.step(actions)
    speed = 800 / (time.process_time() - start)
    print(f"{speed:.0f} steps/s")
    assert speed > 250


def test_pictures_of_all_sheets() -> None:
    envs = gymnasium.make_vec(IDS[0], num_envs=2, render_mode="rgb_array")
    envs.reset(seed=0)
    lift = np.array([[0, 0, 1, 0, 0, 0, 1]], np.float32)
    for _ in range(12):
        envs.step(np.stack([lift, np.zeros_like(lift)]))
    lifted, flat = envs.render()
    assert lifted.shape == flat.shape and lifted.shape[2] == 3 and lifted.dtype == np.uint8
    assert flat.std() > 5  # there is something to see
    assert not np.array_equal(lifted, flat)
    alone = gymnasium.make(IDS[0], render_mode="rgb_array")
    alone.reset(seed=1)
    for _ in range(12):
        alone.step(np.zeros_like(lift))
    assert np.array_equal(alone.render(), flat)
    assert gymnasium.make_vec(IDS[0], num_envs=2).render() is None
    with pytest.raises(ValueError, match="render_mode: human"):
        gymnasium.make_vec(IDS[0], num_envs=2, render_mode="human")
