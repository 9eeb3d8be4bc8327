"""The closed loop: driver, brake unit, vehicle, sensors, estimator, controller, wired once."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.compiled import compiled, hold
from vse_gym.controllers.allocation import as_torques
from vse_gym.controllers.base import Controller
from vse_gym.ending import BEYOND_MODEL, ENDINGS, GOES_ON, OFF_COURSE, ending
from vse_gym.estimators.base import Estimator
from vse_gym.listener import EstimatorError, Listener
from vse_gym.logbook import LogBook
from vse_gym.multibody import MultiBody
from vse_gym.physics import parameters as p
from vse_gym.physics.brakes import brake_torques, drive_torques, released_brakes
from vse_gym.physics.double_track import advance, road_friction, rolling_start
from vse_gym.physics.reference import advance_reference
from vse_gym.scenarios import Scenario
from vse_gym.sensing import NoiseRecord, read_sensors, unread_sensors
from vse_gym.sensors import stream
from vse_gym.types import NO_BRAKE, NO_TORQUE, Array, BrakeDemand, Car, Estimate, Log, Reading


@compiled
def next_row(constants, runge_kutta, substeps, h, memory, state, sensed, steer, held, velocity, k):
    """One row's way from a demand to the next reading: brake unit, plant, sensors, in one call.

    Three calls would pass the same arrays three times.

    Args:
        constants: hold((brake unit, geometry, vehicle, road, noise record)) of the drive.
        runge_kutta: Whether the reference integrator is used.
        substeps: Steps of the plant, of h seconds each.
        h: [s].
        memory: Of the brake unit, see :func:`released_brakes`.
        state: Of the plant, (STATE_SIZE,).
        sensed: Memory of the sensors, (1 + delay steps, 10); its first row is the last valid value of each channel.
        steer: Road-wheel angle [rad].
        held: The driver's drive and brake torques, what is added and released, (4, 4).
        velocity: Estimated vx, vy, yaw rate.
        k: Step of the reading.

    Returns:
        memory, state, u (9,), y (10,), sensed, as they are at step k.
    """
    unit, geometry, vehicle, road, record = constants.value
    memory = brake_torques(unit, geometry, memory, held[1], held[2], held[3], sensed[0], velocity, steer, substeps * h)
    drive = drive_torques(held[0], held[2])
    inputs = p.Inputs(steer + vehicle.steering_offset, drive, memory[0])
    if runge_kutta:
        state = advance_reference(vehicle, road, state, inputs, substeps, h)
    else:
        state = advance(vehicle, road, state, inputs, substeps, h)
    u, y, sensed = read_sensors(record, k, state, p.Inputs(steer, drive, memory[0]), sensed)
    return memory, state, u, y, sensed


class Frame(NamedTuple):
    """One instant of a drive."""

    truth: Car
    reading: Reading
    estimate: Estimate
    brake: Array  # torques that acted until now, (4,) [N m]


class Simulation:
    """One drive in the making; the only object of the loop that changes.

    ``reset`` and ``step`` hand out frames; whoever calls decides the brake demand, from the estimate if it is fair.
    """

    def __init__(self, scenario: Scenario, estimator: str | Estimator):
        self.scenario = scenario
        self.estimator: Estimator = ESTIMATORS.make(estimator)
        self.road = scenario.road
        self._multibody = scenario.multibody()
        self._geometry = scenario.nominal.vehicle.geometry  # the brake unit's own idea of the car

    def reset(self, seed: int) -> Frame:
        """Start a drive: the same seed gives the same noise, whatever the estimator."""
        s = self.scenario
        self.k, self.ended = 0, ""
        self.record: NoiseRecord = s.sensors.record(s.steps + 1, s.dt, seed)
        self._constants = hold((s.brake_unit, self._geometry, s.vehicle, self.road, self.record))
        self.listener = Listener(self.estimator, s.nominal, stream(seed, "estimator"))
        self.state: Array = rolling_start(s.vehicle, s.manoeuvre.speed)
        if self._multibody is not None:
            self._bodies, self.state = self._multibody.start(s.manoeuvre.speed)
        self._lost = False
        self._driver_state = s.manoeuvre.init(replace(s.nominal, vehicle=s.vehicle))  # he knows his own car
        self._unit = released_brakes(s.brake_unit, s.dt)
        self.hand_wheel, self.steer = 0.0, 0.0
        rest = p.Inputs(0.0, NO_TORQUE, NO_TORQUE)
        self._sensed: Array = unread_sensors(self.record.delay, self.state)
        u, y, self._sensed = read_sensors(self.record, 0, self.state, rest, self._sensed)
        return self._sense(Reading(0.0, u, y))

    @property
    def heard(self) -> Array:
        """Last valid value of each channel, (10,)."""
        heard: Array = self._sensed[0]
        return heard

    @property
    def time(self) -> float:
        """[s]."""
        return self.k * self.scenario.dt

    @property
    def done(self) -> bool:
        """Whether the drive is over: it ended, or its time is up."""
        return bool(self.ended) or self.k >= self.scenario.steps

    @property
    def friction(self) -> float:
        """Of the road, mean of the four wheels [-]."""
        return float(road_friction(self.scenario.vehicle, self.road, self.state[p.DISTANCE]))

    def step(self, demand: BrakeDemand = NO_BRAKE) -> Frame:
        """Drive on to the next reading under a brake demand.

        Raises:
            RuntimeError: If the drive is over.
            ValueError: If the demand or what the driver does is not four finite numbers each.
            EstimatorError: If the estimator raises.
        """
        if self.done:
            raise RuntimeError(f"the drive is over ({self.ended or 'its time is up'}): call reset")
        s = self.scenario
        driver, self._driver_state = s.manoeuvre.drive(self._driver_state, self.time, Car(self.state))
        steer = driver.hand_wheel / s.vehicle.steering_ratio
        held = np.array((driver.drive, driver.brake, demand.added, demand.release), dtype=float)
        if held.shape != (4, 4) or not math.isfinite(sum(held.ravel().tolist())):
            raise ValueError(f"drive, brake, added and release are four finite numbers each, not {held.tolist()}")
        estimate = self.frame.estimate
        self.driver = driver._replace(brake=held[1])
        self.hand_wheel, self.steer, self.k = driver.hand_wheel, steer, self.k + 1
        velocity = (estimate.vx, estimate.vy, estimate.yaw_rate)
        if self._multibody is not None:
            u, y = self._next_row(self._multibody, steer, held, velocity)
            return self._sense(Reading(self.time, u, y))
        self._unit, self.state, u, y, self._sensed = next_row(
            self._constants,
            s.integrator == "runge_kutta",
            s.substeps,
            s.substep,
            self._unit,
            self.state,
            self._sensed,
            steer,
            held,
            velocity,
            self.k,
        )
        return self._sense(Reading(self.time, u, y))

    def _next_row(
        self, plant: MultiBody, steer: float, held: Array, velocity: tuple[float, float, float]
    ) -> tuple[Array, Array]:
        """As the function of this name, with a plant of Python code: u and y of the reading."""
        s, (drive, driver, added, release) = self.scenario, held
        asked = (driver, added, release, self.heard, velocity, steer, s.dt)
        self._unit = brake_torques(s.brake_unit, self._geometry, self._unit, *asked)
        inputs = p.Inputs(steer + s.vehicle.steering_offset, drive_torques(drive, added), self._unit[0])
        bodies, self.state = plant.advance(self._bodies, self.state, inputs, s.dt)
        if bodies is None:
            self._lost = True
        else:
            self._bodies = bodies
        told = inputs._replace(steer=steer)
        u, y, self._sensed = read_sensors(self.record, self.k, self.state, told, self._sensed)
        return u, y

    def _sense(self, reading: Reading) -> Frame:
        told = self.friction if self.estimator.told_friction else math.nan
        estimate = self.listener.hear(reading, self.heard, self.state, told)
        self.ended = self._why_over(estimate)
        self.frame = Frame(Car(self.state), reading, estimate, self._unit[0])
        return self.frame

    def _why_over(self, estimate: Estimate) -> str:
        why = ending(self.state, np.array(estimate[:5]))
        if why == GOES_ON and self._lost:
            why = BEYOND_MODEL
        if why == GOES_ON and self.scenario.manoeuvre.off_course(Car(self.state), self.scenario.vehicle):
            why = OFF_COURSE
        return ENDINGS[why]


def rollout(scenario: Scenario, estimator: str | Estimator, controller: str | Controller, seed: int) -> Log:
    """One whole drive. An estimator that raises ends it; the log says why.

    Args:
        scenario: What is driven.
        estimator: What the controller sees the car through.
        controller: Who brakes.
        seed: Of the noise.
    """
    simulation, law = Simulation(scenario, estimator), CONTROLLERS.make(controller)
    book = LogBook(scenario.steps + 1)
    ended = ""
    filled: tuple[str, ...] = ()
    state = law.init(scenario.nominal)
    try:
        frame = simulation.reset(seed)
        while True:
            asked, state = law.act(state, frame.estimate, frame.reading)
            demand = BrakeDemand(*as_torques(asked.added, asked.release))
            listener = simulation.listener
            control = (simulation.time, simulation.hand_wheel, simulation.steer, simulation.friction)
            scalars = (*control, listener.nis, listener.seconds)
            book.write(frame.truth, frame.reading, frame.estimate, frame.brake, demand, scalars)
            filled = listener.filled
            if simulation.done:
                break
            frame = simulation.step(demand)
    except EstimatorError as error:  # a broken estimator is a row with its reason, not the end of a benchmark
        ended = str(error)
    return book.close(ended or simulation.ended, filled, scenario.vehicle)
