"""The Gymnasium face of the closed loop."""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vse_gym.catalogue import CONTROLLERS
from vse_gym.compiled import hold
from vse_gym.controllers.allocation import agent_demand, as_torques
from vse_gym.controllers.base import Controller, NoControl
from vse_gym.controllers.canonical import ACTIONS
from vse_gym.controllers.esc import StabilityControl
from vse_gym.controllers.observation import Encoder
from vse_gym.episodes import AS_WRITTEN, episodes
from vse_gym.estimators.base import Estimator
from vse_gym.listener import true_estimate
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.randomise import Randomise
from vse_gym.reward import INTERVENTION, MOVING, PEAK, SQUARES, Worth, reward_memory, step_reward, tally
from vse_gym.scenarios import Scenario
from vse_gym.sensors import Sensors
from vse_gym.simulation import Frame, Simulation
from vse_gym.types import NO_BRAKE, Array, BrakeDemand, Estimate


class StabilityControlEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A car in a standard manoeuvre; the agent brakes single wheels and sees what an estimator lets it see.

    Action, in [-1, 1]:
        ``brakes``, (4,): per wheel, a > 0 adds a times the wheel's cap, a < 0 releases |a| of the driver's torque
        (without effect where the driver does not brake, as in most manoeuvres).
        ``yaw_moment``, (1,): times the largest moment of one side's brakes, through the allocator; positive left.
        With a ``controller`` other than "none" the action is added to what the controller asks for.

    Observation: float32 vector, see :mod:`vse_gym.controllers.observation`: the estimate with its standard
        deviations, the road-wheel angle and the reference yaw rate that follows from them; or the truth, or the
        readings, in their place. ``info`` always holds the truth too: an agent must not be given it.

    Reward of a step, from true states, in [-1, 1]: 1 - 2 (
        0.2 min(1, |sideslip|/10 deg)           the car points where it goes
        + 0.3 min(1, |yaw rate - reference|/20 deg/s)   it turns as the driver wants
        + 0.1 mean(torque asked for/cap)        brakes cost
        + 0.4 min(1, |speed - wanted|/start speed))   and so does speed: standing still is no answer, nor rolling on
        The reference is limited by the road's friction alone, not by what the car did before. The wanted speed is the
        one at the start; from when the driver brakes, what his brakes and the road make of it. Until then more speed
        costs nothing.
        When a drive ends early, -1 for every step that was left.

    Terminated: |sideslip| > 80 deg above 1 m/s, off course, anything not finite, an estimated speed above 150 m/s, or
        where the multi-body plant's model ends. Truncated: the manoeuvre's duration.

    ``info`` has the same keys and shapes at every step, in SI units: truth; reading (the last valid value of each
        channel, and which are new); estimate (std is infinite where unknown); errors; metrics so far; ended (why).

    Args:
        manoeuvre: A name from the catalogue or an instance.
        estimator: The same, or several: one is drawn at every reset.
        vehicle: A name, a TOML file's path or a Vehicle: the true car.
        sensors: A suite's name, with extra sensors after a plus ("loud+optical"), or Sensors; or several, as above.
        friction: Of the road at the start; None: the manoeuvre's own.
        observation: "estimate", "truth" or "reading".
        action: "brakes" or "yaw_moment".
        controller: Works underneath the agent.
        nominal: What estimator and controller are told; None: this very car, friction 0.9.
        plant: "double_track", or "commonroad_mb", an independent truth for one of CommonRoad's cars.
        randomise: What is drawn about the scenario at every reset; nothing of it is told to estimator or controller.
        settings: Of the manoeuvre, in SI units: speed, amplitude, ...

    Raises:
        UnknownNameError, ValueError, TypeError: If a name, a number or a setting cannot be; the message says what can.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  as Gymnasium declares it

    def __init__(
        self,
        manoeuvre: str | Manoeuvre = "sine_with_dwell",
        estimator: str | Estimator | Sequence[str | Estimator] = "ekf",
        vehicle: str | p.Vehicle = "qin2014_understeer",
        sensors: str | Sensors | Sequence[str | Sensors] = "gaussian",
        friction: float | None = None,
        observation: str = "estimate",
        action: str = "brakes",
        controller: str | Controller = "none",
        nominal: Nominal | None = None,
        plant: str = "double_track",
        randomise: Randomise = AS_WRITTEN,
        render_mode: None = None,
        **settings: Any,
    ):
        if action not in ACTIONS:
            raise ValueError(f"action must be one of {', '.join(ACTIONS)}, not {action!r}")
        if render_mode is not None:
            raise ValueError(f"there is no render mode {render_mode!r}; vse-gym run --plot draws a drive")
        if friction is not None:
            settings["friction"] = float(friction)
        self.render_mode = render_mode
        self.encoder = Encoder(observation)
        self.episodes = episodes(manoeuvre, estimator, vehicle, sensors, nominal, plant, randomise, **settings)
        self.scenario: Scenario = self.episodes.written[0]
        self.controller: Controller = CONTROLLERS.make(controller)
        self._alone = type(self.controller) is NoControl
        self.action_kind = action
        self.action_space = spaces.Box(-1.0, 1.0, (ACTIONS[action],), np.float32)
        self.observation_space = spaces.Box(self.encoder.low, self.encoder.high, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start a drive; with a seed it meets the same noise as ``rollout`` with that seed."""
        super().reset(seed=seed)
        drive = int(self.np_random.integers(2**62)) if seed is None else seed
        self.scenario, estimator = self.episodes.draw(drive)
        self.simulation = Simulation(self.scenario, estimator)
        frame = self.simulation.reset(drive)
        told = self.scenario.nominal
        self._law_state = self.controller.init(told)
        self._view = self.encoder.view(told)
        self._seen = np.zeros(2)
        self._worth = worth(self.scenario)
        self._wanted = reward_memory(self._worth.value)
        self._geometry = told.vehicle.geometry
        self._totals = np.zeros(4)
        return self._observe(frame), self._info(frame)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drive on to the next reading.

        Raises:
            ValueError: If the action has the wrong shape or is not finite.
            RuntimeError: If the drive is over.
        """
        demand = self._demand(self._checked(action))
        simulation = self.simulation
        frame = simulation.step(demand)
        state, added = frame.truth.state, demand.added
        self._totals = tally(self._worth, self._totals, state, _motion(frame.estimate), added, demand.release)
        seen = (state, simulation.steer, added, simulation.driver.brake, simulation.friction)
        reward, self._wanted = step_reward(self._worth, self._wanted, *seen)
        observation = self._observe(frame)
        terminated = bool(simulation.ended)
        if terminated:
            reward -= self.scenario.steps - simulation.k
        return observation, reward, terminated, not terminated and simulation.done, self._info(frame)

    def _checked(self, action: NDArray[np.float32]) -> Array:
        values = np.asarray(action, dtype=float)
        if values.shape != self.action_space.shape:
            raise ValueError(f"the action must have the shape {self.action_space.shape}, not {values.shape}")
        if not math.isfinite(sum(values.tolist())):
            raise ValueError(f"the action must be finite, not {values.tolist()}")
        return values

    def _demand(self, action: Array) -> BrakeDemand:
        frame = self.simulation.frame
        estimate, reading, base = frame.estimate, frame.reading, NO_BRAKE
        if not self._alone:
            base, self._law_state = self.controller.act(self._law_state, estimate, reading)
            base = BrakeDemand(*as_torques(base.added, base.release))
        by_moment = self.action_kind == "yaw_moment"
        seen = (estimate.vx, estimate.yaw_rate, reading.steer)
        return BrakeDemand(*agent_demand(self._geometry, base.added, base.release, action, by_moment, *seen))

    def _observe(self, frame: Frame) -> NDArray[np.float32]:
        seen, steer = frame.estimate, frame.reading.steer
        if self.encoder.layout == "truth":
            seen, steer = true_estimate(frame.truth.state), self.simulation.steer
        heard = self.simulation.heard
        observation, self._seen = self.encoder.encode(self._view, self._seen, seen, steer, frame.reading, heard)
        return observation

    def _info(self, frame: Frame) -> dict[str, Any]:
        x, y, yaw, vx, vy, yaw_rate, *_ = state = frame.truth.state.tolist()
        estimate, totals = frame.estimate, self._totals
        sideslip, guess, spread = frame.truth.sideslip, estimate.sideslip, estimate.cov.diagonal()
        return {
            "truth": {
                "x": x,
                "y": y,
                "yaw": yaw,
                "vx": vx,
                "vy": vy,
                "yaw_rate": yaw_rate,
                "ax": state[p.AX],
                "ay": state[p.AY],
                "sideslip": sideslip,
            },
            "reading": {
                "time": frame.reading.time,
                "inputs": frame.reading.inputs.copy(),
                "y": self.simulation.heard.copy(),
                "valid": frame.reading.y == frame.reading.y,
            },
            "estimate": {
                "vx": estimate.vx,
                "vy": estimate.vy,
                "yaw_rate": estimate.yaw_rate,
                "ax": estimate.ax,
                "ay": estimate.ay,
                "sideslip": guess,
                "std": np.where(np.isnan(spread), np.inf, np.sqrt(spread)),
            },
            "errors": {
                "vx": estimate.vx - vx,
                "vy": estimate.vy - vy,
                "yaw_rate": estimate.yaw_rate - yaw_rate,
                "sideslip": math.remainder(guess - sideslip, 2 * math.pi) if math.isfinite(guess) else math.nan,
            },
            "metrics": {
                "peak_sideslip": float(totals[PEAK]),
                "sideslip_rmse": math.sqrt(totals[SQUARES] / max(1.0, totals[MOVING])),
                "brake_energy": state[p.BRAKE_WORK],
                "speed_lost": self.scenario.manoeuvre.speed - math.hypot(vx, vy),
                "intervention_time": float(totals[INTERVENTION]),
            },
            "ended": self.simulation.ended,
        }


def worth(scenario: Scenario) -> Any:
    """What the reward of a scenario's drives is measured by: a Worth, held for compiled code."""
    told, car = scenario.nominal, scenario.vehicle
    reference, caps = StabilityControl().reference(told), np.array(told.vehicle.brake_caps, dtype=float)
    braking = 1.0 / (car.mass * car.wheel_radius)
    return hold(Worth(reference, caps, float(scenario.manoeuvre.speed), braking, float(scenario.dt)))


def _motion(estimate: Estimate) -> Array:
    return np.array(estimate[:5])


IDS = {
    "vse_gym/SineWithDwell-v0": "sine_with_dwell",
    "vse_gym/StraightDriving-v0": "straight_driving",
    "vse_gym/HeldSteer-v0": "held_steer",
    "vse_gym/DoubleLaneChange-v0": "double_lane_change",
    "vse_gym/TripleLaneChange-v0": "triple_lane_change",
    "vse_gym/ObstacleAvoidance-v0": "obstacle_avoidance",
    "vse_gym/Slalom-v0": "slalom",
    "vse_gym/SplitFrictionBraking-v0": "split_friction_braking",
    "vse_gym/FrictionJump-v0": "friction_jump",
    "vse_gym/BrakeInTurn-v0": "brake_in_turn",
    "vse_gym/StepSteer-v0": "step_steer",
    "vse_gym/SteadyCircle-v0": "steady_circle",
    "vse_gym/SineSteer-v0": "sine_steer",
    "vse_gym/GentleCurve-v0": "gentle_curve",
}


def register_environments() -> None:
    """Give the environments their Gymnasium ids; importing vse_gym does it."""
    for name, manoeuvre in IDS.items():
        gymnasium.register(
            name,
            entry_point="vse_gym.env:StabilityControlEnv",
            vector_entry_point="vse_gym.vector.env:StabilityControlVectorEnv",
            kwargs={"manoeuvre": manoeuvre},
        )
