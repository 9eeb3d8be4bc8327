"""The peers' half of speed.py, run in their own virtual environment with this package's source on PYTHONPATH.

Started with the path of a pickled drive (models, inputs, readings), it reads one request a line from standard input, a
JSON list of a name in REQUESTS and its arguments, and answers each with one line of JSON. So it lives on while
speed.py alternates between its own measurements and those here.

filterpy's Kalman filters are in peers_filterpy.py; here are a particle filter in NumPy, and environments.
"""

import contextlib
import json
import math
import sys
import time
from importlib.metadata import version
from itertools import cycle, islice

import numpy as np
from filterpy.monte_carlo import systematic_resample
from peers_filterpy import DRIVES as KALMAN_DRIVES
from peers_filterpy import drive_extended, heeded, model, readings

from vse_gym.inference.model import advance, attend, observe
from vse_gym.models.channels import BRAKING
from vse_gym.models.single_track import SLOWEST
from vse_gym.physics.parameters import GRAVITY
from vse_gym.physics.tyres import KNOT

# -- a bootstrap particle filter in NumPy ---------------------------------------------------------------------------


def held(u):
    """As in vse_gym.models: what the inputs alone determine, so that it is computed once for all particles."""
    steer, brake, drive = float(u[0]), u[1:5].tolist(), u[5:9].tolist()
    wished = [(d - b) / model.wheel_radius for d, b in zip(drive, brake, strict=True)]
    weight = model.mass * GRAVITY
    total = max(-model.friction * weight, min(model.friction * weight, sum(wished)))
    load_front = max(0.0, (weight * model.lr - total * model.height) / (model.lf + model.lr))
    loads = (load_front, load_front, weight - load_front, weight - load_front)
    fl, fr, rl, rr = (
        max(-0.5 * model.friction * load, min(0.5 * model.friction * load, force))
        for load, force in zip(loads, wished, strict=True)
    )
    cos, sin = math.cos(steer), math.sin(steer)
    moment = 0.5 * (model.track_front * (fr - fl) * cos + model.track_rear * (rr - rl)) * model.brake_moment
    limits = [model.friction * load + 1e-9 for load in loads[1:3]]
    left = [math.sqrt(max(0.01, 1 - (f / m) ** 2)) for f, m in zip((fl + fr, rl + rr), limits, strict=True)]
    return cos, sin, fl + fr, rl + rr, moment, limits, left


def lateral(tan_alpha, stiffness, limit, left):
    """Lateral force of an axle, (N,)."""
    theta = stiffness / limit * tan_alpha
    t = np.minimum(np.abs(theta), KNOT)
    return np.copysign(limit * left * t * (1 - t * (0.0668 + 0.1032 * t)), theta)


def forces(given, vx, vy, r):
    """Specific forces and yaw acceleration of all particles, three times (N,)."""
    cos, sin, front, rear, moment, limits, left = given
    speed = np.maximum(vx, SLOWEST)
    vy_front = vy + model.lf * r
    tan_front = (speed * sin - vy_front * cos) / np.maximum(speed * cos + vy_front * sin, SLOWEST)
    side_front = lateral(tan_front, model.stiffness_front, limits[0], left[0])
    side_rear = lateral((model.lr * r - vy) / speed, model.stiffness_rear, limits[1], left[1])
    across = side_front * cos + front * sin
    turn = (model.lf * across - model.lr * side_rear + moment) / model.yaw_inertia
    return (front * cos - side_front * sin + rear) / model.mass, (across + side_rear) / model.mass, turn


def advance_numpy(states, given):
    """Heun's method for all particles: (3, N) to (3, N)."""
    vx, vy, r = states
    ax, ay, dr = forces(given, vx, vy, r)
    dvx, dvy = ax + vy * r, ay - vx * r
    h = model.dt
    wx, wy, q = vx + h * dvx, vy + h * dvy, r + h * dr
    ax, ay, dq = forces(given, wx, wy, q)
    return states + 0.5 * h * np.stack((dvx + ax + wy * q, dvy + ay - wx * q, dr + dq))


def observe_numpy(states, given):
    """Readings expected of all particles: (3, N) to (10, N), zero for the sensors that are not on board."""
    vx, vy, r = states
    cos, sin = given[:2]
    ax, ay, _ = forces(given, vx, vy, r)
    across, front, rear = (vy + model.lf * r) * sin, 0.5 * model.track_front * r, 0.5 * model.track_rear * r
    wheels = ((vx - front) * cos + across, (vx + front) * cos + across, vx - rear, vx + rear)
    nothing = np.zeros((3, vx.size))
    return np.concatenate((np.stack((ax, ay, r, *(w / model.wheel_radius for w in wheels))), nothing))


def attend_python(memory, u, y):
    """As in vse_gym.models, on lists: for seven numbers that is faster than NumPy."""
    speeds, brake = y[3:7].tolist(), u[1:5].tolist()
    memory, reference = [0.0 if b > BRAKING else m + model.dt for b, m in zip(brake, memory, strict=False)], memory[4]
    variances = np.where(np.isnan(y), np.nan, model.variances)
    heard = [i for i in range(4) if speeds[i] == speeds[i]]
    rolling = [i for i in heard if memory[i] >= model.brake_hold]
    for i in heard:
        rolls = memory[i] >= model.brake_hold
        variances[3 + i] = model.variances[3 + i] + (model.slip * speeds[i]) ** 2 if rolls else np.nan
    if rolling:
        return variances, [*memory, model.wheel_radius * sum(speeds[i] for i in rolling) / len(rolling)]
    felt = min(0.0, float(y[0])) if y[0] == y[0] else -model.friction * GRAVITY
    reference += model.dt * (felt - model.brake_margin)
    i = max(heard, key=speeds.__getitem__, default=None)
    if i is not None and model.wheel_radius * speeds[i] >= reference:
        reference = model.wheel_radius * speeds[i]
        variances[3 + i] = model.variances[3 + i] + (model.brake_slip * speeds[i]) ** 2
    return variances, [*memory, reference]


def drive_particles(size):
    """Means (T, 3) of a bootstrap filter, resampled below half the effective size, and covariances."""
    rng = np.random.default_rng(0)
    spread = np.linalg.cholesky(model.process_cov)
    states = model.prior_mean[:, None] + np.linalg.cholesky(model.prior_cov) @ rng.standard_normal((3, size))
    weights, memory = np.full(size, 1 / size), model.memory.tolist()
    means, covs = np.empty((len(readings), 3)), np.empty((len(readings), 3, 3))
    for k, (u, y) in enumerate(zip(heeded, readings, strict=True)):
        given = held(u)
        states = advance_numpy(states, given) + spread @ rng.standard_normal((3, size))
        variances, memory = attend_python(memory, u, y)
        used = ~np.isnan(variances)
        innovation = y[used, None] - observe_numpy(states, given)[used]
        logs = -0.5 * (1 / variances[used]) @ innovation**2
        weights = weights * np.exp(logs - logs.max())
        weights /= weights.sum()
        means[k] = mean = states @ weights
        centred = states - mean[:, None]
        covs[k] = (weights * centred) @ centred.T
        if 1 / (weights @ weights) < 0.5 * size:
            states = states[:, systematic_resample(weights)]
            weights = np.full(size, 1 / size)
    return means, covs


def particle_model_error():
    """Largest difference between the model in NumPy and the compiled one, over the drive [SI]."""
    states = drive_extended()[0].T + np.random.default_rng(0).standard_normal((3, len(readings)))
    worst, memory, listed = 0.0, model.memory, model.memory.tolist()
    for u, y in zip(heeded, readings, strict=True):
        given = held(u)
        variances, memory = attend(model, memory, u, y)
        mine, listed = attend_python(listed, u, y)
        pairs = (
            (advance_numpy(states, given), advance(model, states, u)),
            (observe_numpy(states, given), observe(model, states, u)),
            (mine, variances),
        )
        for ours, theirs in pairs:
            np.testing.assert_array_equal(np.isnan(ours), np.isnan(theirs))
            worst = max(worst, float(np.nanmax(np.abs(ours - theirs))))
    return worst


# -- environments ---------------------------------------------------------------------------------------------------

_environments = {}


def steps_per_second(name, duration, chunk):
    """Of an environment under random actions drawn beforehand, with the resets that come up."""
    if name not in _environments:
        import gymnasium
        import highway_env

        gymnasium.logger.min_level = gymnasium.logger.ERROR  # racetrack-v0 has a successor; it is meant all the same
        gymnasium.register_envs(highway_env)
        env = gymnasium.make(name)
        env.action_space.seed(0)
        env.reset(seed=0)
        _environments[name] = env, cycle([env.action_space.sample() for _ in range(256)])
    env, actions = _environments[name]
    steps, start = 0, time.process_time()
    while (spent := time.process_time() - start) < duration:
        for action in islice(actions, chunk):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        steps += chunk
    return steps / spent


DRIVES = KALMAN_DRIVES | {"pf": drive_particles}


def drive(kind, *settings):
    """Estimates of the recorded drive: vx, vy, yaw rate by step; then their covariances."""
    return [a.tolist() for a in DRIVES[kind](*settings)]


def seconds_per_update(kind, *settings):
    """Processor time of the whole drive over its steps [s]."""
    start = time.process_time()
    DRIVES[kind](*settings)
    return (time.process_time() - start) / len(readings)


def versions():
    """Of everything measured here."""
    return {name: version(name) for name in ("filterpy", "highway-env", "gymnasium", "numba", "numpy", "scipy")}


REQUESTS = {f.__name__: f for f in (drive, seconds_per_update, steps_per_second, particle_model_error, versions)}

if __name__ == "__main__":
    answers = sys.stdout
    with contextlib.redirect_stdout(sys.stderr):  # libraries greet on standard output
        for line in sys.stdin:
            request, *arguments = json.loads(line)
            print(json.dumps(REQUESTS[request](*arguments)), file=answers, flush=True)
