"""PPO learns to keep the car from spinning, within a minute."""

import torch
from segments import Judge, Run

from .conftest import Brief

# A sine with dwell that spins the car if nobody brakes; over when the steering is
TASK = Brief(
    env=("vse_gym/SineWithDwell-v0",),
    estimator=("truth",),
    sensors=("gaussian",),
    vehicle=("qin2014_understeer",),
    friction=(0.85, 0.95),
    speed_kmh=(78.0, 82.0),
    steer=0.05,
    mass=(1.0, 1.05),
    stiffness=(0.95, 1.0),
    duration=3.5,
)
SETTINGS = {
    "n_timesteps": 150_000,
    "n_envs": 32,
    "segments": 3,
    "policy": "MlpPolicy",
    "n_steps": 128,
    "batch_size": 1024,
    "n_epochs": 6,
    "gamma": 0.99,
    "learning_rate": "lin_2e-3",
    "policy_kwargs": {"net_arch": [32, 32], "log_std_init": -1.0},
}


def of_controller(name):
    """Mean return of drives in which nobody is on top of a controller."""
    return Judge(Brief(**{**vars(TASK), "controller": name}), 16).drive(None)[0].mean()


def test_ppo_comes_to_what_a_good_controller_has():
    torch.set_num_threads(1)
    run = Run("ppo", TASK, SETTINGS, seed=0, steps=SETTINGS["n_timesteps"], drives=16)
    untrained, _ = run.judge.drive(run.model)
    run.go_on()
    learned, early = run.judge.drive(run.model)
    esc, nobody = of_controller("esc"), of_controller("none")
    print(untrained.mean(), learned.mean(), early.mean(), esc, nobody, run.curve)
    assert learned.mean() > 0.9 * esc
    assert learned.mean() > max(nobody, untrained.mean()) + 100
    assert early.mean() == 0
