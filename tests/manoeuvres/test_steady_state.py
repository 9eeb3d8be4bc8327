"""Steady-state and transient figures of open-loop steering and of the circle, against the linear single track."""

import math

import numpy as np
import pytest

from vse_gym.manoeuvres.script import NEEDLE
from vse_gym.manoeuvres.sine_steer import SineSteer
from vse_gym.manoeuvres.steady_circle import SteadyCircle, understeer_gradient
from vse_gym.manoeuvres.step_steer import StepSteer
from vse_gym.physics import parameters as p
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Log
from vse_gym.vehicles import names

DEG = math.pi / 180
every_car = pytest.mark.parametrize("car", names())


def figures(drive, log):
    return {c.name: c.figure for c in drive.manoeuvre.judge(log, drive.nominal).criteria}


@every_car
def test_the_circle_s_understeer_gradient_is_theory_s(car):
    drive = scenario("steady_circle", car, "clean")
    log = rollout(drive, "truth", "none", 0)
    assert drive.manoeuvre.judge(log, drive.nominal).passed
    # K is the difference of the axles' compliances, some 0.01 rad s2/m each: 1.2 % of one of them. The driving force on
    # the steered or the rear wheels, and what of the tyres' softening a cubic leaves, are of that size.
    measured, theory = understeer_gradient(log, drive.manoeuvre.settle), drive.vehicle.understeer_gradient
    assert measured == pytest.approx(theory, abs=1.2e-4)
    reported = figures(drive, log)["understeer gradient"]
    assert reported == pytest.approx(measured / DEG * p.GRAVITY, rel=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_gradient_of_a_made_up_circle_is_what_it_was_made_of(side):
    # A log of steer = l/R + K ay + c ay^2 at rising speed.
    wheelbase, gradient, softening, radius = 2.6, 0.0021, 3e-5, 80.0
    speed = np.linspace(5, 16, 500)
    truth = np.zeros((500, p.STATE_SIZE))
    truth[:, p.VX], truth[:, p.YAW_RATE] = speed, side * speed / radius
    ay = speed**2 / radius
    truth[:, p.AY] = side * ay
    blank = {field: np.zeros(500) for field in Log._fields}
    steer = side * (wheelbase / radius + gradient * ay + softening * ay**2)
    log = Log(**blank | {"time": 0.1 * np.arange(500), "truth": truth, "steer": steer, "vehicle": None})
    assert understeer_gradient(log, 0.0) == pytest.approx(gradient, rel=1e-6)
    assert math.isnan(understeer_gradient(log, 45.0))


def test_the_circle_is_driven_faster_and_faster_and_no_faster_than_asked():
    test = SteadyCircle(speed=10.0, settle=2.0, gain=0.5, most=4.0, radius=64.0)
    assert test.script(np.array([0.0, 2.0, 6.0, 100.0])).speed.tolist() == [10.0, 10.0, 12.0, 16.0]


@every_car
def test_a_small_step_s_steady_gain_is_theory_s(car):
    drive = scenario("step_steer", car, "clean", amplitude=0.2 * DEG, duration=12.0)
    log = rollout(drive, "truth", "none", 0)
    v, car_ = drive.manoeuvre.speed, drive.vehicle
    theory = v / (car_.wheelbase + car_.understeer_gradient * v * v) / car_.steering_ratio
    # The tyres' softening is 0.07 of the normalised slip, some 1e-3 here, and an oversteering car amplifies it tenfold;
    # its slowest mode, of 1.4 s, leaves exp(-11/1.4) = 4e-4.
    assert figures(drive, log)["steady gain of the yaw rate"] == pytest.approx(theory, rel=8e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_step_s_figures_are_those_of_a_known_response(side):
    # A second-order response has its peak half a damped period after its begin, higher by what its decay leaves then.
    test = StepSteer(amplitude=side * 0.5, rate=1000.0, begin=0.5, duration=5.0)
    time = 0.01 * np.arange(501)
    z, w, steady = 0.5, 12.0, 0.3
    damped = w * math.sqrt(1 - z * z)
    t = np.maximum(time - 0.5, 0.0)
    response = steady * (1 - np.exp(-z * w * t) * (np.cos(damped * t) + z * w / damped * np.sin(damped * t)))
    truth = np.zeros((501, p.STATE_SIZE))
    truth[:, p.VX], truth[:, p.YAW_RATE], truth[:, p.AY] = 20.0, side * response, side * 20 * response
    blank = {field: np.zeros(501) for field in Log._fields}
    log = Log(**blank | {"time": time, "truth": truth, "ended": "", "filled": (), "vehicle": None})
    found = {c.name: c.figure for c in test.verdict(log, None).criteria}
    assert found["peak time of the yaw rate"] == pytest.approx(
        math.pi / damped, abs=0.006
    )  # half a step, half the ramp
    assert found["overshoot of the yaw rate"] == pytest.approx(100 * math.exp(-math.pi * z * w / damped), abs=0.1)
    assert found["steady gain of the yaw rate"] == pytest.approx(steady / 0.5, rel=1e-6)
    # When 90 % is first reached has no closed form.
    low, high = 0.0, math.pi / damped
    for _ in range(50):
        mid = (low + high) / 2
        value = 1 - math.exp(-z * w * mid) * (math.cos(damped * mid) + z * w / damped * math.sin(damped * mid))
        low, high = (mid, high) if value < 0.9 else (low, mid)
    assert found["response time of the yaw rate"] == pytest.approx(low, abs=1e-3)  # straight lines between instants


def test_the_sine_is_a_sine_within_its_window_and_nothing_outside():
    test = SineSteer(amplitude=1.0, period=4.0, begin=2.0, stop=6.0)
    angles = test.hand_wheel(np.array([0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 6.0 - 1e-9]))
    np.testing.assert_allclose(angles[:-1], [0, 0, 1, 0, -1, 0, 0], atol=1e-12)
    assert abs(angles[-1]) < 1e-8  # whole periods end without a jump


@every_car
def test_the_speed_is_held_while_steering(car):
    for name in ("step_steer", "sine_steer"):
        drive = scenario(name, car, "clean")
        log = rollout(drive, "truth", "none", 0)
        # Cornering at 0.8 g with 4 deg of slip costs 0.5 m/s2, less than a step of the needle makes him press for; the
        # foot's delay and the slips of the oversteering car, three times as large, cost as much again.
        assert np.abs(np.hypot(log.truth[:, p.VX], log.truth[:, p.VY]) - drive.manoeuvre.speed).max() < 2 * NEEDLE
