"""Braking one side turns the car: a single track that does not know it is wrong exactly when the controller acts."""

import numpy as np

from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.models import SingleTrackTuning
from vse_gym.physics import parameters as p
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout


def yaw_rate_error(brake_moment, friction):
    """RMSE of the yaw rate while brakes act, of a filter without a good gyro, in the truth's drive [deg/s]."""
    drive = scenario("sine_with_dwell", friction=friction)
    log = rollout(drive, "truth", "esc", seed=0)
    tuning = SingleTrackTuning(yaw_noise=0.05, yaw_rate_error=0.2, brake_moment=brake_moment)
    trace = shadow(log, ExtendedKalmanFilter(tuning), drive.nominal, 0)
    braking = log.brake.max(axis=1) > 200
    assert braking.sum() > 100
    return np.degrees(np.sqrt(np.mean((trace.estimate[:, 2] - log.truth[:, p.YAW_RATE])[braking] ** 2)))


def test_the_brakes_yaw_moment_makes_the_model_follow_while_the_controller_acts():
    # On the friction that the model is told, where nothing else is wrong with it by as much: 0.9.
    assert yaw_rate_error(brake_moment=True, friction=0.9) < 0.7 * yaw_rate_error(brake_moment=False, friction=0.9)
