"""The plant against the linear single track, and its two integrators against each other."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import (
    advance,
    rolling_start,
)
from vse_gym.physics.reference import advance_reference
from vse_gym.vehicles import load, names

CARS = [car for car in names() if isinstance(load(car).body, p.RigidBody)]  # the others: test_roll.py
NOTHING = np.zeros(4)
KMH = 1 / 3.6
every_car = pytest.mark.parametrize("car", CARS)


def with_linear_tyres(vehicle, slip_stiffness=None):
    front, rear = (
        p.LinearTyre(slip_stiffness or t.slip_stiffness, t.cornering_stiffness)
        for t in (vehicle.front_tyre, vehicle.rear_tyre)
    )
    return vehicle._replace(front_tyre=front, rear_tyre=rear)


def coast(vehicle, road, state, seconds, steer=0.0, drive=NOTHING, brake=NOTHING):
    return advance(vehicle, road, state, p.Inputs(steer, drive, brake), round(1000 * seconds), 1e-3)


def fast_but_stable(vehicle):
    """80 km/h, or half the speed at which the car becomes unstable [m/s]."""
    return min(80 * KMH, 0.5 * vehicle.critical_speed)


def yaw_gain_error(vehicle, speed):
    """Yaw rate in a steady turn of 0.2 m/s2, relative to the linear single track r = v steer/(l + K v^2), less one."""

    def gain(v):
        return v / (vehicle.wheelbase + vehicle.understeer_gradient * v**2)

    steer = 0.2 / speed / gain(speed)
    state = coast(vehicle, p.road((0.0, 0.9)), rolling_start(vehicle, speed), 8.0, steer)
    return state[p.YAW_RATE] / (steer * gain(state[p.VX])) - 1  # at the speed that is left: cornering drags a little


@pytest.mark.parametrize(("car", "speed"), [("qin2014_understeer", 80), ("qin2014", 30)])
def test_turns_as_the_linear_single_track_does(car, speed):
    # The tyre softens by 0.0668 of the normalised slip, 0.2/(0.9 g) = 0.023 here: by 0.15 %. What of it does not
    # cancel between the axles is 0.035 % of the gain at the first, 0.016 % at the second.
    assert abs(yaw_gain_error(load(car), speed * KMH)) < 5e-4


@every_car
def test_turns_as_the_linear_single_track_does_with_linear_tyres(car):
    # Left are cosines of angles below 0.02 rad, the car's width, and a speed that falls while the car settles.
    vehicle = with_linear_tyres(load(car))
    assert abs(yaw_gain_error(vehicle, fast_but_stable(vehicle))) < 5e-5


@every_car
def test_answers_a_small_step_of_steer_as_the_linear_single_track_does(car):
    # On tyres so stiff along that the wheels follow the car at once: with their own they do so some 2 to 8 ms late.
    vehicle = with_linear_tyres(load(car), slip_stiffness=1e6)
    v, steer, (m, inertia, a, b) = fast_but_stable(vehicle), 1e-3, vehicle[:4]
    # Turning the car also spins the outer wheels up and the inner ones down, which adds 1 % to its inertia.
    squares = 2 * (vehicle.track_front / 2) ** 2 + 2 * (vehicle.track_rear / 2) ** 2
    inertia += vehicle.wheel_inertia / vehicle.wheel_radius**2 * squares
    front, rear = 2 * vehicle.front_tyre.cornering_stiffness, 2 * vehicle.rear_tyre.cornering_stiffness
    of_vy_and_yaw_rate = np.array(
        [
            [-(front + rear) / (m * v), (b * rear - a * front) / (m * v) - v],
            [(b * rear - a * front) / (inertia * v), -(a**2 * front + b**2 * rear) / (inertia * v)],
        ]
    )
    settled = np.linalg.solve(of_vy_and_yaw_rate, [-front * steer / m, -a * front * steer / inertia])
    for seconds in (0.05, 0.1, 0.2, 0.5, 1.0):
        linear = settled - expm(of_vy_and_yaw_rate * seconds) @ settled
        state = advance_reference(
            vehicle,
            p.road((0.0, 0.9)),
            rolling_start(vehicle, v),
            p.Inputs(steer, NOTHING, NOTHING),
            int(1e4 * seconds),
            1e-4,
        )
        # Left are the cosine of 1 mrad, and wheels that follow some 0.3 ms late.
        np.testing.assert_allclose(state[[p.VY, p.YAW_RATE]], linear, rtol=0, atol=1e-4 * np.abs(settled).max())


@every_car
@pytest.mark.parametrize(("integrator", "order"), [(advance, 1), (advance_reference, 4)], ids=["advance", "reference"])
def test_converges_with_its_order(car, integrator, order):
    # With linear tyres and constant inputs everything is smooth. Below 0.5 ms the reference's error is rounding.
    vehicle, road = with_linear_tyres(load(car)), p.road((0.0, 0.9))
    start, inputs = rolling_start(vehicle, 20.0), p.Inputs(0.08, np.array([100.0, 100.0, 0.0, 0.0]), NOTHING)
    exact = advance_reference(vehicle, road, start, inputs, 6400, 1e-4)
    motion = [p.VX, p.VY, p.YAW_RATE]
    errors = []
    for steps in (160, 320, 640):  # 4, 2 and 1 ms; the wheels' pole of -540 1/s makes Runge-Kutta unstable above 5 ms
        errors.append(np.abs(integrator(vehicle, road, start, inputs, steps, 0.64 / steps) - exact)[motion].max())
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(observed, order, atol=0.25)  # the next term of the error is some per cent of the first


@every_car
def test_the_default_step_follows_the_reference_at_the_limit(car):
    # 100 deg of hand wheel brings either car to its limit; above, a drive without control ends in a spin, where
    # small differences grow. 1 to 2 deg/s is what first order costs at 1 ms.
    vehicle, road = load(car), p.road((0.0, 0.9))
    coarse = fine = rolling_start(vehicle, 80 * KMH)
    largest, grip = 0.0, 0.0
    for k in range(300):
        since = 0.01 * k if 0.01 * k < 0.75 / 0.7 else max(0.75 / 0.7, 0.01 * k - 0.5)
        angle = math.radians(100) / vehicle.steering_ratio * math.sin(2 * math.pi * 0.7 * since) * (since < 1 / 0.7)
        inputs = p.Inputs(angle, NOTHING, NOTHING)
        coarse = advance(vehicle, road, coarse, inputs, 10, 1e-3)
        fine = advance_reference(vehicle, road, fine, inputs, 100, 1e-4)
        largest = max(largest, abs(coarse[p.YAW_RATE] - fine[p.YAW_RATE]))
        grip = max(grip, abs(fine[p.AY]))
    assert math.degrees(largest) < 2
    assert grip > 0.8 * 0.9 * p.GRAVITY  # it was the limit
