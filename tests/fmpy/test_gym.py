"""The Gymnasium environment: a loop without its controller, stepped by an agent."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from adaptive_fmu import ArgumentError, Loop, export
from adaptive_fmu.gym import LoopEnv, Signals
from gymnasium.utils.env_checker import check_env

SEEN = {"x1": "plant.x[1]", "x2": "plant.x[2]", "r": "reference.r[1]"}


def reward(signals: Signals) -> float:
    return -((signals["x1"] - signals["r"]) ** 2)


def environment(**options: object) -> LoopEnv:
    usual = {
        "without": ["controller"],
        "action": {"u": "plant.u[1]"},
        "observation": SEEN,
        "reward": reward,
        "step": 0.01,
        "until": 2.0,
        "low": -5,
        "high": 5,
    }
    return LoopEnv("3.2.1-cosine", **{**usual, **options})


def test_gymnasium_finds_nothing_wrong() -> None:
    env = environment()
    check_env(env, skip_render_check=True)
    env.close()


def test_an_agent_that_does_what_the_controller_did_gets_what_the_loop_gave() -> None:
    """The controls that were recorded of the whole loop, held between the same points, drive the plant the same way."""
    step, loop = 1e-3, Loop("3.2.1-cosine").run(until=1, step=1e-3).data
    env = environment(step=step, until=1.0)
    observation, _ = env.reset()
    np.testing.assert_allclose(observation, loop[list(SEEN.values())].iloc[0])
    # The plant takes the control that the controller gives at the beginning of a step.
    for k in range(1000):
        observation, got, over, cut, _ = env.step(np.array([loop["controller.u[1]"].iloc[k]]))
        assert not over and cut == (k == 999)
        np.testing.assert_allclose(observation, loop[list(SEEN.values())].iloc[k + 1], rtol=0, atol=2e-2)
        assert got == reward(dict(zip(SEEN, observation, strict=True)))
    env.close()


def test_a_reset_goes_back_to_the_same_start() -> None:
    env, rng = environment(), np.random.default_rng(3)
    actions = rng.uniform(-1, 1, (50, 1))
    first, _ = env.reset(seed=1)
    ran = [env.step(action)[0] for action in actions]
    for _ in range(3):
        again, _ = env.reset()
        np.testing.assert_array_equal(again, first)
        np.testing.assert_array_equal([env.step(action)[0] for action in actions], ran)
    other, _ = env.reset(options={"values": {"plant.x0": [0.5, 0.0]}})
    assert other[0] == 0.5
    back, _ = env.reset()
    np.testing.assert_array_equal(back, other)
    env.close()


def test_a_loop_that_fails_ends_the_episode_with_the_penalty() -> None:
    env = environment(until=10.0, penalty=-100.0)
    env.reset()
    for _ in range(1000):
        _, got, over, cut, info = env.step(np.array([5.0]))
        if over or cut:
            break
    assert over and got == -100.0 and "message" in info
    observation, _ = env.reset()
    assert np.isfinite(observation).all() and not env.step(np.array([0.0]))[2]
    env.close()


def test_terminated_is_the_users() -> None:
    env = environment(terminated=lambda signals: abs(signals["x1"]) > 0.2)
    env.reset()
    steps = 0
    while not env.step(np.array([3.0]))[2]:
        steps += 1
    assert 0 < steps < 199
    env.close()


def test_side_by_side_they_are_as_one_by_one() -> None:
    options = {
        "without": ["controller"],
        "action": {"u": "plant.u[1]"},
        "observation": SEEN,
        "reward": reward,
        "step": 0.01,
        "until": 2.0,
    }
    many = LoopEnv.vector(2, "3.2.1-cosine", **options)
    single = environment()
    many.reset(), single.reset()
    for value in (0.5, -0.3, 1.0):
        observations, rewards, *_ = many.step(np.full((2, 1), value))
        observation, got, *_ = single.step(np.array([value]))
        np.testing.assert_array_equal(observations, [observation, observation])
        assert list(rewards) == [got, got]
    many.close(), single.close()


def test_what_does_not_fit_is_reported_and_no_files_are_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with pytest.raises(ArgumentError, match="is not an input. Leave out the component"):
        environment(without=[])
    with pytest.raises(ArgumentError, match="has no variable `plant.nix`"):
        environment(observation=["plant.nix"])
    with pytest.raises(ArgumentError, match="must be above 0"):
        environment(step=-1.0)
    env = environment()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.0]))
    env.close()
    env.close()
    assert list(tmp_path.iterdir()) == []


def test_a_plant_of_any_tool_may_be_the_loop(tmp_path: Path) -> None:
    [fmu] = export("NonlinearSiso", out=tmp_path)
    env = LoopEnv("plant", fmu=fmu, action=["u[1]"], observation=["x[1]", "x[2]"], reward=lambda s: -(s["x[1]"] ** 2))
    observation, _ = env.reset()
    assert observation.shape == (2,) and env.step(np.array([0.1]))[0].shape == (2,)
    env.close()
